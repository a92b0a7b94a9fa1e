"""Terms of the voltage equation: laws over all of them, and each against its formula in NumPy."""

from dataclasses import replace
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from penode.arrays import float64
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.models.inputs import Inputs
from penode.models.parameters import setting_at, with_batch_axis
from penode.models.transforms import Positive
from penode.pmsm.balance.trial_balance import DirectedDeadTime
from penode.pmsm.balance.voltage_balance import (
    BalanceForm,
    PolynomialMap,
    balance_equations,
    term_columns,
)
from penode.pmsm.machine.dead_time import DeadTime, PhaseDeadTime
from penode.pmsm.machine.flux_maps import Flux, FluxMap
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.term_registry import (
    TERMS,
    completed,
    physical_places,
    physical_values,
    term_name,
    terms_of,
    with_physical,
)
from penode.pmsm.machine.terms import Channel, Resistance, Rotation, TemperatureResistance
from penode.training.weak_form import HannWindow

RANDOM = np.random.default_rng(7)
COUNT = 60
POLYNOMIAL = PolynomialMap(True, 200.0, 2)

#: Every term there is: a new one joins by its line in TERMS.
ALL = {
    **TERMS,
    "rotation": Rotation,
    "mean dead time": DirectedDeadTime,
    "soft dead time": lambda: DeadTime(dead_time_softness=0.5),
    "nodes": lambda: DeadTime(dead_time_softness=0.5, dead_time_tail="node"),
    "junctions": lambda: DeadTime(junction_voltage=0.04),
    "junctions by phase": lambda: PhaseDeadTime(junction_voltage=0.04),
}


def drawn(kind):
    """Return a term with random parameters: positive ones where they must be."""
    term = kind().prepared(200.0)
    changed = {}
    for name in type(term).__dataclass_fields__:
        value = getattr(term, name)
        if isinstance(value, np.ndarray):
            setting = setting_at(term, (jax.tree_util.GetAttrKey(name),))
            positive = isinstance(setting.transform, Positive) or not setting.physical
            changed[name] = RANDOM.uniform(1, 5) if positive else RANDOM.normal()
    return replace(term, **changed)


def recording(terms):
    """Return random samples of all that terms read, within what is credible."""
    channels = {n: RANDOM.uniform(-150, 150, COUNT) for n in ("i_d", "i_q", "u_d", "u_q")}
    for term in completed(terms):
        for channel in term.channels:
            low, high = max(channel.lowest, -300.0), min(channel.highest, 300.0)
            channels[channel.name] = RANDOM.uniform(low, high, COUNT)
    return Experiment("random", 1e-4, channels)


@eqx.filter_jit
def compiled_drop(term, x, u, flux):
    return with_batch_axis(term).drop(x, u, flux)


def dropped(term, run, psi, span=(0.0, 0.0)):
    """Return the predictor's face of a term, (2, time) in V, at single moments or over a span."""
    names = tuple(channel.name for channel in term.channels)
    with float64():
        u = Inputs(jnp.asarray(run.stack(names).T if names else np.zeros((0, COUNT))), names, span)
        flux = Flux(jnp.asarray(psi), None, 0.0)
        x = jnp.asarray(run.stack(("i_d", "i_q")).T)
        return np.asarray(compiled_drop(term, x, u, flux))


def dead_time_in_numpy(term, run, psi):
    i_d, i_q, theta = run.stack(("i_d", "i_q", "theta_el")).T
    angles = theta - np.array([[0.0], [2.0], [-2.0]]) * np.pi / 3
    phases = i_d * np.cos(angles) - i_q * np.sin(angles)
    if isinstance(term, PhaseDeadTime):
        voltages = np.array([[getattr(term, f"dead_time_voltage_{phase}")] for phase in "abc"])
    else:
        voltages = term.dead_time_voltage
    width, softness = term.dead_time_current, term.dead_time_softness
    if term.narrowest:  # never narrower, and never 128 times as wide
        width = np.hypot(width / np.hypot(1.0, width / (128 * term.narrowest)), term.narrowest)
    scaled = phases / width
    softness = 0.0 if softness is None else softness
    tail = 2 / np.pi * np.arctan(scaled)
    if term.dead_time_tail == "node":  # recharged within the dead time from a scaled current of 1
        large = 1 - 1 / (2 * np.maximum(np.abs(scaled), 1.0))
        tail = np.where(np.abs(scaled) < 1.0, scaled / 2, np.sign(scaled) * large)
    signs = voltages * ((1 - softness) * np.tanh(scaled) + softness * tail)
    if term.junction_voltage is not None:  # 16 e-folds below the largest current
        saturation = term.narrowest / 0.003 * np.exp(-16)
        signs = signs + term.junction_voltage * np.arcsinh(phases / (2 * saturation))
    return 2 / 3 * np.stack([(signs * np.cos(angles)).sum(0), -(signs * np.sin(angles)).sum(0)])


def along_the_current(term, run, psi):
    i = run.stack(("i_d", "i_q")).T
    return term.directed_voltage * i / np.sqrt((i**2).sum(0) + term.fade**2)


def mean_dead_time(term, run, psi):
    i = run.stack(("i_d", "i_q")).T
    return term.inverter_voltage * i / np.hypot(np.hypot(*i), term.knee_current or 1e-9)


def warm_resistance(term, run, psi):
    factor = 1 + term.alpha * (run.channels["winding_temperature"] - 20.0)
    return term.R * factor * run.stack(("i_d", "i_q")).T


#: The voltage of each term, (2, time), written down once more and by hand.
FORMULAS = {
    "resistance": lambda term, run, psi: term.R * run.stack(("i_d", "i_q")).T,
    "temperature_resistance": warm_resistance,
    "magnet_temperature": lambda term, run, psi: (
        term.magnet_coefficient
        * run.channels["omega_el"]
        * (run.channels["magnet_temperature"] - 20.0)
        * np.array([[0.0], [1.0]])
    ),
    "dead_time": dead_time_in_numpy,
    "phase_dead_time": dead_time_in_numpy,
    "soft dead time": dead_time_in_numpy,
    "nodes": dead_time_in_numpy,
    "junctions": dead_time_in_numpy,
    "junctions by phase": dead_time_in_numpy,
    "rotation": lambda _, run, psi: run.channels["omega_el"] * np.stack([-psi[1], psi[0]]),
    "mean dead time": along_the_current,
    "mean_dead_time": mean_dead_time,
}


def test_every_term_has_a_formula():
    assert FORMULAS.keys() == ALL.keys()


@pytest.mark.parametrize("name", ALL)
def test_a_term_drops_what_its_formula_says(name):
    term = drawn(ALL[name])
    run, psi = recording([term]), RANDOM.normal(size=(2, COUNT))
    expected = FORMULAS[name](term, run, psi)
    np.testing.assert_allclose(dropped(term, run, psi), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ALL)
def test_both_faces_of_a_term_agree(name):
    """What the predictor drops is what the weak form's columns give with the same parameters."""
    term = drawn(ALL[name])
    run = recording([term])
    basis = POLYNOMIAL.basis(run.stack(("i_d", "i_q")))
    weights = RANDOM.normal(size=basis.shape[2])
    known, by_parameter, by_psi = term_columns(run, (term,))
    values = np.array([*physical_values((term,)).values()])
    from_columns = known + by_parameter @ values + np.squeeze(by_psi @ (basis @ weights)[..., None])
    half = 0.5 * run.time_step
    expected = dropped(term, run, (basis @ weights).T, (-half, half)).T
    scale = np.abs(expected).max()
    assert scale > 0
    np.testing.assert_allclose(from_columns, expected, rtol=0, atol=1e-12 * scale)
    if "junctions" not in name:  # whose law is known to the columns
        assert np.abs(known).max() < 1e-12 * scale  # linear in what is solved for


def test_terms_together_drop_what_each_of_them_drops():
    terms = tuple(drawn(ALL[name]) for name in ("dead_time", "resistance", "rotation"))
    run, psi = recording(terms), RANDOM.normal(size=(2, COUNT))
    known, by_parameter, by_psi = term_columns(run, terms)
    values = np.array([*physical_values(terms).values()])
    found = known + by_parameter @ values + np.squeeze(by_psi @ psi.T[..., None])
    half = 0.5 * run.time_step
    expected = sum(dropped(term, run, psi, (-half, half)).T for term in terms)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("name", ALL)
def test_the_machine_loses_what_the_term_drops(name):
    """L di/dt = u - drops: the whole equation, with and without the term."""
    term = drawn(ALL[name])
    run = recording([term])
    flux = FluxMap(Linear(), 1.0, 1.0)
    others = [t for t in completed(()) if t.role != term.role]
    rates = []
    for terms in ((term, *others), tuple(others)):
        machine = Machine(flux, terms)
        if term.role not in ("resistance", "rotation"):
            assert len(machine.terms) == len(terms)
        machine = object.__new__(Machine)  # without the completion: the term really is left out
        object.__setattr__(machine, "flux", flux)
        object.__setattr__(machine, "terms", tuple(terms))
        with float64():
            x = jnp.asarray(run.stack(("i_d", "i_q")).T)
            u = Inputs(jnp.asarray(run.stack(machine.inputs).T), machine.inputs)
            rates.append(np.asarray(with_batch_axis(machine).derivative(x, u)))
    psi = Linear.PSI[:, None] + Linear.L @ run.stack(("i_d", "i_q")).T
    lost = Linear.L @ (rates[1] - rates[0])
    expected = dropped(term, run, psi)
    np.testing.assert_allclose(lost, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


class Linear(eqx.Module):
    """A flux map psi = PSI + L i."""

    PSI: ClassVar = np.array([0.05, 0.01])
    L: ClassVar = np.array([[3e-4, 2e-5], [2e-5, 5e-4]])

    def value_and_jacobian(self, x):
        value = self.PSI[:, None] + jnp.asarray(self.L) @ x
        return value, jnp.broadcast_to(self.L[:, :, None], (2, 2, x.shape[1]))


@pytest.mark.parametrize("name", [n for n in ALL if physical_places((ALL[n](),))])
def test_the_weak_form_solves_for_every_physical_parameter_and_its_deviation(name, slow_run):
    """Deviations come from the declaration, without a further line."""
    term = ALL[name]()
    run = replace(slow_run, channels={**slow_run.channels, **_further(term, slow_run)})
    balance = BalanceForm.of([run], True, (term,)).solve([run])
    wanted = {field for _, field in physical_places((term,))}
    assert wanted <= set(balance.physical)
    for parameter in wanted:
        value, deviation = balance.physical[parameter]
        assert np.isfinite(value)
        assert 0 < deviation < np.inf


def _further(term, run):
    """Return channels that a term needs and a recording lacks."""
    names = [channel.name for channel in term.channels if channel.name not in run.channels]
    return {name: np.linspace(20.0, 90.0, len(run)) for name in names}


def test_a_known_voltage_without_parameters_is_taken_off(slow_run):
    """A term may know all there is to know of it: it then has no column, but a voltage."""
    currents = slow_run.stack(("i_d", "i_q"))
    basis = PolynomialMap(True, 250.0, 4).basis(currents)

    class Known(Resistance):
        def drop(self, x, u, flux):
            return super().drop(x, u, flux) + 0.02 * x + 0.7

    plain = balance_equations(slow_run, completed(()), basis, 20)
    known = balance_equations(slow_run, completed((Known(),)), basis, 20)
    np.testing.assert_allclose(known.matrix, plain.matrix, rtol=0, atol=1e-12)
    # The same by hand: u less the known voltage, as smooth as the drops are.
    extra = 0.02 * currents + 0.7
    weak = HannWindow(slow_run.time_step, 20).of_supply(-extra)
    np.testing.assert_allclose(known.target, plain.target - weak.ravel(), rtol=0, atol=1e-12)


# --- each by its formula ----------------------------------------------------------------------


def test_resistances_and_rotation_by_their_formulas():
    i, psi = RANDOM.normal(size=(2, COUNT)), RANDOM.normal(size=(2, COUNT))
    temperature, omega = RANDOM.uniform(-40, 180, COUNT), RANDOM.normal(size=COUNT)
    run = Experiment(
        "run",
        1e-4,
        {"i_d": i[0], "i_q": i[1], "winding_temperature": temperature, "omega_el": omega},
    )
    found = dropped(TemperatureResistance(0.02), run, psi)
    np.testing.assert_allclose(found, 0.02 * (1 + 0.00393 * (temperature - 20)) * i, rtol=1e-14)
    aluminium = dropped(TemperatureResistance(0.02, alpha=0.00403), run, psi)
    np.testing.assert_allclose(aluminium, 0.02 * (1 + 0.00403 * (temperature - 20)) * i, rtol=1e-14)
    np.testing.assert_allclose(dropped(Resistance(0.02), run, psi), 0.02 * i, rtol=1e-15)
    turned = omega * np.stack([-psi[1], psi[0]])
    np.testing.assert_allclose(dropped(Rotation(), run, psi), turned, rtol=1e-15)


# --- how terms are put together ---------------------------------------------------------------


def test_resistance_and_rotation_are_added_where_nothing_stands_in_their_place():
    names = [[term_name(t) for t in completed(terms)] for terms in ((), (TemperatureResistance(),))]
    assert names == [["resistance", "Rotation"], ["temperature_resistance", "Rotation"]]
    assert [type(t) for t in completed((DeadTime(),))] == [Resistance, DeadTime, Rotation]


def test_two_terms_of_one_role_are_refused():
    with pytest.raises(InputError, match="Resistance and TemperatureResistance both"):
        Machine(FluxMap(Linear(), 1.0, 1.0), (Resistance(), TemperatureResistance()))


def test_an_unknown_term_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match="unknown term 'iron'; known are resistance, temperature"):
        terms_of(["iron"])


def test_the_inputs_of_a_machine_are_what_its_terms_need():
    flux = FluxMap(Linear(), 1.0, 1.0)
    assert Machine(flux).inputs == ("u_d", "u_q", "omega_el")
    both = Machine(flux, (TemperatureResistance(), DeadTime(0.0, 1.0)))
    assert set(both.inputs) == {"u_d", "u_q", "omega_el", "theta_el", "winding_temperature"}


def test_parameters_are_exchanged_in_their_order():
    terms = completed((DeadTime(1.0, 2.0),))
    assert physical_values(terms) == {"R": 0.0, "dead_time_voltage": 1.0}
    assert physical_values(with_physical(terms, [0.3, 4.0])) == {"R": 0.3, "dead_time_voltage": 4.0}


def test_a_guess_is_made_only_where_nothing_was_said():
    assert float(DeadTime().prepared(250.0).dead_time_current) == 2.5
    assert float(DeadTime(dead_time_current=1.0).prepared(250.0).dead_time_current) == 1.0


def test_a_channel_of_its_own_has_no_bounds_unless_it_says_so():
    assert Channel("x", "A", "this").lowest == -np.inf
