"""What a plant has and the model does not: friction, delay, an unmodelled mode, saturation."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import tanh

from validate.physics.signals import Path

#: Rates of a plant's states from states, inputs and parameters, SI units.
Plant = Callable[[Sequence[float], Sequence[float], Mapping[str, float]], Sequence[float]]


@dataclass(frozen=True)
class Misfit:
    """Nothing; what follows changes one of the three.

    Attributes
    ----------
    more : int
        States beside the model's, at rest in the beginning.
    """

    more: int = 0

    def drive(self, paths: Sequence[Path]) -> Sequence[Path]:
        """Return the inputs that act on the plant for those that are recorded."""
        return paths

    def plant(self, plant: Plant) -> Plant:
        """Return the plant for that of the model."""
        return plant


@dataclass(frozen=True)
class Friction(Misfit):
    """Coulomb friction on a speed: -size tanh(speed / width) in its rate, the state's unit/s."""

    row: int = 0
    size: float = 0.0
    width: float = 1.0

    def plant(self, plant: Plant) -> Plant:
        """Return the plant with friction."""

        def rates(x: Sequence[float], u: Sequence[float], p: Mapping[str, float]) -> list[float]:
            out = list(plant(x, u, p))
            out[self.row] -= self.size * tanh(x[self.row] / self.width)
            return out

        return rates


@dataclass(frozen=True)
class Delay(Misfit):
    """The first input acts some samples late."""

    samples: float = 0.0

    def drive(self, paths: Sequence[Path]) -> Sequence[Path]:
        """Return the inputs with a late first one."""
        return [paths[0].late(self.samples), *paths[1:]]


@dataclass(frozen=True)
class Saturation(Misfit):
    """The first input is cut off at two limits."""

    low: float = 0.0
    high: float = 0.0

    def drive(self, paths: Sequence[Path]) -> Sequence[Path]:
        """Return the inputs with a limited first one."""
        return [paths[0].within(self.low, self.high), *paths[1:]]


@dataclass(frozen=True)
class Lag(Misfit):
    """The first input acts through a first-order lag, s; it begins where the input does not act."""

    more: int = 1
    time: float = 1.0
    rest: float = 0.0

    def plant(self, plant: Plant) -> Plant:
        """Return the plant behind its actuator."""

        def rates(x: Sequence[float], u: Sequence[float], p: Mapping[str, float]) -> list[float]:
            behind = self.rest + x[-1]
            return [*plant(x[:-1], [behind, *u[1:]], p), (u[0] - behind) / self.time]

        return rates


@dataclass(frozen=True)
class Resonance(Misfit):
    """The first input acts through an oscillator of so many rad/s and damping."""

    more: int = 2
    frequency: float = 1.0
    damping: float = 0.1

    def plant(self, plant: Plant) -> Plant:
        """Return the plant behind its actuator."""

        def rates(x: Sequence[float], u: Sequence[float], p: Mapping[str, float]) -> list[float]:
            *own, y, v = x
            w = self.frequency
            return [*plant(own, [y, *u[1:]], p), v, w * w * (u[0] - y) - 2 * self.damping * w * v]

        return rates


@dataclass(frozen=True)
class Appendage(Misfit):
    """A mass on a spring hangs on a mass of the model, at rows of its position and speed.

    Attributes
    ----------
    place, speed : int
        Rows.
    ratio : float
        Its mass over the model's.
    frequency, damping : float
        Of the mass alone, rad/s.
    """

    more: int = 2
    place: int = 0
    speed: int = 1
    ratio: float = 0.1
    frequency: float = 1.0
    damping: float = 0.1

    def plant(self, plant: Plant) -> Plant:
        """Return the plant with the mass on it."""

        def rates(x: Sequence[float], u: Sequence[float], p: Mapping[str, float]) -> list[float]:
            *own, q, r = x
            w = self.frequency
            pull = w * w * (own[self.place] - q) + 2 * self.damping * w * (own[self.speed] - r)
            out = list(plant(own, u, p))
            out[self.speed] -= self.ratio * pull
            return [*out, r, pull]

        return rates


@dataclass(frozen=True)
class Store(Misfit):
    """A store fills from a state and gives back, rate 1/s: another lump, another pair.

    Attributes
    ----------
    row : int
        State that it takes from.
    ratio : float
        Its capacity over that of the state.
    """

    more: int = 1
    row: int = 0
    ratio: float = 0.1
    rate: float = 1.0

    def plant(self, plant: Plant) -> Plant:
        """Return the plant with the store."""

        def rates(x: Sequence[float], u: Sequence[float], p: Mapping[str, float]) -> list[float]:
            *own, full = x
            flow = self.rate * (own[self.row] - full)
            out = list(plant(own, u, p))
            out[self.row] -= self.ratio * flow
            return [*out, flow]

        return rates
