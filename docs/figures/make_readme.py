"""Draw the README's picture: python docs/figures/make_readme.py."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import PathPatch
from matplotlib.ticker import MaxNLocator
from scipy.ndimage import gaussian_filter

from penode.bench import TRACTION_300A, Lissajous, simulate
from penode.pmsm import Study, identify

INK, BLUE, RED = "#222831", "#1768ac", "#c8553d"
KINDS = (("mlp", RED, "unconstrained network"), ("coenergy", BLUE, "reciprocal map (default)"))


def record_and_identify() -> tuple:
    """Return the simulated recording, and a fit with each kind of map."""
    run = simulate(TRACTION_300A, Lissajous(240.0, 14.0, 15.0), speed_rpm=1500.0, duration=2.0)
    return run, [identify([run], study=Study(flux_map=kind)) for kind, _, _ in KINDS]


def draw_ladders(axes, ladders) -> None:
    """Draw R over the rungs of each kind of map, with the truth."""
    for (_, colour, label), ladder in zip(KINDS, ladders, strict=True):
        values = [1e3 * rung.parameters["R"] for rung in ladder]
        bars = [1.96e3 * rung.std["R"] for rung in ladder]
        horizons = [rung.horizon for rung in ladder]
        axes.errorbar(
            horizons, values, bars, color=colour, marker="o", ms=4, capsize=2, label=label
        )
    axes.axhline(1e3 * TRACTION_300A.resistance, color=INK, lw=1, ls="--", label="truth")
    axes.axhline(0, color="0.8", lw=0.8, zorder=0)
    axes.set(xscale="log", xlabel="integration horizon H (samples)", ylabel="estimated R (mΩ)")
    axes.legend(frameon=False, fontsize=9)


def draw_map(axes, fit) -> None:
    """Draw psi_d and psi_q, cut along the smoothed border of the excited region."""
    axis = np.linspace(-260, 260, 261)
    i_d, i_q = np.meshgrid(axis, axis)
    inside = fit.supported(np.column_stack([i_d.ravel(), i_q.ravel()])).reshape(i_d.shape)
    smooth = gaussian_filter(inside.astype(np.float64), 4.0)
    psi = 1e3 * fit.flux_map(i_d, i_q)
    border = axes.contour(i_d, i_q, smooth, [0.5], colors=INK, linewidths=0.8)
    region = PathPatch(border.get_paths()[0], transform=axes.transData)
    levels = [MaxNLocator(14).tick_values(*np.percentile(one[inside], (0, 100))) for one in psi]
    filled = axes.contourf(i_d, i_q, psi[0], levels[0], cmap="Blues", extend="both")
    lines = axes.contour(i_d, i_q, psi[1], levels[1][::2], colors=INK, linewidths=0.7)
    for drawn in (filled, lines):
        drawn.set_clip_path(region)
    for label in axes.clabel(lines, fontsize=7):
        label.set_visible(_covers(inside, axis, label))
    plt.colorbar(filled, ax=axes, label="ψ_d (mVs)", shrink=0.85)
    axes.set(xlabel="i_d (A)", ylabel="i_q (A)", aspect="equal")
    axes.set_title("Identified ψ_d (colour) and ψ_q (lines, mVs)", loc="left", fontsize=10)


def _covers(inside, axis, label) -> bool:
    """Return whether a label of a line stands within the region."""
    x, y = np.abs(axis[:, None] - label.get_position()).argmin(axis=0)
    return bool(inside[y, x])


def main() -> None:
    """Simulate, identify twice, draw."""
    _, fits = record_and_identify()
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.4), layout="constrained")
    draw_ladders(left, [fit.horizon.ladder for fit in fits])
    left.set_title("The horizon decides where the map leaves R free", loc="left", fontsize=10)
    draw_map(right, fits[-1])
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(Path(__file__).with_name("readme.png"), dpi=130)


if __name__ == "__main__":
    main()
