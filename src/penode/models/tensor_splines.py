"""Sums of tensor splines and their derivatives, linear in a table of coefficients.

One primitive serves values, forward and reverse mode: a slope along the places is one of the next
derivatives, a slope along the table the same sum of other coefficients, and its transpose
`products`. A kernel in C computes them where there is one, JAX where not.
"""

import functools
import operator
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from penode.arrays import FloatArray, JaxArray
from penode.models.spline_basis import DEGREE, SplineBasis, splines_of_each
from penode.native import library

Array = TypeVar("Array", FloatArray, JaxArray)

#: Derivatives along d and q, a pair each.
Orders = tuple[tuple[int, int], ...]
#: Highest derivative that the kernel has.
_HIGHEST = 3
_LANES = 8


@dataclass(frozen=True)
class TensorBasis:
    """Splines of x_d times splines of x_q, those along q folded by their symmetry."""

    count: int
    # Of the knots along d and along q.
    sharpness: tuple[float, float]
    # Columns of a table: first those even in x_q (True), say, then those odd.
    parities: tuple[bool, ...]

    @property
    def axes(self) -> tuple[SplineBasis, SplineBasis]:
        """Splines along d and q."""
        along_d, along_q = (SplineBasis(self.count, s) for s in self.sharpness)
        return along_d, along_q

    @property
    def columns(self) -> int:
        """Columns of a table."""
        return sum((self.count + even) // 2 for even in self.parities)

    @cached_property
    def pieces(self) -> FloatArray:
        """Polynomials of each cell, shape (axis, cell, power, lane), over the distance from it."""
        pieces = np.stack([axis.pieces.transpose(2, 0, 1) for axis in self.axes])
        return np.pad(pieces, [*[(0, 0)] * 3, (0, _LANES - DEGREE - 1)])

    @cached_property
    def breaks(self) -> FloatArray:
        """Ends of the cells, shape (axis, cell + 1)."""
        return np.stack([axis.breaks for axis in self.axes])


def folded(splines: Array, even: bool) -> Array:
    """Return sums or differences of mirror images: (..., count, batch) to half as many."""
    numerics: Any = np if isinstance(splines, np.ndarray) else jnp
    half = splines.shape[-2] // 2
    mirrored = splines[..., ::-1, :]
    if even:
        pairs = splines[..., :half, :] + mirrored[..., :half, :]
        middle = splines[..., half : splines.shape[-2] - half, :]
        return cast(Array, numerics.concatenate([pairs, middle], axis=-2))
    return mirrored[..., :half, :] - splines[..., :half, :]


def jets(basis: TensorBasis, orders: Orders, table: JaxArray, x: JaxArray) -> JaxArray:
    """Return derivatives (order, batch) of the sum over all splines at x (2, batch).

    An order is how often to differentiate along d and along q; the table (d, q, batch or 1) holds
    coefficients.
    """
    return cast(JaxArray, _jets_p.bind(table, x, basis=basis, orders=orders))


# --- in JAX ---------------------------------------------------------------------------------------


def _jets(table: JaxArray, x: JaxArray, basis: TensorBasis, orders: Orders) -> JaxArray:
    along_d, along_q = _along(basis, orders, x)
    rows = _added(table[None], along_q[:, None], 2)
    m, n = np.array(orders).T
    return _added(along_d[m], rows[n], 1)


def _products(cotangents: JaxArray, x: JaxArray, basis: TensorBasis, orders: Orders) -> JaxArray:
    """Return one table for each of the cotangents (many, order, batch)."""
    return jax.vmap(partial(_product, basis=basis, orders=orders), (0, None))(cotangents, x)


def _product(cotangents: JaxArray, x: JaxArray, basis: TensorBasis, orders: Orders) -> JaxArray:
    along_d, along_q = _along(basis, orders, x)
    rows = {
        n: sum(c * along_d[m] for c, (m, k) in zip(cotangents, orders, strict=True) if k == n)
        for n in {n for _, n in orders}
    }
    return cast(JaxArray, sum(row[:, None] * along_q[n] for n, row in rows.items()))


def _along(basis: TensorBasis, orders: Orders, x: JaxArray) -> tuple[JaxArray, JaxArray]:
    """Return splines along d and along q, (derivative, spline, batch)."""
    both = splines_of_each(basis.axes, x, 1 + int(np.max(orders)))
    along_q = jnp.concatenate([folded(both[:, 1], even) for even in basis.parities], axis=1)
    return both[:, 0], along_q


def _added(left: JaxArray, right: JaxArray, axis: int) -> JaxArray:
    """Return the sum of left * right over an axis, product by product: one fused loop."""
    pairs = [jax.lax.split(part, [1] * part.shape[axis], axis=axis) for part in (left, right)]
    products = [a * b for a, b in zip(*pairs, strict=True)]
    return jnp.squeeze(functools.reduce(operator.add, products), axis=axis)


# --- as primitives --------------------------------------------------------------------------------

_jets_p, _products_p = Primitive("spline_jets"), Primitive("spline_products")


def _jets_shape(table: Any, x: Any, *, basis: TensorBasis, orders: Orders) -> Any:
    return x.update(shape=(len(orders), x.shape[1]))


def _products_shape(cotangents: Any, x: Any, *, basis: TensorBasis, orders: Orders) -> Any:
    return x.update(shape=(cotangents.shape[0], basis.count, basis.columns, x.shape[1]))


def _jets_jvp(primals: Any, tangents: Any, *, basis: TensorBasis, orders: Orders) -> Any:
    (table, x), (table_dot, x_dot) = primals, tangents
    slopes = [] if isinstance(table_dot, ad.Zero) else [jets(basis, orders, table_dot, x)]
    if isinstance(x_dot, ad.Zero):
        return jets(basis, orders, table, x), slopes[0]
    if np.max(orders) == _HIGHEST:
        pure = partial(_jets, table, basis=basis, orders=orders)
        values, slope = jax.jvp(pure, (x,), (x_dot,))
        return values, sum(slopes, slope)
    further = tuple(one for m, n in orders for one in ((m + 1, n), (m, n + 1)))
    every = tuple(dict.fromkeys(orders + further))
    rows = jets(basis, every, table, x)
    # As sums over an axis: the transpose of rows taken one by one is a loop for each of them.
    at = [np.array([every.index((m + i, n + j)) for m, n in orders]) for i, j in _NEXT]
    value, *slopes_along = (rows[places] for places in at)
    along = jnp.sum(jnp.stack(slopes_along) * x_dot[:, None], axis=0)
    return value, sum(slopes, along)


#: What is added to orders of differentiation: nothing, one along d, one along q.
_NEXT = ((0, 0), (1, 0), (0, 1))


def _jets_transposed(cotangents: Any, table: Any, x: Any, **described: Any) -> Any:
    products = _products_p.bind(cotangents[None], x, **described)[0]
    if table.aval.shape[-1] == 1:
        products = jnp.sum(products, axis=-1, keepdims=True)
    return products, None


def _products_jvp(primals: Any, tangents: Any, **described: Any) -> Any:
    (cotangents, x), (cotangents_dot, x_dot) = primals, tangents
    slopes = []
    if not isinstance(cotangents_dot, ad.Zero):
        slopes.append(_products_p.bind(cotangents_dot, x, **described))
    if not isinstance(x_dot, ad.Zero):
        pure = partial(_products, cotangents, **described)
        slopes.append(jax.jvp(pure, (x,), (x_dot,))[1])
    return _products_p.bind(cotangents, x, **described), sum(slopes[1:], slopes[0])


def _products_transposed(tables: Any, cotangents: Any, x: Any, **described: Any) -> Any:
    return jnp.stack([_jets_p.bind(table, x, **described) for table in tables]), None


def _products_mapped(arguments: Any, axes: Any, **described: Any) -> Any:
    """Map over cotangents at the same places: the splines there are computed once for all."""
    (cotangents, x), (axis, axis_of_x) = arguments, axes
    if axis_of_x is not None:
        return _one_by_one(_products_p, arguments, axes, **described)
    mapped = jnp.moveaxis(cotangents, axis, 0)
    every = _products_p.bind(mapped.reshape(-1, *mapped.shape[2:]), x, **described)
    return every.reshape(*mapped.shape[:2], *every.shape[1:]), 0


def _one_by_one(primitive: Primitive, arguments: Any, axes: Any, **described: Any) -> Any:
    """Map a primitive over an axis of some of its arguments."""
    pairs = list(zip(arguments, axes, strict=True))
    mapped = [jnp.moveaxis(part, axis, 0) for part, axis in pairs if axis is not None]

    def one(parts: Any) -> Any:
        rest = iter(parts)
        whole = [part if axis is None else next(rest) for part, axis in pairs]
        return primitive.bind(*whole, **described)

    return jax.lax.map(one, mapped), 0


def _in_c(
    primitive: Primitive, pure: Callable[..., JaxArray], *arguments: Any, **named: Any
) -> Any:
    """Call the kernel, or JAX where it is not there or does not fit."""
    basis, orders = named["basis"], named["orders"]
    shape = jax.eval_shape(partial(primitive.bind, **named), *arguments)
    if shape.dtype != np.float64 or np.max(orders) > _HIGHEST or not library.available():
        return pure(*arguments, **named)
    described = np.array(orders, np.int32), np.array(basis.parities, np.int32)
    call: Callable[..., Any] = jax.ffi.ffi_call(f"penode_{primitive.name}", shape)
    return call(*arguments, basis.pieces, basis.breaks, *described)


def _define(primitive: Primitive, pure: Callable[..., JaxArray], shape: Callable[..., Any]) -> None:
    primitive.def_impl(jax.jit(primitive.bind, static_argnames=("basis", "orders")))
    primitive.def_abstract_eval(shape)
    batching.primitive_batchers[primitive] = partial(_one_by_one, primitive)
    kernel = partial(_in_c, primitive, pure)
    mlir.register_lowering(primitive, mlir.lower_fun(pure, multiple_results=False))
    mlir.register_lowering(
        primitive, mlir.lower_fun(kernel, multiple_results=False), platform="cpu"
    )


_define(_jets_p, _jets, _jets_shape)
_define(_products_p, _products, _products_shape)
ad.primitive_jvps.update({_jets_p: _jets_jvp, _products_p: _products_jvp})
ad.primitive_transposes[_jets_p] = _jets_transposed
ad.primitive_transposes[_products_p] = _products_transposed
batching.primitive_batchers[_products_p] = _products_mapped
