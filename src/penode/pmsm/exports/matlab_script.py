"""MATLAB script that makes the variables for look-up tables in Simulink and Simscape."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from penode.arrays import FloatArray

_HEAD = """% Flux-linkage map of a permanent-magnet synchronous machine, written by penode.
% Currents in A (peak value of a phase, rotor frame, d axis on the magnet), flux linkages in Vs.
% FEM-Parameterized PMSM (Simscape), 2-D: iD vector idVec, iQ vector iqVec, flux linkages fluxD and
% fluxQ, torque torque, stator resistance Rs, pole pairs polePairs.
% Look-up tables (Simulink): i(psi) is idOfFlux, iqOfFlux over fluxDVec, fluxQVec.
"""


def encode(variables: Mapping[str, Any]) -> str:
    """Return the text of what `penode.pmsm.exports.matlab_tables.variables` gives; 17 digits."""
    return _HEAD + "".join(f"{name} = {_literal(one)};\n" for name, one in variables.items())


def _literal(one: FloatArray | float | str) -> str:
    if isinstance(one, str):
        return "'" + one.replace("'", "''") + "'"
    rows = [" ".join(f"{value:.17g}" for value in row) for row in np.atleast_2d(one)]
    return rows[0] if np.ndim(one) == 0 else "[" + "; ...\n ".join(rows) + "]"
