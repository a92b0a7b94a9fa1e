"""What was measured against the model's one-step and free-run predictions."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from penode.arrays import (
    FloatArray,
    JaxArray,
    float64,
    on_device,
    shared_length,
    with_shared_length,
)
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.models.base import Model
from penode.models.explicit_time import driving_channels
from penode.models.inputs import Inputs
from penode.models.measured import (
    dynamic_states,
    free_states,
    hidden_states,
    measured_units,
    predicted_outputs,
)
from penode.models.parameters import with_batch_axis
from penode.predictors.base import Predictor
from penode.predictors.delays import Recorded, as_acting, delayed
from penode.predictors.rollout import rollout
from penode.validation.comparison import Comparison

#: What stands for an error or a slope of a free run that diverged.
_DIVERGED = 1e100
#: Samples by which the start of a free run is estimated first; then by four times as many.
_BEGINNING = 32


def with_unmeasured(experiment: Experiment, model: Model) -> Experiment:
    """Return the recording with a channel of zeros for each hidden state that has no guess."""
    absent = [name for name in hidden_states(model) if name not in experiment.channels]
    blank = {name: np.zeros(len(experiment)) for name in absent}
    return replace(experiment, channels={**experiment.channels, **blank}) if absent else experiment


def require_predictable(predictor: Predictor, model: Model, experiment: Experiment) -> None:
    """Refuse a recording that the model cannot predict.

    A channel is missing or not finite, or the time step is not the predictor's.
    """
    for name, values in experiment.channels.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad) and name in (*model.states, *model.outputs, *model.inputs):
            raise InputError(
                f"{experiment.name}: data row {bad[0] + 1}, channel {name} is {values[bad[0]]} "
                "where a number was wanted; cut the recording there."
            )
    needed = (*model.states, *model.outputs, *model.inputs)
    with_unmeasured(experiment, model).stack(tuple(dict.fromkeys(needed)))
    if not np.isclose(experiment.time_step, predictor.time_step, rtol=1e-4, atol=0):
        raise InputError(
            f"{experiment.name}: time step must be {predictor.time_step:.6g} s, as trained, got "
            f"{experiment.time_step:.6g} s; record or resample at that step."
        )


def compare(
    predictor: Predictor,
    model: Model,
    experiment: Experiment,
    role: str = "validation",
    free: Sequence[str] | None = None,
    begin: FloatArray | None = None,
) -> Comparison:
    """Predict one recording step by step and in free run.

    Parameters
    ----------
    predictor : Predictor
    model : Model
        Trained, without batch axis.
    experiment : Experiment
        Has the model's measured states, or its outputs, and its inputs as channels.
    role : str
        ``"train"`` or ``"validation"``.
    free : sequence of str, optional
        States whose initial value the free run estimates, by least squares over the whole
        recording (NOE with estimated initial state); by default the model's unmeasured ones, and
        all of a model with outputs.
    begin : ndarray, shape (state,), optional
        Where that estimation begins, such as a similar model's `Comparison.start`; by default at
        what was recorded, and the first samples lead on to the whole recording.

    Raises
    ------
    InputError
        If a channel is missing, or the time step is not the predictor's.
    """
    require_predictable(predictor, model, experiment)
    guessed = all(name in experiment.channels for name in hidden_states(model))
    experiment, units = with_unmeasured(experiment, model), measured_units(model)
    freed = [model.states.index(name) for name in (free_states(model) if free is None else free)]
    driving = driving_channels(model)
    with float64():
        read, inputs = (experiment.stack(names).T for names in (model.states, driving))
        batched = with_batch_axis(model)
        corrected = batched.corrected(with_shared_length(read))
        states = np.asarray(corrected)[:, : len(experiment)]
        ahead = look_ahead(predictor, batched, states, inputs, 1)
        start = on_device(states[:, : predictor.past].T[::-1].copy())
        measured = _measured(batched, experiment, states)
        padded = with_shared_length(predictor.prepared(inputs.T).T)
        if freed:
            start = _estimated_start(predictor, batched, (start, measured, padded), freed, begin)
        samples = len(experiment) - predictor.past
        run = np.asarray(run_freely(predictor, batched, start, padded, samples))[:, :samples]
        if batched.covariances:
            guessed, given = True, with_shared_length(measured)
            ahead = np.asarray(run_freely(predictor, batched, start, padded, samples, given))
            ahead = ahead[:, :samples]
        first = np.asarray(start)[::-1].T
        one_step, free_run = (
            _predicted(predictor, batched, np.concatenate([first, after], axis=1), inputs)
            for after in (ahead if guessed else ahead * np.nan, run)
        )
    return Comparison(
        name=experiment.name,
        role=role,
        time_step=experiment.time_step,
        states=tuple(units),
        units=tuple(units.values()),
        measured=measured.T,
        one_step=one_step.T,
        free_run=free_run.T,
        recording="" if experiment.stretch is None else experiment.stretch.recording,
        start=np.asarray(start)[0],
    )


def free_run_errors(
    predictor: Predictor,
    fits: Sequence[Sequence[Model]],
    experiments: Sequence[Experiment],
    free: Sequence[str] | None = None,
) -> FloatArray:
    """Return the free-run RMSE, (fit, quantity), over all recordings in SI units.

    Each fit has a model of every recording, of one structure; infinite where a free run diverged.
    A recording is predicted at its own time step. States whose start is estimated are as in
    `compare`.
    """
    squares, count = np.zeros((len(fits), len(measured_units(fits[0][0])))), 0
    for models, experiment in zip(zip(*fits, strict=True), experiments, strict=True):
        at = predictor.at(experiment.time_step)
        squares += _free_run_squares(at, models, experiment, free)
        count += len(experiment) - predictor.past
    with np.errstate(invalid="ignore"):
        rms = np.sqrt(squares / count)
    return np.asarray(np.where(np.isfinite(rms), rms, np.inf))


def _measured(model: Model, experiment: Experiment, states: FloatArray) -> FloatArray:
    """Return what was measured, (quantity, time): outputs, or rows of the corrected states."""
    if model.outputs:
        return experiment.stack(tuple(model.outputs)).T
    return states[[model.states.index(name) for name in measured_units(model)]]


def _predicted(
    predictor: Predictor, model: Model, states: FloatArray, inputs: FloatArray
) -> FloatArray:
    """Return what sensors read at states (state, time) and inputs (input, time)."""
    padded = with_shared_length(states), with_shared_length(inputs)
    return np.asarray(_outputs(model, *padded, predictor.time_step))[:, : states.shape[1]]


@jax.jit
def _outputs(model: Model, states: JaxArray, inputs: JaxArray, time_step: float) -> JaxArray:
    acting = as_acting(model, inputs, time_step)
    return predicted_outputs(model, states, Inputs(acting, driving_channels(model)))


def _free_run_squares(
    predictor: Predictor,
    models: Sequence[Model],
    experiment: Experiment,
    free: Sequence[str] | None,
) -> FloatArray:
    """Return the sums of squared free-run errors of each model on a recording, (model, row)."""
    if free or free_states(models[0]):  # each estimates its own start, from the last one's
        own = partial(compare, predictor, experiment=experiment, free=free)
        last = own(models[-1])
        begin = None if last.diverged else last.start
        others = [own(model, begin=begin) for model in models[:-1]]
        gaps = [(run.measured - run.free_run)[predictor.past :] for run in (*others, last)]
        with np.errstate(over="ignore"):
            return np.asarray(np.sum(np.square(gaps), axis=1))
    with float64():
        names = (models[0].states, driving_channels(models[0]))
        experiment = with_unmeasured(experiment, models[0])
        states, inputs = (experiment.stack(channels) for channels in names)
        recorded = [with_shared_length(a.T) for a in (states, predictor.prepared(inputs))]
        together: Model = jax.tree.map(lambda *leaves: np.stack(leaves, axis=-1), *models)
        samples = len(experiment) - predictor.past
        squares = np.asarray(_squares(predictor, together, *recorded, samples))
        return squares[:, : len(dynamic_states(models[0]))]


@partial(jax.jit, static_argnums=0)
def _squares(
    predictor: Predictor, models: Model, measured: JaxArray, inputs: JaxArray, samples: JaxArray
) -> JaxArray:
    """Let models with a batch axis run side by side from the first samples of (state, time)."""
    batch, past = jax.tree.leaves(models)[0].shape[-1], predictor.past

    def at(record: JaxArray, k: JaxArray) -> JaxArray:
        column = jax.lax.dynamic_slice_in_dim(record, k, 1, axis=1)
        return jnp.broadcast_to(column, (len(record), batch))

    def step(k: JaxArray, history: JaxArray) -> tuple[JaxArray, None]:
        now = jnp.full(batch, k + past - 1)
        return predictor.step(models, history, Recorded(inputs, now)), None

    def visit(k: JaxArray, history: JaxArray, _: None, total: JaxArray) -> JaxArray:
        gap = models.corrected(at(measured, k + past)) - history[0]
        return total + gap**2

    first = [models.corrected(at(measured, jnp.asarray(past - 1 - j))) for j in range(past)]
    nothing = jnp.zeros((len(measured), batch), measured.dtype)
    return rollout(step, jnp.stack(first), samples, visit, nothing).T


def look_ahead(
    predictor: Predictor,
    model: Model,
    states: JaxArray | FloatArray,
    inputs: JaxArray | FloatArray,
    steps: int,
    stride: int = 1,
) -> FloatArray:
    """Predict every sample from the measured ones `steps` before it (paper, k-step-ahead).

    States (state, time) and inputs (input, time); the model has a batch axis of length 1; steps is
    known at run time only. Every ``stride`` samples give (state, ceil((time - past) / stride)), for
    samples past .. time - 1, of which the first k - 1 start from fewer steps before.
    """
    count = len(range(predictor.past, states.shape[1], stride))
    recorded = [with_shared_length(a) for a in (states, predictor.prepared(np.asarray(inputs).T).T)]
    ahead = _ahead(predictor, model, *recorded, steps, stride)
    return np.asarray(ahead)[:, :count]


@partial(jax.jit, static_argnums=(0, 5))
def _ahead(
    predictor: Predictor,
    model: Model,
    states: JaxArray,
    inputs: JaxArray,
    steps: JaxArray,
    stride: int,
) -> JaxArray:
    """Predict every so many samples of padded rows; see `look_ahead`."""
    past, last = predictor.past, states.shape[1] - 1
    target = jnp.arange(past, last + 1, stride)
    origin = jnp.maximum(target - steps, past - 1)
    start = jnp.stack([states[:, origin - j] for j in range(past)])

    def step(k: JaxArray, history: JaxArray) -> tuple[JaxArray, None]:
        at = origin + k
        ahead = predictor.step(model, history, Recorded(inputs, at))
        return jnp.where(at < target, ahead, history), None

    def visit(k: JaxArray, history: JaxArray, _: None, path: JaxArray) -> JaxArray:
        return history[0]

    return rollout(step, start, steps, visit, start[0])


def look_far_ahead(
    predictor: Predictor,
    model: Model,
    states: FloatArray,
    inputs: FloatArray,
    least: int,
) -> FloatArray:
    """Predict every sample from measured ones more than `least` steps before it, twice at most.

    As `look_ahead` does, states (state, time) and inputs (input, time) to (state, time - past), but
    in twice as many steps as there are samples, however far it looks. The first `least` samples
    start from the first one.
    """
    samples = states.shape[1]
    windows = shared_length(-(-(samples - predictor.past) // least))
    first = on_device(predictor.past - 1 + least * np.arange(windows))
    recorded = [with_shared_length(a) for a in (states, predictor.prepared(np.asarray(inputs).T).T)]
    ahead = _far_ahead(predictor, model, *recorded, first, least)
    return np.asarray(ahead)[:, predictor.past : samples]


@partial(jax.jit, static_argnums=0)
def _far_ahead(
    predictor: Predictor,
    model: Model,
    states: JaxArray,
    inputs: JaxArray,
    first: JaxArray,
    least: JaxArray,
) -> JaxArray:
    """Let windows of padded rows run side by side, and keep the second half of each."""
    last = states.shape[1] - 1
    at = jnp.minimum(first, last)
    start = jnp.stack([states[:, at - j] for j in range(predictor.past)])

    def step(k: JaxArray, history: JaxArray) -> tuple[JaxArray, None]:
        return predictor.step(model, history, Recorded(inputs, jnp.minimum(first + k, last))), None

    def visit(k: JaxArray, history: JaxArray, _: None, path: JaxArray) -> JaxArray:
        kept = (k >= least) | (jnp.arange(len(first)) == 0)
        place = jnp.where(kept, first + k + 1, last + 1)
        return path.at[:, place].set(history[0], mode="drop")

    return rollout(step, start, 2 * least, visit, states)


@partial(jax.jit, static_argnums=0)
def run_freely(
    predictor: Predictor,
    model: Model,
    start: JaxArray,
    inputs: JaxArray,
    samples: JaxArray,
    measured: JaxArray | None = None,
) -> JaxArray:
    """Predict as many samples from the states (past, state) before them; zeros after (state, N).

    Where what was measured (quantity, time) is given, it moves the state as the model's filter says
    before each step: predictions are one step ahead.
    """
    last = predictor.past - 1
    names = driving_channels(model)

    def column(record: JaxArray, k: JaxArray | int) -> JaxArray:
        return jax.lax.dynamic_slice_in_dim(record, k, 1, axis=1)

    def step(k: JaxArray, history: JaxArray) -> tuple[JaxArray, None]:
        drive = Recorded(inputs, (k + last)[None])
        if measured is not None:
            acting = delayed(model, drive, predictor.time_step)(0)
            now = Inputs(acting[: len(names)], names)
            history = model.filtered(history[0], column(measured, k), now)[None]
        return predictor.step(model, history, drive), None

    def visit(k: JaxArray, history: JaxArray, _: None, path: JaxArray) -> JaxArray:
        return jax.lax.dynamic_update_slice_in_dim(path, history[0], k, axis=1)

    blank = jnp.zeros((start.shape[1], inputs.shape[1]), start.dtype)
    return rollout(step, start[..., None], samples, visit, blank)


def _estimated_start(
    predictor: Predictor,
    model: Model,
    recording: tuple[JaxArray, FloatArray, JaxArray],
    freed: list[int],
    guess: FloatArray | None,
) -> JaxArray:
    """Return the first state (1, state), its free rows fitted to what was measured of the run."""
    start, measured, inputs = recording
    # The first sample of states that are measured as they are says nothing of the others.
    begin = 0 if model.outputs else 1
    if predictor.past > 1:
        raise InputError(
            f"the first state is to be estimated, but {predictor.solver} starts from "
            f"{predictor.past} samples; choose a one-step solver."
        )

    first, ahead = on_device(np.asarray(start)[0]), measured.shape[1] - 1
    scale = scale_of_errors(model, measured)[:, None]
    free = np.asarray(first if guess is None else guess)[freed]
    # A long run of a nonlinear model has several minima; its beginning leads to the right one.
    shorter = () if guess is not None else (_BEGINNING * 4**k for k in range(20))
    for length in (*(n for n in shorter if n < ahead / 4), ahead):
        fixed = predictor, tuple(freed), model, first, (inputs, jnp.asarray(length))
        part = slice(begin, length + 1)

        @lru_cache(maxsize=1)
        def run(free: bytes, fixed: Any = fixed) -> list[FloatArray]:
            return [np.asarray(one) for one in _run_with_slope(np.frombuffer(free), *fixed)]

        def residual(free: FloatArray, part: slice = part, run: Any = run) -> FloatArray:
            gap = run(free.tobytes())[1][:, part] - measured[:, part]
            return _bounded((gap / scale).ravel())

        def slope(free: FloatArray, part: slice = part, run: Any = run) -> FloatArray:
            slopes = run(free.tobytes())[0][:, part] / scale[..., None]
            return _bounded(slopes.reshape(-1, len(freed)))

        with np.errstate(all="ignore"):  # of a run that diverges from every start
            method = "lm" if length * len(measured) >= len(freed) else "trf"
            options = {"jac": slope, "x_scale": "jac", "max_nfev": 50}
            free = least_squares(residual, free, method=method, **options).x
    found = np.array(start)
    found[:, freed] = free
    return on_device(found)


def scale_of_errors(model: Model, measured: FloatArray) -> FloatArray:
    """Return what a free run's errors are divided by, (quantity,): deviations where units differ.

    What was measured is (quantity, time).
    """
    if len(set(measured_units(model).values())) == 1:
        return np.ones(len(measured))
    return np.maximum(measured.std(axis=1), 1e-300)


def _bounded(values: FloatArray) -> FloatArray:
    """Return values of a run that may diverge as numbers whose squares can be summed."""
    return np.clip(np.nan_to_num(values, nan=_DIVERGED), -_DIVERGED, _DIVERGED)


def _from_free(
    free: JaxArray,
    predictor: Predictor,
    freed: tuple[int, ...],
    model: Model,
    first: JaxArray,
    drive: tuple[JaxArray, JaxArray],
) -> JaxArray:
    """Return what sensors read of the run of inputs and samples (`drive`) from a state.

    Its free rows are given; the first column is the state's own.
    """
    start = first.at[np.array(freed)].set(free)[None]
    run = run_freely(predictor, model, start, *drive)
    path = jnp.concatenate([start.T, run[:, :-1]], axis=1)
    names = driving_channels(model)
    acting = as_acting(model, drive[0][: len(names)], predictor.time_step)
    return predicted_outputs(model, path, Inputs(acting, names))


@partial(jax.jit, static_argnums=(1, 2))
def _run_with_slope(free: JaxArray, *fixed: Any) -> tuple[JaxArray, JaxArray]:
    """Return the slope of `_from_free` by the free rows, and what it returns.

    Compiled once for all recordings of about a length, all values of parameters and all starts.
    """

    def twice(free: JaxArray) -> tuple[JaxArray, JaxArray]:
        run = _from_free(free, *fixed)
        return run, run

    return jax.jacfwd(twice, has_aux=True)(free)
