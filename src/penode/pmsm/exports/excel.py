"""Excel workbook of a flux map: a sheet a table; the package XlsxWriter is an extra."""

import io

from penode.arrays import FloatArray
from penode.errors import InputError
from penode.pmsm.exports.control_tables import TorquePerAmpere
from penode.pmsm.machine.flux_grid import FluxGrid

_HEAD = "i_d in A down, i_q in A across"


def encode(grid: FluxGrid, mtpa: TorquePerAmpere | None) -> bytes:
    """Return the workbook: facts, psi_d, psi_q, L of both axes, torque, the region, and MTPA.

    A table has i_d down the first column and i_q across the first row. Refuses a missing
    XlsxWriter.
    """
    try:
        import xlsxwriter
    except ImportError as error:
        raise InputError(
            "the format xlsx needs a package that is not installed; run pip install "
            "'penode[excel]'."
        ) from error
    content = io.BytesIO()
    with xlsxwriter.Workbook(content, {"in_memory": True}) as book:
        facts = book.add_worksheet("facts")
        facts.set_column(0, 0, 40)
        for row, cells in enumerate(_facts(grid)):
            facts.write_row(row, 0, cells)
        for name, table in _tables(grid).items():
            sheet = book.add_worksheet(name)
            sheet.set_column(0, 0, len(_HEAD))
            sheet.freeze_panes(1, 1)
            sheet.write_row(0, 0, [_HEAD, *grid.i_q])
            for row, (current, values) in enumerate(zip(grid.i_d, table, strict=True), start=1):
                sheet.write_row(row, 0, [current, *values])
        if mtpa is not None:
            sheet = book.add_worksheet("MTPA")
            sheet.write_row(0, 0, ["torque in Nm", "i_d in A", "i_q in A"])
            for row, cells in enumerate(zip(mtpa.torque, *mtpa.current, strict=True), start=1):
                sheet.write_row(row, 0, cells)
    return content.getvalue()


def _facts(grid: FluxGrid) -> list[tuple[str | float, ...]]:
    """Return the rows of the first sheet: what is known, in which frame, and where."""
    known = grid.temperatures
    numbers = {
        "R in ohm": grid.resistance,
        "temperature of R in degC": known.resistance,
        "coefficient of R in 1/K": known.coefficient,
        "temperature of the magnets in degC": known.magnets,
        "pole pairs": grid.pole_pairs,
    }
    rows: list[tuple[str | float, ...]] = [(n, v) for n, v in numbers.items() if v is not None]
    rows.append((known.sentences,))
    rows.append(("Currents are peak values of a phase; the d axis is that of the magnet.",))
    rows.append(("supported is 1 where recordings have been; elsewhere maps are extrapolated.",))
    return rows


def _tables(grid: FluxGrid) -> dict[str, FloatArray]:
    """Return every table over both currents, by the name of its sheet."""
    (l_dd, l_dq), (_, l_qq) = grid.inductance
    tables = {"psi_d in Vs": grid.psi[0], "psi_q in Vs": grid.psi[1]}
    tables |= {"L_dd in H": l_dd, "L_dq in H": l_dq, "L_qq in H": l_qq}
    if grid.torque is not None:
        tables["torque in Nm"] = grid.torque
    return tables | {"supported": grid.supported.astype(float)}
