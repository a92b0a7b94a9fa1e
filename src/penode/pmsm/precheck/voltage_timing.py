"""Whether voltages act a sample beside where they are recorded, by what training leaves over.

The controller's answer to the noise of its currents looks like a delay in the voltage balance and
in predictions of a few steps, and may hide whole samples there. Currents that are simulated for
longer are free of that noise.
"""

from collections.abc import Iterator, Sequence

from penode.data.experiment import Experiment
from penode.fit.fit import Fit
from penode.fit.outcome import Objection
from penode.horizon.ladder import LadderProblem, ignore_events
from penode.horizon.objections import Check
from penode.pmsm.balance.calibration import Calibration
from penode.pmsm.recording.imperfection import UNKNOWN_DRIVE
from penode.pmsm.recording.imperfections import IMPERFECTIONS
from penode.training.plan import Plan, Stage

#: Loss of voltages a sample beside over that of them as recorded below which they act there.
_CLEARLY = 0.95
#: Steps from which predictions hardly have the noise of their start.
_LONG = 10


def voltage_timing(plan: Plan, calibration: Calibration) -> tuple[Check, ...]:
    """Return a check of the timing where the voltage balance does not determine it, else none."""
    known = calibration.deviation.get("delay", float("inf")) <= IMPERFECTIONS["delay"].near
    return () if known or calibration["delay"] else (_acts_where_recorded(plan),)


def _acts_where_recorded(plan: Plan) -> Check:
    def acts_where_recorded(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
        finished = {rung.horizon for rung in fit.horizon.ladder}
        stages = [stage for stage in plan.stages if stage.horizon in finished]
        least = max(fit.horizon.selected, _LONG)
        stage = next((stage for stage in stages if stage.horizon >= least), None)
        if stage is None:
            return
        losses = {late: _loss(fit, experiments, plan, stage, late) for late in (-1, 0, 1)}
        late = min(losses, key=lambda late: losses[late])
        if not losses[late] < _CLEARLY * losses[0]:
            return
        where = "later" if late > 0 else "earlier"
        yield Objection(
            "one-sample delay",
            f"With voltages that act a sample {where} than recorded, predictions over "
            f"{stage.horizon} steps err by {losses[late] ** 0.5:.3g} A instead of "
            f"{losses[0] ** 0.5:.3g} A.",
            f"Give the columns of the voltages delay = {-late} in the study file.",
        )

    return acts_where_recorded


def _loss(
    fit: Fit, experiments: Sequence[Experiment], plan: Plan, stage: Stage, late: int
) -> float:
    """Return the loss to first order at its minimum, in A^2, of voltages that act so much later."""
    delay = IMPERFECTIONS["delay"]
    moved = [delay.corrected(e, float(late), UNKNOWN_DRIVE) for e in experiments]
    ladder = LadderProblem.of(fit.model, moved, plan, ignore_events)
    problem = ladder.problem(stage, plan)
    terms = problem.gauss_newton(ladder.objective.layout.raw(fit.model))
    return float(terms.loss - terms.descent @ terms.inverse @ terms.descent / terms.count)
