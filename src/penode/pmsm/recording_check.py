"""All checks of recordings before any training."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from penode.arrays import one_blas_thread
from penode.data.experiment import Experiment
from penode.data.quality import Finding
from penode.data.stretches import STRETCH, excerpt, reasons_of
from penode.fit.outcome import NORMAL_95, Estimate
from penode.pmsm.balance.term_selection import structure_of
from penode.pmsm.balance.usable import left_out, require_samples, usable_stretches
from penode.pmsm.conventions.broken_convention import BrokenConvention
from penode.pmsm.conventions.check import judge
from penode.pmsm.machine.terms import Term
from penode.pmsm.precheck.excitation import Excitation, excitation_of
from penode.pmsm.precheck.expected import expected_resistance
from penode.pmsm.precheck.identifiability import Identifiability, identifiability_of
from penode.pmsm.recording.channels import drive_recording, electrical, require_channels
from penode.pmsm.recording.quality import quality_of
from penode.pmsm.study_settings import DEFAULT_STUDY, Study

#: Samples that are enough to judge all but the quality of the channels by.
SAMPLES = 10 * STRETCH


@dataclass(frozen=True, eq=False)
class RecordingCheck:
    """What the check found.

    Attributes
    ----------
    recordings : tuple of Experiment
        As they were given.
    quality : tuple of Finding
    broken : tuple of BrokenConvention
    undetermined : tuple of str
        Conventions that could not be judged, and why.
    drives : tuple of Experiment
        The recordings in dq; empty where a convention is broken.
    excitation : Excitation or None
        None where a convention is broken, as is what follows.
    identifiability : Identifiability or None
    structure : tuple of str
        How the voltage acts where that is not as recorded, terms that the model would get, and why.
    expected : Estimate or None
        R as the weak form has it, ohm, and the budget of its uncertainty before training.
    sentences : tuple of str
        What was used beyond the quality of the channels; empty where all was.
    left_out : str
        How many samples cannot be used, in a sentence; empty where all can.
    """

    recordings: tuple[Experiment, ...]
    quality: tuple[Finding, ...]
    broken: tuple[BrokenConvention, ...]
    undetermined: tuple[str, ...]
    drives: tuple[Experiment, ...] = ()
    excitation: Excitation | None = None
    identifiability: Identifiability | None = None
    structure: tuple[str, ...] = ()
    expected: Estimate | None = None
    sentences: tuple[str, ...] = ()
    left_out: str = ""

    @property
    def verdict(self) -> str:
        """What the recordings are good for, in a sentence."""
        if self.broken:
            names = ", ".join(dict.fromkeys(finding.name for finding in self.broken))
            return (
                f"These recordings cannot be used as they are ({names}). Fix that and check again; "
                "a sign or order to be given is in addition to what the study file already has."
            )
        if any(finding.severity == "error" for finding in self.quality):
            return "A channel cannot serve; record again."
        if self.identifiability is None or self.identifiability.indistinguishable:
            names = (
                ", ".join(self.identifiability.indistinguishable)
                if self.identifiability
                else "anything"
            )
            return f"These recordings cannot distinguish {names} from the map."
        if self.left_out:
            return f"These recordings can be used. {self.left_out}"
        taken = "; what is undetermined is taken as recorded" if self.undetermined else ""
        return f"These recordings can be used as they are{taken}."

    @property
    def good(self) -> bool:
        """Whether the recordings can be used."""
        serve = all(finding.severity != "error" for finding in self.quality)
        determined = self.identifiability is not None and not self.identifiability.indistinguishable
        return serve and determined and not self.broken

    @property
    def half_widths(self) -> tuple[float, float]:
        """Half widths of R's 95 % interval over R: by sensors, and by what the data show."""
        if self.expected is None:
            return np.inf, np.inf
        sensors, whole = self.expected.sensor_std, self.expected.std
        scale = NORMAL_95 / max(abs(self.expected.value), 1e-300)
        return scale * sensors, scale * float(np.sqrt(max(whole**2 - sensors**2, 0.0)))

    def as_json(self) -> dict[str, Any]:
        """Return the findings as what JSON knows, in SI units."""
        document: dict[str, Any] = {
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
                    "fix": b.fix,
                }
                for b in self.broken
            ],
            "undetermined": list(self.undetermined),
            "used": list(self.sentences),
        }
        if self.excitation is not None and self.identifiability is not None:
            document["excitation"] = {
                "largest_current": self.excitation.largest_current,
                "share_of_disc": self.excitation.fraction,
                "quarters": list(self.excitation.quarters),
                "omega_el": list(self.excitation.speeds),
                "current_rate": self.excitation.current_rate,
                "advice": list(self.excitation.advice),
            }
            document["identifiability"] = {
                "flux_map": self.identifiability.flux_map,
                "independence": dict(self.identifiability.independence),
                "indistinguishable": list(self.identifiability.indistinguishable),
                "alarm": self.identifiability.alarm,
                "repair": self.identifiability.repair,
            }
            document["structure"] = list(self.structure)
        if self.expected is not None:
            sensors, balance = self.half_widths
            document["expected"] = {
                "R_half_width_of_sensors": sensors,
                "R_half_width_of_balance": balance,
            }
        return document


@one_blas_thread
def check_recordings(
    recordings: Sequence[Experiment],
    study: Study = DEFAULT_STUDY,
) -> RecordingCheck:
    """Check recordings as an identification would use them.

    Parameters
    ----------
    recordings : sequence of Experiment
        As a study file maps them.
    study : Study
        Flux map, terms, hold, pole pairs and name plate.

    Raises
    ------
    InputError
        If a recording cannot be used at all.
    """
    quality = quality_of(recordings)
    require_samples(recordings)
    usable = usable_stretches(recordings)
    used = excerpt(usable, electrical(usable), SAMPLES)
    sentences = (*reasons_of(usable), *filter(None, [used.sentence]))
    found, calibration = judge(used.experiments, **study.conventions)
    broken, undetermined = found.broken, found.undetermined
    if broken:
        return RecordingCheck(tuple(recordings), quality, broken, undetermined, sentences=sentences)
    corrected = [calibration.applied(e) for e in _drives(used.experiments, study.terms)]
    drives = tuple(calibration.acting(e) for e in corrected)
    structure = structure_of(drives, study.flux_map, study.terms, study.candidates)
    return RecordingCheck(
        tuple(recordings),
        quality,
        broken,
        undetermined,
        drives,
        excitation_of(drives),
        identifiability_of(drives, study.flux_map, structure.terms),
        (*calibration.reasons, *structure.term_reasons, *structure.angle_reasons),
        expected_resistance(
            corrected, calibration, study.accuracy, study.flux_map, structure.terms
        ),
        sentences,
        left_out(recordings, usable),
    )


def _drives(recordings: Sequence[Experiment], terms: Sequence[Term]) -> list[Experiment]:
    drives = [drive_recording(e) for e in recordings]
    require_channels(drives, terms)
    return drives
