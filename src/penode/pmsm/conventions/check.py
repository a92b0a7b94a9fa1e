"""Conventions of a drive recording, tested against physics before anything is trained.

An angle in steps and phases of different units end the tests. First what the channels are, as they
were recorded: angle and speed, the order of phases, signs, exchanged channels, pole pairs. Only
where nothing of that is wrong, when the voltages act, where the magnet lies and how large things
are: a wrong sign or wrong pole pairs imitate all of these. What is found is set right for the
judgement of the next.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from penode.data.experiment import Experiment
from penode.data.stretches import by_recording
from penode.errors import InputError
from penode.pmsm.balance.calibration import AS_RECORDED, Calibration
from penode.pmsm.balance.calibration_fit import calibration_of
from penode.pmsm.balance.trial_balance import try_balance
from penode.pmsm.conventions.agreement import disagreement_of
from penode.pmsm.conventions.balance import judge_delay, judge_hold, judge_magnet
from penode.pmsm.conventions.broken_convention import BrokenConvention, Judge
from penode.pmsm.conventions.cures import judge_cures
from penode.pmsm.conventions.motion import (
    OfShaft,
    find_stepped_angle,
    judge_angle_unit,
    judge_speed_and_angle,
)
from penode.pmsm.conventions.phases import find_uneven_phases, judge_phases, judge_turns
from penode.pmsm.conventions.scales import (
    beside_plate,
    judge_rms_by_phases,
    judge_rms_by_plate,
    judge_temperatures,
    judge_units,
)
from penode.pmsm.machine.holds import DEFAULT_HOLD
from penode.pmsm.machine.standstill import stands_still
from penode.pmsm.machine.terms import Term
from penode.pmsm.recording.channels import drive_recording, require_channels
from penode.pmsm.recording.imperfection import KnownDrive
from penode.pmsm.recording.name_plate import NO_PLATE, NamePlate
from penode.pmsm.recording.stationary_frame import with_phases

#: Samples of a stretch from which the tests may be believed: of 40 stretches of 1000 samples of
#: sound recordings four were called broken, of 20 of 2000 none.
_JUDGED = 2000
#: Shorter ones that are asked where there is no longer one.
_SHORT_ONES = 5
_RMS_UNDETERMINED = (
    "Values{of} are taken as peak, which dq values of a controller are; no recording shows it. "
    "If yours are rms, add rms = true to their entries; the data sheet's values in [name_plate] "
    "test it."
)
#: Where the phases of one of the two kinds were recorded, whose samples are no amplitudes.
_OF_OTHER = {"": "", "i": " of u_d and u_q", "u": " of i_d and i_q"}


@dataclass(frozen=True)
class Conventions:
    """What the physics says of a recording's channels.

    Attributes
    ----------
    broken : tuple of BrokenConvention
        Empty where the channels are right.
    undetermined : tuple of str
        What could not be judged, and why, a sentence each.
    """

    broken: tuple[BrokenConvention, ...] = ()
    undetermined: tuple[str, ...] = ()

    @property
    def refusal(self) -> str:
        """The first broken convention as its sentence, and the names of the others."""
        first, *others = self.broken
        names = ", ".join(dict.fromkeys(b.name for b in others if b.name != first.name))
        return f"{first.sentence} Broken too: {names}." if names else first.sentence

    def __add__(self, other: "Conventions") -> "Conventions":
        return Conventions(self.broken + other.broken, self.undetermined + other.undetermined)


@dataclass(frozen=True, eq=False)
class _Recorded:
    """One stretch as it was recorded, and what its channels turn out to be."""

    found: Conventions
    drive: Experiment
    kinds: str
    pole_pairs_known: bool = True
    ended: bool = False


def check_conventions(
    experiment: Experiment,
    pole_pairs: int | None = None,
    plate: NamePlate = NO_PLATE,
    of_shaft: tuple[str, ...] = (),
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
    of_shaft : tuple of str
        Channels that were recorded of the shaft, and are electrical by the pole pairs.

    Returns
    -------
    Conventions

    Raises
    ------
    InputError
        If a channel is missing or never moves; see
        `penode.pmsm.recording.channels.drive_recording`.
    """
    recorded = _as_recorded(experiment, OfShaft(pole_pairs, of_shaft))
    return recorded.found if recorded.ended else recorded.found + _placed([recorded], plate)


def judge(
    experiments: Sequence[Experiment],
    terms: Sequence[Term] = (),
    hold: str | None = None,
    pole_pairs: int | None = None,
    plate: NamePlate = NO_PLATE,
    of_shaft: tuple[str, ...] = (),
) -> tuple[Conventions, Calibration]:
    """Test the conventions of recordings, and estimate what their channels are corrected by.

    Terms are certain; without a frame of the hold it is decided from the data.
    Of a recording in stretches those are looked at that are long enough not to mislead; where
    there are none, what most of the longest say is taken. Nothing is corrected where a
    convention is broken or pole pairs cannot be determined.
    """
    recordings = [_long_enough(stretches) for stretches in by_recording(experiments)]
    said = OfShaft(pole_pairs, of_shaft)
    recorded = [[_as_recorded(e, said) for e in some] for some in recordings]
    first = [_by_vote([r.found for r in some]) for some in recorded]
    given = Calibration(drive=KnownDrive(hold=hold or DEFAULT_HOLD))
    if any(one.broken for one in first):
        return _sum(first), given
    found = given
    if all(r.pole_pairs_known for some in recorded for r in some):
        drives = [drive_recording(e) for e in experiments]
        require_channels(drives, terms)
        found = calibration_of(drives, terms)
    other = hold and judge_hold(experiments, hold, found)
    if other:
        return _sum([*first, Conventions((other,))]), given
    calibration = given if hold else found
    corrected = [[_corrected(r, calibration) for r in some] for some in recorded]
    timed = hold is None and stands_still(experiments)
    placed = [_placed(some, plate, timed, calibration.knows("delay")) for some in corrected]
    apart = disagreement_of([r.drive for some in corrected for r in some], terms)
    short = [_few(some) for some in recordings]
    return _sum([*first, *placed, Conventions(apart), *short, _unshown(said)]), calibration


def _unshown(said: OfShaft) -> Conventions:
    """Return what is to be said of pole pairs that no recorded channel depends on."""
    if said.pole_pairs is None or said.channels:
        return Conventions()
    reason = (
        f"pole_pairs = {said.pole_pairs} is taken as given: speed and angle are electrical, and "
        "only the torque depends on it."
    )
    return Conventions((), (reason,))


def _long_enough(stretches: Sequence[Experiment]) -> list[Experiment]:
    enough = [e for e in stretches if e.stretch is None or len(e) >= _JUDGED]
    return enough or sorted(stretches, key=len, reverse=True)[:_SHORT_ONES]


def _few(stretches: Sequence[Experiment]) -> Conventions:
    """Return what is to be said of a recording whose longest stretches are short."""
    if stretches[0].stretch is None or len(stretches[0]) >= _JUDGED:
        return Conventions()
    reason = (
        f"{stretches[0].place.recording}: no stretch has {_JUDGED} samples; conventions are what "
        f"most of the {len(stretches)} longest say."
    )
    return Conventions((), (reason,))


def _by_vote(each: Sequence[Conventions]) -> Conventions:
    """Return what most stretches of a recording say, each finding and sentence once."""
    votes = Counter(name for one in each for name in {b.name for b in one.broken})
    found = {b.name: b for one in each for b in one.broken if 2 * votes[b.name] > len(each)}
    reasons = Counter(sentence for one in each for sentence in one.undetermined)
    undetermined = tuple(reason for reason, count in reasons.items() if 2 * count > len(each))
    return Conventions(
        tuple(found.values()), undetermined or (each[0].undetermined if each else ())
    )


def _sum(each: Sequence[Conventions]) -> Conventions:
    whole = sum(each, Conventions())
    return replace(whole, undetermined=tuple(dict.fromkeys(whole.undetermined)))


def _as_recorded(experiment: Experiment, said: OfShaft) -> _Recorded:
    """Return what is wrong with the channels as they were recorded, and the drive set right."""
    stepped = "theta_el" in experiment.channels and find_stepped_angle(experiment)
    ending = stepped or find_uneven_phases(experiment)
    if ending:
        what = "a stepped angle" if stepped else "phases of different units"
        found = Conventions((ending,), (f"With {what} nothing else was tested.",))
        return _Recorded(found, experiment, "", ended=True)
    experiment = with_phases(experiment)
    kinds = "".join(kind for kind in "ui" if _in_phases(experiment, kind))
    broken, fixed = _judge_motion(experiment, kinds, said)
    try:
        broken += judge_rms_by_phases(fixed)
        drive = drive_recording(fixed)
    except InputError:
        if not broken:
            raise
        return _Recorded(Conventions(broken), fixed, kinds, ended=True)
    (finding, drive), undetermined = judge_cures(drive, said)
    broken += (_of_phases(finding, kinds),) if finding else ()
    return _Recorded(
        Conventions(broken, (undetermined,) if undetermined else ()), drive, kinds, not undetermined
    )


def _corrected(recorded: _Recorded, calibration: Calibration) -> _Recorded:
    """Return a stretch corrected in dq with its mean voltages.

    Phases that dq was made from are left out: they are no second measurement.
    """
    if calibration == AS_RECORDED:
        return recorded
    drive = calibration.acting(calibration.applied(recorded.drive))
    left_out = {f"{kind}_{phase}" for kind in recorded.kinds for phase in "abc"}
    kept = {name: values for name, values in drive.channels.items() if name not in left_out}
    return replace(recorded, drive=replace(drive, channels=kept), kinds="")


def _placed(
    stretches: Sequence[_Recorded], plate: NamePlate, timed: bool = False, known: bool = False
) -> Conventions:
    """Return what timing, magnet and scales say of the stretches of one recording.

    At standstill the timing is that of all recordings together, and known before; what the
    calibration knows of it is not said to be undetermined.
    """
    kinds, drives, late = stretches[0].kinds, [r.drive for r in stretches], Conventions()
    if all(r.pole_pairs_known for r in stretches) and not timed:
        finding, drives, why = judge_delay(drives, "u" in kinds)
        late = Conventions((finding,) if finding else (), (why,) if why and not known else ())
    return late + _by_vote([_sized(drive, kinds, plate) for drive in drives])


def _sized(drive: Experiment, kinds: str, plate: NamePlate) -> Conventions:
    """Return where the magnet of a stretch lies, and whether its scales are right."""
    aside, why_not = judge_magnet(drive, kinds == "ui")
    broken: tuple[BrokenConvention, ...] = (aside,) if aside else ()
    broken += judge_units(drive, try_balance(drive)) + judge_temperatures(drive)
    broken += judge_rms_by_plate(drive, plate)
    undetermined: tuple[str, ...] = (why_not,) if why_not else ()
    if not broken and (far := beside_plate(drive, plate)):
        undetermined += (far,)
    if plate.magnet_flux_linkage is None and kinds in _OF_OTHER and not _has_both(drive, kinds):
        undetermined += (_RMS_UNDETERMINED.format(of=_OF_OTHER[kinds]),)
    return Conventions(broken, undetermined)


def _judge_motion(
    experiment: Experiment, kinds: str, said: OfShaft
) -> tuple[tuple[BrokenConvention, ...], Experiment]:
    """Judge angle, speed and phases; return what was found and the recording set right."""
    steps: list[Judge] = []
    if "theta_el" in experiment.channels:
        steps.append(judge_angle_unit)
        if "omega_el" in experiment.channels:
            steps.append(lambda run: judge_speed_and_angle(run, said))
    if kinds:
        steps.append(lambda run: judge_turns(run, kinds))
        steps.append(lambda run: judge_phases(run, kinds))
    broken: tuple[BrokenConvention, ...] = ()
    for step in steps:
        finding, experiment = step(experiment)
        broken += (finding,) if finding else ()
    return broken, experiment


def _of_phases(finding: BrokenConvention, kinds: str) -> BrokenConvention:
    """Return a finding whose fix names the phases of currents that were recorded in phases."""
    fix = finding.fix.replace("i_d and i_q sign", "i_a, i_b and i_c sign")
    return replace(finding, fix=fix) if "i" in kinds else finding


def _in_phases(experiment: Experiment, kind: str) -> bool:
    """Return whether a kind was recorded in phases only."""
    return f"{kind}_d" not in experiment.channels and f"{kind}_a" in experiment.channels


def _has_both(experiment: Experiment, kinds: str) -> bool:
    """Return whether phases were recorded beside dq channels."""
    both = (f"{kind}_{axis}" for kind in "ui" for axis in "dabc")
    return not kinds and all(name in experiment.channels for name in both)
