"""Studies of the experiment's design: well-designed recordings, and a part of the current disc."""

from collections.abc import Sequence

from penode.paper.studies.panels import Claim, Panel, StudyResult
from penode.paper.studies.runs import Run, Runs
from penode.paper.studies.simulated import HORIZON, over_horizons
from penode.paper.studies.summaries import (
    at,
    error_percent,
    flux_percent,
    in_numbers,
    listed,
    mean_at,
    milliohm,
    rows,
    star,
)
from penode.paper.studies.variants import COENERGY, INVERTER, PAPER, SECOND_ORDER, Variant

_WELL = (PAPER, SECOND_ORDER, COENERGY, INVERTER)
_MOTOR = (PAPER, SECOND_ORDER, COENERGY)
_SEEDS = 1


def _few(runs: Runs, case: str, variants: Sequence[Variant]) -> dict[str, list[Run]]:
    """Return the runs of variants at few horizons."""
    extent = runs.extent
    at = extent.few_horizons, extent.seeds[:_SEEDS]
    wanted = [v for v in variants if v.name in extent.variants]
    return {v.name: runs.at_horizons(case, v, *at) for v in wanted}


def well_designed(runs: Runs) -> StudyResult:
    """Return R over the horizon at low speed with fast currents (paper, section 5.3)."""
    cases = ("well_designed", "well_designed_testbench")
    groups, panels, claims = [], [], []
    for case in cases:
        by = _few(runs, case, _WELL)
        ours = runs.ours(case)
        groups += [*by.values(), [ours]]
        label = runs.case(case).label
        series = over_horizons(by, error_percent, _WELL)
        panels.append(
            Panel(label, HORIZON, "error of R (%)", (*series, star(ours, error_percent)), 0.0)
        )
        claims += [
            _flat(label, PAPER, by[PAPER.name], runs),
            _flat(label, INVERTER, by[INVERTER.name], runs),
            _chosen(label, ours),
        ]
    return StudyResult(
        "well_designed",
        "A well-designed experiment",
        "150 rpm and currents that move at 140 and 150 rad/s: R and the map part by themselves. "
        "The horizon should make no difference, and do no harm.",
        rows(groups),
        tuple(panels),
        tuple(claims),
        "Where the trajectory is as fast as the machine turns, the term (ΔR/ω) J di/dt that "
        "resolves the gauge is as large as the resistive drop itself. What then remains is what "
        "looks like resistance at any horizon: on the bench the dead time, 2 V against 2 V of "
        "resistive drop at 200 A, which only its own term can take away.",
    )


def _flat(label: str, variant: Variant, variant_runs: list[Run], runs: Runs) -> Claim:
    errors = {h: mean_at(variant_runs, h, error_percent) for h in runs.extent.few_horizons}
    return Claim(
        f"{label}, {variant.label}: R within 2 % at every horizon.",
        all(abs(error) <= 2.0 for error in errors.values()),
        f"error at H = {listed(list(errors))}: {listed(list(errors.values()))} %.",
    )


def _chosen(label: str, run: Run) -> Claim:
    measures = run.result
    return Claim(
        f"{label}, our defaults: R within 2 %.",
        abs(measures.error) <= 0.02,
        f"{in_numbers(measures)}.",
    )


def subdomain(runs: Runs) -> StudyResult:
    """Return what motor operation alone identifies (paper, section 5.1)."""
    case = "motor_operation"
    by = _few(runs, case, _MOTOR)
    ours = runs.ours(case)
    truth = 1e3 * ours.result.true_resistance
    resistance = over_horizons(by, milliohm, _MOTOR)
    flux = over_horizons(by, flux_percent, _MOTOR)
    paper, last = by[PAPER.name], runs.extent.few_horizons[-1]
    first = [abs(error) for error in at(paper, 1, error_percent)]
    end = [abs(error) for error in at(paper, last, error_percent)]
    claims = (
        Claim(
            "The paper's recipe in motor operation alone: the error of R shrinks with H.",
            bool(first and end) and max(end) < min(first),
            f"|error| {listed(first)} % at H = 1, {listed(end)} % at H = {last}.",
        ),
        _chosen(runs.case(case).label, ours),
    )
    panels = (
        Panel(
            "R from motor operation alone",
            HORIZON,
            "estimated R (mΩ)",
            (*resistance, star(ours, milliohm)),
            truth,
        ),
        Panel(
            "Map over the part of the disc that was visited",
            HORIZON,
            "mean |error| of ψ_d, ψ_q (% of ψ_PM)",
            (*flux, star(ours, flux_percent)),
            y_log=True,
            legend=False,
        ),
    )
    return StudyResult(
        "subdomain",
        "Motor operation alone",
        "The same simulated system, its trajectory within i_d ≤ 0 and i_q ≥ 0: what a machine that "
        "never brakes can be identified from.",
        rows([*by.values(), [ours]]),
        panels,
        claims,
        "A quarter of the disc has less leverage on R, and the map may bend as it likes outside of "
        "it. The gauge is the same.",
    )
