"""Adam and other first-order optimisers, through optax."""

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
import optax

from penode.arrays import FloatArray, float64
from penode.training.plan import DIVERGED, Problem, Progress, Solution, silent


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

    transformation: optax.GradientTransformation = optax.adam(1e-3)  # noqa: RUF009 (pure functions)
    epochs: int = 100
    batches: int = 20
    seed: int = 0
    physical_scale: float = 1.0

    def minimise(self, problem: Problem, raw: FloatArray, progress: Progress = silent) -> Solution:
        """Lower the loss from `raw` (parameter,); the last parameters are given back.

        Returns
        -------
        Solution
            Ends early, with the parameters before it, when the loss is not finite.
        """
        layout = problem.objective.layout
        groups = ("physical",) if layout.physical else ()
        scale = np.where(layout.members(groups), self.physical_scale, 1.0)
        random = np.random.default_rng(self.seed)
        with float64():
            state = self.transformation.init(jnp.asarray(raw / scale))
        sound = raw
        for epoch in range(self.epochs):
            order = random.permutation(len(problem.windows.starts))
            for batch in np.array_split(order, min(self.batches, len(order))):
                loss, gradient = self._gradient(problem, raw, np.sort(batch))
                if not np.isfinite(loss):
                    return Solution(sound, problem.gauss_newton(sound), epoch, DIVERGED)
                sound = raw
                with float64():
                    step, state = self.transformation.update(
                        jnp.asarray(gradient * scale), state, jnp.asarray(raw / scale)
                    )
                raw = raw + np.asarray(step) * scale * problem.moving
            progress(raw, loss)
        terms = problem.gauss_newton(raw)
        if not terms.finite:
            return Solution(sound, problem.gauss_newton(sound), self.epochs, DIVERGED)
        return Solution(raw, terms, self.epochs, "The epochs are used up.")

    def _gradient(
        self, problem: Problem, raw: FloatArray, batch: FloatArray
    ) -> tuple[float, FloatArray]:
        windows = problem.windows
        part = replace(windows, starts=windows.starts[batch], recording=windows.recording[batch])
        return problem.objective.loss_and_gradient(raw, part)
