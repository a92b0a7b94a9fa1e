"""Sections of a fit's report: functions of a fit, None where there is nothing to show."""

import math
from collections.abc import Mapping, Sequence

from penode.fit.fit import Fit
from penode.report.correlations import correlations, correlations_caption, correlations_title
from penode.report.document import Block, Notice, Section, picture
from penode.report.ladder import parameter_over_ladder
from penode.report.learned_maps import map_figures
from penode.report.loss_weighting import weighting_of, weighting_section
from penode.report.over_channel import over_channel, over_channel_title
from penode.report.overlay import overlay
from penode.report.spectrum import residual_spectrum
from penode.report.statements import (
    ladder_title,
    listed,
    overlay_title,
    relative_error,
    spectrum_title,
)
from penode.report.tables import (
    correlation_table,
    ladder_table,
    measured_states,
    parameter_table,
    provenance_table,
    validation_table,
)
from penode.validation.comparison import Comparison

#: Recordings drawn at most, so that the page stays small; the table holds all.
_DRAWN = 8
#: Inputs over whose values the residual is drawn, and how to read the figure.
_OVER = 3
_OVER_CAPTION = (
    "One-step residual along the value of a channel at the same sample, in stretches of its range. "
    "A mean beyond chance, four deviations of that of independent samples, is something the model "
    "lacks that goes with the channel; an rms that changes, noise or ripple that does."
)
#: What became of it behind the ladder, where operating points or a torque were given.
_MOVED = ", after {name} has moved and narrowed it"


def parameters(fit: Fit) -> Section | None:
    """Return the section on the physical parameters over the horizons."""
    if not fit.parameters:
        return None
    # Points of one objective with the recordings are in every bar, and their distance is known.
    points = fit.stationary
    moved = _MOVED.format(name=points.name) if points and math.isnan(points.distance) else ""
    figures = [
        picture(
            ladder_title(fit, name),
            "Each point is a complete identification at one horizon, its bar 1.96 standard "
            "deviations. Where neighbouring points agree, the value no longer depends on how "
            "far ahead the model predicted; that is the plateau. Shaded blue is the 95 % "
            "interval that the data show: around the value reported, widened by the spread "
            f"between horizons{moved}. The interval of the answer is wider by the other rows of "
            f"the uncertainty budget.{_without_interval(fit, name)}",
            parameter_over_ladder,
            fit,
            name,
        )
        for name in (fit.parameters if fit.horizon.ladder else ())
    ]
    return Section(
        "Parameters over the horizon",
        "At a short horizon unmodelled ripple and sensor noise can bias a parameter; a longer one "
        "averages them out. The right value is the one neighbouring horizons agree on.",
        [parameter_table(fit), *correlations_of(fit), *figures],
    )


def _without_interval(fit: Fit, name: str) -> str:
    """Return what a point without a bar is, where there is one."""
    known = (rung.std[name] for rung in fit.horizon.ladder if name in rung.std)
    if all(map(math.isfinite, known)):
        return ""
    return " A point without a bar has no interval, and no weight."


def correlations_of(fit: Fit) -> list[Block]:
    """Return the table of the parameters' correlations, where there are two or more."""
    return [correlation_table(fit)] if len(fit.covariance) > 1 else []


def learned_maps(fit: Fit) -> Section | None:
    """Return the section on the learned maps over the states."""
    names = list(fit.model.maps())
    if not names:
        return None
    figures = {name: map_figures(fit, name) for name in names}
    blocks: list[Block] = [figure for of_map in figures.values() for figure in of_map]
    absent = [name for name, of_map in figures.items() if not of_map]
    if absent:
        states = listed(fit.model.states)
        text = (
            f"{listed(absent)}: drawn are maps of one or two states, whose arguments are named "
            f"after them ({states})."
        )
        blocks.append(Notice("caution", "Not drawn", text))
    return Section(
        "Learned maps",
        "What the data say of the part of the equation that has no formula, where the recordings "
        "support it.",
        blocks,
    )


def predictions(fit: Fit) -> Section | None:
    """Return the section on predictions beside measurements."""
    if not fit.comparisons:
        return None
    ordered = _worst_first(fit.comparisons)
    figures = [
        picture(
            overlay_title(one),
            "What was measured (wide grey), the free run and the prediction one step ahead, each "
            "with its error. The close-up is a typical stretch, shaded in the whole.",
            overlay,
            one,
        )
        for one in ordered[:_DRAWN]
    ]
    inputs = f"{listed(fit.model.inputs)} and " if fit.model.inputs else ""
    start = f"the first sample of {listed(ordered[0].states)}"
    if fit.initial_states:
        start = "the initial state that fits it best"
    return Section(
        "Prediction against measurement",
        f"In a free run the model sees {inputs}{start}, nothing else. Recordings not used for "
        "training count most, and those with the largest errors come first.",
        [validation_table(_worst_first(fit.recordings)), *figures],
    )


def _worst_first(comparisons: Sequence[Comparison]) -> list[Comparison]:
    return sorted(comparisons, key=lambda one: (one.role != "validation", -relative_error(one)))


def residual_section(
    fit: Fit,
    lines: Sequence[tuple[float, str]] = (),
    cause: str = "",
    note: str = "",
    over: Mapping[str, str] | None = None,
) -> Section | None:
    """Return the section on the one-step residual, named frequencies (Hz, name) marked.

    ``cause`` and ``note`` are added to the lead and to the caption; ``over`` are channels over
    whose values the residual is drawn with their units, by default the first inputs that move.
    None where no recording is predicted one step ahead.
    """
    states, spectrum = measured_states(fit.comparisons), fit.spectrum
    blocks: list[Block] = []
    if states and any(math.isfinite(value) for value in spectrum.amplitude.ravel()):
        caption = (
            f"Amplitude spectrum of the one-step residual of {spectrum.recording}; of "
            f"neighbouring frequencies the largest is drawn. {note}"
        )
        title = spectrum_title(spectrum, states, lines)
        blocks.append(picture(title, caption.rstrip(), residual_spectrum, spectrum, states, lines))
    tests = fit.correlations
    if tests.own.size:
        title, caption = correlations_title(tests), correlations_caption(tests)
        blocks.append(picture(title, caption, correlations, tests))
        chosen = dict.fromkeys(tests.inputs[:_OVER], "") if over is None else over
        shown = [one for one in tests.over if one.channel in chosen]
        if shown:
            title = over_channel_title(shown)
            blocks.append(
                picture(
                    title, _OVER_CAPTION, over_channel, tests, shown, {**dict(states), **chosen}
                )
            )
    lead = (
        "Noise of the sensors gives a floor that rises with the frequency. A line is something "
        "periodic that the model lacks, "
        f"and a rise towards low frequencies a slow error of the map or a parameter. {cause}"
    )
    return Section("What the model does not explain", lead.rstrip(), blocks) if blocks else None


def loss_weighting(fit: Fit) -> Section | None:
    """Return the section on how each horizon weighs the residual."""
    view = weighting_of(fit)
    return None if view is None else weighting_section(view, fit.comparisons[0].units)


def horizons(fit: Fit) -> Section | None:
    """Return the section with the table of all horizons."""
    if not fit.horizon.ladder:
        return None
    units = {name: estimate.unit for name, estimate in fit.parameters.items()}
    table = ladder_table(fit.horizon, units, measured_states(fit.comparisons))
    return Section("All horizons", "The numbers behind the choice of the horizon.", [table])


def provenance(fit: Fit) -> Section | None:
    """Return the section on versions, data and settings."""
    lead = "What it takes to repeat this identification."
    return Section("Provenance", lead, [provenance_table(fit.provenance)])
