"""A hundred random starts: ``python -m validate.random_starts [COUNT] [FIRST]``.

Each start is a machine and a recording drawn at random and identified with default settings. It has
arrived if its loss at the horizon it selected is within 0.1 % of the best known there: the least of
its own result and of two maps whose coefficients are disturbed at random, each trained on for 100
evaluations.
As the loss goes on falling where nothing reported moves, the table also gives the distance of R
from the best fit's in deviations. Ctrl-C prints the count so far; the same command goes on.
"""

import time
from dataclasses import replace

import jax
import numpy as np

from penode.arrays import FloatArray
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.horizon.identifiability import Start
from penode.identify import identify
from penode.models.base import Model
from penode.pmsm.balance.start import weak_start
from penode.pmsm.machine.model import Machine
from penode.pmsm.study import identify as identify_machine
from penode.pmsm.study_settings import Study
from penode.training.plan import Stage
from penode.training.second_order import LevenbergMarquardt
from validate.drawn_recordings import Drawn, draw_recording
from validate.ledger import Record, run_draws

COUNT = 100
ARRIVED = 1.001
#: Deviation of the factors that disturb the coefficients of the start.
_DISTURBED = 0.2
#: Stops when nothing that is reported moves by a hundred-thousandth of its deviation.
_TO_THE_END = LevenbergMarquardt(evaluations=100, tolerance=1e-5)


def loss_of(fit: Fit) -> float:
    """Return the loss at the longest horizon of a ladder."""
    return fit.horizon.ladder[-1].rmse ** 2


def best_known(drawn: Drawn, fit: Fit, study: Study) -> Fit:
    """Return the fit of least loss at the selected horizon: the same loss, the same windows."""
    horizon = fit.horizon.selected
    stages = (Stage(horizon, _TO_THE_END),)
    warm = stages if horizon == 1 else (Stage(1, LevenbergMarquardt(evaluations=60)), *stages)
    start = weak_start([drawn.run], "coenergy")
    others: list[tuple[Model, tuple[Stage, ...]]] = [(fit.model, stages)]
    others += [(disturbed(start.machine, study.seed + k), warm) for k in (1000, 2000)]
    plan = study.plan([drawn.run])
    fits = [
        identify(
            Start(model, penalties=start.penalties), [drawn.run], plan=replace(plan, stages=chosen)
        )
        for model, chosen in others
    ]
    return min(fits, key=loss_of)


def disturbed(machine: Machine, seed: int) -> Machine:
    """Return a machine whose map's coefficients are multiplied by random factors around 1."""
    random = np.random.default_rng(seed)

    def changed(leaf: FloatArray) -> FloatArray:
        return np.asarray(leaf * (1 + _DISTURBED * random.normal(size=np.shape(leaf))))

    network = jax.tree.map(changed, machine.flux.network)
    return replace(machine, flux=replace(machine.flux, network=network))


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
    best = best_known(drawn, fit, study)
    excess = rung.rmse**2 / loss_of(best) - 1
    found, truth = fit.parameters["R"], drawn.machine.resistance
    apart = abs(found.value - best.parameters["R"].value) / found.std
    text = (
        f"{drawn.description}: {rung.horizon:3d}  {fit.horizon.verdict:16s} "
        f"R {100 * (found.value / truth - 1):+6.2f} % {abs(found.value - truth) / found.std:4.1f} "
        f"| {100 * excess:+7.3f} % {apart:4.1f} | {took:4.1f} s"
    )
    finite = bool(np.isfinite([found.value, found.std, rung.rmse]).all())
    return {"text": text, "failure": "", "excess": excess, "apart": apart, "finite": finite}


def print_table(draws: list[Record]) -> None:
    """Print how many arrived."""
    done = [draw for draw in draws if not draw["failure"]]
    # A best known loss far above the start's own would be another loss: it has not arrived either.
    excess = np.abs([draw["excess"] for draw in done])
    agreeing = sum(draw["apart"] < 1 for draw in done)
    print(
        f"{np.sum(excess < ARRIVED - 1)} of {len(draws)} starts are within 0.1 % of the best known "
        f"loss, half within {100 * np.median(excess):.3f} %, all within {100 * excess.max():.3f} "
        f"%; {agreeing} are within one deviation of its R; "
        f"{sum(not draw['finite'] for draw in done)} are not finite; "
        f"{len(draws) - len(done)} were refused."
    )


def line_of(draw: Record) -> str:
    """Return one line of the list."""
    return f"{draw['draw']:3d} {draw['text']}{draw['failure'] and ': '}{draw['failure']}"


if __name__ == "__main__":
    print("machine and recording: H, verdict, error of R and in deviations | loss over the best")
    print("known and R apart from that fit's in deviations | wall time")
    run_draws("random_starts", COUNT, result_of, line_of, print_table)
