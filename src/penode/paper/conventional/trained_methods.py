"""Methods that train a network by a plan of their own: the paper's recipe and two one-step ones."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from penode.data.experiment import Experiment
from penode.data.windows import Contiguous
from penode.fit.fit import Fit
from penode.horizon.identifiability import Start
from penode.horizon.ladder import Observer, ignore_events
from penode.horizon.selection import Longest
from penode.identify import identify
from penode.pmsm.balance.start import nominal_start, weak_start
from penode.pmsm.machine.dead_time import DeadTime
from penode.pmsm.machine.holds import HOLDS
from penode.pmsm.machine.model import Machine
from penode.pmsm.recording.channels import drive_recording
from penode.pmsm.study_settings import Study
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import EULER
from penode.training.first_order import FirstOrder, adam
from penode.training.plan import Plan, Stage
from penode.training.second_order import LevenbergMarquardt


class TrainedMethod(ABC):
    """A plan and a start; `seed` is that of the network and of what else is drawn."""

    seed: int

    @property
    @abstractmethod
    def plan(self) -> Plan:
        """What is trained."""

    def identify(
        self,
        experiments: Sequence[Experiment],
        validation: Sequence[Experiment] = (),
        observer: Observer = ignore_events,
    ) -> Fit:
        """Return the fit at the last horizon; recordings for validation are predicted only."""
        runs, unseen = ([drive_recording(e) for e in part] for part in (experiments, validation))
        return identify(
            Start(self.start(runs, unseen)),
            runs,
            plan=self.plan,
            purpose=Longest(),
            validation=unseen,
            observer=observer,
        )

    def start(self, runs: Sequence[Experiment], unseen: Sequence[Experiment]) -> Machine:
        """Return the paper's network and a resistance within 0 to 20 mohm."""
        return nominal_start(runs, self.seed)


@dataclass(frozen=True)
class PaperRecipe(TrainedMethod):
    """The paper's training: Adam with default values on contiguous windows (section 4.3)."""

    horizon: int
    # At the horizon itself.
    epochs: int = 600
    seed: int = 0
    batches: int = 20
    # Horizons on the way, of which those not below the last are left out, and epochs at each.
    growth: tuple[int, ...] = (1, 2, 5, 10, 20, 50)
    growth_epochs: int = 75
    # Learning rate of the network's weights, and of R in ohm.
    rate: float = 1e-3
    resistance_rate: float = 1e-4

    @property
    def plan(self) -> Plan:
        """A stage for each horizon; Adam's moments start anew."""
        below = [(step, self.growth_epochs) for step in self.growth if step < self.horizon]
        scale = self.resistance_rate / self.rate
        stages = (
            Stage(horizon, FirstOrder(adam(self.rate), epochs, self.batches, self.seed, scale))
            for horizon, epochs in (*below, (self.horizon, self.epochs))
        )
        return Plan(tuple(stages), Contiguous())


@dataclass(frozen=True)
class NeuralODE(TrainedMethod):
    """Neural ODE of one or two steps: the network 2-6-4-2 of Sevcik, Smidl and Glac 2025.

    They report that a horizon beyond H = 2 changes nothing on a well-designed experiment (paper,
    section 5.3). Here the classic Runge-Kutta method and Levenberg-Marquardt train it.
    """

    horizon: int = 1
    seed: int = 0
    evaluations: int = 100

    @property
    def plan(self) -> Plan:
        """One stage at the horizon, on windows end to end."""
        stage = Stage(self.horizon, LevenbergMarquardt(self.evaluations))
        return Plan((stage,), Contiguous(), hold=HOLDS["dq"])


@dataclass(frozen=True)
class CurrentPredictor(TrainedMethod):
    """Least squares of the currents one forward Euler step ahead, with a dead-time voltage.

    The current predictor of Wiedemann and Hackl 2023 (paper, section 4.2) in the engine's terms.
    """

    seed: int = 0
    evaluations: int = 60

    @property
    def plan(self) -> Plan:
        """One stage of one Euler step."""
        stage = Stage(1, LevenbergMarquardt(self.evaluations))
        return Plan((stage,), Contiguous(), RungeKutta(EULER), HOLDS["dq"])

    def start(self, runs: Sequence[Experiment], unseen: Sequence[Experiment]) -> Machine:
        """Return the weak form's machine; refuse recordings without the channels it needs."""
        terms = (DeadTime(),)
        Study("mlp", horizon=1, terms=terms, hold="dq").check([*runs, *unseen])
        return weak_start(runs, "mlp", self.seed, terms=terms)[0]
