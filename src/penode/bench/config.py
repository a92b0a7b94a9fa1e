"""A simulation as a TOML file: machine, reference, speed and every imperfection, by name."""

import inspect
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

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
from penode.data.toml_file import FINITE, FLAG, NATURAL, WHOLE, read_toml, require, require_known
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
_PLAIN = {bool: FLAG, int: WHOLE}
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
    table = {"drive": {}, "seed": 0, **read_toml(path)}
    require(f"{path}: seed", table["seed"], NATURAL)
    origin = _read_machine(path, table.pop("machine", None))
    return Simulation(**origin, **_arguments(_Rest, table, f"{path}:"))


class _Rest:
    """Entries at the top of the file that need no special reading."""

    def __init__(
        self, reference: Reference, speed_rpm: Speed, duration: float, drive: Drive, seed: int
    ) -> None: ...


def _read_machine(path: Path, entry: Any) -> dict[str, Any]:
    """Return the machine, and what else a simulation holds about where it comes from."""
    if isinstance(entry, str):
        return {"machine": machine(entry)}
    named = [key for key in _SOURCES if isinstance(entry, dict) and key in entry]
    if len(named) != 1 or not isinstance(entry[named[0]], str):
        raise InputError(
            f"{path}: machine = {entry!r} came; give a name, or a table with map or result."
        )
    make, source = _SOURCES[named[0]], path.parent / entry[named[0]]
    rest = {key: value for key, value in entry.items() if key != named[0]}
    arguments = _arguments(make, rest, f"{path}: machine", supplied=1)
    if not source.exists():
        raise InputError(f"{path}: machine.{named[0]}: {source} is not there; mend the path.")
    imported = make(source, **arguments)
    return {
        "machine": imported.machine,
        "warnings": imported.findings.warnings,
        "result": source if named[0] == "result" else None,
    }


def _read(kind: Any, entry: Any, where: str) -> Any:
    """Return an entry as the kind it is to be: a type, a record, or one of several records."""
    if entry == {} and kind in KINDS:
        raise InputError(f"{where}: empty; name a kind: {', '.join(KINDS[kind])}.")
    if kind is Domain and isinstance(entry, str) and entry in _DOMAINS:
        return _DOMAINS[entry]
    if isinstance(entry, dict) and _is_record(kind):
        return _read_record(kind, entry, where)
    if _is_record(kind) and kind is not Speed:
        names = f", or one of {', '.join(_DOMAINS)}" if kind is Domain else ""
        wanted = "a table with a kind" if kind in KINDS else f"a table{names}"
        raise InputError(f"{where} = {entry!r} came; give {wanted}.")
    return _plain(kind, entry, where)


def _is_record(kind: Any) -> bool:
    return kind in KINDS or hasattr(kind, "__dataclass_fields__")


def _read_record(kind: Any, entry: dict[str, Any], where: str) -> Any:
    choices = KINDS.get(kind)
    if choices is None:
        return _make(kind, entry, where)
    name = entry.get("kind")
    if not isinstance(name, str) or name not in choices:
        raise InputError(f"{where}: kind = {name!r} came; choose one of {', '.join(choices)}.")
    rest = {key: value for key, value in entry.items() if key != "kind"}
    return _make(choices[name], rest, where)


def _make(target: Callable[..., Any], entry: Mapping[str, Any], where: str) -> Any:
    """Return the record that a table describes; its refusals name the table."""
    arguments = _arguments(target, entry, where)
    try:
        return target(**arguments)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _arguments(
    target: Callable[..., Any], entry: Mapping[str, Any], where: str, supplied: int = 0
) -> dict[str, Any]:
    """Return a table's entries as arguments, each read as the kind that the target wants."""
    wanted = dict(list(inspect.signature(target).parameters.items())[supplied:])
    hints = typing.get_type_hints(target.__init__ if inspect.isclass(target) else target)
    if hasattr(target, "__dataclass_fields__"):
        hints = typing.get_type_hints(target)
    require_known(f"{where} entry", entry, wanted)
    missing = [n for n, p in wanted.items() if p.default is p.empty and n not in entry]
    if missing:
        raise InputError(f"{where} {', '.join(missing)} is missing; add it.")
    inside = f"{where} " if where.endswith(":") else f"{where}."
    return {n: _read(_sole(hints.get(n)), v, inside + n) for n, v in entry.items()}


def _sole(hint: Any) -> Any:
    """Return X for X | None, and any other hint as it is."""
    if hint in KINDS:
        return hint
    if isinstance(hint, types.UnionType) or typing.get_origin(hint) is typing.Union:
        kinds = [part for part in typing.get_args(hint) if part is not type(None)]
        return kinds[0] if len(kinds) == 1 else hint
    return hint


def _plain(kind: Any, entry: Any, where: str) -> Any:
    """Return numbers, truth values and nested lists of numbers as they are wanted."""
    if typing.get_origin(kind) is tuple:
        return _listed(typing.get_args(kind), entry, where)
    require(where, entry, _PLAIN.get(kind, FINITE))
    return entry if kind in _PLAIN else float(entry)


def _listed(kinds: tuple[Any, ...], entry: Any, where: str) -> tuple[Any, ...]:
    """Return a list as a tuple of so many kinds, or of any number of one kind."""
    count = len(entry) if isinstance(entry, list) else -1
    if kinds[-1] is Ellipsis:
        kinds = kinds[:1] * max(count, 0)
    if count != len(kinds):
        wanted = f"a list of {len(kinds)}" if kinds else "a list"
        raise InputError(f"{where} = {entry!r} came; give {wanted}.")
    return tuple(
        _plain(kind, item, f"{where}[{k}]")
        for k, (kind, item) in enumerate(zip(kinds, entry, strict=True))
    )
