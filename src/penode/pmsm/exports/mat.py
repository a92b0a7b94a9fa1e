"""MATLAB file for look-up tables in Simulink and Simscape: psi(i), L(i) and i(psi)."""

import io
from typing import Any

import numpy as np
from scipy.io import savemat
from scipy.spatial import cKDTree

from penode.arrays import FloatArray
from penode.fit.fit import Fit
from penode.pmsm.control.inversion import inverse
from penode.pmsm.machine.flux_grid import FluxGrid


def encode(fit: Fit, grid: FluxGrid) -> bytes:
    """Return the file of a machine's map over currents, and of currents over flux linkages.

    Breakpoints ``idVec``, ``iqVec`` (A), zero exactly among them; over them, i_d along the rows,
    ``fluxD``, ``fluxQ`` (Vs), ``lDD``, ``lDQ``, ``lQD``, ``lQQ`` (H) and ``supported``. Breakpoints
    ``fluxDVec``, ``fluxQVec`` (Vs); over them ``idOfFlux``, ``iqOfFlux`` (A) and
    ``supportedOfFlux``. Where known ``torque`` (Nm), ``polePairs``, ``Rs`` (ohm), ``RsTemperature``
    (degC), ``RsCoefficient`` (1/K) and ``magnetTemperature`` (degC). ``temperatures`` is a text
    that says the same.
    """
    tables: dict[str, Any] = {
        "idVec": grid.i_d,
        "iqVec": grid.i_q,
        "fluxD": grid.psi[0],
        "fluxQ": grid.psi[1],
        "supported": grid.supported.astype(float),
        **_inverse_tables(fit, grid),
    }
    for name, table in zip(("lDD", "lDQ", "lQD", "lQQ"), _entries(grid), strict=True):
        tables[name] = table
    known = grid.temperatures
    facts = {
        "torque": grid.torque,
        "polePairs": grid.pole_pairs,
        "Rs": grid.resistance,
        "RsTemperature": known.resistance,
        "RsCoefficient": known.coefficient,
        "magnetTemperature": known.magnets,
        "temperatures": known.sentences,
    }
    tables |= {name: fact for name, fact in facts.items() if fact is not None}
    content = io.BytesIO()
    savemat(content, tables, do_compression=True)
    return content.getvalue()


def _entries(grid: FluxGrid) -> FloatArray:
    return grid.inductance.reshape(4, *grid.supported.shape)


def _inverse_tables(fit: Fit, grid: FluxGrid) -> dict[str, FloatArray]:
    """Return i(psi) on an even grid over the flux linkages of the supported region.

    The corners of that rectangle may belong to currents beyond the grid, or to none: they hold what
    was found, or the nearest point of the table, and are not supported.
    """
    flux, current = grid.psi.reshape(2, -1), grid.mesh.reshape(2, -1)
    inside = flux[:, grid.supported.ravel()] if grid.supported.any() else flux
    count = len(grid.i_d)
    axes = [np.linspace(one.min(), one.max(), count) for one in inside]
    targets = np.stack(np.meshgrid(*axes, indexing="ij")).reshape(2, -1)
    nearest = current[:, cKDTree(flux.T).query(targets.T)[1]]
    currents = inverse(
        lambda i: fit.flux_map(*i), lambda i: fit.differential_inductance(*i), targets, nearest
    )
    reach = np.array([np.ptp(grid.i_d), np.ptp(grid.i_q)])[:, None]
    lost = ~(np.abs(currents - nearest) <= reach).all(axis=0)
    currents = np.where(lost, nearest, currents)
    supported = fit.supported(currents.T) & ~lost
    i_d, i_q, flags = (one.reshape(count, count) for one in (*currents, supported.astype(float)))
    return {
        "fluxDVec": axes[0],
        "fluxQVec": axes[1],
        "idOfFlux": i_d,
        "iqOfFlux": i_q,
        "supportedOfFlux": flags,
    }
