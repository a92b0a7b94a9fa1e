"""The sentence that says which part of the residual the loss at each horizon consists of."""

from collections.abc import Sequence

import numpy as np

from penode.arrays import FloatArray
from penode.horizon.loss_weighting import LossWeighting
from penode.report.quantities import number
from penode.validation.residual_lines import Line

#: Change of a fraction of the loss over the horizons that is worth a sentence.
_CHANGE = 0.01


def weighting_sentence(view: LossWeighting, lines: Sequence[tuple[Line, str]]) -> str:
    """Say which part of the residual contributes most to the loss at each horizon.

    ``"Most of the loss comes from the line at −6× (82 %) at H = 1, from the line at 0× (71 %) at
    H = 60."`` Horizons at which the weight is not available are named.
    """
    if not np.isfinite(view.power).all():
        return "The weighting is not available, as the one-step residual is not finite."
    known = view.at(view.available)
    missing = [
        f"H\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}{one}"
        for one in view.horizons
        if one not in known.horizons
    ]
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
    fractions = np.array([view.fractions(line) for line, _ in lines])
    fractions = np.vstack([fractions, np.maximum(1 - fractions.sum(axis=0), 0.0)])
    parts = [
        f"from {names[int(here.argmax())]} ({_percent(here.max())}) at H = {horizon}"
        for horizon, here in zip(view.horizons, fractions.T, strict=True)
    ]
    return f"Most of the loss comes {', '.join(parts)}.{_change(view.horizons, fractions, names)}"


def _change(horizons: Sequence[int], fractions: FloatArray, names: Sequence[str]) -> str:
    """Say whose fraction (name, horizon) grows and whose shrinks most over the horizons."""
    gain = fractions[:, -1] - fractions[:, 0]
    if gain.max() < _CHANGE:
        return ""
    grows, shrinks = (
        f"{names[k]} ({_percent(fractions[k, 0])} to {_percent(fractions[k, -1])})"
        for k in (int(gain.argmax()), int(gain.argmin()))
    )
    span = f"From H = {horizons[0]} to H = {horizons[-1]}"
    return f" {span} the weight of {grows} grows most, and that of {shrinks} shrinks most."


def _percent(fraction: float) -> str:
    return f"{number(100 * fraction, 2)}\N{NO-BREAK SPACE}%"
