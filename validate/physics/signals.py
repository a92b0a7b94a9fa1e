"""Inputs over time: steps, ramps and sums of sines, drawn; times are counted in samples."""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from penode.arrays import FloatArray

#: A value over time, from the beginning of a piece to its end.
Piece = Callable[[float], float]


@dataclass(frozen=True, eq=False)
class Path:
    """One input over time, smooth from one break to the next.

    Attributes
    ----------
    breaks : tuple of float
        Times where a piece ends and the next begins, ascending.
    pieces : tuple of callable
        One more than breaks.
    """

    breaks: tuple[float, ...]
    pieces: tuple[Piece, ...]

    def piece(self, inside: float) -> Piece:
        """Return the piece that a time lies in; at a break the one that begins."""
        return self.pieces[bisect_right(self.breaks, inside)]

    def sampled(self, samples: int) -> FloatArray:
        """Return the values at the samples, (sample,)."""
        return np.array([self.piece(k)(k) for k in range(samples)])

    def late(self, delay: float) -> "Path":
        """Return the same some samples later."""
        pieces = tuple((lambda t, f=f: f(t - delay)) for f in self.pieces)
        return Path(tuple(at + delay for at in self.breaks), pieces)

    def within(self, low: float, high: float) -> "Path":
        """Return the same cut off at two limits."""
        pieces = tuple((lambda t, f=f: min(max(f(t), low), high)) for f in self.pieces)
        return replace(self, pieces=pieces)


#: Draws a path for so many samples.
Signal = Callable[[np.random.Generator, int], Path]


def steps(low: float, high: float, hold: int) -> Signal:
    """Return levels between two limits, each held for about `hold` samples: a zero-order hold."""

    def draw(random: np.random.Generator, samples: int) -> Path:
        breaks = _breaks(random, samples, hold)
        levels = random.uniform(low, high, len(breaks) + 1).tolist()
        return Path(breaks, tuple((lambda t, level=level: level) for level in levels))

    return draw


def ramps(low: float, high: float, hold: int) -> Signal:
    """Return straight lines between levels, about `hold` samples apart: a first-order hold."""

    def draw(random: np.random.Generator, samples: int) -> Path:
        breaks = _breaks(random, samples, hold)
        knots = [0, *breaks, breaks[-1] + hold]
        levels = random.uniform(low, high, len(knots)).tolist()
        ends = zip(knots, knots[1:], levels, levels[1:], strict=False)
        return Path(breaks, tuple(_line(*each) for each in ends))

    return draw


def sines(middle: float, size: float, fastest: float, slowest: float, lines: int = 8) -> Signal:
    """Return a sum of sines about a middle, periods in samples, which no hold repeats exactly.

    Its deviation is about half of `size`.
    """

    def draw(random: np.random.Generator, samples: int) -> Path:
        edges = np.geomspace(1 / slowest, 1 / fastest, lines + 1)
        rate = 2 * np.pi * random.uniform(edges[:-1], edges[1:])
        phase = random.uniform(0, 2 * np.pi, lines)
        scale = size / np.sqrt(2 * lines)
        return Path((), (lambda t: middle + scale * float(np.sin(rate * t + phase).sum()),))

    return draw


def _breaks(random: np.random.Generator, samples: int, hold: int) -> tuple[float, ...]:
    lengths = random.integers(max(hold // 2, 1), 3 * hold // 2 + 1, 2 * samples // hold + 4)
    ends = np.cumsum(lengths)
    return tuple(ends[: int(np.searchsorted(ends, samples)) + 1].tolist())


def _line(begin: float, end: float, low: float, high: float) -> Piece:
    slope = (high - low) / (end - begin)
    return lambda t: low + slope * (max(t, 0.0) - begin)


def all_breaks(drive: Sequence[Path], samples: int) -> list[float]:
    """Return the times from the first sample to the last between which all inputs are smooth."""
    inner = {at for path in drive for at in path.breaks if 0 < at < samples - 1}
    return [0.0, *sorted(inner), samples - 1.0]
