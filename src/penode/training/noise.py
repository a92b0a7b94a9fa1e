"""Noise with outliers: residuals whose squares are a negative log likelihood."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray
from penode.errors import InputError

#: Most that w z^2 / nu may be, which never reaches 1: z is a number then.
_MOST = 1.0 - 1e-15


@dataclass(frozen=True)
class StudentT:
    """Noise of Student's t distribution: a value far out counts little, and none counts nothing.

    In place of the square of a residual r of scale s stands nu s^2 log(1 + r^2 / (nu s^2)), which
    is r^2 where it is small; up to constants the sum is the negative log likelihood. Its slope is
    that of least squares with weights nu / (nu + r^2 / s^2), by which steps are made (K. L. Lange
    et al., J. Am. Stat. Assoc. 84 (1989) 881, doi:10.2307/2290063).

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

    def weight(self, z: JaxArray) -> JaxArray:
        """Return what squares of residuals z = r / s weigh, of any shape."""
        return 1.0 / (1.0 + z**2 / self.degrees)

    def squares(self, z: JaxArray) -> JaxArray:
        """Return what stands in place of squares of residuals z = r / s, of any shape."""
        return self.degrees * jnp.log1p(z**2 / self.degrees)

    def unweighted(self, weighted: JaxArray) -> JaxArray:
        """Return residuals z of which sqrt(w) z is given, w their weights."""
        share = jnp.minimum(weighted**2 / self.degrees, _MOST)
        return weighted / jnp.sqrt(1.0 - share)

    def moments(self, z: JaxArray) -> JaxArray:
        """Return w, w z^2 and the curvature w - 2 w^2 z^2 / nu of half the squares, (3, ...)."""
        w = self.weight(z)
        return jnp.stack([w, w * z**2, w * (1.0 - 2.0 * w * z**2 / self.degrees)])

    def scales(self, quantities: int) -> FloatArray:
        """Return s of each quantity, (quantity,), 1 as long as it is not estimated."""
        return np.ones(quantities) if self.scale is None else np.array(self.scale)
