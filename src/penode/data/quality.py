"""Quality of a recording: generic checks that report and never repair."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.errors import InputError

# A spread below this share of the magnitude is rounding: the channel is constant.
_CONSTANT = 1e-12
# A run of equal samples is suspect from this length, and from this many times the usual run.
_STUCK_SAMPLES, _STUCK_RATIO = 20, 20
# An extreme value is suspect from this count, and from this many times its neighbour's count.
_CLIPPED_SAMPLES, _CLIPPED_RATIO = 10, 10


@dataclass(frozen=True)
class Finding:
    """One thing found in a recording.

    Attributes
    ----------
    severity : {"warning", "error"}
        ``"error"`` where the channel cannot serve, ``"warning"`` where a person should look.
    channel : str
        Channel concerned.
    sentence : str
        What was found and how to mend it, naming the recording and the channel.
    """

    severity: Literal["warning", "error"]
    channel: str
    sentence: str


Check: TypeAlias = Callable[[Experiment, str], Finding | None]


def inspect(experiment: Experiment, channels: Sequence[str]) -> tuple[Finding, ...]:
    """Run every check over the named channels.

    Parameters
    ----------
    experiment : Experiment
        Recording to look at.
    channels : sequence of str
        Channels to look at; each is expected to move.

    Returns
    -------
    tuple of Finding
        In the order of the channels; empty where nothing was found.

    Raises
    ------
    InputError
        If a channel is missing.
    """
    findings = (check(experiment, channel) for channel in channels for check in CHECKS)
    return tuple(finding for finding in findings if finding is not None)


def check_excitation(experiment: Experiment, channels: Sequence[str]) -> None:
    """Refuse a recording in which a needed channel never moves.

    Parameters
    ----------
    experiment : Experiment
        Recording to look at.
    channels : sequence of str
        Channels that have to move for the identification at hand.

    Raises
    ------
    InputError
        If a channel is missing or constant.
    """
    for channel in channels:
        finding = find_constant(experiment, channel)
        if finding is not None:
            raise InputError(finding.sentence)


def check_some_excitation(experiment: Experiment, channels: Sequence[str]) -> None:
    """Refuse a recording in which none of several channels moves; see `check_excitation`.

    One axis at rest is no obstacle: a winding may be excited along the other alone.
    """
    if channels and all(find_constant(experiment, channel) is not None for channel in channels):
        check_excitation(experiment, channels)


def find_constant(experiment: Experiment, channel: str) -> Finding | None:
    """Find a channel that never moves.

    Parameters
    ----------
    experiment : Experiment
        Recording to look at.
    channel : str
        Channel to look at.

    Returns
    -------
    Finding or None
        An error if all samples are equal but for rounding.

    Raises
    ------
    InputError
        If the channel is missing.
    """
    values = _values(experiment, channel)
    if not _is_constant(values):
        return None
    return Finding(
        "error",
        channel,
        f"{experiment.name}: channel {channel} is constant at {values[0]:.6g} in all "
        f"{len(values)} samples, so nothing can be learned from it; record with moving {channel}.",
    )


def find_stuck(experiment: Experiment, channel: str) -> Finding | None:
    """Find the longest stretch in which a moving channel stands still.

    Parameters
    ----------
    experiment : Experiment
        Recording to look at.
    channel : str
        Channel to look at.

    Returns
    -------
    Finding or None
        A warning if at least 20 samples in a row are equal and this is at least 20 times the
        median length of such runs, away from the extremes (see `find_clipping`).

    Raises
    ------
    InputError
        If the channel is missing.
    """
    values = _values(experiment, channel)
    if _is_constant(values):
        return None
    begin = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
    length = np.diff(begin, append=len(values))
    usual = float(np.median(length))
    inner = (values[begin] > values.min()) & (values[begin] < values.max())
    longest = int(np.argmax(np.where(inner, length, 0)))
    run = int(length[longest])
    if not inner[longest] or run < max(_STUCK_SAMPLES, _STUCK_RATIO * usual):
        return None
    first = int(begin[longest]) + 1
    return Finding(
        "warning",
        channel,
        f"{experiment.name}: channel {channel} stands still at {values[first - 1]:.6g} for {run} "
        f"samples (data rows {first} to {first + run - 1}); check the sensor or the link.",
    )


def find_clipping(experiment: Experiment, channel: str) -> Finding | None:
    """Find a channel cut off at its largest or smallest value.

    Parameters
    ----------
    experiment : Experiment
        Recording to look at.
    channel : str
        Channel to look at.

    Returns
    -------
    Finding or None
        A warning if at least 10 samples equal the extreme value, and 10 times as many as equal
        the value next to it. An extreme of zero is taken for rest, not for clipping.

    Raises
    ------
    InputError
        If the channel is missing.
    """
    values = _values(experiment, channel)
    if _is_constant(values):
        return None
    levels, counts = np.unique(values, return_counts=True)
    for word, at, beside in (("largest", -1, -2), ("smallest", 0, 1)):
        count = int(counts[at])
        enough = max(_CLIPPED_SAMPLES, _CLIPPED_RATIO * int(counts[beside]))
        if count >= enough and levels[at] != 0.0:
            return Finding(
                "warning",
                channel,
                f"{experiment.name}: channel {channel} equals its {word} value {levels[at]:.6g} in "
                f"{count} of {len(values)} samples, as if clipped; check the measuring range.",
            )
    return None


#: The checks `inspect` runs, in this order.
CHECKS: tuple[Check, ...] = (find_constant, find_stuck, find_clipping)


def _values(experiment: Experiment, channel: str) -> FloatArray:
    """Return one channel, refusing one that is missing."""
    return experiment.stack([channel])[:, 0]


def _is_constant(values: FloatArray) -> bool:
    """Return whether all values are equal but for rounding."""
    return bool(np.ptp(values) <= _CONSTANT * np.abs(values).max())
