"""Trees of models and records as JSON values beside named arrays, and back."""

import importlib
import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import equinox as eqx
import numpy as np

from penode.arrays import FloatArray
from penode.errors import InputError

#: Package whose classes are restored without being asked.
_OWN = "penode"


def describe_module(module: Any, name: str, arrays: dict[str, FloatArray]) -> Any:
    """Turn a tree into JSON values, its arrays moved into `arrays` under dotted names.

    Parameters
    ----------
    module : object
        Models, records, tuples, mappings of text, arrays, numbers, text and None.
    name : str
        First part of the names of its arrays.
    arrays : dict of str to ndarray
        Gets the arrays.
    """
    if is_dataclass(module) and not isinstance(module, type):
        inner = {
            f.name: describe_module(getattr(module, f.name), f"{name}.{f.name}", arrays)
            for f in fields(module)
        }
        return {"class": f"{type(module).__module__}:{type(module).__qualname__}", "fields": inner}
    if isinstance(module, (tuple, list)):
        return [describe_module(item, f"{name}.{k}", arrays) for k, item in enumerate(module)]
    if isinstance(module, Mapping):
        inner = {k: describe_module(item, f"{name}.{k}", arrays) for k, item in module.items()}
        return {"mapping": inner}
    if isinstance(module, np.ndarray):
        arrays[name] = module
        return {"array": name}
    if isinstance(module, (float, np.floating)) and not np.isfinite(module):
        return {"number": repr(float(module))}  # JSON has none of these
    return module


def restore_module(document: Any, arrays: Mapping[str, FloatArray], trust: bool = False) -> Any:
    """Rebuild a tree from `describe_module`'s document.

    Parameters
    ----------
    document : object
    arrays : mapping of str to ndarray
    trust : bool
        Whether modules other than penode's are imported, which runs them. Without it their classes
        are taken where the program has imported them already, and nothing is imported.

    Raises
    ------
    InputError
        If a class named in the document is not trusted, cannot be imported, or is none of models
        and records.
    """
    if isinstance(document, list):
        return tuple(restore_module(item, arrays, trust) for item in document)
    if not isinstance(document, dict):
        return document
    if "array" in document:
        return arrays[document["array"]]
    if "number" in document:
        return float(document["number"])
    if "mapping" in document:
        return {k: restore_module(v, arrays, trust) for k, v in document["mapping"].items()}
    kind = _restorable_class(document["class"], trust)
    module: Any = object.__new__(kind)
    for name, value in document["fields"].items():
        object.__setattr__(module, name, restore_module(value, arrays, trust))
    return module


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
    record = own and isinstance(target, type) and is_dataclass(target)
    if not (model or record):
        raise InputError(
            f"the saved fit names {reference}, which is no model; it was not written by penode."
        )
    return target
