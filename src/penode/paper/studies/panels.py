"""What a study shows, as data: panels of series, and matrices of numbers."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace


@dataclass(frozen=True)
class Series:
    """Points of one kind, with a label (empty for none in the legend) and a colour of `COLOURS`.

    ``marker`` is matplotlib's, empty for none; a line joins the means of the points at each x.
    """

    label: str
    x: Sequence[float]
    y: Sequence[float]
    colour: str
    marker: str = "o"


@dataclass(frozen=True)
class Panel:
    """Axes with series over a logarithmic x; a line marks the true value of y.

    Points beyond ``y_limits`` are drawn at the edge, as arrows.
    """

    title: str
    x_label: str
    y_label: str
    series: tuple[Series, ...]
    truth: float | None = None
    y_log: bool = False
    y_limits: tuple[float, float] | None = None
    legend: bool = True


@dataclass(frozen=True)
class Matrix:
    """Numbers in rows and columns, row by row, shaded by their logarithm."""

    title: str
    x_label: str
    y_label: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    values: Sequence[Sequence[float]]


@dataclass(frozen=True)
class Claim:
    """Something the paper says, or a goal, beside the numbers that came out here, as a sentence.

    ``holds`` is None where a quick run does not judge it.
    """

    text: str
    holds: bool | None
    evidence: str


@dataclass(frozen=True)
class StudyResult:
    """Everything a study says: question, numbers (a row a run), one figure, claims, reading.

    ``reading`` says how to read it, and why it comes out so; ``columns`` are those of the rows that
    the page shows as a table, none for no table.
    """

    name: str
    title: str
    question: str
    rows: list[dict[str, object]]
    panels: tuple[Panel | Matrix, ...]
    claims: tuple[Claim, ...]
    reading: str
    columns: tuple[str, ...] = field(default=())

    @property
    def outcome(self) -> str:
        """How many statements hold, or that none is judged, in a few words."""
        count = len(self.claims)
        if self.count(None) == count:
            return "ran; quick numbers prove nothing, and its statements are not judged"
        return f"{self.count(True)} of {count} statements hold"

    def count(self, holds: bool | None) -> int:
        """Return how many statements hold, do not, or are not judged."""
        return sum(claim.holds is holds for claim in self.claims)

    def unjudged(self) -> "StudyResult":
        """Return the result of a quick run: the same numbers, and no statement judged by them."""
        return replace(self, claims=tuple(replace(claim, holds=None) for claim in self.claims))
