"""One picture of what recordings cover: currents in the dq plane, their lengths, the speeds."""

import io

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, MaxNLocator

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.pmsm.precheck.excitation import Excitation
from penode.pmsm.precheck.identifiability import Identifiability
from penode.report import palette

_INK, _MUTED = palette.INK.light, palette.MUTED.light
_HULL = "#c8553d"
_LINES = ("#1768ac", "#c8553d", "#7a4fb5", "#14734f", "#8f5a00")
_CELLS, _BARS, _POINTS = 48, 24, 4000
_TO_HZ = 1 / (2 * np.pi)
#: What the maps of the profiles are called.
_MAPS = {
    "reciprocal": "reciprocal map, such as coenergy",
    "unconstrained": "any map, for comparison",
}


def check_picture(
    recordings: tuple[Experiment, ...], excitation: Excitation, identifiability: Identifiability
) -> bytes:
    """Return a PNG of what recordings cover, and of how well they determine R.

    Left the visited currents with their hull, coloured by the time spent; right the time over
    the length of the current, the speeds over time, and the profile of R.
    """
    figure = Figure(figsize=(11, 8), layout="constrained")
    panels = figure.subplot_mosaic(
        [["plane", "length"], ["plane", "speed"], ["plane", "profile"]], width_ratios=(1.2, 1)
    )
    image = _draw_plane(panels["plane"], recordings, excitation)
    figure.colorbar(
        image,
        ax=panels["plane"],
        label="time spent in a cell (ms)",
        location="bottom",
        shrink=0.8,
    )
    _draw_lengths(panels["length"], recordings, excitation.largest_current)
    _draw_speeds(panels["speed"], recordings)
    _draw_profiles(panels["profile"], identifiability)
    for axes in panels.values():
        axes.spines[["top", "right"]].set_visible(False)
    names = ", ".join(e.name for e in recordings)
    figure.suptitle(names, x=0.01, ha="left", fontsize=11)
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=110)
    return content.getvalue()


def _times(recordings: tuple[Experiment, ...]) -> FloatArray:
    """Return the time in ms of each sample of all recordings."""
    return np.concatenate([np.full(len(e), 1e3 * e.time_step) for e in recordings])


def _draw_plane(axes: Axes, recordings: tuple[Experiment, ...], excitation: Excitation) -> QuadMesh:
    limit = 1.05 * excitation.largest_current
    currents = np.concatenate([e.stack(("i_d", "i_q")) for e in recordings])
    edges = np.linspace(-limit, limit, _CELLS + 1)
    spent, _, _ = np.histogram2d(
        currents[:, 0], currents[:, 1], bins=[edges, edges], weights=_times(recordings)
    )
    shown = np.where(spent > 0, spent, np.nan).T
    least, most = float(np.nanmin(shown)), float(np.nanmax(shown))
    scale = LogNorm(0.2 * least, max(most, 2 * least))  # a fifth: the palest colours are not seen
    image = axes.pcolormesh(edges, edges, shown, cmap="Blues", norm=scale)
    angle = np.linspace(-np.pi, np.pi, 181)
    largest = excitation.largest_current
    axes.plot(largest * np.cos(angle), largest * np.sin(angle), color=_MUTED, lw=0.8)
    if len(excitation.hull):
        closed = np.vstack([excitation.hull, excitation.hull[:1]])
        axes.plot(*closed.T, color=_HULL, lw=1.4)
    holes, named = excitation.holes, ""
    if holes.inside.any():
        inside = holes.inside.T.astype(float)
        axes.contourf(holes.axis, holes.axis, inside, [0.5, 1.5], colors="none", hatches=["///"])
        named = f", {100 * holes.fraction:.0f} % of it holes (hatched)"
    axes.axhline(0, color=_MUTED, lw=0.5)
    axes.axvline(0, color=_MUTED, lw=0.5)
    axes.set(aspect="equal", xlabel="i_d (A)", ylabel="i_q (A)")
    title = f"Currents visited; hull (red) {100 * excitation.fraction:.0f} % of the disc{named}"
    axes.set_title(title, loc="left", fontsize=10)
    return image


def _draw_lengths(axes: Axes, recordings: tuple[Experiment, ...], largest: float) -> None:
    currents = np.concatenate([e.stack(("i_d", "i_q")) for e in recordings])
    spent = _times(recordings) / 1e3
    axes.hist(np.hypot(*currents.T), bins=_BARS, range=(0, largest), weights=spent, color=_LINES[0])
    axes.set(xlabel="amplitude of the current (A)", ylabel="time (s)", xlim=(0, largest))
    axes.set_title("Time spent by amplitude", loc="left", fontsize=10)


def _draw_speeds(axes: Axes, recordings: tuple[Experiment, ...]) -> None:
    for k, experiment in enumerate(recordings):
        every = max(len(experiment) // _POINTS, 1)
        time = np.arange(len(experiment))[::every] * experiment.time_step
        speed = experiment.channels["omega_el"][::every] * _TO_HZ
        axes.plot(time, speed, color=_LINES[k % len(_LINES)], lw=1.2, label=experiment.name)
    low, high = axes.get_ylim()
    axes.set(
        xlabel="time (s)",
        ylabel="electrical frequency (Hz)",
        ylim=(1.1 * min(low, 0), 1.1 * max(high, 0)),
    )
    axes.yaxis.set_major_locator(MaxNLocator(5))
    axes.axhline(0, color=_MUTED, lw=0.5)
    if len(recordings) > 1:
        axes.legend(fontsize=8, frameon=False)
    axes.set_title("Speed", loc="left", fontsize=10)


def _draw_profiles(axes: Axes, identifiability: Identifiability) -> None:
    """Draw what the balance loses with R held: a flat curve does not determine R."""
    chosen = next(p for p in identifiability.profiles if (p.flux_map == "reciprocal"))
    reach = max(1.5 * abs(chosen.resistance), 1e-4)
    resistance = chosen.resistance + np.linspace(-reach, reach, 301)
    for profile, colour in zip(identifiability.profiles, _LINES, strict=False):
        factor = 1 + profile.rise(resistance)
        axes.semilogy(1e3 * resistance, factor, color=colour, lw=1.6, label=_MAPS[profile.flux_map])
    axes.set(xlabel="R held at (mΩ)", ylabel="residual / least residual")
    for set_formatter in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
        set_formatter(LogFormatter(minor_thresholds=(1.0, 0.4)))
    axes.set_ylim(bottom=1)
    axes.legend(fontsize=8, frameon=False)
    title = "Profile of R: a map whose curve is flat cannot determine it"
    axes.set_title(title, loc="left", fontsize=10)
