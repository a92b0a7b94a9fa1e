"""Harmonics of the angle in the map and the inverter's dead time, against equations written out."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import penode
from penode.arrays import float64
from penode.bench.coenergy_table import true_flux_map
from penode.bench.machines import TRACTION_300A
from penode.errors import InputError
from penode.models.inputs import Inputs
from penode.models.networks import ConvexGradient
from penode.models.parameters import with_batch_axis
from penode.pmsm.balance.start import weak_start
from penode.pmsm.machine.dead_time import DeadTime
from penode.pmsm.machine.flux_maps import FluxMap
from penode.pmsm.machine.holds import HOLDS
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.terms import Resistance
from penode.pmsm.study import identify
from penode.pmsm.study_settings import Study
from penode.predictors.base import DEFAULT_SOLVER, Predictor
from penode.predictors.field import Field
from penode.predictors.implicit import ImplicitMidpoint, Trapezoidal
from penode.predictors.multistep import AdamsBashforth
from penode.predictors.one_step import RungeKutta, Substeps
from penode.predictors.tableaus import AB2, AB5, DOPRI5, RUNGE_KUTTA

ORDERS = (6, 12)
SCALE, FLUX = 200.0, 0.08
RANDOM = np.random.default_rng(11)
CURRENTS = RANDOM.uniform(-250, 250, (2, 40))
THETA = RANDOM.uniform(0, 2 * np.pi, 40)


def drawn(seed=3, orders=ORDERS, size=0.4):
    """Return a map whose harmonics are large, unlike a fresh one's."""
    network = ConvexGradient.random(2, 7, seed, 2 * len(orders))
    shifts = size * np.random.default_rng(seed).normal(size=network.modulation.shape)
    network = replace(network, modulation=shifts, offset=np.array([0.4, -0.1]))
    return FluxMap(network, SCALE, FLUX, orders)


def by_hand(flux_map, currents, theta):
    """Return psi (2, point) in Vs, in NumPy; complex arguments differentiate it."""
    network, orders = flux_map.network, np.array(flux_map.angle_orders)[:, None]
    waves = np.concatenate([np.cos(orders * theta), np.sin(orders * theta)])
    x = currents / SCALE
    hidden = network.directions @ x + network.bias[:, None] + network.modulation @ waves
    pull = network.directions.T @ (network.gain[:, None] * np.tanh(hidden))
    return FLUX * (network.offset[:, None] + network.stiffness @ x + pull)


@jax.jit
def compiled_at_angle(flux_map, currents, theta):
    return with_batch_axis(flux_map).at_angle(currents, theta)


def at_angle(flux_map, currents=CURRENTS, theta=THETA):
    with float64():
        return [np.asarray(part) for part in compiled_at_angle(flux_map, currents, theta)]


def test_flux_linkage_inductance_and_angle_slope_at_an_angle():
    flux_map, tiny = drawn(), 1e-30
    linkage, inductance, slope = at_angle(flux_map)
    np.testing.assert_allclose(linkage, by_hand(flux_map, CURRENTS, THETA), rtol=0, atol=1e-15)
    for k, shift in enumerate(1j * tiny * np.eye(2)[:, :, None]):
        expected = by_hand(flux_map, CURRENTS + shift, THETA).imag / tiny
        np.testing.assert_allclose(inductance[:, k], expected, rtol=1e-12, atol=1e-18)
    expected = by_hand(flux_map, CURRENTS, THETA + 1j * tiny).imag / tiny
    assert np.abs(expected).max() > 0.1 * FLUX
    np.testing.assert_allclose(slope, expected, rtol=0, atol=1e-14)


def test_central_differences_agree():
    flux_map = drawn()
    _, inductance, slope = at_angle(flux_map)
    for k, step in enumerate(1e-3 * np.eye(2)[:, :, None]):
        ends = [at_angle(flux_map, CURRENTS + sign * step)[0] for sign in (1, -1)]
        np.testing.assert_allclose(inductance[:, k], (ends[0] - ends[1]) / 2e-3, atol=1e-11)
    ends = [at_angle(flux_map, theta=THETA + shift)[0] for shift in (1e-6, -1e-6)]
    np.testing.assert_allclose(slope, (ends[0] - ends[1]) / 2e-6, atol=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_reciprocal_and_positive_definite_at_every_angle(seed):
    inductance = at_angle(drawn(seed), 5 * CURRENTS)[1]
    np.testing.assert_allclose(inductance[0, 1], inductance[1, 0], rtol=1e-12, atol=1e-18)
    assert np.linalg.eigvalsh(inductance.transpose(2, 0, 1)).min() > 0


def test_one_coenergy_stands_behind_currents_and_angle():
    """The angle slope too is a gradient: its Jacobian over the currents is symmetric."""
    flux_map = drawn()
    columns = []
    for step in 1e-3 * np.eye(2)[:, :, None]:
        ends = [at_angle(flux_map, CURRENTS + sign * step)[2] for sign in (1, -1)]
        columns.append((ends[0] - ends[1]) / 2e-3)
    assert np.abs(columns[0][1]).max() > 1e-6
    np.testing.assert_allclose(columns[0][1], columns[1][0], rtol=0, atol=1e-11)


@pytest.mark.parametrize("orders", [(6, 12), (4, 6)])
def test_maps_of_the_fit_are_means_over_the_angle(orders):
    flux_map = drawn(orders=orders, size=0.15)
    maps = Machine(flux_map, (Resistance(0.01),)).maps()
    turn = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    mean = np.mean([by_hand(flux_map, CURRENTS, th + 0 * THETA) for th in turn], axis=0)
    np.testing.assert_allclose(maps["flux_map"](*CURRENTS), mean, rtol=0, atol=1e-5 * FLUX)
    unshifted = np.zeros_like(flux_map.network.modulation)
    still = replace(flux_map, network=replace(flux_map.network, modulation=unshifted))
    assert np.abs(by_hand(still, CURRENTS, 0 * THETA) - mean).max() > 1e-3 * FLUX
    slopes = np.mean([at_angle(flux_map, theta=th + 0 * THETA)[1] for th in turn[::6]], axis=0)
    found = maps["differential_inductance"](*CURRENTS)
    np.testing.assert_allclose(found, slopes, rtol=0, atol=1e-4 * FLUX / SCALE)
    with float64():
        watched = with_batch_axis(Machine(flux_map, (Resistance(0.01),))).learned(
            jnp.asarray(CURRENTS)
        )
    np.testing.assert_allclose(watched, maps["flux_map"](*CURRENTS), rtol=1e-13, atol=1e-15)


# --- dead time --------------------------------------------------------------------------------


def phase_currents(currents, theta):
    """Return the three phases (3, point) as projections of the rotating vector."""
    vector = (currents[0] + 1j * currents[1]) * np.exp(1j * theta)
    return np.array([(vector * np.exp(-2j * np.pi * k / 3)).real for k in range(3)])


def space_vector(phases, theta):
    """Return the dq components (2, point) of phases by the sum of rotated phases."""
    vector = 2 / 3 * sum(phases[k] * np.exp(2j * np.pi * k / 3) for k in range(3))
    vector = vector * np.exp(-1j * theta)
    return np.array([vector.real, vector.imag])


@jax.jit
def compiled_drop(term, currents, u):
    return with_batch_axis(term).drop(currents, u, None)


def signs(currents, theta, scale, span=(0.0, 0.0), omega=0.0):
    """Return the drop of a dead-time voltage of 1 V, (2, point)."""
    u = Inputs(np.stack([omega + 0 * theta, theta]), ("omega_el", "theta_el"), span)
    with float64():
        return np.asarray(compiled_drop(DeadTime(1.0, scale), currents, u))


def test_dead_time_is_the_smooth_sign_of_each_phase_current():
    found = signs(CURRENTS, THETA, 7.0)
    expected = space_vector(np.tanh(phase_currents(CURRENTS, THETA) / 7.0), THETA)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)


def test_a_knee_is_never_sharper_than_the_narrowest_nor_a_straight_line():
    """0.003 times 170 A is 0.51 A; the power of two below it is the narrowest, 64 A the widest."""
    term = DeadTime(1.0, 0.1).prepared(170.0)
    assert (float(term.dead_time_current), term.narrowest) == (0.1, 0.5)
    rows, currents = np.stack([0 * THETA, THETA]), CURRENTS / 40
    half = 0.5 / np.hypot(1.0, 1.0 / 128.0)
    for width, bent in ((1e-9, 0.0), (0.5, half), (48.0, 38.4), (1e12, 64.0)):
        with float64():
            inputs = Inputs(rows, ("omega_el", "theta_el"), (0.0, 0.0))
            found = compiled_drop(replace(term, dead_time_current=width), currents, inputs)
        expected = signs(currents, THETA, np.hypot(bent, 0.5))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)


def test_dead_time_at_known_phase_currents():
    """Phases at (+, -, -): along phase a with 4/3; at (+, 0, -): at -30 degrees with 2/sqrt(3)."""
    currents, theta = np.array([[90.0, 90 * np.cos(np.pi / 6)], [0.0, 0.0]]), np.zeros(2)
    currents[1, 1] = -90 * np.sin(np.pi / 6)
    found = signs(currents, theta, 0.1)
    expected = [[4 / 3, 2 / np.sqrt(3) * np.cos(np.pi / 6)], [0, -2 / np.sqrt(3) * 0.5]]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_dead_time_is_4_over_pi_along_a_large_current_on_average():
    turn = np.linspace(0, 2 * np.pi, 3600, endpoint=False) + 1e-4
    currents = 300 * np.array([np.cos(2.0), np.sin(2.0)])[:, None] + 0 * turn
    mean = signs(currents, turn, 0.1).mean(axis=1)
    np.testing.assert_allclose(mean, 4 / np.pi * np.array([np.cos(2.0), np.sin(2.0)]), atol=2e-3)


@pytest.mark.parametrize("span", [(0.0, 1e-9), (-0.02, 0.02), (0.0, 0.02), (-0.105, 0.095)])
def test_dead_time_over_a_part_of_a_sample_is_the_mean_there(span):
    """Against a sum over phase currents that move along straight lines; a turn of 1 rad/s."""
    phases = phase_currents(CURRENTS, THETA)
    rates = phase_currents(np.array([-CURRENTS[1], CURRENTS[0]]), THETA)
    begin, end = span
    times = begin + (end - begin) * (np.arange(2000) + 0.5) / 2000
    mean = np.mean([np.tanh((phases + time * rates) / 7.0) for time in times], axis=0)
    found = signs(CURRENTS, THETA, 7.0, span, omega=1.0)
    np.testing.assert_allclose(found, space_vector(mean, THETA), rtol=0, atol=1e-4)


STANDING_FOR_PARTS = {
    **{t.name: RungeKutta(t) for t in RUNGE_KUTTA if t.order > 1 and None not in t.parts},
    "rk4 twice": Substeps(DEFAULT_SOLVER, 2),
    "implicit midpoint": ImplicitMidpoint(),
    "trapezoidal": Trapezoidal(),
}
IMPLICIT = (ImplicitMidpoint, Trapezoidal)
QUICK = [(name, "dq") for name in ("rk4", "rk4 twice")]


def crossed(solver, frame, machine, at, theta, parts=1):
    """Return where 40 samples near rest end from everywhere on the circle, (2, angle).

    With steps of as many parts of a sample, where the voltage is the same in all of them.
    """
    omega, width = 600.0, 1e-4 / parts
    psi = np.asarray(with_batch_axis(machine).flux.flux_and_inductance(jnp.asarray(at[:, :1]))[0])
    lost = 4 / np.pi * 3.0 * at / 150.0 if len(machine.terms) == 3 else 0.0
    rest = 0.01 * at + omega * np.array([-psi[1], psi[0]]) + lost

    @jax.jit
    def step(x, angle):
        rows = jnp.stack([*rest, omega + 0 * angle, angle])
        named = [rows[("u_d", "u_q", "omega_el", "theta_el").index(n)] for n in machine.inputs]
        field = Field(with_batch_axis(machine), lambda k: jnp.stack(named), HOLDS[frame], width)
        return solver.advance(field, x[None])

    x = jnp.asarray(at)
    for k in range(40 * parts):
        x = step(x, jnp.asarray(theta + width * omega * k))
    return np.asarray(x)


FINE = {}
#: Errors fall with the square of the steps a sample: a thirtieth of the solvers' own.
FINELY = 6


def finely_crossed(frame, machines, at, theta):
    """Return what as many steps a sample give for each machine; computed once a frame."""
    if frame not in FINE:
        # In dq shorter samples are the same, and compile in a sixth of the time.
        fine = (DEFAULT_SOLVER, 6) if frame == "dq" else (Substeps(DEFAULT_SOLVER, FINELY), 1)
        FINE[frame] = [crossed(fine[0], frame, m, at, theta, fine[1]) for m in machines]
    return FINE[frame]


class Momentary(DeadTime):
    """Dead time by the signs at the stages' moments, whatever they stand for."""

    def drop(self, x, u, flux):
        return super().drop(x, u.over((0.0, 0.0)), flux)


@pytest.mark.usefixtures("quickly_compiled")
@pytest.mark.parametrize(
    ("name", "frame"),
    [
        # A method of each kind; the rest, and the other frame, in `make validate`.
        pytest.param(name, frame, marks=() if (name, frame) in QUICK else pytest.mark.slow)
        for name, solver in STANDING_FOR_PARTS.items()
        # Implicit methods take their parts from the same place in both frames; compiling is slow.
        for frame in (("dq",) if isinstance(solver, IMPLICIT) else ("dq", "stationary"))
    ],
)
def test_stages_that_stand_for_parts_of_a_sample_follow_zero_crossings(name, frame):
    """What the signs add to 40 samples, against six steps a sample."""
    theta = np.linspace(0, 2 * np.pi, 700)
    at = np.array([[-120.0], [90.0]]) + 0 * theta
    solver, flux = STANDING_FOR_PARTS[name], machines()["dead time"].flux
    with_dead_time, momentary, without = (
        Machine(flux, (Resistance(0.01), *terms))
        for terms in ((DeadTime(3.0, 2.0),), (Momentary(3.0, 2.0),), ())
    )
    with float64():
        exact, without_it = finely_crossed(frame, (with_dead_time, without), at, theta)
        # The solver's own error, without any dead time, is no fault of its parts.
        own = crossed(solver, frame, without, at, theta) - without_it
        errors = [
            np.linalg.norm(crossed(solver, frame, machine, at, theta) - own - exact)
            for machine in (with_dead_time, momentary)
        ]
    assert errors[0] < 0.7 * errors[1]


REFUSED = {"dopri5": RungeKutta(DOPRI5), "ab2": AdamsBashforth(AB2), "ab5": AdamsBashforth(AB5)}


@pytest.mark.parametrize("name", REFUSED)
def test_a_solver_whose_stages_stand_for_no_part_is_refused_with_dead_time(name):
    machine = with_batch_axis(Machine(machines()["dead time"].flux, (DeadTime(3.0, 2.0),)))
    predictor = Predictor(1e-4, REFUSED[name])
    history = jnp.full((predictor.past, 2, 1), 100.0)
    with pytest.raises(InputError, match="dead time takes its mean over the part"):
        predictor.step(machine, history, lambda k: jnp.ones((4, 1)))


# --- the equation -----------------------------------------------------------------------------


def machines():
    flux_map = drawn()
    still = replace(flux_map, network=replace(flux_map.network, modulation=None), angle_orders=())
    return {
        "angle": Machine(flux_map, (Resistance(0.02),)),
        "angle and dead time": Machine(flux_map, (Resistance(0.02), DeadTime(3.0, 5.0))),
        "dead time": Machine(still, (Resistance(0.02), DeadTime(3.0, 5.0))),
    }


@pytest.mark.parametrize("name", machines())
def test_derivative_is_the_equation_in_numpy(name):
    machine = machines()[name]
    u = np.stack([RANDOM.uniform(-50, 50, 40), RANDOM.uniform(-50, 50, 40)])
    omega = RANDOM.uniform(-900, 900, 40)
    with float64():
        rows = jnp.asarray(np.concatenate([u, [omega], [THETA]]))
        found = jax.jit(lambda m, x, u: m.derivative(x, u))(
            with_batch_axis(machine), jnp.asarray(CURRENTS), Inputs(rows, machine.inputs)
        )
    flux_map = machine.flux
    if not flux_map.angle_orders:
        shifts = np.zeros((7, 4))
        flux_map = replace(flux_map, network=replace(flux_map.network, modulation=shifts))
        flux_map = replace(flux_map, angle_orders=ORDERS)
    arriving = u
    if "dead time" in name:
        arriving = u - 3.0 * space_vector(np.tanh(phase_currents(CURRENTS, THETA) / 5.0), THETA)
    psi, tiny = by_hand(flux_map, CURRENTS, THETA), 1e-30
    turning = by_hand(flux_map, CURRENTS, THETA + 1j * tiny).imag / tiny
    left = arriving - 0.02 * CURRENTS - omega * (np.array([-psi[1], psi[0]]) + turning)
    shifts = 1j * tiny * np.eye(2)[:, :, None]
    inductance = np.stack(
        [by_hand(flux_map, CURRENTS + shift, THETA).imag / tiny for shift in shifts], axis=1
    )
    expected = np.linalg.solve(inductance.transpose(2, 0, 1), left.T[..., None])[..., 0].T
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())


def test_power_is_copper_loss_stored_power_and_torque_times_speed():
    """u.i = R i.i + d(W_m)/dt + omega (i'J psi + dW_c/d theta); W_m + W_c = i.psi."""
    machine, omega = machines()["angle"], 500.0
    u = np.stack([RANDOM.uniform(-50, 50, 40), RANDOM.uniform(-50, 50, 40)])
    with float64():
        rows = jnp.asarray(np.concatenate([u, np.full((1, 40), omega), [THETA]]))
        inputs = Inputs(rows, machine.inputs)
        rate = np.asarray(with_batch_axis(machine).derivative(jnp.asarray(CURRENTS), inputs))
    network = machine.flux.network

    def coenergy(currents, theta):
        orders = np.array(ORDERS)[:, None]
        waves = np.concatenate([np.cos(orders * theta), np.sin(orders * theta)])
        x = currents / SCALE
        hidden = network.directions @ x + network.bias[:, None] + network.modulation @ waves
        quadratic = network.offset @ x + np.sum(x * (network.stiffness @ x), axis=0) / 2
        return FLUX * SCALE * (quadratic + network.gain @ np.log(np.cosh(hidden)))

    def stored(currents, theta):
        psi = by_hand(machine.flux, currents, theta)
        return np.sum(currents * psi, axis=0) - coenergy(currents, theta)

    step = 1e-30j
    storing = stored(CURRENTS + step * rate, THETA + step * omega).imag / 1e-30
    psi = by_hand(machine.flux, CURRENTS, THETA)
    turning = coenergy(CURRENTS, THETA + step).imag / 1e-30
    torque = CURRENTS[1] * psi[0] - CURRENTS[0] * psi[1] + turning
    supplied = np.sum(u * CURRENTS, axis=0)
    used = 0.02 * np.sum(CURRENTS**2, axis=0) + storing + omega * torque
    np.testing.assert_allclose(supplied, used, rtol=0, atol=1e-8 * np.abs(used).max())


# --- identification ---------------------------------------------------------------------------


def test_weak_start_finds_dead_time_beside_the_resistance(dead_time_run):
    machine, balance, _ = weak_start([dead_time_run], "coenergy", terms=(DeadTime(),))
    assert float(machine.terms[1].dead_time_voltage) == pytest.approx(2.4, rel=0.1)
    assert float(machine.terms[0].R) == pytest.approx(TRACTION_300A.resistance, rel=0.1)
    assert 0.01 < balance.independence["R"] < 0.3  # both drop voltage along the current
    blind, *_ = weak_start([dead_time_run], "coenergy")
    assert float(blind.terms[0].R) > 1.5 * TRACTION_300A.resistance


def test_weak_start_finds_the_harmonics_of_the_bench(slow_run):
    machine, *_ = weak_start([slow_run], "coenergy", angle_orders=ORDERS)
    currents = slow_run.stack(("i_d", "i_q"))[::37].T
    theta = slow_run.channels["theta_el"][::37]
    found = at_angle(machine.flux, currents, theta)[0] - machine.maps()["flux_map"](*currents)
    w = jax.jit(jax.vmap(jax.grad(TRACTION_300A.coenergy, argnums=(0, 1))))
    with float64():
        psi = np.array(w(*map(jnp.asarray, (*currents, theta))))
    true = psi - true_flux_map(TRACTION_300A, *currents).T
    assert np.sqrt(np.mean((found - true) ** 2)) < 0.4 * np.sqrt(np.mean(true**2))


@pytest.mark.slow
def test_identification_with_the_inverter_term(dead_time_run, tmp_path):
    study = Study(horizon=8, terms=(DeadTime(),), angle_orders=ORDERS)
    fit = identify([dead_time_run], study=study)
    voltage, resistance = fit.parameters["dead_time_voltage"], fit.parameters["R"]
    assert voltage.unit == "V"
    assert voltage.value == pytest.approx(2.4, rel=0.01)
    assert resistance.value == pytest.approx(TRACTION_300A.resistance, rel=0.01)
    assert fit.provenance["inverter"] is True
    fit.save(tmp_path)
    again = penode.Fit.load(tmp_path)
    np.testing.assert_array_equal(again.flux_map(50.0, 9.0), fit.flux_map(50.0, 9.0))


# --- what is refused --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("choice", "sentence"),
    [
        ({"flux_map": "spline", "angle_orders": (6,)}, "cannot follow angle orders"),
        ({"angle_orders": (6, 6)}, "distinct whole numbers"),
        ({"angle_orders": (0,)}, "from 1"),
        ({"hold": "alpha"}, "must be one of dq, stationary"),
    ],
)
def test_choices_that_cannot_be_are_refused(choice, sentence):
    with pytest.raises(InputError, match=sentence):
        Study(**choice)


@pytest.mark.parametrize("choice", [{"terms": (DeadTime(),)}, {"angle_orders": (6,)}])
def test_a_recording_without_the_angle_is_refused_where_it_is_needed(dead_time_run, choice):
    channels = {k: v for k, v in dead_time_run.channels.items() if k != "theta_el"}
    bare = replace(dead_time_run, name="bare.csv", channels=channels)
    with pytest.raises(InputError, match=r"bare\.csv: channel theta_el is missing"):
        identify([dead_time_run], study=Study(**choice), validation=[bare])
