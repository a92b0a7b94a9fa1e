"""The files that an identification writes."""

from pathlib import Path

import numpy as np

from penode.fit.archive import write_atomically
from penode.fit.fit import Fit
from penode.fit.result_folder import REPORT, claimed, replace_together
from penode.pmsm.machine.flux_grid import FluxGrid
from penode.pmsm.machine.standstill import STANDSTILL, excited_axes
from penode.pmsm.report.no_current import at_no_current

#: Points a side of the grid in ``flux_map.csv``.
GRID = 41


def write(fit: Fit, folder: str | Path) -> None:
    """Write the result, the map and the reloadable fit into a folder, and then its report.

    Parameters
    ----------
    fit : Fit
        Of a machine.
    folder : str or Path
        Made if absent. Gets ``result.json``, ``flux_map.csv`` and ``fit/`` together, or stays as
        it was; then ``report.html``.

    Raises
    ------
    InputError
        If another process writes there.
    """
    with claimed(Path(folder)):
        write_answer(fit, Path(folder))
        write_report(fit, Path(folder))


def write_answer(fit: Fit, folder: Path) -> None:
    """Write all but the report into a claimed folder, and remove the report of what was there."""
    known = {
        name: {"value": one.value, "interval_95": one.interval_95, "unit": one.unit}
        for name, one in at_no_current(fit).items()
    }
    beside = {"flux_map.csv": flux_map_csv(fit).encode()}
    replace_together(folder, fit.files(beside, {"no_current": known} if known else {}))


def write_report(fit: Fit, folder: Path, truth: FluxGrid | None = None) -> None:
    """Write the report, which is no part of the set with digests: it may be made again.

    A machine that is known is drawn beside.
    """
    # Imported here: the plotting library takes a third of a second, and few commands draw.
    from penode.pmsm.report.against import Against
    from penode.pmsm.report.machine_report import machine_report

    against = None if truth is None else Against.of(fit, "The machine as it is", truth)
    write_atomically(folder / REPORT, machine_report(fit, against))


def flux_map_csv(fit: Fit) -> str:
    """Return the map on an even grid over the visited range, as CSV in SI units.

    Of a standstill it has the flux linkage less that at zero current, in columns of other names,
    and nothing of an axis without current.
    """
    low, high = fit.excited.min(axis=0), fit.excited.max(axis=0)
    excited = excited_axes(fit)
    axes = [
        np.linspace(a, b, GRID) if moves else np.array([0.5 * (a + b)])
        for a, b, moves in zip(low, high, excited, strict=True)
    ]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    psi, names = np.array(fit.flux_map(*points.T)), ("psi_d", "psi_q")
    if fit.provenance.get(STANDSTILL):
        psi = psi - fit.flux_map(0.0, 0.0)[:, None]
        names = ("delta_psi_d", "delta_psi_q")
    psi[~excited] = np.nan
    inductance = np.array(fit.differential_inductance(*points.T))
    inductance[~excited] = inductance[:, ~excited] = np.nan
    rows = np.column_stack([points, psi.T, inductance.reshape(4, -1).T])
    lines = [f"i_d,i_q,{','.join(names)},l_dd,l_dq,l_qd,l_qq,supported"]
    for row, inside in zip(rows, fit.supported(points), strict=True):
        lines.append(",".join(f"{value:.9g}" for value in row) + f",{int(inside)}")
    return "\n".join(lines) + "\n"
