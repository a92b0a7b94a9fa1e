"""Noise with outliers: residuals whose squares are a negative log likelihood."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray
from penode.errors import InputError

#: Square over the degrees of freedom below which a series takes the place of log(1 + u) / u.
_SMALL = 1e-6


@dataclass(frozen=True)
class StudentT:
    """Noise of Student's t distribution: a value far out counts little, and none counts nothing.

    A residual r of scale s is replaced by the number of its sign whose square is
    nu s^2 log(1 + r^2 / (nu s^2)): r itself where it is small. Up to constants the sum of squares
    is then the negative log likelihood, in which r weighs (nu + 1) / (nu + r^2 / s^2) times as much
    as in least squares (K. L. Lange et al., J. Am. Stat. Assoc. 84 (1989) 881,
    doi:10.2307/2290063).

    Attributes
    ----------
    degrees : float
        Degrees of freedom nu; the fewer, the less outliers count.
    scale : tuple of float, or None
        s of each quantity, in units of the loss's scale. None: estimated, the most likely one at
        every horizon.

    Raises
    ------
    InputError
        If the degrees of freedom or a scale are not above 0.
    """

    degrees: float = 4.0
    scale: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if not self.degrees > 0:
            raise InputError(f"degrees must be > 0, got {self.degrees}; 4 is usual.")
        if self.scale is not None and not all(one > 0 for one in self.scale):
            raise InputError(f"scale must be > 0 for every quantity, got {self.scale}.")

    def root(self, z: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return what takes the place of residuals z = r / s, of any shape, and its slope."""
        u = z**2 / self.degrees
        tiny = u < _SMALL
        safe = jnp.where(tiny, 1.0, u)
        ratio = jnp.where(tiny, 1.0 - u / 4, jnp.sqrt(jnp.log1p(safe) / safe))
        return z * ratio, 1.0 / ((1.0 + u) * ratio)

    def moments(self, root: JaxArray) -> JaxArray:
        """Return w, w z^2, the loss's curvature and Gauss and Newton's, (4, ...), of roots.

        w is 1 / (1 + z^2 / nu); half the square of a root has the derivatives w z and
        w - 2 w^2 z^2 / nu, and Gauss and Newton take (w z / root)^2 for the latter.
        """
        u = jnp.expm1(root**2 / self.degrees)
        w = 1.0 / (1.0 + u)
        squares = jnp.where(root == 0.0, 1.0, root**2)
        gauss = jnp.where(root == 0.0, 1.0, w**2 * self.degrees * u / squares)
        return jnp.stack([w, w * self.degrees * u, w * (1.0 - 2.0 * w * u), gauss])

    def scales(self, quantities: int) -> FloatArray:
        """Return s of each quantity, (quantity,), 1 as long as it is not estimated."""
        return np.ones(quantities) if self.scale is None else np.array(self.scale)
