"""Initial states: where the free run of each recording starts, and how well that is known."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, float64, on_device
from penode.data.windows import Contiguous, cut
from penode.fit.fit import unused
from penode.fit.outcome import Estimate
from penode.horizon.ladder import LadderProblem
from penode.models.explicit_time import driving_channels
from penode.models.measured import free_states
from penode.training.gauss_newton_terms import flat_directions, inverse_normal
from penode.training.loss import Loss
from penode.training.prediction_error import Batch, PredictionError, compiled_windows
from penode.training.sensitivities import Columns, Recursion
from penode.validation.autocovariance import score_covariance
from penode.validation.comparison import Comparison
from penode.validation.free_run import scale_of_errors, with_unmeasured

#: Share of a state in directions that the recording does not show, from which nothing is known.
_UNSEEN = 1e-3


def initial_states(
    problem: LadderProblem, raw: FloatArray, covariance: FloatArray, seen: Sequence[Comparison]
) -> dict[str, dict[str, Estimate]]:
    """Return the estimated initial states of each recording's free run, by recording and state.

    A start is a least-squares estimate from the whole recording at the parameters found. To its
    variance under the residuals' own autocovariance is added what the parameters' is: the start
    follows them by -(S'S)^-1 S'S_theta.

    Parameters
    ----------
    problem : LadderProblem
    raw : ndarray, shape (parameter,)
    covariance : ndarray, shape (parameter, parameter)
        Of raw.
    seen : sequence of Comparison
        Predictions of the recordings trained on, in their order.
    """
    if not free_states(problem.model):
        return {}
    found: dict[str, dict[str, Estimate]] = {}
    for number, one in enumerate(seen):
        found[unused(one.name, found)] = _of_recording(problem, raw, covariance, number, one)
    return found


def _of_recording(
    problem: LadderProblem, raw: FloatArray, covariance: FloatArray, number: int, seen: Comparison
) -> dict[str, Estimate]:
    model, before = problem.model, problem.objective
    names, start = free_states(model), np.asarray(seen.start)
    rows = [model.states.index(name) for name in names]
    deviation = np.full(len(rows), np.inf)  # as long as the parameters' is not known
    if np.isfinite(covariance).all() and np.isfinite(start).all():
        scale = np.ones(len(model.outputs) or len(model.states))
        scale[before.error.compared] = scale_of_errors(model, seen.measured.T)
        predictor = before.predictor.at(seen.time_step)
        error = PredictionError(predictor, before.layout, scale, Loss(), model, simulates=True)
        residual, own, mixed = _slopes(problem, error, raw, number, start)
        with float64():
            transform = np.asarray(_transform(error, on_device(raw)))
        deviation = _deviation(residual, own, mixed @ transform, covariance)
    units = [model.state_units[k] for k in rows]
    return {
        name: Estimate.of(float(start[k]), float(std), unit)
        for name, k, std, unit in zip(names, rows, deviation, units, strict=True)
    }


def _deviation(
    residual: FloatArray, own: FloatArray, mixed: FloatArray, covariance: FloatArray
) -> FloatArray:
    """Return the deviations (free,) of a start; infinite where the recording does not show it.

    Residuals are (output, time), their slopes (output, free, time), S'S_theta (free, parameter).
    """
    normal = np.tensordot(own, own, axes=((0, 2), (0, 2)))
    inverse = inverse_normal(normal)
    noise = score_covariance(own, residual)
    follow = inverse @ mixed
    variance = np.diag(inverse @ noise @ inverse + follow @ covariance @ follow.T)
    unseen = np.linalg.norm(flat_directions(normal), axis=1) > _UNSEEN
    return np.where(unseen, np.inf, np.sqrt(np.maximum(variance, 0.0)))


def _slopes(
    problem: LadderProblem,
    error: PredictionError,
    raw: FloatArray,
    number: int,
    start: FloatArray,
) -> tuple[FloatArray, ...]:
    """Return residuals, slopes by the start, and S'S_theta by values of a recording's free run."""
    experiment, model = with_unmeasured(problem.experiments[number], problem.model), problem.model
    windows = cut(
        [experiment],
        model.states,
        driving_channels(model),
        len(experiment) - 1,
        output_names=tuple(model.outputs),
        placement=Contiguous(),
        prepared=error.predictor.prepared,
    )
    windows = replace(windows, recording=np.array([number]))
    correction = (start - windows.states[0])[error.free][:, None]
    with float64():
        batch = compiled_windows(error, windows, 1)
        given = on_device(raw), on_device(error.scale), on_device(correction), batch
        residual, own, mixed = map(np.asarray, _by_sample(error, *given, windows.horizon))
    return residual[:, : len(experiment)], own[..., : len(experiment)], mixed


@partial(jax.jit, static_argnums=0)
def _by_sample(
    error: PredictionError,
    raw: JaxArray,
    scale: JaxArray,
    correction: JaxArray,
    batch: Batch,
    horizon: JaxArray,
) -> tuple[JaxArray, JaxArray, JaxArray]:
    """Return residuals (output, time), slopes (output, free, time) and S'S_theta (free, value)."""
    error = replace(error, scale=scale)
    values = error.layout.values(raw)[:, None]
    size, outputs, free = len(values), len(error.compared), len(error.free)
    samples = batch.states.shape[1]

    def add(k: JaxArray, residual: JaxArray, slopes: Columns, sums: _Sums) -> _Sums:
        own, shared = slopes.own[..., 0], slopes.shared[..., 0]
        return (
            sums[0].at[:, k + 1].set(residual[:, 0]),
            sums[1].at[:, :, k + 1].set(own),
            sums[2] + own.T @ shared,
        )

    nothing = (
        jnp.zeros((outputs, samples), values.dtype),
        jnp.zeros((outputs, free, samples), values.dtype),
        jnp.zeros((free, size), values.dtype),
    )
    recursion = Recursion(error, error.layout.split(values), horizon, batch, size)
    return recursion.over_steps(correction, add, nothing)


#: What `_by_sample` adds up.
_Sums = tuple[JaxArray, JaxArray, JaxArray]


@partial(jax.jit, static_argnums=0)
def _transform(error: PredictionError, raw: JaxArray) -> JaxArray:
    """Return d(values)/d(raw)."""
    slopes: JaxArray = jax.jacfwd(error.layout.values)(raw)
    return slopes
