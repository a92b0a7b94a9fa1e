"""What is trained: the steps from the paper's recipe to ours, and how much of every study."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from penode.data.experiment import Experiment
from penode.data.windows import Contiguous, Jittered
from penode.horizon.identifiability import Start
from penode.horizon.ladder import ladder_plan
from penode.paper.conventional.trained_methods import PaperRecipe
from penode.pmsm.balance.start import nominal_start, weak_start
from penode.pmsm.machine.dead_time import DeadTime
from penode.pmsm.machine.holds import HOLDS
from penode.pmsm.study_settings import Study
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

    def plans(
        self, horizons: Sequence[int], run: Experiment, seed: int, extent: "Extent"
    ) -> dict[int, Plan]:
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


def _paper_plan(horizon: int, run: Experiment, seed: int, extent: "Extent") -> Plan:
    """Return the paper's recipe with so many gradient steps, in batches of 1000 samples."""
    batches = max(round(len(run) / _BATCH), 2)
    epochs, growing = (max(steps // batches, 1) for steps in (extent.steps, extent.growth_steps))
    return PaperRecipe(horizon, epochs, seed, batches, extent.growth, growing).plan


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


@dataclass(frozen=True)
class Extent:
    """Size of the studies: by default all of them, as the paper has it.

    Horizons are in steps, ascending, few where they are not the question. Training grows through
    ``growth`` with ``growth_steps`` gradient steps of the paper's recipe each, then takes ``steps``
    at the horizon. ``share`` is the training duration over the paper's, ``unseen_duration`` is in
    s; ``recordings`` are those of the table of methods.
    """

    name: str = "full"
    horizons: tuple[int, ...] = (1, 2, 5, 10, 15, 20, 30, 50, 75, 100)
    few_horizons: tuple[int, ...] = (1, 10, 100)
    seeds: tuple[int, ...] = (0, 1, 2)
    growth: tuple[int, ...] = (1, 2, 5, 10, 20, 50)
    growth_steps: int = 1500
    steps: int = 12000
    share: float = 1.0
    unseen: int = 8
    unseen_duration: float = 0.25
    recordings: tuple[str, ...] = (
        "simulation",
        "testbench",
        "well_designed",
        "well_designed_testbench",
        "motor_operation",
        "operating_points",
    )
    #: Steps from the paper's recipe to ours that are taken.
    variants: tuple[str, ...] = tuple(variant.name for variant in AXES)
    ours: Study = field(default_factory=Study)

    @property
    def judges(self) -> bool:
        """Whether results of this size say anything: those of the quick extent do not."""
        return self.name != "quick"

    @property
    def longest(self) -> int:
        """The longest horizon."""
        return self.horizons[-1]


FULL = Extent()

#: The same code, small. What takes time is not training but compiling: a program a structure of
#: the model, a recording and a length. So there are few structures, and lengths are alike.
QUICK = Extent(
    name="quick",
    horizons=(1, 20),
    few_horizons=(1,),
    seeds=(0,),
    growth=(1,),
    growth_steps=20,
    steps=40,
    share=0.1,
    unseen=2,
    unseen_duration=0.2,
    recordings=("operating_points",),
    variants=("paper", "inverter"),
    ours=Study(candidates=(), angle_orders=()),
)
