"""Files of a saved fit: one JSON document and one NPZ of arrays, written atomically, no pickle."""

import hashlib
import importlib
import io
import json
import os
import sys
import tempfile
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np

from penode.arrays import FloatArray
from penode.errors import InputError

#: Key under which the document names the arrays it belongs to.
_DIGEST = "arrays_sha256"


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def write_atomically(path: Path, content: str | bytes) -> None:
    """Replace a file in one step: a reader sees the old one or the new one, whole."""
    data = content.encode() if isinstance(content, str) else content
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def to_json(document: Any) -> str:
    """Return strict JSON: numbers that are not finite become null."""
    return json.dumps(_plain(document), indent=2, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    if isinstance(value, np.integer):
        return int(value)
    return value


def describe_module(module: Any, name: str, arrays: dict[str, FloatArray]) -> Any:
    """Turn a model tree into JSON values, its arrays moved into `arrays` under dotted names."""
    if isinstance(module, eqx.Module):
        inner = {
            f.name: describe_module(getattr(module, f.name), f"{name}.{f.name}", arrays)
            for f in fields(module)
        }
        return {"class": f"{type(module).__module__}:{type(module).__qualname__}", "fields": inner}
    if isinstance(module, tuple):
        return [describe_module(item, f"{name}.{k}", arrays) for k, item in enumerate(module)]
    if isinstance(module, np.ndarray):
        arrays[name] = module
        return {"array": name}
    return module


def restore_module(document: Any, arrays: Mapping[str, FloatArray]) -> Any:
    """Rebuild a model tree from `describe_module`'s document.

    Raises
    ------
    InputError
        If a class named in the document cannot be imported or is not a model part.
    """
    if isinstance(document, list):
        return tuple(restore_module(item, arrays) for item in document)
    if not isinstance(document, dict):
        return document
    if "array" in document:
        return arrays[document["array"]]
    kind = _import_module_class(document["class"])
    module = object.__new__(kind)
    for name, value in document["fields"].items():
        object.__setattr__(module, name, restore_module(value, arrays))
    return module


def _import_module_class(reference: str) -> type[eqx.Module]:
    module_name, _, class_name = reference.partition(":")
    needs = f"The saved fit needs {reference}, which"
    if module_name == "__main__" and not hasattr(sys.modules["__main__"], class_name.split(".")[0]):
        raise InputError(
            f"{needs} a script or notebook defined; move it into a module of its own, import it "
            "from there, and save the fit again."
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
    if not (isinstance(target, type) and issubclass(target, eqx.Module)):
        raise InputError(
            f"The saved fit names {reference}, which is no model; it was not written by penode."
        )
    return target


def write_archive(folder: Path, document: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
    """Write ``fit.json`` and ``fit.npz`` into a folder, the JSON last, each in one step."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile() as buffer:
        np.savez_compressed(buffer, **arrays)
        buffer.seek(0)
        content = buffer.read()
    write_atomically(folder / "fit.npz", content)
    write_atomically(folder / "fit.json", to_json({**document, _DIGEST: _sha256(content)}))


def read_archive(folder: Path) -> tuple[dict[str, Any], dict[str, FloatArray]]:
    """Read what `write_archive` wrote.

    Raises
    ------
    InputError
        If a file is missing or damaged; the message names it.
    """
    try:
        document = json.loads((folder / "fit.json").read_text())
        content = (folder / "fit.npz").read_bytes()
        if not isinstance(document, dict) or document.pop(_DIGEST, None) != _sha256(content):
            raise ValueError("its two files do not belong together")
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except FileNotFoundError as error:
        raise InputError(
            f"{error.filename}: no such file; give the folder that `penode identify --out` wrote."
        ) from error
    except (ValueError, OSError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(
            f"{folder}: the saved fit is damaged ({error}); run the identification again."
        ) from error
    return document, arrays
