"""The report of a machine's identification: the answer first, then what it rests on."""

import numpy as np

from penode.fit.fit import Fit
from penode.fit.outcome import AVERAGED
from penode.pmsm.report.flux_sections import flux_linkage, inductances
from penode.pmsm.report.loss_weighting import listening
from penode.report.correlations import correlations_caption, correlations_title
from penode.report.document import Block, Document, Figure, Glossary, KeyValue, KeyValues, Section
from penode.report.figures import correlations, parameter_over_ladder, residual_spectrum
from penode.report.html import render
from penode.report.overlay import overlay
from penode.report.quantities import number, with_unit
from penode.report.statements import (
    estimate_text,
    free_run_value,
    ladder_title,
    overlay_title,
    range_text,
    spectrum_title,
    verdict_notice,
    warning_notices,
)
from penode.report.tables import ladder_table, parameter_table, provenance_table, validation_table

_MEANINGS = {"R": "stator resistance"}
_HARMONIC = 6
_LINES = 8
#: Recordings drawn at most, so that the page stays small; the table holds all.
_DRAWN = 8
_WORDS = Glossary(
    "The words used here",
    (
        ("Horizon H", "How many samples ahead the model predicts by itself during training, from "
         "the measured currents at the start and the voltages and the speed after that."),
        ("One step ahead", "Each sample predicted from the measured one before it (H = 1). Easy to "
         "do well, and therefore a weak test."),
        ("Free run", "A whole recording predicted from its first sample, without looking at the "
         "measured currents again. The hardest test: errors may add up."),
        ("Plateau", "Neighbouring horizons whose estimates agree within their uncertainty. The "
         "sign that a physical parameter is right and not an artefact of the horizon."),
        ("95 % interval", "Where the parameter lies with 95 % confidence if the model's structure "
         "is right. A wrong sensor gain or angle is not in it."),
        ("Flux-linkage map", "Flux linkage of the d and the q winding as a function of both "
         "currents; saturation and cross-coupling included."),
    ),
)  # fmt: skip


def machine_report(fit: Fit) -> str:
    """Return the report of a machine's identification as one self-contained HTML page.

    Parameters
    ----------
    fit : Fit
        Identification result of a machine: its parameters hold ``R`` in ohm, its maps are
        ``flux_map`` (Vs) and ``differential_inductance`` (H).

    Returns
    -------
    str
        The page; save it as UTF-8.
    """
    return render(machine_document(fit))


def machine_document(fit: Fit) -> Document:
    """Return the report of a machine's identification as a document.

    Parameters
    ----------
    fit : Fit
        Identification result of a machine, as for `machine_report`.

    Returns
    -------
    Document
        Title and key values, then one section for each question a reader may ask.
    """
    sections = [
        _resistance(fit),
        flux_linkage(fit),
        inductances(fit),
        _validation(fit),
        _residual(fit),
        *listening(fit),
        _horizons(fit),
        Section(
            "Provenance",
            "What it takes to repeat this identification.",
            [provenance_table(fit.provenance)],
        ),
    ]
    answer: list[Block] = [
        verdict_notice(fit.horizon),
        *warning_notices([one for one in fit.warnings if one != fit.horizon.reason]),
        _key_values(fit),
        _WORDS,
    ]
    return Document("Machine identification", _title(fit), _lead(fit), answer, sections)


def _title(fit: Fit) -> str:
    if not fit.horizon.answered:
        return "These recordings cannot tell the stator resistance"
    return f"The stator resistance is {estimate_text(fit.parameters['R'])[0]}"


def _lead(fit: Fit) -> str:
    _, interval = estimate_text(fit.parameters["R"])
    names = [one.name for one in fit.comparisons if one.role == "train"]
    source = "the training recordings"
    if len(names) == 1:
        source = names[0]
    elif names:
        source = f"{len(names)} recordings"
    subject = "It was" if fit.horizon.answered else "Each was"
    method = (
        f"{subject} fitted to {source} together with the machine's flux-linkage map, so that the "
        "voltage equation predicts the measured currents."
    )
    if fit.horizon.answered:
        return f"With 95 % confidence it lies between {interval.replace(' to ', ' and ')}. {method}"
    return f"The horizons tried gave values from {_spread(fit)}. {method}"


def _spread(fit: Fit) -> str:
    values = [rung.parameters["R"] for rung in fit.horizon.ladder if "R" in rung.parameters]
    return range_text(values, fit.parameters["R"].unit)


def _key_values(fit: Fit) -> KeyValues:
    choice, resistance = fit.horizon, fit.parameters["R"]
    value, interval = estimate_text(resistance)
    label = "Stator resistance R"
    items = [KeyValue(label, value, f"95 % interval {interval}", resistance.value)]
    if not choice.answered:
        items = [KeyValue(label, "no answer", f"{_spread(fit)} over the horizons", doubtful=True)]
    free_run = free_run_value(fit.comparisons)
    items += [free_run] if free_run else []
    trained = [one for one in fit.comparisons if np.isfinite(one.one_step_rmse)]
    if trained:
        worst = max(trained, key=lambda one: one.one_step_rmse)
        text = f"{number(worst.one_step_rmse)}\N{NO-BREAK SPACE}{worst.units[0]}"
        detail = "root mean square, worst recording"
        items.append(KeyValue("One step ahead", text, detail, worst.one_step_rmse))
    detail = choice.verdict
    if fit.comparisons:
        step = fit.comparisons[0].time_step
        detail = (
            f"{number(1e3 * step * choice.selected, 2)}\N{NO-BREAK SPACE}ms ahead; {choice.verdict}"
        )
    items.append(KeyValue("Horizon", f"H = {choice.selected}", detail, choice.selected))
    return KeyValues(tuple(items))


#: Whether the plateau is averaged -> what the band is drawn around.
_BANDS = {
    True: "around the mean of the plateau, weighted by precision",
    False: "the bar of the selected horizon",
}


def _resistance(fit: Fit) -> Section:
    blocks: list[Block] = [
        Figure(
            ladder_title(fit, name),
            "Each point is a complete identification at one horizon, its bar 1.96 standard "
            "deviations. Where neighbouring points agree, the value no longer depends on how "
            "far ahead the model predicted; that is the plateau. The blue band is the reported "
            f"95 % interval: {_BANDS[fit.horizon.verdict in AVERAGED]}, widened by the spread "
            "between horizons.",
            parameter_over_ladder(fit, name),
        )
        for name in ("R", *(name for name in fit.parameters if name != "R"))
    ]
    return Section(
        "Parameters over the horizon",
        "A short horizon can let unmodelled ripple and sensor noise pull the resistance away; a "
        "longer one averages them out. The right value is the one neighbouring horizons agree on.",
        [parameter_table(fit, _MEANINGS), *blocks],
    )


def _validation(fit: Fit) -> Section:
    ordered = sorted(
        fit.comparisons, key=lambda one: (one.role != "validation", -one.free_run_rmse)
    )
    blocks: list[Block] = [
        Figure(
            overlay_title(one),
            "Measured currents (wide grey), the free run and the prediction one step ahead, each "
            "with its error. The close-up at the right is a typical stretch, shaded at the left.",
            overlay(one),
        )
        for one in ordered[:_DRAWN]
    ]
    return Section(
        "Prediction against measurement",
        "In a free run the model sees the voltages, the speed and the first sample of the "
        "currents, nothing else. Recordings not used for training count most, and those with "
        "the largest errors come first.",
        [validation_table(ordered), *blocks],
    )


def _residual(fit: Fit) -> Section:
    spectrum = fit.spectrum
    base = abs(float(fit.provenance.get("electrical_frequency_hz") or 0.0))
    orders = [_HARMONIC * k for k in range(1, _LINES + 1)] if base else []
    lines = [(order * base, f"{order}×") for order in orders]
    states = (("i_d", "A"), ("i_q", "A"))
    caption = (
        f"Amplitude spectrum of the one-step residual of {spectrum.recording}; of neighbouring "
        "frequencies the largest is drawn."
    )
    if lines:
        caption += (
            f" Dotted: multiples of {_HARMONIC} times the electrical frequency "
            f"({with_unit(base, 'Hz')})."
        )
    return Section(
        "What the model does not explain",
        "Pure noise would give a flat floor. Lines at multiples of six times the electrical "
        "frequency are the ripple of slots and inverter, which a map of the currents alone "
        "cannot follow; a longer horizon keeps them from bending the resistance.",
        [
            Figure(
                spectrum_title(spectrum, lines), caption, residual_spectrum(spectrum, states, lines)
            ),
            *_correlations(fit),
        ],
    )


def _correlations(fit: Fit) -> list[Figure]:
    tests = fit.correlations
    if not tests.own.size:
        return []
    return [Figure(correlations_title(tests), correlations_caption(tests), correlations(tests))]


def _horizons(fit: Fit) -> Section:
    units = {name: estimate.unit for name, estimate in fit.parameters.items()}
    error_unit = fit.comparisons[0].units[0] if fit.comparisons else ""
    return Section(
        "All horizons",
        "The numbers behind the choice of the horizon.",
        [ladder_table(fit.horizon, units, error_unit)],
    )
