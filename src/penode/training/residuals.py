"""THE objective: one residual, from which loss, gradient, Gauss-Newton terms and scores derive."""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, lru_cache, partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.sparse import csr_array

from penode.arrays import FloatArray, JaxArray, float64, on_device
from penode.data.windows import Windows
from penode.models.base import Model
from penode.models.layout import Layout
from penode.predictors.base import Predictor
from penode.predictors.rollout import rollout
from penode.training.chunks import WindowSums, summed
from penode.training.free_starts import estimated_starts
from penode.training.gauss_newton_terms import GaussNewtonTerms, squared
from penode.training.loss import DEFAULT_LOSS, Loss
from penode.training.moments import moments
from penode.training.noise import StudentT
from penode.training.penalties import GaussianPrior, Penalty
from penode.training.prediction_error import Batch, PredictionError, compiled_windows
from penode.training.sample_scores import sample_scores
from penode.training.steady_points import Rest

#: Least curvature of noise with outliers over that of its weighted squares: far from a minimum the
#: mean curvature may have any sign.
_LEAST_BEND = 0.25
#: Windows that one pass of reverse mode takes: their rollouts stay in the second-level cache.
GRADIENT_CHUNK = 256


class Objective:
    """Squared k-step-ahead error of a model on windows, k = 1..H.

    Parameters
    ----------
    predictor : Predictor
        Solver and time step.
    model : Model
        Structure of the parameters; its values are not kept.
    scale : ndarray, shape (state,)
        Residuals are divided by it; in the units of the loss's domain, SI units of the states by
        default. Shape (output,) of a model with outputs.
    loss : Loss
        What is squared and summed; the paper's training loss by default.
    experiments : int
        Recordings, each with its own value of every nuisance.
    """

    def __init__(
        self,
        predictor: Predictor,
        model: Model,
        scale: FloatArray,
        loss: Loss = DEFAULT_LOSS,
        experiments: int = 1,
    ):
        self.predictor = predictor
        self.layout = Layout(model, experiments)
        self.scale = np.asarray(scale, dtype=np.float64)
        self.loss = loss
        own = self.scale * self.noise_scale
        self.error = PredictionError(predictor, self.layout, own, loss, model)
        # What squares of residuals over the noise's scale are in units of the loss.
        self._unit = float(np.mean(self.noise_scale[self.error.compared] ** 2))

    def with_penalties(self, penalties: tuple[Penalty, ...]) -> "Objective":
        """Return the objective with these penalties in place of its own; compiled code serves both.

        Parameters
        ----------
        penalties : tuple of Penalty
        """
        loss, error = replace(self.loss, penalties=penalties), self.error
        return Objective(self.predictor, error.model, self.scale, loss, self.layout.experiments)

    @property
    def noise_scale(self) -> FloatArray:
        """Scale of the noise in units of `scale`, (quantity,); 1 where squares are summed."""
        count, noise = len(self.scale), self.loss.noise
        return np.ones(count) if noise is None else noise.scales(count)

    def with_noise_scale(self, scale: FloatArray) -> "Objective":
        """Return the objective with another scale of noise with outliers, (quantity,)."""
        noise = replace(self.loss.noise or StudentT(), scale=tuple(scale.tolist()))
        loss, error = replace(self.loss, noise=noise), self.error
        return Objective(self.predictor, error.model, self.scale, loss, self.layout.experiments)

    def loss_and_gradient(self, raw: FloatArray, windows: Windows) -> tuple[float, FloatArray]:
        """Return the loss and its gradient (parameter,) by reverse mode.

        Parameters
        ----------
        raw : ndarray, shape (parameter,)
            Raw parameters.
        windows : Windows
            One program is compiled for each time step, horizon and number of windows.
        """
        loss, gradient, predicted = 0.0, np.zeros(len(raw)), windows.steps.sum()
        for places, error, alike in self.error.by_time_step(windows):
            share = len(places) * alike.horizon / predicted
            with float64():
                batch = compiled_windows(error, alike, len(places))
                own = self._gradients_at(error.predictor)(on_device(raw), batch, alike.horizon)
                loss += share * float(own[0])
                gradient += share * np.asarray(own[1])
        return loss, gradient

    def gauss_newton(
        self, raw: FloatArray, windows: Windows, starts: FloatArray | None = None
    ) -> GaussNewtonTerms:
        """Return the loss and the Gauss-Newton terms by forward sensitivities, J never stored.

        Parameters
        ----------
        raw : ndarray, shape (parameter,)
            Raw parameters.
        windows : Windows
            One program serves every horizon and number of windows cut from the same recordings.
        starts : ndarray, shape (free state, window), optional
            Those of terms near by, from which these are looked for.
        """
        residuals = int(windows.steps.sum()) * len(self.error.compared)
        penalties, slopes = self.penalties(raw)
        with float64():
            prior = self._prior(on_device(raw), residuals)
        sums = self._sums(raw, windows, guess=starts)
        return GaussNewtonTerms(
            loss=float(sums.squares) / residuals + float(penalties @ penalties),
            count=residuals,
            normal=sums.normal + residuals * squared(slopes),
            descent=_summed(sums.scores) - residuals * slopes.T @ penalties,
            scores=sums.scores,
            prior=prior,
            starts=sums.starts,
            far=sums.far or starts is not None,
        )

    def descent(
        self, raw: FloatArray, windows: Windows, starts: FloatArray | None = None
    ) -> FloatArray:
        """Return the descent (parameter,) of the Gauss-Newton terms alone, which costs less.

        Parameters
        ----------
        raw : ndarray, shape (parameter,)
            Raw parameters.
        windows : Windows
            Served by the same program as those of `gauss_newton`.
        starts : ndarray, shape (free state, window), optional
            As `gauss_newton` takes them.
        """
        residuals = int(windows.steps.sum()) * len(self.error.compared)
        penalties, slopes = self.penalties(raw)
        scores = self._sums(raw, windows, False, starts).scores
        return np.asarray(_summed(scores) - residuals * slopes.T @ penalties)

    def sample_scores(
        self, raw: FloatArray, windows: Windows, starts: FloatArray | None = None
    ) -> FloatArray:
        """Return the scores of `gauss_newton` by sample instead, shape (parameter, sample).

        Parameters
        ----------
        raw : ndarray, shape (parameter,)
            Raw parameters.
        windows : Windows
            A few of them: all go through at once.
        starts : ndarray, shape (free state, window), optional
            Those of the terms at `raw`; estimated if left out.
        """
        scores = sample_scores(self.error, raw, windows, starts)
        return np.asarray(self._unit * (self._transposed(raw) @ scores))

    def penalties(self, raw: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the penalties' residuals at raw (parameter,) and slopes (residual, parameter)."""
        return self._remembered_penalties(raw.tobytes())

    @cached_property
    def _remembered_penalties(self) -> Callable[[bytes], tuple[FloatArray, FloatArray]]:
        """The penalties at raw parameters, of which an optimiser asks several times."""

        @lru_cache(maxsize=4)
        def at(raw: bytes) -> tuple[FloatArray, FloatArray]:
            with float64():
                here = on_device(np.frombuffer(raw))
                both = _penalties_at(self.layout, self._arguments, here)
                return np.asarray(both[0]), np.asarray(both[1])

        return at

    def _prior(self, raw: JaxArray, residuals: int) -> FloatArray | float:
        """Return what Gaussian priors and points at rest add to the covariance of the scores."""
        beliefs = [p for p in self.loss.penalties if isinstance(p, GaussianPrior)]
        rests = [p for p in self._arguments if isinstance(p, Rest)]
        if not beliefs and not rests:
            return 0.0
        transform = np.asarray(_transform(self.layout, raw))
        at_rest = [
            (rest.scale, np.asarray(_penalties_at(self.layout, (rest,), raw)[1])) for rest in rests
        ]
        with np.errstate(invalid="ignore"):  # a step too far has none, and is rejected
            slopes = [belief.slopes(self.layout) @ transform for belief in beliefs]
            believed = [(b.variance[:, None], s) for b, s in zip(beliefs, slopes, strict=True)]
            parts = [s.T @ (variance * s) for variance, s in (*believed, *at_rest)]
        return np.asarray(residuals**2 * sum(parts))

    def _sums(
        self,
        raw: FloatArray,
        windows: Windows,
        normal: bool = True,
        guess: FloatArray | None = None,
    ) -> WindowSums:
        """Return the sums of raw parameters, the normal matrix only if wanted."""
        sums = summed(self.error, raw, windows, normal, guess)
        transposed, unit, bent = self._transposed(raw), self._unit, self._unit
        if normal and self.loss.noise is not None:
            bent *= self._bend(raw, windows, sums.starts)
        products = transposed @ (transposed @ sums.normal).T
        return sums._replace(
            squares=unit * sums.squares,
            normal=bent * products,
            scores=unit * (transposed @ sums.scores),
        )

    def _bend(self, raw: FloatArray, windows: Windows, corrections: FloatArray) -> float:
        """Return the mean curvature of noise with outliers over that of its weighted squares.

        By weighted squares steps are safe; a covariance wants the curvature itself (P. J. Huber,
        Ann. Stat. 1 (1973) 799, doi:10.1214/aos/1176342503).
        """
        weight, _, curvature = moments(self.error, raw, windows, corrections).sum(axis=1)
        return float(np.clip(curvature / max(weight, 1e-300), _LEAST_BEND, 1.0))

    def _transposed(self, raw: FloatArray) -> csr_array:
        """Return d(values)/d(raw), transposed."""
        with float64():
            return csr_array(np.asarray(_transform(self.layout, on_device(raw))).T)

    @cached_property
    def _gradients_at(self) -> Callable[[Predictor], Any]:
        """The compiled loss and gradient of a predictor, this one's at a time step."""

        @lru_cache
        def compiled(predictor: Predictor) -> Any:
            one, error = self, self.error
            if predictor is not self.predictor:
                count = self.layout.experiments
                one = Objective(predictor, error.model, self.scale, self.loss, count)
            return jax.jit(one.loss_and_gradient_of, static_argnums=2)

        return compiled

    @cached_property
    def _arguments(self) -> tuple[Penalty, ...]:
        """The penalties, whose numbers are arguments of compiled code, moved there once."""

        def moved(number: Any) -> Any:
            return on_device(number) if isinstance(number, float | np.ndarray) else number

        with float64():
            arguments: tuple[Penalty, ...] = jax.tree.map(moved, self.loss.penalties)
        return arguments

    def loss_and_gradient_of(
        self, raw: JaxArray, batch: Batch, horizon: int
    ) -> tuple[JaxArray, JaxArray]:
        """Return loss and gradient (parameter,) inside compiled code, by reverse mode.

        Parameters
        ----------
        raw : array, shape (parameter,)
        batch : Batch
            Windows; those not in use do not count.
        horizon : int
            Known when compiled.
        """
        differentiated = jax.value_and_grad(self._squares)

        def add(
            sums: tuple[JaxArray, JaxArray], part: tuple[JaxArray, ...]
        ) -> tuple[tuple[JaxArray, JaxArray], None]:
            square, slope = differentiated(raw, batch.of_windows(*part), horizon)
            return (sums[0] + square, sums[1] + slope), None

        nothing = (jnp.zeros((), raw.dtype), jnp.zeros_like(raw))
        (squares, slopes), _ = jax.lax.scan(add, nothing, batch.parts(GRADIENT_CHUNK))
        count = len(self.error.compared) * horizon * jnp.sum(batch.used)
        believed = partial(_penalties, self.layout, self.loss.penalties)
        penalty, bent = jax.value_and_grad(lambda raw: jnp.sum(believed(raw) ** 2))(raw)
        share = self._unit / count
        return squares * share + penalty, slopes * share + bent

    def _squares(self, raw: JaxArray, batch: Batch, horizon: int) -> JaxArray:
        """Return the sum of squared residuals, to be differentiated in reverse mode."""
        error, values = self.error, self.layout.values(raw)[:, None]
        correction = self._correction(jax.lax.stop_gradient(values), horizon, batch)
        parts = self.layout.split(values)
        outputs, prefilter = len(error.compared), self.loss.prefilter

        @jax.checkpoint
        def predict(k: JaxArray, history: JaxArray) -> JaxArray:
            return error.step(parts, history, k, batch, self.predictor.substeps)

        def step(k: JaxArray, history: JaxArray) -> tuple[JaxArray, None]:
            return predict(k, history), None

        def visit(k: JaxArray, history: JaxArray, _: None, carry: Any) -> Any:
            memory, total = carry
            residual = error.residual(parts, history[0], k + 1, jnp.asarray(horizon), batch)
            filtered, memory = prefilter.advance(memory, residual)
            return memory, total + jnp.sum(error.squares(filtered * batch.used))

        memory = jnp.zeros((prefilter.order, outputs, len(batch.starts)), values.dtype)
        start = error.start(parts, correction, batch)
        held = jnp.sum(error.squares_of_weighted(error.held(correction * batch.used)[0]))
        if error.model.outputs:
            here = jnp.zeros((), int)
            first = error.residual(parts, start[0], here, jnp.asarray(horizon), batch)
            held += jnp.sum(error.squares(first * batch.used))
        total: JaxArray = rollout(step, start, horizon, visit, (memory, held))[1]
        return total

    def _correction(self, values: JaxArray, horizon: int, batch: Batch) -> JaxArray:
        """Return the windows' starts at their minimum, where they do not move the gradient."""
        starts = estimated_starts(self.error, values, jnp.asarray(horizon), batch)
        return jax.lax.stop_gradient(starts)


def _summed(scores: FloatArray) -> FloatArray:
    """Return the scores summed over windows, (parameter,), which have no sum where one diverged."""
    return scores.sum(axis=1) if np.isfinite(scores).all() else np.full(len(scores), np.nan)


def _penalties(layout: Layout[Model], penalties: tuple[Penalty, ...], raw: JaxArray) -> JaxArray:
    values = layout.values(raw)
    return jnp.concatenate([raw[:0], *(penalty.residuals(layout, values) for penalty in penalties)])


# Compiled once for all objectives whose structure is the same: what differs from one recording to
# the next are arguments.


@eqx.filter_jit
def _penalties_at(
    layout: Layout[Model], penalties: tuple[Penalty, ...], raw: JaxArray
) -> tuple[JaxArray, JaxArray]:
    """Return the residuals of penalties and their Jacobian."""
    residuals = partial(_penalties, layout, penalties)
    return residuals(raw), jax.jacfwd(residuals)(raw)


@partial(jax.jit, static_argnums=0)
def _transform(layout: Layout[Model], raw: JaxArray) -> JaxArray:
    """Return d(values)/d(raw)."""
    slopes: JaxArray = jax.jacfwd(layout.values)(raw)
    return slopes
