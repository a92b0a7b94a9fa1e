"""From the columns of a file to channels: names, units, scales, signs, delays, one clock.

In this order: a column becomes SI values at its own sampling times, channels of several rates are
put onto one clock if that is asked for, and delays shift whole rows. Rows at the ends that a
channel does not reach are cut off; nothing is filled in or repeated.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.data.gathered import in_pieces, pieces
from penode.data.stretches import SHORTEST
from penode.data.table import TIME, Table, cell_error, list_names
from penode.data.time_axis import Sampled, on_one_clock, steady_times, uniform_stretches
from penode.data.units import UNITS, Unit, find_unit, unit_name
from penode.errors import InputError, did_you_mean


@dataclass(frozen=True)
class Origin:
    """Where a channel comes from."""

    # Of the file.
    column: str
    # SI unit of the channel, such as "A"; empty where any unit will do.
    si: str = ""
    # Of the column; empty for the one that the file gives, and SI where it gives none.
    unit: str = ""
    # What one count of the column is in that unit, and 1 or -1.
    scale: float = 1.0
    sign: int = 1
    # Samples by which the column lags behind the channel: row k of the channel is row k + delay of
    # the column, on the common clock. Negative where the column leads.
    delay: int = 0
    # Another column that the column is a share of, such as the DC-link voltage of a duty; it then
    # is the one that has the unit. Empty for none.
    times: str = ""


def own_names(table: Table) -> dict[str, Origin]:
    """Return the mapping that takes every column but clocks under its own name, `TIME` in s."""
    clocks = set(table.clocks.values()) | {TIME}
    return {name: Origin(name) for name in table.columns if name not in clocks}


@dataclass(frozen=True, eq=False)
class Mapped:
    """Channels of a file on one clock, (time,) each, SI, in the order of origins; it may have gaps.

    Step and times in s; ``spans`` are the first sample of each stretch without a gap, and last plus
    one.
    """

    time_step: float
    times: FloatArray
    channels: Mapping[str, FloatArray]
    spans: tuple[tuple[int, int], ...]


def map_channels(
    file: str,
    table: Table,
    origins: Mapping[str, Origin],
    resample: bool = False,
    time_step: float | None = None,
) -> Mapped:
    """Make channels of one uniform clock from the columns of a file; origin ``t`` is the time in s.

    ``resample`` puts channels of different clocks onto the fastest, and those whose times jitter
    onto uniform ones between the gaps, by linear interpolation, angles without their jumps, over
    the time that all channels cover. ``time_step`` in s is that of a steady clock whose stamps
    jitter; see `steady_times`. Refused are clocks that differ without it, values that are not
    finite or do not match their times, units of another quantity, and times as `uniform_stretches`
    says.
    """
    time = origins.get(TIME, Origin(TIME, "s"))
    read: dict[Origin, FloatArray] = {}
    sampled = {}
    for name, origin in origins.items():
        if name == TIME:
            continue
        values, si = si_values(file, table, name, origin)
        own = table.clocks.get(origin.column)
        clock = time if own in (None, table.clocks.get(time.column)) else Origin(own, "s")
        if clock not in read:
            stamps = si_values(file, table, TIME, clock)[0]
            read[clock] = stamps if time_step is None else steady_times(file, stamps, time_step)
        if len(values) != len(read[clock]):
            raise InputError(
                f"{file}: channel {name}: column {origin.column} has {len(values)} values where "
                f"its times in column {clock.column} are {len(read[clock])}; name the time column "
                "that belongs to it, or export them together."
            )
        sampled[name] = Sampled(read[clock], values, si == "rad")
    times, channels = on_one_clock(file, sampled, resample)
    return _without_delays(file, times, channels, origins)


def si_values(file: str, table: Table, name: str, origin: Origin) -> tuple[FloatArray, str]:
    """Return the values of a channel in SI units, finite, and the unit."""
    factor = origin.scale * origin.sign
    if not origin.times:
        unit = _unit(file, table, name, origin)
        column = _column(file, table, name, origin.column)
        return in_pieces(lambda piece: unit.to_si(piece, factor), column), unit.si
    share = Origin(origin.column, "1", scale=factor)
    whole = Origin(origin.times, origin.si, origin.unit)
    shares, _ = si_values(file, table, name, share)
    wholes, si = si_values(file, table, name, whole)
    together = table.clocks.get(origin.column) == table.clocks.get(origin.times)
    if not together or len(shares) != len(wholes):
        raise InputError(
            f"{file}: channel {name}: column {origin.column} has {len(shares)} values and column "
            f"{origin.times} {len(wholes)} of its own times; multiply columns that were sampled "
            "together."
        )
    return in_pieces(np.multiply, shares, wholes), si


def _column(file: str, table: Table, name: str, column: str) -> FloatArray:
    """Return a column that is there and finite."""
    table.require_numbers(file, column)
    values = table.columns.get(column)
    if values is None:
        raise InputError(
            f"{file}: no column {column} for channel {name}{did_you_mean(column, table.columns)}; "
            f"the columns are {list_names(table.columns)}."
        )
    row = 0
    for piece in pieces(values):
        bad = np.flatnonzero(~np.isfinite(piece))
        if bad.size:
            raise cell_error(file, f"data row {row + bad[0] + 1}", column, str(piece[bad[0]]))
        row += len(piece)
    return values


def _unit(file: str, table: Table, name: str, origin: Origin) -> Unit:
    """Return the unit of a column as it was given, else as the file gives it, else SI."""
    column_unit = table.units.get(origin.column, "")
    text = origin.unit or column_unit or origin.si
    if not origin.si and unit_name(text) is None:
        return Unit("")
    where = f"{file}: channel {name}"
    unit = find_unit(where, text)
    if origin.si not in ("", unit.si):
        fitting = [candidate for candidate, other in UNITS.items() if other.si == origin.si]
        raise InputError(
            f"{where}: the unit of column {origin.column} must be one of {', '.join(fitting)}, "
            f"got {text!r}."
        )
    return unit


def _without_delays(
    file: str,
    times: FloatArray,
    channels: Mapping[str, FloatArray],
    origins: Mapping[str, Origin],
) -> Mapped:
    """Shift rows so that each channel stands at the time it belongs to; cut what is not whole."""
    delays = {name: origins[name].delay for name in channels}
    longest = max(delays, key=lambda name: abs(delays[name]))
    if delays[longest] and abs(delays[longest]) >= len(times):
        raise InputError(
            f"{file}: channel {longest}: delay must be a few samples at most, got "
            f"{delays[longest]} in a recording of {len(times)} samples."
        )
    begin, lost = max(0, -min(delays.values())), max(0, *delays.values())
    end = max(begin, len(times) - lost)
    moved = {name: v[begin + delays[name] : end + delays[name]] for name, v in channels.items()}
    times = times[begin:end]
    step, spans = uniform_stretches(file, times, SHORTEST + begin + lost)
    # At a gap a stretch loses the rows of which a channel came from beyond it.
    inner = ((a + begin * (a > 0), b - lost * (b < len(times))) for a, b in spans)
    return Mapped(step, times, moved, tuple(inner))
