"""Quality of a recording: generic checks that report and never repair.

Every sample is looked at, piece by piece.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from penode.arrays import FloatArray, IntArray
from penode.data.experiment import Experiment
from penode.data.gathered import pieces

# A spread below this share of the magnitude is rounding: the channel is constant.
_CONSTANT = 1e-12
# A run of equal samples is suspect from this length, and from this many times the usual run.
_STUCK_SAMPLES, _STUCK_RATIO = 20, 20
# An extreme value is suspect from this count, and from this many times its neighbour's count.
_CLIPPED_SAMPLES, _CLIPPED_RATIO = 10, 10


@dataclass(frozen=True)
class Finding:
    """One thing found in a recording: a sentence with the fix, naming recording and channel.

    The severity is ``"error"`` where the channel cannot serve, ``"warning"`` where a person should
    look.
    """

    severity: Literal["warning", "error"]
    channel: str
    sentence: str


def inspect_stretches(
    stretches: Sequence[Experiment], channels: Sequence[str]
) -> tuple[Finding, ...]:
    """Run every check over one recording.

    A channel may stand still in one stretch and not in all.
    """
    each = [inspect(stretch, channels) for stretch in stretches]
    still = [{f.channel: f for f in found if f.severity == "error"} for found in each]
    never = [f for channel, f in still[0].items() if all(channel in other for other in still)]
    return (*never, *(f for found in each for f in found if f.severity != "error"))


def inspect(experiment: Experiment, channels: Sequence[str]) -> tuple[Finding, ...]:
    """Run every check over the named channels, each of which is expected to move."""
    checks = (find_constant, find_stuck, find_clipping)
    findings = (check(experiment, channel) for channel in channels for check in checks)
    return tuple(finding for finding in findings if finding is not None)


def find_constant(experiment: Experiment, channel: str) -> Finding | None:
    """Find a channel that never moves: an error if all samples are equal but for rounding."""
    values = _values(experiment, channel)
    if not _is_constant(values):
        return None
    return Finding(
        "error",
        channel,
        f"{experiment.name}: channel {channel} is constant at {values[0]:.6g} in all "
        f"{len(values)} samples, so nothing can be learned from it; map the right column, "
        f"or record with moving {channel}.",
    )


def find_stuck(experiment: Experiment, channel: str) -> Finding | None:
    """Find the longest stretch in which a moving channel stands still, away from its extremes.

    A warning if at least 20 samples in a row are equal and this is at least 20 times the median
    length of such runs.
    """
    values = _values(experiment, channel)
    low, high = _range(values)
    if _is_constant(values):
        return None
    lengths: Counter[int] = Counter()
    run, first, at = 0, 0, 0.0
    for begin, length, level in _runs(values):
        lengths.update(
            dict(zip(*(a.tolist() for a in np.unique(length, return_counts=True)), strict=True))
        )
        inner = np.where((level > low) & (level < high), length, 0)
        longest = int(np.argmax(inner))
        if inner[longest] > run:
            run, at = int(inner[longest]), float(level[longest])
            first = experiment.place.row + int(begin[longest]) + 1
    if run < max(_STUCK_SAMPLES, _STUCK_RATIO * _median(lengths)):
        return None
    return Finding(
        "warning",
        channel,
        f"{experiment.name}: channel {channel} stands still at {at:.6g} for {run} "
        f"samples (data rows {first} to {first + run - 1}); check the sensor or the link.",
    )


def find_clipping(experiment: Experiment, channel: str) -> Finding | None:
    """Find a channel cut off at its largest or smallest value.

    A warning if at least 10 samples equal the extreme value, and 10 times as many as equal the
    value next to it. An extreme of zero is taken for rest, not for clipping.
    """
    values = _values(experiment, channel)
    if _is_constant(values):
        return None
    for word, sign in (("largest", 1.0), ("smallest", -1.0)):
        (level, count), (_, beside) = _two_largest(values, sign)
        enough = max(_CLIPPED_SAMPLES, _CLIPPED_RATIO * beside)
        if count >= enough and level != 0.0:
            return Finding(
                "warning",
                channel,
                f"{experiment.name}: channel {channel} equals its {word} value {level:.6g} in "
                f"{count} of {len(values)} samples, as if clipped; check the measuring range.",
            )
    return None


def _values(experiment: Experiment, channel: str) -> FloatArray:
    """Return one channel, refusing one that is missing."""
    experiment.require([channel])
    return experiment.channels[channel]


def _is_constant(values: FloatArray) -> bool:
    """Return whether all values are equal but for rounding."""
    low, high = _range(values)
    return bool(high - low <= _CONSTANT * max(abs(low), abs(high)))


def _range(values: FloatArray) -> tuple[float, float]:
    """Return the smallest and the largest value."""
    ends = [(float(piece.min()), float(piece.max())) for piece in pieces(values)]
    return min(low for low, _ in ends), max(high for _, high in ends)


def _runs(values: FloatArray) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
    """Yield begin, length and value of runs of equal values, piece by piece, in order."""
    done, before = 0, np.nan
    opened = np.empty(0, dtype=np.int64)
    for piece in pieces(values):
        begin = np.concatenate(
            [opened, done + np.flatnonzero(np.diff(piece, prepend=before) != 0.0)]
        )
        level = np.concatenate([[before] * len(opened), piece[begin[len(opened) :] - done]])
        if len(begin) > 1:
            yield begin[:-1], np.diff(begin), level[:-1]
        opened, before, done = begin[-1:], piece[-1], done + len(piece)
    yield opened, done - opened, np.array([before])


def _median(counted: Counter[int]) -> float:
    """Return the median of whole numbers that were counted."""
    numbers = np.array(sorted(counted))
    below = np.cumsum([counted[n] for n in numbers.tolist()])
    middle = [(below[-1] - 1) // 2, below[-1] // 2]
    return float(numbers[np.searchsorted(below, middle, side="right")].mean())


def _two_largest(values: FloatArray, sign: float) -> list[tuple[float, int]]:
    """Return the two largest values and how often each comes; the smallest with sign -1."""
    counted: Counter[float] = Counter()
    for piece in pieces(values):
        left = sign * piece
        for _ in range(2):
            if left.size:
                top = float(left.max())
                counted[top] += int(np.sum(left == top))
                left = left[left < top]
    levels = [(sign * level, counted[level]) for level in sorted(counted, reverse=True)]
    return [*levels, (0.0, 0), (0.0, 0)][:2]
