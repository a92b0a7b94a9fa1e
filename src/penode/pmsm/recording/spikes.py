"""Spikes: lone samples that no drive can make, left out of a recording.

An inductance keeps a current from moving there and back within two samples, and an inertia a speed,
so a sample far outside the two beside it is an error of the sensor or the link. One of them is
enough to spoil a result.
"""

from collections.abc import Collection, Iterator, Sequence
from typing import TypeAlias

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.data.gathered import PIECE, released
from penode.data.stretches import SHORTEST, listed, spans_of
from penode.pmsm.recording.stationary_frame import LINK

#: Most spikes of a channel: where there are more of a kind, they belong to the drive.
_MOST = 20
#: How far a spike lies outside its neighbours, over the same of any sample but the `_MOST` first.
_APART = 20.0
#: The same over the range that the other samples cover, zero included, of currents, speeds and
#: voltages. A controller may ask for a lone peak of voltage when its reference steps.
_BEYOND = {"i": 0.2, "omega": 1.0, "u": 100.0}

#: Which stretch, and which of its samples.
_Place: TypeAlias = tuple[int, int]


def without_spikes(stretches: Sequence[Experiment]) -> Sequence[Experiment]:
    """Return a recording without the spikes of its currents, speed and voltages.

    The stretches come back as they came where there are none, or nothing long enough is left; else
    what lies between them, with a sentence on where they are.
    """
    found = {where: name for kind in _BEYOND for where, name in _spikes(stretches, kind).items()}
    if not found:
        return stretches
    usable = [np.ones(len(e), dtype=np.bool_) for e in stretches]
    for stretch, sample in found:
        usable[stretch][sample] = False
    spans = spans_of(stretches, usable)
    if not spans:
        return stretches
    sentence = _sentence(stretches, found, sum(last - first for _, first, last in spans))
    return [e.between(first, last, sentence) for e, first, last in spans]


def _spikes(stretches: Sequence[Experiment], kind: str) -> dict[_Place, str]:
    """Return where channels of a kind have spikes, and which of them."""
    names = [n for n in stretches[0].channels if n.split("_")[0] == kind and n != LINK]
    peaks = {name: _peaks([e.channels[name] for e in stretches]) for name in names}
    lone = {
        (where, name): height
        for name, tops in peaks.items()
        for height, where in tops[:_MOST]
        if height > _APART * (tops[_MOST][0] if len(tops) > _MOST else 0.0)
    }
    if not lone:
        return {}
    out = {name: [where for where, of in lone if of == name] for name in names}
    reach = max(_range([e.channels[name] for e in stretches], out[name]) for name in names)
    return {where: name for (where, name), height in lone.items() if height > _BEYOND[kind] * reach}


def _sentence(stretches: Sequence[Experiment], found: dict[_Place, str], used: int) -> str:
    rows = sorted(stretches[k].place.row + sample + 1 for k, sample in found)
    names = sorted(set(found.values()))
    left = sum(map(len, stretches)) - used - len(rows)
    beside = f", with {left} beside that are fewer than {SHORTEST} in a row" if left else ""
    return (
        f"{stretches[0].place.recording}: {', '.join(names)} "
        f"{'jumps' if len(names) == 1 else 'jump'} there and back within two samples, which no "
        f"drive does, at {listed(rows)}. "
        f"{'This sample is' if len(rows) == 1 else 'These samples are'} left out{beside}."
    )


def _peaks(parts: Sequence[FloatArray]) -> list[tuple[float, _Place]]:
    """Return how far samples lie outside the two beside them, and which: the largest first."""
    tops: list[tuple[float, _Place]] = []
    for number, values in enumerate(parts):
        for first, piece in _overlapping(values):
            before, at, after = piece[:-2], piece[1:-1], piece[2:]
            above, below = at - np.maximum(before, after), np.minimum(before, after) - at
            height = np.maximum(above, below)
            largest = np.argpartition(-height, min(_MOST, len(height) - 1))[: _MOST + 1]
            tops += [(float(height[k]), (number, first + int(k) + 1)) for k in largest]
        tops = sorted(tops, key=lambda top: (-top[0], top[1]))[: _MOST + 1]
    return [top for top in tops if top[0] > 0.0]


def _range(parts: Sequence[FloatArray], lone: Collection[_Place]) -> float:
    """Return the range that zero and a channel without its lone peaks cover."""
    low, high = 0.0, 0.0
    for number, values in enumerate(parts):
        for first, piece in _overlapping(values):
            inside = [at - first for k, at in lone if k == number and 0 <= at - first < len(piece)]
            rest = np.delete(piece, inside)
            low, high = min(low, float(rest.min())), max(high, float(rest.max()))
    return high - low


def _overlapping(values: FloatArray) -> Iterator[tuple[int, FloatArray]]:
    """Yield pieces that share two samples with the next, and where each begins."""
    for first in range(0, len(values) - 2, PIECE - 2):
        yield first, np.asarray(values[first : first + PIECE])
        released(values)
