"""Networks against plain NumPy, their Jacobians against three other ways, and the convexity."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from penode.arrays import float64
from penode.models.layout import Layout
from penode.models.networks import ConvexGradient, TanhLayers, dense
from penode.models.parameters import with_batch_axis


def layers(network, x):
    """Evaluate a `TanhLayers` without batch axis at columns x (n, batch), real or complex."""
    for weights, bias in zip(network.weights[:-1], network.biases[:-1], strict=True):
        x = np.tanh(weights @ x + bias[:, None])
    return network.weights[-1] @ x + network.biases[-1][:, None]


def gradient(network, x):
    """Evaluate a `ConvexGradient` without batch axis at columns x (n, batch), real or complex."""
    pull = network.gain[:, None] * np.tanh(network.directions @ x + network.bias[:, None])
    return network.offset[:, None] + network.stiffness @ x + network.directions.T @ pull


def convex(inputs, units, seed):
    """Draw a network whose offset, unlike a fresh one's, is not zero."""
    offset = np.linspace(0.2, -0.3, inputs)
    return replace(ConvexGradient.random(inputs, units, seed), offset=offset)


#: name -> network, its evaluation in NumPy, its number of inputs
NETWORKS = {
    "paper": (TanhLayers.random((2, 6, 4, 2), 3), layers, 2),
    "one hidden layer": (TanhLayers.random((1, 5, 3), 3), layers, 1),
    "convex": (convex(2, 12, 3), gradient, 2),
    "convex in three inputs": (convex(3, 4, 3), gradient, 3),
}
over_networks = pytest.mark.parametrize(
    ("network", "plain", "inputs"), NETWORKS.values(), ids=NETWORKS
)


@jax.jit
def evaluate(leaves, x):
    """Return value and Jacobian of the batched network whose leaves come."""
    return leaves.value_and_jacobian(x)


@jax.jit
def forward_mode(leaves, x):
    """Return the Jacobian of the value (m, n, batch), by JAX."""

    def one(column):
        return leaves.value_and_jacobian(column[:, None])[0][:, 0]

    return jax.vmap(jax.jacfwd(one), in_axes=1, out_axes=2)(x)


def complex_steps(plain, network, x):
    """Return the Jacobian of the NumPy twin (m, n, batch), to the last digit."""
    shifts = 1e-30j * np.eye(len(x))[:, :, None]
    return np.stack([plain(network, x + shift).imag / 1e-30 for shift in shifts], axis=1)


def central_differences(plain, network, x, step=1e-4):
    shifts = step * np.eye(len(x))[:, :, None]
    slopes = [(plain(network, x + s) - plain(network, x - s)) / (2 * step) for s in shifts]
    return np.stack(slopes, axis=1)


@over_networks
def test_shared_parameters(network, plain, inputs, rng):
    x = rng.uniform(-2, 2, (inputs, 200))
    with float64():
        value, jacobian = evaluate(with_batch_axis(network), x)
        by_jax = forward_mode(with_batch_axis(network), x)
    np.testing.assert_allclose(value, plain(network, x), rtol=0, atol=1e-14)
    np.testing.assert_allclose(jacobian, by_jax, rtol=0, atol=1e-13)
    np.testing.assert_allclose(jacobian, complex_steps(plain, network, x), rtol=0, atol=1e-13)
    by_differences = central_differences(plain, network, x)
    np.testing.assert_allclose(jacobian, by_differences, rtol=0, atol=3e-7)


@over_networks
def test_each_batch_member_has_its_own_parameters(network, plain, inputs, rng):
    x = rng.uniform(-2, 2, (inputs, 7))
    spread = [np.asarray(leaf)[..., None] for leaf in jax.tree.leaves(network)]
    batched = [leaf * rng.uniform(0.5, 1.5, (*leaf.shape[:-1], 7)) for leaf in spread]
    structure = jax.tree.structure(network)
    with float64():
        value, jacobian = evaluate(jax.tree.unflatten(structure, batched), x)
    for k in range(7):
        member = jax.tree.unflatten(structure, [leaf[..., k] for leaf in batched])
        at = x[:, k : k + 1]
        np.testing.assert_allclose(value[:, k : k + 1], plain(member, at), rtol=0, atol=1e-13)
        expected = complex_steps(plain, member, at)
        np.testing.assert_allclose(jacobian[:, :, k : k + 1], expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("given", [True, False])
def test_features_are_further_inputs_of_layers(given, rng):
    """The Jacobian is that of the map's own inputs, by complex steps."""
    network, tiny = TanhLayers.random((2 + 4, 12, 6, 2), 5), 1e-30
    x, features = rng.normal(size=(2, 9)), rng.normal(size=(4, 9)) if given else np.zeros((4, 9))
    with float64():
        batched = with_batch_axis(network)
        value, jacobian = batched.value_and_jacobian(
            jax.numpy.asarray(x), jax.numpy.asarray(features) if given else None
        )
    both = np.concatenate([x, features])
    np.testing.assert_allclose(value, layers(network, both), rtol=1e-12, atol=1e-14)
    steps = 1j * tiny * np.eye(6)[:2, :, None]
    known = np.stack([layers(network, both + step).imag / tiny for step in steps], axis=1)
    np.testing.assert_allclose(jacobian, known, rtol=1e-11, atol=1e-13)


def test_dense_multiplies_columns_and_matrices(rng):
    shared, own = rng.normal(size=(3, 2, 1)), rng.normal(size=(3, 2, 6))
    matrices = rng.normal(size=(2, 4, 6))
    with float64():
        for weights in (shared, own):
            full = np.broadcast_to(weights, (3, 2, 6))
            columns = dense(weights, matrices[:, 0])
            np.testing.assert_allclose(columns, np.einsum("ijb,jb->ib", full, matrices[:, 0]))
            product = dense(weights, matrices)
            np.testing.assert_allclose(product, np.einsum("ijb,jkb->ikb", full, matrices))


@pytest.mark.parametrize(
    "draw", [lambda s: TanhLayers.random((2, 6, 2), s), lambda s: ConvexGradient.random(2, 5, s)]
)
def test_draws_are_set_by_their_seed(draw):
    first, again, other = (Layout(n).raw(n) for n in (draw(5), draw(5), draw(6)))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_layers_are_drawn_within_the_common_bound():
    network = TanhLayers.random((16, 300, 4), seed=0)
    for weights, bias in zip(network.weights, network.biases, strict=True):
        bound = 1 / np.sqrt(weights.shape[1])
        for values in (weights, bias):
            assert np.abs(values).max() <= bound
        assert np.abs(weights).max() > 0.99 * bound


# --- the convex network -----------------------------------------------------------------------


def test_convex_value_is_the_gradient_of_its_scalar(rng):
    network, x, step = convex(2, 12, seed=1), rng.uniform(-3, 3, (2, 200)), 1e-20

    def scalar(x):
        linear = network.offset @ x + np.sum(x * (network.stiffness @ x), axis=0) / 2
        z = network.directions @ x + network.bias[:, None]
        return linear + network.gain @ np.log(np.cosh(z))

    expected = [scalar(x + 1j * step * shift).imag / step for shift in np.eye(2)[:, :, None]]
    with float64():
        value, _ = evaluate(with_batch_axis(network), x)
    np.testing.assert_allclose(value, expected, rtol=0, atol=1e-13)


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), spread=st.floats(0.0, 3.0), reach=st.floats(0.01, 1e3))
def test_convex_hessian_is_symmetric_positive_definite_everywhere(seed, spread, reach):
    random = np.random.default_rng(seed)
    offset, directions, bias, gain, factor = (
        spread * random.normal(size=shape) for shape in ((2,), (5, 2), (5,), (5,), (2, 2))
    )
    stiffness = factor @ factor.T + 1e-3 * np.eye(2)
    network = ConvexGradient(offset, stiffness, directions, bias, np.exp(gain))
    x = random.normal(size=(2, 40)) * reach
    with float64():
        hessian = np.asarray(evaluate(with_batch_axis(network), x)[1])
    np.testing.assert_array_equal(hessian[0, 1], hessian[1, 0])
    softest = np.linalg.eigvalsh(network.stiffness).min()
    assert softest > 0
    eigenvalues = np.linalg.eigvalsh(np.moveaxis(hessian, -1, 0))
    assert (eigenvalues.min(axis=1) >= softest - 1e-12 * np.abs(hessian).max()).all()


def test_wide_weights_that_all_columns_share_multiply_as_others_do():
    random = np.random.default_rng(0)
    weights = random.normal(size=(20, 30, 1))
    with float64():
        for x in (random.normal(size=(30, 6)), random.normal(size=(30, 2, 6))):
            by_hand = np.einsum("mn,n...->m...", weights[..., 0], x)
            assert np.asarray(dense(jnp.asarray(weights), jnp.asarray(x))) == pytest.approx(by_hand)
            own = jnp.asarray(np.broadcast_to(weights, (20, 30, 6)))
            assert np.asarray(dense(own, jnp.asarray(x))) == pytest.approx(by_hand)
