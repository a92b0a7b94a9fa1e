"""Results of linear least squares as a `Fit`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.fit.fit import Estimate, Fit, HorizonChoice, HorizonSummary
from penode.fit.provenance import provenance_of
from penode.horizon.loss_weighting import linearised
from penode.models.base import LearnedMap
from penode.pmsm.machine.flux_maps import FluxMap
from penode.pmsm.machine.holds import HOLDS
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.terms import Resistance, Term
from penode.pmsm.recording.channels import drive_recording
from penode.predictors.base import Predictor
from penode.training.weak_form import WeakRegression
from penode.validation.coverage import thin
from penode.validation.free_run import compare
from penode.validation.residual_tests import residual_correlations, residual_spectrum

_SOLVED = "Linear least squares: solved in one step."


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Resistance and map as linear least squares gives them."""

    # Its name in the provenance.
    method: str
    # Currents over `current_scale`, A, to flux linkages, Vs.
    network: LearnedMap
    current_scale: float
    # R and its standard deviation, ohm.
    resistance: float
    deviation: float
    # Share of the resistance's regressor that no regressor of the map explains.
    identifiability: float | None
    # Why there is no horizon to choose, as a sentence.
    reason: str
    # A key of `HOLDS`.
    hold: str = "dq"
    facts: Mapping[str, Any] = field(default_factory=dict)
    # Of the voltage equation beside resistance and rotation, and their physical parameters.
    terms: tuple[Term, ...] = ()
    beside: Mapping[str, Estimate] = field(default_factory=dict)

    def to_fit(self, experiments: Sequence[Experiment], validation: Sequence[Experiment]) -> Fit:
        """Return the fit, every recording predicted by the classic Runge-Kutta method."""
        flux_map = FluxMap(self.network, self.current_scale, 1.0)
        model = Machine(flux_map, (Resistance(self.resistance), *self.terms))
        estimate = Estimate.of(
            self.resistance, self.deviation, "ohm", self.identifiability, "stator resistance"
        )
        parameters = {"R": estimate, **self.beside}
        predictor = Predictor(experiments[0].time_step, hold=HOLDS[self.hold])
        seen = [compare(predictor, model, e, "train") for e in experiments]
        unseen = [compare(predictor, model, e) for e in validation]
        squares = [c.one_step_rmse**2 for c in seen]
        free = float(np.sqrt(np.mean([c.free_run_rmse**2 for c in seen])))
        rung = HorizonSummary(
            horizon=1,
            parameters={name: one.value for name, one in parameters.items()},
            std={name: one.std for name, one in parameters.items()},
            rmse=float(np.sqrt(np.mean(squares))),
            free_run_rmse=free if np.isfinite(free) else None,
            iterations=1,
            outcome=_SOLVED,
        )
        return Fit(
            model=model,
            parameters=parameters,
            horizon=HorizonChoice(1, "fixed", self.reason, (rung,), (1,)),
            excited=thin(np.concatenate([e.stack(Machine.states) for e in experiments])),
            comparisons=(*seen, *unseen),
            spectrum=residual_spectrum(seen[0]),
            correlations=residual_correlations(seen[0], experiments[0], model.inputs),
            transitions=linearised(predictor, model, experiments[0], np.ones(2)),
            warnings=tuple(
                f"{c.name}: the free run diverges; the map is unusable for simulation there."
                for c in (*seen, *unseen)
                if c.diverged
            ),
            provenance=self._provenance((*experiments, *validation)),
        )

    def _provenance(self, recordings: Sequence[Experiment]) -> dict[str, Any]:
        speed = float(np.median(np.abs(recordings[0].channels["omega_el"])))
        return {
            "method": self.method,
            **provenance_of(recordings),
            "hold": self.hold,
            "electrical_frequency_hz": speed / (2 * np.pi),
            **self.facts,
        }


def usable(experiments: Sequence[Experiment]) -> list[Experiment]:
    """Return recordings with the channels of a drive checked."""
    if not experiments:
        raise InputError("no recording came; give at least one.")
    return [drive_recording(e) for e in experiments]


def solution_of(equations: WeakRegression, name: str, smaller: str) -> FloatArray:
    """Return the least-squares solution of equations; fewer than unknowns are refused.

    `name` is that of the first recording, `smaller` what would have fewer unknowns.
    """
    rows, unknowns = equations.matrix.shape
    if rows < unknowns:
        raise InputError(
            f"{name}: {rows} equations came for {unknowns} unknowns; record for longer, or use "
            f"{smaller}."
        )
    return equations.solve()


def largest_current(experiments: Sequence[Experiment]) -> float:
    """Return the largest |i_d| or |i_q| in A."""
    return max(float(np.abs(e.stack(Machine.states)).max()) for e in experiments)
