"""Array aliases, axis names of shapes, the scope of float64, and threads of BLAS.

Axis names: ``time``, ``channel``, ``state``, ``input``, ``output``, ``parameter``, ``window``,
``batch``. Outside compiled code arrays are ``(time, channel)``; inside it they are batch-last,
``(state, batch)``.
"""

import os
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import cache, wraps
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

#: Channel that every recording has: time in s.
CLOCK = "time in s"

#: An array inside compiled code. Its axes are named in the docstring that carries it.
JaxArray: TypeAlias = jax.Array


#: Options of XLA, which one that does not know them leaves alone. Loops of steps that call no other
#: code become one function each, whatever they touch: else XLA calls each sum of a step by itself,
#: which costs more than the sum. Of two ways to write a sum the older compiles in two thirds of the
#: time.
_EXTRA = "xla_backend_extra_options"
_OPTIONS = (
    f"--{_EXTRA}=xla_cpu_small_while_loop_byte_threshold={10**8},"
    "xla_cpu_disable_new_fusion_emitters"
)


@cache
def start_jax() -> None:
    """Start JAX with these options, unless it runs or ``XLA_FLAGS`` has some of their kind.

    Its settings and the environment stay as they are: XLA reads its flags once, when JAX starts.
    """
    flags = os.environ.get("XLA_FLAGS")
    if flags is not None and _EXTRA in flags:
        return
    os.environ["XLA_FLAGS"] = f"{flags or ''} {_OPTIONS}"
    try:
        jax.devices()
    finally:
        del os.environ["XLA_FLAGS"]
        if flags is not None:
            os.environ["XLA_FLAGS"] = flags


def float64() -> AbstractContextManager[None]:
    """Return a context in which JAX computes in float64; its global settings stay untouched."""
    start_jax()
    context: Callable[[bool], AbstractContextManager[None]] = jax.enable_x64
    return context(True)


def on_device(values: Any) -> JaxArray:
    """Return numbers as an argument of compiled code.

    `jax.numpy.asarray` would compile a program of its own for every shape.
    """
    moved: JaxArray = jax.device_put(np.asarray(values))
    return moved


def shared_length(samples: int) -> int:
    """Return the next power of two, or three quarters of it where that is enough."""
    power = 1 << max(samples - 1, 1).bit_length()
    return power if samples > 3 * power // 4 else 3 * power // 4


#: A call over as many samples costs a millisecond, another program half a second and more.
SHORTEST = 4096


def with_shared_length(rows: JaxArray | FloatArray, shortest: int = SHORTEST) -> JaxArray:
    """Return rows (channel, time) whose last sample goes on up to a `shared_length`.

    Recordings of about the same length then run through one compiled program, and so do all of a
    few thousand samples: a recording with gaps has stretches of any length. Where each sample is
    dear, a smaller number may be the `shortest` that comes back.
    """
    length = max(shared_length(rows.shape[1]), shortest)
    missing = [(0, 0), (0, length - rows.shape[1])]
    return on_device(np.pad(np.asarray(rows), missing, mode="edge"))


def in_blocks(rows: FloatArray) -> list[FloatArray]:
    """Return rows (channel, time) cut into blocks of one length, zeros behind the last sample.

    One compiled program then serves any number of samples, where each of them is by itself.
    """
    starts = range(0, max(rows.shape[1], 1), SHORTEST)
    parts = [rows[:, first : first + SHORTEST] for first in starts]
    return [np.pad(part, [(0, 0), (0, SHORTEST - part.shape[1])]) for part in parts]


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
