"""From drive recordings to a machine: the application's main path."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

from penode.arrays import one_blas_thread
from penode.data.experiment import Experiment
from penode.data.quality import inspect
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.horizon.checkpoint import Checkpoint
from penode.horizon.held_out import LOOK_AHEADS, HeldOut
from penode.horizon.identifiability import Start
from penode.horizon.ladder import HORIZONS, Observer, fitting_plan, ignore_events, ladder_plan
from penode.horizon.selection import Longest, Plateau, Selector
from penode.horizon.uncertainty_budget import Imperfection
from penode.identify import identify as identify_model
from penode.pmsm.balance.calibration import AS_RECORDED, Calibration
from penode.pmsm.balance.calibration_fit import calibration_of
from penode.pmsm.balance.doubt import Doubt
from penode.pmsm.balance.drift import Drift, drift_of
from penode.pmsm.balance.start import anchor_of, weak_start
from penode.pmsm.balance.term_selection import CANDIDATES, is_open, structure_of
from penode.pmsm.machine.dead_time import PhaseSigns
from penode.pmsm.machine.facts import facts_of
from penode.pmsm.machine.flux_maps import FLUX_MAPS, check_angle_orders
from penode.pmsm.machine.holds import DEFAULT_HOLD, HOLDS, check_hold
from penode.pmsm.machine.standstill import counted_from_zero
from penode.pmsm.machine.term_registry import completed
from penode.pmsm.machine.terms import Term
from penode.pmsm.precheck.objections import machine_checks
from penode.pmsm.recording.accuracy import DEFAULT_ACCURACY, Accuracy
from penode.pmsm.recording.channels import drive_recording, require_channels
from penode.training.plan import Plan
from penode.training.second_order import LevenbergMarquardt

#: What the horizon may be chosen for.
PURPOSES = ("parameters", *LOOK_AHEADS)
#: First damping for a map that is linear in its coefficients: one step reaches the minimum.
_NEARLY_LINEAR = 1e-6


@dataclass(frozen=True)
class Study:
    """What a user may ask for; everything has a default.

    Attributes
    ----------
    flux_map : str
        A key of `penode.pmsm.machine.flux_maps.FLUX_MAPS`.
    horizon : int or None
        Steps of one sample; None selects it from the data.
    pole_pairs : int or None
        For the torque; None where it is not needed.
    seed : int
        Seed of window placement, and of the draw of a map other than ``"coenergy"``.
    terms : tuple of Term
        Of the voltage equation, beside resistance and rotation or in their place.
    candidates : tuple of Term
        Terms that the data decide; dead time by default.
    angle_orders : tuple of int or None
        Harmonics of the electrical angle in the flux map, such as (6, 12); they need theta_el.
        None decides from the data.
    purpose : str
        ``"parameters"`` picks the horizon by the agreement of the physical parameters,
        ``"simulation"`` and ``"one_step"`` by the errors of free runs and of single steps, on the
        validation recordings where there are any.
    hold : str or None
        Frame in which the voltage of a row is held until the next: ``"dq"``, or
        ``"stationary"`` for an inverter without correction of the turn. None decides from the
        data, and whether the voltage acts later than it was recorded.
    accuracy : Accuracy
        Of the recording chain, for the uncertainty budget; an ordinary bench's by default.

    Raises
    ------
    InputError
        If a name is unknown, the horizon is below 1, the map cannot have angle orders, or two
        terms have one role.
    """

    flux_map: str = "coenergy"
    horizon: int | None = None
    pole_pairs: int | None = None
    seed: int = 0
    terms: tuple[Term, ...] = ()
    candidates: tuple[Term, ...] = CANDIDATES
    angle_orders: tuple[int, ...] | None = None
    hold: str | None = None
    purpose: str = "parameters"
    accuracy: Accuracy = DEFAULT_ACCURACY

    def __post_init__(self) -> None:
        if self.flux_map not in FLUX_MAPS:
            raise InputError(
                f"flux map {self.flux_map!r} came; choose one of {', '.join(FLUX_MAPS)}."
            )
        if self.horizon is not None and self.horizon < 1:
            raise InputError(f"horizon {self.horizon} came; give a whole number from 1, or auto.")
        if self.purpose not in PURPOSES:
            raise InputError(f"purpose {self.purpose!r} came; choose one of {', '.join(PURPOSES)}.")
        check_hold(self.hold or DEFAULT_HOLD)
        completed(self.terms)
        check_angle_orders(self.flux_map, self.angle_orders or ())

    def plan(self, experiments: Sequence[Experiment]) -> Plan:
        """Return the ladder: up to the horizon asked for, or as far as the recordings reach."""
        # A map with angle orders is larger and starts closer: fewer rungs, none of them cold.
        horizons = HORIZONS[:: 2 if self.angle_orders else 1]
        optimiser = LevenbergMarquardt(evaluations=25) if self.angle_orders else None
        if self.flux_map == "coenergy":
            optimiser = LevenbergMarquardt(evaluations=25, damping=_NEARLY_LINEAR)
        if self.horizon is None:
            plan = fitting_plan(ladder_plan(horizons, optimiser, self.seed), experiments)
        else:
            below = [h for h in HORIZONS if h < self.horizon]
            plan = ladder_plan([*below[::3], self.horizon], optimiser, self.seed)
        return replace(plan, hold=HOLDS[self.hold or DEFAULT_HOLD])

    def check(self, experiments: Sequence[Experiment]) -> None:
        """Refuse recordings without a channel that the model needs.

        Raises
        ------
        InputError
            If a channel of a term, or theta_el for angle orders, is missing or not credible.
        """
        require_channels(experiments, self.terms, self.angle_orders or ())

    def decided(
        self, experiments: Sequence[Experiment]
    ) -> tuple["Study", tuple[str, ...], tuple[Doubt, ...]]:
        """Return the study with what was left to the data decided, why, and what stays open."""
        if self.angle_orders is not None and not (self.candidates or any(map(is_open, self.terms))):
            return self, (), ()
        structure = structure_of(experiments, self.flux_map, self.terms, self.candidates)
        study, reasons = replace(self, terms=structure.terms, candidates=()), structure.term_reasons
        if self.angle_orders is None:
            study = replace(study, angle_orders=structure.angle_orders)
            reasons += structure.angle_reasons
        return study, reasons, structure.doubts

    def calibration(self, experiments: Sequence[Experiment]) -> Calibration:
        """Return what the channels of recordings have to be corrected by."""
        if self.hold is not None:
            return Calibration(hold=self.hold)
        return calibration_of(experiments, self.terms)

    def selector(self, experiments: Sequence[Experiment]) -> Selector:
        """Return the rule that picks the horizon, given what it may predict."""
        if self.horizon is not None:
            return Longest()
        if self.purpose == "parameters":
            return Plateau()
        return HeldOut(experiments, LOOK_AHEADS[self.purpose])


DEFAULT_STUDY = Study()


@one_blas_thread
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
        If a recording cannot be used; the message names it, the channel and the mend.
    Stopped
        On Ctrl-C after the first horizon; a KeyboardInterrupt that carries the fit so far.
    """
    recordings = [drive_recording(e) for e in experiments]
    unseen = [drive_recording(e) for e in validation]
    study = study if pole_pairs is None else replace(study, pole_pairs=pole_pairs)
    study.check([*recordings, *unseen])
    observer({"event": "start", "recordings": [e.name for e in recordings]})
    asked = {entry.name.replace("_", " "): getattr(study, entry.name) for entry in fields(study)}
    began = None if checkpoint is None else checkpoint.begun(asked)
    began = began or _Beginning.of(recordings, study)
    calibration, study = began.calibration, began.study
    recordings, unseen = ([calibration.applied(e) for e in runs] for runs in (recordings, unseen))
    study.check([*recordings, *unseen])
    recordings = began.drift.applied(recordings)
    plan = study.plan(recordings)
    if checkpoint is not None:
        plan = checkpoint.over(plan, observer, asked, began)
    start = replace(
        began.start,
        checks=machine_checks(experiments, calibration, study.pole_pairs),
        imperfections=(
            *calibration.accuracy(study.accuracy).imperfections(recordings),
            *began.imperfections,
        ),
    )
    fit = identify_model(
        start,
        recordings,
        plan=plan,
        selector=study.selector(unseen or recordings),
        validation=unseen,
        observer=observer,
    )
    return counted_from_zero(fit)


@dataclass(frozen=True, eq=False)
class _Beginning:
    """What is decided and estimated before training; a checkpoint keeps it.

    Attributes
    ----------
    calibration : Calibration
        Of the channels.
    study : Study
        With what was left to the data decided.
    start : Start
        By the weak form.
    doubts : tuple of Doubt
        What the recordings leave open.
    drift : Drift
        Over the recordings.
    """

    calibration: Calibration
    study: Study
    start: Start
    doubts: tuple[Doubt, ...]
    drift: Drift

    @classmethod
    def of(cls, recordings: Sequence[Experiment], study: Study) -> "_Beginning":
        """Return what recordings say; a knee found after the calibration is cause for another."""
        once = cls._with(study.calibration(recordings), recordings, study)
        knee = any(isinstance(term, PhaseSigns) for term in once.study.terms)
        if study.hold is not None or once.calibration == AS_RECORDED or not knee:
            return once
        return cls._with(calibration_of(recordings, once.study.terms), recordings, study)

    @classmethod
    def _with(
        cls, calibration: Calibration, recordings: Sequence[Experiment], study: Study
    ) -> "_Beginning":
        corrected = [calibration.applied(e) for e in recordings]
        acting = [calibration.acting(e) for e in corrected]
        drift = drift_of(acting, study.terms)
        steady = drift.applied(acting)
        study, reasons, doubts = replace(study, hold=calibration.hold).decided(steady)
        study.check(corrected)
        start = _start(steady, study, (*calibration.reasons, *drift.reasons, *reasons))
        return cls(calibration, study, start, doubts, drift)

    @property
    def imperfections(self) -> tuple[Imperfection, ...]:
        """What is left of all that was decided and estimated."""
        doubts = tuple(doubt.imperfection for doubt in self.doubts)
        return self.calibration.imperfections + doubts + self.drift.imperfections


def _start(recordings: Sequence[Experiment], study: Study, reasons: Sequence[str]) -> Start:
    """Return the start by the weak form, the settings and what is odd in the recordings."""
    orders, terms = study.angle_orders or (), study.terms
    machine, balance, penalties = weak_start(
        recordings, study.flux_map, study.seed, angle_orders=orders, terms=terms
    )
    repair = "Add a recording at another speed, or reverse the speed."
    if not FLUX_MAPS[study.flux_map].reciprocal:
        repair = f"Use the reciprocal map (--flux-map coenergy). Or: a{repair[1:]}"
    odd = tuple(f.sentence for e in recordings for f in inspect(e, ("i_d", "i_q", "u_d", "u_q")))
    facts = facts_of(recordings, study, reasons)
    anchor = anchor_of(recordings, balance)
    return Start(machine, balance.independence, anchor, repair, facts, odd, penalties)
