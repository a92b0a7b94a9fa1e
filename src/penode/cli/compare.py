"""The command ``penode compare``."""

import json
from pathlib import Path

import typer

from penode.cli.console import print_rows
from penode.cli.fits import load_machine
from penode.cli.options import require_png
from penode.errors import InputError
from penode.fit.archive import write_atomically
from penode.pmsm.comparison.map_comparison import compare_maps, compare_resistances
from penode.pmsm.machine.flux_grid import is_map, read_grid


def compare_command(
    first: Path,
    second: Path,
    out: Path | None,
    as_json: bool,
    trust: bool,
) -> None:
    """Compare a saved fit with another one, or with a map in a CSV file."""
    if out is not None:
        require_png(out)
    if is_map(first):
        raise InputError(f"{first}: a map must be given second, got it first; exchange the two.")
    fit, resistance = load_machine(first, trust), None
    if second.suffix.lower() == ".csv":
        maps = compare_maps(fit, read_grid(second))
    else:
        other = load_machine(second, trust)
        maps, resistance = compare_maps(fit, other), compare_resistances(fit, other)
    if out is not None:
        # Imported here: the plotting library takes a third of a second, and few commands draw.
        from penode.pmsm.comparison.comparison_picture import comparison_picture

        write_atomically(out, comparison_picture(maps, f"{second}\nless {first}"))
    picture = None if out is None else str(out)
    if as_json:
        figures = {"psi_rms": maps.rms, "psi_largest": maps.largest}
        typer.echo(json.dumps({**figures, "resistance": resistance, "picture": picture}))
    else:
        told = {"map": maps.sentence, "R": resistance, "picture": picture}
        print_rows([(name, text) for name, text in told.items() if text is not None])
