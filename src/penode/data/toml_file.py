"""TOML files: read and held against a schema; refused in a sentence with file, key and value."""

import re
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
from msgspec import inspect as schemas

from penode.data.content import Content
from penode.errors import InputError, did_you_mean

# Bytes of the longest file; people write these.
_LONGEST = 1 << 20
# Whole numbers of TOML.
_WHOLES = range(-(2**63), 2**63)
_VALUE_SHOWN = 200
_LARGEST = sys.float_info.max

#: Numbers of a schema, beside those of Python.
FINITE = Annotated[float, msgspec.Meta(ge=-_LARGEST, le=_LARGEST)]
POSITIVE = Annotated[float, msgspec.Meta(gt=0, le=_LARGEST)]
NATURAL = Annotated[int, msgspec.Meta(ge=0)]
COUNT = Annotated[int, msgspec.Meta(ge=1)]

_Schema = TypeVar("_Schema")


def read_toml(path: Path) -> dict[str, Any]:
    """Return the entries of a TOML file (UTF-8), refusing what is longer than 1 MiB or not TOML."""
    try:
        with Content(str(path)) as content:
            if content.size > _LONGEST:
                raise InputError(
                    f"{path}: a file of settings must have at most {_LONGEST} bytes, got "
                    f"{content.size}; name another file (a recording is no study file)."
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
        twice = "an entry is given twice; remove one, " if "overwrite" in str(error) else ""
        raise InputError(f"{path}: not a TOML file ({twice}{error}); correct that line.") from error
    except ValueError as error:  # Python reads no number of more than 4300 digits
        raise InputError(f"{path}: a whole number of thousands of digits; shorten it.") from error


def _require_64_bits(path: Path, entry: object) -> None:
    """Refuse a whole number that no TOML file may hold."""
    if isinstance(entry, dict):
        for item in entry.values():
            _require_64_bits(path, item)
    elif isinstance(entry, list):
        for item in entry:
            _require_64_bits(path, item)
    elif isinstance(entry, int) and entry not in _WHOLES:
        digits = str(entry)
        shown = digits if len(digits) < 30 else f"{digits[:12]}... ({len(digits)} digits)"
        raise InputError(f"{path}: whole numbers must have at most 64 bits, got {shown}.")


def held_against(schema: type[_Schema], entries: Mapping[str, Any], where: str) -> _Schema:
    """Return entries as a schema of msgspec has them, or refuse them.

    ``where`` begins the sentence: the file, and the table in it.
    """
    try:
        return msgspec.convert(entries, schema)
    except msgspec.ValidationError as error:
        raise InputError(f"{where}{_refusal(str(error), schema, entries)}") from error


def _refusal(error: str, schema: Any, entry: Any) -> str:
    """Return msgspec's error, ``Expected `int`, got `str` - at `$.horizon` ``, as a sentence."""
    message, _, path = error.partition(" - at `$")
    whole = wanted = schemas.type_info(schema)
    place = ""
    for key in re.findall(r"[^].[`]+", path):
        wanted = _within(wanted, entry, key)
        index = int(key) if key.isdigit() else key
        entry, place = entry[index], f"{place}[{key}]" if key.isdigit() else f"{place}.{key}"
    place, named = place.lstrip("."), re.search("`(.*)`", message)
    inside = f"{place}." if place else ""
    if named and "unknown field" in message:
        known = _fields(wanted, entry)
        nearest = did_you_mean(named[1], known)
        if place and named[1] in _fields(whole, {}):
            return f"{inside}{named[1]} is unknown; {named[1]} belongs above all tables."
        return f"{inside}{named[1]} is unknown{nearest}; known are {', '.join(known)}."
    if named and "missing required field" in message:
        return (
            f"{inside}{named[1]} is missing; it must be {_words(_within(wanted, entry, named[1]))}."
        )
    if not re.match("Expected|Invalid|Number", message):  # a schema's own check
        return ": ".join(filter(None, [place, message]))
    return f"{place} must be {_words(wanted)}, got {_shown(entry)}."


def _fields(wanted: Any, entry: Any) -> dict[str, Any]:
    """Return the entries that a table may have; of several tables it is the one of its kind."""
    tables = [one for one in _choices(wanted) if isinstance(one, schemas.StructType)]
    kinds: dict[Any, Any] = {
        one.tag_field: schemas.LiteralType(tuple(t.tag for t in tables)) for one in tables
    }
    known = [one for one in tables if one.tag_field is None or one.tag == entry.get(one.tag_field)]
    fields = {field.encode_name: field.type for one in known for field in one.fields}
    return fields or kinds


def _within(wanted: Any, entry: Any, key: str) -> Any:
    """Return what is wanted of an entry of a table, or of an item of a list."""
    if not key.isdigit():
        return _fields(wanted, entry)[key]
    for one in _choices(wanted):
        if isinstance(one, schemas.TupleType):
            return one.item_types[int(key)]
        if hasattr(one, "item_type"):
            return one.item_type
    raise KeyError(key)


def _choices(wanted: Any) -> tuple[Any, ...]:
    return wanted.types if isinstance(wanted, schemas.UnionType) else (wanted,)


def _words(wanted: Any) -> str:
    """Return what a schema wants in words; None only stands for an entry that is not there."""
    tags = [repr(one.tag) for one in _choices(wanted) if getattr(one, "tag", None)]
    words = [_WORDS[type(one)](one) for one in _choices(wanted) if type(one) in _WORDS]
    kinds = [f"a table with kind = {' or '.join(tags)}"] if tags else []
    return " or ".join([*dict.fromkeys(word for word in words if word), *kinds])


def _bounded(name: str, wanted: Any) -> str:
    bounds = {">": wanted.gt, ">=": wanted.ge, "<=": wanted.le}
    finite = "finite " if wanted.le == _LARGEST else ""
    said = [f"{sign} {b}" for sign, b in bounds.items() if b is not None and abs(b) < _LARGEST]
    return " ".join([f"a {finite}{name}", " and ".join(said)]).rstrip()


_WORDS: dict[Any, Any] = {
    schemas.StrType: lambda _: "text",
    schemas.BoolType: lambda _: "true or false",
    schemas.IntType: lambda one: _bounded("whole number", one),
    schemas.FloatType: lambda one: _bounded("number", one),
    schemas.LiteralType: lambda one: " or ".join(map(repr, one.values)),
    schemas.ListType: lambda one: f"a list, each item {_words(one.item_type)}",
    schemas.VarTupleType: lambda one: f"a list, each item {_words(one.item_type)}",
    schemas.TupleType: lambda one: f"a list of {len(one.item_types)}",
    schemas.DictType: lambda _: "a table",
    schemas.StructType: lambda one: "" if one.tag else "a table",
}


def _shown(value: object) -> str:
    """Return a value, cut where it is long."""
    text = repr(value)
    return text if len(text) <= _VALUE_SHOWN else text[:_VALUE_SHOWN] + "..."
