"""Files of a saved fit: one JSON document and one NPZ of arrays, written atomically, no pickle."""

import hashlib
import io
import json
import os
import socket
import threading
import zipfile
import zlib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from penode.arrays import FloatArray
from penode.errors import InputError

#: Key under which the document names the arrays it belongs to, and that of its own digest.
_ARRAYS, _OWN = "arrays_sha256", "sha256"
#: Keys of the objects that stand for numbers which JSON lacks.
_NUMBER, _COMPLEX = "json:number", "json:complex"
#: Bytes that any arrays may unpack to, and those for each byte of their file.
_UNPACKED, _COMPRESSION = 1 << 26, 20
_HOST = hashlib.sha256(socket.gethostname().encode()).hexdigest()[:8]


def sha256(content: bytes) -> str:
    """Return the digest by which files of one result are recognised."""
    return hashlib.sha256(content).hexdigest()


def write_atomically(path: Path, content: str | bytes) -> None:
    """Replace a file in one step: a reader sees the old one or the new one, whole.

    What processes that died left of this file is removed.
    """
    data = content.encode() if isinstance(content, str) else content
    made = [folder for folder in path.parents if not folder.exists()]
    path.parent.mkdir(parents=True, exist_ok=True)
    # The file's own name may be as long as a name can be.
    stem = f".{sha256(path.name.encode())[:12]}.{_HOST}"
    for left in path.parent.glob(f"{stem}.*.part"):
        if not _alive(int(left.name.split(".")[3])):
            left.unlink(missing_ok=True)
    temporary = path.parent / f"{stem}.{os.getpid()}.{threading.get_ident()}.part"
    try:
        temporary.write_bytes(data)
        temporary.replace(path)
    except BaseException as error:
        name_file(error, path)
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
            for folder in made:
                folder.rmdir()
        raise


def name_file(error: BaseException, path: Path) -> None:
    """Tell an error of writing, which names no file, which one it was."""
    if isinstance(error, OSError) and error.filename is None:
        error.filename = str(path)


def _alive(process: int) -> bool:
    """Return whether a process of this machine runs, True where that cannot be asked."""
    if os.name == "nt":  # signal 0 would end it there
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def to_json(document: Any, exact: bool = False) -> str:
    """Return strict JSON of mappings, lists, arrays, text, None and numbers; arrays become lists.

    ``exact`` writes numbers that JSON lacks so that `from_json` reads them back; without it those
    that are not finite are null, and complex ones pairs.
    """
    return json.dumps(_plain(document, exact), indent=2, allow_nan=False) + "\n"


def from_json(text: str | bytes) -> Any:
    """Return the document that `to_json` was given, as far as JSON distinguishes it."""
    return json.loads(text, object_hook=_number)


def _plain(value: Any, exact: bool) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item, exact) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item, exact) for item in value]
    if isinstance(value, (float, np.floating)):
        missing = {_NUMBER: repr(float(value))} if exact else None
        return float(value) if np.isfinite(value) else missing
    if isinstance(value, (complex, np.complexfloating)):
        pair = _plain([value.real, value.imag], exact)
        return {_COMPLEX: pair} if exact else pair
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return _plain(value.tolist(), exact)
    return value


def _number(entry: dict[str, Any]) -> Any:
    """Return the number that an object of JSON stands for, or the object."""
    if entry.keys() == {_NUMBER}:
        return float(entry[_NUMBER])
    if entry.keys() == {_COMPLEX}:
        return complex(*entry[_COMPLEX])
    return entry


def archive(document: Mapping[str, Any], arrays: Mapping[str, Any]) -> dict[str, bytes]:
    """Return ``fit.npz`` and ``fit.json`` by name, each with what shows that it is whole."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    content = buffer.getvalue()
    whole = {**document, _ARRAYS: sha256(content)}
    text = to_json({**whole, _OWN: _digest(whole)}, exact=True)
    return {"fit.npz": content, "fit.json": text.encode()}


def content_of(path: Path) -> bytes:
    """Return the bytes of a file of a saved fit; refuse a pipe or a device, which may never end."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise InputError(f"{path}: this is a pipe or a device where a file was wanted; remove it.")
    return path.read_bytes()


def read_archive(folder: Path) -> tuple[dict[str, Any], dict[str, FloatArray]]:
    """Read what `archive` gave; refuse a missing or damaged file, which the message names."""
    try:
        document = from_json(content_of(folder / "fit.json"))
        content = content_of(folder / "fit.npz")
        _require_whole(document, content)
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            _require_plausible(stored, len(content))
            arrays = {name: stored[name] for name in stored.files}
    except InputError:
        raise
    except FileNotFoundError as error:
        missing = error.filename if folder.parent.is_dir() else folder.parent
        raise InputError(
            f"{missing}: no such file or folder; give the folder that `penode identify --out` "
            "wrote."
        ) from error
    except (ValueError, OSError, EOFError, RecursionError, *_BROKEN_ZIP) as error:
        raise InputError(
            f"{folder}: the saved fit is damaged ({_in_short(error)}); run the identification "
            "again."
        ) from error
    return document, arrays


#: What reading a damaged NPZ raises, beside errors of values and of the system.
_BROKEN_ZIP = (zipfile.BadZipFile, zlib.error, NotImplementedError, SyntaxError)


def _require_plausible(stored: Any, size: int) -> None:
    """Refuse arrays that are far larger than their file, before they are unpacked."""
    unpacked = sum(entry.file_size for entry in stored.zip.infolist())
    if unpacked > _UNPACKED + _COMPRESSION * size:
        raise ValueError(f"{size} bytes unpack to {unpacked}")


def _digest(document: Any) -> str:
    return sha256(to_json(document, exact=True).encode())


def _require_whole(document: Any, content: bytes) -> None:
    """Take the digests out of a document, or refuse it; earlier ones have none of their own."""
    if not isinstance(document, dict):
        raise ValueError("its document is not a table")
    own = document.pop(_OWN, None)
    if own is not None and own != _digest(document):
        raise ValueError("fit.json is not as it was written")
    if document.pop(_ARRAYS, None) != sha256(content):
        raise ValueError("its two files do not belong together")


def _in_short(error: BaseException) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
