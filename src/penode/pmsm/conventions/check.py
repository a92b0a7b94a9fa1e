"""Conventions of a drive recording, tested against physics before anything is trained.

An angle in steps ends the tests. Angle and speed come first, then the order of phases, signs, the
speed's side, timing, the angle's zero and scales: what is found is mended for the judgement of the
next.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from penode.data.experiment import Experiment
from penode.data.stretches import by_recording
from penode.pmsm.balance.calibration import AS_RECORDED, Calibration
from penode.pmsm.balance.trial_balance import try_balance
from penode.pmsm.conventions.balance import (
    judge_delay,
    judge_magnet,
    judge_signs,
    judge_speed_factor,
)
from penode.pmsm.conventions.broken_convention import BrokenConvention, Judge
from penode.pmsm.conventions.motion import (
    find_stepped_angle,
    judge_angle_unit,
    judge_speed_and_angle,
)
from penode.pmsm.conventions.phases import judge_phases, judge_turns
from penode.pmsm.conventions.scales import judge_rms_by_phases, judge_rms_by_plate, judge_units
from penode.pmsm.recording.channels import drive_recording
from penode.pmsm.recording.name_plate import NO_PLATE, NamePlate
from penode.pmsm.recording.stationary_frame import with_phases

#: Samples of a stretch from which the tests may be believed: of 40 stretches of 1000 samples of
#: sound recordings four were called broken, of 20 of 2000 none.
_JUDGED = 2000
#: Shorter ones that are asked where there is no longer one.
_SHORT_ONES = 5


@dataclass(frozen=True)
class Conventions:
    """What the physics says of a recording's channels.

    Attributes
    ----------
    broken : tuple of BrokenConvention
        Empty where nothing speaks against the channels.
    untold : tuple of str
        What could not be judged, and why, a sentence each.
    """

    broken: tuple[BrokenConvention, ...]
    untold: tuple[str, ...]


def check_conventions(
    experiment: Experiment, pole_pairs: int | None = None, plate: NamePlate = NO_PLATE
) -> Conventions:
    """Test the conventions of one recording.

    Parameters
    ----------
    experiment : Experiment
        Channels as a study file maps them: dq or phase quantities, omega_el, theta_el.
    pole_pairs : int, optional
        Of the machine.
    plate : NamePlate
        Of the machine; only against it, or against phases recorded beside, rms shows.

    Returns
    -------
    Conventions

    Raises
    ------
    InputError
        If a channel is missing or never moves; see
        `penode.pmsm.recording.channels.drive_recording`.
    """
    stepped = "theta_el" in experiment.channels and find_stepped_angle(experiment)
    if stepped:
        return Conventions((stepped,), ("With a stepped angle nothing else was tested.",))
    experiment = with_phases(experiment)
    kinds = "".join(kind for kind in "ui" if _in_phases(experiment, kind))
    broken, mended = _judge_motion(experiment, kinds)
    broken += judge_rms_by_phases(mended)
    drive = drive_recording(mended)
    steps: list[Judge] = [judge_signs]
    if "theta_el" not in drive.channels:
        steps.append(lambda run: judge_speed_factor(run, pole_pairs))
    for judge in steps:
        finding, drive = judge(drive)
        broken += (finding,) if finding else ()
    late, drive, why = judge_delay(drive, "u" in kinds)
    aside, why_not = judge_magnet(drive, kinds == "ui")
    broken += tuple(finding for finding in (late, aside) if finding)
    untold = tuple(reason for reason in (why, why_not) if reason)
    trial = try_balance(drive)
    broken += judge_units(drive, trial)
    broken += judge_rms_by_plate(drive, plate)
    if plate.magnet_flux_linkage is None and not _has_both(experiment):
        untold += (
            "Rms values cannot be distinguished from peak values; give magnet_flux_linkage and "
            "resistance in [name_plate] of the study file, or record phase channels beside.",
        )
    return Conventions(broken, untold)


def check_all(
    experiments: Sequence[Experiment],
    calibration: Calibration,
    pole_pairs: int | None = None,
    plate: NamePlate = NO_PLATE,
) -> list[Conventions]:
    """Test the conventions of recordings, corrected as far as they need it.

    Of a recording in stretches those are looked at that are long enough not to mislead; where there
    are none, what most of the longest say is taken.

    Parameters
    ----------
    experiments : sequence of Experiment
        As in `check_conventions`.
    calibration : Calibration
        Of their channels.
    pole_pairs : int, optional
        Of the machine.
    plate : NamePlate
        Of the machine.
    """
    judged: list[Conventions] = []
    for stretches in by_recording(experiments):
        enough = [e for e in stretches if e.stretch is None or len(e) >= _JUDGED]
        tried = enough or sorted(stretches, key=len, reverse=True)[:_SHORT_ONES]
        corrected = (_corrected(e, calibration) for e in tried)
        each = [check_conventions(e, pole_pairs, plate) for e in corrected]
        judged += each if enough else [_by_vote(each, stretches[0].place.recording)]
    return judged


def _by_vote(each: Sequence[Conventions], recording: str) -> Conventions:
    """Return what most short stretches of a recording say."""
    votes = Counter(name for one in each for name in {b.name for b in one.broken})
    found = {b.name: b for one in each for b in one.broken if 2 * votes[b.name] > len(each)}
    reason = (
        f"{recording}: no stretch has {_JUDGED} samples; conventions are what most of the "
        f"{len(each)} longest say."
    )
    return Conventions(tuple(found.values()), (reason, *each[0].untold))


def _corrected(experiment: Experiment, calibration: Calibration) -> Experiment:
    """Return a recording as it came, or corrected in dq with its mean voltages.

    Phases that dq was made from are left out: they are no second measurement.
    """
    if calibration == AS_RECORDED:
        return experiment
    experiment = with_phases(experiment)
    made = [kind for kind in "ui" if _in_phases(experiment, kind)]
    drive = calibration.acting(calibration.applied(drive_recording(experiment)))
    left_out = {f"{kind}_{phase}" for kind in made for phase in "abc"}
    kept = {name: values for name, values in drive.channels.items() if name not in left_out}
    return replace(drive, channels=kept)


def _judge_motion(
    experiment: Experiment, kinds: str
) -> tuple[tuple[BrokenConvention, ...], Experiment]:
    """Judge angle, speed and phases; return what was found and the recording mended."""
    steps: list[Judge] = []
    if "theta_el" in experiment.channels:
        steps.append(judge_angle_unit)
        if "omega_el" in experiment.channels:
            steps.append(judge_speed_and_angle)
    if kinds:
        steps.append(lambda run: judge_turns(run, kinds))
        steps.append(lambda run: judge_phases(run, kinds))
    broken: tuple[BrokenConvention, ...] = ()
    for judge in steps:
        finding, experiment = judge(experiment)
        broken += (finding,) if finding else ()
    return broken, experiment


def _in_phases(experiment: Experiment, kind: str) -> bool:
    """Return whether a kind was recorded in phases only."""
    return f"{kind}_d" not in experiment.channels and f"{kind}_a" in experiment.channels


def _has_both(experiment: Experiment) -> bool:
    both = (f"{kind}_{axis}" for kind in "ui" for axis in "dabc")
    return all(name in experiment.channels for name in both)
