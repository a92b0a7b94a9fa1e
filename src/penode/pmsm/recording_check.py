"""Everything that can be said of recordings before any training."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from threadpoolctl import threadpool_limits

from penode.data.experiment import Experiment
from penode.data.quality import Finding, inspect
from penode.pmsm.broken_convention import BrokenConvention
from penode.pmsm.channels import drive_recording
from penode.pmsm.conventions import check_conventions
from penode.pmsm.excitation import Excitation, excitation_of
from penode.pmsm.prospects import Prospects, prospects_of
from penode.pmsm.study_file import StudyFile

_INSPECTED = ("u", "i")


@dataclass(frozen=True, eq=False)
class RecordingCheck:
    """What the check found.

    Attributes
    ----------
    recordings : tuple of Experiment
        As they came.
    quality : tuple of Finding
    broken : tuple of BrokenConvention
    untold : tuple of str
        Conventions that could not be judged, and why.
    drives : tuple of Experiment
        The recordings in dq; empty where a convention is broken.
    excitation : Excitation or None
        None where a convention is broken, as is what follows.
    prospects : Prospects or None
    structure : tuple of str
        Terms that the model would get, and why.
    """

    recordings: tuple[Experiment, ...]
    quality: tuple[Finding, ...]
    broken: tuple[BrokenConvention, ...]
    untold: tuple[str, ...]
    drives: tuple[Experiment, ...] = ()
    excitation: Excitation | None = None
    prospects: Prospects | None = None
    structure: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        """What the recordings are good for, in a sentence."""
        if self.broken:
            names = ", ".join(dict.fromkeys(found.name for found in self.broken))
            return (
                f"Mend the conventions first ({names}), then check again; the entries count from "
                "the channels as they are mapped now."
            )
        if any(finding.severity == "error" for finding in self.quality):
            return "A channel cannot serve; record again."
        if self.prospects is None or self.prospects.indistinguishable:
            names = ", ".join(self.prospects.indistinguishable) if self.prospects else "anything"
            return f"These recordings cannot tell {names} from the map."
        return "These recordings can be used as they are."

    @property
    def good(self) -> bool:
        """Whether the recordings can be used as they are."""
        serve = all(finding.severity != "error" for finding in self.quality)
        told = self.prospects is not None and not self.prospects.indistinguishable
        return serve and told and not self.broken

    def as_json(self) -> dict[str, Any]:
        """Return the findings as what JSON knows, in SI units."""
        found: dict[str, Any] = {
            "good": self.good,
            "verdict": self.verdict,
            "recordings": [
                {"name": e.name, "samples": len(e), "time_step": e.time_step}
                for e in self.recordings
            ],
            "quality": [
                {"severity": f.severity, "channel": f.channel, "sentence": f.sentence}
                for f in self.quality
            ],
            "conventions": [
                {
                    "name": b.name,
                    "recording": b.recording,
                    "channels": list(b.channels),
                    "evidence": b.evidence,
                    "mend": b.mend,
                }
                for b in self.broken
            ],
            "untold": list(self.untold),
        }
        if self.excitation is not None and self.prospects is not None:
            found["excitation"] = {
                "largest_current": self.excitation.largest_current,
                "share_of_disc": self.excitation.share,
                "quarters": list(self.excitation.quarters),
                "omega_el": list(self.excitation.speeds),
                "current_rate": self.excitation.current_rate,
                "advice": list(self.excitation.advice),
            }
            found["identifiability"] = {
                "flux_map": self.prospects.flux_map,
                "independence": dict(self.prospects.independence),
                "indistinguishable": list(self.prospects.indistinguishable),
                "alarm": self.prospects.alarm,
                "repair": self.prospects.repair,
            }
            found["structure"] = list(self.structure)
        return found


def check_recordings(recordings: Sequence[Experiment], asked: StudyFile) -> RecordingCheck:
    """Check recordings as a study would use them.

    Parameters
    ----------
    recordings : sequence of Experiment
        As `StudyFile.load` gives them.
    asked : StudyFile
        Flux map, inverter, pole pairs, name plate.

    Raises
    ------
    InputError
        If a recording cannot be used at all.
    """
    # Threads that wait for each other cost more than these small matrices bring.
    with threadpool_limits(limits=1, user_api="blas"):
        return _check(recordings, asked)


def _check(recordings: Sequence[Experiment], asked: StudyFile) -> RecordingCheck:
    quality = tuple(f for e in recordings for f in inspect(e, _electrical(e)))
    judged = [check_conventions(e, asked.mapping.pole_pairs, asked.name_plate) for e in recordings]
    broken = tuple(b for one in judged for b in one.broken)
    untold = tuple(dict.fromkeys(sentence for one in judged for sentence in one.untold))
    if broken:
        return RecordingCheck(tuple(recordings), quality, broken, untold)
    drives = tuple(drive_recording(e) for e in recordings)
    study, reasons = asked.study.settled(drives)
    study.check(drives)
    return RecordingCheck(
        tuple(recordings),
        quality,
        broken,
        untold,
        drives,
        excitation_of(drives),
        prospects_of(drives, study.flux_map, bool(study.inverter)),
        reasons,
    )


def _electrical(experiment: Experiment) -> list[str]:
    return [n for n in experiment.channels if n.split("_")[0] in _INSPECTED]
