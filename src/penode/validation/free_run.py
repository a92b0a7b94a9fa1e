"""Measured states against the model's one-step and free-run predictions."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from penode.arrays import FloatArray, JaxArray, float64, on_device, with_shared_length
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.models.base import Model
from penode.models.parameters import with_batch_axis
from penode.predictors.base import Predictor
from penode.predictors.rollout import rollout
from penode.validation.comparison import Comparison

#: What stands for an error or a slope of a free run that diverged.
_DIVERGED = 1e100
#: Samples by which the start of a free run is estimated first; then by four times as many.
_BEGINNING = 32


def with_unmeasured(experiment: Experiment, model: Model) -> Experiment:
    """Return the recording with a channel of zeros for each unmeasured state that has no guess."""
    absent = [name for name in model.unmeasured if name not in experiment.channels]
    blank = {name: np.zeros(len(experiment)) for name in absent}
    return replace(experiment, channels={**experiment.channels, **blank}) if absent else experiment


def require_predictable(predictor: Predictor, model: Model, experiment: Experiment) -> None:
    """Refuse a recording that the model cannot predict.

    A channel is missing or not finite, or the time step is not the predictor's.
    """
    for name, values in experiment.channels.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad) and name in (*model.states, *model.inputs):
            raise InputError(
                f"{experiment.name}: data row {bad[0] + 1}, channel {name} is {values[bad[0]]} "
                "where a number was wanted; cut the recording there."
            )
    with_unmeasured(experiment, model).stack((*model.states, *model.inputs))
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
        Has the model's measured states and inputs as channels.
    role : str
        ``"train"`` or ``"validation"``.
    free : sequence of str, optional
        States whose initial value the free run estimates, by least squares over the whole
        recording (NOE with estimated initial state); the model's unmeasured ones by default.

    Raises
    ------
    InputError
        If a channel is missing, or the time step is not the predictor's.
    """
    require_predictable(predictor, model, experiment)
    guessed = all(name in experiment.channels for name in model.unmeasured)
    experiment = with_unmeasured(experiment, model)
    rows = _measured_rows(model)
    freed = [model.states.index(name) for name in (model.unmeasured if free is None else free)]
    with float64():
        read, inputs = (experiment.stack(names).T for names in (model.states, model.inputs))
        batched = with_batch_axis(model)
        corrected = batched.corrected(with_shared_length(read))
        measured = np.asarray(corrected)[:, : len(experiment)]
        ahead = look_ahead(predictor, batched, measured, inputs, 1).T
        start = on_device(measured[:, : predictor.past].T[::-1].copy())
        inputs = predictor.prepared(inputs.T).T
        if freed:
            both = on_device(measured), on_device(inputs)
            start = _estimated_start(predictor, batched, both, (rows, freed))
        samples = inputs.shape[1] - predictor.past
        padded = with_shared_length(inputs)
        run = np.asarray(_free_run(predictor, batched, start, padded, samples)).T[:samples]
    whole = measured.T
    first = np.asarray(start)[::-1]
    return Comparison(
        name=experiment.name,
        role=role,
        time_step=experiment.time_step,
        states=tuple(model.states[k] for k in rows),
        units=tuple(model.state_units[k] for k in rows),
        measured=whole[:, rows],
        one_step=np.concatenate([first, ahead if guessed else ahead * np.nan])[:, rows],
        free_run=np.concatenate([first, run])[:, rows],
        recording="" if experiment.stretch is None else experiment.stretch.recording,
    )


def free_run_errors(
    predictor: Predictor, fits: Sequence[Sequence[Model]], experiments: Sequence[Experiment]
) -> FloatArray:
    """Return the free-run RMSE, (fit, state), over all recordings in the states' units.

    Each fit has a model of every recording, of one structure; infinite where a free run diverged.
    """
    rows = _measured_rows(fits[0][0])
    squares, count = np.zeros((len(fits), len(rows))), 0
    for models, experiment in zip(zip(*fits, strict=True), experiments, strict=True):
        squares += _free_run_squares(predictor, models, experiment)[:, rows]
        count += len(experiment) - predictor.past
    with np.errstate(invalid="ignore"):
        rms = np.sqrt(squares / count)
    return np.asarray(np.where(np.isfinite(rms), rms, np.inf))


def _measured_rows(model: Model) -> list[int]:
    return [k for k, name in enumerate(model.states) if name not in model.unmeasured]


def _free_run_squares(
    predictor: Predictor, models: Sequence[Model], experiment: Experiment
) -> FloatArray:
    """Return the sums of squared free-run errors of each model on a recording, (model, state)."""
    if models[0].unmeasured:  # each estimates its own start
        squares = np.full((len(models), len(models[0].states)), np.nan)
        for row, model in zip(squares, models, strict=True):
            run = compare(predictor, model, experiment)
            gap = (run.measured - run.free_run)[predictor.past :]
            with np.errstate(over="ignore"):
                row[_measured_rows(model)] = np.sum(gap**2, axis=0)
        return squares
    with float64():
        names = (models[0].states, models[0].inputs)
        states, inputs = (experiment.stack(channels) for channels in names)
        recorded = [with_shared_length(a.T) for a in (states, predictor.prepared(inputs))]
        together: Model = jax.tree.map(lambda *leaves: np.stack(leaves, axis=-1), *models)
        samples = len(experiment) - predictor.past
        return np.asarray(_squares(predictor, together, *recorded, samples))


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
        now = k + past - 1
        return predictor.step(models, history, lambda offset: at(inputs, now + offset)), None

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
        ahead = predictor.step(model, history, lambda offset: inputs[:, at + offset])
        return jnp.where(at < target, ahead, history), None

    def visit(k: JaxArray, history: JaxArray, _: None, path: JaxArray) -> JaxArray:
        return history[0]

    return rollout(step, start, steps, visit, start[0])


@partial(jax.jit, static_argnums=0)
def _free_run(
    predictor: Predictor, model: Model, start: JaxArray, inputs: JaxArray, samples: JaxArray
) -> JaxArray:
    """Predict as many samples from the states (past, state) before them; zeros after (state, N)."""
    last = predictor.past - 1

    def step(k: JaxArray, history: JaxArray) -> tuple[JaxArray, None]:
        def drive(offset: int) -> JaxArray:
            return jax.lax.dynamic_slice_in_dim(inputs, k + last + offset, 1, axis=1)

        return predictor.step(model, history, drive), None

    def visit(k: JaxArray, history: JaxArray, _: None, path: JaxArray) -> JaxArray:
        return jax.lax.dynamic_update_slice_in_dim(path, history[0], k, axis=1)

    blank = jnp.zeros((start.shape[1], inputs.shape[1]), start.dtype)
    return rollout(step, start[..., None], samples, visit, blank)


def _estimated_start(
    predictor: Predictor,
    model: Model,
    recording: tuple[JaxArray, JaxArray],
    rows: tuple[list[int], list[int]],
) -> JaxArray:
    """Return the first state (1, state), its free rows fitted to the compared rows of the run."""
    (measured, inputs), (compared, freed) = recording, rows
    first, ahead = measured[:, 0], inputs.shape[1] - 1
    padded = with_shared_length(inputs)
    if predictor.past > 1:
        raise InputError(
            f"the first state is to be estimated, but {predictor.solver} starts from "
            f"{predictor.past} samples; choose a one-step solver."
        )

    target = np.asarray(measured[:, 1:])[compared]
    free = np.asarray(first)[freed]
    # A long run of a nonlinear model has several minima; its beginning leads to the right one.
    lengths = [n for n in (_BEGINNING * 4**k for k in range(20)) if n < ahead]
    for length in (*lengths, ahead):
        fixed = predictor, tuple(freed), model, first, (padded, jnp.asarray(length))

        def residual(free: FloatArray, length: int = length, fixed: Any = fixed) -> FloatArray:
            gap = np.asarray(_run_from(free, *fixed))[compared, :length] - target[:, :length]
            return _bounded(gap.ravel())

        def slope(free: FloatArray, length: int = length, fixed: Any = fixed) -> FloatArray:
            slopes = np.asarray(_slope_of_run(free, *fixed))[compared, :length]
            return _bounded(slopes.reshape(-1, len(freed)))

        with np.errstate(all="ignore"):  # of a run that diverges from every start
            free = least_squares(residual, free, jac=slope, x_scale="jac", max_nfev=50).x
    start: JaxArray = first.at[np.array(freed)].set(free)[None]
    return start


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
    """Return the free run of inputs and samples (`drive`) from a state with free rows."""
    start = first.at[np.array(freed)].set(free)[None]
    return _free_run(predictor, model, start, *drive)


# Compiled once for all recordings of about a length, all values of parameters and all starts.
_run_from = jax.jit(_from_free, static_argnums=(1, 2))
_slope_of_run = jax.jit(jax.jacfwd(_from_free), static_argnums=(1, 2))
