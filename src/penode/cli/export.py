"""The command ``penode export``."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from penode.arrays import FloatArray
from penode.cli.completion import formats
from penode.cli.machine_fit import caution, load_machine
from penode.cli.options import TrustClasses
from penode.pmsm.exports.formats import FORMATS, export
from penode.pmsm.machine.flux_grid import interpolation_error
from penode.report.quantities import number

_output, _errors = Console(), Console(stderr=True)


def export_command(
    folder: Annotated[Path, typer.Argument(help="Folder that identify or demo wrote.")],
    to: Annotated[str, typer.Option(help=f"One of {', '.join(FORMATS)}.", autocompletion=formats)],
    out: Annotated[Path, typer.Option(help="File to write; its suffix is that of the format.")],
    points: Annotated[
        int | None, typer.Option(help="Points a side of the grid; 41, but 256 for syre.")
    ] = None,
    pole_pairs: Annotated[int | None, typer.Option(help="Of the machine, for the torque.")] = None,
    trust: TrustClasses = False,
) -> None:
    """Write the flux map of a saved fit for a controller or another program.

    csv: flux_map.csv; npz: motulator; syre: SyR-e's fdfq_idiq;
    mat: look-up tables for Simulink and Simscape, with the inverse map;
    c: a C99 header with its look-up; onnx: the map itself, as a graph.

    Example: penode export result --to c --out machine.h
    """
    fit = load_machine(folder, trust)
    grid = export(fit, to, out, points=points, pole_pairs=pole_pairs)
    lines = [f"map        {out}"]
    if to not in ("csv", "onnx"):
        rows, columns = grid.supported.shape
        lines += [
            f"grid       {rows} x {columns}, i_d {_range(grid.i_d)}, i_q {_range(grid.i_q)}",
            f"supported  {number(100 * grid.supported.mean())} % of the points; there, linear "
            f"interpolation is within {number(1e3 * interpolation_error(fit, grid), 2)} mVs",
        ]
    _output.print("\n".join(lines), soft_wrap=True, highlight=False, markup=False)
    if warning := caution(fit):
        _errors.print(warning, soft_wrap=True, highlight=False, markup=False)


def _range(currents: FloatArray) -> str:
    return f"{number(currents[0])} to {number(currents[-1])} A"
