"""Which columns of a recording are probably the channels of a drive, and in what convention."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from penode.arrays import FloatArray
from penode.data.table import TIME, Table
from penode.data.time_axis import is_uneven
from penode.data.units import UNITS, unit_name
from penode.errors import InputError
from penode.pmsm.machine.standstill import TURN
from penode.pmsm.machine.terms import TEMPERATURE
from penode.pmsm.recording.channel_guess import ChannelGuess
from penode.pmsm.recording.channels import missing_channels, stationary_kinds
from penode.pmsm.recording.drive_mapping import MAPPED, OF_SHAFT, TORQUE
from penode.pmsm.recording.guess_motion import Turning, electrical_turns, motion_of
from penode.pmsm.recording.guess_names import NameHint, read_name, split_unit, time_step_of
from penode.pmsm.recording.guess_scale import with_duty_range, with_fractions
from penode.pmsm.recording.stationary_frame import FORMS, LINK, form_of, phases_of

_SPEED, _ANGLE = "omega_el", "theta_el"
# First letters of what a controller asks for: voltages and duty cycles.
_COMMANDED = "ud"
# Currents in the order in which the file's times are taken from them.
_CURRENTS = ("i_q", "i_a", "i_b", "i_alpha")
# Units of time, and the sampling step up to which a drive's times are taken for it.
_TIME_UNITS = {"s": 5e-3, "ms": 5.0, "us": 5e3, "ns": np.inf}
# Units of an angle, and the range that it then covers at most: it starts again after a turn.
_ANGLE_UNITS = {"turn": 1.0005, "rad": 2.001 * np.pi, "deg": 360.5}


@dataclass(frozen=True)
class StudyGuess:
    """What a recording probably holds.

    Attributes
    ----------
    channels : mapping of str to ChannelGuess
        Key of `MAPPED` -> guess.
    missing : tuple of str
        Channels that are needed and missing.
    unused : tuple of str
        Columns that belong to no channel.
    pole_pairs : int or None
        None where the recording does not show it.
    resample : bool
        The channels have different sampling times.
    bases : tuple of str
        Entries that are needed for what is recorded per unit.
    numbers : mapping of str to float
        Channels that are a number, SI, as no column holds them.
    counter : str
        Column that counts samples where none holds the time; empty for none.
    uneven : bool
        The times jitter or repeat.
    time_step : (str, float) or None
        Number of the file that is the time from one sample to the next, and the s it stands for,
        where no column holds the time.
    heat : mapping of str to str
        Unit by column of the temperatures that belong to no channel.
    """

    channels: Mapping[str, ChannelGuess]
    missing: tuple[str, ...]
    unused: tuple[str, ...]
    pole_pairs: int | None
    resample: bool
    bases: tuple[str, ...] = ()
    numbers: Mapping[str, float] = field(default_factory=dict)
    counter: str = ""
    uneven: bool = False
    time_step: tuple[str, float] | None = None
    heat: Mapping[str, str] = field(default_factory=dict)

    @property
    def lacks_pole_pairs(self) -> bool:
        """Whether a channel belongs to the shaft and the pole pairs are not known."""
        return self.pole_pairs is None and any(g.mechanical for g in self.channels.values())


def guess_study(table: Table) -> StudyGuess:
    """Guess the channels of a drive among the columns of a file.

    Parameters
    ----------
    table : Table
        Columns of the file.

    Returns
    -------
    StudyGuess
        Every part of it is a guess; reasons say from what.
    """
    picks = _with_clock(table, _one_frame(_picks(table)))
    if TIME in picks:  # a torque is an output of operating points, which have none
        picks.pop(TORQUE, None)
    channels = {name: _from_name(table, name, pick) for name, pick in picks.items()}
    if TIME in channels:
        channels[TIME] = _in_likely_time_unit(table, channels[TIME])
    channels |= {n: with_duty_range(table, g) for n, g in channels.items() if n[:5] == "duty_"}
    if not _link_fits(table, channels):
        channels.pop(LINK)
    pole_pairs = _decide_motion(table, picks, channels)
    channels, bases = with_fractions(table, channels)
    used = {guess.column for guess in channels.values()} | set(table.clocks.values())
    measured = [guess.column for name, guess in channels.items() if name != TIME]
    clocks = {table.clocks.get(column) for column in measured}
    unused = tuple(column for column in table.columns if column not in used)
    step = None if TIME in channels else time_step_of(table.numbers)
    needed = (*([] if step else [TIME]), *missing_channels(channels))
    return StudyGuess(
        {name: channels[name] for name in MAPPED if name in channels},
        tuple(name for name in needed if name not in channels),
        unused,
        pole_pairs,
        len(clocks) > 1 and len({_times_key(table, clock) for clock in clocks}) > 1,
        bases,
        counter=next((name for name in unused if _counts(table.columns[name])), ""),
        uneven=TIME in channels and is_uneven(table.columns[channels[TIME].column]),
        time_step=step,
        heat={column: unit for column in unused if (unit := _unit_of_heat(table, column))},
    )


def _unit_of_heat(table: Table, column: str) -> str:
    """Return the unit of a column that holds a temperature, empty of another."""
    unit = unit_name(table.units.get(column, "")) or split_unit(column)[1]
    return unit if unit and UNITS[unit].si == MAPPED[TEMPERATURE.name] else ""


def at_standstill(guess: StudyGuess, table: Table, file: str) -> StudyGuess:
    """Return a guess of a recording whose rotor stood still: its speed is 0, or a column that is.

    Raises
    ------
    InputError
        If a column of the file is a speed that turns by more than a radian.
    """
    if _SPEED not in guess.channels:
        missing = tuple(name for name in guess.missing if name != _SPEED)
        return replace(guess, missing=missing, numbers={**guess.numbers, _SPEED: 0.0})
    speed = guess.channels[_SPEED]
    values = UNITS[speed.unit].to_si(table.columns[speed.column])
    times = _times(table, speed.column, guess.channels)
    if len(times) == len(values) and abs(float(np.trapezoid(values, times))) > TURN:
        raise InputError(
            f"{file}: the rotor must stand still for --standstill, and column {speed.column} is a "
            f"speed from {values.min():.4g} to {values.max():.4g} rad/s; leave the option out."
        )
    return guess


def _counts(values: FloatArray) -> bool:
    """Return whether a column rises by one from row to row."""
    return len(values) > 2 and bool((np.diff(values) == 1.0).all())


def _times_key(table: Table, clock: str | None) -> bytes:
    return b"" if clock is None else table.columns[clock].tobytes()


# --- by name ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Pick:
    """A column for a channel, what its name says, and the columns that it was preferred to."""

    column: str
    hint: NameHint
    others: tuple[str, ...] = ()


def _picks(table: Table) -> dict[str, _Pick]:
    """Return the column whose name suits each channel best."""
    by_channel: dict[str, list[_Pick]] = {}
    for column in table.columns:
        hint = read_name(column)
        if hint is not None and _may_be(table, column, hint):
            by_channel.setdefault(hint.channel, []).append(_Pick(column, hint))
    picks = {}
    for channel, candidates in by_channel.items():
        best, *rest = sorted(candidates, key=_unlikeliness)
        picks[channel] = replace(best, others=tuple(pick.column for pick in rest))
    return picks


def _may_be(table: Table, column: str, hint: NameHint) -> bool:
    """Return whether unit and kind of a column let it be the channel of its name."""
    given = unit_name(table.units.get(column, ""))
    if given is not None and UNITS[given].si not in (MAPPED[hint.channel], "1"):
        return False
    return hint.channel[0] in _COMMANDED or not hint.asked_for


def _unlikeliness(pick: _Pick) -> tuple[bool, bool]:
    """Order candidates: our own name first; a voltage asked for before one measured."""
    commanded = pick.hint.channel[0] in _COMMANDED and pick.hint.channel != LINK
    return pick.column != pick.hint.channel, commanded and not pick.hint.asked_for


def _one_frame(picks: dict[str, _Pick]) -> dict[str, _Pick]:
    """Leave one form of the voltages, and one of the currents."""
    kept = {name for kind in FORMS for name in form_of(kind, picks)}
    others = {name for forms in FORMS.values() for form in forms for name in form} - kept - {LINK}
    return {name: pick for name, pick in picks.items() if name not in others}


def _link_fits(table: Table, channels: Mapping[str, ChannelGuess]) -> bool:
    """Return whether a link beside voltages that need none is above all of them, or is not there.

    A column that was never connected, or holds something else, would be taken for the limit.
    """
    if LINK not in channels or any(name.startswith("duty_") for name in channels):
        return True

    def of(name: str) -> FloatArray:
        guess = channels[name]
        return UNITS[guess.unit].to_si(table.columns[guess.column])

    link, voltages = of(LINK), [of(n) for n in channels if n[:2] == "u_" and n != LINK]
    highest = max((np.abs(one).max(initial=0.0) for one in voltages), default=0.0)
    return not len(link) or bool(np.median(link) > highest)


def _with_clock(table: Table, picks: dict[str, _Pick]) -> dict[str, _Pick]:
    """Take the times that the file ties to a current, if it does."""
    current = next((picks[name] for name in _CURRENTS if name in picks), None)
    clock = None if current is None else table.clocks.get(current.column)
    if clock is None:
        return picks
    return {**picks, TIME: _Pick(clock, NameHint(TIME, "", "", False))}


def _from_name(table: Table, name: str, pick: _Pick) -> ChannelGuess:
    """Return the guess that names and units of the file alone allow."""
    called = "the column has the name of the channel" if pick.column == name else "by its name"
    if pick.others:
        called += f", before {', '.join(pick.others)}"
    given = table.units.get(pick.column, "")
    unit, why = MAPPED[name], f"{MAPPED[name]}, as no unit is given"
    if unit_name(given) is not None and unit_name(given) != "1":
        unit, why = str(unit_name(given)), f"the file gives {given}"
    elif pick.hint.unit and UNITS[pick.hint.unit].si == unit:
        unit, why = pick.hint.unit, f"{pick.hint.unit} stands in the name"
    elif given:
        why = f"{unit}, as the file gives {given!r}, which is no unit known here"
    elif name == TIME or (name in OF_SHAFT and pick.column != name):
        why = ""  # the numbers may show it
    return ChannelGuess(pick.column, unit, (called, why) if why else (called,))


# --- by magnitude -------------------------------------------------------------------------------


def _in_likely_time_unit(table: Table, guess: ChannelGuess) -> ChannelGuess:
    if len(guess.reasons) > 1:
        return guess
    times = table.columns[guess.column]
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    unit = next((unit for unit, largest in _TIME_UNITS.items() if step <= largest), "s")
    return replace(guess, unit=unit, reasons=(guess.reasons[0], f"{unit}, as a step is {step:.4g}"))


def _decide_motion(
    table: Table, picks: Mapping[str, _Pick], channels: dict[str, ChannelGuess]
) -> int | None:
    """Decide units, sides and signs of speed and angle in the channels; return the pole pairs."""
    turning = {n: _turning(table, picks[n], channels, n) for n in OF_SHAFT if n in channels}
    speed, angle = turning.get(_SPEED), turning.get(_ANGLE)
    turns = None if angle is None else _turns(table, angle, channels)
    motion = motion_of(speed, angle, turns)
    usual = "as is usual for such a name"
    if speed is not None:
        why = "so that it is the slope of the angle" if motion.agrees else usual
        decided = (motion.speed_unit, motion.speed_side, motion.speed_sign)
        channels[_SPEED] = _decided(channels[_SPEED], *decided, why)
    if angle is not None:
        why = "so that its slope is the speed" if motion.agrees else usual
        if turns is not None:
            why += " and the dq quantities have a mean"
        if stationary_kinds(channels):
            why += "; zero where the d axis is that of phase a, as no file shows it"
        decided = (motion.angle_unit, motion.angle_side, motion.angle_sign)
        channels[_ANGLE] = _decided(channels[_ANGLE], *decided, why)
    return motion.pole_pairs


def _decided(guess: ChannelGuess, unit: str, side: str, sign: int, why: str) -> ChannelGuess:
    backwards = ", counted backwards" if sign < 0 else ""
    summary = f"{unit}, {side}" if len(guess.reasons) == 1 else side
    reasons = (*guess.reasons, f"{summary}{backwards}, {why}")
    return replace(guess, unit=unit, sign=sign, mechanical=side == "mechanical", reasons=reasons)


def _turning(table: Table, pick: _Pick, channels: Mapping[str, ChannelGuess], name: str) -> Turning:
    """Return a speed or angle with the units that it may have; empty where it cannot be judged."""
    values, times = table.columns[pick.column], _times(table, pick.column, channels)
    usable = len(times) == len(values) > 1 and bool(np.isfinite([values, times]).all())
    if not usable:
        values = times = np.zeros(0)
    units: tuple[str, ...] = (channels[name].unit,)
    if len(channels[name].reasons) == 1:
        units = _speed_units(pick.column) if name == _SPEED else _angle_units(values)
    return Turning(values, times, units, pick.hint.side)


def _times(table: Table, column: str, channels: Mapping[str, ChannelGuess]) -> FloatArray:
    """Return the sampling times of a column in s, none without a time column."""
    clock = table.clocks.get(column)
    if TIME not in channels:
        return np.zeros(0)
    if clock is None or clock == table.clocks.get(channels[TIME].column):
        return UNITS[channels[TIME].unit].to_si(table.columns[channels[TIME].column])
    return table.columns[clock]


def _speed_units(column: str) -> tuple[str, ...]:
    last = re.split(r"[./\\]", column.lower())[-1]
    is_omega = "omega" in last or last.startswith("w")
    return ("rad/s", "rpm", "Hz") if is_omega else ("rpm", "rad/s", "Hz")


def _angle_units(values: FloatArray) -> tuple[str, ...]:
    """Return what an angle of this range may be in; one beyond a turn was counted on."""
    span = float(np.ptp(values)) if len(values) else 0.0
    starts_again = bool((np.abs(np.diff(values)) > 0.5 * span).any())
    fitting = [unit for unit, most in _ANGLE_UNITS.items() if span <= most]
    return (fitting[0],) if starts_again and fitting else ("rad", "deg", "turn")


def _turns(table: Table, angle: Turning, channels: Mapping[str, ChannelGuess]) -> int | None:
    """Return the electrical turns in one of the angle, where phase currents show it."""
    columns = {
        name: guess.sign * table.columns[guess.column]
        for name, guess in channels.items()
        if len(table.columns[guess.column]) == len(angle.values) > 0
    }
    found = (phases_of(kind, columns) for kind in "ui")
    kinds = [phases for phases in found if phases is not None]
    theta = UNITS[angle.units[0]].to_si(angle.values)
    return electrical_turns(kinds, theta) if kinds else None
