"""Trees of models and records as JSON values beside named arrays, and back."""

import importlib
import sys
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import equinox as eqx
import jax
import numpy as np

from penode.arrays import FloatArray
from penode.errors import InputError

#: Package whose classes are restored without being asked.
_OWN = "penode"


def describe_module(module: Any, name: str, arrays: dict[str, FloatArray]) -> Any:
    """Turn a tree into values for `to_json`, exact, its arrays in `arrays` under dotted names.

    It may hold models, records, tuples, lists, mappings, arrays, numbers, text and None; ``name``
    is the first part of the names.
    """
    if is_dataclass(module) and not isinstance(module, type):
        inner = {
            f.name: describe_module(getattr(module, f.name), f"{name}.{f.name}", arrays)
            for f in fields(module)
        }
        return {"class": f"{type(module).__module__}:{type(module).__qualname__}", "fields": inner}
    if isinstance(module, (tuple, list)):
        items = [describe_module(item, f"{name}.{k}", arrays) for k, item in enumerate(module)]
        return items if isinstance(module, tuple) else {"list": items}
    if isinstance(module, Mapping):
        return _described_mapping(module, name, arrays)
    if isinstance(module, (np.ndarray, jax.Array)):
        arrays[name] = np.asarray(module)
        return {"array": name}
    if isinstance(module, np.generic):
        return {"scalar": module.dtype.str, "value": module.item()}
    return module


def _described_mapping(
    mapping: Mapping[Any, Any], name: str, arrays: dict[str, FloatArray]
) -> dict[str, Any]:
    """Describe a mapping; its arrays are named by its keys where these are plain names."""
    named = {
        key: f"{name}.{key if isinstance(key, str) and key.isidentifier() else k}"
        for k, key in enumerate(mapping)
    }
    inner = {key: describe_module(value, named[key], arrays) for key, value in mapping.items()}
    if all(type(key) is str for key in mapping):
        return {"mapping": inner}
    return {"pairs": [[describe_module(key, name, arrays), inner[key]] for key in mapping]}


def restore_module(document: Any, arrays: Mapping[str, FloatArray], trust: bool = False) -> Any:
    """Rebuild a tree from `describe_module`'s document, as `from_json` reads it.

    ``trust`` imports modules other than penode's, which runs them. Without it their classes are
    taken where the program has imported them already, and nothing is imported. Refuses a class that
    is not trusted, cannot be imported, or is none of models and records.
    """
    if isinstance(document, list):
        return tuple(restore_module(item, arrays, trust) for item in document)
    if not isinstance(document, dict):
        return document
    for form, restored in _FORMS.items():
        if form in document:
            return restored(document, lambda inner: restore_module(inner, arrays, trust), arrays)
    kind = _restorable_class(document["class"], trust)
    module: Any = object.__new__(kind)
    for name, value in document["fields"].items():
        object.__setattr__(module, name, restore_module(value, arrays, trust))
    return module


def _scalar(kind: str, value: Any) -> Any:
    """Return a number of NumPy, whose kinds are known to be small."""
    dtype = np.dtype(kind)
    if dtype.kind not in "biufcU":
        raise ValueError(f"{kind} is no kind of number")
    try:
        return dtype.type(value)
    except OverflowError as error:
        raise ValueError(f"{value} is no {kind}") from error


#: What describes a value that is no record -> the value, from its document.
_FORMS: dict[str, Callable[[dict[str, Any], Callable[[Any], Any], Mapping[str, Any]], Any]] = {
    "array": lambda document, _, arrays: arrays[document["array"]],
    "scalar": lambda document, *_: _scalar(document["scalar"], document["value"]),
    "list": lambda document, inner, _: [inner(item) for item in document["list"]],
    "mapping": lambda document, inner, _: {k: inner(v) for k, v in document["mapping"].items()},
    "pairs": lambda document, inner, _: {inner(k): inner(v) for k, v in document["pairs"]},
}


def _restorable_class(reference: str, trust: bool) -> type:
    module_name, _, class_name = reference.partition(":")
    needs = f"the saved fit needs {reference}, which"
    if module_name == "__main__" and not hasattr(sys.modules["__main__"], class_name.split(".")[0]):
        raise InputError(
            f"{needs} a script or notebook defined; move it into a module of its own, import it "
            "from there, and save the fit again."
        )
    own = module_name.split(".")[0] == _OWN
    if not (own or trust or module_name in sys.modules):
        raise InputError(
            f"{needs} is no class of penode, and to import a module runs it; if you trust "
            f"{module_name}, add --trust-classes (in Python: import it first, or give trust=True)."
        )
    try:
        target: Any = importlib.import_module(module_name)
        for part in class_name.split("."):
            target = getattr(target, part)
    except (ImportError, AttributeError, SyntaxError) as error:
        raise InputError(
            f"{needs} cannot be imported ({error}); run in the folder that holds "
            f"{module_name}.py, or add that folder to PYTHONPATH."
        ) from error
    model = isinstance(target, type) and issubclass(target, eqx.Module)
    record = isinstance(target, type) and is_dataclass(target)
    if not (model or record):
        raise InputError(
            f"the saved fit names {reference}, which is no model; it was not written by penode."
        )
    return target
