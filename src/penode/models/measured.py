"""What of a model is measured: its outputs, or those of its states that a sensor reads."""

import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.models.base import Model
from penode.models.explicit_time import evaluated
from penode.models.inputs import Inputs


def measured_units(model: Model) -> dict[str, str]:
    """Return the channels that predictions are compared with, and their SI units."""
    if model.outputs:
        return dict(model.outputs)
    pairs = zip(model.states, model.state_units, strict=True)
    return {name: unit for name, unit in pairs if name not in model.unmeasured}


def hidden_states(model: Model) -> tuple[str, ...]:
    """Return the states that no channel is needed of; one that is there is a first guess."""
    if not model.outputs:
        return tuple(name for name in model.states if name in model.unmeasured)
    return tuple(name for name in model.states if name not in model.outputs)


def nothing_measured(model: Model) -> str:
    """Return the sentence that refuses a model of which nothing is measured."""
    return (
        f"no state of {type(model).__name__} is measured; name in `unmeasured` only those that no "
        'sensor measures, or what sensors read instead, as in outputs = {"y": "m"}.'
    )


def free_states(model: Model) -> tuple[str, ...]:
    """Return the states whose start is estimated whatever the loss says."""
    names = model.states if model.outputs else hidden_states(model)
    return tuple(name for name in names if name not in model.covariances)


def dynamic_states(model: Model) -> tuple[str, ...]:
    """Return the states without those that are covariances, which are the last."""
    return model.states[: len(model.states) - len(model.covariances)]


def predicted_outputs(model: Model, x: JaxArray, u: Inputs) -> JaxArray:
    """Return what sensors read at states (state, batch) and inputs, (output, batch)."""
    if not model.outputs:
        measured = measured_units(model)
        return x[np.array([k for k, name in enumerate(model.states) if name in measured])]
    read = jnp.asarray(evaluated(model, "output", x, u))
    return jnp.broadcast_to(read, (len(read), x.shape[-1]))
