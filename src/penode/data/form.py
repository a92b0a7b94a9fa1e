"""What a recording is given as: a name, a time step, and series of real numbers."""

import math
import numbers
from collections.abc import Mapping
from typing import Any

import numpy as np

from penode.errors import InputError

#: Kind of numbers -> what is wrong with them, and the fix.
_MENDS = {
    "b": "is boolean; give numbers, as in values.astype(float)",
    "c": "is complex; give real numbers, as in values.real",
    "U": "is text; give numbers, as in values.astype(float)",
    "S": "is text; give numbers, as in values.astype(float)",
    "M": "holds dates; give numbers, and the interval between samples as time_step",
    "m": "holds times; give numbers, as in values / np.timedelta64(1, 's')",
}


def require_form(name: Any, time_step: Any, channels: Any) -> None:
    """Refuse what is no recording: a name, a step above 0 s, channels of real numbers (time,)."""
    if not isinstance(name, str):
        raise InputError(
            f"{name!r} came as the name of a recording; give text, as in "
            'penode.Experiment("run 1", time_step, channels).'
        )
    if not (isinstance(time_step, numbers.Real) and 0 < float(time_step) < math.inf):
        came = repr(time_step) if np.ndim(time_step) == 0 else f"of shape {np.shape(time_step)}"
        raise InputError(
            f"{name}: time_step {came} came; give the one number of seconds, above 0, from a sample"
            " to the next."
        )
    if not isinstance(channels, Mapping):
        raise InputError(
            f"{name}: channels is a {type(channels).__name__}; give a dictionary from names to "
            'series, as in {"position": values}.'
        )
    for channel, values in channels.items():
        if not isinstance(channel, str):
            raise InputError(f"{name}: channel {channel!r} is named by no text; put it in quotes.")
        if problem := _unusable(values):
            raise InputError(f"{name}: channel {channel} {problem}.")


def _unusable(values: Any) -> str:
    """Return why values are no series of real numbers, and the fix; nothing if they are."""
    try:
        array = values if isinstance(values, np.ndarray) else np.asarray(values)
    except (TypeError, ValueError):  # rows of different lengths
        return "is mixed; give one real number a sample, as an array of floats"
    if array.dtype.kind not in "iuf":
        came = "is mixed" if array.ndim else f"holds {type(values).__name__}"
        odd = f"{came}; give one real number a sample, as an array of floats"
        return _MENDS.get(array.dtype.kind, odd)
    if array.ndim != 1:
        one = array.size and array.size == max(array.shape, default=0)
        fix = "as in values.ravel()" if one else "and each column a name of its own"
        return f"has shape {array.shape}; give one number a sample, shape (time,), {fix}"
    if np.ma.is_masked(values):
        return "has masked samples; cut the recording there"
    return ""
