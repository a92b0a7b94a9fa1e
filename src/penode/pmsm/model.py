"""The voltage equation of a permanent-magnet synchronous machine as a state-space model."""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, Leaf, float64
from penode.models.base import Model
from penode.models.parameters import Positive, parameter, physical, with_batch_axis
from penode.pmsm.flux_maps import FluxMap


class Machine(Model):
    """di/dt = L(i)^-1 (u - R i - omega J psi(i)), the paper's current ODE.

    Attributes
    ----------
    flux : FluxMap
        psi(i) in Vs and L(i) = d psi / d i in H.
    R : array, shape ()
        Stator resistance in ohm.
    """

    states: ClassVar[tuple[str, ...]] = ("i_d", "i_q")
    inputs: ClassVar[tuple[str, ...]] = ("u_d", "u_q", "omega_el")
    state_units: ClassVar[tuple[str, ...]] = ("A", "A")

    flux: FluxMap
    R: Leaf = physical("ohm")

    def derivative(self, x: JaxArray, u: JaxArray) -> JaxArray:
        """Return di/dt (2, batch) in A/s from i (2, batch) in A and u_d, u_q (V), omega (rad/s)."""
        psi, inductance = self.flux.flux_and_inductance(x)
        return _solved(inductance, u[:2] - self.R * x - u[2] * _quarter_turned(psi))

    def learned(self, x: JaxArray) -> JaxArray:
        """Return psi (2, batch) in Vs at currents x (2, batch) in A, averaged over the angle."""
        return self.flux.flux_and_inductance(x)[0]

    def stored(self, x: JaxArray) -> JaxArray:
        """Return psi (2, batch) in Vs: errors in this domain are voltages, integrated."""
        return self.learned(x)

    def maps(self) -> Mapping[str, Callable[..., Any]]:
        """Return ``flux_map`` and ``differential_inductance`` as functions of i_d, i_q in A."""
        return {
            "flux_map": lambda i_d, i_q: _evaluate(self, i_d, i_q)[0],
            "differential_inductance": lambda i_d, i_q: _evaluate(self, i_d, i_q)[1],
        }


class AngleMachine(Machine):
    """di/dt = L^-1 (u - R i - omega J psi - omega d psi/d theta), psi and L at the rotor's angle.

    Its flux map may have harmonics of the angle (`FluxMap.angle_orders`).
    """

    inputs: ClassVar[tuple[str, ...]] = ("u_d", "u_q", "omega_el", "theta_el")

    def derivative(self, x: JaxArray, u: JaxArray) -> JaxArray:
        """Return di/dt (2, batch) in A/s from i (2, batch) in A and the inputs.

        Parameters
        ----------
        x : array, shape (2, batch)
            i_d and i_q in A.
        u : array, shape (4, batch)
            u_d and u_q (V), omega (rad/s), theta (rad), both electrical.
        """
        flux = self.flux.at_angle(x, u[3])
        induced = u[2] * (_quarter_turned(flux.linkage) + flux.angle_slope)
        return _solved(flux.inductance, self.terminal_voltage(x, u) - self.R * x - induced)

    def terminal_voltage(self, x: JaxArray, u: JaxArray) -> JaxArray:
        """Return what arrives of u_d and u_q at the machine (2, batch) in V: here, all of it."""
        return u[:2]


class DeadTimeMachine(AngleMachine):
    """A machine behind an inverter with dead time: u is short of dU tanh(i/i_0) in every phase.

    While both switches of a leg are off, the phase current decides the voltage; a phase with much
    current loses dU = u_dc t_dead / T over a sample, one near its zero less. Jeong and Park, IEEE
    Trans. Ind. Electron. 38 (1991) 108, doi:10.1109/41.88903. Under the hold
    `penode.pmsm.holds.Standing` each stage of a step takes the mean over the part of the sample
    that it stands for.

    Attributes
    ----------
    dead_time_voltage : array, shape ()
        dU in V.
    dead_time_current : array, shape ()
        i_0 in A, the phase current at which 76 % of dU are lost. It moves in training but is not
        reported: a phase current crosses zero within a fraction of a sample, which tells little
        of it.
    """

    dead_time_voltage: Leaf = physical("V")
    dead_time_current: Leaf = parameter(unit="A", group="physical", transform=Positive())

    def terminal_voltage(self, x: JaxArray, u: JaxArray) -> JaxArray:
        """Return u_d and u_q less what the dead time takes, (2, batch) in V."""
        lost = self.dead_time_voltage * dead_time_shape(x, u[3], self.dead_time_current, u[4:])
        arriving: JaxArray = u[:2] - lost
        return arriving


def dead_time_shape(
    currents: JaxArray, theta_el: JaxArray, scale: JaxArray, part: JaxArray | None = None
) -> JaxArray:
    """Return the smooth signs tanh(i/i_0) of the three phase currents as d and q components.

    Parameters
    ----------
    currents : array, shape (2, batch)
        i_d and i_q in A, amplitude invariant (`penode.pmsm.frames`).
    theta_el : array, shape (batch,)
        Electrical angle of the d axis in rad.
    scale : array, shape () or (batch,)
        i_0 in A.
    part : array, shape (2, batch), optional
        Turn of the rotor in rad to the middle of a part of the sample, and over half of it, over
        which the signs are averaged. Without it, or with no rows, they are those of the moment.

    Returns
    -------
    array, shape (2, batch)
        Dimensionless; of length 4/pi on average where the currents are large.
    """
    cosine, sine = jnp.cos(theta_el), jnp.sin(theta_el)
    alpha = cosine * currents[0] - sine * currents[1]
    beta = sine * currents[0] + cosine * currents[1]
    phases = _phases(alpha, beta) / scale
    if part is None or not len(part):
        a, b, c = jnp.tanh(phases)
    else:
        rates = _phases(-beta, alpha) / scale
        a, b, c = _mean_tanh(phases + part[0] * rates, part[1] * rates)
    sign_alpha, sign_beta = (2 * a - b - c) / 3, (b - c) / np.sqrt(3)
    return jnp.stack(
        [cosine * sign_alpha + sine * sign_beta, cosine * sign_beta - sine * sign_alpha]
    )


#: Half the width of the narrowest mean; the closed form divides by it.
_NARROW = 0.02


def _phases(alpha: JaxArray, beta: JaxArray) -> JaxArray:
    """Return the three phase values (3, batch) of a stationary vector."""
    half, root = 0.5 * alpha, np.sqrt(0.75) * beta
    return jnp.stack([alpha, root - half, -root - half])


def _mean_tanh(middle: JaxArray, sweep: JaxArray) -> JaxArray:
    """Return the mean of tanh over all values within a sweep of the middle."""
    half = jnp.sqrt(sweep**2 + _NARROW**2)
    return (_log_cosh(middle + half) - _log_cosh(middle - half)) / (2 * half)


def _log_cosh(x: JaxArray) -> JaxArray:
    """Return log(2 cosh x), the integral of tanh, without overflow."""
    size = jnp.abs(x)
    return size + jnp.log1p(jnp.exp(-2 * size))


def _quarter_turned(vector: JaxArray) -> JaxArray:
    """Return J times a vector (2, batch)."""
    return jnp.stack([-vector[1], vector[0]])


def _solved(matrix: JaxArray, vector: JaxArray) -> JaxArray:
    """Return the solution (2, batch) of a system with matrix (2, 2, batch)."""
    (a, b), (c, d) = matrix
    rates = (d * vector[0] - b * vector[1], a * vector[1] - c * vector[0])
    solution: JaxArray = jnp.stack(rates) / (a * d - b * c)
    return solution


@jax.jit
def _flux_and_inductance(machine: Machine, currents: JaxArray) -> tuple[JaxArray, JaxArray]:
    return with_batch_axis(machine).flux.flux_and_inductance(currents)


def _evaluate(machine: Machine, i_d: Any, i_q: Any) -> tuple[FloatArray, FloatArray]:
    """Return psi (2, *shape) in Vs and L (2, 2, *shape) in H for currents of any one shape."""
    currents = np.stack(np.broadcast_arrays(np.asarray(i_d, float), np.asarray(i_q, float)))
    shape = currents.shape[1:]
    with float64():
        flat = jnp.asarray(currents.reshape(2, -1))
        psi, inductance = _flux_and_inductance(machine, flat)
        return np.asarray(psi).reshape(2, *shape), np.asarray(inductance).reshape(2, 2, *shape)
