"""Operating points: where a recording dwells, averaged over whole electrical periods."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from penode.arrays import BoolArray, ComplexArray, FloatArray
from penode.data.experiment import Experiment
from penode.paper.conventional.rotation import held

#: Means over successive electrical periods that differ by less, in the largest current, stand.
_STILL = 0.005
#: Electrical periods at a point, the settling one included, below which it is passed, not held.
_LEAST_PERIODS = 3
#: Points this close, in the largest current, are one point.
_SAME = 0.02
#: Bounds of a period in samples, for speeds too high or too low to count by.
_SHORTEST = 10
_LONGEST = 2000


@dataclass(frozen=True)
class OperatingPoint:
    """Means over whole electrical periods at one point, `omega_el` in rad/s."""

    # i_d + j i_q, A, and u_d + j u_q, V, as the machine sees it on average.
    current: complex
    voltage: complex
    omega_el: float
    samples: int


def operating_points(experiment: Experiment, hold: str = "dq") -> tuple[OperatingPoint, ...]:
    """Find where the currents stand still, and average there; empty where they never dwell.

    The mean over one electrical period is free of offsets of the sensors (order 1 in dq) and of
    slots and dead time (orders 6, 12, ...). The currents stand while such means, taken one
    period apart, agree within 0.5 % of the largest current; the first period of a stretch is
    left out, in which currents settle, and a quarter of one at its end. A voltage held in the
    stationary frame falls behind the rotor by half a sample, which `hold` takes into account.
    """
    drive = experiment.stack(("i_d", "i_q", "u_d", "u_q", "omega_el"))
    period = _period(experiment)
    if len(drive) < _LEAST_PERIODS * period:
        return ()
    tolerance = _STILL * float(np.abs(drive[:, :2]).max())
    means = _moving_mean(drive[:, :2], period)
    gaps = np.abs(means[period:] - means[:-period]).max(axis=1)
    still = np.asarray(gaps <= tolerance)
    points = []
    for first, last in _runs(still):
        # Means from `first` to `last` and those a period later stand, so that their samples do, but
        # for a few at the end that one mean hides: the voltage of a step begins with a spike.
        end = last + 2 * period - 1 - period // 4
        whole = (end - first - period) // period * period
        if whole >= (_LEAST_PERIODS - 1) * period:
            points.append(_averaged(drive[end - whole : end], hold, experiment))
    return tuple(points)


def fold(points: Sequence[OperatingPoint], scale: float, mirrored: bool) -> list[list[int]]:
    """Return which points belong together: at one current, or mirrored at the d axis.

    Points within 2 % of `scale`, the largest current, A, are one; if mirrored, so are motor and
    generator, of opposite i_q.
    """
    groups: list[list[int]] = []
    for k, point in enumerate(points):
        for group in groups:
            first = points[group[0]].current
            gap = abs(_folded(point.current, mirrored) - _folded(first, mirrored))
            if gap <= _SAME * scale:
                group.append(k)
                break
        else:
            groups.append([k])
    return groups


def _folded(current: complex, mirrored: bool) -> complex:
    """Return i_d + j |i_q| of a machine that is symmetric about its d axis, or i as it is."""
    return complex(current.real, abs(current.imag)) if mirrored else current


def _period(experiment: Experiment) -> int:
    speed = float(np.median(np.abs(experiment.channels["omega_el"])))
    turn = max(speed * experiment.time_step, 1e-12)
    return int(np.clip(round(2 * np.pi / turn), _SHORTEST, _LONGEST))


def _moving_mean(values: FloatArray, length: int) -> FloatArray:
    """Return the means over `length` rows from each row on, (time - length + 1, channel)."""
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray((sums[length:] - sums[:-length]) / length)


def _runs(flags: BoolArray) -> list[tuple[int, int]]:
    """Return first and one past the last index of every run of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _averaged(rows: FloatArray, hold: str, experiment: Experiment) -> OperatingPoint:
    i_d, i_q, u_d, u_q, omega = rows.mean(axis=0)
    voltage = complex(u_d, u_q)
    if hold == "stationary":
        turn: ComplexArray = np.array([-1j * omega * experiment.time_step])
        voltage *= complex(held(turn)[0])
    return OperatingPoint(complex(i_d, i_q), voltage, float(omega), len(rows))
