"""The two ways penode refuses: the input is unusable, or the data cannot answer."""

import difflib
import importlib.util
import unicodedata
from collections.abc import Iterable
from itertools import takewhile

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


#: Likeness of words that may be meant for each other, and letters at the end that may be a slip.
_LIKE, _SLIP = 0.5, 3


def did_you_mean(word: str, candidates: Iterable[str]) -> str:
    """Return the nearest known word, ``" (did you mean unit?)"``, nothing where none is near."""
    spelt = {name.lower(): name for name in candidates}
    near = difflib.get_close_matches(word.lower(), spelt, n=3, cutoff=_LIKE)
    for name in near:
        # What all columns begin with, "Mot_", says nothing of which one is meant.
        pairs = zip(word.lower(), name, strict=False)
        same = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
        rest = word.lower()[same:], name[same:]
        like = difflib.SequenceMatcher(None, *rest).ratio() >= _LIKE
        if like or not all(rest) or max(map(len, rest)) <= _SLIP:
            return f" (did you mean {spelt[name]}?)"
    return ""


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
