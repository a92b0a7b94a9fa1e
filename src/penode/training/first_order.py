"""Adam and other first-order optimisers, through optax."""

from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, IntArray, JaxArray, float64, on_device
from penode.errors import InputError
from penode.training.plan import DIVERGED, Problem, Progress, Solution, ignore_progress
from penode.training.prediction_error import Batch, compiled_windows
from penode.training.residuals import Objective

if TYPE_CHECKING:
    import optax


@lru_cache
def adam(rate: float = 1e-3) -> "optax.GradientTransformation":
    """Return Adam of a learning rate, one object a rate: programs are compiled for it."""
    import optax  # a fifth of a second that nobody else waits for

    return optax.adam(rate)


@dataclass(frozen=True)
class FirstOrder:
    """Mini-batch descent with any optax transformation, Adam by default.

    Attributes
    ----------
    transformation : optax.GradientTransformation
        Works on the raw vector divided by `scale`.
    epochs : int
        Passes over the windows.
    batches : int
        Mini-batches a pass.
    seed : int
        Seed of the batch order.
    physical_scale : float
        Raw size of one unit of every physical parameter: 0.01 makes a step of 1e-3 move a
        resistance by 10 microohm (the paper's higher learning rate for R is a larger scale).
    """

    transformation: "optax.GradientTransformation" = field(default_factory=adam)
    epochs: int = 100
    batches: int = 20
    seed: int = 0
    physical_scale: float = 1.0

    def minimise(
        self, problem: Problem, raw: FloatArray, progress: Progress = ignore_progress
    ) -> Solution:
        """Lower the loss from `raw` (parameter,); the last parameters are given back.

        Returns
        -------
        Solution
            Ends early, with the parameters before it, when the loss is not finite.
        """
        return self.minimise_together(problem, raw[None], progress)[0]

    def minimise_together(
        self, problem: Problem, raws: FloatArray, progress: Progress = ignore_progress
    ) -> list[Solution]:
        """Lower the loss from several starts at once, in one program.

        Parameters
        ----------
        problem : Problem
        raws : ndarray, shape (start, parameter)
            Start k draws its batches with `seed` + k.
        progress : callable
            Receives the first start's parameters and loss after each epoch.

        Returns
        -------
        list of Solution
            What `minimise` would return for each; one that diverges stands still.

        Raises
        ------
        InputError
            If the recordings differ in their time step.
        """
        if problem.windows.time_steps is not None:
            raise InputError(
                "recordings must have one time step for an optimiser of first order, got several; "
                "train with LevenbergMarquardt."
            )
        layout, count = problem.objective.layout, len(problem.windows.starts)
        groups = ("physical",) if layout.physical else ()
        scale = np.where(layout.members(groups), self.physical_scale, 1.0)
        randoms = [np.random.default_rng(self.seed + k) for k in range(len(raws))]
        recipe = (problem.objective, self.transformation, problem.windows.horizon)
        with float64():
            windows = compiled_windows(problem.objective.error, problem.windows, count)
            state = jax.vmap(self.transformation.init)(on_device(raws / scale))
            finite, loss = jnp.ones(len(raws), bool), jnp.zeros(len(raws))
            at = _Descent(on_device(raws), state, on_device(raws), finite, loss)
        finished = np.zeros(len(raws), dtype=np.int64)
        for _ in range(self.epochs):
            orders = [random.permutation(count) for random in randoms]
            draws = [_batches(order, min(self.batches, count)) for order in orders]
            with float64():
                drawn = tuple(on_device(np.stack(parts)) for parts in zip(*draws, strict=True))
                at = _epoch(*recipe, at, windows, (*drawn, scale, problem.moving))
                running = np.asarray(at.finite)
            finished += running
            if not running.any():
                break
            progress(np.asarray(at.raw[0]), float(at.loss[0]))
        return [
            _solution(
                problem, np.asarray(raw), np.asarray(sound), int(epochs), bool(epochs < self.epochs)
            )
            for raw, sound, epochs in zip(at.raw, at.sound, finished, strict=True)
        ]


def _solution(
    problem: Problem, raw: FloatArray, sound: FloatArray, epochs: int, diverged: bool
) -> Solution:
    """Return the last parameters, or those before them if they diverge."""
    terms = problem.gauss_newton(sound if diverged else raw)
    if not diverged and terms.finite:
        return Solution(raw, terms, epochs, "The epochs are used up.")
    return Solution(sound, problem.gauss_newton(sound), epochs, DIVERGED)


class _Descent(NamedTuple):
    raw: JaxArray
    state: Any
    #: The last parameters whose loss was finite.
    sound: JaxArray
    finite: JaxArray
    loss: JaxArray


def _batches(order: IntArray, count: int) -> tuple[IntArray, FloatArray]:
    """Return the windows of each batch (batch, size), padded to one size, and which are in use."""
    parts = np.array_split(order, count)
    size = max(len(part) for part in parts)
    windows = np.stack([np.resize(np.sort(part), size) for part in parts])
    used = np.stack([np.arange(size) < len(part) for part in parts]).astype(np.float64)
    return windows, used


@partial(jax.jit, static_argnums=(0, 1, 2))
def _epoch(
    objective: Objective,
    transformation: "optax.GradientTransformation",
    horizon: int,
    start: _Descent,
    windows: Batch,
    draw: tuple[JaxArray, ...],
) -> _Descent:
    """Go through the batches of every start once, in one program; the diverged stand still."""
    order, used, scale, moving = draw

    def descend(at: _Descent, batch: tuple[JaxArray, JaxArray]) -> tuple[_Descent, None]:
        chosen, counts = batch
        part = windows.of_windows(windows.starts[chosen], windows.recording[chosen], counts)
        loss, gradient = objective.loss_and_gradient_of(at.raw, part, horizon)
        step, state = transformation.update(gradient * scale, at.state, at.raw / scale)
        finite = at.finite & jnp.isfinite(loss) & jnp.isfinite(gradient).all()
        ahead = _Descent(at.raw + step * scale * moving, state, at.raw, finite, loss)
        stay = at._replace(finite=finite)
        return jax.tree.map(lambda new, old: jnp.where(finite, new, old), ahead, stay), None

    def one(at: _Descent, order: JaxArray, used: JaxArray) -> _Descent:
        return jax.lax.scan(descend, at, (order, used))[0]

    ahead: _Descent = jax.vmap(one)(start, order, used)
    return ahead
