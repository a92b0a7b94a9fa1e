"""Current references: what the drive is asked to follow.

A reference is a function of time. Each of these stays within a disc of its own amplitude by
construction, whatever its other values; a run refuses an amplitude above the machine's limit.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from penode.arrays import FloatArray
from penode.errors import InputError

#: Takes times in s, shape (time,), and returns i_d and i_q in A, shape (time, 2).
Reference: TypeAlias = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Domain:
    """A part of the current disc: smallest and largest i_d and i_q within -1 and 1.

    i_q is over the radius, i_d over what i_q leaves of it.
    """

    d: tuple[float, float] = (-1.0, 1.0)
    q: tuple[float, float] = (-1.0, 1.0)

    def __post_init__(self) -> None:
        for axis, (low, high) in {"d": self.d, "q": self.q}.items():
            if not -1.0 <= low < high <= 1.0:
                raise InputError(
                    f"domain: the {axis} axis must rise within -1 and 1, got {low:g} to {high:g}."
                )


WHOLE_DISC = Domain()
#: Motor operation with the magnets' field weakened: i_d <= 0, i_q >= 0.
MOTOR = Domain(d=(-1.0, 0.0), q=(0.0, 1.0))
#: The same braking: i_d <= 0, i_q <= 0.
GENERATOR = Domain(d=(-1.0, 0.0), q=(-1.0, 0.0))


@dataclass(frozen=True)
class Lissajous:
    """Double-sine sweep over the disc of a maximum current, or over a part of it.

    ``i_q = I sin(phi_q t)``, ``i_d = sqrt(I^2 - i_q^2) sin(phi_d t)``: Montecchio et al., Horizon
    Selection in Physics-Enhanced Neural ODEs, section 5. Nearly equal rates cover the disc densely.
    In a smaller domain both sines swing between its bounds. Where i_q turns at +-I, i_d has a kink,
    in the paper's figure as in a part of it.

    Attributes
    ----------
    amplitude : float
        Radius I of the disc in A (peak value of a phase).
    rate_d, rate_q : float
        Angular frequencies phi_d and phi_q in rad/s.
    domain : Domain
        The part of the disc to sweep.
    """

    amplitude: float
    rate_d: float
    rate_q: float
    domain: Domain = WHOLE_DISC

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return i_d and i_q (time, 2), A, at times in s."""
        i_q = self.amplitude * _swing(self.domain.q, self.rate_q * time)
        left = np.sqrt(self.amplitude**2 - i_q**2)
        return np.stack([left * _swing(self.domain.d, self.rate_d * time), i_q], axis=1)


@dataclass(frozen=True)
class Spiral:
    """Circles whose radius swings between nothing and the amplitude: ``I |sin(pi t / T)|``."""

    # Largest radius I, A.
    amplitude: float
    # Angular frequency of the circles, rad/s; negative turns the other way.
    rate: float
    # Time T from the centre out and back, s.
    period: float

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return i_d and i_q (time, 2), A, at times in s."""
        radius = self.amplitude * np.abs(np.sin(np.pi * time / self.period))
        angle = self.rate * time
        return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


@dataclass(frozen=True)
class Steps:
    """Operating points, each held for the same time, over and over.

    Attributes
    ----------
    points : tuple of (float, float)
        i_d and i_q in A.
    dwell : float
        Time at each point in s.
    """

    points: tuple[tuple[float, float], ...]
    dwell: float

    def __post_init__(self) -> None:
        if not self.points or not self.dwell > 0:
            raise InputError(
                f"steps: at least one point and a dwell above zero are needed, got "
                f"{len(self.points)} points for {self.dwell:g} s each."
            )

    @property
    def duration(self) -> float:
        """Time in s that all points take once."""
        return len(self.points) * self.dwell

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return i_d and i_q (time, 2), A, at times in s."""
        # A sample that falls on a step by rounding belongs to the point that begins there.
        index = np.floor(time / self.dwell + 1e-9).astype(int) % len(self.points)
        rows: FloatArray = np.asarray(self.points, dtype=np.float64)[index]
        return rows


def stationary_grid(
    amplitude: float, *, points: int, dwell: float, domain: Domain = WHOLE_DISC
) -> Steps:
    """Return a grid of operating points to be held one after the other, row by row and back.

    Parameters
    ----------
    amplitude : float
        Radius of the disc in A.
    points : int
        Points to one axis of the square around the disc; those outside the disc are left out.
    dwell : float
        Time at each point in s.
    domain : Domain
        The part of the disc, its bounds here in shares of the radius in both axes.
    """
    if points < 2:
        raise InputError(f"stationary grid: points an axis must be >= 2, got {points}.")
    i_d = amplitude * np.linspace(*domain.d, points)
    i_q = amplitude * np.linspace(*domain.q, points)
    snake = [
        (float(d), float(q))
        for row, q in enumerate(i_q)
        for d in (i_d if row % 2 == 0 else i_d[::-1])
        if np.hypot(d, q) <= amplitude
    ]
    return Steps(tuple(snake), dwell)


@dataclass(frozen=True)
class Injection:
    """A sine of current around an operating point, such as is injected at standstill.

    The disc of ``|point| + |amplitude|`` holds it.

    Attributes
    ----------
    amplitude : tuple of two floats
        Peak values in the d and the q axis in A.
    frequency : float
        Frequency in Hz.
    point : tuple of two floats
        Mean i_d and i_q in A.
    """

    amplitude: tuple[float, float]
    frequency: float
    point: tuple[float, float] = (0.0, 0.0)

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return i_d and i_q (time, 2), A, at times in s."""
        wave = np.sin(2 * np.pi * self.frequency * np.asarray(time, dtype=np.float64))
        rows: FloatArray = np.asarray(self.point) + wave[:, None] * np.asarray(self.amplitude)
        return rows


def _swing(bounds: tuple[float, float], angle: FloatArray) -> FloatArray:
    """Return a sine between two bounds."""
    low, high = bounds
    return np.asarray((high + low) / 2 + (high - low) / 2 * np.sin(angle), dtype=np.float64)
