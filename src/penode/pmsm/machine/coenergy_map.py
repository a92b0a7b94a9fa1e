"""The flux map that is linear in what it learns: gradient of a coenergy of tensor splines."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, Leaf, float64
from penode.models.networks import FeatureNetwork
from penode.models.parameters import parameter
from penode.models.spline_basis import SplineBasis

#: Knots lie densest at zero current, more so along q, where iron saturates from there on.
_ALONG_D, _ALONG_Q = 0.5, 0.3
#: Splines along each axis: of the mean map, of what of it is not mirror symmetric, of an amplitude
#: over the angle.
MEAN, ODD, AMPLITUDE = 15, 7, 7


class CoenergyPart(eqx.Module):
    """Splines of i_d times splines of i_q that are all even or all odd in i_q.

    Attributes
    ----------
    counts : tuple of 2 int
        Splines along i_d and i_q.
    even : bool
        Symmetry in i_q.
    coefficients : array, shape (wave, d, q)
        One table for the mean over the angle, or one for each order; q counts half of the splines
        along i_q.
    """

    counts: tuple[int, int] = eqx.field(static=True)
    even: bool = eqx.field(static=True)
    coefficients: Leaf = parameter()

    @classmethod
    def zero(cls, count: int, even: bool, waves: int = 1) -> "CoenergyPart":
        """Return the part with as many splines along each axis, all coefficients zero."""
        half = (count + 1) // 2 if even else count // 2
        return cls((count, count), even, np.zeros((waves, count, half)))

    @property
    def bases(self) -> tuple[SplineBasis, SplineBasis]:
        """Splines along i_d and i_q."""
        return SplineBasis(self.counts[0], _ALONG_D), SplineBasis(self.counts[1], _ALONG_Q)

    def axes(self, x: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return splines with two derivatives along d and q, (3, count, batch), at x (2, batch)."""
        along_d, along_q = self.bases
        return along_d(x[0]), _folded(along_q(x[1]), self.even)

    def jet(self, x: JaxArray, waves: JaxArray | None = None) -> tuple[JaxArray, JaxArray]:
        """Return the gradient (2, batch) and the Hessian (2, 2, batch).

        Parameters
        ----------
        x : array, shape (2, batch)
            Dimensionless currents.
        waves : array, shape (wave, batch), optional
            What each table is multiplied by; 1 where not given.
        """
        along_d, along_q = self.axes(x)
        tables = self.coefficients
        table = tables[0] if waves is None else jnp.sum(tables * waves[:, None, None], axis=0)
        # sum over d first: (derivative, q, batch)
        rows = jnp.stack([jnp.sum(table * one[:, None], axis=0) for one in along_d])
        value, slope, bend = rows
        mixed = jnp.sum(slope * along_q[1], axis=0)
        gradient = jnp.stack([jnp.sum(slope * along_q[0], 0), jnp.sum(value * along_q[1], 0)])
        along, across = jnp.sum(bend * along_q[0], axis=0), jnp.sum(value * along_q[2], axis=0)
        return gradient, jnp.stack([jnp.stack([along, mixed]), jnp.stack([mixed, across])])


class CoenergySplines(FeatureNetwork):
    """Gradient of W(x, theta) = sum of tensor splines, linear in all coefficients.

    A machine without skew has W(i_d, -i_q, -theta) = W(i_d, i_q, theta): a mean and cosines even in
    i_q, sines odd. Further parts of the other symmetry describe one that lacks it. The Jacobian is
    a Hessian at every angle, so the map is reciprocal. P. H. C. Eilers and B. D. Marx, Statist.
    Sci. 11 (1996) 89, doi:10.1214/ss/1038425655.

    Attributes
    ----------
    mean : tuple of CoenergyPart
        Of the coenergy averaged over the angle.
    cosine, sine : tuple of CoenergyPart
        Amplitudes of cos(n theta) and sin(n theta), a wave an order n.
    """

    mean: tuple[CoenergyPart, ...]
    cosine: tuple[CoenergyPart, ...] = ()
    sine: tuple[CoenergyPart, ...] = ()

    @classmethod
    def linear(cls, orders: int = 0) -> "CoenergySplines":
        """Return the map psi = 0.3 x, with room for the default number of coefficients."""
        even = CoenergyPart.zero(MEAN, True)
        points = np.random.default_rng(0).uniform(-1.0, 1.0, (4 * even.coefficients.size, 2))
        wanted = 0.3 * points
        gradient = np.concatenate(columns(even, points)[0].transpose(1, 0, 2))
        solved = np.linalg.lstsq(gradient, wanted.T.ravel(), rcond=None)[0]
        mean = replace(even, coefficients=solved.reshape(even.coefficients.shape))
        if not orders:
            return cls((mean,))
        cosine, sine = (CoenergyPart.zero(AMPLITUDE, even, orders) for even in (True, False))
        return cls((mean,), (cosine,), (sine,))

    def value_and_jacobian(
        self, x: JaxArray, features: JaxArray | None = None
    ) -> tuple[JaxArray, JaxArray]:
        """Return the gradient (2, batch) and the Hessian (2, 2, batch)."""
        found = [part.jet(x) for part in self.mean]
        if features is not None and (self.cosine or self.sine):
            orders = len(features) // 2
            found += [part.jet(x, features[:orders]) for part in self.cosine]
            found += [part.jet(x, features[orders:]) for part in self.sine]
        gradients, hessians = zip(*found, strict=True)
        return sum(gradients[1:], gradients[0]), sum(hessians[1:], hessians[0])


def _folded(splines: JaxArray, even: bool) -> JaxArray:
    """Return sums or differences of mirror images: (3, count, batch) to half as many."""
    half = splines.shape[1] // 2
    mirrored = splines[:, ::-1]
    if even:
        pairs = splines[:, :half] + mirrored[:, :half]
        return jnp.concatenate([pairs, splines[:, half : splines.shape[1] - half]], axis=1)
    return mirrored[:, :half] - splines[:, :half]


def columns(part: CoenergyPart, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return gradient and Hessian of each coefficient of one table of a part.

    Parameters
    ----------
    part : CoenergyPart
    points : ndarray, shape (point, 2)
        Dimensionless currents.

    Returns
    -------
    tuple of ndarray
        Shapes (point, 2, coefficient) and (point, 3, coefficient): d psi_d / d i_d,
        d psi_d / d i_q and d psi_q / d i_q.
    """
    with float64():
        d, q = (np.asarray(axis) for axis in part.axes(jnp.asarray(points.T)))

    def product(m: int, n: int) -> FloatArray:
        return np.einsum("jp,kp->pjk", d[m], q[n]).reshape(len(points), -1)

    gradient = np.stack([product(1, 0), product(0, 1)], axis=1)
    return gradient, np.stack([product(2, 0), product(1, 1), product(0, 2)], axis=1)


def roughness(part: CoenergyPart) -> FloatArray:
    """Return the matrix of the integral of all squared third derivatives, for one table of a part.

    It is zero for a quadratic coenergy, the linear machine.

    Returns
    -------
    ndarray, shape (coefficient, coefficient)
    """
    grams = []
    for basis, fold in zip(part.bases, (None, part.even), strict=True):
        places, weights = basis.quadrature()
        with float64():
            at = jnp.asarray(places)
            splines = jnp.concatenate([basis(at), basis.third(at)[None]])
            every = np.asarray(splines if fold is None else _folded(splines, fold))
        grams.append([np.einsum("ip,jp,p->ij", one, one, weights) for one in every])
    along_d, along_q = grams
    binomial = (1.0, 3.0, 3.0, 1.0)
    return np.asarray(sum(b * np.kron(along_d[m], along_q[3 - m]) for m, b in enumerate(binomial)))
