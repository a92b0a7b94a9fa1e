"""The files that an identification writes."""

import tempfile
from pathlib import Path

import numpy as np

from penode.fit.archive import write_atomically
from penode.fit.fit import Fit
from penode.pmsm.report.machine_report import machine_report

#: Points a side of the grid in ``flux_map.csv``.
GRID = 41


def write(fit: Fit, folder: str | Path) -> None:
    """Write the result, the map, the reloadable fit and the report into a folder.

    Parameters
    ----------
    fit : Fit
        Of a machine.
    folder : str or Path
        Gets ``result.json``, ``flux_map.csv``, ``fit/`` and ``report.html``, moved there together
        when all are written: what interrupts the writing leaves an earlier result as it was.
    """
    folder = Path(folder)
    report = machine_report(fit)
    table = flux_map_csv(fit)
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder, prefix=".result.") as made:
        staged = Path(made)
        fit.save(staged)
        write_atomically(staged / "flux_map.csv", table)
        write_atomically(staged / "report.html", report)
        (folder / "fit").mkdir(exist_ok=True)
        for file in [path for path in staged.rglob("*") if path.is_file()]:
            file.replace(folder / file.relative_to(staged))


def flux_map_csv(fit: Fit) -> str:
    """Return the map on an even grid over the visited range, as CSV in SI units."""
    low, high = fit.excited.min(axis=0), fit.excited.max(axis=0)
    axes = [np.linspace(a, b, GRID) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    psi = fit.flux_map(*points.T)
    inductance = fit.differential_inductance(*points.T).reshape(4, -1)
    rows = np.column_stack([points, psi.T, inductance.T])
    lines = ["i_d,i_q,psi_d,psi_q,l_dd,l_dq,l_qd,l_qq,supported"]
    for row, inside in zip(rows, fit.supported(points), strict=True):
        lines.append(",".join(f"{value:.9g}" for value in row) + f",{int(inside)}")
    return "\n".join(lines) + "\n"
