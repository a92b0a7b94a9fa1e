"""The section on how the loss at each horizon weighs the residual."""

from collections.abc import Callable, Sequence

import numpy as np

from penode.fit.fit import Fit
from penode.horizon.loss_weighting import LossWeighting, loss_weighting
from penode.report.document import Notice, Section, Table, picture
from penode.report.quantities import labelled, number, with_unit
from penode.report.spectrum import weighting_figure
from penode.report.tables import Column, numeric, plain, table
from penode.validation.residual_lines import Line

_SPACE = "\N{NO-BREAK SPACE}"
#: Lines named at most, and the fraction of the loss at one of the horizons from which one is named.
_NAMED, _WORTH = 8, 1e-3
#: Change of a fraction of the loss over the horizons that is worth a sentence.
_CHANGE = 0.01
_TITLE = "What the loss of each horizon consists of"
_LEAD = (
    "Training H steps ahead is training one step ahead with each frequency of the residual "
    "weighted: the longer the horizon, the more slow errors count, and the less fast ones. This "
    "is why estimates differ or agree over the horizons; nothing here asks for action."
)
_CAPTION = (
    "Above: one-step residual of the first training recording; of neighbouring frequencies the "
    "largest is drawn. Below: the weight of each frequency in the loss, as a multiple of the mean "
    "over all frequencies. The loss is the sum of the squared residual times the weight."
)


def weighting_of(fit: Fit, base: float | None = None) -> LossWeighting | None:
    """Return how the loss weighs the residual at H = 1, the selected and the longest horizon.

    ``base``, in Hz, is the frequency whose multiples are the lines' orders; its sign is kept. None
    where the fit keeps no one-step matrices or no prediction.
    """
    if not fit.transitions.size or not fit.comparisons:
        return None
    longest = max((rung.horizon for rung in fit.horizon.ladder), default=1)
    horizons = sorted({1, fit.horizon.selected, longest})
    shown = (one for one in fit.comparisons if one.name == fit.spectrum.recording)
    comparison = next(shown, fit.comparisons[0])
    return loss_weighting(comparison, fit.transitions, horizons, base, fit.starts)


def weighting_section(
    view: LossWeighting,
    units: Sequence[str],
    named: Callable[[Line], tuple[str, str]] = lambda line: (with_unit(line.frequency, "Hz"), ""),
    note: str = "",
) -> Section:
    """Say and show how the loss weighs the residual at three horizons at most.

    ``units`` is the SI unit of each signal; ``named`` returns what a line is called and what may
    have made it; ``note``, what the names mean, goes into the caption. A notice takes the place of
    all where the weight is available at no horizon.
    """
    whole, view = view, view.at(view.available)
    if not view.horizons:
        why = weighting_sentence(whole, [])
        return Section(_TITLE, _LEAD, [Notice("caution", "Not available", why)])
    largest = {k: float(view.fractions(line).max()) for k, line in enumerate(view.lines)}
    order = sorted((k for k in largest if largest[k] >= _WORTH), key=lambda k: -largest[k])
    names = [(view.lines[k], *named(view.lines[k])) for k in sorted(order[:_NAMED])]
    lines = [(line, label) for line, label, _ in names]
    caption = " ".join(filter(None, [_CAPTION, _peak(view), note]))
    title = "The residual has no lines"
    if lines:
        count = "one line," if len(lines) == 1 else f"{len(lines)} lines, the strongest"
        title = f"Of all states together the residual has {count} at {lines[0][1]}"
    drawn = picture(title, caption, weighting_figure, view, lines, units)
    tables = [_table(view, names, units)] if lines else []
    return Section(_TITLE, f"{_LEAD} {weighting_sentence(whole, lines)}", [drawn, *tables])


def _peak(view: LossWeighting) -> str:
    """Say where the weight of the longest horizon peaks; at H = 1 it is flat."""
    longest = int(np.argmax(view.horizons))
    if view.horizons[longest] == 1:
        return ""
    peak = with_unit(float(view.frequency[view.weight[longest, :, 0].argmax()]), "Hz")
    return f"The weight of a long horizon peaks at {peak}, where errors grow most over the horizon."


def _table(
    view: LossWeighting, names: Sequence[tuple[Line, str, str]], units: Sequence[str]
) -> Table:
    lines, labels, causes = zip(*names, strict=True)
    own = units[: len(view.signals)]
    unit = own[0] if len(set(own)) == 1 else ""
    amplitudes = [
        f"{number(line.amplitude)}{'' if unit else _SPACE + own[line.signal]}".rstrip()
        for line in lines
    ]
    columns: list[Column] = [
        ("line", labels),
        (f"frequency in{_SPACE}Hz", [plain(line.frequency, 4) for line in lines]),
        (
            labelled("amplitude", unit, _SPACE),
            [numeric(*one) for one in zip(amplitudes, (o.amplitude for o in lines), strict=True)],
        ),
    ]
    fractions = np.array([view.fractions(line) for line in lines]).T
    for horizon, at in zip(view.horizons, fractions.tolist(), strict=True):
        cells = [numeric(f"{number(100 * one, 2)} %", one) for one in at]
        columns.append((f"fraction at H{_SPACE}={_SPACE}{horizon}", cells))
    if any(causes):
        columns.append(("likely causes", causes))
    caption = (
        "Fraction of the loss at each horizon; the rest lies between the lines. The frequency is "
        "the centre of a line's power, which is spread where speed or currents vary, and the "
        "amplitude that of all its frequencies together."
    )
    return table("Lines of the one-step residual", columns, caption)


def weighting_sentence(view: LossWeighting, lines: Sequence[tuple[Line, str]]) -> str:
    """Say which part of the residual contributes most to the loss at each horizon.

    ``"The largest part of the loss is the line at −6× (82 %) at H = 1, the line at 0× (71 %) at
    H = 60."`` Horizons at which the weight is not available are named.
    """
    if not np.isfinite(view.power).all():
        return "The weighting is not available, as the one-step residual is not finite."
    known = view.at(view.available)
    missing = [f"H{_SPACE}={_SPACE}{one}" for one in view.horizons if one not in known.horizons]
    sentences = [_most(known, lines)] if known.horizons else []
    if missing:
        sentences.append(
            f"At {' and '.join(missing)} the weighting is not available, as the fitted model is "
            "unstable: errors grow without bound over so many steps."
        )
    return " ".join(sentences)


def _most(view: LossWeighting, lines: Sequence[tuple[Line, str]]) -> str:
    """Say what most of the loss comes from at each horizon, and what changes over them."""
    if not lines:
        return "The loss at every horizon comes from noise without lines."
    names = [*(f"the line at {name}" for _, name in lines), "what lies between the lines"]
    shares = np.array([view.fractions(line) for line, _ in lines])
    shares = np.vstack([shares, np.maximum(1 - shares.sum(axis=0), 0.0)])
    parts = [
        f"{names[int(here.argmax())]} ({_percent(here.max())}) at H = {horizon}"
        for horizon, here in zip(view.horizons, shares.T, strict=True)
    ]
    sentence = f"The largest part of the loss is {', '.join(parts)}."
    gain = shares[:, -1] - shares[:, 0]
    if gain.max() < _CHANGE:
        return sentence
    grows, shrinks = (
        f"{verb} from {_percent(shares[k, 0])} to {_percent(shares[k, -1])}"
        for verb, k in (
            (f"{names[gain.argmax()]} grows", gain.argmax()),
            (f"{names[gain.argmin()]} falls", gain.argmin()),
        )
    )
    span = f"From H = {view.horizons[0]} to H = {view.horizons[-1]}"
    return f"{sentence} {span} {grows}, and {shrinks}."


def _percent(fraction: float) -> str:
    return f"{number(100 * fraction, 2)}{_SPACE}%"
