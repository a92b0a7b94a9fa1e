"""Stretches: a recording that is cut, by gaps in time, samples that cannot be used, or its length.

Each stretch is a recording like any other, that knows its place on the clock of the whole one. Of a
recording with far more samples than an answer needs an `excerpt` is used: stretches over its whole
length and all that its channels do there. The uncertainty of what is estimated from them is that of
what was used.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from penode.arrays import BoolArray, FloatArray, IntArray
from penode.data.experiment import Experiment
from penode.data.gathered import released
from penode.data.rates import steps_in, time_steps
from penode.data.time_axis import gaps_in
from penode.errors import InputError

#: Fewest samples that are worth a stretch.
SHORTEST = 200
#: Places that a sentence lists.
_LISTED = 3
#: Samples of a stretch, and the fewest where recordings are many.
STRETCH, _SHORTEST = 10_000, 2_000
#: Movement of a stretch, over that of those that move most, from which it is worth a look.
_LIVELY = 0.1
#: Movement of a channel, over its size, that is rounding.
_ROUNDING = 1e-12


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

    ``horizon`` is how many samples are predicted, of the recording with the shortest time step,
    ``past`` how many the first prediction starts from.
    """
    fastest = float(time_steps(experiments).min())
    for stretches in by_recording(experiments):
        longest = max(stretches, key=len)
        own = steps_in(horizon, fastest, longest.time_step)
        if len(longest) < past + own:
            raise InputError(
                f"{longest.name}: horizon {own} with {past} past samples needs at least "
                f"{past + own} samples, got {len(longest)}; shorten the horizon or record for "
                "longer."
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


def between_gaps(
    whole: Experiment, times: FloatArray, spans: Sequence[tuple[int, int]], shortest: int
) -> tuple[Experiment, ...]:
    """Return what lies between the gaps of times (time,) in s, each a recording of its own.

    Spans are as `penode.data.time_axis.uniform_stretches` gives them of a shortest one; without
    gaps the whole comes back.
    """
    if len(spans) == 1 and spans[0] == (0, len(whole)):
        return (whole,)
    sentence, duration = _of_gaps(whole, times, spans, shortest), float(np.ptp(times))
    found = []
    for first, last in spans:
        one = whole.between(first, last, sentence)
        place = replace(one.place, start=float(times[first]), duration=duration)
        found.append(replace(one, stretch=place))
    return tuple(found)


def _of_gaps(
    whole: Experiment, times: FloatArray, spans: Sequence[tuple[int, int]], shortest: int
) -> str:
    """Say where the gaps are, how long, and what is left out between them."""
    gaps = gaps_in(times)
    lengths = times[gaps + 1] - times[gaps] - whole.time_step
    ends = (f"{lengths.min():.3g}", f"{lengths.max():.3g}")
    long = " to ".join(dict.fromkeys(ends)) + " s"
    count = "a gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
    read = "one stretch" if len(spans) == 1 else f"{len(spans)} stretches"
    sentence = (
        f"{whole.name}: {count} of {long} in time, after {listed((gaps + 1).tolist())}: read as "
        f"{read}, and nothing is predicted across a gap."
    )
    left = len(times) - sum(b - a for a, b in spans)
    few = f"{left} samples that are fewer than {shortest} in a row are"
    alone = "A sample that stands alone is"
    return f"{sentence} {few if left > 1 else alone} left out." if left else sentence


def listed(places: Sequence[int], word: str = "data row") -> str:
    """Return a few numbers as words, such as ``data rows 5, 80, 300 and 12 more``."""
    shown = ", ".join(str(place) for place in places[:_LISTED])
    more = f" and {len(places) - _LISTED} more" if len(places) > _LISTED else ""
    return f"{word}{'s' if len(places) > 1 else ''} {shown}{more}"


# --- excerpts -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Excerpt:
    """Recordings that are used whole, and stretches of the others in order of time.

    The sentence says what was used of how much; it is empty where all is used.
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
            f"samples must be at least {_SHORTEST * len(recordings)} for {len(recordings)} "
            f"recordings, {_SHORTEST} of each, got {samples}."
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
    counts = f"Of {whole:,} samples {used:,} were used".replace(",", "\N{NO-BREAK SPACE}")
    sentence = f"{counts}, in {spread}; the intervals are those of what was used."
    return Excerpt(tuple(parts), sentence)


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
