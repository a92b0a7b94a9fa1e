"""The flux map that is linear in what it learns: gradient of a coenergy of tensor splines."""

import functools
import math
import operator
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, Leaf
from penode.models.networks import FeatureNetwork
from penode.models.parameters import coefficients
from penode.models.spline_basis import SplineBasis
from penode.models.tensor_splines import Orders, TensorBasis, folded, jets

#: Knots lie densest at zero current, more so along q, where iron saturates from there on.
_SHARPNESS = (0.5, 0.3)
#: Splines along each axis: of the mean map, of what of it is not mirror symmetric, of an amplitude
#: over the angle.
MEAN, ODD, AMPLITUDE = 15, 7, 7


class CoenergyPart(eqx.Module):
    """Splines of i_d times splines of i_q that are all even or all odd in i_q."""

    even: bool = eqx.field(static=True)
    # (wave, d, q), one table for the mean or one an order; folded by symmetry, q is half of d.
    coefficients: Leaf = coefficients()

    @classmethod
    def zero(cls, count: int, even: bool, waves: int = 1) -> "CoenergyPart":
        """Return the part with as many splines along each axis, all coefficients zero."""
        half = (count + 1) // 2 if even else count // 2
        return cls(even, np.zeros((waves, count, half)))

    @property
    def count(self) -> int:
        """Splines along each axis."""
        return int(self.coefficients.shape[1])

    @property
    def bases(self) -> tuple[SplineBasis, SplineBasis]:
        """Splines along i_d and i_q."""
        along_d, along_q = (SplineBasis(self.count, sharpness) for sharpness in _SHARPNESS)
        return along_d, along_q


class CoenergySplines(FeatureNetwork):
    """Gradient of W(x, theta) = sum of tensor splines, linear in all coefficients.

    A machine without skew has W(i_d, -i_q, -theta) = W(i_d, i_q, theta): a mean and cosines
    even in i_q, sines odd. Further parts of the other symmetry describe one that lacks it. The
    Jacobian is a Hessian at every angle, so the map is reciprocal (Eilers and Marx 1996,
    doi:10.1214/ss/1038425655).
    """

    linear_in_features: ClassVar[bool] = True

    mean: tuple[CoenergyPart, ...]
    # Amplitudes of cos(n theta) and sin(n theta), a wave an order n.
    cosine: tuple[CoenergyPart, ...] = ()
    sine: tuple[CoenergyPart, ...] = ()

    @property
    def skewed(self) -> bool:
        """Whether the harmonics are those of a machine with skew."""
        return len(self.cosine) > 1

    @classmethod
    def linear(cls, orders: int = 0) -> "CoenergySplines":
        """Return the map psi = 0.3 x, to rounding, with harmonics of amplitude zero."""
        even = CoenergyPart.zero(MEAN, True)
        solved = quadratic(even, np.array([0.3, 0.3]))
        mean = replace(even, coefficients=solved.reshape(even.coefficients.shape))
        if not orders:
            return cls((mean,))
        cosine, sine = (CoenergyPart.zero(AMPLITUDE, even, orders) for even in (True, False))
        return cls((mean,), (cosine,), (sine,))

    def weighted(self, features: JaxArray | None) -> list[tuple[CoenergyPart, JaxArray | None]]:
        """Return each part with what its tables are multiplied by, (wave, batch) or nothing."""
        parts: list[tuple[CoenergyPart, JaxArray | None]] = [(part, None) for part in self.mean]
        return parts + ([] if features is None else self._turning(features))

    def _turning(self, features: JaxArray) -> list[tuple[CoenergyPart, JaxArray | None]]:
        if not self.cosine + self.sine:
            return []
        cosine, sine = jnp.split(features, 2)
        return [*((part, cosine) for part in self.cosine), *((part, sine) for part in self.sine)]

    def value_and_jacobian(
        self, x: JaxArray, features: JaxArray | None = None
    ) -> tuple[JaxArray, JaxArray]:
        """Return the gradient (2, batch) and the Hessian (2, 2, batch)."""
        orders = _GRADIENT + _HESSIAN
        every = [jets(basis, orders, table, x) for basis, table in _tables(self.weighted(features))]
        d, q, dd, dq, qq = functools.reduce(operator.add, every)
        return jnp.stack([d, q]), jnp.stack([dd, dq, dq, qq]).reshape(2, 2, -1)

    def slope(self, x: JaxArray, rates: JaxArray) -> JaxArray:
        """Return how fast the gradient (2, batch) changes while the features do."""
        tables = _tables(self._turning(rates))
        slopes = (jets(basis, _GRADIENT, table, x) for basis, table in tables)
        return sum(slopes, jnp.zeros_like(x))


#: Orders of differentiation along d and q: of a gradient, and of a Hessian.
_GRADIENT: Orders = ((1, 0), (0, 1))
_HESSIAN: Orders = ((2, 0), (1, 1), (0, 2))


def _tables(
    parts: list[tuple[CoenergyPart, JaxArray | None]],
) -> list[tuple[TensorBasis, JaxArray]]:
    """Return one table for each number of splines: parts added up, waves multiplied out."""
    tables: dict[int, dict[bool, JaxArray]] = {}
    for part, waves in parts:
        table = part.coefficients[0]
        if waves is not None:
            table = jnp.sum(part.coefficients * waves[:, None, None], axis=0)
        same = tables.setdefault(part.count, {})
        same[part.even] = same[part.even] + table if part.even in same else table
    merged = []
    for count, of_parity in tables.items():
        batch = jnp.broadcast_shapes(*(t.shape[-1:] for t in of_parity.values()))
        wide = [jnp.broadcast_to(t, (*t.shape[:-1], *batch)) for t in of_parity.values()]
        basis = TensorBasis(count, _SHARPNESS, tuple(of_parity))
        merged.append((basis, jnp.concatenate(wide, axis=1)))
    return merged


#: Derivatives along d and q of the coenergy: of the flux linkage, and of the inductance's
#: d psi_d / d i_d, d psi_d / d i_q and d psi_q / d i_q.
GRADIENT, HESSIAN = ((1, 0), (0, 1)), ((2, 0), (1, 1), (0, 2))


def columns(
    part: CoenergyPart, points: FloatArray, orders: Sequence[tuple[int, int]] = GRADIENT
) -> FloatArray:
    """Return derivatives of each coefficient's coenergy, (point, order, coefficient), of a table.

    `points` (point, 2) are dimensionless currents, `orders` how often to differentiate along d
    and q.
    """
    along_d, along_q = part.bases
    d = along_d.derivatives(points[:, 0])
    q = np.asarray(folded(along_q.derivatives(points[:, 1]), part.even))
    every = np.empty((len(points), len(orders), d.shape[1], q.shape[1]))
    for k, (m, n) in enumerate(orders):
        np.einsum("jp,kp->pjk", d[m], q[n], out=every[:, k])
    return every.reshape(len(points), len(orders), -1)


def quadratic(part: CoenergyPart, inductances: FloatArray) -> FloatArray:
    """Return the coefficients of (L_d x_d^2 + L_q x_q^2) / 2, dimensionless, to rounding."""
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (4 * part.coefficients.size, 2))
    gradient = np.concatenate(columns(part, points).transpose(1, 0, 2))
    wanted = points * inductances
    return np.asarray(np.linalg.lstsq(gradient, wanted.T.ravel(), rcond=None)[0])


def roughness(part: CoenergyPart, orders: tuple[int, ...] = (3,)) -> FloatArray:
    """Return the matrix of the integral of all squared derivatives of some orders, for one table.

    That of the third alone is zero for a quadratic coenergy, the linear machine.
    """
    grams = []
    for basis, fold in zip(part.bases, (None, part.even), strict=True):
        places, weights = basis.quadrature()
        splines = basis.derivatives(places)
        every = splines if fold is None else np.asarray(folded(splines, fold))
        grams.append([np.einsum("ip,jp,p->ij", one, one, weights) for one in every])
    along_d, along_q = grams
    parts = [
        math.comb(n, m) * np.kron(along_d[m], along_q[n - m]) for n in orders for m in range(n + 1)
    ]
    return np.asarray(sum(parts))
