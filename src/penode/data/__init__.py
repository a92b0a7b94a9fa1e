"""Recordings: loaded from files, checked and cut into windows; nothing here repairs data.

A recording is an `Experiment`; `load` makes one from a file, `check_excitation` and `inspect`
judge it, and `cut` makes `Windows` of one or many. To read another file format, add a reader
beside those in `penode.data.readers` and name its suffix in `penode.data.load`.
"""

from penode.data.excitation import check_excitation
from penode.data.experiment import Experiment, Source
from penode.data.load import load
from penode.data.quality import (
    Finding,
    find_clipping,
    find_constant,
    find_stuck,
    inspect,
)
from penode.data.windows import Contiguous, Jittered, Placement, Windows, cut

__all__ = [
    "Contiguous",
    "Experiment",
    "Finding",
    "Jittered",
    "Placement",
    "Source",
    "Windows",
    "check_excitation",
    "cut",
    "find_clipping",
    "find_constant",
    "find_stuck",
    "inspect",
    "load",
]
