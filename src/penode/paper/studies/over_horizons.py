"""Studies of what the horizon does: the paper's figures, with its training and with ours."""

from collections.abc import Sequence
from functools import partial
from math import gcd

import numpy as np

from penode.horizon.loss_weighting import LossWeighting, loss_weighting
from penode.paper.studies.panels import Panel, Series, StudyResult
from penode.paper.studies.runs import Measures, Place, Run, Runs
from penode.paper.studies.summaries import (
    HORIZON,
    Judged,
    Trained,
    error_percent,
    flux_percent,
    good,
    limits,
    listed,
    milliohm,
    told,
)
from penode.paper.studies.variants import (
    AXES,
    COENERGY,
    HARMONICS,
    INVERTER,
    JITTERED,
    PAPER,
    SECOND_ORDER,
    Variant,
)
from penode.pmsm.report.line_causes import named_lines, signed_frequency
from penode.predictors.base import Predictor
from penode.validation.free_run import compare

#: Horizons below which the paper finds R negative.
_NEGATIVE_BELOW = 15
#: Lines of the residual that are shown.
_LINES = 5
_COLOURS = ("paper", "second_order", "coenergy", "inverter", "harmonics", "other")
_MARKS = tuple(zip(_COLOURS[2:] * 2, "osD^vPh>", strict=True))


def resistance_vs_horizon(runs: Runs) -> StudyResult:
    """Return R over the horizon on the simulated system (paper, figure of R in simulation)."""
    seen, last = Trained.of(runs, "simulation"), runs.extent.longest
    truth, any_map = seen.truth, seen.series(milliohm, AXES[:3])
    coenergy = seen.series(milliohm, AXES[3:])
    short = [h for h in runs.extent.horizons if h < _NEGATIVE_BELOW]
    below = [value for h in short for value in seen.at(PAPER, h, milliohm)]
    means = [seen.mean(PAPER, h, milliohm) for h in short]
    first, end = (np.abs(np.array(seen.at(PAPER, h, error_percent))) for h in (1, last))
    worst = max(seen.spread(PAPER, h, milliohm) for h in short)
    bias = min(abs(mean - truth) for mean in means)
    numbers = {"below": _NEGATIVE_BELOW, "short": listed(short), "means": listed(means)}
    numbers |= {"largest": max(below), "truth": truth, "spread": worst, "bias": bias, "last": last}
    numbers |= {"first": listed(first), "end": listed(end), "ratio": listed(end / first, 2)}
    judged = [
        ("negative", bool(below) and max(below) < 0, numbers),
        ("shrinking", bool((end <= first / 5).all()), numbers),
        ("agreeing", worst < bias, numbers),
        *_converged(runs, seen),
        seen.ours_within(2.0, 0.2),
    ]
    shown = (*any_map, *coenergy[:1])
    title = "Any map: the horizon decides"
    left = seen.resistance_panel(title, shown, limits(any_map[0], truth))
    right = seen.resistance_panel("With a coenergy map", coenergy, (0.9 * truth, 1.1 * truth))
    return told("resistance_vs_horizon", seen.rows, (left, right), judged)


def _converged(runs: Runs, seen: Trained) -> list[Judged]:
    """Judge whether the recipe ends in the minimum of its own loss."""
    if SECOND_ORDER.name not in seen.by:
        return []
    left = {
        h: [seen.mean(variant, h, lambda m: m.trained) for variant in (PAPER, SECOND_ORDER)]
        for h in runs.extent.horizons
        if seen.at(SECOND_ORDER, h, milliohm)
    }
    errors = "; ".join(f"H = {h}: {a:.3g} and {b:.3g} A" for h, (a, b) in left.items())
    minima = listed([seen.mean(SECOND_ORDER, h, milliohm) for h in left])
    holds = all(a <= 1.1 * b for a, b in left.values())
    return [("converged", holds, {"errors": errors, "minima": minima})]


def flux_error_vs_horizon(runs: Runs) -> StudyResult:
    """Return the error of the map over the horizon (paper, figure of the flux MAE)."""
    seen, last = Trained.of(runs, "simulation"), runs.extent.longest
    first, end = (seen.mean(PAPER, h, flux_percent) for h in (1, last))
    shape = [seen.mean(PAPER, h, flux_percent) for h in runs.extent.horizons]
    numbers = {"first": first, "end": end, "last": last, "shape": listed(shape, 2)}
    panel = seen.flux_panel("Error of the identified map over the excited region")
    judged = [("falling", end <= first / 2, numbers), seen.ours_within(2.0, 0.2)]
    return told("flux_error_vs_horizon", seen.rows, (panel,), judged)


def generalisation_vs_horizon(runs: Runs) -> StudyResult:
    """Return one-step errors on unseen recordings over the horizon (paper, figure of the MSE)."""
    chosen = (PAPER, COENERGY, HARMONICS)
    seen, last = Trained.of(runs, "simulation", chosen), runs.extent.longest
    ours, everything = seen.ours.result, [run for group in seen.by.values() for run in good(group)]
    levels = [
        error
        for run in everything
        for error in (run.result.one_step_train, *run.result.one_step.values())
        if np.isfinite(error)
    ]
    edges = (0.7 * min(levels), 1.4 * max(levels))
    trained, unseen = (
        [seen.mean(PAPER, h, value) for h in (1, last)]
        for value in (lambda m: m.one_step_train, lambda m: m.unseen_one_step)
    )
    on = [partial(_on, name) for name in ours.one_step]
    falling = sum(seen.mean(PAPER, last, one) < seen.mean(PAPER, 1, one) for one in on)
    best = min(seen.mean(PAPER, h, lambda m: m.unseen_one_step) for h in runs.extent.horizons)
    counts = {"count": len(ours.one_step), "falling": falling, "last": last}
    judged = [
        ("falling", unseen[1] < unseen[0], {**counts, "first": unseen[0], "end": unseen[1]}),
        (
            "rising",
            trained[0] <= trained[1] <= 2 * trained[0],
            {"first": trained[0], "end": trained[1], "last": last},
        ),
        ("ours", ours.unseen_one_step < best, {"ours": ours.unseen_one_step}),
    ]
    panels = [_generalisation(v, good(seen.by[v.name]), edges) for v in chosen if v.name in seen.by]
    table = []
    for run in (*everything, *good([seen.ours])):
        head = {"method": run.method, "seed": run.seed, "horizon": run.result.horizon}
        errors = {"trained on": run.result.one_step_train, **run.result.one_step}
        table += [{**head, "on": name, "one_step_mse_A2": e} for name, e in errors.items()]
    return told("generalisation_vs_horizon", table, panels, judged, count=counts["count"])


def _on(name: str, measures: Measures) -> float:
    """Return the one-step error on one of the unseen recordings."""
    return measures.one_step[name]


def _generalisation(variant: Variant, runs: Sequence[Run], edges: tuple[float, float]) -> Panel:
    x = [float(run.horizon) for run in runs]
    names = runs[0].result.one_step if runs else {}
    others = [
        Series(name, x, [run.result.one_step[name] for run in runs], colour, marker)
        for name, (colour, marker) in zip(names, _MARKS, strict=False)
    ]
    trained = Series("trained on", x, [r.result.one_step_train for r in runs], "paper", "x")
    return Panel(
        variant.label,
        HORIZON,
        "one-step MSE (A²)",
        (trained, *others),
        y_log=True,
        y_limits=edges,
        legend=variant is PAPER,
    )


def testbench_resistance(runs: Runs) -> StudyResult:
    """Return R over the horizon with every imperfection on (paper, figure of R on the bench)."""
    seen, horizons = Trained.of(runs, "testbench"), runs.extent.horizons
    truth, series = seen.truth, seen.series(milliohm)
    left = seen.resistance_panel("Every imperfection on", series, limits(series[0], truth))
    view, labels = _weighting(runs)
    right = Panel(
        "Weight of each error in the paper's loss",
        HORIZON,
        "share of the loss (%)",
        tuple(
            Series(label, view.horizons, (100 * view.fractions(line)).tolist(), colour, "")
            for line, label, colour in zip(view.lines, labels, _COLOURS, strict=False)
        ),
    )
    means = [seen.mean(PAPER, h, milliohm) for h in horizons]
    gaps = np.abs(np.array(means) - truth)
    worse = [
        f"{a} to {b}"
        for a, b, before, after in zip(horizons, horizons[1:], gaps, gaps[1:], strict=False)
        if after > before
    ]
    numbers = {"horizons": listed(horizons), "means": listed(means), "truth": truth}
    numbers["worse"] = ", ".join(worse) or "nowhere"
    numbers["spread"] = max(seen.spread(PAPER, h, milliohm) for h in horizons)
    name, holds, ours = seen.ours_within(5.0, 1.0)
    lost = seen.ours.result.others.get("dead_time_voltage")
    dead_time = f", dead time {lost:.2f} V" if lost is not None else ""
    run = runs.case("testbench").experiment
    turn = float(np.median(np.abs(run.channels["omega_el"]))) * run.time_step
    sixth = 2 * np.pi / (6 * turn)
    judged = [
        ("not_monotone", bool(worse), numbers),
        *_aliasing(seen, horizons, round(sixth)),
        (name, holds, {**ours, "dead_time": dead_time}),
    ]
    return told("testbench_resistance", seen.rows, (left, right), judged, sixth=sixth)


def _weighting(runs: Runs) -> tuple[LossWeighting, list[str]]:
    """Return how the paper's fit at H = 1 leaves lines, and their names, strongest first."""
    fit = runs.fit(Place("testbench", PAPER.name, runs.extent.seeds[0], 1))
    run = runs.case("testbench").experiment
    seen = compare(Predictor(run.time_step), fit.model, run, "train")
    base = float(np.median(run.channels["omega_el"])) / (2 * np.pi)
    base = signed_frequency(base, fit.transitions)
    view = loss_weighting(seen, fit.transitions, runs.extent.horizons, base)
    pole_pairs = runs.case("testbench").recording.truth.machine.pole_pairs
    labels = []
    for line in named_lines(view.lines[:_LINES], base, pole_pairs):
        order = f"{line.order:+.3g}" if line.order else "0"
        cause = line.cause.split(",")[0].split(":")[0].split(" (")[0]
        labels.append(f"order {order}: {cause}")
    return view, labels


def _aliasing(seen: Trained, horizons: Sequence[int], period: int) -> list[Judged]:
    """Judge windows end to end by the phases of the sixth order, of a period in samples."""
    if JITTERED.name not in seen.by:
        return []
    gap = {
        h: seen.mean(SECOND_ORDER, h, milliohm) - seen.mean(JITTERED, h, milliohm) for h in horizons
    }
    gap = {h: value for h, value in gap.items() if np.isfinite(value)}
    phases = {h: period // gcd(h, period) for h in gap}
    few = [abs(gap[h]) for h in gap if phases[h] <= 2]
    many = [abs(gap[h]) for h in gap if phases[h] > 2]
    listing = "; ".join(f"H = {h}: {phases[h]} phases, {gap[h]:+.2g} mΩ" for h in gap)
    holds = bool(few and many and np.mean(few) > np.mean(many))
    return [("aliasing", holds, {"listing": listing})]


def well_designed(runs: Runs) -> StudyResult:
    """Return R over the horizon at low speed with fast currents (paper, section 5.3)."""
    variants, horizons = (PAPER, SECOND_ORDER, COENERGY, INVERTER), runs.extent.few_horizons
    rows, panels, judged = [], [], list[Judged]()
    for case in ("well_designed", "well_designed_testbench"):
        seen = Trained.of(runs, case, variants, few=True)
        rows += seen.rows
        shown = (*seen.series(error_percent, variants), seen.star(error_percent))
        panels.append(Panel(seen.label, HORIZON, "error of R (%)", shown, 0.0))
        for variant in (PAPER, INVERTER):
            errors = [seen.mean(variant, h, error_percent) for h in horizons]
            numbers = {"horizons": listed(horizons), "errors": listed(errors)}
            numbers |= {"label": seen.label, "variant": variant.label}
            judged.append(("flat", all(abs(error) <= 2.0 for error in errors), numbers))
        judged.append(seen.ours_within(2.0))
    return told("well_designed", rows, panels, judged)


def subdomain(runs: Runs) -> StudyResult:
    """Return what motor operation alone identifies (paper, section 5.1)."""
    variants, last = (PAPER, SECOND_ORDER, COENERGY), runs.extent.few_horizons[-1]
    seen = Trained.of(runs, "motor_operation", variants, few=True)
    first, end = ([abs(e) for e in seen.at(PAPER, h, error_percent)] for h in (1, last))
    numbers = {"first": listed(first), "end": listed(end), "last": last}
    judged = [
        ("shrinking", bool(first and end) and max(end) < min(first), numbers),
        seen.ours_within(2.0),
    ]
    panels = (
        seen.resistance_panel("R from motor operation alone", seen.series(milliohm)),
        seen.flux_panel("Map over the part of the disc that was visited", legend=False),
    )
    return told("subdomain", seen.rows, panels, judged)
