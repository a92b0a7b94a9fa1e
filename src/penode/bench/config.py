"""A simulation as a TOML file: machine, reference, speed and every imperfection, by name."""

import inspect
import typing
from collections.abc import Callable
from dataclasses import dataclass, is_dataclass
from functools import reduce
from importlib import resources
from operator import or_
from pathlib import Path
from typing import Any

import msgspec

from penode.bench.drive import Drive
from penode.bench.inverter import (
    CarrierPwm,
    Circle,
    Hexagon,
    Hold,
    RotorHold,
    StationaryHold,
    VoltageLimit,
)
from penode.bench.machines import Machine, machine
from penode.bench.map_import import ImportedMachine, identified_machine, import_machine
from penode.bench.references import (
    GENERATOR,
    MOTOR,
    WHOLE_DISC,
    Domain,
    Injection,
    Lissajous,
    Reference,
    Spiral,
    Steps,
    stationary_grid,
)
from penode.bench.run import Recording, record
from penode.bench.shaft import FreeShaft, Speed, SpeedPoints, SpeedRipple
from penode.data.toml_file import FINITE, NATURAL, held_against, read_toml
from penode.errors import InputError

#: What a table's ``kind`` may name, wherever one of several records fits.
KINDS: dict[Any, dict[str, Callable[..., Any]]] = {
    Hold: {"rotor": RotorHold, "stationary": StationaryHold, "pwm": CarrierPwm},
    VoltageLimit: {"circle": Circle, "hexagon": Hexagon},
    Reference: {
        "lissajous": Lissajous,
        "spiral": Spiral,
        "steps": Steps,
        "stationary_grid": stationary_grid,
        "injection": Injection,
    },
    Speed: {"points": SpeedPoints, "ripple": SpeedRipple, "free": FreeShaft},
}
#: Where a machine may come from, besides its name.
_SOURCES: dict[str, Callable[..., ImportedMachine]] = {
    "map": import_machine,
    "result": identified_machine,
}
_DOMAINS = {"whole": WHOLE_DISC, "motor": MOTOR, "generator": GENERATOR}


@dataclass(frozen=True, eq=False)
class Simulation:
    """Everything that makes a recording.

    Attributes
    ----------
    machine : Machine
    reference : Reference
        Times in s to i_d and i_q in A.
    speed_rpm : Speed
        Mechanical speed in rpm, or a shaft.
    duration : float
        s.
    drive : Drive
    seed : int
        Seed of the measurement noise.
    warnings : tuple of str
        What was found in an imported map, a sentence each.
    result : Path or None
        Folder of the identification that the machine comes from.
    """

    machine: Machine
    reference: Reference
    speed_rpm: Speed
    duration: float
    drive: Drive
    seed: int
    warnings: tuple[str, ...] = ()
    result: Path | None = None

    def record(self) -> Recording:
        """Return the recording and the truth behind it; see `penode.bench.run.record`."""
        return record(
            self.machine,
            self.reference,
            speed_rpm=self.speed_rpm,
            duration=self.duration,
            drive=self.drive,
            seed=self.seed,
        )


def shipped_configs() -> dict[str, Path]:
    """Return the configurations that come with the package, by name."""
    folder = Path(str(resources.files("penode.bench"))) / "configs"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def load_config(source: str | Path) -> Simulation:
    """Read a simulation from a TOML file, or a shipped one by its name.

    Parameters
    ----------
    source : str or Path
        A path ending in ``.toml``, or a name from `shipped_configs`.

    Raises
    ------
    InputError
        If there is no such file or name, or an entry is missing, unknown or of the wrong kind;
        the message names the file and the entry.
    """
    path = shipped_configs().get(str(source), Path(source))
    if not path.is_file():
        raise InputError(
            f"{source}: no such file; give a .toml file or one of {', '.join(shipped_configs())}."
        )
    schema = msgspec.defstruct(
        "Simulation",
        [
            ("machine", str | dict[str, Any]),
            ("reference", _schema(Reference)),
            ("speed_rpm", _schema(Speed)),
            ("duration", FINITE),
            ("drive", _schema(Drive)),
            ("seed", NATURAL, 0),
        ],
        kw_only=True,
        forbid_unknown_fields=True,
    )
    read: Any = held_against(schema, {"drive": {}, **read_toml(path)}, f"{path}: ")
    made = {
        name: _made(value, f"{path}: {name}")
        for name, value in msgspec.structs.asdict(read).items()
    }
    return Simulation(**{**made, **_machine(path, read.machine)})


def _machine(path: Path, entry: str | dict[str, Any]) -> dict[str, Any]:
    """Return the machine, and what else a simulation holds about where it comes from."""
    if isinstance(entry, str):
        return {"machine": machine(entry)}
    named = [key for key in _SOURCES if isinstance(entry.get(key), str)]
    if len(named) != 1:
        raise InputError(
            f"{path}: machine must be a name, or a table with map or result, got {entry!r}."
        )
    (origin,) = named
    where, source = f"{path}: machine", path.parent / str(entry[origin])
    table = _table(_SOURCES[origin], first=origin)
    read = msgspec.structs.asdict(held_against(table, entry, f"{where}."))
    if not source.exists():
        raise InputError(f"{where}.{origin}: {source} is not there; correct the path.")
    arguments = {n: v for n, v in read.items() if n != origin and v is not msgspec.UNSET}
    imported = _SOURCES[origin](source, **arguments)
    return {
        "machine": imported.machine,
        "warnings": imported.findings.warnings,
        "result": source if origin == "result" else None,
    }


def _schema(hint: Any) -> Any:
    """Return the schema of what an argument with a type hint may be in a file."""
    if hint in KINDS:
        tables = tuple(_table(make, kind) for kind, make in KINDS[hint].items())
        return reduce(or_, tables, FINITE) if hint is Speed else reduce(or_, tables)
    if hint is Domain:
        return typing.Literal[tuple(_DOMAINS)] | _table(Domain)
    if isinstance(hint, type) and is_dataclass(hint):
        return _table(hint)
    parts = tuple(_schema(part) for part in typing.get_args(hint))
    if typing.get_origin(hint) is tuple:
        return tuple[parts]  # type: ignore[valid-type]
    if parts:
        return reduce(or_, parts)
    return FINITE if hint is float else hint


def _table(target: Callable[..., Any], kind: str | None = None, first: str | None = None) -> Any:
    """Return the schema of a table whose entries are arguments, ``first`` the name of the first."""
    hints = typing.get_type_hints(target)
    fields: list[Any] = []
    for name, parameter in inspect.signature(target).parameters.items():
        schema = _schema(hints[name])
        if first and not fields:
            fields.append((first, str))
        elif parameter.default is parameter.empty:
            fields.append((name, schema))
        else:
            fields.append((name, schema | msgspec.UnsetType, msgspec.UNSET))
    return msgspec.defstruct(
        target.__name__,
        fields,
        tag=kind,
        tag_field=kind and "kind",
        namespace={"make": staticmethod(target)},
        kw_only=True,
        forbid_unknown_fields=True,
    )


def _made(entry: Any, where: str) -> Any:
    """Return what an entry of a file describes; the refusal of a record names its table."""
    if isinstance(entry, str):
        return _DOMAINS.get(entry)
    if not isinstance(entry, msgspec.Struct):
        return entry
    given = {n: v for n, v in msgspec.structs.asdict(entry).items() if v is not msgspec.UNSET}
    arguments = {name: _made(value, f"{where}.{name}") for name, value in given.items()}
    try:
        return entry.make(**arguments)  # type: ignore[attr-defined]
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
