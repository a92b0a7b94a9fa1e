"""Table: the named numeric columns of one file, and what every reader shares."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from penode.errors import InputError, printable

#: Values of one column; not that of `penode.arrays`, as readers start without JAX.
Column: TypeAlias = NDArray[np.float64]

#: Column that holds the time in s.
TIME = "t"
# What a column of times is called in a group of columns that it belongs to.
_CLOCK_NAMES = ("t", "time", "zeit")

_NAMES_SHOWN = 20
_TEXT_SHOWN = 40


@dataclass(frozen=True, eq=False)
class Table:
    """What a reader returns: columns (time,), float64, in the order and the units of the file.

    ``units`` has those columns for which the file gives one, ``clocks`` those that the file ties to
    a column of sampling times. ``text`` has columns without a number in any row, by place and
    content of the first cell, and ``left_out`` further columns that ``columns`` lacks, and why.
    ``numbers`` has what is a single number in the file.
    """

    columns: Mapping[str, Column]
    units: dict[str, str] = field(default_factory=dict)
    clocks: dict[str, str] = field(default_factory=dict)
    text: dict[str, tuple[str, str]] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)

    def require_numbers(self, file: str, column: str) -> None:
        """Refuse a column that is left out, as text whose first cell is named, or otherwise."""
        if column in self.text:
            place, cell = self.text[column]
            raise cell_error(file, place, column, cell)
        if column in self.left_out:
            raise InputError(
                f"{file}: {column} cannot be used as a column, as it is {self.left_out[column]}; "
                "save it as a vector of numbers."
            )


class Decoded(Mapping[str, Column]):
    """Columns of a file that are decoded one by one, each by its function when it is asked for."""

    def __init__(self, decoders: Mapping[str, Callable[[], Column]]) -> None:
        self._decoders = decoders

    def __getitem__(self, name: str) -> Column:
        return self._decoders[name]()

    def __iter__(self) -> Iterator[str]:
        return iter(self._decoders)

    def __len__(self) -> int:
        return len(self._decoders)


@dataclass(frozen=True, eq=False)
class Signal:
    """One channel of a group, decoded when asked for; its unit is empty where the file gives none.

    ``times`` (time,) are in s, None where the file knows none but those in a column.
    """

    group: str
    name: str
    unit: str
    decode: Callable[[], Column]
    times: Column | None


def table_of(file: str, signals: Sequence[Signal]) -> Table:
    """Put the channels of all groups into one table, ``group/name`` where a name comes twice.

    Columns are decoded when asked for. Times in s become columns, shared by the channels that were
    sampled together: ``t``, then ``t_2``. Channels without times have the column of their group
    that is called t, time or Zeit for a clock. Refuses a group with two channels of one name.
    """
    times: dict[str, Column] = {}
    own = [None if signal.times is None else _clock(times, signal.times) for signal in signals]
    often = Counter([*times, *(signal.name for signal in signals)])
    names = [f"{s.group}/{s.name}" if often[s.name] > 1 else s.name for s in signals]
    names = clean_names(file, [*times, *names])[len(times) :]
    decoders: dict[str, Callable[[], Column]] = {}
    decoders |= {name: partial(np.asarray, values) for name, values in times.items()}
    decoders |= dict(zip(names, (signal.decode for signal in signals), strict=True))
    units = dict.fromkeys(times, "s")
    units |= {name: s.unit for name, s in zip(names, signals, strict=True) if s.unit}
    clocks = {name: name for name in times}
    groups: dict[str, dict[str, str]] = {}
    for name, signal, clock in zip(names, signals, own, strict=True):
        if clock is None:
            groups.setdefault(signal.group, {})[signal.name] = name
        else:
            clocks[name] = clock
    for members in groups.values():
        clocks |= clocks_within(members)
    return Table(Decoded(decoders), units, clocks)


def _clock(known: dict[str, Column], times: Column) -> str:
    """Return the name of these times, which are added where they are new."""
    for name, clock in known.items():
        if times is clock or np.array_equal(times, clock):
            return name
    name = f"{TIME}_{len(known) + 1}" if known else TIME
    known[name] = times
    return name


def clocks_within(members: Mapping[str, str]) -> dict[str, str]:
    """Tie the columns of a group to its column of times, which is called t, time or Zeit.

    ``members`` is name within the group to name of the column; empty where there is no such column.
    """
    called = {name.lower(): column for name, column in members.items()}
    clock = next((called[name] for name in _CLOCK_NAMES if name in called), None)
    return {} if clock is None else dict.fromkeys(members.values(), clock)


def clean_names(file: str, names: Sequence[str]) -> list[str]:
    """Strip and escape column names; refuse one that is empty or comes twice."""
    stripped = [printable(name.strip()) for name in names]
    if "" in stripped:
        raise InputError(
            f"{file}: column {stripped.index('') + 1} of {len(stripped)} has no name; "
            "name it in the header or remove it."
        )
    twice = [name for name, count in Counter(stripped).items() if count > 1]
    if twice:
        raise InputError(
            f"{file}: duplicate column name {list_names(twice)}; "
            "every channel needs a name of its own, so rename or remove one."
        )
    return stripped


def list_names(names: Iterable[str]) -> str:
    """Join names with commas for a message, cut after the first twenty; ``"none"`` for none."""
    names = list(names)
    more = len(names) - _NAMES_SHOWN
    return ", ".join(names[:_NAMES_SHOWN]) + (f" and {more} more" if more > 0 else "") or "none"


def cell_error(file: str, row: str, channel: str, text: str | None) -> InputError:
    """Make the refusal of a cell, at ``"data row 3 (line 4)"``, that is not a finite number.

    ``text`` is what it holds, None or blank where it is missing.
    """
    if text is None or not text.strip():
        return InputError(
            f"{file}: {row}, channel {channel}: the cell is missing where a number was wanted; "
            "fill it from the source or cut the recording before it."
        )
    shown = text if len(text) <= _TEXT_SHOWN else text[:_TEXT_SHOWN] + "..."
    return InputError(
        f"{file}: {row}, channel {channel}: found {shown!r} where a finite number was wanted; "
        "correct it, cut the recording before it, or remove the column if it is no measurement."
    )
