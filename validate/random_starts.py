"""A hundred random starts: ``python -m validate.random_starts [COUNT]``.

Each start is a machine, a recording and a network drawn at random and identified with default
settings. It has arrived if its loss at the horizon it selected is within 1 % of the best known
there: the least of two other networks and of its own result, each trained on for 100 evaluations.
As the loss goes on falling where nothing reported moves, the table also gives the distance of R
from the best fit's in deviations.
"""

import sys
import time
from dataclasses import dataclass

import numpy as np

from penode.data.windows import Jittered
from penode.errors import InputError
from penode.identify import identify
from penode.models.base import Model
from penode.pmsm.start import weak_start
from penode.pmsm.study import Study
from penode.pmsm.study import identify as identify_machine
from penode.training.fit import Fit
from penode.training.plan import Plan, Stage
from penode.training.second_order import LevenbergMarquardt
from validate.drawn_recordings import Drawn, draw_recording

COUNT = 100
ARRIVED = 1.01
#: Stops when nothing that is reported moves by a hundred-thousandth of its deviation.
_TO_THE_END = LevenbergMarquardt(evaluations=100, tolerance=1e-5)


@dataclass(frozen=True)
class Outcome:
    """What became of one start.

    Attributes
    ----------
    excess : float
        Loss over the best known, less 1.
    apart : float
        Difference of R to the best fit's, in deviations.
    text : str
        For the table.
    failure : str
        Why there is no result; empty where there is one.
    """

    excess: float
    apart: float
    text: str
    failure: str = ""


def loss_of(fit: Fit) -> float:
    """Return the loss at the longest horizon of a ladder."""
    return fit.horizon.ladder[-1].rmse ** 2


def best_known(drawn: Drawn, fit: Fit, seed: int) -> Fit:
    """Return the fit of least loss at the selected horizon, on the same windows."""
    horizon = fit.horizon.selected
    stages = (Stage(horizon, _TO_THE_END),)
    warm = stages if horizon == 1 else (Stage(1, LevenbergMarquardt(evaluations=60)), *stages)
    others: list[tuple[Model, tuple[Stage, ...]]] = [(fit.model, stages)]
    others += [(weak_start([drawn.run], "coenergy", seed + k)[0], warm) for k in (1000, 2000)]
    fits = [identify(m, [drawn.run], plan=Plan(chosen, Jittered(seed))) for m, chosen in others]
    return min(fits, key=loss_of)


def outcome_of(drawn: Drawn, seed: int) -> Outcome:
    """Identify one recording and judge the loss."""
    began = time.perf_counter()
    try:
        fit = identify_machine([drawn.run], study=Study(seed=seed, inverter=False, angle_orders=()))
    except InputError as error:
        return Outcome(np.inf, np.inf, "", str(error))
    took = time.perf_counter() - began
    rung = next(r for r in fit.horizon.ladder if r.horizon == fit.horizon.selected)
    best = best_known(drawn, fit, seed)
    excess = max(rung.rmse**2 / loss_of(best) - 1, 0.0)
    found, truth = fit.parameters["R"], drawn.machine.resistance
    apart = abs(found.value - best.parameters["R"].value) / found.std
    text = (
        f"{rung.horizon:3d}  {fit.horizon.verdict:16s} R {100 * (found.value / truth - 1):+6.2f} % "
        f"{abs(found.value - truth) / found.std:4.1f} | {100 * excess:6.2f} % {apart:4.1f} | "
        f"{took:4.1f} s"
    )
    return Outcome(excess, apart, text)


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else COUNT
    outcomes = []
    print("machine and recording: H, verdict, error of R and in deviations | loss over the best")
    print("known and R apart from that fit's in deviations | wall time")
    for seed in range(count):
        drawn = draw_recording(seed)
        outcome = outcome_of(drawn, seed)
        outcomes.append(outcome)
        print(f"{seed:3d} {drawn.description}: {outcome.text or outcome.failure}", flush=True)
    arrived = sum(outcome.excess < ARRIVED - 1 for outcome in outcomes)
    named = sum(bool(outcome.failure) for outcome in outcomes)
    agreeing = sum(outcome.apart < 1 for outcome in outcomes)
    print(
        f"{arrived} of {count} starts are within 1 % of the best known loss, {agreeing} within one "
        f"deviation of its R; {named} were refused."
    )


if __name__ == "__main__":
    main()
