"""R over the horizon on the test bench, and how each horizon weights the errors there."""

from collections.abc import Sequence
from math import gcd

import numpy as np

from penode.horizon.loss_weighting import LossWeighting, loss_weighting
from penode.paper.studies.panels import Claim, Panel, Series, StudyResult
from penode.paper.studies.runs import Place, Run, Runs
from penode.paper.studies.simulated import HORIZON, axes_runs, over_horizons
from penode.paper.studies.summaries import (
    at,
    in_numbers,
    limits,
    listed,
    mean_at,
    milliohm,
    rows,
    spread,
    star,
)
from penode.paper.studies.variants import JITTERED, PAPER, SECOND_ORDER
from penode.pmsm.report.line_causes import named_lines, signed_frequency
from penode.predictors.base import Predictor
from penode.validation.free_run import compare

_LINES = 5


def testbench_resistance(runs: Runs) -> StudyResult:
    """Return R over the horizon with every imperfection on (paper, figure of R on the bench)."""
    by = axes_runs(runs, "testbench")
    ours = runs.ours("testbench")
    truth = 1e3 * ours.result.true_resistance
    series = over_horizons(by, milliohm)
    left = Panel(
        "Every imperfection on",
        HORIZON,
        "estimated R (mΩ)",
        (*series, star(ours, milliohm)),
        truth,
        y_limits=limits(series[0], truth),
    )
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
    return StudyResult(
        "testbench_resistance",
        "Resistance over the horizon, test bench",
        "1000 rpm, 6 s, with dead time, unequal and offset current sensors, quantisation, a "
        "resolver whose error grows with the current, a noisy speed signal and unequal phases.",
        rows([*by.values(), [ours]]),
        (left, right),
        (_not_monotone(runs, by[PAPER.name], truth), *_aliasing(runs, by), _ours(ours)),
        "Windows end to end start at multiples of H. The sixth order has "
        f"{_sixth(runs):.0f} samples a period here: a horizon that is a multiple of it starts "
        "every window at one phase of the ripple, which then counts as a constant; other horizons "
        "sample two, four or all phases. Jittered windows see all of them at every horizon. What "
        "is left over the horizon is the prefilter: the right panel shows which lines of the "
        "one-step residual make up the loss at each. The dead time is a voltage along the "
        "current, which without its term every horizon takes for resistance.",
    )


_COLOURS = ("paper", "second_order", "coenergy", "inverter", "harmonics")


def _weighting(runs: Runs) -> tuple[LossWeighting, list[str]]:
    """Return how the paper's fit at H = 1 leaves lines, and their names, strongest first."""
    fit = runs.fit(Place("testbench", PAPER.name, runs.extent.seeds[0], 1))
    run = runs.case("testbench").experiment
    seen = compare(Predictor(run.time_step), fit.model, run, "train")
    base = float(np.median(run.channels["omega_el"])) / (2 * np.pi)
    base = signed_frequency(base, fit.transitions)
    view = loss_weighting(seen, fit.transitions, runs.extent.horizons, base)
    pole_pairs = runs.case("testbench").recording.truth.machine.pole_pairs
    named = named_lines(view.lines[:_LINES], base, pole_pairs)
    return view, [f"order {_signed(one.order)}: {_short(one.cause)}" for one in named]


def _signed(order: float) -> str:
    return f"{order:+.3g}" if order else "0"


def _short(cause: str) -> str:
    """Return the first few words of a cause."""
    return cause.split(",")[0].split(":")[0].split(" (")[0]


def _sixth(runs: Runs) -> float:
    """Return the period of the sixth electrical order in samples."""
    run = runs.case("testbench").experiment
    turn = float(np.median(np.abs(run.channels["omega_el"]))) * run.time_step
    return 2 * np.pi / (6 * turn)


def _not_monotone(runs: Runs, paper: Sequence[Run], truth: float) -> Claim:
    horizons = runs.extent.horizons
    means = [mean_at(paper, h, milliohm) for h in horizons]
    gaps = np.abs(np.array(means) - truth)
    noise = max(spread(at(paper, h, milliohm)) for h in horizons)
    worse = [
        f"{a} to {b}"
        for a, b, before, after in zip(horizons, horizons[1:], gaps, gaps[1:], strict=False)
        if after > before
    ]
    return Claim(
        "Paper: R(H) is not monotone; a longer horizon can be worse.",
        bool(worse),
        f"R over H = {listed(horizons)}: {listed(means)} mΩ (true {truth:.3g}); the error grows "
        f"from H = {', '.join(worse) or 'nowhere'}; seeds differ by at most {noise:.2g} mΩ.",
    )


def _aliasing(runs: Runs, by: dict[str, list[Run]]) -> list[Claim]:
    if JITTERED.name not in by:
        return []
    period, horizons = round(_sixth(runs)), runs.extent.horizons
    gap = {
        h: mean_at(by[SECOND_ORDER.name], h, milliohm) - mean_at(by[JITTERED.name], h, milliohm)
        for h in horizons
    }
    gap = {h: value for h, value in gap.items() if np.isfinite(value)}
    phases = {h: period // gcd(h, period) for h in gap}
    few = [abs(gap[h]) for h in gap if phases[h] <= 2]
    many = [abs(gap[h]) for h in gap if phases[h] > 2]
    listing = "; ".join(f"H = {h}: {phases[h]} phases, {gap[h]:+.2g} mΩ" for h in gap)
    claim = Claim(
        "Windows end to end differ from jittered ones most where few phases of the sixth order are "
        "sampled.",
        bool(few and many and np.mean(few) > np.mean(many)),
        f"R end to end less R jittered, the same optimiser: {listing}.",
    )
    return [claim]


def _ours(run: Run) -> Claim:
    measures = run.result
    lost = measures.others.get("dead_time_voltage")
    dead_time = f", dead time {lost:.2f} V" if lost is not None else ""
    return Claim(
        "Ours: R within 5 % and the map within 1 % of ψ_PM with every imperfection on.",
        abs(measures.error) <= 0.05 and measures.flux_share <= 0.01,
        f"{in_numbers(measures)}{dead_time}.",
    )
