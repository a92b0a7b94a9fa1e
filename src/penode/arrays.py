"""Array aliases, axis names of shapes, the scope of float64, and threads of BLAS.

Axis names: ``time``, ``channel``, ``state``, ``input``, ``output``, ``parameter``, ``window``,
``batch``. Outside compiled code arrays are ``(time, channel)``; inside it they are batch-last,
``(state, batch)``.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import wraps
from typing import Any, ParamSpec, TypeAlias, TypeVar

import jax
import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

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


_Given = ParamSpec("_Given")
_Returned = TypeVar("_Returned")


def one_blas_thread(function: Callable[_Given, _Returned]) -> Callable[_Given, _Returned]:
    """Decorate a function to run BLAS in one thread.

    Matrices are small here, and threads that wait for each other cost more than they save.
    """

    @wraps(function)
    def limited(*arguments: _Given.args, **named: _Given.kwargs) -> _Returned:
        with threadpool_limits(1, "blas"):
            return function(*arguments, **named)

    return limited
