"""Scales of guessed channels: duty cycles from 0 to 1 or -1 to 1, and quantities per unit."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from penode.data.table import Table
from penode.data.units import UNITS, unit_name
from penode.pmsm.recording.channel_guess import ChannelGuess
from penode.pmsm.recording.drive_mapping import BASES, FRACTIONS, MAPPED
from penode.pmsm.recording.guess_names import read_name

# Duty cycles beyond this are in %.
_LARGEST_SHARE = 1.5
# A duty cycle below zero by this much of its largest value runs from -1 to 1.
_NEGATIVE = 0.02
# A and V up to which currents and voltages without a unit look like fractions of a base.
_PER_UNIT = 2.5


def with_duty_range(table: Table, guess: ChannelGuess) -> ChannelGuess:
    """Return the guess of a duty cycle with the unit and the scale that its range shows."""
    values = table.columns[guess.column]
    largest = _largest(table, guess)
    if not largest:
        return guess
    if guess.unit == "1" and largest > _LARGEST_SHARE:
        guess = replace(
            guess, unit="%", reasons=(guess.reasons[0], f"%, as it reaches {largest:.3g}")
        )
    if values.min() < -_NEGATIVE * largest:
        why = f"half of the DC link is 1, as it reaches {values.min():.3g}"
        guess = replace(guess, scale=0.5, reasons=(*guess.reasons, why))
    return guess


def with_fractions(
    table: Table, channels: Mapping[str, ChannelGuess]
) -> tuple[dict[str, ChannelGuess], tuple[str, ...]]:
    """Return the guesses with those per unit marked, and the bases (of `BASES`) that are needed.

    The unit becomes ``"1"`` or ``"%"`` where unit or name say so, or where no voltage and no
    current of a file without units is above 2.5.
    """
    small = _looks_per_unit(table, channels)
    found = {name: _fraction(table, name, guess, small) for name, guess in channels.items()}
    units = {MAPPED[name] for name, guess in found.items() if guess.unit in FRACTIONS}
    return found, tuple(base for unit, base in BASES.items() if unit in units)


def _fraction(table: Table, name: str, guess: ChannelGuess, small: bool) -> ChannelGuess:
    if MAPPED[name] not in BASES or guess.unit in FRACTIONS:
        return guess
    given = _given(table, guess)
    if given in FRACTIONS:
        why = f"per unit, as {'the file' if guess.column in table.units else 'the name'} says"
    elif small and _largest(table, guess) <= _PER_UNIT:
        why = f"per unit, as no voltage and no current is above {_PER_UNIT}"
    else:
        return guess
    return replace(guess, unit=given or "1", reasons=(guess.reasons[0], why))


def _looks_per_unit(table: Table, channels: Mapping[str, ChannelGuess]) -> bool:
    """Return whether all voltages and currents lack a unit and are as small as fractions."""
    electrical = [guess for name, guess in channels.items() if MAPPED[name] in ("V", "A")]
    kinds = {UNITS[guess.unit].si for guess in electrical}
    known = any(guess.column in table.units or _given(table, guess) for guess in electrical)
    largest = [_largest(table, guess) for guess in electrical]
    return kinds == {"V", "A"} and not known and 0.0 < max(largest) <= _PER_UNIT


def _given(table: Table, guess: ChannelGuess) -> str:
    """Return the unit that the file or the name of the column gives, if it is known here."""
    hint = read_name(guess.column)
    return unit_name(table.units.get(guess.column, "")) or (hint.unit if hint else "")


def _largest(table: Table, guess: ChannelGuess) -> float:
    """Return the largest absolute value of a column, 0 without one that is finite."""
    values = np.abs(table.columns[guess.column])
    return float(values.max()) if len(values) and np.isfinite(values).all() else 0.0
