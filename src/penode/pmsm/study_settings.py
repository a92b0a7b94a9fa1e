"""What a user may ask for: settings of an identification, and what they mean for recordings."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from penode.data.experiment import Experiment
from penode.data.stretches import STRETCH, Excerpt, by_recording, excerpt
from penode.data.windows import Jittered
from penode.errors import InputError, did_you_mean
from penode.horizon.held_out import selector_for
from penode.horizon.ladder import HORIZONS, fitting_plan, ladder_plan
from penode.horizon.selection import Longest, Plateau, Selector
from penode.pmsm.balance.doubt import Doubt
from penode.pmsm.balance.term_selection import CANDIDATES, is_open, structure_of
from penode.pmsm.control.controlled_machine import LINK_VOLTAGE, recorded_link_voltage
from penode.pmsm.machine.dead_time import DeadTime
from penode.pmsm.machine.flux_maps import FLUX_MAPS, check_angle_orders
from penode.pmsm.machine.holds import DEFAULT_HOLD, HOLDS, check_hold
from penode.pmsm.machine.space_vectors import CURRENTS
from penode.pmsm.machine.standstill import SCOPE, STANDSTILL, stands_still
from penode.pmsm.machine.temperatures import RECORDED, recorded_temperatures
from penode.pmsm.machine.term_registry import completed, term_name
from penode.pmsm.machine.terms import SPEED, Term
from penode.pmsm.recording.channels import electrical, require_channels
from penode.pmsm.recording.imperfections import DEFAULT_ACCURACY, Accuracy
from penode.pmsm.recording.name_plate import NO_PLATE, NamePlate
from penode.training.plan import Plan
from penode.training.second_order import LevenbergMarquardt

#: Samples between windows of short horizons where recordings hold far more than is used.
_APART = 5
#: A window's first sample is measured like all others: its error counts as one of theirs, and is
#: estimated, instead of being carried to the window's end. In A, as residuals are.
_STARTS = dict.fromkeys(CURRENTS, 1.0)
#: First damping for a map that is linear in its coefficients: one step reaches the minimum.
_NEARLY_LINEAR = 1e-6
#: Tests at standstill last for tenths of a second, and currents wander through the map once or
#: twice: windows that a recording is to have, which overlap for that, and the longest as a share.
_OVERLAPPING, _SHARE = 40, 0.4


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
    samples : int
        Most samples that are used; of more, stretches are (`penode.data.stretches`).
    accuracy : Accuracy
        Of the recording chain, for the uncertainty budget; an ordinary bench's by default.
    name_plate : NamePlate
        What the data sheet says; against it peak and rms values are distinguished.
    train_anyway : bool
        Train though a convention of the channels is broken; the verdict then names it.
    of_shaft : tuple of str
        Channels that were recorded of the shaft, and made electrical by the pole pairs: what is
        advised where pole pairs are wrong depends on it.

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
    samples: int = 10 * STRETCH
    purpose: str = "parameters"
    accuracy: Accuracy = DEFAULT_ACCURACY
    name_plate: NamePlate = NO_PLATE
    train_anyway: bool = False
    of_shaft: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.flux_map not in FLUX_MAPS:
            raise InputError(
                f"flux_map must be one of {', '.join(FLUX_MAPS)}, got {self.flux_map!r}"
                f"{did_you_mean(self.flux_map, FLUX_MAPS)}."
            )
        if self.horizon is not None and self.horizon < 1:
            raise InputError(f"horizon must be >= 1, or auto, got {self.horizon}.")
        if self.samples < 1:
            raise InputError(f"samples must be >= 1, got {self.samples}.")
        selector_for(self.purpose, ())
        check_hold(self.hold or DEFAULT_HOLD)
        completed(self.terms)
        check_angle_orders(self.flux_map, self.angle_orders or ())

    def plan(self, experiments: Sequence[Experiment], partly: bool = False) -> Plan:
        """Return the ladder: up to the horizon asked for, or as far as the recordings reach.

        Of recordings that are used partly short horizons leave samples between their windows.
        """
        # A map with angle orders is larger and starts closer: fewer rungs, none of them cold.
        horizons = (1, *HORIZONS[2::3]) if self.angle_orders else HORIZONS[::2]
        optimiser = LevenbergMarquardt(evaluations=25) if self.angle_orders else None
        if self.flux_map == "coenergy":
            optimiser = LevenbergMarquardt(evaluations=25, damping=_NEARLY_LINEAR)
        if self.horizon is None:
            plan = _reaching(ladder_plan(horizons, optimiser, self.seed), experiments)
        else:
            below = [h for h in HORIZONS if h < self.horizon]
            plan = ladder_plan([*below[::3], self.horizon], optimiser, self.seed)
        fewest = _OVERLAPPING if stands_still(experiments) else 1
        placement = Jittered(self.seed, shortest=_APART if partly else 1, fewest=fewest)
        loss = replace(plan.loss, free_starts=_STARTS)
        return replace(plan, hold=HOLDS[self.hold or DEFAULT_HOLD], placement=placement, loss=loss)

    def excerpt(self, experiments: Sequence[Experiment]) -> Excerpt:
        """Return what is used of recordings."""
        return excerpt(experiments, electrical(experiments), self.samples, seed=self.seed)

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

    @property
    def conventions(self) -> dict[str, Any]:
        """What `penode.pmsm.conventions.check.judge` is to know."""
        of = {"terms": self.terms, "hold": self.hold, "pole_pairs": self.pole_pairs}
        return {**of, "plate": self.name_plate, "of_shaft": self.of_shaft}

    def facts(self, recordings: Sequence[Experiment], reasons: Sequence[str]) -> dict[str, Any]:
        """Return what provenance says of a model with nothing left open, and in sentences why."""
        speed = float(np.median(np.abs(recordings[0].channels[SPEED.name])))
        still = stands_still(recordings)
        facts = {
            "flux_map": self.flux_map,
            "inverter": any(term.role == DeadTime.role for term in self.terms),
            "terms": [term_name(term) for term in completed(self.terms)],
            "angle_orders": list(self.angle_orders or ()),
            "structure": [SCOPE, *reasons] if still else list(reasons),
            STANDSTILL: still or None,
            "hold": self.hold,
            "purpose": self.purpose,
            "seed": self.seed,
            "pole_pairs": self.pole_pairs,
            "electrical_frequency_hz": speed / (2 * np.pi),
            RECORDED: recorded_temperatures(recordings),
            LINK_VOLTAGE: recorded_link_voltage(recordings),
        }
        return {name: fact for name, fact in facts.items() if fact is not None}

    def selector(self, experiments: Sequence[Experiment]) -> Selector:
        """Return the rule that picks the horizon, given what it may predict."""
        if self.horizon is not None:
            return Longest()
        if self.purpose == "parameters":  # a map is better as the mean over the horizons
            return Plateau(averaged=True)
        return selector_for(self.purpose, experiments)


def _reaching(plan: Plan, experiments: Sequence[Experiment]) -> Plan:
    """Return a plan with those horizons that recordings are long enough for."""
    if not stands_still(experiments):
        return fitting_plan(plan, experiments)
    samples = min(max(map(len, stretches)) for stretches in by_recording(experiments))
    longest = max(_SHARE * samples, 1)
    return replace(plan, stages=tuple(s for s in plan.stages if s.horizon <= longest))


DEFAULT_STUDY = Study()
