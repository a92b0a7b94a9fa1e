"""Table: the named numeric columns of one file, and the refusals every reader shares."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import TypeAlias

from penode.arrays import FloatArray
from penode.errors import InputError

#: Columns by name, all float64, finite and of one length: what a reader returns.
Table: TypeAlias = dict[str, FloatArray]

_NAMES_SHOWN = 20
_TEXT_SHOWN = 40


def clean_names(file: str, names: Sequence[str]) -> list[str]:
    """Strip the spaces around column names and refuse unusable ones.

    Parameters
    ----------
    file : str
        File, for the message.
    names : sequence of str
        Column names as they stand in the file.

    Returns
    -------
    list of str
        The stripped names, in the same order.

    Raises
    ------
    InputError
        If a name is empty or appears twice.
    """
    stripped = [name.strip() for name in names]
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
    """Join names for a message, cut after the first twenty.

    Parameters
    ----------
    names : iterable of str
        Column or channel names.

    Returns
    -------
    str
        The names separated by commas, or ``"none"``.
    """
    names = list(names)
    more = len(names) - _NAMES_SHOWN
    return ", ".join(names[:_NAMES_SHOWN]) + (f" and {more} more" if more > 0 else "") or "none"


def cell_error(file: str, row: str, channel: str, text: str | None) -> InputError:
    """Make the refusal of one cell that is not a finite number.

    Parameters
    ----------
    file : str
        File, for the message.
    row : str
        Where the cell is, for example ``"data row 3 (line 4)"``.
    channel : str
        Column of the cell.
    text : str or None
        What the cell holds; None or blank where the cell is missing.

    Returns
    -------
    InputError
        To be raised by the caller.
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
