"""Energy balance of the plant with the imperfections that leave it to be balanced."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import simpson

from penode.bench.drive import Drive
from penode.bench.inverter import DeadTime, Inverter, Pulses, StationaryHold
from penode.bench.machines import TRACTION_300A, torque
from penode.bench.rig import rig_of
from penode.bench.shaft import FreeShaft, Shaft
from penode.bench.winding import Winding

pytestmark = pytest.mark.usefixtures("quickly_compiled")

OMEGA = 2 * np.pi * 25.0 * 5
INTERVALS, FINE = 30, 64
STEP = 1e-4
FREE = FreeShaft(0.02, load_torque=30.0, friction=0.02)
CASES = {
    "ideal": (Drive(), Shaft()),
    "real": (
        Drive(
            inverter=Inverter(StationaryHold(), dead_time=DeadTime(1e-6, current_scale=20.0)),
            winding=Winding(80.0, (1.0, 1.05, 0.95)),
        ),
        Shaft(FREE, 5.0),
    ),
}


def traced(drive, shaft):
    """Return states and terminal voltages at fine instants, (interval, fine + 1, ...)."""
    rig = rig_of(TRACTION_300A, drive, shaft, OMEGA)
    hold = drive.inverter.hold

    def interval(state, k):
        wanted = OMEGA * jnp.array([-0.066, 0.035]) + jnp.array([9.0, -6.0]) * jnp.cos(0.4 * k)
        turned = state.theta_el - hold.frame_angle(state.theta_el)
        c, s = jnp.cos(turned), jnp.sin(turned)
        vector = jnp.stack([c * wanted[0] - s * wanted[1], s * wanted[0] + c * wanted[1]])
        voltage_at = rig.voltages(vector)

        def fine(state, _):
            pulses = Pulses(jnp.full(1, STEP / FINE), vector[None])
            end = rig.plant.advance(state, pulses, rig.voltages, jnp.zeros(()))
            return end, (end, voltage_at(end.current, end.theta_el))

        end, (states, applied) = jax.lax.scan(fine, state, None, length=FINE)
        first = (state, voltage_at(state.current, state.theta_el))
        joined = jax.tree.map(
            lambda a, b: jnp.concatenate([jnp.asarray(a)[None], b]), first, (states, applied)
        )
        return end, joined

    with jax.enable_x64(True):
        start = rig.plant.rest(jnp.zeros(()), jnp.asarray(OMEGA))
        start = start._replace(current=jnp.array([-120.0, 150.0]))
        run = jax.jit(lambda s: jax.lax.scan(interval, s, jnp.arange(INTERVALS))[1])
        states, applied = jax.tree.map(np.asarray, run(start))
    return rig, states, applied


@pytest.mark.parametrize("case", CASES)
def test_input_is_copper_loss_work_and_field_energy(case):
    drive, shaft = CASES[case]
    rig, states, applied = traced(drive, shaft)
    step = STEP / FINE

    def over_time(power):
        return simpson(power, dx=step, axis=1).sum()

    current, theta, omega = states.current, states.theta_el, states.omega_el
    shape = theta.shape
    nm = torque(TRACTION_300A, *current.reshape(-1, 2).T, theta.ravel()).reshape(shape)
    with jax.enable_x64(True):
        factors = np.array(drive.winding.phase_factors or (1.0, 1.0, 1.0))
        phase = current_of_phases(current, theta)
        resistance = np.asarray(rig.plant.copper.at(states.temperature))
    supplied = over_time(1.5 * (applied * current).sum(-1))
    heat = over_time(resistance * (factors * phase**2).sum(-1))
    work = over_time(nm * omega / 5.0)
    stored = field_energy(current[-1, -1], theta[-1, -1]) - field_energy(current[0, 0], theta[0, 0])
    assert min(abs(heat), abs(work), abs(stored)) > 0.1
    assert supplied == pytest.approx(heat + work + stored, abs=1e-6 * abs(supplied))
    if shaft.free is not None:
        mechanical = omega / 5.0
        kinetic = 0.5 * FREE.inertia * (mechanical[-1, -1] ** 2 - mechanical[0, 0] ** 2)
        drawn = over_time((FREE.load_torque + FREE.friction * mechanical) * mechanical)
        assert work == pytest.approx(kinetic + drawn, rel=1e-7)
        assert abs(kinetic) > 0.1


def current_of_phases(current, theta):
    angle = theta[..., None] - 2 * np.pi / 3 * np.array([0.0, 1.0, -1.0])
    return current[..., :1] * np.cos(angle) - current[..., 1:] * np.sin(angle)


def field_energy(current, theta):
    """Return 3/2 (psi i - W), the energy in the magnetic field up to a constant, in J."""
    with jax.enable_x64(True):
        value, psi = jax.value_and_grad(
            lambda i: TRACTION_300A.coenergy(i[0], i[1], jnp.asarray(theta))
        )(jnp.asarray(current))
        return float(1.5 * (psi @ current - value))
