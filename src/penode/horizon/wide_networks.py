"""Networks with more parameters than a normal matrix can have rows: all of them descend first.

Their hidden layers are what reverse mode and L-BFGS make of them at the first horizons. Then they
are held, and what is linear, the last layer, is climbed with all else as ever: its prior, its band
and the intervals of what is physical are those of a model that is linear in what it learns.
"""

from dataclasses import replace

from penode.arrays import float64
from penode.errors import InputError
from penode.horizon.identifiability import Start
from penode.horizon.ladder import LadderProblem
from penode.models.last_layer import last_layers
from penode.models.layout import Layout
from penode.training.gauss_newton_terms import MOST_PARAMETERS
from penode.training.plan import Plan
from penode.training.quasi_newton import quasi_newton

#: Stages of the plan at which everything descends: the first, and one that shows dynamics.
_STAGES = (0, 2)
#: Iterations at each.
_ITERATIONS = 60


def with_held_layers(start: Start, problem: LadderProblem, plan: Plan) -> Start:
    """Return a start whose model has no more parameters than a fit may have.

    Raises
    ------
    InputError
        If it has too many of them outside the hidden layers of networks.
    """
    layout = problem.objective.layout
    size, left = layout.size, Layout(last_layers(start.model), layout.experiments).size
    if size <= MOST_PARAMETERS:
        return start
    if left > MOST_PARAMETERS or left == size:
        raise InputError(
            f"parameters of a fit must be <= {MOST_PARAMETERS}, hidden layers of TanhLayers apart, "
            f"got {left}: their normal matrix would take {8e-9 * left**2:.2g} GB several times "
            "over; use a smaller network, or a spline over fewer cells."
        )
    raw = layout.raw(start.model)
    stages = [plan.stages[k] for k in _STAGES if k < len(plan.stages)]
    for number, stage in enumerate(stages):
        progress = problem.progress(stage.horizon, (number + 1, len(stages)))
        raw = quasi_newton(problem.problem(stage, plan), raw, _ITERATIONS, progress)
    note = (
        f"The model has {size} parameters: {size - left} of hidden layers were trained first, at "
        f"horizon {' and '.join(str(stage.horizon) for stage in stages)}, and held; intervals and "
        f"bands are those of the other {left}."
    )
    with float64():
        trained = layout.plain_model(raw)
    return replace(start, model=last_layers(trained), warnings=(*start.warnings, note))
