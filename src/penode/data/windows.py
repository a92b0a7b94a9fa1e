"""Windows: a batch cut from recordings, each predicted from its measured start."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from penode.arrays import BoolArray, FloatArray, IntArray
from penode.data.experiment import Experiment
from penode.data.rates import steps_in, time_steps
from penode.data.stretches import check_lengths
from penode.errors import InputError

#: Windows that hold a sample at most, where they overlap so that there are more of them.
_DEEPEST = 4


class Placement(Protocol):
    """Where windows start within one recording."""

    def starts(self, first: int, last: int, horizon: int) -> IntArray:
        """Return starts (window,) in ascending order, all within ``first .. last``."""
        ...


@dataclass(frozen=True)
class Jittered:
    """One start drawn uniformly from each stratum of admissible starts, as long as the horizon.

    Regular starts sample a periodic disturbance at few phases, which biases parameters; these
    do not. The draw depends on the seed and the place of the recording only. Where no more than
    four windows hold a sample though more are wanted, the first and the last reach the ends of the
    recording: they are few, and jitter would leave up to a stratum at each end unused.

    Attributes
    ----------
    seed : int
        Seed of the draw, not negative.
    stride : int, optional
        Length of a stratum; the horizon if not given. A shorter one makes windows overlap, which
        keeps their number up where the horizon is long and the recording short.
    shortest : int
        Of a stratum as long as the horizon: short horizons then leave samples between windows.
    fewest : int
        Windows that are wanted of a recording: where the horizon leaves fewer, they overlap, until
        four of them hold a sample; more would add next to nothing.

    Raises
    ------
    InputError
        If the seed is negative, or the stride or the number of windows below 1.
    """

    seed: int = 0
    stride: int | None = None
    shortest: int = 1
    fewest: int = 1

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise InputError(f"seed must be >= 0, got {self.seed}.")
        if self.stride is not None and self.stride < 1:
            raise InputError(f"stride must be >= 1, got {self.stride}.")
        if self.fewest < 1:
            raise InputError(f"fewest must be >= 1 window, got {self.fewest}.")

    def starts(self, first: int, last: int, horizon: int) -> IntArray:
        """Place one window in each stratum; the last stratum may be shorter than the others."""
        room = last - first + 1
        apart = min(-(-horizon // _DEEPEST), room // _DEEPEST)
        widest = max(room // self.fewest, apart, 1)
        stratum = self.stride or min(max(horizon, self.shortest), widest)
        lower = np.arange(first, last + 1, stratum, dtype=np.int64)
        upper = np.minimum(lower + stratum, last + 1)
        # `first` sets the draws of recordings apart, the horizon those of a ladder's rungs.
        random = np.random.default_rng([self.seed, first, horizon])
        drawn = random.integers(lower, upper, dtype=np.int64)
        if stratum == apart:
            drawn[-1], drawn[0] = last, first
        return drawn


@dataclass(frozen=True)
class Contiguous:
    """Windows end to end: each starts where the one before it ends."""

    def starts(self, first: int, last: int, horizon: int) -> IntArray:
        """Place windows at ``first``, ``first + horizon``, ``first + 2 horizon``, ..."""
        return np.arange(first, last + 1, horizon, dtype=np.int64)


DEFAULT_PLACEMENT = Jittered(seed=0)


@dataclass(frozen=True, eq=False)
class Windows:
    """A batch of windows cut from recordings.

    With ``s = starts[w]``, ``P = past`` and ``H = horizon``, window ``w``

    - starts from the measured ``states[s - P + 1], ..., states[s]``,
    - uses ``inputs[s - P + 1], ..., inputs[s + H - 1]``,
    - predicts, and is compared with, ``states[s + 1], ..., states[s + H]``; of a model with
      outputs with ``outputs[s], ..., outputs[s + H]``,

    so that ``states[s + k]`` is the k-step-ahead target, k = 1 .. H. All of these lie within the
    one recording ``recording[w]``. Where recordings differ in their time step, H is of the shortest
    one; windows of another recording are as long in time, rounded to whole steps, one at least.

    Attributes
    ----------
    states : ndarray, shape (time, state)
        Measured states of all recordings, one after the other, in SI units; of states that are not
        measured, where the search for the windows' starts begins.
    inputs : ndarray, shape (time, input)
        Inputs beside them; ``inputs[k]`` acts from sample k to sample k + 1. Behind them may stand
        what a hold reads between samples (`penode.Predictor.prepared`).
    starts : ndarray of int64, shape (window,)
        Start of each window, an index into `states`; ascending.
    recording : ndarray of int64, shape (window,)
        Index of the recording each window is cut from.
    horizon : int
        Steps H predicted from each start, of the length `time_step`.
    past : int
        Measured samples P a prediction starts from, the start included.
    time_step : float
        Sampling interval in s, the shortest of all recordings.
    outputs : ndarray, shape (time, output)
        Measured outputs beside the states, of a model that declares them; without columns else.
    time_steps : ndarray, shape (recording,), or None
        Sampling interval of each recording in s; None where all have `time_step`.
    begins : ndarray of int64, shape (recording,), or None
        First sample of each recording, an index into `states`; None: there is one recording.
    """

    states: FloatArray
    inputs: FloatArray
    starts: IntArray
    recording: IntArray
    horizon: int
    past: int
    time_step: float
    outputs: FloatArray | None = None
    time_steps: FloatArray | None = None
    begins: IntArray | None = None

    def __post_init__(self) -> None:
        if self.begins is None:
            object.__setattr__(self, "begins", np.zeros(1))
        if self.outputs is None:
            object.__setattr__(self, "outputs", np.empty((len(self.states), 0)))
        for name in ("states", "inputs", "outputs", "starts", "recording", "begins"):
            kind = np.int64 if name in ("starts", "recording", "begins") else np.float64
            copy = np.array(getattr(self, name), dtype=kind, order="C")
            copy.setflags(write=False)
            object.__setattr__(self, name, copy)

    def __len__(self) -> int:
        return len(self.starts)

    @property
    def measured(self) -> FloatArray:
        """What predictions are compared with: the outputs, or the states, (time, quantity)."""
        outputs = np.asarray(self.outputs)
        return outputs if outputs.shape[1] else self.states

    @property
    def steps(self) -> IntArray:
        """Steps predicted from each start, (window,)."""
        if self.time_steps is None:
            return np.full(len(self), self.horizon)
        own = [steps_in(self.horizon, self.time_step, step) for step in self.time_steps]
        return np.array(own)[self.recording]

    @cached_property
    def by_time_step(self) -> "list[tuple[IntArray, Windows]]":
        """The windows of each time step, and their places among all, (window,).

        The horizon of each is in its own steps.
        """
        if self.time_steps is None:
            return [(np.arange(len(self)), self)]
        own, found = self.time_steps[self.recording], []
        for step in np.unique(own):
            steps = steps_in(self.horizon, self.time_step, float(step))
            alone = replace(self.among(own == step), horizon=steps, time_step=float(step))
            found.append((np.flatnonzero(own == step), replace(alone, time_steps=None)))
        return found

    def among(self, chosen: slice | BoolArray | IntArray) -> "Windows":
        """Return some of the windows of the same recordings."""
        return replace(self, starts=self.starts[chosen], recording=self.recording[chosen])


def cut(  # noqa: PLR0913 (three of them are rarely given)
    experiments: Sequence[Experiment],
    state_names: Sequence[str],
    input_names: Sequence[str],
    horizon: int,
    *,
    output_names: Sequence[str] = (),
    past: int = 1,
    placement: Placement = DEFAULT_PLACEMENT,
    prepared: Callable[[FloatArray], FloatArray] = np.asarray,
) -> Windows:
    """Cut recordings into windows; no window crosses from one recording into the next.

    Stretches of a recording that are too short for a window have none.

    Parameters
    ----------
    experiments : sequence of Experiment
        Recordings, of one time step or several.
    state_names, input_names : sequence of str
        Channels that are the states and the inputs, in the order of the columns wanted.
    horizon : int
        Steps H predicted from each start, at least 1, of the shortest time step (see `Windows`).
    output_names : sequence of str
        Channels that are the outputs, of a model that declares them.
    past : int, default 1
        Measured samples a prediction starts from, the start included, at least 1.
    placement : Placement, optional
        Where the windows start; ``Jittered(seed=0)`` if not given. `Contiguous` cuts them end
        to end.
    prepared : callable, optional
        `penode.Predictor.prepared`: takes the inputs of each recording, (time, input), and returns
        them with what a hold reads between samples; as they are if not given.

    Returns
    -------
    Windows
        The windows of the first recording, then those of the second, and so on, each in order of
        time; the index formula stands at `Windows`.

    Raises
    ------
    InputError
        If there is no recording, one is shorter than ``past + horizon`` samples (all stretches of
        it, where it has gaps), lacks a channel or holds a value that is not finite, or `horizon` or
        `past` is below 1.
    """
    for word, count in (("horizon", horizon), ("past", past)):
        if count < 1:
            raise InputError(f"{word} must be >= 1, got {count}.")
    if not experiments:
        raise InputError("there must be one recording at least to cut windows from.")
    starts, recording, offset = [], [], 0
    check_lengths(experiments, horizon, past)
    sampled = time_steps(experiments)
    fastest = float(sampled.min())
    for index, experiment in enumerate(experiments):
        own = steps_in(horizon, fastest, experiment.time_step)
        first, last = offset + past - 1, offset + len(experiment) - 1 - own
        none = np.empty(0, dtype=np.int64)
        placed = none if last < first else _placed(placement, first, last, own)
        starts.append(placed)
        recording.append(np.full(len(placed), index, dtype=np.int64))
        offset += len(experiment)
    return Windows(
        states=np.concatenate([_columns(each, state_names) for each in experiments]),
        inputs=np.concatenate([prepared(_columns(each, input_names)) for each in experiments]),
        starts=np.concatenate(starts),
        recording=np.concatenate(recording),
        horizon=horizon,
        past=past,
        time_step=fastest,
        outputs=np.concatenate([_columns(each, output_names) for each in experiments]),
        time_steps=sampled if np.ptp(sampled) else None,
        begins=np.cumsum([0, *map(len, experiments[:-1])]),
    )


def _placed(placement: Placement, first: int, last: int, horizon: int) -> IntArray:
    """Place the windows of one recording, and hold the placement to its promise."""
    starts = placement.starts(first, last, horizon)
    inside = starts.size and starts[0] >= first and starts[-1] <= last
    if not inside or (np.diff(starts) < 0).any():
        raise InputError(
            f"{placement}: starts must lie within {first} .. {last}, at least one, in ascending "
            "order."
        )
    return starts


def _columns(experiment: Experiment, names: Sequence[str]) -> FloatArray:
    """Return the named channels side by side (none at all is allowed), all finite."""
    if not names:
        return np.empty((len(experiment), 0))
    columns = experiment.stack(names)
    bad = np.argwhere(~np.isfinite(columns))
    if bad.size:
        row, column = bad[0]
        raise InputError(
            f"{experiment.name}: data row {row + 1}, channel {names[column]} is "
            f"{columns[row, column]} where a finite number was wanted; cut the recording before it."
        )
    return columns
