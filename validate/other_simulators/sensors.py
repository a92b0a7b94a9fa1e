"""Current sensors in the loop of a simulated drive."""

import numpy as np

from validate.other_simulators.plan import Planned

#: Range of a converter of currents over the amplitude of the machine.
_RANGE = 2.0


class Sensors:
    """Three current sensors: gains, an offset, noise, quantisation. Called once a sample.

    Parameters
    ----------
    planned : Planned
        What the drive of its kind does to the currents.
    part : int
        Which recording of it.
    """

    def __init__(self, planned: Planned, part: int):
        does, current = planned.kind.drive, planned.machine.current
        self.gains = does.get("gain", 1.0) * np.array([1.0, does.get("gain_b", 1.0), 1.0])
        self.offsets = np.array([0.0, does.get("offset_b", 0.0) * current, 0.0])
        self.step = _RANGE * 2 * current / 2 ** does["bits"] if "bits" in does else 0.0
        self.colour, self.noise = does.get("colour", 0.0), planned.noise
        self.random = planned.random(10 + part)
        self.state = np.zeros(3)

    def __call__(self, currents: np.ndarray) -> np.ndarray:
        """Return what is measured of three phase currents, in A."""
        fresh = np.sqrt(1 - self.colour**2) * self.random.normal(size=3)
        self.state = self.colour * self.state + fresh
        measured = self.gains * currents + self.offsets + self.noise * self.state
        return self.step * np.round(measured / self.step) if self.step else measured
