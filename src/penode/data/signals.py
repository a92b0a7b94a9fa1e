"""Signals: channels as file formats with groups and several sampling rates hold them."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from penode.data.table import TIME, Column, Decoded, Table, clean_names, clocks_within


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
    clocks: dict[str, Column] = {}
    ticks = [None if signal.times is None else _clock(clocks, signal.times) for signal in signals]
    often = Counter([*clocks, *(signal.name for signal in signals)])
    names = [f"{s.group}/{s.name}" if often[s.name] > 1 else s.name for s in signals]
    names = clean_names(file, [*clocks, *names])[len(clocks) :]
    columns: dict[str, Callable[[], Column]] = {}
    columns |= {name: partial(np.asarray, times) for name, times in clocks.items()}
    table = Table(Decoded(columns), dict.fromkeys(clocks, "s"), {name: name for name in clocks})
    groups: dict[str, dict[str, str]] = {}
    for name, signal, tick in zip(names, signals, ticks, strict=True):
        columns[name] = signal.decode
        if signal.unit:
            table.units[name] = signal.unit
        if tick is not None:
            table.clocks[name] = tick
        else:
            groups.setdefault(signal.group, {})[signal.name] = name
    for members in groups.values():
        table.clocks.update(clocks_within(members))
    return table


def _clock(clocks: dict[str, Column], times: Column) -> str:
    """Return the name of these times, which are added where they are new."""
    for name, clock in clocks.items():
        if times is clock or np.array_equal(times, clock):
            return name
    name = f"{TIME}_{len(clocks) + 1}" if clocks else TIME
    clocks[name] = times
    return name
