"""From drive recordings to a machine: the application's main path."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial

from penode.arrays import one_blas_thread
from penode.data.experiment import Experiment, require_recordings
from penode.data.gathered import require_memory
from penode.data.rates import require_one_time_step
from penode.data.stretches import Excerpt, reasons_of
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.horizon.checkpoint import Checkpoint
from penode.horizon.identifiability import Start
from penode.horizon.ladder import Observer, ignore_events
from penode.identify import identify as identify_model
from penode.pmsm.balance.calibration import AS_RECORDED, Calibration
from penode.pmsm.balance.calibration_fit import calibration_of
from penode.pmsm.balance.doubt import Doubt
from penode.pmsm.balance.drift import Drift, drift_of
from penode.pmsm.balance.left_over import left_over
from penode.pmsm.balance.start import anchor_of, weak_start
from penode.pmsm.balance.usable import left_out, require_samples, usable_stretches
from penode.pmsm.conventions.check import Conventions, judge
from penode.pmsm.machine.dead_time import PhaseSigns
from penode.pmsm.machine.flux_maps import FLUX_MAPS
from penode.pmsm.machine.standstill import counted_from_zero
from penode.pmsm.points.beside import with_points, with_recorded_torque
from penode.pmsm.points.identify import balances_of
from penode.pmsm.precheck.objections import machine_checks, uncertain_resistance
from penode.pmsm.precheck.unused_samples import unused_samples
from penode.pmsm.precheck.voltage_timing import voltage_timing
from penode.pmsm.recording.channels import drive_recording
from penode.pmsm.recording.imperfections import budget_rows
from penode.pmsm.recording.quality import quality_of
from penode.pmsm.study_settings import DEFAULT_STUDY, Study
from penode.predictors.base import Predictor
from penode.training.plan import Plan

#: What a sample that is used takes at most, measured at 100 000 of them with angle orders.
_BYTES = 15_000
_SKEWED = (
    "The angle harmonics are not mirror symmetric, as those of a skewed machine: cosines and sines "
    "of both symmetries were included."
)


def identify(
    experiments: Sequence[Experiment],
    *,
    pole_pairs: int | None = None,
    study: Study = DEFAULT_STUDY,
    validation: Sequence[Experiment] = (),
    observer: Observer = ignore_events,
    checkpoint: Checkpoint | None = None,
) -> Fit:
    """Identify the resistance and the flux-linkage map of a machine from drive recordings.

    Parameters
    ----------
    experiments : sequence of Experiment
        Recordings with u_d, u_q (V), i_d, i_q (A) and omega_el (rad/s), or phase quantities with
        theta_el (rad), of one time step.
    pole_pairs : int, optional
        For the torque; overrides the study's.
    study : Study
        Flux map, terms, hold, horizon and seed.
    validation : sequence of Experiment
        Recordings that are predicted but not trained on.
    observer : callable
        Receives each evaluation and rung.
    checkpoint : Checkpoint, optional
        Keeps finished horizons in a file, from which a stopped fit goes on.

    Returns
    -------
    Fit
        With ``flux_map(i_d, i_q)`` in Vs and ``differential_inductance(i_d, i_q)`` in H.

    Raises
    ------
    InputError
        If a recording cannot be used, or breaks a convention and the study does not train anyway;
        the message names it, the channel and the fix. If more
        samples are asked for than there is memory for.
    Stopped
        On Ctrl-C after the first horizon; a KeyboardInterrupt that carries the fit so far.
    """
    asked = study if pole_pairs is None else replace(study, pole_pairs=pole_pairs)
    fit, recordings = identified(experiments, asked, validation, observer, checkpoint)
    if asked.flux_map == "coenergy":
        fit = with_recorded_torque(fit, recordings, asked.pole_pairs, asked.accuracy)
    return uncertain_resistance(counted_from_zero(fit))


def identify_with_points(
    experiments: Sequence[Experiment],
    points: Experiment,
    *,
    study: Study = DEFAULT_STUDY,
    validation: Sequence[Experiment] = (),
    observer: Observer = ignore_events,
    checkpoint: Checkpoint | None = None,
) -> Fit:
    """Identify a machine from drive recordings and a table of operating points of the same bench.

    Parameters
    ----------
    experiments : sequence of Experiment
        As `identify` takes them.
    points : Experiment
        As `penode.pmsm.identify_points` takes them.
    study, validation, observer, checkpoint
        As `identify` takes them; the flux map must be ``coenergy``.

    Returns
    -------
    Fit
        That of the recordings, R and map narrowed by the points, with ``fit.stationary``.
        Recordings are predicted without the points. Where no horizon was preferred, or fewer than
        two points lie within the currents of the recordings, it is that of the recordings alone,
        with a warning.

    Raises
    ------
    InputError
        As from `identify`; if the map is another one, or a channel that the points need is missing.
    Stopped
        As from `identify`, of the recordings alone.
    """
    if study.flux_map != "coenergy":
        raise InputError(
            f"flux_map must be coenergy with operating points beside recordings, got "
            f"{study.flux_map}."
        )
    balances = balances_of(points, study)
    fit, _ = identified(experiments, study, validation, observer, checkpoint)
    return uncertain_resistance(counted_from_zero(with_points(fit, balances)))


@one_blas_thread
def identified(
    experiments: Sequence[Experiment],
    asked: Study,
    validation: Sequence[Experiment],
    observer: Observer,
    checkpoint: Checkpoint | None,
) -> tuple[Fit, list[Experiment]]:
    """Return the fit before its verdict says whether R is known well enough.

    Behind it are the recordings as it was trained on, corrected.
    """
    read = _Read.of(experiments, validation, asked)
    words = {entry.name.replace("_", " "): getattr(asked, entry.name) for entry in fields(asked)}
    kept = None if checkpoint is None else checkpoint.begun(words)
    found, calibration = kept.judged if kept else read.judged(asked)
    recorded = read.drives(found, asked, observer)
    began = kept or _Beginning.of(recorded.recordings, asked, found, calibration)
    corrected = began.corrected(recorded)
    plan = began.study.plan(corrected.recordings, bool(read.used.sentence))
    fit = identify_model(
        began.start_of(corrected, read, plan),
        corrected.recordings,
        plan=plan if checkpoint is None else checkpoint.over(plan, observer, words, began),
        purpose=began.study.selector(corrected.unseen or corrected.recordings),
        validation=corrected.unseen,
        observer=observer,
    )
    reason = " ".join(filter(None, [fit.horizon.reason, left_out(experiments, read.usable)]))
    return replace(fit, horizon=replace(fit.horizon, reason=reason)), corrected.recordings


@dataclass(frozen=True, eq=False)
class _Drives:
    """Recordings of a drive in dq, to train on and to predict."""

    recordings: list[Experiment]
    unseen: list[Experiment]


@dataclass(frozen=True, eq=False)
class _Read:
    """What can be used of recordings, and what of it is."""

    usable: Sequence[Experiment]
    used: Excerpt
    unseen: Sequence[Experiment]

    @classmethod
    def of(
        cls, experiments: Sequence[Experiment], validation: Sequence[Experiment], study: Study
    ) -> "_Read":
        require_recordings(experiments, validation)
        require_one_time_step(experiments)
        require_samples(experiments)
        usable = usable_stretches(experiments)
        unseen = study.excerpt(usable_stretches(validation)).experiments
        used = study.excerpt(usable)
        require_memory(sum(map(len, used.experiments)), _BYTES)
        return cls(usable, used, unseen)

    def judged(self, study: Study) -> tuple[Conventions, Calibration]:
        """Return what is wrong with the channels, and what they have to be corrected by."""
        return judge(self.used.experiments, **study.conventions)

    def drives(self, found: Conventions, study: Study, observer: Observer) -> _Drives:
        """Return the channels of a drive, refused where a convention or a channel is missing."""
        if found.broken and not study.train_anyway:
            raise InputError(f"{found.refusal} Nothing was trained; --train-anyway would.")
        runs, unseen = (
            [drive_recording(e) for e in some] for some in (self.used.experiments, self.unseen)
        )
        study.check([*runs, *unseen])
        observer({"event": "start", "recordings": [e.name for e in runs]})
        return _Drives(runs, unseen)


@dataclass(frozen=True, eq=False)
class _Beginning:
    """What is decided and estimated before training; a checkpoint keeps it.

    The study has what was left to the data decided; the start is by the weak form; doubts are what
    the recordings leave open.
    """

    found: Conventions
    calibration: Calibration
    study: Study
    start: Start
    doubts: tuple[Doubt, ...]
    drift: Drift

    @classmethod
    def of(
        cls,
        recordings: Sequence[Experiment],
        study: Study,
        found: Conventions,
        calibration: Calibration,
    ) -> "_Beginning":
        """Return what recordings say; a knee found after the calibration is cause for another."""
        once = cls._with(calibration, recordings, study, found)
        knee = any(isinstance(term, PhaseSigns) for term in once.study.terms)
        if study.hold is not None or calibration == AS_RECORDED or not knee:
            return once
        return cls._with(calibration_of(recordings, once.study.terms), recordings, study, found)

    @classmethod
    def _with(
        cls,
        calibration: Calibration,
        recordings: Sequence[Experiment],
        study: Study,
        found: Conventions,
    ) -> "_Beginning":
        corrected = [calibration.applied(e) for e in recordings]
        acting = [calibration.acting(e) for e in corrected]
        drift = drift_of(acting, study.terms)
        steady = drift.applied(acting)
        held = replace(study, hold=calibration.drive.hold)
        decided, reasons, doubts = held.decided(steady)
        decided.check(corrected)
        start = _start(steady, decided, (*calibration.reasons, *drift.reasons, *reasons))
        odd = tuple(f.sentence for f in quality_of(recordings))
        start = replace(start, warnings=odd)
        return cls(found, calibration, decided, start, doubts, drift)

    @property
    def judged(self) -> tuple[Conventions, Calibration]:
        """As `_Read.judged` gives it, calibrated once more where a knee was found."""
        return self.found, self.calibration

    def corrected(self, drives: _Drives) -> _Drives:
        """Return recordings corrected, those to train on without their drift."""
        runs, unseen = (
            [self.calibration.applied(e) for e in some]
            for some in (drives.recordings, drives.unseen)
        )
        self.study.check([*runs, *unseen])
        return _Drives(self.drift.applied(runs), unseen)

    def start_of(self, corrected: _Drives, read: _Read, plan: Plan) -> Start:
        """Return the start with what is left of every imperfection, and what is examined after."""
        recordings, used = corrected.recordings, read.used.sentence
        checks = machine_checks(
            self.found.broken, corrected.unseen, self.study.terms, self.study.name_plate
        )
        checks += voltage_timing(plan, self.calibration)
        predictor = Predictor(recordings[0].time_step, plan.solver, plan.hold)
        if used:
            checks += (unused_samples(read.usable, self.calibration, predictor),)
        sentences = filter(None, (*reasons_of(read.usable), used))
        structure = [*sentences, *self.start.facts["structure"], *self.found.undetermined]
        left = (
            *self.calibration.rows(self.study.accuracy, recordings),
            *(doubt.imperfection for doubt in self.doubts),
            *budget_rows(self.drift.left, recordings, self.calibration.drive),
        )
        facts = {**self.start.facts, "structure": structure}
        over = partial(left_over, recordings, predictor, left)
        return replace(self.start, facts=facts, checks=checks, imperfections=left, left_out=over)


def _start(recordings: Sequence[Experiment], study: Study, reasons: Sequence[str]) -> Start:
    """Return the start by the weak form, and the settings."""
    orders, terms = study.angle_orders or (), study.terms
    machine, balance, penalties = weak_start(
        recordings, study.flux_map, study.seed, angle_orders=orders, terms=terms
    )
    repair = "Add a recording at another speed, or reverse the speed."
    if not FLUX_MAPS[study.flux_map].reciprocal:
        repair = f"Use the reciprocal map (--flux-map coenergy). Or: a{repair[1:]}"
    if getattr(machine.flux.network, "skewed", False):
        reasons = (*reasons, _SKEWED)
    facts = study.facts(recordings, reasons)
    anchor = anchor_of(recordings, balance)
    return Start(machine, balance.independence, anchor, repair, facts, penalties=penalties)
