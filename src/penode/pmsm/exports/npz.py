"""NumPy archive in the arrays of motulator's ``MagneticModel``.

``MagneticModel(i_s_dq=map["i_s_dq"], psi_s_dq=map["psi_s_dq"])``, motulator 0.6; d along the first
axis, q along the second.
"""

import io
from typing import Any

import numpy as np

from penode.pmsm.machine.flux_grid import FluxGrid


def encode(grid: FluxGrid) -> bytes:
    """Return the archive, ``i_s_dq`` (A) and ``psi_s_dq`` (Vs) complex, of shape (row, column).

    Beside them ``supported``, and where known ``tau_M`` (Nm), ``n_p``, ``R_s`` (ohm),
    ``R_s_temperature`` (degC), ``R_s_coefficient`` (1/K) and ``magnet_temperature`` (degC);
    ``temperatures`` is a text that says the same.
    """
    arrays: dict[str, Any] = {
        "i_s_dq": grid.mesh[0] + 1j * grid.mesh[1],
        "psi_s_dq": grid.psi[0] + 1j * grid.psi[1],
        "supported": grid.supported,
    }
    known = grid.temperatures
    facts = {
        "tau_M": grid.torque,
        "n_p": grid.pole_pairs,
        "R_s": grid.resistance,
        "R_s_temperature": known.resistance,
        "R_s_coefficient": known.coefficient,
        "magnet_temperature": known.magnets,
        "temperatures": known.sentences,
    }
    arrays |= {name: fact for name, fact in facts.items() if fact is not None}
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    return content.getvalue()
