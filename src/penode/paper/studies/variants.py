"""Variants of the paper's recipe, each a small step from it to our defaults."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from penode.data.experiment import Experiment
from penode.data.windows import Contiguous, Jittered
from penode.horizon.identifiability import Start
from penode.horizon.ladder import ladder_plan
from penode.paper.conventional.paper_recipe import Growing, PaperRecipe
from penode.paper.studies.extent import Extent
from penode.pmsm.balance.start import nominal_start, weak_start
from penode.pmsm.machine.dead_time import DeadTime
from penode.pmsm.machine.holds import HOLDS
from penode.predictors.base import DEFAULT_SOLVER
from penode.predictors.solver import Solver
from penode.training.plan import Plan, Stage
from penode.training.second_order import LevenbergMarquardt

#: Samples of one mini-batch of the paper's recipe, whatever the recording's length.
_BATCH = 1000
#: Of Levenberg-Marquardt at a horizon that is reached from the weak form at once.
_EVALUATIONS = 80


@dataclass(frozen=True)
class Variant:
    """How a machine is trained at given horizons; ``name`` is the folder, figures use ``label``.

    ``adam`` takes the paper's optimiser and start, a random network beside the name plate's linear
    map, instead of Levenberg-Marquardt from the weak form. ``climbing`` starts each horizon from
    where the one before ended: the loss of an unconstrained map has valleys that a climb does not
    come out of.
    """

    name: str
    label: str
    flux_map: str = "mlp"
    #: Whether windows start at random instead of end to end.
    jittered: bool = True
    #: Whether the dead-time voltage is identified too.
    inverter: bool = False
    #: Harmonics of the electrical angle in the map.
    angle_orders: tuple[int, ...] = ()
    adam: bool = False
    climbing: bool = True
    solver: Solver = DEFAULT_SOLVER

    def start(self, run: Experiment, seed: int) -> Start:
        """Return where training begins."""
        if self.adam:
            return Start(nominal_start([run], seed))
        terms = (DeadTime(),) if self.inverter else ()
        machine, _, penalties = weak_start(
            [run], self.flux_map, seed, angle_orders=self.angle_orders, terms=terms
        )
        return Start(machine, penalties=penalties)

    def plans(self, horizons: Sequence[int], run: Experiment, seed: int, extent: Extent) -> "Plans":
        """Return how each horizon is reached: the plan up to it, whose last stage is its own."""
        if self.adam:
            return {h: _paper_plan(h, run, seed, extent) for h in horizons}
        placement = Jittered(seed) if self.jittered else Contiguous()
        alone = Stage(1, LevenbergMarquardt(_EVALUATIONS))
        plan = Plan((alone,), placement, self.solver, HOLDS["dq"])
        if not self.climbing:
            return {h: replace(plan, stages=(replace(alone, horizon=h),)) for h in horizons}
        stages = ladder_plan(horizons).stages
        return {h: replace(plan, stages=stages[: k + 1]) for k, h in enumerate(horizons)}


#: Horizon to the plan that ends at it.
Plans = dict[int, Plan]


def _paper_plan(horizon: int, run: Experiment, seed: int, extent: Extent) -> Plan:
    """Return the paper's recipe with so many gradient steps, in batches of 1000 samples."""
    batches = max(round(len(run) / _BATCH), 2)
    growth = max(extent.growth_steps // batches, 1)
    schedule = Growing(horizon, extent.growth, growth)
    epochs = schedule.growth + max(extent.steps // batches, 1)
    return PaperRecipe(schedule, epochs, seed, batches).plan()


PAPER = Variant("paper", "paper recipe: Adam, windows end to end, any map", adam=True)
SECOND_ORDER = Variant(
    "second_order", "Levenberg-Marquardt instead of Adam", jittered=False, climbing=False
)
JITTERED = Variant("jittered", "+ jittered windows", climbing=False)
COENERGY = Variant("coenergy", "+ coenergy map", "coenergy")
INVERTER = Variant("inverter", "+ inverter term", "coenergy", inverter=True)
HARMONICS = Variant("harmonics", "+ angle harmonics", "coenergy", True, True, (6, 12))

#: From the paper's recipe to ours, each with what those before it have.
AXES = (PAPER, SECOND_ORDER, JITTERED, COENERGY, INVERTER, HARMONICS)
