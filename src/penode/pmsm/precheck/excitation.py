"""What recordings cover: currents, speeds, and how fast the currents move."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import label
from scipy.spatial import ConvexHull, QhullError

from penode.arrays import BoolArray, FloatArray
from penode.data.experiment import Experiment
from penode.validation.coverage import supported, thin

#: Fraction of the disc of the largest current from which the currents cover it well.
ENOUGH = 0.2
#: Relative change of the speed that makes it another one.
_OTHER_SPEED = 0.2
#: Percentiles between which a speed is no spike.
_USUAL = (5.0, 95.0)
#: A quarter of the disc was visited from this fraction of the time on.
_VISITED = 0.01
#: Points of an axis at which holes are looked for, and area of one over the hull's to be named.
_POINTS, _HOLE = 61, 0.02


@dataclass(frozen=True, eq=False)
class Holes:
    """Where the hull of the visited currents is not supported, on an even grid."""

    # A, (point,), of both axes.
    axis: FloatArray
    # Whether currents of the hull are too far from any that was visited, (i_d, i_q).
    inside: BoolArray
    # Of all holes and of the largest, over the hull's area.
    fraction: float
    largest: float
    # A, of the largest.
    middle: FloatArray

    @classmethod
    def of(cls, currents: FloatArray, hull: ConvexHull | None) -> "Holes":
        """Return those of visited currents (time, 2), A; none where they lie on a line."""
        most = float(np.abs(currents).max())
        axis = np.linspace(-most, most, _POINTS)
        points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
        flat = points.reshape(-1, 2)
        if hull is None:
            within = np.zeros(len(flat), bool)
        else:
            faces = hull.equations
            within = (flat @ faces[:, :2].T + faces[:, 2] <= 0).all(axis=1)
        empty = np.zeros(len(flat), bool)
        empty[within] = ~supported(thin(currents), flat[within])
        inside = empty.reshape(_POINTS, _POINTS)
        parts, count = label(inside)
        sizes = np.bincount(parts.ravel(), minlength=count + 1)[1:]
        if not count:
            return cls(axis, inside, 0.0, 0.0, np.zeros(2))
        middle = points[parts == 1 + int(np.argmax(sizes))].mean(axis=0)
        area = max(int(within.sum()), 1)
        return cls(axis, inside, float(sizes.sum()) / area, float(sizes.max()) / area, middle)


@dataclass(frozen=True, eq=False)
class Excitation:
    """What recordings cover together."""

    # A (peak).
    largest_current: float
    # Area of the hull of all visited currents over that of the disc of the largest current.
    fraction: float
    # Of the time in each quarter of the dq plane, anticlockwise from i_d > 0, i_q > 0.
    quarters: tuple[float, ...]
    # Median electrical speed of each recording, rad/s.
    speeds: tuple[float, ...]
    # From the lowest to the highest speed, spikes left out, rad/s.
    speed_range: tuple[float, float]
    # Typical angular frequency of the currents' movement, rad/s.
    current_rate: float
    # Corners (corner, 2), A, in order; empty where all currents lie on a line.
    hull: FloatArray
    # Where the hull is too far from any current to count as recorded.
    holes: "Holes"

    @property
    def advice(self) -> tuple[str, ...]:
        """What would widen the excitation, a sentence each."""
        suggestions = []
        empty = [q for q, part in zip(QUARTERS, self.quarters, strict=True) if part < _VISITED]
        if self.fraction < ENOUGH:
            suggestions.append(
                f"The currents visit {100 * self.fraction:.2g} % of the disc of "
                f"{self.largest_current:.3g} A; sweep i_d and i_q over a Lissajous figure or a "
                "spiral."
            )
        if empty:
            suggestions.append(
                f"No current was visited with {' or '.join(empty)}, so the map says nothing there."
            )
        if self.holes.largest > _HOLE:
            step = 0.01 * self.largest_current
            i_d, i_q = step * np.round(self.holes.middle / step) + 0.0
            suggestions.append(
                f"{100 * self.holes.fraction:.2g} % of the hull lie in holes, too far from any "
                f"recorded current; the largest is around i_d {i_d:.3g} A, i_q {i_q:.3g} A. There "
                "the map will be an extrapolation; other frequencies of the currents fill it."
            )
        if np.ptp(self.speed_range) < _OTHER_SPEED * np.max(np.abs(self.speed_range)):
            suggestions.append(
                "There is one speed only; a second one, or the reverse, makes R surer unless the "
                "accuracy of the sensors is its limit."
            )
        return tuple(suggestions)


QUARTERS = (
    "i_d > 0 and i_q > 0",
    "i_d < 0 and i_q > 0",
    "i_d < 0 and i_q < 0",
    "i_d > 0 and i_q < 0",
)


def excitation_of(recordings: Sequence[Experiment]) -> Excitation:
    """Measure what recordings cover."""
    currents = np.concatenate([e.stack(("i_d", "i_q")) for e in recordings])
    largest = float(np.hypot(*currents.T).max())
    quarter = (np.arctan2(currents[:, 1], currents[:, 0]) // (np.pi / 2)).astype(int) % 4
    try:
        hull = ConvexHull(currents)
        area, corners = float(hull.volume), currents[hull.vertices]
    except QhullError:  # all on a line
        hull, area, corners = None, 0.0, np.zeros((0, 2))
    ends = np.array([np.percentile(e.channels["omega_el"], _USUAL) for e in recordings])
    return Excitation(
        largest_current=largest,
        fraction=area / (np.pi * largest**2),
        quarters=tuple(float(np.mean(quarter == k)) for k in range(4)),
        speeds=tuple(float(np.median(e.channels["omega_el"])) for e in recordings),
        speed_range=(float(ends[:, 0].min()), float(ends[:, 1].max())),
        current_rate=max(_rate(e) for e in recordings),
        hull=corners,
        holes=Holes.of(currents, hull),
    )


def _rate(experiment: Experiment) -> float:
    """Return the frequency below which nine tenths of the currents' power lie, in rad/s."""
    currents = experiment.stack(("i_d", "i_q"))
    power = np.sum(np.abs(np.fft.rfft(currents - currents.mean(axis=0), axis=0)) ** 2, axis=1)
    below = np.cumsum(power) / max(float(power.sum()), 1e-300)
    index = int(np.searchsorted(below, 0.9))
    return 2 * np.pi * index / (len(currents) * experiment.time_step)
