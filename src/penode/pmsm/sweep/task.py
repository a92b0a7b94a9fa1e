"""One task of a sweep: an identification, known by the content of all that decides its result."""

import hashlib
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from penode.arrays import FloatArray
from penode.errors import InputError
from penode.fit.archive import to_json
from penode.fit.fit import Fit
from penode.fit.model_tree import describe_module
from penode.fit.provenance import versions
from penode.pmsm.study import identify
from penode.pmsm.study_file import StudyFile

#: Characters of a key: with 80 bits no two of a million tasks have one key.
_KEY = 20
#: What is computed with, beside the packages that a fit names.
_BELOW = ("equinox", "jaxlib")
_CODE = ("*.py", "*.c")

#: Name of the table of a sweep while it grows.
LINES = "table.jsonl"

#: What the table has of the map: flux linkages in Vs, their deviations, inductances in H.
MAP_COLUMNS = ("psi_d", "psi_q", "psi_d_std", "psi_q_std", "l_dd", "l_dq", "l_qq")

#: A task was answered or refused for good, or failed for a reason that may pass.
ANSWERED, REFUSED, FAILED = "done", "refused", "failed"


@dataclass(frozen=True, eq=False)
class Task:
    """One identification of files, with the SHA-256 of each, by one version of the code.

    ``asked`` includes horizon and seed; ``current`` is i_d and i_q in A at which the map is put
    into the table.
    """

    files: tuple[str, ...]
    digests: tuple[str, ...]
    asked: StudyFile
    current: tuple[float, float]
    code: str

    @cached_property
    def key(self) -> str:
        """What the result depends on, in 20 hexadecimal digits: data, settings and code."""
        arrays: dict[str, FloatArray] = {}
        settings = describe_module((self.asked.study, self.asked.mapping), "asked", arrays)
        named = [(Path(f).name, d) for f, d in zip(self.files, self.digests, strict=True)]
        digest = hashlib.sha256(
            to_json([self.code, named, settings, self.current], exact=True).encode()
        )
        for name in sorted(arrays):
            digest.update(name.encode() + np.asarray(arrays[name]).tobytes())
        return digest.hexdigest()[:_KEY]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of a task: its row's columns, and the saved fit, names to contents, if any."""

    values: Mapping[str, Any]
    files: Mapping[str, bytes] = field(default_factory=dict)


@cache
def code_version() -> str:
    """Return a digest of penode's source and of the versions of what it computes with."""
    digest, folder = hashlib.sha256(), Path(__file__).parents[2]
    for path in sorted(path for kind in _CODE for path in folder.rglob(kind)):
        digest.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    digest.update(to_json({**versions(), **{name: version(name) for name in _BELOW}}).encode())
    return digest.hexdigest()


def run(task: Task) -> Outcome:
    """Do a task; whatever becomes of it is an outcome."""
    began, spent = time.monotonic(), time.process_time()
    try:
        fit = _identified(task)
        outcome = Outcome(_columns(fit, task.current), fit.files())
    except _Passing as error:
        outcome = failed(str(error))
    except InputError as error:
        outcome = Outcome({"status": REFUSED, "error": _sentence(error)})
    except MemoryError as error:
        what = f" ({error})" if str(error) else ""
        outcome = failed(f"Not enough memory{what}; ask for fewer processes.")
    except Exception as error:
        outcome = failed(f"Internal error of penode ({type(error).__name__}: {error}).")
    times = {
        "seconds": round(time.monotonic() - began, 3),
        "processor_seconds": round(time.process_time() - spent, 3),
    }
    return Outcome({**outcome.values, **times}, outcome.files)


def failed(sentence: str) -> Outcome:
    """Return the outcome of a task that is to be tried again when the sweep is."""
    return Outcome({"status": FAILED, "error": _sentence(sentence)})


class _Passing(Exception):  # noqa: N818 (a reason, shown as a row)
    """A reason to fail that says nothing of data or settings."""


def _identified(task: Task) -> Fit:
    if code_version() != task.code:
        raise _Passing(
            "The worker's penode or JAX is another version than that of the sweep; install the "
            "same on all machines."
        )
    files = [task.asked.load_stretches(path) for path in task.files]
    for (first, *_), path, digest in zip(files, task.files, task.digests, strict=True):
        if first.source.sha256 != digest:
            name = Path(path).name
            raise _Passing(f"{name}: the file changed during the sweep; start it again.")
    return identify([stretch for file in files for stretch in file], study=task.asked.study)


def _columns(fit: Fit, current: tuple[float, float]) -> dict[str, Any]:
    choice = fit.horizon
    rung = next(r for r in choice.ladder if r.horizon == choice.selected)
    columns: dict[str, Any] = {
        "status": ANSWERED,
        "verdict": choice.verdict,
        "answered": choice.answered,
        "objections": "; ".join(objection.name for objection in choice.objections),
        "reason": _sentence(choice.reason),
        "warnings": len(fit.warnings),
        "selected": choice.selected,
        "rmse": rung.rmse,
        "free_run_rmse": rung.free_run_rmse,
    }
    for name, estimate in fit.parameters.items():
        low, high = estimate.interval_95
        columns |= {name: estimate.value, f"{name}_std": estimate.std}
        columns |= {f"{name}_low": low, f"{name}_high": high}
    return {**columns, **_map_at(fit, current)}


def _map_at(fit: Fit, current: tuple[float, float]) -> dict[str, float]:
    """Return the map at a current, or nothing where it was not recorded there."""
    point = np.array([current])
    if not fit.supported(point)[0]:
        return {}
    psi, inductance = fit.flux_map(*current), fit.differential_inductance(*current)
    deviation = fit.learned_deviation(point)[0]
    values = (*psi, *deviation, *inductance[0], inductance[1, 1])
    return dict(zip(MAP_COLUMNS, map(float, values), strict=True))


def _sentence(text: object) -> str:
    return " ".join(str(text).split())
