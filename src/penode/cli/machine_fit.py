"""Reading of a saved fit that has to be one of a machine."""

from pathlib import Path

from penode.errors import InputError
from penode.fit.fit import Fit


def load_machine(folder: Path, trust: bool = False) -> Fit:
    """Return the fit of a machine from the folder that identify or demo wrote; refuse another's.

    ``trust`` imports modules other than penode's for the classes of the fit.
    """
    fit = Fit.load(folder, trust)
    maps = sorted(fit.model.maps())
    if "flux_map" not in maps:
        raise InputError(
            f"{folder}: a fit with the maps {', '.join(maps) or 'none'} came, and one of a machine "
            "was wanted; give a folder that penode identify wrote."
        )
    return fit


def caution(fit: Fit) -> str | None:
    """Return a warning where the recordings could not answer, else None."""
    if fit.horizon.answered:
        return None
    return (
        f"warning: the verdict of this fit is {fit.horizon.verdict!r}; R is left out, and the map "
        "is as doubtful as R."
    )
