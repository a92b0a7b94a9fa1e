"""Words that the shell completes on TAB; see ``penode --install-completion``."""

from pathlib import Path

from penode.bench.config import shipped_configs
from penode.horizon.held_out import PURPOSES
from penode.pmsm.exports.formats import FORMATS
from penode.pmsm.machine.flux_maps import FLUX_MAPS
from penode.pmsm.machine.holds import HOLDS
from penode.pmsm.machine.term_registry import TERMS


def simulations() -> list[str]:
    """Return the names of the shipped simulations and the TOML files at hand."""
    return [*shipped_configs(), *sorted(str(path) for path in Path().glob("*.toml"))]


def flux_maps() -> list[str]:
    """Return the families of flux maps."""
    return list(FLUX_MAPS)


def formats() -> list[str]:
    """Return the export formats."""
    return list(FORMATS)


def holds() -> list[str]:
    """Return the frames in which a voltage may be held."""
    return list(HOLDS)


def terms() -> list[str]:
    """Return the terms of the voltage equation."""
    return list(TERMS)


def purposes() -> list[str]:
    """Return what a horizon may be chosen for."""
    return list(PURPOSES)
