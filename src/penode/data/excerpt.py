"""Excerpt: stretches of recordings that hold far more samples than an answer needs.

A recording of a day is used by stretches of it, each of which is a recording like any other. They
are spread over its whole length and over all that its channels do there, and the uncertainty of
what is estimated from them is that of what was used.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from penode.arrays import BoolArray, FloatArray, IntArray
from penode.data.experiment import Experiment
from penode.data.gathered import released
from penode.data.stretches import by_recording
from penode.errors import InputError

#: Samples of a stretch, and the fewest where recordings are many.
STRETCH, _SHORTEST = 10_000, 2_000
#: Movement of a stretch, over that of those that move most, from which it is worth a look.
_LIVELY = 0.1
#: Movement of a channel, over its size, that is rounding.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Excerpt:
    """What is used of recordings.

    Attributes
    ----------
    experiments : tuple of Experiment
        Recordings that are used whole, and stretches of the others in order of time.
    sentence : str
        What was used and what there is; empty where all is used.
    """

    experiments: tuple[Experiment, ...]
    sentence: str = ""


def excerpt(
    experiments: Sequence[Experiment],
    moving: Collection[str],
    samples: int,
    *,
    seed: int = 0,
    length: int = STRETCH,
) -> Excerpt:
    """Return recordings as they are, or stretches of them where there are more samples than wanted.

    Half of the stretches of a recording are drawn one from each part of its length; the other half
    are those that differ most from all before: in the mean, the range and the power of each moving
    channel. Stretches in which next to nothing moves are left aside.

    Parameters
    ----------
    experiments : sequence of Experiment
    moving : collection of str
        Channels that have to move and that are to be covered, where they are recorded.
    samples : int
        Most samples wanted of all recordings together.
    seed : int
        Of the draw, not negative.
    length : int
        Samples of a stretch; fewer where there are many recordings.

    Returns
    -------
    Excerpt

    Raises
    ------
    InputError
        If fewer samples are wanted than make one stretch of each recording, or a recording has none
        of the channels.
    """
    whole = sum(map(len, experiments))
    if whole <= samples:
        return Excerpt(tuple(experiments))
    recordings = by_recording(experiments)
    length = min(length, samples // len(recordings))
    if length < _SHORTEST:
        raise InputError(
            f"samples {samples} came for {len(recordings)} recordings; ask for "
            f"{_SHORTEST * len(recordings)} at least, {_SHORTEST} of each."
        )
    parts: list[Experiment] = []
    for number, recording in enumerate(recordings):
        wanted = samples / whole * sum(map(len, recording))
        parts += _drawn(recording, moving, (wanted, length), np.random.default_rng([seed, number]))
    used = sum(map(len, parts))
    if used == whole:
        return Excerpt(tuple(parts))
    spread = "one stretch"
    if len(parts) > 1:
        spread = f"{len(parts)} stretches over the whole length and all that the channels do there"
    sentence = (
        f"Of {_grouped(whole)} samples {_grouped(used)} were used, in {spread}; the intervals are "
        "those of what was used."
    )
    return Excerpt(tuple(parts), sentence)


def _grouped(number: int) -> str:
    return f"{number:,}".replace(",", "\N{NO-BREAK SPACE}")


def _drawn(
    recording: Sequence[Experiment],
    moving: Collection[str],
    wanted: tuple[float, int],
    random: np.random.Generator,
) -> list[Experiment]:
    """Return stretches of one recording, or the whole where they would be most of it.

    Wanted are so many samples, in stretches of a length; what is shorter already stays as it is.
    """
    samples, length = wanted
    blocks = [max(len(e) // length, 1) for e in recording]
    each = [min(len(e), length) for e in recording]
    mean = sum(n * k for n, k in zip(each, blocks, strict=True)) / sum(blocks)
    count = max(int(samples / mean), 1)
    if sum(blocks) <= count:
        return list(recording)
    parts: list[tuple[Experiment, int, int]] = []
    traits, movement = [], []
    for e, own, number in zip(recording, each, blocks, strict=True):
        first = int(random.integers(len(e) - number * own + 1))
        parts += [(e, at, at + own) for at in range(first, first + number * own, own)]
        names = [name for name in e.channels if name in moving]
        e.require(names or tuple(moving))
        stretch = _traits(e, names, slice(first, first + number * own), number)
        traits.append(stretch[0])
        movement.append(stretch[1])
    spanned = np.concatenate(traits)
    spanned /= np.maximum(np.ptp(spanned[:, :, :2], axis=(0, 2)), 1e-300)[:, None]
    lively = np.flatnonzero(_is_lively(np.concatenate(movement), count))
    drawn = [int(random.choice(part)) for part in np.array_split(lively, -(-count // 2))]
    chosen = _with_furthest(spanned.reshape(len(parts), -1), lively, drawn, count)
    return [
        e if last - first == len(e) else e.part(first, last)
        for e, first, last in (parts[k] for k in chosen)
    ]


def _traits(
    experiment: Experiment, names: Sequence[str], rows: slice, blocks: int
) -> tuple[FloatArray, FloatArray]:
    """Return traits of channels in each block, (block, channel, 4), and their ranges.

    The traits are the smallest and largest value, mean and root mean square; ranges are (block,
    channel), 0 where they are rounding.
    """
    traits, movement = np.zeros((blocks, len(names), 4)), np.zeros((blocks, len(names)))
    for k, name in enumerate(names):
        values = experiment.channels[name][rows].reshape(blocks, -1)
        low, high = values.min(axis=1), values.max(axis=1)
        power = np.einsum("bt,bt->b", values, values) / values.shape[1]
        traits[:, k] = np.stack([low, high, values.mean(axis=1), np.sqrt(power)], axis=1)
        released(experiment.channels[name])
        largest = np.abs(traits[:, k]).max()
        movement[:, k] = np.where(high - low > _ROUNDING * largest, high - low, 0.0)
    return traits, movement


def _is_lively(movement: FloatArray, count: int) -> BoolArray:
    """Return in which blocks (block,) every channel moves, and all together as much as elsewhere.

    Elsewhere: where each moves most, but for so few blocks that they may be outliers.
    """
    usual = np.sort(movement, axis=0)[-min(count + 1, len(movement))]
    share = np.mean(movement / np.maximum(usual, 1e-300), axis=1)
    moving = ((movement > 0.0) | (usual == 0.0)).all(axis=1)  # one that never moves says nothing
    lively = moving & (share >= _LIVELY)
    enough = [kept for kept in (lively, moving) if kept.sum() >= count]
    return np.asarray([*enough, np.ones(len(movement), dtype=bool)][0])


def _with_furthest(
    traits: FloatArray, lively: IntArray, chosen: Sequence[int], count: int
) -> list[int]:
    """Return `count` blocks in order: those chosen, and one by one the furthest from them all."""
    chosen = list(chosen)
    gap = np.full(len(lively), np.inf)
    for block in chosen:
        gap = np.minimum(gap, np.linalg.norm(traits[lively] - traits[block], axis=1))
    while len(chosen) < count:
        block = int(lively[np.argmax(gap)])
        chosen.append(block)
        gap = np.minimum(gap, np.linalg.norm(traits[lively] - traits[block], axis=1))
        gap[np.isin(lively, chosen)] = -1.0
    return sorted(chosen)
