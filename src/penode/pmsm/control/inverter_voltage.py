"""What an inverter takes of the voltage over a turn of the rotor: along the current, by size."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from penode.arrays import FloatArray, float64, on_device
from penode.models.base import Model
from penode.models.inputs import Inputs
from penode.models.parameters import with_batch_axis
from penode.pmsm.machine.dead_time import PhaseSigns
from penode.pmsm.machine.terms import ANGLE, SPEED

#: Sizes of the current, closer where the voltage bends, and angles of the rotor of a mean.
_SIZES, _ANGLES = 65, 360


@dataclass(frozen=True, eq=False)
class InverterVoltage:
    """V(abs(i)) i/abs(i), the mean over the angle of what dead time and devices take.

    Attributes
    ----------
    size : ndarray, shape (size,)
        Sizes of the current in A, from zero up; from the largest on the voltage stays.
    voltage : ndarray, shape (size,)
        V in V.
    """

    size: FloatArray
    voltage: FloatArray

    @classmethod
    def of(cls, model: Model, largest: float) -> "InverterVoltage | None":
        """Return that of a machine's terms up to a current in A; None without dead time."""
        terms = [t for t in getattr(model, "terms", ()) if t.role == PhaseSigns.role]
        if not terms or not largest > 0:
            return None
        size = largest * np.linspace(0, 1, _SIZES) ** 2
        angle = np.tile(2 * np.pi / _ANGLES * np.arange(_ANGLES), _SIZES)
        along = np.repeat(size, _ANGLES)
        with float64():
            x = on_device(np.stack([along, np.zeros_like(along)]))
            u = Inputs(on_device(np.stack([0 * angle, angle])), (SPEED.name, ANGLE.name))
            lost = [with_batch_axis(term).drop(x, u, None)[0] for term in terms]
            mean = np.sum(lost, axis=0).reshape(_SIZES, _ANGLES).mean(axis=1)
        return cls(size, mean)

    def per_ampere(self, size: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return V/abs(i) and dV/d abs(i) in ohm at sizes of the current in A."""
        known, largest = PchipInterpolator(self.size, self.voltage), self.size[-1]
        inside = np.clip(size, 1e-9 * largest, largest)
        slope = np.where(size < largest, known(inside, 1), 0.0)
        return known(inside) / np.maximum(size, inside), slope
