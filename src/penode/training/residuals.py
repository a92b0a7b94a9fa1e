"""THE objective: one residual, from which loss, gradient, Gauss-Newton terms and scores derive."""

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, IntArray, JaxArray, float64
from penode.data.windows import Windows
from penode.models.base import Model
from penode.models.parameters import Layout
from penode.predictors.base import Predictor
from penode.predictors.holds import Drive
from penode.predictors.rollout import rollout

#: Windows a chunk: the sensitivities of one chunk stay in the first-level cache.
CHUNK = 64


@dataclass(frozen=True, eq=False)
class GaussNewtonTerms:
    """Sums over windows w and steps k of the residual r and its sensitivity S = -dr/dtheta.

    Attributes
    ----------
    loss : float
        Mean squared residual over windows, steps and states (paper, training loss).
    count : int
        Number of residuals summed.
    normal : ndarray, shape (parameter, parameter)
        Sum of S'S.
    descent : ndarray, shape (parameter,)
        Sum of S'r: minus half the gradient of the summed squares.
    scores : ndarray, shape (parameter, window)
        S'r summed over the steps of each window.
    """

    loss: float
    count: int
    normal: FloatArray
    descent: FloatArray
    scores: FloatArray

    @property
    def finite(self) -> bool:
        """Whether no rollout diverged."""
        return bool(np.isfinite(self.loss) and np.isfinite(self.normal).all())


class Objective:
    """Squared k-step-ahead error of a model on windows, k = 1..H.

    Parameters
    ----------
    predictor : Predictor
        Solver and time step.
    model : Model
        Structure of the parameters; its values are not kept.
    scale : ndarray, shape (state,)
        Residuals are divided by it; in the states' SI units.
    """

    def __init__(self, predictor: Predictor, model: Model, scale: FloatArray):
        self.predictor = predictor
        self.layout = Layout(model)
        self.scale = np.asarray(scale, dtype=np.float64)

    def residual(self, measured: JaxArray, predicted: JaxArray) -> JaxArray:
        """Return the scaled k-step-ahead error, shape (state, batch)."""
        return (measured - predicted) / jnp.asarray(self.scale)[:, None]

    def loss_and_gradient(self, raw: FloatArray, windows: Windows) -> tuple[float, FloatArray]:
        """Return the loss and its gradient (parameter,) by reverse mode.

        Parameters
        ----------
        raw : ndarray, shape (parameter,)
            Raw parameters.
        windows : Windows
            One program is compiled for each horizon and number of windows.
        """
        with float64():
            arguments = (jnp.asarray(raw), *_recordings(windows), jnp.asarray(windows.starts))
            loss, gradient = self._value_and_grad(*arguments, windows.horizon)
            return float(loss), np.asarray(gradient)

    def gauss_newton(self, raw: FloatArray, windows: Windows) -> GaussNewtonTerms:
        """Return the loss and the Gauss-Newton terms by forward sensitivities, J never stored.

        Parameters
        ----------
        raw : ndarray, shape (parameter,)
            Raw parameters.
        windows : Windows
            One program serves every horizon and number of windows cut from the same recordings.
        """
        count = len(windows.starts)
        with float64():
            sums = self._terms(
                jnp.asarray(raw), *_recordings(windows), _padded(windows), count, windows.horizon
            )
            squares, normal, descent, scores = (np.asarray(part) for part in sums)
        residuals = count * windows.horizon * len(self.scale)
        return GaussNewtonTerms(
            float(squares) / residuals, residuals, normal, descent, scores[:, :count]
        )

    @cached_property
    def _value_and_grad(self) -> Any:
        return jax.jit(jax.value_and_grad(self._loss), static_argnums=4)

    @cached_property
    def _terms(self) -> Any:
        return jax.jit(self._sum_over_chunks)

    def _loss(
        self, raw: JaxArray, states: JaxArray, inputs: JaxArray, starts: JaxArray, horizon: int
    ) -> JaxArray:
        model = self.layout.model(self.layout.values(raw)[:, None])

        @jax.checkpoint
        def predict(k: JaxArray, history: JaxArray) -> JaxArray:
            return self.predictor.step(model, history, _drive(inputs, starts + k))

        def step(k: JaxArray, history: JaxArray) -> tuple[JaxArray, None]:
            return predict(k, history), None

        def visit(k: JaxArray, history: JaxArray, _: None, total: JaxArray) -> JaxArray:
            return total + jnp.sum(self.residual(states[:, starts + k + 1], history[0]) ** 2)

        start = _history(states, starts, self.predictor.past)
        total = rollout(step, start, horizon, visit, jnp.zeros((), states.dtype))
        return total / (states.shape[0] * starts.shape[0] * horizon)

    def _sum_over_chunks(
        self,
        raw: JaxArray,
        states: JaxArray,
        inputs: JaxArray,
        starts: JaxArray,
        count: JaxArray,
        horizon: JaxArray,
    ) -> tuple[JaxArray, ...]:
        values = self.layout.values(raw)
        transform = jax.jacfwd(self.layout.values)(raw)
        size = values.shape[0]
        chunk_of = partial(self._one_chunk, values, (states, inputs), horizon)

        def body(chunk: JaxArray, sums: tuple[JaxArray, ...]) -> tuple[JaxArray, ...]:
            squares, normal, scores = sums
            at = jax.lax.dynamic_slice(starts, (chunk * CHUNK,), (CHUNK,))
            used = (chunk * CHUNK + jnp.arange(CHUNK) < count).astype(values.dtype)
            chunk_scores, normal, squares = chunk_of((at, used), (normal, squares))
            here = (jnp.zeros_like(chunk), chunk * CHUNK)
            return squares, normal, jax.lax.dynamic_update_slice(scores, chunk_scores, here)

        nothing = (
            jnp.zeros((), values.dtype),
            jnp.zeros((size, size), values.dtype),
            jnp.zeros((size, starts.shape[0]), values.dtype),
        )
        chunks = (count + CHUNK - 1) // CHUNK
        squares, normal, scores = jax.lax.fori_loop(0, chunks, body, nothing)
        scores = transform.T @ scores
        return squares, transform.T @ normal @ transform, jnp.sum(scores, axis=1), scores

    def _one_chunk(
        self,
        values: JaxArray,
        recordings: tuple[JaxArray, JaxArray],
        horizon: JaxArray,
        windows: tuple[JaxArray, JaxArray],
        sums: tuple[JaxArray, JaxArray],
    ) -> tuple[JaxArray, JaxArray, JaxArray]:
        (states, inputs), (starts, used) = recordings, windows
        shared = jnp.broadcast_to(values[:, None], (values.shape[0], CHUNK))

        def step(k: JaxArray, history: JaxArray) -> tuple[JaxArray, Any]:
            drive = _drive(inputs, starts + k)

            def predict(own: JaxArray, history: JaxArray) -> JaxArray:
                return self.predictor.step(self.layout.model(own), history, drive)

            return jax.vjp(predict, shared, history)

        def visit(k: JaxArray, history: JaxArray, pull: Any, carry: Any) -> Any:
            sensitivity, scores, normal, squares = carry
            residual = self.residual(states[:, starts + k + 1], history[0]) * used
            sensitivity = _advance(sensitivity, pull, history)
            scaled = sensitivity[0] * (used / jnp.asarray(self.scale)[:, None])[:, None]
            scores = scores + jnp.sum(scaled * residual[:, None], axis=0)
            normal = normal + jnp.einsum("sib,sjb->ij", scaled, scaled)
            return sensitivity, scores, normal, squares + jnp.sum(residual**2)

        start = _history(states, starts, self.predictor.past)
        blank = jnp.zeros((*start.shape[:2], *shared.shape), values.dtype)
        carry = (blank, jnp.zeros_like(shared), *sums)
        _, scores, normal, squares = rollout(step, start, horizon, visit, carry)
        return scores, normal, squares


def _advance(sensitivity: JaxArray, pull: Any, history: JaxArray) -> JaxArray:
    """Return S_(k+1) = sum_j (dg/dx_(k-j)) S_(k-j) + dg/dtheta in front of the older ones.

    One vector-Jacobian product a state; shapes (past, state, value, batch).
    """
    rows = []
    for state in range(history.shape[1]):
        own, before = pull(jnp.zeros_like(history).at[0, state].set(1.0))
        rows.append(own + jnp.sum(before[:, :, None] * sensitivity, axis=(0, 1)))
    ahead = jnp.stack(rows)[None]
    return ahead if len(sensitivity) == 1 else jnp.concatenate([ahead, sensitivity[:-1]])


def _history(states: JaxArray, at: JaxArray, past: int) -> JaxArray:
    """Return the measured states (past, state, batch) at and before samples `at`, newest first."""
    return jnp.stack([states[:, at - j] for j in range(past)])


def _drive(inputs: JaxArray, at: JaxArray) -> Drive:
    return lambda offset: inputs[:, at + offset]


def _recordings(windows: Windows) -> tuple[JaxArray, JaxArray]:
    return jnp.asarray(windows.states.T), jnp.asarray(windows.inputs.T)


def _padded(windows: Windows) -> JaxArray:
    """Return the starts at a length that the recordings alone decide: one shape a ladder.

    The last window pads: a rollout from elsewhere could overflow, and zero times that is nan.
    """
    capacity = CHUNK * -(-len(windows.states) // CHUNK)
    starts: IntArray = np.full(capacity, windows.starts[-1], dtype=np.int64)
    starts[: len(windows.starts)] = windows.starts
    return jnp.asarray(starts)
