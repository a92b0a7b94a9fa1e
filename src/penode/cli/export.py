"""The command ``penode export``."""

from pathlib import Path
from typing import Annotated

import typer

from penode.arrays import FloatArray
from penode.cli.console import Row, print_rows
from penode.cli.fits import end_unless_answered, load_machine, require_same_pole_pairs
from penode.cli.options import SavedFit, TrustClasses
from penode.pmsm.exports.control_tables import torque_per_ampere
from penode.pmsm.exports.formats import FORMATS, export
from penode.pmsm.exports.motorcad import reference_resistance
from penode.pmsm.machine.flux_grid import interpolation_error
from penode.report.quantities import number


def export_command(
    folder: SavedFit,
    to: Annotated[
        str,
        typer.Option(help=f"One of {', '.join(FORMATS)}.", autocompletion=lambda: list(FORMATS)),
    ],
    out: Annotated[Path, typer.Option(help="File to write; its suffix is that of the format.")],
    points: Annotated[
        int | None, typer.Option(help="Points a side of the grid; 41, but 256 for syre.")
    ] = None,
    pole_pairs: Annotated[int | None, typer.Option(help="Of the machine, for the torque.")] = None,
    trust: TrustClasses = False,
) -> None:
    """Write the flux map of a saved fit for a controller or another program.

    csv: flux_map.csv; npz: motulator; syre: SyR-e's fdfq_idiq; xlsx: a workbook;
    mat, m: tables for Simulink and Simscape, as a file and as a script, with i(psi) and MTPA;
    motorcad: what reads a saturation map of Motor-CAD; over the rotor's angle too, as is mat;
    c, c_fixed: a C99 header with look-ups of psi, i(psi), torque and MTPA, in float or 16 bits;
    onnx: the map itself, as a graph.

    Example: penode export result --to c --out machine.h
    """
    fit = load_machine(folder, trust)
    require_same_pole_pairs(fit, pole_pairs)
    replaced = " (replaced)" if out.exists() else ""
    grid = export(fit, to, out, points=points, pole_pairs=pole_pairs)
    rows: list[Row] = [("map", f"{out}{replaced}")]
    if to not in ("csv", "onnx"):
        d, q = grid.supported.shape
        error = number(1e3 * interpolation_error(fit, grid), 2)
        rows += [
            ("grid", f"{d} x {q}, i_d {_range(grid.i_d)}, i_q {_range(grid.i_q)}"),
            (
                "supported",
                f"{number(100 * grid.supported.mean())} % of the table, where recordings are; "
                f"there, linear interpolation is within {error} mVs of the fit",
            ),
        ]
    if to in ("c", "c_fixed", "mat", "m", "xlsx"):
        best = torque_per_ampere(fit, grid)
        said = ""
        if best:
            cells = best.supported.replace("-", "\N{MINUS SIGN}")
            said = (
                f"{number(best.torque[0])} to {number(best.torque[-1])} Nm, as far as recordings "
                f"support it; cells of the table do at {cells} Nm"
            )
        if grid.pole_pairs is None:
            said = "left out, as is the torque: the pole pairs are not known; add --pole-pairs"
        rows += [("mtpa", said)] if said else []
    if to == "motorcad" and reference_resistance(grid) is None:
        rows.append(("note", "R is left out: this form has it at 20 degC, which is not known"))
    print_rows(rows)
    end_unless_answered(fit)


def _range(currents: FloatArray) -> str:
    return f"{number(currents[0])} to {number(currents[-1])} A"
