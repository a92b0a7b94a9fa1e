"""Every method on every recording."""

from penode.paper.conventional.coenergy_least_squares import CoenergyLeastSquares
from penode.paper.conventional.current_predictor import CurrentPredictor
from penode.paper.conventional.flux_predictor import FluxPredictor
from penode.paper.conventional.linear_maps import polynomial, radial, spline
from penode.paper.conventional.method import Method
from penode.paper.conventional.neural_ode import NeuralODE
from penode.paper.conventional.stationary_averaging import StationaryAveraging
from penode.paper.studies.panels import Claim, Matrix, StudyResult
from penode.paper.studies.runs import Run, Runs
from penode.paper.studies.summaries import Value, error_percent, flux_percent, row
from penode.paper.studies.variants import PAPER

#: Name in folders and tables to the method; the paper's recipe and our defaults are beside them.
METHODS: dict[str, Method] = {
    "stationary_averaging": StationaryAveraging(),
    "flux_predictor_polynomial": FluxPredictor(polynomial()),
    "flux_predictor_radial": FluxPredictor(radial()),
    "flux_predictor_spline": FluxPredictor(spline()),
    "coenergy_least_squares": CoenergyLeastSquares(),
    "coenergy_least_squares_inverter": CoenergyLeastSquares(inverter=True),
    "current_predictor": CurrentPredictor(),
    "neural_ode_1": NeuralODE(1),
    "neural_ode_2": NeuralODE(2),
}

LABELS = {
    "stationary_averaging": "stationary averaging",
    "flux_predictor_polynomial": "flux predictor, polynomial",
    "flux_predictor_radial": "flux predictor, radial",
    "flux_predictor_spline": "flux predictor, spline",
    "coenergy_least_squares": "least squares, coenergy",
    "coenergy_least_squares_inverter": "least squares, coenergy, inverter term",
    "current_predictor": "current predictor, inverter term",
    "neural_ode_1": "neural ODE, H = 1",
    "neural_ode_2": "neural ODE, H = 2",
    "paper": "paper recipe, longest H",
    "ours": "our defaults",
}


def method_table(runs: Runs) -> StudyResult:
    """Return R, map, one-step and free-run errors of every method on every recording."""
    extent = runs.extent
    by_method: dict[tuple[str, str], Run] = {}
    for case in extent.recordings:
        for name in LABELS:
            by_method[name, case] = _run(runs, case, name)
    table = []
    for (name, case), run in by_method.items():
        shown = {**row(run), "method": LABELS[name], "recording": runs.case(case).label}
        table.append(shown)
    best = [_best(by_method, case) for case in extent.recordings]
    mine = sum(name == "ours" for name in best)
    claims = (
        Claim(
            "Our defaults find R closest, or within 2 %, on every recording.",
            all(
                name == "ours" or abs(by_method["ours", case].result.error) <= 0.02
                for name, case in zip(best, extent.recordings, strict=True)
            ),
            f"Closest of all on {mine} of {len(best)} recordings; error of R: "
            + ", ".join(
                f"{case} {error_percent(by_method['ours', case].result):+.2f} %"
                for case in extent.recordings
            )
            + ".",
        ),
    )
    return StudyResult(
        "table",
        "Every method on every recording",
        "Conventional methods, the paper's recipe and our defaults. Errors against the bench's "
        "truth; one-step and free-run errors on recordings not used for training.",
        table,
        (
            _matrix(runs, by_method, "|error of R| (%)", lambda m: abs(error_percent(m))),
            _matrix(runs, by_method, "error of the map (% of ψ_PM)", flux_percent),
        ),
        claims,
        "Stationary averaging needs recordings that dwell, and refuses the others. One-step "
        "methods, whatever their map, share the bias of H = 1 where the experiment leaves R free. "
        "Dead time that no term describes counts as resistance with every method; averaging motor "
        "and generator points does not help, as it turns with the current. Linear least squares "
        "over windows of two periods of the sixth harmonic has no bias of a horizon; with the "
        "inverter term it is what a trained map has to be better than, and on some slow "
        "trajectories its map is the closer one. It describes no harmonic of the angle, so it "
        "predicts worse.",
        (
            "recording",
            "method",
            "R_mohm",
            "R_error_percent",
            "flux_mae_percent_of_psi_PM",
            "one_step_mse_unseen_A2",
            "free_run_rmse_unseen_A",
            "wall_time_s",
            "refusal",
        ),
    )


def _run(runs: Runs, case: str, name: str) -> Run:
    if name == PAPER.name:
        at = (runs.extent.longest,), runs.extent.seeds[:1]
        return runs.at_horizons(case, PAPER, *at)[0]
    return runs.ours(case) if name == "ours" else runs.by_method(case, name, METHODS[name])


def _best(by_method: dict[tuple[str, str], Run], case: str) -> str:
    errors = {
        name: abs(run.result.error)
        for (name, at), run in by_method.items()
        if at == case and run.measures is not None
    }
    return min(errors, key=lambda name: errors[name])


def _matrix(runs: Runs, by_method: dict[tuple[str, str], Run], title: str, value: Value) -> Matrix:
    cases = runs.extent.recordings
    named = tuple(
        runs.case(case).label.replace(", ", "\n").replace("operating ", "operating\n")
        for case in cases
    )
    values = [[_shown(by_method[name, case], value) for case in cases] for name in LABELS]
    return Matrix(title, "", "", tuple(LABELS.values()), named, values)


def _shown(run: Run, value: Value) -> float:
    return value(run.measures) if run.measures is not None else float("nan")
