"""Where one channel of a drive probably comes from, and why."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ChannelGuess:
    """Where one channel probably comes from, and why, a clause each.

    ``unit`` is a key of `penode.data.units.UNITS`, and ``scale`` what one count of the column is in
    it; ``sign`` is -1 where the column counts backwards; ``mechanical`` says that it belongs to the
    shaft.
    """

    column: str
    unit: str
    reasons: tuple[str, ...]
    sign: int = 1
    mechanical: bool = False
    scale: float = 1.0
