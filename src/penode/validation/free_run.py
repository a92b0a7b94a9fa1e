"""What was measured against the model's one-step and free-run predictions."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from penode.arrays import (
    FloatArray,
    JaxArray,
    float64,
    on_device,
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
from penode.validation.look_ahead import look_ahead

#: What stands for an error or a slope of a free run that diverged.
_DIVERGED = 1e100
#: Samples by which the start of a free run is estimated first; then by four times as many.
_BEGINNING = 32
#: Share of what a run says of its start, in any direction, by which its later half adds nothing.
_FORGOTTEN = 1e-4


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
        States whose initial value the free run estimates, by least squares over as many samples
        as say anything of it (NOE with estimated initial state); by default the model's unmeasured
        ones, and all of a model with outputs.

    Raises
    ------
    InputError
        If a channel is missing, or the time step is not the predictor's.
    """
    require_predictable(predictor, model, experiment)
    guessed = all(name in experiment.channels for name in hidden_states(model))
    experiment, units = with_unmeasured(experiment, model), measured_units(model)
    with float64():
        batched = with_batch_axis(model)
        run = _run_of(predictor, batched, experiment, free, None)
        if batched.covariances:
            guessed, samples = True, run.states.shape[1] - predictor.past
            read = with_shared_length(run.measured)
            ahead = np.asarray(run_freely(predictor, batched, run.start, run.drive, samples, read))
            ahead = ahead[:, :samples]
        else:
            inputs = experiment.stack(driving_channels(model)).T
            ahead = look_ahead(predictor, batched, run.recorded, inputs, 1)
        first = run.states[:, : predictor.past]
        ahead = np.concatenate([first, ahead if guessed else ahead * np.nan], axis=1)
        one_step, free_run = (
            _predicted(predictor, batched, states, run.drive) for states in (ahead, run.states)
        )
    return Comparison(
        name=experiment.name,
        role=role,
        time_step=experiment.time_step,
        states=tuple(units),
        units=tuple(units.values()),
        measured=run.measured.T,
        one_step=one_step.T,
        free_run=free_run.T,
        recording="" if experiment.stretch is None else experiment.stretch.recording,
        start=np.asarray(run.start)[0],
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


class _Run(NamedTuple):
    """A free run of a recording, from its first samples or an estimated start."""

    # (past, state), the present first.
    start: JaxArray
    # (quantity, time).
    measured: FloatArray
    # What was recorded of the states, corrected, (state, time).
    recorded: FloatArray
    # From the first samples on, (state, time).
    states: FloatArray
    # What the predictor prepared of the inputs, (row, padded time).
    drive: JaxArray
    # Samples that an estimated start was found from.
    used: int


def _run_of(
    predictor: Predictor,
    model: Model,
    experiment: Experiment,
    free: Sequence[str] | None,
    begin: tuple[FloatArray, int] | None,
) -> _Run:
    """Let a model with a batch axis run freely; see `compare`.

    Estimation begins at a state, and with as many samples at least.
    """
    freed = [model.states.index(name) for name in (free_states(model) if free is None else free)]
    read, inputs = (experiment.stack(n) for n in (model.states, driving_channels(model)))
    corrected = model.corrected(with_shared_length(read.T))
    states = np.asarray(corrected)[:, : len(experiment)]
    start = on_device(states[:, : predictor.past].T[::-1].copy())
    measured = _measured(model, experiment, states)
    drive = with_shared_length(predictor.prepared(inputs).T)
    used = 0
    if freed:
        start, used = _estimated_start(predictor, model, (start, measured, drive), freed, begin)
    samples = len(experiment) - predictor.past
    after = np.asarray(run_freely(predictor, model, start, drive, samples))[:, :samples]
    whole = np.concatenate([np.asarray(start)[::-1].T, after], axis=1)
    return _Run(start, measured, states, whole, drive, used)


def _predicted(
    predictor: Predictor, model: Model, states: FloatArray, drive: JaxArray
) -> FloatArray:
    """Return what sensors read at states (state, time) and what was prepared of the inputs."""
    inputs = drive[: len(driving_channels(model))]
    read = _outputs(model, with_shared_length(states), inputs, predictor.time_step)
    return np.asarray(read)[:, : states.shape[1]]


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
        return np.stack(_squares_of_runs(predictor, models, experiment, free))
    with float64():
        names = (models[0].states, driving_channels(models[0]))
        experiment = with_unmeasured(experiment, models[0])
        states, inputs = (experiment.stack(channels) for channels in names)
        recorded = [with_shared_length(a.T) for a in (states, predictor.prepared(inputs))]
        together: Model = jax.tree.map(lambda *leaves: np.stack(leaves, axis=-1), *models)
        samples = len(experiment) - predictor.past
        squares = np.asarray(_squares(predictor, together, *recorded, samples))
        return squares[:, : len(dynamic_states(models[0]))]


def _squares_of_runs(
    predictor: Predictor,
    models: Sequence[Model],
    experiment: Experiment,
    free: Sequence[str] | None,
) -> list[FloatArray]:
    """Return the sums of squared errors of runs whose start is estimated, (row,) of each model."""
    experiment, begin = with_unmeasured(experiment, models[0]), None
    squares: list[FloatArray] = []
    for model in reversed(models):
        with float64(), np.errstate(over="ignore", invalid="ignore"):
            batched = with_batch_axis(model)
            run = _run_of(predictor, batched, experiment, free, begin)
            gap = run.measured - _predicted(predictor, batched, run.states, run.drive)
            squares.append(np.sum(gap[:, predictor.past :] ** 2, axis=1))
        if len(squares) == 1 and np.isfinite(gap).all():
            begin = np.asarray(run.start)[0], run.used
    return squares[::-1]


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
    guess: tuple[FloatArray, int] | None,
) -> tuple[JaxArray, int]:
    """Return the first state (1, state), its free rows fitted to what was measured of the run.

    Behind it, the samples that sufficed.
    """
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
    state, least = (first, 0) if guess is None else guess
    free = np.asarray(state)[freed]
    # A long run of a nonlinear model has several minima; its beginning leads to the right one.
    shorter = (_BEGINNING * 4**k for k in range(20))
    for length in (*(n for n in shorter if least <= n < ahead / 4), ahead):
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
            answer = least_squares(residual, free, method=method, **options)
        free = answer.x
        if _forgotten(answer.jac.reshape(len(measured), -1, len(freed))):
            break
    found = np.array(start)
    found[:, freed] = free
    return on_device(found), length


def _forgotten(slopes: FloatArray) -> bool:
    """Return whether the later half of slopes (quantity, time, free) adds nothing to the start."""
    quantities, samples, free = slopes.shape
    if quantities * samples < free:
        return False
    later = np.linalg.qr(slopes.reshape(-1, free))[0].reshape(slopes.shape)[:, samples // 2 :]
    return float(np.linalg.norm(later.reshape(-1, free), 2)) ** 2 <= _FORGOTTEN


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
