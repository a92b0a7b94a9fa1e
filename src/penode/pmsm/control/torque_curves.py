"""The most torque on closed curves of currents, many curves at once."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.spatial import cKDTree

from penode.arrays import FloatArray
from penode.pmsm.control.controlled_machine import ControlledMachine
from penode.pmsm.control.inversion import inverse, solved
from penode.pmsm.machine.frames import quarter_turned

#: Angles of a curve in rad that are tried before the best one is refined.
ANGLES = np.linspace(-np.pi, np.pi, 121)
#: Rounds of refinement, and angles in each; the distance to the root is squared every time.
_ROUNDS, _WITHIN = 4, np.linspace(-1, 1, 11)
#: First guesses of a current: a grid, up to this many times the current limit.
_GUESSES, _REACH = 41, 1.25


class Curves(Protocol):
    """Closed curves of currents."""

    def __call__(self, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return currents, slopes (2, curve, angle) at angles (curve, angle) or (1, angle), rad."""


@dataclass(frozen=True, eq=False)
class Circles:
    """Currents of one magnitude, the radius (curve,), A, by their angle."""

    radius: FloatArray

    def __call__(self, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return currents in A and their slopes in A/rad, see `Curves`."""
        current = self.radius[:, None] * np.stack([np.cos(angle), np.sin(angle)])
        return current, quarter_turned(current)


@dataclass(frozen=True, eq=False)
class VoltageCurves:
    """Currents at which the voltage has one magnitude, by the angle of the voltage."""

    machine: ControlledMachine
    # Electrical (curve,), rad/s.
    speed: FloatArray
    # (curve,), V.
    magnitude: FloatArray
    # Current, A, around which first guesses are spread.
    reach: float

    def __call__(self, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return currents in A, NaN where none was found, and their slopes, see `Curves`."""
        voltage = self.magnitude[:, None] * np.stack([np.cos(angle), np.sin(angle)])
        flat, start = voltage.reshape(2, -1), self._nearest(voltage).reshape(2, -1)
        speed = np.broadcast_to(self.speed[:, None], voltage.shape[1:]).ravel()
        current = inverse(
            lambda i: self.machine.voltage(i, speed),
            lambda i: self.machine.voltage_slope(i, speed),
            flat,
            start,
        )
        along = solved(self.machine.voltage_slope(current, speed), quarter_turned(flat))
        return current.reshape(voltage.shape), along.reshape(voltage.shape)

    def _nearest(self, voltage: FloatArray) -> FloatArray:
        """Return the currents of a grid whose voltages are nearest, of the shape of voltage."""
        cloud, trees = self._cloud, self._trees
        rows = [
            cloud[:, trees[speed].query(wanted.T)[1]]
            for speed, wanted in zip(self.speed.tolist(), np.moveaxis(voltage, 1, 0), strict=True)
        ]
        return np.stack(rows, axis=1) if rows else voltage

    @cached_property
    def _cloud(self) -> FloatArray:
        """First guesses of a current, (2, guess), A."""
        axis = _REACH * self.reach * np.linspace(-1, 1, _GUESSES)
        return np.stack(np.meshgrid(axis, axis)).reshape(2, -1)

    @cached_property
    def _trees(self) -> dict[float, cKDTree]:
        """The voltages of the first guesses at each speed, V."""
        still = self.machine.drop(self._cloud)
        flux = quarter_turned(self.machine.flux_map(*self._cloud))
        return {w: cKDTree((still + w * flux).T) for w in set(self.speed.tolist())}


def most_torque(machine: ControlledMachine, curves: Curves) -> FloatArray:
    """Return the current of most torque on each curve, (2, curve), A; NaN where none was found."""
    torque = machine.torque(curves(ANGLES[None])[0])
    best = ANGLES[np.where(np.isnan(torque), -np.inf, torque).argmax(axis=1)]
    width = ANGLES[1] - ANGLES[0]
    for _ in range(_ROUNDS):
        angle = best[:, None] + width * _WITHIN
        current, along = curves(angle)
        best = _falling_zero(angle, (machine.torque_slope(current) * along).sum(axis=0), best)
        width *= _WITHIN[1] - _WITHIN[0]
    return curves(best[:, None])[0][..., 0]


def _falling_zero(angle: FloatArray, slope: FloatArray, otherwise: FloatArray) -> FloatArray:
    """Return where each row of slopes falls through zero, interpolated; else what was given."""
    falls = (slope[:, :-1] > 0) & (slope[:, 1:] <= 0)
    rows, cell = np.arange(len(angle)), falls.argmax(axis=1)
    before, after = slope[rows, cell], slope[rows, cell + 1]
    with np.errstate(all="ignore"):
        share = before / (before - after)
    crossing = angle[rows, cell] + share * (angle[:, 1] - angle[:, 0])
    return np.where(falls.any(axis=1), crossing, otherwise)
