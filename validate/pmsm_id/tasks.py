"""The plan: twelve machines, six imperfections, two draws; current references and name plates."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

FOLDER = Path("out") / "validate" / "pmsm_id"
#: Simulators, and the machines that each of them has.
MACHINES = {
    "bench": ("traction_300A", "comsol_300A", "brusa_250A", "ev400v_420A"),
    "sampled drive": ("drawn 1", "drawn 2", "drawn 3", "drawn 4"),
    "motulator": ("IPM 2.2 kW", "SPM 2.2 kW", "SyRM 6.7 kW", "PM-SyRM 5.6 kW"),
}
#: What a drive has beside noise of its current sensors. The last has no right answer: the sign of
#: the speed contradicts the voltages.
KINDS = ("clean", "delay", "inverter", "sensors", "iron", "reversed speed")
REFUSE = "reversed speed"
DRAWS = 2
#: Of the current sensors, as fractions of the machine's current: noise of each phase, and what
#: those of "sensors" have in phase b. Iron takes as large a fraction at the link's voltage.
NOISE, OFFSET, GAIN, IRON = 1e-3, 5e-3, 1.01, 1e-2
#: Seconds at operating points, and of the wander after them.
STILL, WANDER = 1.4, 0.8
#: How far the name plate is off at most, and how many currents the map is asked for.
NAME_PLATE, QUERIES = 0.2, 60

Reference = Callable[[float], complex]


@dataclass(frozen=True)
class Task:
    """A log that is to be made.

    Attributes
    ----------
    number : int
        From 0 on; those of one draw follow each other.
    simulator, machine, kind : str
    draw : int
    """

    number: int
    simulator: str
    machine: str
    kind: str
    draw: int

    @property
    def file(self) -> str:
        """Name of the log."""
        return f"{self.number:03d}.csv"

    def random(self, purpose: int) -> np.random.Generator:
        """Return a generator of its own for a purpose."""
        return np.random.default_rng([2026, self.number, purpose])

    def fraction(self, low: float, high: float) -> float:
        """Return the speed as a fraction of the machine's, of either sign."""
        random = self.random(0)
        return float(random.choice((-1, 1)) * random.uniform(low, high))

    def reference(self, current: float, frequency: float) -> Reference:
        """Return currents over time: operating points for five periods each, then a wander.

        Parameters
        ----------
        current : float
            Of the machine, in A; up to 0.6 to 0.8 of it is used.
        frequency : float
            Electrical, in Hz.
        """
        random = self.random(1)
        amplitude = float(random.uniform(0.6, 0.8)) * current
        dwell = max(0.06, 5 / frequency)
        levels = random.uniform((-0.8, 0.2), (0.3, 0.8), (1 + int(STILL / dwell) // 2, 2))
        points = [complex(d, side * q) for d, q in levels for side in (1, -1)]
        rates = 2 * np.pi * random.uniform(4, 15, 2)

        def at(time: float) -> complex:
            if time < STILL:
                return amplitude * points[int(time / dwell)]
            d, q = np.sin(rates * (time - STILL))
            return amplitude * complex(0.75 * d - 0.15, 0.85 * q)

        return at


def tasks() -> list[Task]:
    """Return all tasks."""
    drawn = [
        (simulator, machine, kind, draw)
        for draw in range(DRAWS)
        for simulator, machines in MACHINES.items()
        for machine in machines
        for kind in KINDS
    ]
    return [Task(number, *one) for number, one in enumerate(drawn)]
