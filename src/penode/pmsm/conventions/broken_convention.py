"""One convention that a recording breaks."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

from penode.arrays import FloatArray
from penode.data.experiment import Experiment


@dataclass(frozen=True)
class BrokenConvention:
    """What is wrong with the channels of a recording, as the physics shows it."""

    # Such as "reversed speed".
    name: str
    recording: str
    channels: tuple[str, ...]
    # What shows it, with numbers; the beginning of a sentence.
    evidence: str
    # An entry of the study file, or what to do; the end of that sentence.
    fix: str

    @property
    def sentence(self) -> str:
        """The finding as one sentence."""
        return f"{self.recording}: {self.name}: {self.evidence}; {self.fix}."


#: What a judgement gives: the finding or None, and the recording with it corrected.
Judged: TypeAlias = tuple[BrokenConvention | None, Experiment]
Judge: TypeAlias = Callable[[Experiment], Judged]


def with_channels(experiment: Experiment, changed: dict[str, FloatArray]) -> Experiment:
    """Return a recording with some channels (time,), SI values, exchanged or added."""
    return replace(experiment, channels={**experiment.channels, **changed})
