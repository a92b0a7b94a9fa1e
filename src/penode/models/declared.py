"""What a model's class and fields declare, looked at before anything is computed."""

import dataclasses
import inspect
from collections.abc import Sequence
from typing import Any

import jax

from penode.errors import InputError, did_you_mean
from penode.models.base import Model
from penode.models.layout import Layout


def require_declared(model: Any) -> None:
    """Refuse what is no model, or one whose names, units or fields say nothing."""
    if isinstance(model, type) and issubclass(model, Model):
        fields = ", ".join(f"{f.name}=..." for f in dataclasses.fields(model))
        raise InputError(
            f"the class {model.__name__} came where a model was wanted; give one with its start "
            f"values: {model.__name__}({fields})."
        )
    if not isinstance(model, Model):
        kind = getattr(model, "__name__", type(model).__name__)
        raise InputError(
            f"{kind} came where a model was wanted; give an instance of a subclass of penode.Model."
        )
    for name in ("states", "state_units", "inputs", "unmeasured"):
        _require_names(model, name)
    _require_agreement(model)
    _require_arguments(model)
    layout = Layout(model)
    for name, setting, leaf in zip(
        layout.names, layout.settings, jax.tree.leaves(model), strict=True
    ):
        if setting.physical and leaf.shape:
            raise InputError(
                f"{name} has shape {leaf.shape}, but a physical parameter is one number; declare "
                "one for each, or the field with penode.parameter()."
            )
    layout.raw(model)


def _require_names(model: Model, field: str) -> None:
    """Refuse what is no tuple of text."""
    kind, names = type(model).__name__, getattr(model, field, None)
    if names is None:
        raise InputError(f'{kind} has no {field}; write them as a tuple: {field} = ("...",).')
    if isinstance(names, str):
        raise InputError(
            f"{kind}.{field} is the text {names!r}; write a tuple, with a comma where it has one "
            f"entry: {field} = ({names!r},)."
        )
    odd = [n for n in names if not isinstance(n, str)] if isinstance(names, Sequence) else [names]
    if odd:
        raise InputError(f"{kind}.{field} has {odd[0]!r} where text was wanted; put it in quotes.")


def _require_agreement(model: Model) -> None:
    """Refuse names that stand twice or name nothing, and units that are not one a state."""
    kind, states = type(model).__name__, ", ".join(model.states)
    if not model.states:
        raise InputError(f'{kind}.states is empty; name one state at least: states = ("x",).')
    if len(model.state_units) != len(model.states):
        raise InputError(
            f"{kind}.state_units are {', '.join(model.state_units) or 'none'}, but the states are "
            f"{states}; give each state its SI unit."
        )
    channels = [*model.states, *model.inputs]
    twice = [name for k, name in enumerate(channels) if name in channels[:k]]
    if twice:
        raise InputError(
            f"{kind}: {twice[0]} stands twice among the states {states} and the inputs "
            f"{', '.join(model.inputs)}; give each channel a name of its own."
        )
    unknown = [name for name in model.unmeasured if name not in model.states]
    if unknown:
        raise InputError(
            f"{kind}.unmeasured names {unknown[0]}{did_you_mean(unknown[0], model.states)}, but "
            f"the states are {states}; name some of them."
        )
    if len(set(model.unmeasured)) == len(model.states):
        raise InputError(
            f"no state of {kind} is measured; name those that no sensor measures, and no others, "
            "in `unmeasured`."
        )


def _require_arguments(model: Model) -> None:
    """Refuse a derivative whose arguments are not a state and an input, in this order."""
    kind = type(model)
    try:
        given = list(inspect.signature(model.derivative).parameters.values())
    except (TypeError, ValueError):
        return
    places = [p for p in given if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    names = [p.name for p in places]
    needed = [p for p in places if p.default is p.empty]
    every = any(p.kind is p.VAR_POSITIONAL for p in given)
    if len(needed) > 2 or (len(places) < 2 and not every):
        raise InputError(
            f"{kind.__name__}.derivative takes {', '.join(names) or 'nothing'} beside self; write "
            "derivative(self, x, u), and make time, where it acts, one of the inputs."
        )
    if names[:2] == ["u", "x"]:
        raise InputError(
            f"{kind.__name__}.derivative(self, u, x) has its arguments exchanged; write "
            "derivative(self, x, u): states first, then inputs."
        )
