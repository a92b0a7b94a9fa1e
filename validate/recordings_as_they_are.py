"""Recordings as they are: ``python -m validate.recordings_as_they_are [DRAWS] [PART]``.

A pendulum is recorded with noise of 0.01 rad. Where 2 % of the samples are outliers of 20 noise
deviations (part ``outliers``), it is fitted by least squares and with noise of Student's t
distribution; it is recorded at 10 ms and at 50 ms too (part ``time_steps``), and by the height of
its tip alone, which has one value for two angles (part ``starts``: each window estimates its own,
or an encoder of 12 samples with 8 neurons knows them all). Printed are the median
deviation of each parameter over that of the first line, and how many of the 95 % intervals contain
the truth.
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np

from penode import Experiment, Fit, Model, identify, physical
from penode.arrays import Leaf
from penode.engine import Encoded, StudentT, default_plan

TRUTH = {"pull": 30.0, "damping": 0.4}
NOISE, SHARE, FAR = 0.01, 0.02, 20.0
#: Longest step of the simulation in s.
_FINE = 0.0025


class Pendulum(Model):
    """A pendulum whose angle is measured."""

    states: ClassVar = ("angle", "rate")
    inputs: ClassVar = ("torque",)
    state_units: ClassVar = ("rad", "rad/s")
    unmeasured: ClassVar = ("rate",)

    pull: Leaf = physical("1/s2")
    damping: Leaf = physical("1/s")

    def derivative(self, x, u):  # type: ignore[no-untyped-def]
        """Return the rates, (state, batch)."""
        return jnp.stack([x[1], u[0] - self.pull * jnp.sin(x[0]) - self.damping * x[1]])


class Tip(Pendulum):
    """A pendulum with a bent rod, the height of whose tip is measured."""

    unmeasured: ClassVar = ()
    outputs: ClassVar = {"height": "m"}

    def output(self, x, u):  # type: ignore[no-untyped-def]
        """Return the height, (1, batch)."""
        return _height(x[:1])


def _height(angle: Any) -> Any:
    return 0.5 * (1.0 - jnp.cos(angle)) + 0.2 * jnp.sin(angle)


def _rate(x: np.ndarray, torque: float) -> np.ndarray:
    return np.array([x[1], torque - TRUTH["pull"] * np.sin(x[0]) - TRUTH["damping"] * x[1]])


def recorded(name: str, step: float, count: int, seed: int) -> Experiment:
    """Return a recording whose torque changes every fourth sample."""
    random = np.random.default_rng(seed)
    torque = 8.0 * random.normal(size=count // 4 + 1).repeat(4)[:count]
    path, parts = [np.array([0.3, 0.0])], round(step / _FINE)
    for now in torque[:-1]:
        x, h = path[-1], step / parts
        for _ in range(parts):
            a = _rate(x, now)
            b = _rate(x + h / 2 * a, now)
            c = _rate(x + h / 2 * b, now)
            x = x + h / 6 * (a + 2 * b + 2 * c + _rate(x + h * c, now))
        path.append(x)
    angle = np.array(path)[:, 0] + NOISE * random.normal(size=count)
    return Experiment(name, step, {"angle": angle, "torque": torque})


def with_outliers(run: Experiment, seed: int) -> Experiment:
    """Return a recording some of whose samples are far off."""
    random = np.random.default_rng([seed, 1])
    off = random.random(len(run)) < SHARE
    size = FAR * NOISE * off * random.choice([-1.0, 1.0], len(run))
    return replace(run, channels={**run.channels, "angle": run.channels["angle"] + size})


def fitted(runs: Sequence[Experiment], noise: StudentT | None = None) -> Fit:
    """Return a fit with the default plan."""
    start = Pendulum(pull=25.0, damping=0.6)
    plan = default_plan(start, runs)
    return identify(start, runs, plan=replace(plan, loss=replace(plan.loss, noise=noise)))


def outliers(seed: int) -> dict[str, Fit]:
    """Return fits of a recording of 20 s, without outliers first."""
    run = recorded("run", 0.02, 1000, seed)
    bad = with_outliers(run, seed)
    return {
        "squares, no outliers": fitted([run]),
        "squares, outliers": fitted([bad]),
        "Student's t, no outliers": fitted([run], StudentT()),
        "Student's t, outliers": fitted([bad], StudentT()),
    }


def time_steps(seed: int) -> dict[str, Fit]:
    """Return fits of 10 s at 10 ms and of 10 s at 50 ms, of the first alone first."""
    fast, slow = recorded("fast", 0.01, 1000, 100 + seed), recorded("slow", 0.05, 200, seed)
    return {"10 ms": fitted([fast]), "50 ms": fitted([slow]), "both": fitted([fast, slow])}


def starts(seed: int) -> dict[str, Fit]:
    """Return fits of 80 s of height, an encoder's first."""
    run = recorded("run", 0.02, 4000, 200 + seed)
    height = np.asarray(_height(run.channels["angle"]), dtype=float)
    seen = replace(run, channels={"height": height, "torque": run.channels["torque"]})
    model = Tip(pull=25.0, damping=0.6)
    models = {"an encoder": Encoded(model, [seen], past=12, neurons=8), "each its own": model}
    return {name: identify(one, [seen]) for name, one in models.items()}


PARTS = {"outliers": outliers, "time_steps": time_steps, "starts": starts}


def print_table(cases: dict[str, list[Fit]]) -> None:
    """Print deviations over those of the first case, and coverage."""
    first = next(iter(cases.values()))
    for name, fits in cases.items():
        said, inside = [], 0
        for parameter, true in TRUTH.items():
            pairs = zip(fits, first, strict=True)
            wider = [a.parameters[parameter].std / b.parameters[parameter].std for a, b in pairs]
            said.append(f"{parameter} {np.median(wider):.2f}")
            for low, high in (fit.parameters[parameter].interval_95 for fit in fits):
                inside += low < true < high
        answered = sum(fit.horizon.verdict == "plateau" for fit in fits)
        print(
            f"{name:26s} deviation {', '.join(said)}; covered {inside} of {2 * len(fits)}; "
            f"plateau {answered} of {len(fits)}",
            flush=True,
        )


def main() -> None:
    """Print the table of each part."""
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    for part in sys.argv[2:] or PARTS:
        cases: dict[str, list[Fit]] = {}
        for seed in range(draws):
            for name, fit in PARTS[part](seed).items():
                cases.setdefault(name, []).append(fit)
        print_table(cases)


if __name__ == "__main__":
    main()
