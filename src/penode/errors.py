"""The two ways penode refuses: the input is unusable, or the data cannot answer."""

import difflib
import unicodedata
from collections.abc import Iterable

# Control characters and those that change how the text around them is shown.
_HIDDEN = frozenset(("Cc", "Cf", "Cs", "Zl", "Zp"))


def printable(text: str) -> str:
    r"""Return a text with its control and formatting characters escaped.

    Parameters
    ----------
    text : str
        Such as a column's name from a file, which could move the cursor of a terminal.

    Returns
    -------
    str
        The same text where there are none, else with ``\x1b`` and the like in their place.
    """
    if text.isprintable():
        return text
    return "".join(
        letter.encode("unicode_escape").decode()
        if unicodedata.category(letter) in _HIDDEN
        else letter
        for letter in text
    )


def meant(name: str, known: Iterable[str]) -> str:
    """Return which known name is spelled most like one, as `` (is it force?)``; empty if none."""
    alike = {each.casefold(): each for each in known}
    found = difflib.get_close_matches(name.casefold(), alike, n=1)
    return f" (is it {alike[found[0]]}?)" if found else ""


class InputError(ValueError):
    """Bad input or usage, in one sentence: what came, what was wanted, how to mend it.

    The command line prints the sentence and ends with exit status 2. Names in it may come from a
    file, so control characters are escaped.
    """

    def __init__(self, sentence: str = "") -> None:
        super().__init__(printable(sentence))
