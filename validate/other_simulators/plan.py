"""The plan: which machine runs at which speed for each kind, twice, once for each half."""

from dataclasses import dataclass

import numpy as np

from validate.other_simulators.kinds import KINDS, Kind
from validate.other_simulators.machines import MACHINES, Machine

#: Of every draw.
SEED = 20_26
HALVES = ("developing", "held out")


@dataclass(frozen=True)
class Planned:
    """A recording, or two at two speeds, that is to be made.

    Attributes
    ----------
    number : int
        Even in the half for developing, odd in the half held out.
    kind : Kind
    machine : Machine
    speeds_rpm : tuple of float
        Of the shaft, one a recording.
    amplitude : float
        Of the current reference, in A.
    noise : float
        Deviation of the current sensors, in A.
    """

    number: int
    kind: Kind
    machine: Machine
    speeds_rpm: tuple[float, ...]
    amplitude: float
    noise: float

    @property
    def half(self) -> str:
        """Which half it belongs to."""
        return HALVES[self.number % 2]

    def random(self, purpose: int) -> np.random.Generator:
        """Return a generator of its own for a purpose."""
        return np.random.default_rng([SEED, self.number, purpose])

    def resistance(self, time: float) -> float:
        """Return the resistance in ohm at a time in s; it rises where the kind says so."""
        if "warming" not in self.kind.drive:
            return self.machine.resistance
        rise = self.random(1).uniform(0.1, 0.25)
        return float(self.machine.resistance * (1 + rise * time / self.kind.duration))


def plan(repetition: int = 0) -> list[Planned]:
    """Return all recordings; the two of a kind have different machines.

    Parameters
    ----------
    repetition : int
        From 1 on the same kinds are drawn again, with numbers that go on.
    """
    planned = []
    for index, kind in enumerate(KINDS):
        able = [m for m in MACHINES.values() if m.simulator in kind.simulators]
        random = np.random.default_rng([SEED, index, 99 + repetition])
        first = 2 * (index + repetition * len(KINDS))
        drawn = random.permutation(len(able))[:2]
        planned += [_drawn(first + half, kind, able[which]) for half, which in enumerate(drawn)]
    return planned


def _drawn(number: int, kind: Kind, machine: Machine) -> Planned:
    random = np.random.default_rng([SEED, number, 0])
    fraction = random.uniform(*kind.speeds)
    sign = kind.sign or int(random.choice((-1, 1)))
    speed = sign * fraction * machine.base_rpm
    return Planned(
        number,
        kind,
        machine,
        (speed, 0.4 * speed) if kind.profile == "two" else (speed,),
        float(random.uniform(0.5, 0.85)) * machine.current,
        float(random.uniform(0.0005, 0.002)) * machine.current,
    )
