"""What a study shows, as data: panels of series, and matrices of numbers."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace


@dataclass(frozen=True)
class Series:
    """Points of one kind.

    Attributes
    ----------
    label : str
        Empty to leave it out of the legend.
    x, y : sequence of float
    colour : str
        A name of `penode.pmsm.studies.study_figure.COLOURS`.
    marker : str
        Of matplotlib; empty for none.
    joined : bool
        Whether a line joins the means of the points at each x.
    """

    label: str
    x: Sequence[float]
    y: Sequence[float]
    colour: str
    marker: str = "o"
    joined: bool = True


@dataclass(frozen=True)
class Panel:
    """Axes with series.

    Attributes
    ----------
    title, x_label, y_label : str
    series : tuple of Series
    truth : float or None
        Value of y that a line marks as true.
    x_log, y_log : bool
        Logarithmic axes.
    y_limits : tuple of float or None
        Points beyond are drawn at the edge, as arrows.
    legend : bool
    """

    title: str
    x_label: str
    y_label: str
    series: tuple[Series, ...]
    truth: float | None = None
    x_log: bool = True
    y_log: bool = False
    y_limits: tuple[float, float] | None = None
    legend: bool = True


@dataclass(frozen=True)
class Matrix:
    """Numbers in rows and columns, shaded by their logarithm.

    Attributes
    ----------
    title, x_label, y_label : str
    rows, columns : tuple of str
    values : sequence of sequence of float
        Row by row.
    """

    title: str
    x_label: str
    y_label: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    values: Sequence[Sequence[float]]


@dataclass(frozen=True)
class Claim:
    """Something the paper says, or a goal, beside what came out here.

    Attributes
    ----------
    text : str
        The statement.
    holds : bool or None
        Whether it holds here; None where a quick run does not judge it.
    evidence : str
        The numbers, as a sentence.
    """

    text: str
    holds: bool | None
    evidence: str


@dataclass(frozen=True)
class StudyResult:
    """Everything a study says.

    Attributes
    ----------
    name, title : str
        Of its files, and of its section.
    question : str
        What is asked, in a sentence or two.
    rows : list of dict
        The numbers, a row a run, for CSV and JSON.
    panels : tuple of Panel or Matrix
        One figure.
    claims : tuple of Claim
    reading : str
        How to read it, and why it comes out so.
    columns : tuple of str
        Columns of the rows that the page shows as a table; none shows no table.
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
