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
        batched, drive = with_batch_axis(model), jnp.asarray(inputs[:-1].T)
        ahead = np.asarray(_one_step(predictor, batched, jnp.asarray(measured[:-1].T), drive)).T
        free = np.asarray(_free_run(predictor, batched, jnp.asarray(measured[0]), drive)).T
    first = measured[:1]
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
    return predictor.step(model, states, inputs)


@partial(jax.jit, static_argnums=0)
def _free_run(predictor: Predictor, model: Model, start: JaxArray, inputs: JaxArray) -> JaxArray:
    def step(k: JaxArray, x: JaxArray) -> tuple[JaxArray, None]:
        return predictor.step(model, x, jax.lax.dynamic_slice_in_dim(inputs, k, 1, axis=1)), None

    def visit(k: JaxArray, x: JaxArray, _: None, path: JaxArray) -> JaxArray:
        return jax.lax.dynamic_update_slice_in_dim(path, x, k, axis=1)

    blank = jnp.zeros((start.shape[0], inputs.shape[1]), start.dtype)
    return rollout(step, start[:, None], inputs.shape[1], visit, blank)
