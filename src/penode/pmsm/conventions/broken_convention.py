"""One convention that a recording breaks."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

from penode.arrays import FloatArray
from penode.data.experiment import Experiment


@dataclass(frozen=True)
class BrokenConvention:
    """What is wrong with the channels of a recording, as the physics shows it.

    Attributes
    ----------
    name : str
        Such as ``"reversed speed"``.
    recording : str
        Name of the recording.
    channels : tuple of str
        Channels concerned.
    evidence : str
        What shows it, with numbers; the beginning of a sentence.
    mend : str
        An entry of the study file, or what to do; the end of that sentence.
    """

    name: str
    recording: str
    channels: tuple[str, ...]
    evidence: str
    mend: str

    @property
    def sentence(self) -> str:
        """The finding as one sentence."""
        return f"{self.recording}: {self.name}: {self.evidence}; {self.mend}."


#: What a judgement gives: the finding or None, and the recording with it mended.
Judged: TypeAlias = tuple[BrokenConvention | None, Experiment]
Judge: TypeAlias = Callable[[Experiment], Judged]


def with_channels(experiment: Experiment, changed: dict[str, FloatArray]) -> Experiment:
    """Return a recording with some channels exchanged or added.

    Parameters
    ----------
    experiment : Experiment
    changed : dict of str to ndarray, each of shape (time,)
        SI values.
    """
    return replace(experiment, channels={**experiment.channels, **changed})
