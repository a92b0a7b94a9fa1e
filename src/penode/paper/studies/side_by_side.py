"""Studies side by side: solvers in pairs, and every method on every recording."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from penode.paper.conventional.linear_maps import polynomial, radial, spline
from penode.paper.conventional.linear_methods import CoenergyLeastSquares, FluxPredictor
from penode.paper.conventional.stationary_averaging import StationaryAveraging
from penode.paper.conventional.trained_methods import CurrentPredictor, NeuralODE
from penode.paper.studies.panels import Matrix, StudyResult
from penode.paper.studies.runs import Method, Run, Runs
from penode.paper.studies.summaries import Value, error_percent, flux_percent, milliohm, row, told
from penode.paper.studies.variants import COENERGY, PAPER
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

#: Name in folders to name in tables and method; the paper's recipe and ours are trained elsewhere.
METHODS: dict[str, tuple[str, Method | None]] = {
    "stationary_averaging": ("stationary averaging", StationaryAveraging().identify),
    "flux_predictor_polynomial": (
        "flux predictor, polynomial",
        FluxPredictor(polynomial()).identify,
    ),
    "flux_predictor_radial": ("flux predictor, radial", FluxPredictor(radial()).identify),
    "flux_predictor_spline": ("flux predictor, spline", FluxPredictor(spline()).identify),
    "coenergy_least_squares": ("least squares, coenergy", CoenergyLeastSquares().identify),
    "coenergy_least_squares_inverter": (
        "least squares, coenergy, inverter term",
        CoenergyLeastSquares(inverter=True).identify,
    ),
    "current_predictor": ("current predictor, inverter term", CurrentPredictor().identify),
    "neural_ode_1": ("neural ODE, H = 1", NeuralODE(1).identify),
    "neural_ode_2": ("neural ODE, H = 2", NeuralODE(2).identify),
    PAPER.name: ("paper recipe, longest H", None),
    "ours": ("our defaults", None),
}

_COLUMNS = (
    "recording",
    "method",
    "R_mohm",
    "R_error_percent",
    "flux_mae_percent_of_psi_PM",
    "one_step_mse_unseen_A2",
    "free_run_rmse_unseen_A",
    "wall_time_s",
    "refusal",
)


def solver_dependence(runs: Runs) -> StudyResult:
    """Return one-step and free-run errors of every solver run with every other."""
    horizon = min(_HORIZON, runs.extent.longest)
    unseen, seeds = runs.case("simulation").validation, runs.extent.seeds[:1]
    trained, table = {}, []
    for name, solver in SOLVERS.items():
        short = name.lower().replace(" ", "_").replace("-", "_")
        variant = replace(COENERGY, name=f"solver_{short}", label=name, solver=solver)
        (run,) = runs.at_horizons("simulation", variant, (horizon,), seeds)
        trained[name] = run
    for name, run in trained.items():
        fit = runs.fit(run)
        for other, solver in SOLVERS.items():
            predictor = Predictor(unseen[0].time_step, solver)
            seen = [compare(predictor, fit.model, one) for one in unseen]
            table.append(
                {
                    "trained_with": name,
                    "run_with": other,
                    "R_mohm": milliohm(run.result),
                    "one_step_rmse_A": float(np.sqrt(np.mean([c.one_step_rmse**2 for c in seen]))),
                    "free_run_rmse_A": float(np.median([c.free_run_rmse for c in seen])),
                }
            )
    names, count = tuple(SOLVERS), len(SOLVERS)
    one_step, free_run = (
        np.reshape([line[column] for line in table], (count, count)).astype(float)
        for column in ("one_step_rmse_A", "free_run_rmse_A")
    )
    apart = [100 * (e.max(axis=0) / e.min(axis=0) - 1).max() for e in (one_step, free_run)]
    resistances = {name: milliohm(run.result) for name, run in trained.items()}
    truth = 1e3 * trained["Euler"].result.true_resistance
    own = sum(one_step[:, k].argmin() == k for k in range(count))
    numbers = {"own": own, "count": count, "one_step": apart[0], "free_run": apart[1]}
    numbers |= {"horizon": horizon, "truth": truth}
    numbers["shown"] = ", ".join(f"{name} {value:.2f}" for name, value in resistances.items())
    axes = ("run with", "trained with", names, names)
    panels = (
        Matrix("One-step error (A)", *axes, one_step.tolist()),
        Matrix("Free-run error, median (A)", *axes, free_run.tolist()),
    )
    close = bool(np.ptp(list(resistances.values())) < 0.02 * truth)
    judged = [("own", own == count, numbers), ("resistance", close, numbers)]
    rows: list[dict[str, object]] = [*table, *map(row, trained.values())]
    return told("solver_dependence", rows, panels, judged)


def method_table(runs: Runs) -> StudyResult:
    """Return R, map, one-step and free-run errors of every method on every recording."""
    cases = runs.extent.recordings
    found = {(name, case): _run(runs, case, name) for case in cases for name in METHODS}
    table = [
        {**row(run), "method": METHODS[name][0], "recording": runs.case(case).label}
        for (name, case), run in found.items()
    ]
    errors = {at: abs(run.result.error) for at, run in found.items() if run.measures is not None}
    mine = [_closest(errors, case) == "ours" for case in cases]
    ours = {case: error_percent(found["ours", case].result) for case in cases}
    holds = all(best or abs(e) <= 2.0 for best, e in zip(mine, ours.values(), strict=True))
    listing = ", ".join(f"{case} {error:+.2f} %" for case, error in ours.items())
    numbers = {"mine": sum(mine), "count": len(cases), "errors": listing}
    labels = tuple(label for label, _ in METHODS.values())
    short = tuple(
        runs.case(case).label.replace(", ", "\n").replace("operating ", "operating\n")
        for case in cases
    )

    def matrix(title: str, value: Value) -> Matrix:
        values = [
            [float("nan") if run.measures is None else value(run.measures) for run in line]
            for line in ([found[name, case] for case in cases] for name in METHODS)
        ]
        return Matrix(title, "", "", labels, short, values)

    panels = (
        matrix("|error of R| (%)", lambda m: abs(error_percent(m))),
        matrix("error of the map (% of ψ_PM)", flux_percent),
    )
    return told("table", table, panels, [("closest", holds, numbers)], _COLUMNS)


def _closest(errors: Mapping[tuple[str, str], float], case: str) -> str:
    names = [name for name, at in errors if at == case]
    return min(names, key=lambda name: errors[name, case])


def _run(runs: Runs, case: str, name: str) -> Run:
    if name == PAPER.name:
        return runs.at_horizons(case, PAPER, (runs.extent.longest,), runs.extent.seeds[:1])[0]
    method = METHODS[name][1]
    return runs.ours(case) if method is None else runs.by_method(case, name, method)
