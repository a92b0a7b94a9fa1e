"""What a learned part adds to the derivative: its slopes by the parameters."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

from penode import Model, physical
from penode.arrays import Leaf, float64
from penode.engine import Spline, TanhLayers
from penode.models.inputs import Inputs
from penode.models.layout import Layout
from penode.training.learned_effect import LearnedEffect, Visits

STATES = np.linspace(-2.0, 2.0, 5)
VISITS = Visits(np.stack([STATES, STATES**2], axis=1), np.ones((5, 1)))


class Coupled(Model):
    """Two states; what is learned of the first acts on both."""

    states: ClassVar[tuple[str, ...]] = ("x", "v")
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("m", "m/s")

    curve: TanhLayers | Spline
    rate: Leaf = physical("1/s")

    def derivative(self, x, u):
        force = self.curve.value_and_jacobian(x[:1])[0][0]
        return jnp.stack([x[1] - force, u[0] - self.rate * x[1] - force * x[1]])


@pytest.mark.parametrize(
    "curve",
    [TanhLayers.random((1, 3, 1), seed=3), Spline.zero((-3.0,), (3.0,), (4,), 1)],
    ids=["network", "spline"],
)
def test_slopes_by_the_values_are_those_of_finite_differences(curve):
    model = Coupled(curve, 0.5)
    layout = Layout(model)
    raw = layout.raw(model)
    effect = LearnedEffect.of(layout, raw, VISITS)
    slopes = effect.by_values(VISITS)
    assert slopes.shape == (2, 5, layout.size)

    def rates(values):
        with float64():
            x, u = (jnp.asarray(part.T) for part in (VISITS.states, VISITS.inputs))
            made = layout.model(jnp.asarray(values)[:, None])
            return np.asarray(made.derivative(x, Inputs(u, ("u",))))

    for k in range(layout.size):
        step = 1e-6 * np.eye(layout.size)[k]
        difference = (rates(raw + step) - rates(raw - step)) / 2e-6 / effect.scale[:, None]
        assert slopes[..., k] == pytest.approx(difference, rel=1e-6, abs=1e-8)
