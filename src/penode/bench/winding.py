"""The stator winding and its iron: resistance at temperature and by phase, and iron loss."""

import equinox as eqx
import jax.numpy as jnp

from penode.arrays import JaxArray
from penode.bench.phases import phases, rotated, stationary


class Warming(eqx.Module):
    """First-order thermal model of the winding, fed by its own copper loss.

    ``C dT/dt = 3/2 i' R(T) i - (T - T_ambient) / R_th``
    """

    # C, J/K.
    heat_capacity: float
    # R_th from the winding to the coolant, K/W.
    thermal_resistance: float
    # Of the coolant, degC.
    ambient: float = 20.0

    def rate(self, temperature: JaxArray, copper_loss: JaxArray) -> JaxArray:
        """Return dT/dt, K/s, at a temperature in degC and a loss of the three phases in W."""
        cooling = (temperature - self.ambient) / self.thermal_resistance
        return (copper_loss - cooling) / self.heat_capacity


class Winding(eqx.Module):
    """How the winding departs from the machine's data sheet.

    Each phase has ``R (1 + alpha (T - T_ref))`` times its factor, with R, alpha and T_ref of the
    machine. In the rotor frame three unequal phases are the matrix ``2/3 P diag(R_a, R_b, R_c) P'``
    with P the Park matrix at theta_el: its mean is the mean resistance, the rest has order 2.

    Attributes
    ----------
    temperature : float or None
        Winding temperature in degrees Celsius, at the start where it changes; None: the one at
        which the machine's resistance holds.
    phase_factors : tuple of three floats, or None
        Resistance of the phases a, b, c over the machine's; None for three equal phases.
    warming : Warming or None
        How the temperature changes during the run; None keeps it.
    """

    temperature: float | None = None
    phase_factors: tuple[float, float, float] | None = None
    warming: Warming | None = None

    def relative_drop(self, current: JaxArray, theta_el: JaxArray) -> JaxArray:
        """Return the voltage (2,), V, at phases of 1 ohm times their factor; currents (2,), A."""
        if self.phase_factors is None:
            return current
        by_phase = jnp.stack(self.phase_factors) * phases(rotated(current, theta_el))
        return rotated(stationary(by_phase), -theta_el)

    def warming_rate(self, temperature: JaxArray, copper_loss: JaxArray) -> JaxArray:
        """Return dT/dt, K/s; see `Warming.rate`; zero for a winding that keeps its temperature."""
        if self.warming is None:
            return jnp.zeros_like(temperature)
        return self.warming.rate(temperature, copper_loss)


class IronLoss(eqx.Module):
    """Iron loss as a resistance across the voltage that rotation induces.

    The terminals carry ``i = i_m + omega J psi(i_m) / R_Fe`` where i_m makes the flux; the loss is
    ``3/2 |omega psi|^2 / R_Fe``, so it grows with the square of the speed as eddy currents do.
    Morimoto et al., Loss minimization control of permanent magnet synchronous motor drives, IEEE
    Trans. Ind. Electron. 41 (1994) 511, doi:10.1109/41.315269.
    """

    # R_Fe, ohm; the smaller, the larger the loss.
    resistance: float

    def current(self, induced: JaxArray) -> JaxArray:
        """Return the current (2,), A, that the iron draws at omega J psi (2,), V."""
        return induced / self.resistance
