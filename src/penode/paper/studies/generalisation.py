"""One-step errors on unseen recordings over the horizon of training."""

from collections.abc import Sequence

import numpy as np

from penode.paper.studies.panels import Claim, Panel, Series, StudyResult
from penode.paper.studies.runs import Run, Runs
from penode.paper.studies.simulated import HORIZON, axes_runs
from penode.paper.studies.summaries import Value, good, mean_at
from penode.paper.studies.variants import COENERGY, HARMONICS, PAPER, Variant


def generalisation_vs_horizon(runs: Runs) -> StudyResult:
    """Return one-step errors on unseen recordings over the horizon (paper, figure of the MSE)."""
    chosen = (PAPER, COENERGY, HARMONICS)
    by = axes_runs(runs, "simulation", chosen)
    ours = runs.ours("simulation")
    paper, last = by[PAPER.name], runs.extent.longest
    names = list(ours.result.one_step)
    levels = [v for run in good([r for group in by.values() for r in group]) for v in _errors(run)]
    limits = (0.7 * min(levels), 1.4 * max(levels))
    panels = tuple(_generalisation(v, by[v.name], limits) for v in chosen if v.name in by)
    seen = [mean_at(paper, h, lambda m: m.one_step_train) for h in (1, last)]
    unseen = [mean_at(paper, h, lambda m: m.unseen_one_step) for h in (1, last)]
    falling = [
        name
        for name in names
        if mean_at(paper, last, _unseen(name)) < mean_at(paper, 1, _unseen(name))
    ]
    claims = (
        Claim(
            "Paper: on other recordings the one-step error falls with the horizon.",
            unseen[1] < unseen[0],
            f"Mean over {len(names)} recordings: {unseen[0]:.3g} A² at H = 1, {unseen[1]:.3g} A² "
            f"at H = {last}; it falls on {len(falling)} of them.",
        ),
        Claim(
            "Paper: on the recording trained on it rises slightly.",
            seen[0] <= seen[1] <= 2 * seen[0],
            f"{seen[0]:.3g} A² at H = 1, {seen[1]:.3g} A² at H = {last}.",
        ),
        Claim(
            "Ours generalises better than the paper's recipe at any horizon.",
            ours.result.unseen_one_step
            < min(mean_at(paper, h, lambda m: m.unseen_one_step) for h in runs.extent.horizons),
            f"Our defaults: {ours.result.unseen_one_step:.3g} A² on the same recordings.",
        ),
    )
    return StudyResult(
        "generalisation_vs_horizon",
        "Generalisation over the horizon, simulation",
        f"Mean squared one-step error on {len(names)} recordings of the same drive at other "
        "speeds, currents and trajectories, and on the recording trained on.",
        _generalisation_rows([*by.values(), [ours]]),
        panels,
        claims,
        "At H = 1 a wrong R and a wrong map compensate each other at the one speed they were "
        "trained at, and nowhere else. The long horizon gives a little of the training error away "
        "for a model that is right at other speeds: the paper calls it a regulariser.",
    )


def _errors(run: Run) -> list[float]:
    """Return all finite one-step errors of a run."""
    errors = [run.result.one_step_train, *run.result.one_step.values()]
    return [error for error in errors if np.isfinite(error)]


def _generalisation(variant: Variant, runs: Sequence[Run], limits: tuple[float, float]) -> Panel:
    kept = good(runs)
    x = [float(run.horizon) for run in kept]
    names = kept[0].result.one_step if kept else {}
    others = [
        Series(name, x, [run.result.one_step[name] for run in kept], colour, marker)
        for name, (colour, marker) in zip(names, _MARKS, strict=False)
    ]
    trained = Series("trained on", x, [r.result.one_step_train for r in kept], "paper", "x")
    return Panel(
        variant.label,
        HORIZON,
        "one-step MSE (A²)",
        (trained, *others),
        y_log=True,
        y_limits=limits,
        legend=variant is PAPER,
    )


_MARKS = tuple(
    (colour, marker)
    for colour, marker in zip(
        ("coenergy", "inverter", "harmonics", "other") * 2, "osD^vPh>", strict=True
    )
)


def _unseen(name: str) -> Value:
    return lambda measures: measures.one_step[name]


def _generalisation_rows(groups: Sequence[Sequence[Run]]) -> list[dict[str, object]]:
    table = []
    for run in (run for group in groups for run in good(group)):
        head = {"method": run.method, "seed": run.seed, "horizon": run.result.horizon}
        errors = {"trained on": run.result.one_step_train, **run.result.one_step}
        table += [{**head, "on": name, "one_step_mse_A2": e} for name, e in errors.items()]
    return table
