"""One-step current prediction with flux map and inverter term.

The current predictor of Wiedemann and Hackl 2023 (paper, section 4.2) in the engine's terms: the
model with a dead-time voltage, the forward Euler method, and a horizon of one step. It is a plan.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from penode.data.experiment import Experiment
from penode.data.windows import Contiguous
from penode.fit.fit import Fit
from penode.horizon.identifiability import Start
from penode.horizon.ladder import Observer, ignore_events
from penode.horizon.selection import Longest
from penode.identify import identify
from penode.pmsm.balance.start import weak_start
from penode.pmsm.machine.dead_time import DeadTime
from penode.pmsm.machine.holds import HOLDS
from penode.pmsm.recording.channels import drive_recording
from penode.pmsm.study_settings import Study
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import EULER
from penode.training.plan import Plan, Stage
from penode.training.second_order import LevenbergMarquardt


@dataclass(frozen=True)
class CurrentPredictor:
    """Least squares of the currents one forward Euler step ahead."""

    flux_map: str = "mlp"
    # Whether the dead-time voltage is identified too; the recordings then need theta_el.
    inverter: bool = True
    hold: str = "dq"
    seed: int = 0
    evaluations: int = 60

    @property
    def plan(self) -> Plan:
        """One stage of one Euler step."""
        stage = Stage(1, LevenbergMarquardt(self.evaluations))
        return Plan((stage,), Contiguous(), RungeKutta(EULER), HOLDS[self.hold])

    def identify(
        self,
        experiments: Sequence[Experiment],
        validation: Sequence[Experiment] = (),
        observer: Observer = ignore_events,
    ) -> Fit:
        """Return resistance, map and dead-time voltage; see `Method`."""
        terms = (DeadTime(),) if self.inverter else ()
        asked = Study(self.flux_map, horizon=1, terms=terms, hold=self.hold)
        runs = [drive_recording(e) for e in experiments]
        unseen = [drive_recording(e) for e in validation]
        asked.check([*runs, *unseen])
        start, *_ = weak_start(runs, self.flux_map, self.seed, terms=terms)
        return identify(
            Start(start),
            runs,
            plan=self.plan,
            purpose=Longest(),
            validation=unseen,
            observer=observer,
        )
