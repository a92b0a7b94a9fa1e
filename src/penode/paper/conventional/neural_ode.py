"""Neural ODE of one or two steps: the network of Sevcik, Smidl and Glac 2025 at a fixed horizon.

They report that a horizon beyond H = 2 changes nothing on a well-designed experiment (paper,
section 5.3). Here it is a plan: the paper's network and start, the classic Runge-Kutta method, and
Levenberg-Marquardt at the one horizon.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from penode.data.experiment import Experiment
from penode.data.windows import Contiguous
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.horizon.identifiability import Start
from penode.horizon.ladder import Observer, ignore_events
from penode.horizon.selection import Longest
from penode.identify import identify
from penode.pmsm.balance.start import nominal_start
from penode.pmsm.machine.holds import HOLDS, check_hold
from penode.pmsm.recording.channels import drive_recording
from penode.training.plan import Plan, Stage
from penode.training.second_order import LevenbergMarquardt


@dataclass(frozen=True)
class NeuralODE:
    """A fully connected network 2-6-4-2 trained a fixed number of steps ahead."""

    horizon: int = 1
    hold: str = "dq"
    # Of the network and of R's start, uniform in 0 to 20 mohm.
    seed: int = 0
    evaluations: int = 100

    def __post_init__(self) -> None:
        if self.horizon < 1:
            raise InputError(f"horizon {self.horizon} came; give a whole number from 1.")
        check_hold(self.hold)

    @property
    def plan(self) -> Plan:
        """One stage at the horizon, on windows end to end."""
        stage = Stage(self.horizon, LevenbergMarquardt(self.evaluations))
        return Plan((stage,), Contiguous(), hold=HOLDS[self.hold])

    def identify(
        self,
        experiments: Sequence[Experiment],
        validation: Sequence[Experiment] = (),
        observer: Observer = ignore_events,
    ) -> Fit:
        """Return resistance and map; see `penode.paper.conventional.method.Method`."""
        runs = [drive_recording(e) for e in experiments]
        return identify(
            Start(nominal_start(runs, self.seed)),
            runs,
            plan=self.plan,
            purpose=Longest(),
            validation=[drive_recording(e) for e in validation],
            observer=observer,
        )
