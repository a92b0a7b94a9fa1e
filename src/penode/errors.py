"""The two ways penode refuses: the input is unusable, or the data cannot answer."""

import difflib
import importlib.util
import unicodedata
from collections.abc import Iterable

# Control characters and those that change how the text around them is shown.
_HIDDEN = frozenset(("Cc", "Cf", "Cs", "Zl", "Zp"))


def printable(text: str) -> str:
    r"""Return a text with its control and formatting characters escaped, as ``\x1b``.

    A column's name from a file could move the cursor of a terminal.
    """
    if text.isprintable():
        return text
    return "".join(
        letter.encode("unicode_escape").decode()
        if unicodedata.category(letter) in _HIDDEN
        else letter
        for letter in text
    )


def did_you_mean(word: str, candidates: Iterable[str]) -> str:
    """Return the nearest known word, ``" (did you mean unit?)"``, nothing where none is near."""
    spelt = {name.lower(): name for name in candidates}
    near = difflib.get_close_matches(word.lower(), spelt, n=1, cutoff=0.5)
    return f" (did you mean {spelt[near[0]]}?)" if near else ""


class InputError(ValueError):
    """Bad input or usage, in one sentence: what is wrong, what is wanted, how to fix it.

    The command line prints the sentence and ends with exit status 2. Names in it may come from a
    file, so control characters are escaped.
    """

    def __init__(self, sentence: str = "") -> None:
        super().__init__(printable(sentence))


def require_extra(library: str, extra: str, purpose: str) -> None:
    """Refuse what needs a library that is not installed; the sentence has the command for it."""
    if importlib.util.find_spec(library) is None:
        raise InputError(
            f"{purpose} needs {library}, which is not installed: pip install 'penode[{extra}]'."
        )
