"""What every learned map keeps: its Jacobian, its batch axis, its place in a layout."""

import jax
import numpy as np
import pytest

from penode.arrays import float64
from penode.models.compositions import Gradient, LinearSkip, Scaled
from penode.models.layout import Layout
from penode.models.networks import ConvexGradient, TanhLayers
from penode.models.parameters import with_batch_axis
from penode.models.polynomials import Polynomial
from penode.models.splines import Spline


def moved(network, size=0.3):
    """Return the map with seeded noise on every raw parameter, so that none is zero."""
    layout = Layout(network)
    with float64():
        noise = np.random.default_rng(7).normal(size=layout.size)
        return layout.plain_model(layout.raw(network) + size * noise)


def spline(outputs):
    return Spline.zero((-1.0, -2.0), (1.5, 1.0), (5, 4), outputs)


def skip(network, outputs, inputs):
    return LinearSkip(network, np.zeros((outputs, inputs)), np.zeros(outputs))


#: Columns of every evaluation, so that each map is compiled once.
BATCH = 20

#: name -> map, its number of inputs
MAPS = {
    "convex": (ConvexGradient.random(2, 4, 3), 2),
    "polynomial": (Polynomial.zero(3, 2, 3), 3),
    "spline of one input": (Spline.zero((-1.0,), (1.5,), (6,), 3), 1),
    "spline": (spline(2), 2),
    "tanh and linear": (skip(TanhLayers.random((2, 5, 3), 1), 3, 2), 2),
    "gradient of a spline": (Gradient(spline(1)), 2),
    "gradient of tanh": (Gradient(TanhLayers.random((3, 5, 1), 2)), 3),
    "scaled": (Scaled(Polynomial.zero(2, 3, 3), (2.0, 0.5), (3.0, -0.1, 1.0)), 2),
    "all at once": (
        skip(Scaled(Gradient(Scaled(spline(1), (0.7, 1.3), (2.0,))), (2, 0.5), (3, 1)), 2, 2),
        2,
    ),
}
GRADIENTS = {name: pair for name, pair in MAPS.items() if isinstance(pair[0], Gradient)}


def over(maps):
    return pytest.mark.parametrize(("network", "inputs"), maps.values(), ids=maps)


@jax.jit
def evaluate(network, x):
    """Return value, Jacobian, and the Jacobian by JAX, of a map with parameters shared."""

    def one(column):
        return network.value_and_jacobian(column[:, None])[0][:, 0]

    by_jax = jax.vmap(jax.jacfwd(one), in_axes=1, out_axes=2)(x)
    return *network.value_and_jacobian(x), by_jax


@jax.jit
def evaluate_own(network, x):
    """Return value and Jacobian of a map with parameters for each column."""
    return network.value_and_jacobian(x)


def differences(function, x, step):
    """Return the slopes of a function of columns, an axis of inputs before the last one."""
    shifts = step * np.eye(len(x))[:, :, None]
    slopes = [(function(x + shift) - function(x - shift)) / (2 * step) for shift in shifts]
    return np.stack(slopes, axis=-2)


@over(MAPS)
def test_the_jacobian_is_the_derivative_of_the_value(network, inputs, rng):
    x = rng.uniform(-1.8, 1.8, (inputs, BATCH))
    with float64():
        batched = with_batch_axis(moved(network))
        value, jacobian, by_jax = evaluate(batched, x)
        by_differences = differences(lambda x: np.asarray(evaluate(batched, x)[0]), x, 1e-5)
    assert value.shape == (len(value), BATCH)
    assert jacobian.shape == (len(value), inputs, BATCH)
    assert value.dtype == jacobian.dtype == np.float64
    size = max(np.abs(jacobian).max(), 1.0)
    np.testing.assert_allclose(jacobian, by_jax, rtol=0, atol=1e-13 * size)
    np.testing.assert_allclose(jacobian, by_differences, rtol=0, atol=1e-8 * size)


@over(MAPS)
def test_each_batch_member_has_its_own_parameters(network, inputs, rng):
    x = rng.uniform(-1.8, 1.8, (inputs, BATCH))
    leaves, structure = jax.tree.flatten(moved(network))
    own = [leaf[..., None] * rng.uniform(0.5, 1.5, (*leaf.shape, BATCH)) for leaf in leaves]
    with float64():
        value, jacobian = evaluate_own(jax.tree.unflatten(structure, own), x)
        for k in range(0, BATCH, 5):
            member = jax.tree.unflatten(structure, [leaf[..., k : k + 1] for leaf in own])
            alone, slope, _ = evaluate(member, x)
            np.testing.assert_allclose(value[:, k], alone[:, k], rtol=0, atol=1e-12)
            np.testing.assert_allclose(jacobian[..., k], slope[..., k], rtol=0, atol=1e-12)


@over(MAPS)
def test_a_layout_round_trips(network, inputs, rng):
    network = moved(network)
    layout = Layout(network)
    with float64():
        back = layout.plain_model(layout.raw(network))
    assert jax.tree.structure(back) == jax.tree.structure(network)
    assert hash(jax.tree.structure(back)) == hash(jax.tree.structure(network))
    for found, leaf in zip(jax.tree.leaves(back), jax.tree.leaves(network), strict=True):
        np.testing.assert_allclose(found, leaf, rtol=1e-13)
    assert layout.size > 0
    assert {setting.group for setting in layout.settings} == {"learned"}


@over(GRADIENTS)
def test_a_gradient_is_reciprocal_and_its_jacobian_is_the_hessian(network, inputs, rng):
    x, step = rng.uniform(-1.8, 1.8, (inputs, BATCH)), 1e-3
    batched = with_batch_axis(moved(network))

    def potential(x):
        return np.asarray(evaluate(batched.potential, x)[0])[0]

    with float64():
        value, hessian, _ = evaluate(batched, x)
        slope = differences(potential, x, step)
        curvature = differences(lambda x: differences(potential, x, step), x, step)
    np.testing.assert_allclose(value, slope, rtol=0, atol=1e-5)
    np.testing.assert_allclose(hessian, curvature, rtol=0, atol=1e-4)
    size = np.abs(hessian).max()
    np.testing.assert_allclose(hessian, np.swapaxes(hessian, 0, 1), rtol=0, atol=1e-14 * size)
