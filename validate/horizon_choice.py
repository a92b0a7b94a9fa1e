"""The horizon chosen and the interval given, over machines and drives drawn at random.

``python -m validate.horizon_choice [COUNT] [FIRST]``: each draw is written to files and identified
by ``penode identify``, report included, nothing given but a study file that says that simulated
sensors are exact. Printed are, draw by draw, the terms
the structure took, the horizon and the verdict, the error of R and of the dead-time voltage in per
cent and in deviations, the error of R at the rung of least error, the mean absolute error of the
map in per cent of the largest |psi| and how much of its grid the band covers. In every tenth draw
an unconstrained map at one speed, on a slow trajectory, must be called not identifiable. Behind
``!!`` stands what no run should show: an exit status that the command does not promise, a part of
the report left out, a warning of Python. Ctrl-C prints the table of the draws so far; the same
command goes on.
"""

from collections import Counter

import numpy as np

from penode.arrays import FloatArray
from penode.fit.fit import Fit
from penode.fit.outcome import AGREED
from validate.drawn_recordings import Campaign, draw_campaign
from validate.identified import EXACT, Identified, identified
from validate.ledger import Record, run_draws
from validate.map_errors import error_and_coverage

COUNT = 200
#: Draws, one of which is identified with an unconstrained map too.
_FREE = 10


def result_of(number: int) -> Record:
    """Identify one campaign, at times with an unconstrained map of the machine at one speed."""
    campaign = draw_campaign(number)
    done = identified(f"horizon_choice/{number}", campaign.runs, config=EXACT)
    free = None
    if number % _FREE == 0:
        options = ("--flux-map", "mlp", "--horizon", 1)
        free = identified(
            f"horizon_choice/{number}_free", [campaign.hidden], *options, config=EXACT
        )
    return record_of(campaign, done, free)


def record_of(campaign: Campaign, done: Identified, free: Identified | None) -> Record:
    """Return what became of a campaign, and of a free map where one was identified."""
    fit = done.fit
    record: Record = {
        "verdict": done.verdict,
        "why": done.why,
        "free_verdict": free and free.verdict,
        "noted": "; ".join(one.noted for one in (done, free) if one and one.noted),
        "text": campaign.description,
        "seconds": done.seconds,
    }
    if fit is None:
        return record
    map_error, band = error_and_coverage(fit, campaign.machine)
    truth, (low, high) = campaign.machine.resistance, fit.parameters["R"].interval_95
    ladder = fit.horizon.ladder
    return record | {
        "map_error": map_error,
        "band": band,
        "horizon": fit.horizon.selected,
        "error": fit.parameters["R"].value / truth - 1,
        "deviations": abs(fit.parameters["R"].value - truth) / fit.parameters["R"].std,
        "covered": bool(low <= truth <= high),
        "by_horizon": {str(r.horizon): r.parameters["R"] / truth - 1 for r in ladder},
        "std_by_horizon": {str(r.horizon): r.std["R"] / truth for r in ladder},
        "std": fit.parameters["R"].std / truth,
        "plateau": list(fit.horizon.plateau),
        "text": text_of(campaign, fit),
    }


def text_of(campaign: Campaign, fit: Fit) -> str:
    """Return what was drawn, and the terms that the structure took."""
    orders = ",".join(map(str, fit.provenance["angle_orders"])) or "-"
    terms = f"{'dU' if fit.provenance['inverter'] else '-'} {orders}"
    told = ""
    if "dead_time_voltage" in fit.parameters:
        gap = fit.parameters["dead_time_voltage"].value - campaign.dead_time_voltage
        told = f" ({1e3 * gap:+.0f} mV)"
    return f"{campaign.description}: {terms}{told}"


def line_of(draw: Record) -> str:
    """Return one line of the list."""
    free = f"free map {draw['free_verdict']}; " if draw["free_verdict"] else ""
    end = f"{free}{draw['seconds']:.0f} s" + (draw["noted"] and f"  !! {draw['noted']}")
    if "error" not in draw:
        return f"{draw['draw']:3d} {draw['text']}: {draw['verdict']}: {draw['why']}; {end}"
    best = min(draw["by_horizon"].values(), key=abs)
    return (
        f"{draw['draw']:3d} {draw['text']}, H {draw['horizon']:3d} {draw['verdict']}, "
        f"R {100 * draw['error']:+.2f} % {draw['deviations']:.1f}, best {100 * best:+.2f} %; "
        f"map {100 * draw['map_error']:.3f} %, band {100 * draw['band']:.0f} %; {end}"
    )


def print_table(draws: list[Record]) -> None:
    """Print coverage, errors, and what fixed horizons would have given."""
    good = [draw for draw in draws if draw["verdict"] in AGREED]
    if noted := sum(bool(draw["noted"]) for draw in draws):
        print(f"{noted} of {len(draws)} ended otherwise than promised or with a warning.")
    if not good:
        print(f"0 of {len(draws)} verdicts are positive.")
        return
    errors = np.abs([draw["error"] for draw in good])
    hidden = sum(draw["verdict"] == "not identifiable" for draw in draws)
    free = [draw["free_verdict"] for draw in draws if draw["free_verdict"]]
    said = free.count("not identifiable")
    covered = 100 * np.mean([draw["covered"] for draw in good])
    print(f"{len(good)} of {len(draws)} verdicts are positive, {hidden} 'not identifiable'.")
    print(f"95 % intervals of R cover in {covered:.1f} % of them;")
    print(
        f"|error of R|: median {100 * np.median(errors):.2f} %, 95th percentile "
        f"{100 * np.quantile(errors, 0.95):.2f} %."
    )
    print(f"Unconstrained map, one speed: 'not identifiable' in {said} of {len(free)}.")
    maps, bands = (np.array([draw[key] for draw in good]) for key in ("map_error", "band"))
    print(
        f"Map: error {100 * np.median(maps):.4f} % of the largest |psi| in the median, "
        f"{100 * np.quantile(maps, 0.95):.3f} % at the 95th percentile; its band covers "
        f"{100 * np.mean(bands):.1f} % of the grid."
    )
    widths = [1.96 * draw["std"] for draw in good]
    print(f"Half width of the interval of R: median {100 * np.median(widths):.2f} %.")
    best = [min(map(abs, draw["by_horizon"].values())) for draw in good]
    ratio = np.median((errors / np.maximum(best, 1e-12)) ** 2)
    print(f"Squared error over that of the best rung: median {ratio:.1f}.")
    print("                median    root mean square    95th percentile    mean log error")
    print(_summary("reported", errors))
    horizons = Counter(h for draw in good for h in draw["by_horizon"])
    for h in sorted((h for h, count in horizons.items() if 2 * count > len(good)), key=int):
        reached = [draw["by_horizon"][h] for draw in good if h in draw["by_horizon"]]
        told = f"  ({len(reached)} draws)" if len(reached) < len(good) else ""
        print(_summary(f"H = {h}", np.abs(reached)) + told)


def _summary(name: str, errors: FloatArray) -> str:
    half, most = np.quantile(errors, [0.5, 0.95])
    square = np.sqrt(np.mean(errors**2))
    return (
        f"{name:12s} {100 * half:7.2f} % {100 * square:17.2f} % {100 * most:16.2f} % "
        f"{_mean_log(errors):17.2f}"
    )


def _mean_log(errors: FloatArray) -> float:
    return float(np.mean(np.log(np.maximum(errors, 1e-6))))


if __name__ == "__main__":
    run_draws("horizon_choice", COUNT, result_of, line_of, print_table)
