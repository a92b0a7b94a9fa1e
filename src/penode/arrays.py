"""Array aliases, the axis names used in shape annotations, and the scope of float64.

Axis names: ``time``, ``channel``, ``state``, ``input``, ``output``, ``parameter``, ``window``,
``batch``. Outside compiled code arrays are ``(time, channel)``; inside it they are batch-last,
``(state, batch)``.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, TypeAlias

import jax
import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
ComplexArray: TypeAlias = NDArray[np.complex128]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]

#: The value of a parameter: a NumPy array in a model at rest, a JAX array inside compiled code.
Leaf: TypeAlias = Any

#: An array inside compiled code. Its axes are named in the docstring that carries it.
JaxArray: TypeAlias = jax.Array


def float64() -> AbstractContextManager[None]:
    """Return a context in which JAX computes in float64; its global settings stay untouched."""
    context: Callable[[bool], AbstractContextManager[None]] = jax.enable_x64
    return context(True)
