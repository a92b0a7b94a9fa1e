"""What stands still between two samples: closed forms, and the bench's own holds."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

from penode import Model, Predictor
from penode.arrays import float64
from penode.bench.drive import Drive
from penode.bench.inverter import Inverter, RotorHold, StationaryHold
from penode.bench.machines import Machine as BenchMachine
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.models.networks import ConvexGradient
from penode.pmsm.machine.flux_maps import FluxMap
from penode.pmsm.machine.holds import HOLDS
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.terms import Resistance
from penode.predictors.field import Field
from penode.predictors.holds import FirstOrderHold
from penode.validation.free_run import compare

T = 1e-4
L_D, L_Q, MAGNET, RESISTANCE = 200e-6, 450e-6, 0.05, 0.012
INPUT = np.array([[30.0, -5.0], [40.0, 12.0], [3000.0, -700.0], [1.3, 6.1], [80.0, 20.0]])


NAMES = ("u_d", "u_q", "omega_el", "theta_el", "winding_temperature")


class Mirror(Model):
    """Gives back what it is asked with: the inputs as a solver's field hands them over."""

    states: ClassVar[tuple[str, ...]] = ("i_d",)
    inputs: ClassVar[tuple[str, ...]] = NAMES
    state_units: ClassVar[tuple[str, ...]] = ("A",)
    input_rates: ClassVar[dict[str, str]] = Machine.input_rates

    def derivative(self, x, u):
        return u


def asked(hold, fraction, names=NAMES, sample=0):
    """Return the inputs by name, as the field around a sample gives them."""

    class Some(Mirror):
        inputs: ClassVar[tuple[str, ...]] = names

    rows = INPUT[[NAMES.index(name) for name in names]]
    with float64():
        field = Field(Some(), lambda offset: jnp.asarray(rows) + offset, hold, T)
        u = field(jnp.zeros((1, 2)), sample=sample, fraction=fraction)
        return {name: np.asarray(u[name]) for name in names}


@pytest.mark.parametrize("fraction", [0.0, 0.25, 0.5, 1.0])
def test_a_dq_hold_turns_the_angle_alone(fraction):
    """Not the temperature beside it: 80 degC stay 80 degC at any speed."""
    found = asked(HOLDS["dq"], fraction)
    ahead = INPUT[3] + fraction * T * INPUT[2]
    np.testing.assert_allclose(found.pop("theta_el"), ahead, rtol=1e-15)
    for name, row in found.items():
        np.testing.assert_array_equal(row, INPUT[NAMES.index(name)])


@pytest.mark.parametrize("names", [NAMES[:3], NAMES, NAMES[::-1]])
@pytest.mark.parametrize("fraction", [0.0, 0.25, 0.5, 1.0])
def test_a_stationary_hold_keeps_the_voltage_vector_in_alpha_and_beta(fraction, names):
    """In whatever order the model has its inputs."""
    found = asked(HOLDS["stationary"], fraction, names)
    at_sample = (INPUT[0] + 1j * INPUT[1]) * np.exp(1j * INPUT[3])
    ahead = INPUT[3] + fraction * T * INPUT[2]
    held = (found["u_d"] + 1j * found["u_q"]) * np.exp(1j * ahead)
    np.testing.assert_allclose(held, at_sample)
    np.testing.assert_array_equal(found["omega_el"], INPUT[2])
    if "theta_el" in names:
        np.testing.assert_allclose(found["theta_el"], ahead, rtol=1e-15)
        np.testing.assert_array_equal(found["winding_temperature"], INPUT[4])


@pytest.mark.parametrize("hold", HOLDS.values(), ids=HOLDS)
def test_holds_read_the_sample_they_are_asked_for(hold):
    found = asked(hold, 0.0, sample=-2)
    np.testing.assert_array_equal(np.stack(list(found.values())), INPUT - 2)


def test_an_angle_goes_on_over_its_wrap_under_a_first_order_hold():
    """Between 6.2 rad and 0.1 rad a line would turn the rotor back by nearly a turn."""
    names = ("theta_el", "omega_el")

    class Turning(Mirror):
        inputs: ClassVar[tuple[str, ...]] = names

    rows = jnp.asarray([[[6.2], [1000.0]], [[0.1], [3000.0]]])
    with float64():
        field = Field(Turning(), lambda offset: rows[offset], FirstOrderHold(), T)
        u = field(jnp.zeros((1, 1)), fraction=0.5)
        assert float(u["theta_el"][0]) == pytest.approx(6.25, rel=1e-6)
        assert float(u["omega_el"][0]) == pytest.approx(2000.0)


# --- against the bench ------------------------------------------------------------------------


def linear_coenergy(i_d, i_q, theta_el):
    return MAGNET * i_d + 0.5 * (L_D * i_d**2 + L_Q * i_q**2)


BENCH = BenchMachine("linear", RESISTANCE, 4, 200.0, MAGNET, L_D, L_Q, (), linear_coenergy)


NETWORK = ConvexGradient(
    np.array([MAGNET, 0.0]), np.diag([L_D, L_Q]), np.ones((1, 2)), np.zeros(1), np.array([1e-30])
)
MACHINE = Machine(FluxMap(NETWORK, 1.0, 1.0), (Resistance(RESISTANCE),))


@pytest.mark.parametrize("inverter", [RotorHold(), StationaryHold()], ids=lambda h: h.frame)
def test_only_the_matching_hold_predicts_the_bench(inverter):
    drive = Drive(inverter=Inverter(inverter), dc_voltage=800.0)
    reference = Lissajous(100.0, 140.0, 150.0)
    run = simulate(BENCH, reference, speed_rpm=3000.0, duration=0.05, drive=drive)
    error = {
        name: compare(Predictor(T, hold=hold), MACHINE, run, "train").free_run_rmse
        for name, hold in HOLDS.items()
    }
    matching = error.pop(inverter.frame)
    assert matching < 1e-3
    assert all(other > 1.0 for other in error.values())
