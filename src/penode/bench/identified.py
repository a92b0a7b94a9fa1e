"""A machine of the bench from what an identification wrote; files are all that the two share."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from penode.bench.map_import import ImportedMachine, import_machine
from penode.errors import InputError

# Verdicts under which R and the map must not be used.
_DOUBTFUL = ("no plateau", "not identifiable", "implausible")


def identified_machine(
    folder: str | Path,
    *,
    resistance: float | None = None,
    pole_pairs: int | None = None,
    current_limit: float | None = None,
    inductance_d: float | None = None,
    inductance_q: float | None = None,
) -> ImportedMachine:
    """Make a machine of ``flux_map.csv`` and ``result.json`` in a folder.

    Parameters
    ----------
    folder : str or Path
        Folder that ``penode identify`` wrote.
    resistance : float, optional
        In ohm; by default the one identified.
    pole_pairs : int, optional
        By default those given to the identification.
    current_limit : float, optional
        Largest permitted current, peak value, in A; by default the largest that the map covers
        along the axis it covers less.
    inductance_d, inductance_q : float, optional
        In H, of the data sheet: what the current controller is tuned from; by default those of the
        map at no current.

    Returns
    -------
    ImportedMachine
        Named after the folder, without harmonics of the angle. A doubtful verdict is a warning.

    Raises
    ------
    InputError
        If a file is missing or not what an identification of a machine writes, if the pole
        pairs are not given, or the map is unusable (see `import_machine`).
    """
    folder = Path(folder)
    source = folder / "flux_map.csv"
    result = _read_result(folder / "result.json")
    if not source.is_file():
        raise InputError(f"{source}: no such file; give a folder that penode identify wrote.")
    _require_same_result(source, result)
    if pole_pairs is None:
        pole_pairs = result.get("provenance", {}).get("pole_pairs")
    if pole_pairs is None:
        raise InputError(
            f"{folder}: the identification was not given the pole pairs; add pole_pairs = N beside "
            "result."
        )
    for name, value in (("inductance_d", inductance_d), ("inductance_q", inductance_q)):
        if value is not None and not value > 0:
            raise InputError(f"{folder}: {name} = {value} came; give it in H, above zero.")
    doubts = _doubts(folder, result) if resistance is None else ()
    imported = import_machine(
        source,
        resistance=_resistance(folder, result) if resistance is None else resistance,
        pole_pairs=pole_pairs,
        current_limit=current_limit,
    )
    machine = replace(
        imported.machine,
        name=folder.resolve().name,
        inductance_d=inductance_d or imported.machine.inductance_d,
        inductance_q=inductance_q or imported.machine.inductance_q,
    )
    findings = replace(imported.findings, warnings=(*doubts, *imported.findings.warnings))
    return ImportedMachine(machine, findings)


def _read_result(path: Path) -> Mapping[str, Any]:
    try:
        result = json.loads(path.read_text())
    except OSError as error:
        raise InputError(
            f"{path}: no such file; give a folder that penode identify wrote."
        ) from error
    except ValueError as error:
        raise InputError(f"{path}: not JSON ({error}); identify again.") from error
    if not isinstance(result, dict):
        raise InputError(f"{path}: not a result of penode identify; give its folder.")
    return result


def _require_same_result(source: Path, result: Mapping[str, Any]) -> None:
    """Refuse a map other than the one that the result was written with."""
    files = result.get("files")
    digest = files.get(source.name) if isinstance(files, dict) else None
    if digest is not None and digest != hashlib.sha256(source.read_bytes()).hexdigest():
        raise InputError(
            f"{source}: not the file that result.json beside it was written with; put back the one "
            "that was, or run the identification again."
        )


def _resistance(folder: Path, result: Mapping[str, Any]) -> float:
    try:
        return float(result["parameters"]["R"]["value"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{folder}: result.json has no R; add resistance, in ohm, beside result."
        ) from error


def _doubts(folder: Path, result: Mapping[str, Any]) -> tuple[str, ...]:
    verdict = result.get("horizon", {}).get("verdict")
    if verdict not in _DOUBTFUL:
        return ()
    return (f"the verdict of {folder} is {verdict!r}: its R and its map are doubtful",)
