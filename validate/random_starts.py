"""A hundred random starts: ``python -m validate.random_starts [COUNT] [FIRST]``.

Each start is a machine, a recording and a network drawn at random and identified with default
settings. It has arrived if its loss at the horizon it selected is within 1 % of the best known
there: the least of two other networks and of its own result, each trained on for 100 evaluations.
As the loss goes on falling where nothing reported moves, the table also gives the distance of R
from the best fit's in deviations. Ctrl-C prints the count so far; the same command goes on.
"""

import sys
import time
from contextlib import suppress

import numpy as np

from penode.data.windows import Jittered
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.identify import identify
from penode.models.base import Model
from penode.pmsm.balance.start import weak_start
from penode.pmsm.study import Study
from penode.pmsm.study import identify as identify_machine
from penode.training.plan import Plan, Stage
from penode.training.second_order import LevenbergMarquardt
from validate.drawn_recordings import Drawn, draw_recording
from validate.ledger import Ledger, Record

COUNT = 100
ARRIVED = 1.01
#: Stops when nothing that is reported moves by a hundred-thousandth of its deviation.
_TO_THE_END = LevenbergMarquardt(evaluations=100, tolerance=1e-5)


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


def result_of(number: int) -> Record:
    """Identify one recording and judge the loss."""
    drawn, began = draw_recording(number), time.perf_counter()
    study = Study(seed=number, candidates=(), angle_orders=())
    try:
        fit = identify_machine([drawn.run], study=study)
    except InputError as error:
        return {"text": drawn.description, "failure": str(error)}
    took = time.perf_counter() - began
    rung = next(r for r in fit.horizon.ladder if r.horizon == fit.horizon.selected)
    best = best_known(drawn, fit, number)
    excess = max(rung.rmse**2 / loss_of(best) - 1, 0.0)
    found, truth = fit.parameters["R"], drawn.machine.resistance
    apart = abs(found.value - best.parameters["R"].value) / found.std
    text = (
        f"{drawn.description}: {rung.horizon:3d}  {fit.horizon.verdict:16s} "
        f"R {100 * (found.value / truth - 1):+6.2f} % {abs(found.value - truth) / found.std:4.1f} "
        f"| {100 * excess:6.2f} % {apart:4.1f} | {took:4.1f} s"
    )
    finite = bool(np.isfinite([found.value, found.std, rung.rmse]).all())
    return {"text": text, "failure": "", "excess": excess, "apart": apart, "finite": finite}


def print_table(draws: list[Record]) -> None:
    """Print how many arrived."""
    done = [draw for draw in draws if not draw["failure"]]
    excess = np.array([draw["excess"] for draw in done])
    agreeing = sum(draw["apart"] < 1 for draw in done)
    print(
        f"{np.sum(excess < ARRIVED - 1)} of {len(draws)} starts are within 1 % of the best known "
        f"loss, half within {100 * np.median(excess):.1f} %, all within {100 * excess.max():.1f} "
        f"%; {agreeing} are within one deviation of its R; "
        f"{sum(not draw['finite'] for draw in done)} are not finite; "
        f"{len(draws) - len(done)} were refused."
    )


def main() -> None:
    """Print a line a draw, then the count."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else COUNT
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    print("machine and recording: H, verdict, error of R and in deviations | loss over the best")
    print("known and R apart from that fit's in deviations | wall time")
    ledger, draws = Ledger("random_starts"), []
    with suppress(KeyboardInterrupt):
        for number in range(first, first + count):
            draws.append(ledger.of(number, result_of))
            text, failure = draws[-1]["text"], draws[-1]["failure"]
            print(f"{number:3d} {text}{failure and ': '}{failure}", flush=True)
    print_table(draws)


if __name__ == "__main__":
    main()
