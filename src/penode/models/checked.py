"""What a model declares, and its methods run once on shapes alone: a mistake is one sentence."""

import dataclasses
import inspect
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal

from penode.arrays import float64
from penode.errors import InputError, did_you_mean
from penode.models.base import Model
from penode.models.explicit_time import OF_INPUTS, driving_channels, evaluated, takes_time
from penode.models.inputs import Inputs
from penode.models.layout import Layout
from penode.models.measured import measured_units, nothing_measured
from penode.models.parameters import with_batch_axis
from penode.models.users_code import failing_line
from penode.models.wrapped import Wrapped

#: Length of the batch axis: no model has as many rows of anything.
_BATCH = 9973

_BRANCH = (
    "if, while, and, or, not, min and max cannot ask for values that are not known yet; "
    "choose with jnp.where(condition, a, b), jnp.minimum or jnp.maximum"
)
_ROWS = "its rows differ in shape; bring each to that of x[0], as in 0 * x[0] + 1.0"
#: What stands in the message of an error -> what is wrong, and the fix.
_KNOWN = {
    "truth value": _BRANCH,
    "boolean conversion": _BRANCH,
    "__array__()": "NumPy cannot compute with traced arrays; use the function of jax.numpy",
    "converted to Python scalars": (
        "math and float need a number, not an array; use the function of jax.numpy"
    ),
    "immutable": "arrays cannot be changed in place; stack rows with jnp.stack([...])",
    "'Inputs'": 'u is no array but has the inputs by name; take one, as in u["{input}"] or u[0]',
    "string indexing": "x has no names{instead}",
    "same shape": _ROWS,
    "different numbers of dimensions": _ROWS,
}
#: What JAX computes an index with that was given as a number.
_FOLDED: dict[str, Callable[..., Any]] = {
    "lt": operator.lt,
    "add": operator.add,
    "select_n": lambda which, *cases: cases[int(which)],
}


def require_sound(model: Any) -> None:
    """Refuse a model with a mistake that shapes alone show; nothing is compiled."""
    if isinstance(model, Wrapped):
        return require_sound(model.model)
    layout = _declared(model)
    kind, acting = type(model), set[int]()
    with float64():
        for name in ("derivative", "output", "corrected", "learned", "stored"):
            declared = name == "derivative" or (name == "output" and model.outputs)
            if declared or _overrides(model, name):
                acting |= _traced(model, name)
    for place, (name, setting) in enumerate(zip(layout.names, layout.settings, strict=True)):
        for late in setting.delays:
            if late not in model.inputs:
                raise InputError(
                    f"{kind.__name__}.{name} delays {late}, which is no input"
                    f"{did_you_mean(late, model.inputs)}; the inputs are {', '.join(model.inputs)}."
                )
        acts = place in acting or setting.delays  # a delay acts on the inputs
        if (setting.physical or setting.per_experiment) and not acts:
            where = "derivative or output depends" if model.outputs else "derivative depends"
            raise InputError(
                f"{kind.__name__}.{name} acts nowhere: no {where} on it, so no recording can show "
                "it; use it there, or leave it out."
            )


def _overrides(model: Model, name: str) -> bool:
    return getattr(type(model), name) is not getattr(Model, name)


def _rows(model: Model, name: str) -> tuple[str, Sequence[str]]:
    """Return what the rows of a method's result are, and their names; none where any will do."""
    if name == "output":
        return "outputs", tuple(model.outputs)
    return "states", () if name in ("learned", "stored") else model.states


def _traced(model: Model, name: str) -> set[int]:
    """Return which leaves a method's result depends on; refuse one that is no array of its rows."""
    leaves, structure = jax.tree.flatten(with_batch_axis(model))
    states = jax.ShapeDtypeStruct((len(model.states), _BATCH), jnp.float64)
    inputs = jax.ShapeDtypeStruct((len(driving_channels(model)), _BATCH), jnp.float64)
    returned: list[Any] = []

    def method(leaves: Any, x: Any, u: Any) -> Any:
        one = jax.tree.unflatten(structure, leaves)
        if name in OF_INPUTS:
            returned.append(evaluated(one, name, x, Inputs(u, driving_channels(model))))
        else:
            returned.append(getattr(one, name)(x))
        return returned[0] if isinstance(returned[0], (jax.Array, np.ndarray)) else ()

    place = f"{type(model).__name__}.{name}"
    try:
        program = jax.make_jaxpr(method)(leaves, states, inputs).jaxpr
    except InputError:
        raise
    except Exception as error:
        raise InputError(_sentence(place, error, model)) from error
    _require_rows(place, returned[0], *_rows(model, name))
    _require_bounds(place, program)
    return _dependence(program) & set(range(len(leaves)))


def _require_rows(place: str, result: Any, kind: str, names: Sequence[str]) -> None:
    """Refuse a result that is no real array of one row for each name; without names of any rows."""
    each = f" for each of the {kind} {', '.join(names)}" if names else ""
    if not isinstance(result, (jax.Array, np.ndarray)):
        got = "nothing" if result is None else f"a {type(result).__name__}"
        raise InputError(
            f"{place} returns {got}; return one array with a row{each}: jnp.stack([...])."
        )
    fits = result.ndim == 2 and result.shape[1] in (1, _BATCH)
    if not fits or (names and len(names) != len(result)):
        wanted = f"({len(names) or 'rows'}, batch)"
        rows = f", a row{each}" if names else ""
        raise InputError(
            f"{place} must return shape {wanted}{rows}, got {_shown(result.shape)}; put the rows "
            "together with jnp.stack([...])."
        )
    if jnp.issubdtype(result.dtype, jnp.complexfloating):
        raise InputError(f"{place} returns complex numbers; return real ones, as with jnp.real.")


def _shown(shape: tuple[int, ...]) -> str:
    return str(shape).replace(str(_BATCH), "batch")


def _sentence(place: str, error: Exception, model: Model) -> str:
    """Return what is wrong in a method, where, and the fix."""
    text = str(error.args[0] if isinstance(error, KeyError) and error.args else error).strip()
    first = text.partition("\n")[0].rstrip(".")
    where = f"{place}, {failing_line(error.__traceback__)}"
    if isinstance(error, (KeyError, IndexError)) and first.startswith("no input"):
        return f"{where}: {first}{_elsewhere(text, model)}."
    asked = text.rpartition("idx='")[2].partition("'")[0]
    row = model.states.index(asked) if asked in model.states else 0
    instead = f"; take a row, as in x[{row}]"
    if asked in model.inputs:
        instead = f", but u has: u[{asked!r}]"
    names = {"input": (*model.inputs, "name")[0], "instead": instead}
    for sign, fix in _KNOWN.items():
        if sign in text:
            return f"{where}: {fix.format(**names)}."
    return f"{where}: {type(error).__name__}: {first or 'it fails'}; fix that line."


def _elsewhere(text: str, model: Model) -> str:
    """Return where what is no input may be found."""
    asked = text.partition("'")[2].partition("'")[0]
    if asked in model.states:
        return f", and {asked} is a state: x[{model.states.index(asked)}]"
    return did_you_mean(asked, model.inputs) if asked else "; x has the states, u the inputs"


def _dependence(program: Any) -> set[int]:
    """Return which arguments of a traced program its results may depend on, by place."""
    wanted = {v for v in program.outvars if not isinstance(v, Literal)}
    for step in reversed(program.eqns):
        if wanted.intersection(step.outvars):
            wanted.update(v for v in step.invars if not isinstance(v, Literal))
    return {k for k, v in enumerate(program.invars) if v in wanted}


def _require_bounds(place: str, program: Any) -> None:
    """Refuse a row that an array has not: JAX would take the last one instead."""
    known: dict[Any, Any] = {}

    def value(v: Any) -> Any:
        return v.val if isinstance(v, Literal) else known.get(v)

    for step in program.eqns:
        kind, given = step.primitive.name, [value(v) for v in step.invars]
        if kind == "dynamic_slice":
            shape, sizes = step.invars[0].aval.shape, step.params["slice_sizes"]
            for length, size, first in zip(shape, sizes, given[1:], strict=True):
                if first is not None and not 0 <= first <= length - size:
                    line = failing_line(step.source_info.traceback.as_python_traceback())
                    raise InputError(
                        f"{place}, {line}: an index is beyond an array of {length} rows, "
                        f"which are counted from 0 to {length - 1}; correct it."
                    )
        elif kind in _FOLDED and None not in given:
            known[step.outvars[0]] = _FOLDED[kind](*given)


# --- what it declares -----------------------------------------------------------------------------


def _declared(model: Any) -> Layout[Any]:
    """Return a model's layout; refuse what is none, or whose names, units or fields say nothing."""
    if isinstance(model, type) and issubclass(model, Model):
        fields = ", ".join(f"{f.name}=..." for f in dataclasses.fields(model))
        raise InputError(
            f"a model must have its start values, got the class {model.__name__}; write "
            f"{model.__name__}({fields})."
        )
    if not isinstance(model, Model):
        kind = getattr(model, "__name__", type(model).__name__)
        raise InputError(f"a model must be an instance of a subclass of penode.Model, got {kind}.")
    for name in ("states", "state_units", "inputs", "unmeasured"):
        _require_names(model, name)
    _require_outputs(model)
    _require_agreement(model)
    for name in OF_INPUTS:
        _require_arguments(model, name)
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
    return layout


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
    if not measured_units(model):
        raise InputError(nothing_measured(model))


def _require_outputs(model: Model) -> None:
    """Refuse outputs without units or method, and what contradicts them."""
    kind, outputs = type(model).__name__, model.outputs
    form = 'declare each with its SI unit: outputs = {"y": "m"}'
    if not isinstance(outputs, Mapping):
        raise InputError(f"{kind}.outputs is {outputs!r}, which has no units; {form}.")
    for name, unit in outputs.items():
        if not isinstance(name, str) or not isinstance(unit, str):
            raise InputError(f"{kind}.outputs has {name!r}: {unit!r}; {form}.")
        if name in model.inputs:
            raise InputError(
                f"{kind}: {name} stands twice, among the inputs {', '.join(model.inputs)} and the "
                "outputs; give each channel a name of its own."
            )
    own = dict(zip(model.states, model.state_units, strict=False))
    other = [name for name, unit in outputs.items() if own.get(name, unit) != unit]
    if other:
        raise InputError(
            f"{kind}: the state {other[0]} is in {own[other[0]]} and the output of its name in "
            f"{outputs[other[0]]}; give both one unit, or the output a name of its own."
        )
    if not outputs and _overrides(model, "output"):
        raise InputError(f"{kind} has a method `output`, but no outputs; {form}.")
    if outputs and (model.unmeasured or _overrides(model, "corrected")):
        what = "unmeasured" if model.unmeasured else "corrected"
        raise InputError(
            f"{kind} has outputs, which say all that is measured, and `{what}` beside them; leave "
            "it out, and write what sensors read in `output`."
        )


def _require_arguments(model: Model, method: str) -> None:
    """Refuse a method whose arguments are not state, inputs and, where it acts, t in this order."""
    kind = type(model)
    try:
        given = list(inspect.signature(getattr(model, method)).parameters.values())
    except (TypeError, ValueError):
        return
    places = [p for p in given if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    names = [p.name for p in places]
    needed = [p for p in places if p.default is p.empty]
    every = any(p.kind is p.VAR_POSITIONAL for p in given)
    if names[:1] == ["t"] or names[:2] == ["u", "x"]:
        raise InputError(
            f"{kind.__name__}.{method}(self, {', '.join(names)}) has its arguments exchanged; "
            f"write {method}(self, x, u): states first, then inputs, then t where time acts."
        )
    if len(needed) > 2 + takes_time(model, method) or (len(places) < 2 and not every):
        raise InputError(
            f"{kind.__name__}.{method} takes {', '.join(names) or 'nothing'} beside self; write "
            f"{method}(self, x, u), or {method}(self, x, u, t) where time acts."
        )
