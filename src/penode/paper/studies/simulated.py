"""Studies of the simulated system: R and the map over the horizon.

They share their runs, which are trained once.
"""

from collections.abc import Sequence

import numpy as np

from penode.paper.studies.panels import Claim, Panel, Series, StudyResult
from penode.paper.studies.runs import Run, Runs
from penode.paper.studies.summaries import (
    Value,
    at,
    error_percent,
    flux_percent,
    in_numbers,
    limits,
    listed,
    mean_at,
    milliohm,
    over_horizon,
    rows,
    spread,
    star,
)
from penode.paper.studies.variants import AXES, PAPER, SECOND_ORDER, Variant

HORIZON = "integration horizon H (steps)"
_UNCONSTRAINED = 3
#: Horizons below which the paper finds R negative.
_NEGATIVE_BELOW = 15


def axes_runs(runs: Runs, case: str, variants: Sequence[Variant] = AXES) -> dict[str, list[Run]]:
    """Return the runs of variants on a case, fewer of those with angle harmonics."""
    extent = runs.extent
    by_variant = {}
    for variant in variants:
        if variant.name in extent.variants:
            # A map with angle orders takes several times as long.
            whole = not variant.angle_orders
            horizons = extent.horizons if whole else extent.few_horizons
            seeds = extent.seeds if whole else extent.seeds[:1]
            by_variant[variant.name] = runs.at_horizons(case, variant, horizons, seeds)
    return by_variant


def over_horizons(
    by: dict[str, list[Run]], value: Value, variants: Sequence[Variant] = AXES
) -> tuple[Series, ...]:
    """Return a series for each variant that was run."""
    return tuple(over_horizon(v, by[v.name], value) for v in variants if v.name in by)


def resistance_vs_horizon(runs: Runs) -> StudyResult:
    """Return R over the horizon on the simulated system (paper, figure of R in simulation)."""
    by = axes_runs(runs, "simulation")
    ours = runs.ours("simulation")
    paper, last = by[PAPER.name], runs.extent.longest
    any_map = over_horizons(by, milliohm, AXES[:_UNCONSTRAINED])
    coenergy = over_horizons(by, milliohm, AXES[_UNCONSTRAINED:])
    best = star(ours, milliohm)
    truth = 1e3 * ours.result.true_resistance
    left = Panel(
        "Any map: the horizon decides",
        HORIZON,
        "estimated R (mΩ)",
        (*any_map, *coenergy[:1], best),
        truth,
        y_limits=limits(any_map[0], truth),
    )
    right = Panel(
        "With a coenergy map",
        HORIZON,
        "estimated R (mΩ)",
        (*coenergy, best),
        truth,
        y_limits=(0.9 * truth, 1.1 * truth),
    )
    short = [h for h in runs.extent.horizons if h < _NEGATIVE_BELOW]
    below = [value for h in short for value in at(paper, h, milliohm)]
    first, end = (np.abs(np.array(at(paper, h, error_percent))) for h in (1, last))
    worst = max(spread(at(paper, h, milliohm)) for h in short)
    bias = min(abs(mean_at(paper, h, milliohm) - truth) for h in short)
    claims = (
        Claim(
            f"Paper: R is negative for every H < {_NEGATIVE_BELOW}, in every repetition.",
            bool(below) and max(below) < 0,
            f"R at H = {listed(short)}: {listed([mean_at(paper, h, milliohm) for h in short])} "
            f"mΩ on average, the largest of all seeds {max(below):.3g} mΩ; the truth is "
            f"{truth:.3g} mΩ.",
        ),
        Claim(
            f"Paper: the error shrinks with H, in every repetition; at H = {last} to at most a "
            "fifth of that at H = 1.",
            bool((end <= first / 5).all()),
            f"|error|, seed by seed: {listed(first)} % at H = 1 and {listed(end)} % at H = {last}, "
            f"which is {listed(end / first, 2)} of it.",
        ),
        Claim(
            "Paper: repetitions agree; their spread is smaller than the bias.",
            worst < bias,
            f"Below H = {_NEGATIVE_BELOW} the seeds differ by at most {worst:.2g} mΩ where the "
            f"bias is at least {bias:.3g} mΩ.",
        ),
        *_converged(runs, by),
        _ours(ours, 2.0, 0.2),
    )
    return StudyResult(
        "resistance_vs_horizon",
        "Resistance over the horizon, simulation",
        "The paper's central figure: R over the horizon on a slow trajectory at 1500 rpm, where a "
        "map of the currents cannot describe the harmonics over the rotor angle.",
        rows([*by.values(), [ours]]),
        (left, right),
        claims,
        "At one speed and on a slow trajectory R and a skew part of the map stand in for each "
        "other (the gauge: docs/theory/horizon.md). Whatever the model cannot describe decides "
        "where between them the answer falls, so that every seed agrees on a wrong R: their "
        "agreement is no evidence. Long horizons weight slow errors, where R acts. But the loss "
        "counts currents, the voltage that is left divided by L: a large skew part of the map, of "
        "either sign, makes L large and every error small. Trained to the end, an unconstrained "
        "map therefore goes to R far below zero at short horizons and far above at middle ones, "
        "and the recipe's R in between depends on how long it trains and how fast its horizon "
        "grows. A coenergy map has no skew part; what is left for the horizon to repair is the "
        "bias by the ripple. An inverter term, which nothing in this recording calls for, takes "
        "the ripple for dead time at short horizons and R with it; our defaults leave it out.",
    )


def _converged(runs: Runs, by: dict[str, list[Run]]) -> list[Claim]:
    """Return whether the recipe ends in the minimum of its own loss."""
    if SECOND_ORDER.name not in by:
        return []
    left = {
        h: [mean_at(by[v.name], h, lambda m: m.trained) for v in (PAPER, SECOND_ORDER)]
        for h in runs.extent.horizons
        if at(by[SECOND_ORDER.name], h, milliohm)
    }
    errors = "; ".join(f"H = {h}: {a:.3g} and {b:.3g} A" for h, (a, b) in left.items())
    minima = [mean_at(by[SECOND_ORDER.name], h, milliohm) for h in left]
    claim = Claim(
        "The paper's recipe ends in the minimum of its loss: a second-order method, from another "
        "start, does not get 10 % below it.",
        all(a <= 1.1 * b for a, b in left.values()),
        f"Error over the horizon, Adam and Levenberg-Marquardt: {errors}; R at the latter's "
        f"minima: {listed(minima)} mΩ.",
    )
    return [claim]


def flux_error_vs_horizon(runs: Runs) -> StudyResult:
    """Return the error of the map over the horizon (paper, figure of the flux MAE)."""
    by = axes_runs(runs, "simulation")
    ours = runs.ours("simulation")
    paper, last = by[PAPER.name], runs.extent.longest
    series = over_horizons(by, flux_percent)
    panel = Panel(
        "Error of the identified map over the excited region",
        HORIZON,
        "mean |error| of ψ_d, ψ_q (% of ψ_PM)",
        (*series, star(ours, flux_percent)),
        y_log=True,
    )
    first, end = mean_at(paper, 1, flux_percent), mean_at(paper, last, flux_percent)
    shape = [mean_at(paper, h, flux_percent) for h in runs.extent.horizons]
    claims = (
        Claim(
            f"Paper: the map's error falls with H; at H = {last} to at most half of that at H = 1.",
            end <= first / 2,
            f"{first:.2g} % of ψ_PM at H = 1, {end:.2g} % at H = {last}; over the horizons "
            f"{listed(shape, 2)} %.",
        ),
        _ours(ours, 2.0, 0.2),
    )
    return StudyResult(
        "flux_error_vs_horizon",
        "Error of the map over the horizon, simulation",
        "The same runs: mean absolute error of ψ_d and ψ_q against the bench's own map, averaged "
        "over the rotor angle.",
        rows([*by.values(), [ours]]),
        (panel,),
        claims,
        "What R has too little, the map has too much: the false part of the map is the gauge again "
        "(ΔR/ω times the current), so both errors fall together.",
    )


def _ours(run: Run, resistance: float, flux: float) -> Claim:
    measures = run.result
    return Claim(
        f"Ours: R within {resistance:g} % and the map within {flux:g} % of ψ_PM at the horizon it "
        "chose.",
        abs(error_percent(measures)) <= resistance and flux_percent(measures) <= flux,
        f"{in_numbers(measures)}.",
    )
