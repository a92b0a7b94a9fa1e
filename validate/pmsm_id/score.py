"""The scorer: answers beside the truth, without any method's help.

An answer is a line of JSON of ``answers/METHOD.jsonl``: ``log``; either ``refused``, why, or ``R``
in ohm (left out by a method that wants it given), ``low`` and ``high`` of its 95 % interval where
there is one, ``psi_d`` and ``psi_q`` in Vs at the currents of the task; and ``seconds``.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from validate.pmsm_id.tasks import KINDS, REFUSE

#: Errors of R and of the map, as fractions, within which an answer is of use.
USEFUL_R, USEFUL_MAP = 0.05, 0.02


@dataclass(frozen=True)
class Scored:
    """An answer beside the truth.

    Attributes
    ----------
    kind : str
    refused : bool
    error, map_error : float
        Of R, signed, and of the flux linkages: mean distance over the largest. NaN for none.
    covered : bool or None
        Whether the interval holds R; None without one.
    seconds : float
    """

    kind: str
    refused: bool
    error: float
    map_error: float
    covered: bool | None
    seconds: float

    @property
    def useful(self) -> bool:
        """Whether R, where the method finds it, and the map are within `USEFUL_R`, `USEFUL_MAP`."""
        right = np.isnan(self.error) or abs(self.error) < USEFUL_R
        return bool(not self.refused and right and self.map_error < USEFUL_MAP)


def scored(answer: dict[str, Any], truth: dict[str, Any]) -> Scored:
    """Return an answer beside the truth of its log."""
    kind, seconds = truth["kind"], float(answer["seconds"])
    if "refused" in answer:
        return Scored(kind, True, np.nan, np.nan, None, seconds)
    psi, known = (np.array(x["psi_d"]) + 1j * np.array(x["psi_q"]) for x in (answer, truth))
    error = answer.get("R", np.nan) / truth["R"] - 1
    covered = answer["low"] <= truth["R"] <= answer["high"] if "low" in answer else None
    gap = np.abs(psi - known).mean() / np.abs(known).max()
    return Scored(kind, False, float(error), float(gap), covered, seconds)


def middle(values: list[float], unit: float = 100.0) -> str:
    """Return the median of the numbers among values, or a dash."""
    numbers = [abs(v) for v in values if not np.isnan(v)]
    return f"{unit * np.median(numbers):.2g}" if numbers else "-"


def table(by_method: dict[str, list[Scored]]) -> list[str]:
    """Return the rows of the table, Markdown."""
    rows = [
        "| method | answers | of use | R, % | map, % | R covered | refuses the wrong | s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, every in by_method.items():
        right = [one for one in every if one.kind != REFUSE]
        wrong = [one for one in every if one.kind == REFUSE]
        answered = [one for one in right if not one.refused]
        sure = [one.covered for one in answered if one.covered is not None]
        rows.append(
            f"| {name} | {len(answered)} of {len(right)} "
            f"| {sum(one.useful for one in right)} "
            f"| {middle([one.error for one in answered])} "
            f"| {middle([one.map_error for one in answered])} "
            f"| {f'{sum(sure)} of {len(sure)}' if sure else '-'} "
            f"| {sum(one.refused for one in wrong)} of {len(wrong)} "
            f"| {middle([one.seconds for one in every], 1.0)} |"
        )
    kinds = [kind for kind in KINDS if kind != REFUSE]
    rows += ["", f"| median error of R, % | {' | '.join(kinds)} |", "|---" * (1 + len(kinds)) + "|"]
    for name, every in by_method.items():
        cells = [middle([one.error for one in every if one.kind == kind]) for kind in kinds]
        rows.append(f"| {name} | {' | '.join(cells)} |")
    return rows
