"""Whether the current loop is stable, before it runs: poles of the sampled loop, linearised."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import expm

from penode.arrays import FloatArray, JaxArray, float64, on_device
from penode.bench.coenergy_table import CoenergyTable
from penode.bench.rig import Rig
from penode.errors import InputError

# Operating points of the reference that are looked at.
_POINTS = 16
# Largest modulus of a pole that is let pass: a thousandth a sample grows tenfold in 2300 samples.
_LARGEST_POLE = 1.001

_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


def refuse_unstable(name: str, rig: Rig, wanted: FloatArray, fastest: float) -> None:
    """Refuse a loop that is unstable where `wanted` (time, 2), A, leads.

    It is looked at standing still and at the electrical speed `fastest`, rad/s.
    """
    rows = np.linspace(0, len(wanted) - 1, _POINTS).round().astype(int)
    points = wanted[rows]
    with float64():
        slopes = np.asarray(_inductances(rig.plant.table, on_device(points)))
    for point, inductance in zip(points, slopes, strict=True):
        for omega_el in (0.0, fastest):
            pole = loop_pole(rig, inductance, omega_el)
            if pole > _LARGEST_POLE:
                raise InputError(
                    f"{name}: the current loop is unstable at i_d = {point[0]:.4g} A, "
                    f"i_q = {point[1]:.4g} A and {omega_el:.4g} rad/s (a pole of modulus "
                    f"{pole:.3g}) with a bandwidth of {rig.controller.bandwidth:.4g} rad/s at a "
                    f"time step of {rig.controller.time_step:.4g} s; lower the bandwidth, the "
                    f"tuning factor or the delay."
                )


def loop_pole(rig: Rig, inductance: FloatArray, omega_el: float) -> float:
    """Return the largest modulus of the loop's poles (stable below 1) at L (2, 2), H, and rad/s."""
    controller, delay = rig.controller, rig.inverter.delay
    decay, drive = _sampled_machine(rig, inductance, omega_el)
    angle = -omega_el * controller.time_step * rig.inverter.hold.mean_lag(delay)
    drive = drive @ (np.cos(angle) * np.eye(2) + np.sin(angle) * _TURN)
    believed = np.diag(controller.inductance)
    gain = 2 * controller.bandwidth * believed
    feedback = omega_el * _TURN @ believed - gain
    # States: current, integral, then the voltages that wait, the newest first.
    size = 4 + 2 * delay
    loop = np.zeros((size, size))
    loop[:2, :2] = decay
    loop[2:4, :2] = -controller.time_step * controller.bandwidth**2 * believed
    loop[2:4, 2:4] = np.eye(2)
    asked = np.zeros((2, size))
    asked[:, :2], asked[:, 2:4] = feedback, np.eye(2)
    if delay == 0:
        loop[:2] += drive @ asked
    else:
        loop[:2, -2:] = drive
        loop[4:6] = asked
        loop[6:, 4:-2] = np.eye(size - 6)
    return float(np.abs(np.linalg.eigvals(loop)).max())


def _sampled_machine(
    rig: Rig, inductance: FloatArray, omega_el: float
) -> tuple[FloatArray, FloatArray]:
    """Return what current and held voltage of one sample are in the current of the next."""
    inverse = np.linalg.inv(inductance)
    resistance = rig.plant.copper.resistance * np.eye(2)
    both = np.zeros((4, 4))
    both[:2, :2] = -inverse @ (resistance + omega_el * _TURN @ inductance)
    both[:2, 2:] = inverse
    moved = expm(both * rig.controller.time_step)
    return moved[:2, :2], moved[:2, 2:]


@jax.jit
def _inductances(table: CoenergyTable, currents: JaxArray) -> JaxArray:
    """Return the mean differential inductance over the angle, (point, 2, 2), of currents (A)."""
    mean = CoenergyTable(table.coefficients[..., :1], table.spacing, ())
    return jax.vmap(mean, (0, None))(currents, jnp.zeros(())).inductance
