"""How much of every study is computed: all of it, or a small part of each by the same code."""

from dataclasses import dataclass

from penode.pmsm.study_settings import Study


@dataclass(frozen=True)
class Extent:
    """Size of the studies; horizons in steps, ascending, few where they are not the question.

    Training grows through ``growth`` with ``growth_steps`` gradient steps of the paper's recipe
    each, then takes ``steps`` at the horizon. ``share`` is the training duration over the paper's,
    ``unseen_duration`` is in s; ``recordings`` are those of the table of methods.
    """

    name: str
    horizons: tuple[int, ...]
    few_horizons: tuple[int, ...]
    seeds: tuple[int, ...]
    growth: tuple[int, ...]
    growth_steps: int
    steps: int
    share: float
    unseen: int
    unseen_duration: float
    recordings: tuple[str, ...]
    #: Steps from the paper's recipe to ours that are taken.
    variants: tuple[str, ...]
    ours: Study

    @property
    def judges(self) -> bool:
        """Whether results of this size say anything: those of the quick extent do not."""
        return self.name != "quick"

    @property
    def longest(self) -> int:
        """The longest horizon."""
        return self.horizons[-1]


FULL = Extent(
    name="full",
    horizons=(1, 2, 5, 10, 15, 20, 30, 50, 75, 100),
    few_horizons=(1, 10, 100),
    seeds=(0, 1, 2),
    growth=(1, 2, 5, 10, 20, 50),
    growth_steps=1500,
    steps=12000,
    share=1.0,
    unseen=8,
    unseen_duration=0.25,
    recordings=(
        "simulation",
        "testbench",
        "well_designed",
        "well_designed_testbench",
        "motor_operation",
        "operating_points",
    ),
    variants=("paper", "second_order", "jittered", "coenergy", "inverter", "harmonics"),
    ours=Study(),
)

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
