"""How sure a free run is: what the covariance of the parameters makes of it, to first order."""

from dataclasses import dataclass
from functools import cached_property, partial

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, float64, on_device, with_shared_length
from penode.data.experiment import Experiment
from penode.models.base import Model
from penode.models.explicit_time import driving_channels
from penode.models.inputs import Inputs
from penode.models.layout import Layout
from penode.models.measured import free_states, measured_units, predicted_outputs
from penode.predictors.base import Predictor
from penode.predictors.delays import as_acting
from penode.validation.autocovariance import score_covariance
from penode.validation.free_run import compare, run_freely, scale_of_errors, with_unmeasured

#: Directions of parameters that are followed at a time.
_TOGETHER = 16
#: Eigenvalues of a scaled matrix up to which a direction has none.
_NONE = 1e-12


def free_run_deviation(
    predictor: Predictor, model: Model, experiment: Experiment, covariance: FloatArray
) -> FloatArray:
    """Return the standard deviation of a free run, (time, quantity), SI units.

    An estimated start follows the parameters, as it is found anew for each of them, and has a
    variance of its own under the autocovariance of the run's residual. A measured start is taken as
    it was measured.

    Parameters
    ----------
    predictor : Predictor
    model : Model
        Without batch axis.
    experiment : Experiment
    covariance : ndarray, shape (parameter, parameter)
        Of the raw parameters of the model.
    """
    run = _Run.of(predictor, model, experiment)
    if not np.isfinite(covariance).all():
        return np.full((len(experiment), len(measured_units(model))), np.inf)
    variance = run.variance_of_start
    root = _root(covariance)
    for first in range(0, root.shape[1], _TOGETHER):
        variance = variance + np.sum(run.moved(root[:, first : first + _TOGETHER]) ** 2, axis=0)
    return np.asarray(np.sqrt(variance).T)


@dataclass(frozen=True, eq=False)
class _Run:
    """A free run of a recording; its residual is (quantity, time), the errors' scale (quantity, 1).

    Errors of a start that is estimated are those of its free rows.
    """

    fixed: tuple[Predictor, Layout[Model], tuple[int, ...]]
    # Raw parameters, free rows of the start, first samples (state, past), inputs, count.
    given: tuple[JaxArray, JaxArray, JaxArray, JaxArray, JaxArray]
    residual: FloatArray
    scale: FloatArray

    @classmethod
    def of(cls, predictor: Predictor, model: Model, experiment: Experiment) -> "_Run":
        said = compare(predictor, model, experiment)
        whole = with_unmeasured(experiment, model)
        layout: Layout[Model] = Layout(model)
        freed = tuple(model.states.index(name) for name in free_states(model))
        with float64():
            inputs = predictor.prepared(whole.stack(driving_channels(model)))
            given = (
                on_device(layout.raw(model)),
                on_device(np.asarray(said.start)[list(freed)]),
                on_device(whole.stack(model.states)[: predictor.past].T),
                with_shared_length(inputs.T),
                jnp.asarray(len(experiment) - predictor.past),
            )
        residual = (said.measured - said.free_run).T
        scale = scale_of_errors(model, said.measured.T)[:, None]
        return cls((predictor, layout, freed), given, residual, scale)

    def moved(self, directions: FloatArray) -> FloatArray:
        """Return what directions (parameter, direction) move the run by, (direction, ...)."""
        with float64():
            moved = _along(*self.fixed, on_device(directions.T), *self.given)
        changes = np.asarray(moved)[..., : self.residual.shape[1]]
        if not self.fixed[2]:
            return changes
        scores = np.einsum("qft,dqt->fd", self._weighed, changes / self.scale)
        return changes - np.einsum("qft,fd->dqt", self._slopes, self._inverse @ scores)

    @property
    def variance_of_start(self) -> FloatArray:
        """Variance (quantity, time) from the noise that an estimated start is found from."""
        if not self.fixed[2]:
            return np.zeros_like(self.residual)
        noise = score_covariance(self._weighed, self.residual / self.scale)
        covariance = self._inverse @ noise @ self._inverse
        return np.einsum("qft,fg,qgt->qt", self._slopes, covariance, self._slopes, optimize=True)

    @cached_property
    def _slopes(self) -> FloatArray:
        """Slopes of the run by its free start, (quantity, free, time)."""
        with float64():
            slopes = np.asarray(_by_start(*self.fixed, *self.given))
        return np.swapaxes(slopes[:, : self.residual.shape[1]], 1, 2)

    @cached_property
    def _weighed(self) -> FloatArray:
        return np.asarray(self._slopes / self.scale[..., None])

    @cached_property
    def _inverse(self) -> FloatArray:
        root = _inverse_root(np.tensordot(self._weighed, self._weighed, axes=((0, 2), (0, 2))))
        return root @ root.T


def _root(covariance: FloatArray) -> FloatArray:
    """Return L, (parameter, rank), of which LL' is a covariance."""
    size, values, vectors = _scaled(covariance)
    return np.asarray(size[:, None] * vectors * np.sqrt(values))


def _inverse_root(normal: FloatArray) -> FloatArray:
    """Return L, of which LL' is the pseudo-inverse of a normal matrix."""
    size, values, vectors = _scaled(normal)
    return np.asarray(vectors / np.sqrt(values) / size[:, None])


def _scaled(matrix: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return scales, and the eigenvalues above none with their vectors of the scaled matrix."""
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    size[size == 0] = 1.0
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    kept = values > _NONE * max(values.max(initial=0.0), 1e-300)
    return size, values[kept], vectors[:, kept]


def _run(
    raw: JaxArray,
    free: JaxArray,
    fixed: tuple[Predictor, Layout[Model], tuple[int, ...]],
    recording: tuple[JaxArray, ...],
) -> JaxArray:
    """Return what sensors read of a free run, (quantity, time)."""
    (predictor, layout, freed), (first, inputs, samples) = fixed, recording
    model = layout.model(layout.values(raw)[:, None])
    corrected = model.corrected(first)
    start = corrected.at[np.array(freed, dtype=int), -1].set(free)
    after = run_freely(predictor, model, start.T[::-1], inputs, samples)
    path = jnp.concatenate([start, after[:, : after.shape[1] - start.shape[1]]], axis=1)
    names = driving_channels(model)
    acting = as_acting(model, inputs[: len(names)], predictor.time_step)
    return predicted_outputs(model, path, Inputs(acting, names))


@partial(jax.jit, static_argnums=(0, 1, 2))
def _along(
    predictor: Predictor,
    layout: Layout[Model],
    freed: tuple[int, ...],
    directions: JaxArray,
    raw: JaxArray,
    free: JaxArray,
    *recording: JaxArray,
) -> JaxArray:
    """Return what each direction (direction, parameter) changes the run by to first order."""

    def run(raw: JaxArray) -> JaxArray:
        return _run(raw, free, (predictor, layout, freed), recording)

    changes: JaxArray = jax.vmap(lambda d: jax.jvp(run, (raw,), (d,))[1])(directions)
    return changes


@partial(jax.jit, static_argnums=(0, 1, 2))
def _by_start(
    predictor: Predictor,
    layout: Layout[Model],
    freed: tuple[int, ...],
    raw: JaxArray,
    free: JaxArray,
    *recording: JaxArray,
) -> JaxArray:
    """Return the slopes of the run by its free start, (quantity, time, free)."""
    fixed = predictor, layout, freed
    slopes: JaxArray = jax.jacfwd(lambda free: _run(raw, free, fixed, recording))(free)
    return slopes
