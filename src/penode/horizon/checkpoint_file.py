"""The file of a checkpoint: one JSON document with a digest of its own."""

import base64
import io
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from penode.arrays import FloatArray
from penode.errors import InputError
from penode.fit.archive import content_of, from_json, sha256, to_json
from penode.fit.model_tree import describe_module, restore_module

SCHEMA = "penode-checkpoint/2"
#: The schema before what a climb began with was kept; it is read.
_EARLIER = "penode-checkpoint/1"


@dataclass(frozen=True, eq=False)
class Rung:
    """Where a finished rung ended, and why; everything else follows from it by one evaluation."""

    horizon: int
    raw: FloatArray
    evaluations: int
    outcome: str


@dataclass(frozen=True, eq=False)
class Record:
    """Content of the file."""

    # What was asked for, and what the climb was given, in words by name.
    asked: Mapping[str, str]
    given: Mapping[str, str]
    # Raw parameters at which the climb began, and what it began with, as `packed` gives it.
    start: FloatArray
    began: Mapping[str, Any]
    rungs: tuple[Rung, ...] = ()

    def restored(self, path: Path) -> Any:
        """Return what the climb began with."""
        try:
            content = io.BytesIO(base64.b64decode(self.began["arrays"]))
            with np.load(content, allow_pickle=False) as stored:
                return restore_module(self.began["tree"], dict(stored))
        except (LookupError, TypeError, ValueError) as error:
            raise _unreadable(path, error) from error


def text(record: Record) -> str:
    """Return the content of the file."""
    document = {"schema": SCHEMA, **asdict(record)}
    return to_json({**document, "sha256": _digest(document)}, exact=True)


def _digest(document: Any) -> str:
    return sha256(to_json(document, exact=True).encode())


def read(path: Path) -> Record | None:
    """Return the record in the file, or None where there is no file."""
    try:
        document = from_json(content_of(path))
        if not isinstance(document, dict) or document.pop("sha256", None) != _digest(document):
            raise ValueError("it is not as it was written")
        if document["schema"] not in (SCHEMA, _EARLIER):
            raise ValueError(f"its schema is {document['schema']}, not {SCHEMA}")
        rungs = [Rung(**{**rung, "raw": _numbers(rung["raw"])}) for rung in document["rungs"]]
        began = document.get("began", packed(None))
        asked, start = document.get("asked", {}), _numbers(document["start"])
        return Record(asked, document["given"], start, began, tuple(rungs))
    except FileNotFoundError:
        return None
    except InputError:
        raise
    except (OSError, ValueError, LookupError, TypeError, RecursionError) as error:
        raise _unreadable(path, error) from error


def _numbers(values: list[float]) -> FloatArray:
    return np.array(values, dtype=np.float64)


def _unreadable(path: Path, error: Exception) -> InputError:
    reason = error.strerror if isinstance(error, OSError) else error
    return InputError(
        f"{path}: the checkpoint cannot be read ({reason}); begin again without resuming."
    )


def packed(began: object) -> dict[str, Any]:
    """Return what a climb began with as JSON values, its arrays as the text of an NPZ."""
    arrays: dict[str, FloatArray] = {}
    tree, content = describe_module(began, "began", arrays), io.BytesIO()
    np.savez_compressed(content, **arrays)  # type: ignore[arg-type]
    return {"tree": tree, "arrays": base64.b64encode(content.getvalue()).decode()}
