"""Where one channel of a drive probably comes from, and why."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ChannelGuess:
    """Where one channel probably comes from.

    Attributes
    ----------
    column : str
        Column of the file.
    unit : str
        Key of `penode.data.units.UNITS`.
    reasons : tuple of str
        Why, a clause each.
    sign : {1, -1}
        -1 where the column counts backwards.
    mechanical : bool
        The column belongs to the shaft.
    scale : float
        What one count of the column is in that unit.
    """

    column: str
    unit: str
    reasons: tuple[str, ...]
    sign: int = 1
    mechanical: bool = False
    scale: float = 1.0
