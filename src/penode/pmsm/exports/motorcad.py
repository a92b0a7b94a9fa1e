"""Variables of a saturation map as Motor-CAD exports it over d and q currents."""

from typing import Any

import numpy as np

from penode.pmsm.machine.angle_grid import AngleGrid
from penode.pmsm.machine.flux_grid import FluxGrid
from penode.pmsm.machine.terms import REFERENCE


def variables(grid: FluxGrid, turned: AngleGrid | None) -> dict[str, Any]:
    """Return them by name: i_d along the rows, i_q along the columns, the angle along a third axis.

    ``Id_Peak``, ``Iq_Peak``, ``Stator_Current_Phase_Peak`` (A), ``Phase_Advance`` (degrees by which
    the current leads the q axis), ``Flux_Linkage_D``, ``Flux_Linkage_Q`` (Vs), and with pole pairs
    ``Electromagnetic_Torque`` (Nm). Where the map depends on the angle ``Angular_Rotor_Position``
    (electrical degrees) and the same three with ``Angular_`` before them.
    ``Phase_Resistance_DC_at_20C`` (ohm) where R is known at that temperature. ``supported`` is 1
    where recordings have been, and ``temperatures`` a text.
    """
    (i_d, i_q), (psi_d, psi_q) = grid.mesh, grid.psi
    tables: dict[str, Any] = {
        "Id_Peak": i_d,
        "Iq_Peak": i_q,
        "Stator_Current_Phase_Peak": np.hypot(i_d, i_q),
        "Phase_Advance": np.rad2deg(np.arctan2(-i_d, i_q)),
        "Flux_Linkage_D": psi_d,
        "Flux_Linkage_Q": psi_q,
        "supported": grid.supported.astype(float),
        "temperatures": grid.temperatures.sentences,
    }
    if grid.torque is not None:
        tables["Electromagnetic_Torque"] = grid.torque
    if turned is not None:
        tables["Angular_Rotor_Position"] = np.broadcast_to(turned.angle, turned.psi.shape[1:])
        tables["Angular_Flux_Linkage_D"], tables["Angular_Flux_Linkage_Q"] = turned.psi
        if turned.torque is not None:
            tables["Angular_Electromagnetic_Torque"] = turned.torque
    if (resistance := reference_resistance(grid)) is not None:
        tables["Phase_Resistance_DC_at_20C"] = resistance
    return tables


def reference_resistance(grid: FluxGrid) -> float | None:
    """Return R in ohm where it is that at 20 degC."""
    return grid.resistance if grid.temperatures.resistance == REFERENCE else None
