"""Measured states against the model's one-step and free-run predictions."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, float64
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.models.base import Model
from penode.models.parameters import with_batch_axis
from penode.predictors.base import Predictor
from penode.predictors.rollout import rollout
from penode.validation.metrics import rmse


@dataclass(frozen=True, eq=False)
class Comparison:
    """One recording beside its predictions.

    Attributes
    ----------
    name : str
        The recording.
    role : str
        ``"train"`` or ``"validation"``.
    time_step : float
        Sampling interval in s; row k of the arrays is at time k * time_step.
    states, units : tuple of str
        Names and SI units of the columns.
    measured, one_step, free_run : ndarray, shape (time, state)
        Measured states; prediction of each sample from the measured one before it; prediction of
        the whole recording from its first sample alone (not finite after a divergence).
    """

    name: str
    role: str
    time_step: float
    states: tuple[str, ...]
    units: tuple[str, ...]
    measured: FloatArray
    one_step: FloatArray
    free_run: FloatArray

    @property
    def one_step_rmse(self) -> float:
        """Root mean squared one-step error over all states, in the states' unit."""
        return rmse(self.measured[1:], self.one_step[1:])

    @property
    def free_run_rmse(self) -> float:
        """Root mean squared free-run error over all states; infinite after a divergence."""
        return rmse(self.measured[1:], self.free_run[1:])


def require_predictable(predictor: Predictor, model: Model, experiment: Experiment) -> None:
    """Refuse a recording that the model cannot predict.

    Raises
    ------
    InputError
        If a channel is missing or has a value that is not finite, or the time step is not the
        predictor's.
    """
    for name, values in experiment.channels.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad) and name in (*model.states, *model.inputs):
            raise InputError(
                f"{experiment.name}: data row {bad[0] + 1}, channel {name} is {values[bad[0]]} "
                "where a number was wanted; cut the recording there."
            )
    experiment.stack((*model.states, *model.inputs))
    if not np.isclose(experiment.time_step, predictor.time_step, rtol=1e-4, atol=0):
        raise InputError(
            f"{experiment.name}: time step {experiment.time_step:.6g} s came where the model was "
            f"trained at {predictor.time_step:.6g} s; record or resample at that step."
        )


def compare(predictor: Predictor, model: Model, experiment: Experiment, role: str) -> Comparison:
    """Predict one recording step by step and in free run.

    Parameters
    ----------
    predictor : Predictor
    model : Model
        Trained, without batch axis.
    experiment : Experiment
        Has the model's states and inputs as channels.
    role : str
        ``"train"`` or ``"validation"``.

    Raises
    ------
    InputError
        If a channel is missing, or the time step is not the predictor's.
    """
    require_predictable(predictor, model, experiment)
    measured, inputs = experiment.stack(model.states), experiment.stack(model.inputs)
    with float64():
        arguments = (with_batch_axis(model), jnp.asarray(measured.T), jnp.asarray(inputs.T))
        ahead = np.asarray(_one_step(predictor, *arguments)).T
        free = np.asarray(_free_run(predictor, *arguments)).T
    first = measured[: predictor.past]
    return Comparison(
        name=experiment.name,
        role=role,
        time_step=experiment.time_step,
        states=model.states,
        units=model.state_units,
        measured=measured,
        one_step=np.concatenate([first, ahead]),
        free_run=np.concatenate([first, free]),
    )


def free_run_rmse(predictor: Predictor, model: Model, experiments: Sequence[Experiment]) -> float:
    """Return the free-run error over recordings, in the states' unit; infinite if one diverged."""
    squares, count = 0.0, 0
    for experiment in experiments:
        comparison = compare(predictor, model, experiment, "train")
        squares += comparison.free_run_rmse**2 * (len(experiment) - 1)
        count += len(experiment) - 1
    return float(np.sqrt(squares / count))


@partial(jax.jit, static_argnums=0)
def _one_step(predictor: Predictor, model: Model, states: JaxArray, inputs: JaxArray) -> JaxArray:
    """Predict samples past .. N - 1 (state, N - past), each from the measured ones before it."""
    at = jnp.arange(predictor.past - 1, states.shape[1] - 1)
    history = jnp.stack([states[:, at - j] for j in range(predictor.past)])
    return predictor.step(model, history, lambda offset: inputs[:, at + offset])[0]


@partial(jax.jit, static_argnums=0)
def _free_run(predictor: Predictor, model: Model, states: JaxArray, inputs: JaxArray) -> JaxArray:
    """Predict samples past .. N - 1 (state, N - past) from the first `past` measured ones."""
    last = predictor.past - 1
    samples = states.shape[1] - predictor.past

    def step(k: JaxArray, history: JaxArray) -> tuple[JaxArray, None]:
        def drive(offset: int) -> JaxArray:
            return jax.lax.dynamic_slice_in_dim(inputs, k + last + offset, 1, axis=1)

        return predictor.step(model, history, drive), None

    def visit(k: JaxArray, history: JaxArray, _: None, path: JaxArray) -> JaxArray:
        return jax.lax.dynamic_update_slice_in_dim(path, history[0], k, axis=1)

    start = jnp.stack([states[:, last - j, None] for j in range(predictor.past)])
    blank = jnp.zeros((states.shape[0], samples), states.dtype)
    return rollout(step, start, samples, visit, blank)
