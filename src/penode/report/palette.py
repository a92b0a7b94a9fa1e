"""Colours by role, each for light and for dark pages: one source for the page and its figures.

Figures are drawn with the light colour of a role; the page's script exchanges each light colour
for its dark twin where the reader prefers dark. Light colours are therefore distinct.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Colour:
    """The CSS colours of one role on a light and on a dark page."""

    light: str
    dark: str


INK = Colour("#18212d", "#e4e9f0")
MUTED = Colour("#566376", "#9ba8b9")
PAGE = Colour("#ffffff", "#12161c")
PANEL = Colour("#f5f7fa", "#1a2028")
LINE = Colour("#d8dfe8", "#333d4a")
GRID = Colour("#e9edf3", "#262e39")
ACCENT = Colour("#1f5fc4", "#7db0ff")

MEASURED = Colour("#b3bdca", "#66758a")
ONE_STEP = Colour("#1d62cc", "#6fa8ff")
FREE_RUN = Colour("#d4540a", "#ff9d57")
ESTIMATE = Colour("#1c5bbd", "#86b6ff")
OTHER = Colour("#8b97a7", "#7f8c9e")
INTERVAL = Colour("rgba(31, 95, 196, 0.16)", "rgba(125, 176, 255, 0.22)")
PLATEAU = Colour("rgba(26, 140, 104, 0.11)", "rgba(80, 205, 160, 0.13)")
PLATEAU_TEXT = Colour("#13694e", "#6fd6b0")
WINDOW = Colour("rgba(86, 99, 118, 0.16)", "rgba(155, 168, 185, 0.20)")
MARKER_LINE = Colour("#7a4fb5", "#c3a2f2")
VEIL = Colour("rgba(240, 243, 247, 0.90)", "rgba(30, 36, 45, 0.90)")
OUTLINE = Colour("#4b586b", "#a9b6c7")
RECORDED = Colour("rgba(24, 33, 45, 0.20)", "rgba(228, 233, 240, 0.24)")
CONTOUR = Colour("rgba(24, 33, 45, 0.72)", "rgba(236, 241, 247, 0.82)")
#: Text shadow that lifts a label off the lines below it.
HALO = Colour(
    "0 0 3px #f2f6f2, 0 0 3px #f2f6f2, 0 0 2px #f2f6f2",
    "0 0 3px #14202b, 0 0 3px #14202b, 0 0 2px #14202b",
)

GOOD = Colour("#14734f", "#62d3a6")
GOOD_FILL = Colour("#e9f6f0", "#12291f")
CAUTION = Colour("#8f5a00", "#f3bd5b")
CAUTION_FILL = Colour("#fff5df", "#2e2410")
REFUSAL = Colour("#b3261e", "#ff8f86")
REFUSAL_FILL = Colour("#fdeceb", "#331615")

#: Low to high, for filled maps; each pair is the same step on a light and on a dark page.
SEQUENCE = (
    Colour("#dfe9f8", "#17263d"),
    Colour("#b5d2ee", "#1d3f63"),
    Colour("#85bddb", "#22608a"),
    Colour("#63b3ab", "#2a8296"),
    Colour("#8fc587", "#4a9f83"),
    Colour("#d6d873", "#94b45c"),
    Colour("#f7d65b", "#dcc04d"),
)

#: Three-dimensional surfaces are lit, so they keep one scale on every page.
SURFACE = ("#23427c", "#2e6f9e", "#3a9a9c", "#7dbb7e", "#c9d168", "#f6dc62")

#: Colours by the name of their role; of the page, ``--good-fill`` is GOOD_FILL.
ROLES = {name: value for name, value in [*globals().items()] if isinstance(value, Colour)}


def dark_twins() -> dict[str, str]:
    """Return the dark colour of every light colour that figures use."""
    return {colour.light: colour.dark for colour in (*ROLES.values(), *SEQUENCE)}
