"""The command ``penode export``."""

from pathlib import Path

from penode.arrays import FloatArray
from penode.cli.console import Row, print_rows
from penode.cli.fits import end_unless_answered, load_machine, require_same_pole_pairs
from penode.pmsm.exports.control_tables import torque_per_ampere
from penode.pmsm.exports.formats import export
from penode.pmsm.exports.motorcad import reference_resistance
from penode.pmsm.machine.flux_grid import interpolation_error
from penode.report.quantities import number


def export_command(
    folder: Path,
    to: str,
    out: Path,
    points: int | None,
    pole_pairs: int | None,
    trust: bool,
) -> None:
    """Write the flux map of a saved fit for a controller or another program."""
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
