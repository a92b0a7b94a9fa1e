"""What the pictures that commands write beside their results have in common."""

import io
from collections.abc import Iterable

from matplotlib.axes import Axes
from matplotlib.figure import Figure

#: Colours of the d and of the q axis.
D_AXIS, Q_AXIS = "#1768ac", "#c8553d"


def png(figure: Figure, panels: Iterable[Axes], title: str) -> bytes:
    """Return a figure as PNG, titled at its left, its panels without frames above and beside."""
    for axes in panels:
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(title, x=0.01, ha="left", fontsize=12)
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=110)
    return content.getvalue()
