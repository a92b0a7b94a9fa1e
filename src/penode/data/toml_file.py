"""TOML files: read, and refused with one sentence that names the file and the entry."""

import math
import tomllib
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

from penode.data.content import Content
from penode.errors import InputError, did_you_mean

# Bytes of the longest file; people write these.
_LONGEST = 1 << 20
# Whole numbers of TOML.
_WHOLES = range(-(2**63), 2**63)
_VALUE_SHOWN = 200


@dataclass(frozen=True)
class Kind:
    """What an entry may hold, in words ("give a whole number") and as a test of a value."""

    words: str
    holds: Callable[[Any], bool]


def is_whole(value: object) -> TypeGuard[int]:
    """Return whether a value is a whole number of 64 bits; true and false are none."""
    return isinstance(value, int) and not isinstance(value, bool) and value in _WHOLES


def is_number(value: object) -> bool:
    """Return whether a value is a number, infinities among them; true and false are none."""
    return isinstance(value, float) or is_whole(value)


TEXT = Kind("text", lambda value: isinstance(value, str))
FLAG = Kind("true or false", lambda value: isinstance(value, bool))
NUMBER = Kind("a number", is_number)
FINITE = Kind("a finite number", lambda value: is_number(value) and math.isfinite(value))
FACTOR = Kind("a number other than 0", lambda v: is_number(v) and math.isfinite(v) and v != 0)
POSITIVE = Kind("a number above zero", lambda v: is_number(v) and 0 < v < math.inf)
SIGN = Kind("1 or -1", lambda value: is_whole(value) and value in (1, -1))
WHOLE = Kind("a whole number", is_whole)
NATURAL = Kind("a whole number from 0", lambda value: is_whole(value) and value >= 0)
COUNT = Kind("a whole number from 1", lambda value: is_whole(value) and value >= 1)
NAMES = Kind(
    "names in brackets",
    lambda value: isinstance(value, list) and all(isinstance(one, str) for one in value),
)
WHOLES = Kind(
    "whole numbers in brackets",
    lambda value: isinstance(value, list) and all(map(is_whole, value)),
)
TABLE = Kind("a table", lambda value: isinstance(value, dict))


def read_toml(path: Path) -> dict[str, Any]:
    """Return the entries of a TOML file (UTF-8), refusing what is longer than 1 MiB or not TOML."""
    try:
        with Content(str(path)) as content:
            if content.size > _LONGEST:
                raise InputError(
                    f"{path}: the file must have at most {_LONGEST} bytes, got {content.size}; "
                    "name a text file with settings."
                )
            entries = tomllib.loads(content.all().decode("utf-8-sig"))
        _require_64_bits(path, entries)
        return entries
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise InputError(f"{path}: the file cannot be read ({reason}); check the path.") from error
    except RecursionError as error:
        raise InputError(f"{path}: tables or lists nested too deeply; nest them less.") from error
    except InputError:
        raise
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: not UTF-8 text (byte {error.start + 1}); save the file as UTF-8."
        ) from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not a TOML file ({error}); correct that line.") from error
    except ValueError as error:  # Python reads no number of more than 4300 digits
        raise InputError(f"{path}: a whole number of thousands of digits; shorten it.") from error


def _require_64_bits(path: Path, entry: object) -> None:
    """Refuse a whole number that no TOML file may hold."""
    if isinstance(entry, (dict, list)):
        for item in entry.values() if isinstance(entry, dict) else entry:
            _require_64_bits(path, item)
    elif isinstance(entry, int) and entry not in _WHOLES:
        digits = str(entry)
        shown = digits if len(digits) < 30 else f"{digits[:12]}... ({len(digits)} digits)"
        raise InputError(f"{path}: a whole number must have at most 64 bits, got {shown}.")


def require(where: str, value: object, kind: Kind) -> None:
    """Refuse a value that is not of the kind; ``where`` names the entry."""
    if not kind.holds(value):
        raise InputError(f"{where} = {_shown(value)} came; give {kind.words}.")


def _shown(value: object) -> str:
    """Return a value as TOML text has it, cut where it is long."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):  # too deep, or a number of thousands of digits
        return f"a {type(value).__name__}"
    return text if len(text) <= _VALUE_SHOWN else text[:_VALUE_SHOWN] + "..."


def require_known(where: str, entries: Collection[str], known: Collection[str]) -> None:
    """Refuse entries of unknown name in a table; the message suggests the nearest one."""
    for key in entries:
        if key not in known:
            raise InputError(
                f"{where} {key} came{did_you_mean(key, known)}; known are {', '.join(known)}."
            )


def require_kinds(where: str, entries: Mapping[str, Any], kinds: Mapping[str, Kind]) -> None:
    """Refuse entries that are unknown, not among ``kinds``, or of the wrong kind."""
    require_known(where, entries, kinds)
    for key, value in entries.items():
        require(f"{where} {key}", value, kinds[key])
