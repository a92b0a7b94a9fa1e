"""The kernels in C against their twins in JAX, and what happens where they cannot be compiled."""

import os
import shutil
import subprocess
import sys
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from penode.arrays import float64
from penode.models.spline_basis import SplineBasis
from penode.models.tensor_splines import TensorBasis, folded, jets
from penode.native import harmonics as waves
from penode.native import library
from penode.native.normal_matrix import NormalMatrix

ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
BASES = [
    TensorBasis(count, (0.5, 0.3), parities)
    for count, parities in ((15, (True,)), (7, (False,)), (7, (True, False)), (8, (False, True)))
]


pytestmark = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="no C compiler is at hand"
)


def test_with_a_compiler_the_kernels_are_there():
    assert library.available()


@pytest.fixture
def places(rng):
    """Inside, at both ends, at a break and beyond."""
    x = rng.uniform(-1.3, 1.3, (2, 20))
    x[:, :3] = 1.0, -1.0, 0.0
    return x


def reference(basis, orders, table, x):
    """Return the sum over splines of SciPy-checked bases, by NumPy alone."""
    along_d, along_q = (SplineBasis(basis.count, s) for s in basis.sharpness)
    d, q = along_d.derivatives(x[0]), along_q.derivatives(x[1])
    q = np.concatenate([folded(q, even) for even in basis.parities], axis=1)
    table = np.broadcast_to(table, (*table.shape[:2], x.shape[1]))
    return np.stack([np.einsum("ib,jb,ijb->b", d[m], q[n], table) for m, n in orders])


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("own", [False, True])
def test_jets_are_sums_over_the_splines(basis, own, places, rng):
    table = rng.normal(size=(basis.count, basis.columns, places.shape[1] if own else 1))
    with float64():
        values = jax.jit(partial(jets, basis, ORDERS))(jnp.asarray(table), jnp.asarray(places))
    wanted = reference(basis, ORDERS, table, places)
    np.testing.assert_allclose(values, wanted, atol=1e-12 * np.abs(wanted).max())


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("own", [False, True])
def test_slopes_are_those_of_the_twin(basis, own, places, rng, monkeypatch):
    """Reverse over both arguments, and along one direction, but at the ends, where slopes jump."""
    places = places[:, 2:]
    table = rng.normal(size=(basis.count, basis.columns, places.shape[1] if own else 1))
    weights = rng.normal(size=(len(ORDERS), places.shape[1]))
    with float64():
        point = jnp.asarray(table), jnp.asarray(places)

        def total(table, x):
            return jnp.sum(weights * jnp.sin(jets(basis, ORDERS, table, x)))

        def compiled():  # a function of its own each time, so that it is lowered anew
            def slopes(*point):
                along = jax.jvp(total, point, tuple(0.1 * part for part in point))[1]
                return [along, *jax.grad(total, (0, 1))(*point)]

            return jax.jit(slopes).lower(*point)

        ours = compiled()
        monkeypatch.setattr(library, "available", lambda: False)
        twins = compiled()
        assert "penode_" in ours.as_text()
        assert "penode_" not in twins.as_text()
        pairs = zip(*(one.compile()(*point) for one in (ours, twins)), strict=True)
        for mine, twin in pairs:
            np.testing.assert_allclose(mine, twin, atol=1e-10 * np.abs(twin).max())


def test_jets_are_mapped_and_differentiated_twice(places, rng):
    basis, x = BASES[0], places[:, 3:]
    with float64():
        tables = jnp.asarray(rng.normal(size=(3, basis.count, basis.columns, 1)))
        mapped = jax.vmap(lambda table: jets(basis, ORDERS, table, jnp.asarray(x)))(tables)
        for values, table in zip(mapped, tables, strict=True):
            np.testing.assert_array_equal(values, jets(basis, ORDERS, table, jnp.asarray(x)))

        def curvature(d):
            at = jnp.stack([d, jnp.asarray(x[1])])
            return jets(basis, ((2, 0),), tables[0], at)[0]

        inside = np.abs(x[0]) < 0.99
        d, step = jnp.asarray(x[0]), 1e-6
        ahead, behind = (curvature(d + s * step) for s in (1, -1))
        third = jax.jvp(curvature, (d,), (jnp.ones_like(d),))[1]
        wanted = np.asarray((ahead - behind) / (2 * step))
        np.testing.assert_allclose(
            np.asarray(third)[inside], wanted[inside], atol=1e-5 * np.abs(wanted).max()
        )


@pytest.mark.parametrize("size", [1, 7, 16, 37, 219])
@pytest.mark.parametrize("batch", [1, 32])
@pytest.mark.parametrize("zeros", [0.0, 0.4])
def test_the_normal_matrix_is_a_sum_of_products(size, batch, zeros, rng):
    start = rng.normal(size=(size, size))
    start, slopes = start + start.T, rng.normal(size=(2, size, batch))
    slopes[:, rng.uniform(size=size) < zeros] = 0.0
    slopes[0, :1] = 0.0  # zero for one output alone
    wanted = start + np.einsum("oib,ojb->ij", slopes, slopes)
    total = np.asarray(grown(start, slopes))
    np.testing.assert_allclose(total, wanted, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(total, total.T)


@pytest.mark.parametrize("wanted", [0, 1])
def test_products_that_are_taken_away_leave_what_was_before(wanted, rng):
    slopes = rng.normal(size=(2, 37, 8))
    other = rng.normal(size=(1, 37, 8))

    @jax.jit
    def left(slopes, other):
        matrix = NormalMatrix.zero(37, slopes, wanted).plus(slopes)
        return matrix.plus(other).minus(slopes).whole

    with float64():
        found = np.asarray(left(jnp.asarray(slopes), jnp.asarray(other)))
    expected = wanted * np.einsum("oib,ojb->ij", other, other)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_the_normal_matrix_stays_where_no_products_are_wanted(rng):
    start, slopes = np.eye(5), rng.normal(size=(2, 5, 8))
    np.testing.assert_array_equal(grown(start, slopes, wanted=0), start)


def test_a_slope_that_is_no_number_is_in_the_normal_matrix(rng):
    slopes = rng.normal(size=(2, 20, 8))
    slopes[1, 3] = 0.0
    slopes[1, 3, 2] = np.nan
    assert np.isnan(grown(np.zeros((20, 20)), slopes)[3]).all()


def grown(start, slopes, wanted=1):
    """Return a normal matrix with the products of slopes added."""

    @jax.jit
    def add(start, slopes):
        return NormalMatrix(start, jnp.asarray(wanted, jnp.int32)).plus(slopes).whole

    with float64():
        return np.asarray(add(jnp.asarray(start), jnp.asarray(slopes)))


def test_harmonics_and_their_slopes(rng):
    angle, orders = rng.uniform(-20, 20, 9), (1, 6, 12)
    turned = np.outer(orders, angle)
    with float64():
        values, slopes = jax.jvp(
            partial(waves.harmonics, orders), (jnp.asarray(angle),), (jnp.ones(9),)
        )
    factors = np.array(orders)[:, None]
    wanted = np.concatenate([np.cos(turned), np.sin(turned)])
    turning = np.concatenate([-factors * np.sin(turned), factors * np.cos(turned)])
    np.testing.assert_allclose(values, wanted, atol=1e-13)
    np.testing.assert_allclose(slopes, turning, atol=1e-12)


@pytest.mark.parametrize("way", ["PATH", pytest.param(library.SWITCH, marks=pytest.mark.slow)])
def test_without_a_compiler_jax_answers(way, tmp_path):
    program = (
        "from penode.native import library; from penode.native.harmonics import harmonics; "
        "import jax.numpy as jnp; print(library.available(), harmonics((2,), jnp.zeros(1))[0, 0])"
    )
    environment = {**os.environ, "HOME": str(tmp_path), library.SWITCH: "1"}
    environment[way] = {"PATH": str(tmp_path), library.SWITCH: "0"}[way]
    ran = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert ran.stdout.split() == ["False", "1.0"]
    assert not list(tmp_path.iterdir())
