"""Sweep: many starts trained at many horizons, the starts of a horizon side by side."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.horizon.ladder import LadderProblem
from penode.models.base import Model
from penode.training.first_order import FirstOrder
from penode.training.plan import DIVERGED, Plan


@dataclass(frozen=True, eq=False)
class Sweep:
    """Where starts ended, plan by plan.

    Attributes
    ----------
    names : tuple of str
        Physical parameters.
    values : ndarray, shape (plan, start, physical)
        SI units.
    loss : ndarray, shape (plan, start)
        At each plan's last horizon; nan where a start diverged.
    """

    names: tuple[str, ...]
    values: FloatArray
    loss: FloatArray


def sweep(
    starts: Sequence[Model], experiments: Sequence[Experiment], plans: Sequence[Plan]
) -> Sweep:
    """Train every start by every plan; the starts of a plan go in one program.

    On a processor with few cores this costs what training them one by one costs. An accelerator,
    which a single start leaves idle, takes hardly longer for all of them than for one.

    Parameters
    ----------
    starts : sequence of Model
        Of one structure.
    experiments : sequence of Experiment
        Of one time step.
    plans : sequence of Plan
        Of one solver, hold and loss; all their stages use `FirstOrder`.

    Raises
    ------
    InputError
        If a channel is missing, a state never moves, plans differ in more than their stages and
        placements, or a stage has another optimiser.
    """
    kinds = [(plan.solver, plan.hold, plan.loss) for plan in plans]
    if any(kind != kinds[0] for kind in kinds):
        raise InputError(
            "plans must share solver, hold and loss, got several; sweep each on its own."
        )
    problem = LadderProblem.of(starts[0], experiments, plans[0], lambda event: None)
    ends = [_ends(starts, problem, plan) for plan in plans]
    names = problem.objective.layout.physical
    return Sweep(names, np.stack([values for values, _ in ends]), np.stack([e for _, e in ends]))


def _ends(
    starts: Sequence[Model], problem: LadderProblem, plan: Plan
) -> tuple[FloatArray, FloatArray]:
    """Return the physical parameters (start, physical) and the losses (start,) after a plan."""
    layout = problem.objective.layout
    raws = np.stack([layout.raw(start) for start in starts])
    for stage in plan.stages:
        if not isinstance(stage.optimiser, FirstOrder):
            raise InputError(f"the optimiser of a sweep must be FirstOrder, got {stage.optimiser}.")
        stage_problem = problem.problem(stage, plan)
        solutions = stage.optimiser.minimise_together(stage_problem, raws)
        raws = np.stack([solution.raw for solution in solutions])
    values = np.stack([problem.reported.values(raw)[: len(layout.physical)] for raw in raws])
    ended = [np.nan if s.outcome == DIVERGED else s.terms.loss for s in solutions]
    return values, np.array(ended)
