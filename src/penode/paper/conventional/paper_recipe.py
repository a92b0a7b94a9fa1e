"""The paper's training, as described there: Adam, contiguous windows, a horizon that grows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby

from penode.data.experiment import Experiment
from penode.data.windows import Contiguous
from penode.fit.fit import Fit
from penode.horizon.identifiability import Start
from penode.horizon.ladder import Observer, ignore_events
from penode.horizon.selection import Longest
from penode.identify import identify
from penode.pmsm.balance.start import nominal_start
from penode.training.first_order import FirstOrder, adam
from penode.training.plan import Plan, Stage

#: Horizon of an epoch, counted from 0.
Schedule = Callable[[int], int]


@dataclass(frozen=True)
class Growing:
    """A horizon that goes through shorter ones first."""

    horizon: int
    # Horizons on the way; those not below the last are left out.
    steps: tuple[int, ...] = (1, 2, 5, 10, 20, 50)
    # At each of them.
    epochs: int = 75

    @property
    def growth(self) -> int:
        """Number of epochs before the horizon is reached."""
        return self.epochs * sum(step < self.horizon for step in self.steps)

    def __call__(self, epoch: int) -> int:
        """Return the horizon of an epoch."""
        below = [step for step in self.steps if step < self.horizon]
        return below[epoch // self.epochs] if epoch < self.growth else self.horizon


@dataclass(frozen=True)
class PaperRecipe:
    """Adam with default values on contiguous windows (paper, section 4.3)."""

    # Horizon of each epoch.
    schedule: Schedule
    epochs: int
    # Of the network, of R(0) in 0 to 20 mohm and of the batches.
    seed: int = 0
    batches: int = 20
    # Learning rate of the network's weights, and of R in ohm.
    rate: float = 1e-3
    resistance_rate: float = 1e-4

    @classmethod
    def at(cls, horizon: int, seed: int = 0, epochs: int = 600) -> "PaperRecipe":
        """Return the recipe for one horizon: growth through shorter ones, then `epochs` more."""
        schedule = Growing(horizon)
        return cls(schedule, schedule.growth + epochs, seed)

    def plan(self) -> Plan:
        """Return a stage for each run of epochs with one horizon; Adam's moments start anew."""
        runs = groupby(map(self.schedule, range(self.epochs)))
        scale = self.resistance_rate / self.rate
        stages = tuple(
            Stage(
                horizon, FirstOrder(adam(self.rate), len(list(run)), self.batches, self.seed, scale)
            )
            for horizon, run in runs
        )
        return Plan(stages, Contiguous())

    def identify(
        self,
        experiments: Sequence[Experiment],
        validation: Sequence[Experiment] = (),
        observer: Observer = ignore_events,
    ) -> Fit:
        """Train on recordings and return the fit at the last horizon."""
        return identify(
            Start(nominal_start(experiments, self.seed)),
            experiments,
            plan=self.plan(),
            purpose=Longest(),
            validation=validation,
            observer=observer,
        )
