"""Polynomials in several variables with their Jacobian in closed form."""

from itertools import combinations_with_replacement

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray, Leaf
from penode.errors import InputError
from penode.models.networks import dense
from penode.models.parameters import coefficients


def exponents(inputs: int, degree: int) -> tuple[tuple[int, ...], ...]:
    """Return the exponents of all monomials up to a total degree, the constant first.

    By rising total degree, ``(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), ...``
    """
    chosen = (c for d in range(degree + 1) for c in combinations_with_replacement(range(inputs), d))
    return tuple(tuple(c.count(i) for i in range(inputs)) for c in chosen)


class Polynomial(eqx.Module):
    """All monomials up to a total degree, weighted and summed.

    The inputs should be scaled to order 1 (see `penode.models.compositions.Scaled`): far above it
    the highest monomials drown the others, and a polynomial extrapolates badly in any case.

    Attributes
    ----------
    inputs, degree : int
        Number of inputs n, and the largest total degree.
    coefficients : array, shape (m, term)
        One column a monomial, in the order of `exponents`.

    Raises
    ------
    InputError
        If the number of columns is not the number of monomials.
    """

    inputs: int = eqx.field(static=True)
    degree: int = eqx.field(static=True)
    coefficients: Leaf = coefficients()

    def __check_init__(self) -> None:
        terms = len(exponents(self.inputs, self.degree))
        if self.coefficients.ndim != 2 or self.coefficients.shape[1] != terms:
            raise InputError(
                f"coefficients of {self.inputs} inputs and degree {self.degree} must have shape "
                f"(m, {terms}), one column a monomial, got {self.coefficients.shape}."
            )

    @classmethod
    def zero(cls, inputs: int, outputs: int, degree: int) -> "Polynomial":
        """Return the polynomial of n inputs and m outputs with all coefficients zero."""
        return cls(inputs, degree, np.zeros((outputs, len(exponents(inputs, degree)))))

    def value_and_jacobian(self, x: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return the value (m, batch) and its Jacobian (m, n, batch) at x (n, batch)."""
        columns = dict(zip(range(self.inputs), x, strict=True))
        terms = exponents(self.inputs, self.degree)
        by_exponents = {terms[0]: jnp.ones_like(x[0])}
        for term in terms[1:]:
            i = next(i for i, power in enumerate(term) if power)
            by_exponents[term] = by_exponents[_lowered(term, i)] * columns[i]
        nothing = jnp.zeros_like(x[0])
        slopes = [
            [p * by_exponents[_lowered(term, i)] if p else nothing for i, p in enumerate(term)]
            for term in terms
        ]
        monomials = jnp.stack(list(by_exponents.values()))
        return dense(self.coefficients, monomials), dense(self.coefficients, jnp.array(slopes))


def _lowered(term: tuple[int, ...], i: int) -> tuple[int, ...]:
    """Return the exponents with that of input i lowered by one."""
    return (*term[:i], term[i] - 1, *term[i + 1 :])
