"""Study files: what to identify, and how the columns of the recordings map to channels, as TOML."""

import math
import tomllib
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from penode.data.experiment import Experiment
from penode.data.mapping import Origin
from penode.data.table import TIME
from penode.data.units import did_you_mean
from penode.errors import InputError
from penode.pmsm.machine.terms import DeadTime, terms_of
from penode.pmsm.recording.drive_mapping import RECORDED, DriveMapping, DriveOrigin
from penode.pmsm.recording.name_plate import NamePlate
from penode.pmsm.study import DEFAULT_STUDY, Study

#: Entries of a channel and what they hold.
CHANNEL_ENTRIES = {
    "column": "text",
    "unit": "text",
    "scale": "a number",
    "sign": "1 or -1",
    "delay": "a whole number",
    "times": "text",
    "rms": "true or false",
    "mechanical": "true or false",
}
_TIME_ENTRIES = {key: CHANNEL_ENTRIES[key] for key in ("column", "unit", "scale")}
_HOLDS: Mapping[str, Callable[[Any], bool]] = {
    "text": lambda value: isinstance(value, str),
    "a number": lambda value: _is_number(value) and math.isfinite(value) and value != 0,
    "a number above zero": lambda value: _is_number(value) and 0 < value < math.inf,
    "1 or -1": lambda value: _is_whole(value) and value in (1, -1),
    "a whole number": lambda value: _is_whole(value),
    "a whole number from 1": lambda value: _is_whole(value) and value >= 1,
    "true or false": lambda value: isinstance(value, bool),
    "names in brackets": lambda value: (
        isinstance(value, list) and all(isinstance(one, str) for one in value)
    ),
    "whole numbers in brackets": lambda value: (
        isinstance(value, list) and all(map(_is_whole, value))
    ),
    'a whole number from 1, or "auto"': lambda value: value == "auto" or _is_whole(value),
    '"linear"': lambda value: value == "linear",
    "a table": lambda value: isinstance(value, dict),
}
_SETTINGS = {
    "flux_map": "text",
    "horizon": 'a whole number from 1, or "auto"',
    "pole_pairs": "a whole number from 1",
    "seed": "a whole number",
    "inverter": "true or false",
    "terms": "names in brackets",
    "angle_orders": "whole numbers in brackets",
    "hold": "text",
    "purpose": "text",
    "resample": '"linear"',
    "name_plate": "a table",
    "channels": "a table",
}
_NAME_PLATE = {entry.name: "a number above zero" for entry in fields(NamePlate)}


@dataclass(frozen=True)
class StudyFile:
    """What a study file says.

    Attributes
    ----------
    study : Study
        Flux map, horizon, inverter, angle orders, hold, seed, pole pairs.
    mapping : DriveMapping
        Where the channels come from; that of canonical columns where the file maps none.
    name_plate : NamePlate
        What is known of the machine, for `penode check`.
    """

    study: Study = DEFAULT_STUDY
    mapping: DriveMapping = field(default_factory=DriveMapping)
    name_plate: NamePlate = field(default_factory=NamePlate)

    def load(self, path: str | Path) -> Experiment:
        """Load a recording as the file maps it; see `DriveMapping.load`."""
        return self.mapping.load(path)


def load_study(path: str | Path | None = None, given: Mapping[str, Any] | None = None) -> StudyFile:
    """Read a study file.

    Parameters
    ----------
    path : str or Path, optional
        A TOML file; without one, canonical columns and the default study.
    given : mapping of str to object, optional
        Entries that override the file's.

    Returns
    -------
    StudyFile

    Raises
    ------
    InputError
        If there is no such file, it is not TOML, or an entry is unknown, missing or of the wrong
        kind; the message names the file and the entry, and suggests the nearest known one.
    """
    entries = {} if path is None else _entries(Path(path))
    read = _read(path, entries)
    return replace(read, study=_study({**entries, **given})) if given else read


def _entries(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise InputError(f"{path}: the study file cannot be read ({reason}); check it.") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a TOML file ({error}); mend that line.") from error


def _read(path: str | Path | None, entries: dict[str, Any]) -> StudyFile:
    try:
        return _study_file(entries)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _study_file(entries: dict[str, Any]) -> StudyFile:
    _check("entry", entries, _SETTINGS)
    _require_known("channel", entries.get("channels", {}), RECORDED)
    channels = {name: _channel(name, e) for name, e in entries.get("channels", {}).items()}
    mapping = DriveMapping(channels, entries.get("pole_pairs"), "resample" in entries)
    plate = entries.get("name_plate", {})
    _check("name_plate:", plate, _NAME_PLATE)
    return StudyFile(_study(entries), mapping, NamePlate(**plate))


def _study(entries: Mapping[str, Any]) -> Study:
    """Return the study of entries of a file, some of them overridden by options."""
    settings = {f.name: entries[f.name] for f in fields(Study) if f.name in entries}
    if settings.get("horizon") == "auto":
        settings["horizon"] = None
    if "angle_orders" in settings:
        settings["angle_orders"] = tuple(settings["angle_orders"])
    terms = terms_of(settings.get("terms", ()))
    if "inverter" in entries:  # a word for dead time, which is otherwise left to the data
        settings["candidates"] = ()
        terms = tuple(term for term in terms if not isinstance(term, DeadTime))
        terms += (DeadTime(),) if entries["inverter"] else ()
    return Study(**{**settings, "terms": terms})


def _channel(name: str, entry: Any) -> DriveOrigin:
    """Return one channel: a column's name alone, or a table."""
    if isinstance(entry, str):
        entry = {"column": entry}
    if not isinstance(entry, dict):
        raise InputError(f"channel {name} = {entry!r} came; give the name of a column, or a table.")
    _check(f"channel {name}:", entry, _TIME_ENTRIES if name == TIME else CHANNEL_ENTRIES)
    if "column" not in entry:
        raise InputError(f"channel {name}: column is missing; name the column of the file.")
    own = {key: entry[key] for key in ("rms", "mechanical") if key in entry}
    rest = {key: value for key, value in entry.items() if key not in own}
    return DriveOrigin(Origin(si=RECORDED[name], **rest), **own)


def _check(what: str, entries: Mapping[str, Any], wanted: Mapping[str, str]) -> None:
    """Refuse entries that are unknown or of the wrong kind."""
    _require_known(what, entries, wanted)
    for key, value in entries.items():
        if not _HOLDS[wanted[key]](value):
            raise InputError(f"{what} {key} = {value!r} came; give {wanted[key]}.")


def _require_known(what: str, came: Mapping[str, Any], known: Collection[str]) -> None:
    for key in came:
        if key not in known:
            raise InputError(
                f"{what} {key} came{did_you_mean(key, known)}; known are {', '.join(known)}."
            )


def _is_whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_number(value: object) -> bool:
    return isinstance(value, float) or _is_whole(value)
