"""The horizon chosen and the interval given, over machines and drives drawn at random.

``python -m validate.horizon_choice [COUNT] [FIRST]``: each draw is identified with default
settings, nothing told. Printed are, draw by draw, the terms the structure took, the horizon and the
verdict, the error of R and of the dead-time voltage in per cent and in deviations, and the error of
R at the rung of least error. An unconstrained map at one speed, on a slow trajectory, must be
called not identifiable. Ctrl-C prints the table of the draws so far.
"""

import sys
import time
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.pmsm.study import Study, identify
from penode.training.fit import Fit
from validate.drawn_recordings import Campaign, draw_campaign

COUNT = 200
POSITIVE = ("plateau", "H = 1 suffices")


@dataclass(frozen=True, eq=False)
class Draw:
    """One identified campaign.

    Attributes
    ----------
    fit : Fit
    truth : float
        R in ohm.
    free_verdict : str
        Of an unconstrained map of the same machine at one speed, on a slow trajectory.
    """

    fit: Fit
    truth: float
    free_verdict: str

    @property
    def positive(self) -> bool:
        """Whether the verdict stands behind the number."""
        return self.fit.horizon.verdict in POSITIVE

    @property
    def error(self) -> float:
        """Relative error of R."""
        return self.fit.parameters["R"].value / self.truth - 1

    @property
    def covered(self) -> bool:
        """Whether the 95 % interval holds the true R."""
        low, high = self.fit.parameters["R"].interval_95
        return low <= self.truth <= high

    @property
    def by_horizon(self) -> dict[int, float]:
        """Relative error of R at each rung."""
        ladder = self.fit.horizon.ladder
        return {rung.horizon: rung.parameters["R"] / self.truth - 1 for rung in ladder}


def draw_of(campaign: Campaign) -> Draw:
    """Identify one campaign."""
    fit = identify(campaign.runs)
    free = identify([campaign.hidden], study=Study("mlp", horizon=1))
    return Draw(fit, campaign.machine.resistance, free.horizon.verdict)


def print_draw(number: int, campaign: Campaign, draw: Draw, seconds: float) -> None:
    """Print one line."""
    fit, resistance = draw.fit, draw.fit.parameters["R"]
    orders = ",".join(map(str, fit.provenance["angle_orders"])) or "-"
    terms = f"{'dU' if fit.provenance['inverter'] else '-'} {orders}"
    best = min(draw.by_horizon.values(), key=abs)
    off = abs(resistance.value - draw.truth) / resistance.std
    told = ""
    if "dead_time_voltage" in fit.parameters:
        gap = fit.parameters["dead_time_voltage"].value - campaign.dead_time_voltage
        told = f"dU {1e3 * gap:+5.0f} mV, "
    print(
        f"{number:3d} {campaign.description}: {terms:7s} H {fit.horizon.selected:3d} "
        f"{fit.horizon.verdict:14s} R {100 * draw.error:+6.2f} % {off:4.1f}, {told}"
        f"best {100 * best:+6.2f} %; free map {draw.free_verdict}; {seconds:.0f} s",
        flush=True,
    )


def print_table(draws: list[Draw]) -> None:
    """Print coverage, errors, and what fixed horizons would have given."""
    good = [draw for draw in draws if draw.positive]
    errors = np.abs([draw.error for draw in good])
    hidden = sum(draw.fit.horizon.verdict == "not identifiable" for draw in draws)
    said = sum(draw.free_verdict == "not identifiable" for draw in draws)
    print(f"{len(good)} of {len(draws)} verdicts are positive, {hidden} 'not identifiable'.")
    print(f"95 % intervals of R cover in {100 * np.mean([d.covered for d in good]):.0f} % of them;")
    print(
        f"|error of R|: median {100 * np.median(errors):.2f} %, 95th percentile "
        f"{100 * np.quantile(errors, 0.95):.2f} %."
    )
    print(f"Unconstrained map, one speed: 'not identifiable' in {said} of {len(draws)}.")
    best = [min(map(abs, draw.by_horizon.values())) for draw in good]
    ratio = np.median((errors / np.maximum(best, 1e-12)) ** 2)
    print(f"Squared error over that of the best rung: median {ratio:.1f}.")
    print(f"Mean log error: selected {_mean_log(errors):.2f}, " + _fixed(good))


def _fixed(draws: list[Draw]) -> str:
    common = set.intersection(*(set(draw.by_horizon) for draw in draws))
    means = {h: _mean_log(np.abs([d.by_horizon[h] for d in draws])) for h in sorted(common)}
    return ", ".join(f"H = {h} {mean:.2f}" for h, mean in means.items()) + "."


def _mean_log(errors: FloatArray) -> float:
    return float(np.mean(np.log(np.maximum(errors, 1e-6))))


def main() -> None:
    """Print a line a draw, then the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else COUNT
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    draws = []
    with suppress(KeyboardInterrupt):
        for number in range(first, first + count):
            campaign, began = draw_campaign(number), time.perf_counter()
            draws.append(draw_of(campaign))
            print_draw(number, campaign, draws[-1], time.perf_counter() - began)
    print_table(draws)


if __name__ == "__main__":
    main()
