"""Residual lines of a drive: their orders in both frames, and what usually causes them.

A vector that rotates at n times the electrical frequency in the rotor frame (dq) rotates at n + 1
times in the stationary one: what is fixed there, such as the offset of a sensor, is at -1; what
turns backwards with the rotor, as from unequal phases, at -2; the 5th and the 7th harmonic of a
phase, at -6 and +6.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.validation.residual_lines import Line

#: A line belongs to an order within this distance, or if the order lies inside the line.
_NEAR = 0.07
#: A line as close to a harmonic is a side band of it, unless a mechanical order is this close.
_BESIDE, _EXACT = 0.25, 0.02
_CAUSES = {
    0: "slow errors: resistance, inverter voltage, or map and resistance exchanged (the gauge)",
    1: "offset of a current sensor (at −1; +1 is its mirror by saliency), first order of the angle "
    "sensor",
    2: "unequal gains of current sensors, unequal phases of the winding, second order of the angle "
    "sensor",
}
_HARMONICS = "slots and flux harmonics, dead time of the inverter"
_SIDE_BAND = "side band of {:+d}×: how that harmonic changes with the currents, beyond the map's"
_UNKNOWN = "no usual cause"
_BETWEEN = "no multiple of the rotor's frequencies: control, load, switching, or a fast trajectory"


@dataclass(frozen=True)
class NamedLine:
    """A line of a drive's residual with its likely cause.

    Attributes
    ----------
    line : Line
        Of the complex signal i_d + j i_q.
    order : float
        In the rotor frame, multiples of the electrical frequency; whole where the line belongs to
        a whole order, and a multiple of 1 / pole pairs where to a mechanical one.
    cause : str
        What usually makes such a line; empty where there is no electrical frequency.
    """

    line: Line
    order: float
    cause: str

    @property
    def stationary_order(self) -> float:
        """Order in the stationary frame of the phases."""
        return self.order + 1


def signed_frequency(electrical_frequency: float, transitions: FloatArray) -> float:
    """Return the electrical frequency, Hz, with the sign of the rotation.

    What is fixed to the stator turns by -omega T as seen from the rotor, in the one-step matrices
    of the currents, (sample, 2, 2).
    """
    with np.errstate(over="ignore", invalid="ignore"):  # of an unstable model
        turn = transitions[:, 0, 1].mean() - transitions[:, 1, 0].mean()
    return abs(electrical_frequency) * (-1.0 if turn < 0 else 1.0)


def named_lines(
    lines: Sequence[Line], electrical_frequency: float, pole_pairs: int | None = None
) -> tuple[NamedLine, ...]:
    """Name the likely causes of a drive's residual lines.

    Parameters
    ----------
    lines : sequence of Line
        Of the complex signal i_d + j i_q.
    electrical_frequency : float
        Hz, negative for backward rotation; 0 where there is none.
    pole_pairs : int, optional
        Without it mechanical orders are not named.

    Returns
    -------
    tuple of NamedLine
        In the order given.
    """
    if not electrical_frequency:
        return tuple(NamedLine(line, 0.0, "") for line in lines)
    return tuple(_named(line, electrical_frequency, pole_pairs) for line in lines)


def _named(line: Line, base: float, pole_pairs: int | None) -> NamedLine:
    order, ends = line.frequency / base, (line.low / base, line.high / base)
    whole = round(order)
    if abs(order - whole) <= _NEAR or min(ends) <= whole <= max(ends):
        harmonic = _HARMONICS if whole % 6 == 0 else _UNKNOWN
        return NamedLine(line, float(whole), _CAUSES.get(abs(whole), harmonic))
    nearest = 6 * round(order / 6)
    beside = bool(nearest) and abs(order - nearest) <= _BESIDE
    if pole_pairs:
        mechanical = round(order * pole_pairs)
        near = _EXACT if beside else min(0.25, _NEAR * pole_pairs)
        if abs(order * pole_pairs - mechanical) <= near:
            cause = (
                f"mechanical order {mechanical}: resolver, eccentricity, or torque ripple in the "
                "speed"
            )
            return NamedLine(line, mechanical / pole_pairs, cause.replace("-", "−"))
    if beside:
        return NamedLine(line, order, _SIDE_BAND.format(nearest).replace("-", "−"))
    return NamedLine(line, order, _BETWEEN)
