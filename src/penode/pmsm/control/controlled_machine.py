"""What a controller's operating points rest on: flux map, inductance, resistance, pole pairs.

T = 3/2 p (psi_d i_q - psi_q i_d) and, in steady state, u = R i + omega J psi and what the
inverter takes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from penode.arrays import BoolArray, FloatArray
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.pmsm.control.inverter_voltage import InverterVoltage
from penode.pmsm.machine.frames import quarter_turned
from penode.pmsm.recording.stationary_frame import LINK

#: Entry of the provenance: median voltage of the DC link in V.
LINK_VOLTAGE = "link_voltage_v"


def recorded_link_voltage(recordings: Sequence[Experiment]) -> float | None:
    """Return the median of u_dc in V, None where a recording has none."""
    if any(LINK not in each.channels for each in recordings):
        return None
    return float(np.median(np.concatenate([each.channels[LINK] for each in recordings])))


def voltage_limit_of(fit: Fit) -> float | None:
    """Return u_dc / sqrt(3), V peak of a phase, of the recordings; None where they have no u_dc."""
    link = fit.provenance.get(LINK_VOLTAGE)
    return float(link) / np.sqrt(3) if link and link > 0 else None


def largest_current(fit: Fit) -> float:
    """Return the largest current of the recordings, peak of a phase in A."""
    return float(np.hypot(*fit.excited.T).max())


def _everywhere(points: FloatArray) -> BoolArray:
    return np.ones(len(points), dtype=bool)


@dataclass(frozen=True, eq=False)
class ControlledMachine:
    """What the loci need to know of a machine.

    Attributes
    ----------
    flux_map : callable
        (i_d, i_q) in A to psi (2, ...) in Vs: of a `Fit`, a `FluxGrid` or a closed form.
    differential_inductance : callable
        (i_d, i_q) in A to L = d psi / d i (2, 2, ...) in H.
    pole_pairs : int
        p.
    resistance : float
        R of one phase in ohm.
    supported : callable
        Whether currents (point, 2) in A are backed by recordings; by default all are.
    inverter : InverterVoltage or None
        What the voltage of the command has beside that of the windings; None for nothing.
    """

    flux_map: Callable[..., FloatArray]
    differential_inductance: Callable[..., FloatArray]
    pole_pairs: int
    resistance: float = 0.0
    supported: Callable[[FloatArray], BoolArray] = _everywhere
    inverter: InverterVoltage | None = None

    @classmethod
    def of(cls, fit: Fit, pole_pairs: int | None = None) -> "ControlledMachine":
        """Return the machine of a fit; without R and dead time where recordings do not identify R.

        Raises
        ------
        InputError
            If neither the fit nor the caller says the pole pairs.
        """
        pairs = fit.provenance.get("pole_pairs") if pole_pairs is None else pole_pairs
        if not pairs or pairs < 1:
            raise InputError(
                "pole pairs must be a whole number >= 1 for the torque, got "
                f"{pairs or 'none'}; set --pole-pairs."
            )
        resistance, inverter = 0.0, None
        if fit.horizon.answered:
            resistance = fit.parameters["R"].value
            inverter = InverterVoltage.of(fit.model, largest_current(fit))
        inductance = fit.differential_inductance
        return cls(fit.flux_map, inductance, pairs, resistance, fit.supported, inverter)

    def mirrored(self) -> "ControlledMachine":
        """Return the machine with i_q and psi_q reversed, and with them torque and speed."""
        turn = np.array([1.0, -1.0])

        def flux_map(i_d: FloatArray, i_q: FloatArray) -> FloatArray:
            psi_d, psi_q = self.flux_map(i_d, -np.asarray(i_q))
            return np.stack([psi_d, -psi_q])

        def inductance(i_d: FloatArray, i_q: FloatArray) -> FloatArray:
            slope = self.differential_inductance(i_d, -np.asarray(i_q))
            return np.einsum("a,ab...,b->ab...", turn, slope, turn)

        return replace(
            self,
            flux_map=flux_map,
            differential_inductance=inductance,
            supported=lambda points: self.supported(points * turn),
        )

    def torque(self, current: FloatArray) -> FloatArray:
        """Return T (point,) in Nm at currents (2, point) in A."""
        psi = self.flux_map(*current)
        torque: FloatArray = 1.5 * self.pole_pairs * (psi[0] * current[1] - psi[1] * current[0])
        return torque

    def torque_slope(self, current: FloatArray) -> FloatArray:
        """Return dT/di (2, point) in Nm/A."""
        psi, inductance = self.flux_map(*current), self.differential_inductance(*current)
        turned = np.stack([current[1], -current[0]])
        slope = np.einsum("ab...,a...->b...", inductance, turned) + quarter_turned(psi)
        return np.asarray(1.5 * self.pole_pairs * slope)

    def drop(self, current: FloatArray) -> FloatArray:
        """Return u (2, point) in V at standstill: R i, and along it what the inverter takes."""
        return self._per_ampere(current)[0] * current

    def voltage(self, current: FloatArray, speed: FloatArray | float) -> FloatArray:
        """Return the steady u (2, point) in V at an electrical speed in rad/s."""
        return self.drop(current) + speed * quarter_turned(self.flux_map(*current))

    def voltage_slope(self, current: FloatArray, speed: FloatArray | float) -> FloatArray:
        """Return du/di (2, 2, point) in ohm."""
        slope: FloatArray = speed * quarter_turned(self.differential_inductance(*current))
        aside, ahead = self._per_ampere(current)
        along = current / np.maximum(np.hypot(*current), np.finfo(float).tiny)
        slope[[0, 1], [0, 1]] += aside
        return slope + (ahead - aside) * along[:, None] * along

    def _per_ampere(self, current: FloatArray) -> tuple[FloatArray | float, FloatArray | float]:
        """Return the drop over the current, and its slope along the current, (point,) in ohm."""
        if self.inverter is None:
            return self.resistance, self.resistance
        taken, rise = self.inverter.per_ampere(np.hypot(*current))
        return self.resistance + taken, self.resistance + rise
