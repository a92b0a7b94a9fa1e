"""How far a model is made for the solver it was trained with."""

from dataclasses import dataclass, replace

import numpy as np

from penode.data.experiment import Experiment
from penode.fit.fit import Fit
from penode.paper.studies.panels import Claim, Matrix, StudyResult
from penode.paper.studies.runs import Place, Run, Runs
from penode.paper.studies.summaries import milliohm, rows
from penode.paper.studies.variants import COENERGY, Variant
from penode.predictors.base import Predictor
from penode.predictors.multistep import AdamsBashforth
from penode.predictors.one_step import RungeKutta
from penode.predictors.solver import Solver
from penode.predictors.tableaus import AB3, EULER, MIDPOINT, RK4
from penode.validation.free_run import compare

SOLVERS: dict[str, Solver] = {
    "Euler": RungeKutta(EULER),
    "midpoint": RungeKutta(MIDPOINT),
    "Runge-Kutta 4": RungeKutta(RK4),
    "Adams-Bashforth 3": AdamsBashforth(AB3),
}
#: Steps; one period of the sixth order at 1500 rpm is 13.
_HORIZON = 20


@dataclass(frozen=True)
class _Crossed:
    """A model trained with one solver and run with another."""

    trained: str
    run_with: str
    one_step: float
    free_run: float


def solver_dependence(runs: Runs) -> StudyResult:
    """Return one-step and free-run errors of every solver run with every other."""
    horizon = min(_HORIZON, runs.extent.longest)
    trained = {name: _trained(runs, name, horizon) for name in SOLVERS}
    unseen = runs.case("simulation").validation
    crossed = []
    for name, run in trained.items():
        fit = runs.fit(Place(run.recording, run.method, run.seed, run.horizon))
        crossed += [_cross(fit, name, other, unseen) for other in SOLVERS]
    table = [
        {
            "trained_with": one.trained,
            "run_with": one.run_with,
            "R_mohm": milliohm(trained[one.trained].result),
            "one_step_rmse_A": one.one_step,
            "free_run_rmse_A": one.free_run,
        }
        for one in crossed
    ]
    errors = np.reshape([one.one_step for one in crossed], (len(SOLVERS), -1))
    runs_free = np.reshape([one.free_run for one in crossed], (len(SOLVERS), -1))
    own = [name for k, name in enumerate(SOLVERS) if errors[:, k].argmin() == k]
    apart = [100 * (e.max(axis=0) / e.min(axis=0) - 1).max() for e in (errors, runs_free)]
    resistances = {name: milliohm(run.result) for name, run in trained.items()}
    shown = ", ".join(f"{name} {value:.2f}" for name, value in resistances.items())
    truth = 1e3 * trained["Euler"].result.true_resistance
    claims = (
        Claim(
            "Paper: the model is optimised for its solver: whatever it is run with, the model "
            "trained with that predicts best.",
            len(own) == len(SOLVERS),
            f"So for {len(own)} of {len(SOLVERS)} solvers, by little: run with one solver, the "
            f"models differ by at most {apart[0]:.2g} % one step ahead and {apart[1]:.2g} % in "
            "free run.",
        ),
        Claim(
            "The resistance depends on the solver by less than 2 %.",
            bool(np.ptp(list(resistances.values())) < 0.02 * truth),
            f"R at H = {horizon} in mΩ: {shown} (true {truth:.4g}).",
        ),
    )
    return StudyResult(
        "solver_dependence",
        "Trained with one solver, run with another",
        "The coenergy map trained with four solvers, each then run with all four on the unseen "
        "recordings.",
        [*table, *rows([list(trained.values())])],
        (
            _matrix("One-step error (A)", [one.one_step for one in crossed]),
            _matrix("Free-run error, median (A)", [one.free_run for one in crossed]),
        ),
        claims,
        "All solvers agree on where the machine comes to rest, u = R i + ωJψ, which identifies "
        "R on a slow trajectory. They differ in what a sample makes of a change: forward Euler "
        "moves the current along a straight line where it turns on an arc, a step too long by "
        "(ωT)²/2 of the change. Training puts that into the map. Beside the ripple over the rotor "
        "angle, which no map of the currents describes, it is small. Adams-Bashforth steps start "
        "from several measured samples, whose ripple they extrapolate: what it costs is seen in "
        "its column, whatever the model was trained with.",
    )


def _variant(name: str) -> Variant:
    short = name.lower().replace(" ", "_").replace("-", "_")
    return replace(COENERGY, name=f"solver_{short}", label=name, solver=SOLVERS[name])


def _trained(runs: Runs, name: str, horizon: int) -> Run:
    (run,) = runs.at_horizons("simulation", _variant(name), (horizon,), runs.extent.seeds[:1])
    return run


def _cross(fit: Fit, trained: str, other: str, unseen: tuple[Experiment, ...]) -> _Crossed:
    predictor = Predictor(unseen[0].time_step, SOLVERS[other])
    seen = [compare(predictor, fit.model, run) for run in unseen]
    one_step = float(np.sqrt(np.mean([c.one_step_rmse**2 for c in seen])))
    return _Crossed(trained, other, one_step, float(np.median([c.free_run_rmse for c in seen])))


def _matrix(title: str, values: list[float]) -> Matrix:
    names = tuple(SOLVERS)
    shaped = np.reshape(values, (len(names), len(names))).tolist()
    return Matrix(title, "run with", "trained with", names, names, shaped)
