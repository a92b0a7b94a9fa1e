"""Stretches: a recording that is cut, by gaps in time or by samples that cannot be used.

Each stretch is a recording like any other, that knows its place on the clock of the whole one.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from penode.arrays import BoolArray, IntArray
from penode.data.experiment import Experiment
from penode.errors import InputError

#: Fewest samples that are worth a stretch.
SHORTEST = 200
#: Places that a sentence lists.
_LISTED = 3


def recording_numbers(experiments: Sequence[Experiment]) -> IntArray:
    """Return which recording each of several is or belongs to, (experiment,), counted from 0."""
    known: dict[object, int] = {}
    keys = [
        (e.stretch.recording, e.source) if e.stretch is not None else k
        for k, e in enumerate(experiments)
    ]
    return np.array([known.setdefault(key, len(known)) for key in keys], dtype=np.int64)


def by_recording(experiments: Sequence[Experiment]) -> list[list[Experiment]]:
    """Return experiments, those of one recording together; see `recording_numbers`."""
    groups: dict[int, list[Experiment]] = {}
    for number, experiment in zip(recording_numbers(experiments), experiments, strict=True):
        groups.setdefault(int(number), []).append(experiment)
    return list(groups.values())


def fewest_windows(experiments: Sequence[Experiment], horizon: int) -> int:
    """Return how many windows fit into the shortest recording, its stretches together."""
    return min(sum(len(e) // horizon for e in each) for each in by_recording(experiments))


def check_lengths(experiments: Sequence[Experiment], horizon: int, past: int) -> None:
    """Refuse a recording too short for one window, in all of its stretches.

    ``horizon`` is how many samples are predicted, ``past`` how many the first prediction starts
    from.
    """
    for stretches in by_recording(experiments):
        longest = max(stretches, key=len)
        if len(longest) < past + horizon:
            raise InputError(
                f"{longest.name}: {len(longest)} samples came where horizon {horizon} with "
                f"{past} past samples needs at least {past + horizon}; "
                "shorten the horizon or record for longer."
            )


def reasons_of(experiments: Sequence[Experiment]) -> tuple[str, ...]:
    """Return why recordings were cut, each sentence once."""
    return tuple(dict.fromkeys(reason for e in experiments for reason in e.place.reasons))


def with_reason(experiment: Experiment, reason: str) -> Experiment:
    """Return a recording or stretch with one more sentence on what was left out beside it."""
    whole = experiment.place
    return replace(experiment, stretch=replace(whole, reasons=(*whole.reasons, reason)))


def spans_of(
    stretches: Sequence[Experiment], usable: Sequence[BoolArray]
) -> list[tuple[Experiment, int, int]]:
    """Return the runs of usable samples worth a stretch: of which, first, last plus one."""
    spans = []
    for stretch, own in zip(stretches, usable, strict=True):
        edges = np.flatnonzero(np.diff(own.astype(np.int8), prepend=0, append=0))
        runs = edges.reshape(-1, 2).tolist()
        spans += [(stretch, a, b) for a, b in runs if b - a >= SHORTEST]
    return spans


def listed(places: Sequence[int], word: str = "data row") -> str:
    """Return a few numbers as words, such as ``data rows 5, 80, 300 and 12 more``."""
    shown = ", ".join(str(place) for place in places[:_LISTED])
    more = f" and {len(places) - _LISTED} more" if len(places) > _LISTED else ""
    return f"{word}{'s' if len(places) > 1 else ''} {shown}{more}"
