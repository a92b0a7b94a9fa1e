"""The sentence that says what the loss at each horizon listens to."""

from collections.abc import Sequence

import numpy as np

from penode.arrays import FloatArray
from penode.horizon.loss_weighting import LossWeighting
from penode.report.quantities import number
from penode.validation.residual_lines import Line

#: Change of a share of the loss over the horizons that is worth a sentence.
_TURN = 0.01


def listening(view: LossWeighting, lines: Sequence[tuple[Line, str]]) -> str:
    """Say which part of the residual the loss at each horizon is made of.

    Parameters
    ----------
    view : LossWeighting
        Residual spectrum and weights.
    lines : sequence of (Line, str)
        Lines that have a name, and the name.

    Returns
    -------
    str
        Such as ``"At H = 1 the fit listens mostly to the line at −6× (82 %); at H = 60 to the
        line at 0× (71 %)."``
    """
    rest = "what lies between the lines" if lines else "noise without lines"
    names = [*(f"the line at {name}" for _, name in lines), rest]
    shares = np.array([view.shares(line) for line, _ in lines]).reshape(-1, len(view.horizons))
    shares = np.vstack([shares, np.maximum(1 - shares.sum(axis=0), 0.0)])
    parts: list[str] = []
    for horizon, share in zip(view.horizons, shares.T, strict=True):
        most = int(share.argmax())
        verb = "" if parts else "the fit listens mostly "
        parts.append(f"at H = {horizon} {verb}to {names[most]} ({_percent(share[most])})")
    text = "; ".join(parts)
    return f"{text[0].upper()}{text[1:]}.{_turn(view.horizons, shares, names)}"


def _turn(horizons: Sequence[int], shares: FloatArray, names: Sequence[str]) -> str:
    """Say whose share (name, horizon) grows and whose shrinks most from first to last horizon."""
    gain = shares[:, -1] - shares[:, 0]
    if gain.max() < _TURN:
        return ""
    to, away = (
        f"{names[k]} ({_percent(shares[k, 0])} to {_percent(shares[k, -1])})"
        for k in (int(gain.argmax()), int(gain.argmin()))
    )
    span = f"From H = {horizons[0]} to H = {horizons[-1]}"
    return f" {span} it turns most to {to} and away from {away}."


def _percent(share: float) -> str:
    return f"{number(100 * share, 2)}\N{NO-BREAK SPACE}%"
