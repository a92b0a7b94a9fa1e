"""Whether voltages act a sample beside where they are recorded, by what training leaves over.

The controller's answer to the noise of its currents looks like a delay in the voltage balance and
in predictions of a few steps, and may hide whole samples there. Currents that are simulated for
longer are free of that noise.
"""

import math
from collections.abc import Iterator, Sequence
from functools import cache, partial
from itertools import count

import numpy as np

from penode.data.experiment import Experiment
from penode.fit.fit import Fit
from penode.fit.outcome import Objection
from penode.horizon.ladder import LadderProblem, ignore_events
from penode.horizon.objections import Check
from penode.pmsm.balance.calibration import Calibration
from penode.pmsm.balance.trial_balance import noise_of
from penode.pmsm.machine.space_vectors import CURRENTS
from penode.pmsm.recording.imperfection import UNKNOWN_DRIVE
from penode.pmsm.recording.imperfections import IMPERFECTIONS
from penode.training.plan import Plan, Stage

#: Loss of voltages so many samples beside over that of them as recorded below which they act there,
#: and root of it over the noise of the currents up to which nothing but timing was wrong.
_CLEARLY, _NOISE = 0.95, 1.5
#: Steps from which predictions hardly have the noise of their start.
_LONG = 10


def voltage_timing(plan: Plan, calibration: Calibration) -> tuple[Check, ...]:
    """Return a check of the timing where the voltage balance does not determine it, else none."""
    known = calibration.knows("delay") or calibration["delay"]
    return () if known else (_timing_check(plan),)


def _timing_check(plan: Plan) -> Check:
    def timing_of_the_voltages(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
        finished = {rung.horizon for rung in fit.horizon.ladder}
        stages = [stage for stage in plan.stages if stage.horizon in finished]
        least = max(fit.horizon.selected, _LONG)
        stage = next((stage for stage in stages if stage.horizon >= least), None)
        if stage is None:
            return
        error = cache(partial(_error, fit, experiments, plan, stage))
        side = min((1, -1), key=error)
        most = IMPERFECTIONS["delay"].credible[1]
        late = next(k for k in count(side, side) if abs(k) >= most or error(k + side) > error(k))
        noise = float(np.mean([noise_of(e.stack(CURRENTS)) for e in experiments]))
        if not (error(late) ** 2 < _CLEARLY * error(0) ** 2 and error(late) < _NOISE * noise):
            return
        samples = "a sample" if abs(late) == 1 else f"{abs(late)} samples"
        yield Objection(
            "one-sample delay" if abs(late) == 1 else f"delay of {abs(late)} samples",
            f"With voltages that act {samples} {'later' if late > 0 else 'earlier'} than recorded, "
            f"predictions over {stage.horizon} steps err by {error(late):.3g} A instead of "
            f"{error(0):.3g} A.",
            f"Give the columns of the voltages delay = {-late} in the study file.",
        )

    return timing_of_the_voltages


def _error(
    fit: Fit, experiments: Sequence[Experiment], plan: Plan, stage: Stage, late: int
) -> float:
    """Return the RMSE at its minimum, to first order, in A, of voltages that act so much later."""
    delay = IMPERFECTIONS["delay"]
    moved = [delay.corrected(e, float(late), UNKNOWN_DRIVE) for e in experiments]
    ladder = LadderProblem.of(fit.model, moved, plan, ignore_events)
    problem = ladder.problem(stage, plan)
    terms = problem.gauss_newton(ladder.objective.layout.raw(fit.model))
    least = terms.loss - float(terms.descent @ terms.inverse @ terms.descent) / terms.count
    return math.sqrt(max(least, 0.0))
