"""The table against the coenergy it samples, and against the laws it has to keep."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from penode.bench.coenergy_table import tabulate, true_flux_map
from penode.bench.machines import TRACTION_300A, torque
from penode.errors import InputError


def coenergy(current, theta):
    return TRACTION_300A.coenergy(current[0], current[1], theta)


@pytest.fixture(scope="module")
def points():
    rng = np.random.default_rng(3)
    radius = 1.2 * TRACTION_300A.current_limit * np.sqrt(rng.random(5000))
    direction = rng.uniform(0.0, 2 * np.pi, 5000)
    currents = np.stack([radius * np.cos(direction), radius * np.sin(direction)], axis=1)
    return currents, rng.uniform(-10.0, 10.0, 5000)


def at(function, points):
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, jax.jit(jax.vmap(function))(*map(jnp.asarray, points)))


def test_table_error_is_the_documented_one(points):
    flux = at(tabulate(TRACTION_300A), points)
    psi = jax.grad(coenergy)
    np.testing.assert_allclose(flux.linkage, at(psi, points), atol=1e-10, rtol=0)
    np.testing.assert_allclose(flux.inductance, at(jax.jacfwd(psi), points), atol=1e-10, rtol=0)
    slope = at(jax.jacfwd(psi, argnums=1), points)
    np.testing.assert_allclose(flux.angle_slope, slope, atol=1e-10, rtol=0)


def test_inductance_and_slope_are_the_derivatives_of_the_tables_own_flux(points):
    table = tabulate(TRACTION_300A)
    flux = at(table, points)
    by_current = at(jax.jacfwd(lambda i, theta: table(i, theta).linkage), points)
    by_angle = at(jax.jacfwd(lambda i, theta: table(i, theta).linkage, argnums=1), points)
    np.testing.assert_allclose(flux.inductance, by_current, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(flux.angle_slope, by_angle, rtol=1e-9, atol=1e-15)


def test_table_is_reciprocal_and_positive_definite(points):
    inductance = at(tabulate(TRACTION_300A), points).inductance
    assert np.array_equal(inductance[:, 0, 1], inductance[:, 1, 0])
    assert np.linalg.eigvalsh(inductance).min() > 120e-6


def test_inductance_has_no_jump_where_cells_meet():
    table = tabulate(TRACTION_300A)
    node = np.array([-40 * table.spacing, 30 * table.spacing])
    sides = (np.stack([node - 1e-9, node + 1e-9]), np.full(2, 0.3))
    below, above = at(table, sides).inductance
    np.testing.assert_allclose(below, above, atol=1e-14)


def test_sixty_degrees_are_a_period(points):
    currents, theta = points
    table = tabulate(TRACTION_300A)
    one, next_one = at(table, (currents, theta)), at(table, (currents, theta + np.pi / 3))
    np.testing.assert_allclose(one.linkage, next_one.linkage, atol=1e-15)


def test_true_flux_map_is_the_mean_over_the_angle():
    i_d, i_q = np.meshgrid(np.linspace(-300, 300, 7), np.linspace(-300, 300, 5), indexing="ij")
    currents = np.stack([i_d, i_q], axis=-1).reshape(-1, 2)
    turn = np.linspace(0.0, 2 * np.pi, 36, endpoint=False)
    pairs = (np.repeat(currents, 36, axis=0), np.tile(turn, len(currents)))
    mean = at(jax.grad(coenergy), pairs).reshape(-1, 36, 2).mean(axis=1)
    found = true_flux_map(TRACTION_300A, i_d, i_q)
    assert found.dtype == np.float64
    np.testing.assert_allclose(found.reshape(-1, 2), mean, atol=1e-10)


def test_true_flux_map_refuses_currents_outside_its_table():
    with pytest.raises(InputError, match=r"traction_300A: .* at most the 375 A .* got 400 A"):
        true_flux_map(TRACTION_300A, np.array([-400.0]), np.array([0.0]))


def test_coenergy_and_its_slope_are_those_of_the_machine(points):
    table = tabulate(TRACTION_300A)
    np.testing.assert_allclose(at(table.coenergy, points), at(coenergy, points), atol=1e-10, rtol=0)
    slope = at(jax.grad(coenergy, argnums=1), points)
    np.testing.assert_allclose(at(table.coenergy_angle_slope, points), slope, atol=1e-9, rtol=0)


def test_flux_and_angle_slope_derive_from_the_tables_own_coenergy(points):
    table = tabulate(TRACTION_300A)
    flux = at(table, points)
    np.testing.assert_allclose(at(jax.grad(table.coenergy), points), flux.linkage, atol=1e-14)
    by_current = at(jax.grad(table.coenergy_angle_slope), points)
    np.testing.assert_allclose(by_current, flux.angle_slope, atol=1e-14)
    by_angle = at(jax.grad(table.coenergy, argnums=1), points)
    np.testing.assert_allclose(at(table.coenergy_angle_slope, points), by_angle, atol=1e-12)


def test_torque_from_the_table_is_cross_product_plus_angle_term(points):
    table, (currents, theta) = tabulate(TRACTION_300A), points
    psi, slope = at(table, points).linkage, at(table.coenergy_angle_slope, points)
    cross = psi[:, 0] * currents[:, 1] - psi[:, 1] * currents[:, 0]
    expected = torque(TRACTION_300A, *currents.T, theta)
    found = 1.5 * TRACTION_300A.pole_pairs * (cross + slope)
    np.testing.assert_allclose(found, expected, atol=1e-6)
