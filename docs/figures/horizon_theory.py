"""Draw the pictures of docs/theory/horizon.md: python docs/figures/horizon_theory.py.

One small machine, linear but for a ripple of the sixth order that no model here has, and one lag.
"""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

from penode import (
    Contiguous,
    Experiment,
    Jittered,
    Model,
    Predictor,
    ladder_plan,
    parameter,
    physical,
)
from penode.arrays import Leaf
from penode.engine import LevenbergMarquardt, compare, cut
from penode.horizon.ladder import LadderProblem
from penode.horizon.loss_weighting import linearised, loss_weighting
from penode.training.covariance import Reported
from penode.training.plan import Problem
from penode.training.residuals import Objective

INK, BLUE, RED, GREEN, GREY = "#222831", "#1768ac", "#c8553d", "#13694e", "#aab4c0"
R, L_D, L_Q, PSI = 10e-3, 180e-6, 450e-6, 58e-3
STEP, SAMPLES, RIPPLE = 1e-4, 16_000, 17  # the ripple's period is 17 samples
OMEGA = 2 * np.pi / (6 * RIPPLE * STEP)


class Matrix(Model):
    """u = R i + omega J psi + d psi/dt with psi = L i + psi_PM, L any matrix or a symmetric one."""

    states: ClassVar[tuple[str, ...]] = ("i_d", "i_q")
    inputs: ClassVar[tuple[str, ...]] = ("u_d", "u_q", "omega_el")
    state_units: ClassVar[tuple[str, ...]] = ("A", "A")

    R: Leaf = physical("ohm")
    d: Leaf = parameter(unit="H", group="map")
    q: Leaf = parameter(unit="H", group="map")
    cross: Leaf = parameter(unit="H", group="map")
    psi: Leaf = parameter(unit="Vs", group="map")
    skew: Leaf = parameter(unit="H", group="skew")

    def derivative(self, x, u):
        """Return di/dt in A/s."""
        high, low = self.cross - self.skew, self.cross + self.skew
        psi_d = self.d * x[0] + high * x[1] + self.psi
        psi_q = low * x[0] + self.q * x[1]
        v_d, v_q = u[0] - self.R * x[0] + u[2] * psi_q, u[1] - self.R * x[1] - u[2] * psi_d
        determinant = self.d * self.q - high * low
        return jnp.stack([self.q * v_d - high * v_q, self.d * v_q - low * v_d]) / determinant


class Lag(Model):
    """x' = b u - a x."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("K",)

    a: Leaf = physical("1/s")
    b: Leaf = physical("K/s")

    def derivative(self, x, u):
        """Return dx/dt in K/s."""
        return jnp.stack([self.b * u[0] - self.a * x[0]])


def recording() -> Experiment:
    """Return a slow trajectory at one speed, with a ripple of induced voltage that follows i_q."""
    time = STEP * np.arange(SAMPLES)
    goal = np.stack([-120 + 90 * np.sin(14 * time), 180 * np.sin(15 * time)])
    slope = np.gradient(goal, STEP, axis=1)
    u_d = R * goal[0] - OMEGA * L_Q * goal[1] + L_D * slope[0]
    u_q = R * goal[1] + OMEGA * (L_D * goal[0] + PSI) + L_Q * slope[1]

    def rate(i, k, t):
        ripple = 2e-5 * OMEGA * np.array([np.cos(6 * OMEGA * t), np.sin(6 * OMEGA * t)])
        e_d, e_q = ripple * (200.0 + i[1])
        v_d = u_d[k] - R * i[0] + OMEGA * L_Q * i[1] - e_d
        v_q = u_q[k] - R * i[1] - OMEGA * (L_D * i[0] + PSI) - e_q
        return np.array([v_d / L_D, v_q / L_Q])

    i, h = [goal[:, 0]], STEP / 4
    for k in range(SAMPLES - 1):
        x = i[-1]
        for part in range(4):
            t = k * STEP + part * h
            a = rate(x, k, t)
            b = rate(x + h / 2 * a, k, t + h / 2)
            c = rate(x + h / 2 * b, k, t + h / 2)
            x = x + h / 6 * (a + 2 * b + 2 * c + rate(x + h * c, k, t + h))
        i.append(x)
    i_d, i_q = np.array(i).T
    speed = np.full(SAMPLES, OMEGA)
    channels = {"i_d": i_d, "i_q": i_q, "u_d": u_d, "u_q": u_q, "omega_el": speed}
    return Experiment("ripple", STEP, channels)


def truth() -> Matrix:
    """Return the machine without its ripple."""
    return Matrix(R, L_D, L_Q, 0.0, PSI, 0.0)


def draw_prefilter(run: Experiment) -> plt.Figure:
    """Draw the residual of the true machine and the weight of three horizons over it."""
    predictor, machine = Predictor(STEP), truth()
    matrices = linearised(predictor, machine, run, np.ones(2))
    base = OMEGA / (2 * np.pi)
    view = loss_weighting(compare(predictor, machine, run), matrices, (1, 17, 100), base)
    figure, (top, bottom) = plt.subplots(2, 1, figsize=(8, 5), sharex=True, layout="constrained")
    order = view.frequency / base
    top.semilogy(order, np.sqrt(view.power[:, 0]), color=GREY, lw=0.8)
    for line in view.lines[:5]:
        top.annotate(
            f"{line.order:.0f}".replace("-0", "0").replace("-", "−"),
            (line.order, line.amplitude),
            ha="center",
            va="bottom",
            color=INK,
        )
    for horizon, weight, colour in zip(
        view.horizons, view.weight[:, :, 0], (BLUE, RED, GREEN), strict=True
    ):
        bottom.semilogy(order, weight / weight.mean(), color=colour, label=f"H = {horizon}")
    bottom.axvline(-1, color=INK, lw=0.8, ls="--")
    bottom.set(xlabel="frequency over the electrical frequency, in dq", xlim=(-14, 14))
    top.set(ylabel="one-step residual (A)", ylim=(1e-6, None))
    bottom.set(ylabel="weight over its mean")
    top.set_title("The residual has lines; long horizons listen at −1", loc="left", fontsize=10)
    bottom.legend(frameon=False, fontsize=9)
    return figure


def lag_bias(horizons: tuple[int, ...]) -> list[float]:
    """Return the error of a lag's rate (true 1/s) under measurement noise, by horizon."""
    random, time = np.random.default_rng(2), 1e-3 * np.arange(SAMPLES)
    u = 2.0 * np.sin(1.9 * time) + 1.5 * np.sin(0.7 * time + 1.0)
    decay, x = np.exp(-1e-3), np.zeros(SAMPLES)
    for k in range(SAMPLES - 1):
        x[k + 1] = decay * x[k] + (1 - decay) * u[k]
    noise = 0.02 * random.normal(size=SAMPLES)  # of both signs: what is linear in it cancels
    runs = [Experiment(f"{s:+}", 1e-3, {"x": x + s * noise, "u": u}) for s in (1, -1)]
    objective = Objective(Predictor(1e-3), Lag(1.0, 1.0), np.ones(1))
    reported, found = Reported(objective.layout, np.zeros((1, 1))), []
    for horizon in horizons:
        windows = cut(runs, ("x",), ("u",), horizon, placement=Contiguous())
        problem = Problem(objective, reported, windows, np.ones(2, dtype=bool))
        solution = LevenbergMarquardt(tolerance=1e-6).minimise(problem, np.ones(2))
        found.append(solution.raw[0] - 1.0)
    return found


def draw_errors_in_variables() -> plt.Figure:
    """Draw the bias of a lag's rate over the horizon beside 3 / (2 H + 1)."""
    horizons = (1, 2, 3, 5, 8, 13, 21, 34, 55)
    bias = np.array(lag_bias(horizons))
    figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
    smooth = np.geomspace(1, 55, 200)
    axes.loglog(smooth, 3 / (2 * smooth + 1), color=GREY, lw=4, label="3 / (2 H + 1)")
    axes.loglog(horizons, bias / bias[0], "o", color=BLUE, label="fitted")
    axes.set(xlabel="horizon H", ylabel="bias over that at H = 1")
    axes.set_title("Noise on the start biases less the longer H", loc="left", fontsize=10)
    axes.legend(frameon=False)
    return figure


def profile(run: Experiment, resistances: np.ndarray, groups: tuple[str, ...]) -> np.ndarray:
    """Return the loss at H = 1 with R held and the map at its best, over R."""
    objective, found = Objective(Predictor(STEP), truth(), np.ones(2)), []
    free = np.flatnonzero(objective.layout.members(groups))
    windows = cut([run], Matrix.states, Matrix.inputs, 1, placement=Contiguous())
    raw = objective.layout.raw(truth())
    for resistance in resistances:
        raw[objective.layout.names.index("R")] = resistance
        for _ in range(12):  # Gauss-Newton, from the solution at the resistance before
            terms = objective.gauss_newton(raw, windows)
            normal = terms.normal[np.ix_(free, free)]
            size = np.sqrt(np.diag(normal))
            raw[free] += (
                np.linalg.solve(normal / np.outer(size, size), terms.descent[free] / size) / size
            )
        found.append(objective.gauss_newton(raw, windows).loss)
    return np.array(found)


def draw_gauge(run: Experiment) -> plt.Figure:
    """Draw how well the best map explains the data at a wrong resistance, for both kinds of map."""
    resistances = R + 1e-3 * np.linspace(-200, 200, 21)
    figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
    for groups, colour, label in (
        (("map", "skew"), RED, "any map"),
        (("map",), BLUE, "reciprocal map"),
    ):
        loss = np.sqrt(profile(run, resistances, groups))
        axes.plot(1e3 * resistances, loss, color=colour, label=label)
    axes.axvline(1e3 * R, color=INK, lw=1, ls="--", label="truth")
    axes.set(xlabel="resistance held (mΩ)", ylabel="one-step error of the best map (A)")
    axes.set_title(
        "Any map makes up for a wrong R, a reciprocal one cannot", loc="left", fontsize=10
    )
    axes.legend(frameon=False)
    return figure


def resistances_over_ladder(run: Experiment, horizons: range, placement, groups) -> list[float]:
    """Return R in mOhm at each horizon."""
    plan = ladder_plan(list(horizons))
    stages = tuple(replace(stage, groups=groups) for stage in plan.stages)
    plan = replace(plan, placement=placement, stages=stages)
    ascent = LadderProblem.of(truth(), [run], plan, lambda event: None)
    rungs = ascent.climb(plan, ascent.objective.layout.raw(truth()))
    return [1e3 * float(rung.values[0]) for rung in rungs]


def draw_aliasing(run: Experiment) -> plt.Figure:
    """Draw R over the horizon with windows end to end and with jittered ones."""
    horizons, every = range(6, 61), ("physical", "map", "skew")
    figure, axes = plt.subplots(figsize=(8, 3.6), layout="constrained")
    for placement, groups, colour, label in (
        (Contiguous(), every, RED, "any map, windows end to end"),
        (Jittered(0), every, BLUE, "any map, jittered windows (default)"),
        (Jittered(0), every[:2], GREEN, "reciprocal map, jittered windows"),
    ):
        values = resistances_over_ladder(run, horizons, placement, groups)
        axes.plot(horizons, values, "o-", ms=3, lw=1, color=colour, label=label)
    for period in (RIPPLE, 2 * RIPPLE, 3 * RIPPLE):
        axes.axvline(period, color=GREY, lw=1, ls=":")
    axes.axhline(1e3 * R, color=INK, lw=1, ls="--", label="truth")
    axes.set(xlabel="horizon H (dotted: whole periods of the ripple)", ylabel="estimated R (mΩ)")
    axes.set_title("Windows in step with the ripple see one phase of it", loc="left", fontsize=10)
    axes.legend(frameon=False)
    return figure


def main() -> None:
    """Simulate, fit, draw."""
    run = recording()
    pictures = {
        "prefilter": draw_prefilter(run),
        "errors_in_variables": draw_errors_in_variables(),
        "gauge": draw_gauge(run),
        "aliasing": draw_aliasing(run),
    }
    for name, figure in pictures.items():
        for axes in figure.axes:
            axes.spines[["top", "right"]].set_visible(False)
        figure.savefig(Path(__file__).with_name(f"horizon_{name}.png"), dpi=110)


if __name__ == "__main__":
    main()
