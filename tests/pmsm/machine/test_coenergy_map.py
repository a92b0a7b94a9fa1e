"""The map of splines: one coenergy at every angle, mirror symmetry, the linear machine."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from penode.arrays import float64
from penode.data.experiment import Experiment
from penode.data.windows import cut
from penode.models.parameters import with_batch_axis
from penode.pmsm.machine.coenergy_map import (
    HESSIAN,
    CoenergyPart,
    CoenergySplines,
    columns,
    roughness,
)
from penode.pmsm.machine.flux_maps import FluxMap
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.terms import Resistance
from penode.predictors.base import Predictor
from penode.training.residuals import Objective

ORDERS = (6, 12)


def drawn(part, rng):
    return replace(part, coefficients=rng.normal(size=part.coefficients.shape))


@pytest.fixture
def network(rng):
    even, odd = (drawn(CoenergyPart.zero(*size), rng) for size in ((15, True), (7, False)))
    waves = (drawn(CoenergyPart.zero(7, parity, len(ORDERS)), rng) for parity in (True, False))
    cosine, sine = waves
    return CoenergySplines((even, odd), (cosine,), (sine,))


@jax.jit
def compiled_at(flux, x, theta):
    return with_batch_axis(flux).at_angle(x, theta)


def at(network, x, theta):
    with float64():
        found = compiled_at(FluxMap(network, 1.0, 1.0, ORDERS), x, theta)
        return tuple(np.asarray(part) for part in found)


def test_jacobian_and_slope_over_the_angle_are_derivatives(network, rng):
    x, theta = rng.uniform(-1.2, 1.2, (2, 8)), rng.uniform(0, 6.0, 8)
    _, inductance, turning = at(network, x, theta)
    h = 1e-6
    for k in range(2):
        step = h * np.eye(2)[:, k : k + 1]
        slope = (at(network, x + step, theta)[0] - at(network, x - step, theta)[0]) / (2 * h)
        np.testing.assert_allclose(inductance[:, k], slope, rtol=1e-6, atol=1e-6)
    slope = (at(network, x, theta + h)[0] - at(network, x, theta - h)[0]) / (2 * h)
    np.testing.assert_allclose(turning, slope, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(inductance[0, 1], inductance[1, 0], rtol=1e-12)


@pytest.mark.parametrize("reach", [1.2, 0.01])
@pytest.mark.parametrize("columns_of_their_own", [False, True])
def test_reverse_mode_is_the_slope_of_all_that_a_map_returns(
    network, rng, columns_of_their_own, reach
):
    with float64():
        flux = with_batch_axis(FluxMap(network, 1.0, 1.0, ORDERS))
        if columns_of_their_own:
            flux = jax.tree.map(lambda leaf: np.repeat(leaf, 8, axis=-1), flux)
        x, theta = reach * rng.uniform(-1, 1, (2, 8)), jnp.asarray(rng.uniform(0, 6.0, 8))
        weights = [rng.normal(size=shape) for shape in ((2, 8), (2, 2, 8), (2, 8))]
        point = (flux, jnp.asarray(x))
        along = jax.tree.map(lambda leaf: rng.normal(size=np.shape(leaf)), point)

        @jax.jit
        def total(point):
            returned = point[0].at_angle(point[1], theta)
            return sum(jnp.sum(w * part) for w, part in zip(weights, returned, strict=True))

        def moved(step):
            return total(jax.tree.map(lambda leaf, way: leaf + step * way, point, along))

        slopes = jax.tree.leaves(jax.jit(jax.grad(total))(point))
        found = sum(np.sum(s * w) for s, w in zip(slopes, jax.tree.leaves(along), strict=True))
        wanted = float(moved(1e-6) - moved(-1e-6)) / 2e-6
    assert float(found) == pytest.approx(wanted, rel=1e-7)


def test_a_machine_without_skew_mirrors_its_flux(network, rng):
    symmetric = replace(network, mean=network.mean[:1])
    x, theta = rng.uniform(-1.0, 1.0, (2, 8)), rng.uniform(0, 6.0, 8)
    mirror = np.array([[1.0], [-1.0]])
    there, here = at(symmetric, mirror * x, -theta)[0], at(symmetric, x, theta)[0]
    np.testing.assert_allclose(there, mirror * here, atol=1e-12)
    assert (
        np.abs(at(network, mirror * x, -theta)[0] - mirror * at(network, x, theta)[0]).max() > 0.1
    )


def test_the_angle_average_is_the_map_without_waves(network, rng):
    x = rng.uniform(-1.0, 1.0, (2, 4))
    turn = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    every = [at(network, x, np.full(4, angle))[0] for angle in turn]
    flux = FluxMap(network, 1.0, 1.0, ORDERS)
    mean_of = jax.jit(lambda flux: with_batch_axis(flux).flux_and_inductance(jnp.asarray(x))[0])
    with float64():
        mean, averaged = mean_of(flux), mean_of(flux.averaged())
    np.testing.assert_allclose(np.mean(every, axis=0), mean, atol=1e-12)
    np.testing.assert_array_equal(averaged, mean)


@pytest.mark.parametrize("even", [True, False])
def test_columns_are_what_each_coefficient_adds(even, rng):
    part = drawn(CoenergyPart.zero(7, even), rng)
    points = rng.uniform(-1.3, 1.3, (6, 2))
    gradient, hessian = columns(part, points), columns(part, points, HESSIAN)
    weights = part.coefficients.ravel()
    with float64():
        network = with_batch_axis(CoenergySplines((part,)))
        value, slopes = jax.jit(lambda x: network.value_and_jacobian(x))(points.T)
    np.testing.assert_allclose(gradient @ weights, np.asarray(value).T, atol=1e-12)
    rows = np.stack([slopes[0, 0], slopes[0, 1], slopes[1, 1]])
    np.testing.assert_allclose(hessian @ weights, rows.T, atol=1e-11)


@pytest.mark.parametrize(("even", "flat"), [(True, 4), (False, 2)])
def test_only_a_linear_machine_has_no_roughness(even, flat):
    """Even: a constant, i_d, i_d^2, i_q^2. Odd: i_q and i_d i_q."""
    matrix = roughness(CoenergyPart.zero(9, even))
    eigenvalues = np.linalg.eigvalsh(matrix)
    assert np.sum(eigenvalues < 1e-11 * eigenvalues[-1]) == flat
    linear = CoenergySplines.linear().mean[0].coefficients.ravel()
    wide = roughness(CoenergyPart.zero(15, True))
    assert linear @ wide @ linear < 1e-12 * np.trace(wide) * linear @ linear


def test_an_odd_part_has_no_direction_without_roughness_of_the_first_orders():
    part = CoenergyPart.zero(7, False)
    assert np.linalg.matrix_rank(roughness(part)) == part.coefficients.size - 2
    assert np.linalg.matrix_rank(roughness(part, (1, 2, 3))) == part.coefficients.size


def test_roughness_is_the_integral_of_squared_third_derivatives(rng):
    part = drawn(CoenergyPart.zero(6, True), rng)
    weights = part.coefficients.ravel()
    grid = np.linspace(-1.0, 1.0, 801)
    middle = (grid[1:] + grid[:-1]) / 2
    points = np.stack(np.meshgrid(middle, middle, indexing="ij"), axis=-1).reshape(-1, 2)

    def curvatures(x):
        hessian = with_batch_axis(CoenergySplines((part,))).value_and_jacobian(x)[1]
        return jnp.stack([hessian[0, 0], hessian[0, 1], hessian[1, 1]])

    with float64():
        x = jnp.asarray(points.T)
        ones = jnp.ones(len(points))
        zeros = jnp.zeros(len(points))
        slope = jax.jit(lambda way: jax.jvp(curvatures, (x,), (way,))[1])
        ways = jnp.stack([ones, zeros]), jnp.stack([zeros, ones])
        by_d, by_q = (np.asarray(slope(way)) for way in ways)
    squares = by_d[0] ** 2 + 3 * by_d[1] ** 2 + 3 * by_d[2] ** 2 + by_q[2] ** 2
    integral = float(np.sum(squares)) * (grid[1] - grid[0]) ** 2
    assert weights @ roughness(part) @ weights == pytest.approx(integral, rel=1e-3)


def test_the_linear_map_is_linear_everywhere(rng):
    x = rng.uniform(-2.0, 2.0, (2, 20))
    network = with_batch_axis(CoenergySplines.linear())
    with float64():
        value, slope = jax.jit(lambda x: network.value_and_jacobian(x))(x)
    np.testing.assert_allclose(value, 0.3 * x, atol=1e-9)
    np.testing.assert_allclose(slope, np.tile(0.3 * np.eye(2)[..., None], 20), atol=1e-9)


def test_sensitivities_of_the_whole_machine_are_slopes_of_its_loss(network, rng):
    inputs = ("u_d", "u_q", "omega_el", "theta_el")
    time = np.arange(80.0)
    channels = {name: 5.0 * rng.normal(size=80) for name in ("i_d", "i_q", "u_d", "u_q")}
    channels |= {"omega_el": np.full(80, 900.0), "theta_el": 0.09 * time}
    run = Experiment("drawn", 1e-4, channels)
    small = jax.tree.map(lambda leaf: 0.01 * leaf, network)
    mean = (CoenergySplines.linear().mean[0], small.mean[1])
    flux = FluxMap(replace(small, mean=mean), 10.0, 0.1, ORDERS)
    machine = Machine(flux, (Resistance(R=0.1),))
    objective = Objective(Predictor(1e-4), machine, np.ones(2))
    windows = cut([run], machine.states, inputs, 3)
    raw = objective.layout.raw(machine)
    way = 1e-6 * rng.normal(size=len(raw))
    terms = objective.gauss_newton(raw, windows)
    above, below = (objective.gauss_newton(raw + s * way, windows).loss for s in (1.0, -1.0))
    slope = -2 * terms.descent @ way / terms.count
    assert slope == pytest.approx((above - below) / 2, rel=1e-6)
