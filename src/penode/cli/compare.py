"""The command ``penode compare``."""

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from penode.cli.machine_fit import load_machine
from penode.cli.options import TrustClasses, require_png
from penode.fit.archive import write_atomically
from penode.pmsm.comparison.map_comparison import compare_maps, compare_resistances
from penode.pmsm.machine.flux_grid import read_grid

_output = Console()


def compare_command(
    first: Annotated[Path, typer.Argument(help="Folder that identify or demo wrote.")],
    second: Annotated[Path, typer.Argument(help="Another one, or a map such as flux_map.csv.")],
    out: Annotated[Path, typer.Option(help="PNG to write.")],
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document instead.")] = False,
    trust: TrustClasses = False,
) -> None:
    """Hold a saved fit against another one, or against a map in a CSV file.

    Differences are the second less the first, where both are supported.

    Example: penode compare cold warm --out difference.png
    """
    require_png(out)
    fit, resistance = load_machine(first, trust), None
    if second.suffix.lower() == ".csv":
        maps = compare_maps(fit, read_grid(second))
    else:
        other = load_machine(second, trust)
        maps, resistance = compare_maps(fit, other), compare_resistances(fit, other)
    # Imported here: the plotting library takes a third of a second, and few commands draw.
    from penode.pmsm.comparison.comparison_picture import comparison_picture

    write_atomically(out, comparison_picture(maps, f"{second}\nless {first}"))
    if as_json:
        figures = {"psi_rms": maps.rms, "psi_largest": maps.largest}
        typer.echo(json.dumps({**figures, "resistance": resistance, "picture": str(out)}))
        return
    lines = [f"map      {maps.sentence}", f"picture  {out}"]
    if resistance is not None:
        lines.insert(1, f"R        {resistance}")
    _output.print("\n".join(lines), soft_wrap=True, highlight=False, markup=False)
