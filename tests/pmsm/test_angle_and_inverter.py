"""Harmonics of the angle in the map and the inverter's dead time, against equations written out."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import penode
from penode.arrays import float64
from penode.errors import InputError
from penode.models.networks import ConvexGradient
from penode.models.parameters import with_batch_axis
from penode.pmsm.bench.coenergy_table import true_flux_map
from penode.pmsm.bench.machines import TRACTION_300A
from penode.pmsm.flux_maps import FluxMap
from penode.pmsm.holds import HOLDS, Standing
from penode.pmsm.model import AngleMachine, DeadTimeMachine, Machine, dead_time_shape
from penode.pmsm.start import weak_start
from penode.pmsm.study import Study, identify
from penode.predictors.base import DEFAULT_SOLVER
from penode.predictors.field import Field
from penode.predictors.one_step import Substeps

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


def at_angle(flux_map, currents=CURRENTS, theta=THETA):
    with float64():
        found = with_batch_axis(flux_map).at_angle(jnp.asarray(currents), jnp.asarray(theta))
        return [np.asarray(part) for part in found]


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


@pytest.mark.parametrize("orders", [(6,), (6, 12), (12, 18), (4, 6)])
def test_maps_of_the_fit_are_means_over_the_angle(orders):
    flux_map = drawn(orders=orders, size=0.15)
    maps = AngleMachine(flux_map, R=0.01).maps()
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
        watched = with_batch_axis(AngleMachine(flux_map, R=0.01)).learned(jnp.asarray(CURRENTS))
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


def test_dead_time_is_the_smooth_sign_of_each_phase_current():
    with float64():
        found = dead_time_shape(jnp.asarray(CURRENTS), jnp.asarray(THETA), jnp.asarray([7.0]))
    expected = space_vector(np.tanh(phase_currents(CURRENTS, THETA) / 7.0), THETA)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)


def test_dead_time_at_known_phase_currents():
    """Phases at (+, -, -): along phase a with 4/3; at (+, 0, -): at -30 degrees with 2/sqrt(3)."""
    currents, theta = np.array([[90.0, 90 * np.cos(np.pi / 6)], [0.0, 0.0]]), np.zeros(2)
    currents[1, 1] = -90 * np.sin(np.pi / 6)
    with float64():
        found = dead_time_shape(jnp.asarray(currents), jnp.asarray(theta), jnp.asarray([0.1]))
    expected = [[4 / 3, 2 / np.sqrt(3) * np.cos(np.pi / 6)], [0, -2 / np.sqrt(3) * 0.5]]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_dead_time_is_4_over_pi_along_a_large_current_on_average():
    turn = np.linspace(0, 2 * np.pi, 3600, endpoint=False) + 1e-4
    currents = 300 * np.array([np.cos(2.0), np.sin(2.0)])[:, None] + 0 * turn
    with float64():
        found = dead_time_shape(jnp.asarray(currents), jnp.asarray(turn), jnp.asarray([0.1]))
    mean = np.asarray(found).mean(axis=1)
    np.testing.assert_allclose(mean, 4 / np.pi * np.array([np.cos(2.0), np.sin(2.0)]), atol=2e-3)


@pytest.mark.parametrize("part", [(0.0, 0.0), (0.0, 0.02), (0.01, 0.01), (-0.005, 0.1)])
def test_dead_time_over_a_part_of_a_sample_is_the_mean_there(part):
    """Against a sum over phase currents that move along straight lines."""
    phases = phase_currents(CURRENTS, THETA)
    rates = phase_currents(np.array([-CURRENTS[1], CURRENTS[0]]), THETA)
    middle, half = part
    shares = (np.arange(2000) + 0.5) / 1000 - 1
    mean = np.mean([np.tanh((phases + (middle + s * half) * rates) / 7.0) for s in shares], axis=0)
    with float64():
        given = jnp.asarray(np.array(part)[:, None] + 0 * THETA)
        known = (jnp.asarray(value) for value in (CURRENTS, THETA, [7.0]))
        found = dead_time_shape(*known, given)
    np.testing.assert_allclose(found, space_vector(mean, THETA), rtol=0, atol=1e-4)


@pytest.mark.parametrize("name", ["dq", "stationary"])
def test_stages_that_stand_for_parts_of_a_sample_follow_zero_crossings(name):
    """40 samples near rest from everywhere on the circle, against fifty steps a sample."""
    flux, theta, omega = machines()["dead time"].flux, np.linspace(0, 2 * np.pi, 700), 600.0
    machine = with_batch_axis(DeadTimeMachine(flux, 0.01, 3.0, 2.0))
    at = np.array([[-120.0], [90.0]]) + 0 * theta
    with float64():
        psi = np.asarray(with_batch_axis(flux).flux_and_inductance(jnp.asarray(at[:, :1]))[0])
    rest = 0.01 * at + omega * np.array([-psi[1], psi[0]]) + 12 / np.pi * at / 150.0

    def ended(solver, hold):
        @jax.jit
        def step(x, angle):
            rows = jnp.stack([*rest, omega + 0 * angle, angle])
            return solver.advance(Field(machine, lambda k: rows, hold, 1e-4), x[None])

        x = jnp.asarray(at)
        for k in range(40):
            x = step(x, jnp.asarray(theta + 1e-4 * omega * k))
        return np.asarray(x)

    with float64():
        exact = ended(Substeps(DEFAULT_SOLVER, 50), HOLDS[name])
        moments, parts = (ended(DEFAULT_SOLVER, h) for h in (HOLDS[name], Standing(HOLDS[name])))
    assert np.linalg.norm(parts - exact) < 0.35 * np.linalg.norm(moments - exact)


# --- the equation -----------------------------------------------------------------------------


def machines():
    flux_map = drawn()
    still = replace(flux_map, network=replace(flux_map.network, modulation=None), angle_orders=())
    return {
        "angle": AngleMachine(flux_map, R=0.02),
        "angle and dead time": DeadTimeMachine(flux_map, 0.02, 3.0, 5.0),
        "dead time": DeadTimeMachine(still, 0.02, 3.0, 5.0),
    }


@pytest.mark.parametrize("name", machines())
def test_derivative_is_the_equation_in_numpy(name):
    machine = machines()[name]
    u = np.stack([RANDOM.uniform(-50, 50, 40), RANDOM.uniform(-50, 50, 40)])
    omega = RANDOM.uniform(-900, 900, 40)
    with float64():
        rows = jnp.asarray(np.concatenate([u, [omega], [THETA]]))
        found = jax.jit(lambda m, x, u: m.derivative(x, u))(
            with_batch_axis(machine), jnp.asarray(CURRENTS), rows
        )
    flux_map = machine.flux
    if not flux_map.angle_orders:
        shifts = np.zeros((7, 4))
        flux_map = replace(flux_map, network=replace(flux_map.network, modulation=shifts))
        flux_map = replace(flux_map, angle_orders=ORDERS)
    arriving = u
    if isinstance(machine, DeadTimeMachine):
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
        rate = np.asarray(with_batch_axis(machine).derivative(jnp.asarray(CURRENTS), rows))
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
    machine, balance = weak_start([dead_time_run], "coenergy", inverter=True)
    assert float(machine.dead_time_voltage) == pytest.approx(2.4, rel=0.1)
    assert float(machine.R) == pytest.approx(TRACTION_300A.resistance, rel=0.1)
    assert 0.01 < balance.independence["R"] < 0.3  # both drop voltage along the current
    blind, _ = weak_start([dead_time_run], "coenergy")
    assert type(blind) is Machine
    assert float(blind.R) > 1.5 * TRACTION_300A.resistance


def test_weak_start_finds_the_harmonics_of_the_bench(slow_run):
    machine, _ = weak_start([slow_run], "coenergy", angle_orders=ORDERS)
    currents = slow_run.stack(("i_d", "i_q"))[::37].T
    theta = slow_run.channels["theta_el"][::37]
    found = at_angle(machine.flux, currents, theta)[0] - machine.maps()["flux_map"](*currents)
    w = jax.vmap(jax.grad(TRACTION_300A.coenergy, argnums=(0, 1)))
    with float64():
        psi = np.array(w(*map(jnp.asarray, (*currents, theta))))
    true = psi - true_flux_map(TRACTION_300A, *currents).T
    assert np.sqrt(np.mean((found - true) ** 2)) < 0.4 * np.sqrt(np.mean(true**2))


def test_identification_with_the_inverter_term(dead_time_run, tmp_path):
    fit = identify([dead_time_run], study=Study(horizon=40, inverter=True, angle_orders=()))
    voltage, resistance = fit.parameters["dead_time_voltage"], fit.parameters["R"]
    assert voltage.unit == "V"
    assert voltage.value == pytest.approx(2.4, rel=0.05)
    assert resistance.value == pytest.approx(TRACTION_300A.resistance, rel=0.1)
    assert fit.provenance["inverter"] is True
    fit.save(tmp_path)
    again = penode.Fit.load(tmp_path)
    np.testing.assert_array_equal(again.flux_map(50.0, 9.0), fit.flux_map(50.0, 9.0))


# --- what is refused --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("choice", "sentence"),
    [
        ({"flux_map": "spline", "angle_orders": (6,)}, "cannot follow the angle"),
        ({"angle_orders": (6, 6)}, "distinct whole numbers"),
        ({"angle_orders": (0,)}, "from 1"),
        ({"hold": "alpha"}, "choose one of dq, stationary"),
    ],
)
def test_choices_that_cannot_be_are_refused(choice, sentence):
    with pytest.raises(InputError, match=sentence):
        Study(**choice)


@pytest.mark.parametrize("choice", [{"inverter": True}, {"angle_orders": (6,)}])
def test_a_recording_without_the_angle_is_refused_where_it_is_needed(dead_time_run, choice):
    channels = {k: v for k, v in dead_time_run.channels.items() if k != "theta_el"}
    bare = replace(dead_time_run, name="bare.csv", channels=channels)
    with pytest.raises(InputError, match=r"bare\.csv: no channel theta_el"):
        identify([dead_time_run], study=Study(**choice), validation=[bare])
