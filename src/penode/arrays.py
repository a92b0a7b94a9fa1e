"""Array aliases and the axis names used in shape annotations.

Axis names: ``time``, ``channel``, ``state``, ``input``, ``output``, ``parameter``, ``window``,
``batch``. Outside compiled code arrays are ``(time, channel)``; inside it they are batch-last,
``(state, batch)``.
"""

from typing import TypeAlias

import jax
import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]

#: An array inside compiled code. Its axes are named in the docstring that carries it.
JaxArray: TypeAlias = jax.Array
