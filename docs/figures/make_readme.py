"""Draw the README's picture: python docs/figures/make_readme.py."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from penode.bench import TRACTION_300A, Lissajous, simulate
from penode.pmsm import Study, identify

INK, BLUE, RED = "#222831", "#1768ac", "#c8553d"


def draw_ladders(axes, run) -> object:
    """Draw R over the ladder for both maps; return the default fit."""
    for kind, colour, label in (
        ("mlp", RED, "unconstrained network"),
        ("coenergy", BLUE, "reciprocal map (default)"),
    ):
        fit = identify([run], study=Study(flux_map=kind))
        ladder = fit.horizon.ladder
        values = [1e3 * rung.parameters["R"] for rung in ladder]
        bars = [1.96e3 * rung.std["R"] for rung in ladder]
        horizons = [rung.horizon for rung in ladder]
        axes.errorbar(
            horizons, values, bars, color=colour, marker="o", ms=4, capsize=2, label=label
        )
    axes.axhline(1e3 * TRACTION_300A.resistance, color=INK, lw=1, ls="--", label="truth")
    axes.axhline(0, color="0.8", lw=0.8, zorder=0)
    axes.set(xscale="log", xlabel="integration horizon H (steps)", ylabel="estimated R (mΩ)")
    axes.set_title("The horizon decides where the map leaves R free", loc="left", fontsize=10)
    axes.legend(frameon=False, fontsize=9)
    return fit


def draw_map(axes, fit) -> None:
    """Draw psi_d and psi_q over the excited region."""
    axis = np.linspace(-260, 260, 131)
    i_d, i_q = np.meshgrid(axis, axis)
    inside = fit.supported(np.column_stack([i_d.ravel(), i_q.ravel()])).reshape(i_d.shape)
    psi = np.where(inside, 1e3 * fit.flux_map(i_d, i_q), np.nan)
    filled = axes.contourf(i_d, i_q, psi[0], 14, cmap="Blues")
    lines = axes.contour(i_d, i_q, psi[1], 10, colors=INK, linewidths=0.7)
    axes.clabel(lines, fontsize=7)
    plt.colorbar(filled, ax=axes, label="ψ_d (mVs)", shrink=0.85)
    axes.plot(*fit.excited.T, color="white", lw=0.4, alpha=0.5)
    axes.set(xlabel="i_d (A)", ylabel="i_q (A)", aspect="equal")
    axes.set_title("Identified ψ_d (colour) and ψ_q (lines, mVs)", loc="left", fontsize=10)


def main() -> None:
    """Simulate, identify twice, draw."""
    run = simulate(TRACTION_300A, Lissajous(240.0, 14.0, 15.0), speed_rpm=1500.0, duration=2.0)
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.4), layout="constrained")
    fit = draw_ladders(left, run)
    draw_map(right, fit)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(Path(__file__).with_name("readme.png"), dpi=130)


if __name__ == "__main__":
    main()
