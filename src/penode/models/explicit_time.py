"""Time in an equation: a model whose methods take t, in s, is driven by it beside its inputs.

To a solver t is one more input, whose rate of change is 1: holds, stages and sub-steps then have it
where they have the inputs.
"""

import inspect
from collections.abc import Mapping

from penode.arrays import CLOCK, JaxArray
from penode.models.base import Model
from penode.models.inputs import Inputs

#: Methods that are given the inputs, and time where they take it.
OF_INPUTS = ("derivative", "output")


def takes_time(model: Model, method: str) -> bool:
    """Return whether a method's third argument, after state and inputs, is t."""
    try:
        given = inspect.signature(getattr(model, method)).parameters
    except (TypeError, ValueError):
        return False
    return list(given)[2:3] == ["t"]


def driving_channels(model: Model) -> tuple[str, ...]:
    """Return the channels that drive a model: its inputs, and time where a method takes it."""
    if any(takes_time(model, method) for method in OF_INPUTS):
        return (*model.inputs, CLOCK)
    return model.inputs


def rates_of(model: Model) -> Mapping[str, str | float]:
    """Return the channels that go on between samples, and for each its rate or that of a name."""
    rates: dict[str, str | float] = dict(model.input_rates)
    if CLOCK in driving_channels(model):
        rates[CLOCK] = 1.0
    return rates


def evaluated(model: Model, method: str, x: JaxArray, u: Inputs) -> JaxArray:
    """Return what a method of `OF_INPUTS` gives at states (state, batch) and driving channels."""
    if CLOCK not in u.names or CLOCK in model.inputs:
        value: JaxArray = getattr(model, method)(x, u)
        return value
    own, time = u.leading(model.inputs), u[CLOCK]
    value = getattr(model, method)(x, own, *([time] if takes_time(model, method) else []))
    return value
