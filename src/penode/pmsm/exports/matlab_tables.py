"""Variables for look-up tables in Simulink and Simscape: psi(i), L(i), i(psi) and i(T)."""

from typing import Any

from penode.arrays import FloatArray
from penode.pmsm.exports.control_tables import InverseMap, TorquePerAmpere
from penode.pmsm.machine.angle_grid import AngleGrid
from penode.pmsm.machine.flux_grid import FluxGrid


def variables(grid: FluxGrid, inverse: InverseMap, mtpa: TorquePerAmpere | None) -> dict[str, Any]:
    """Return the variables by name.

    Breakpoints ``idVec``, ``iqVec`` (A), zero exactly among them; over them, i_d along the rows,
    ``fluxD``, ``fluxQ`` (Vs), ``lDD``, ``lDQ``, ``lQD``, ``lQQ`` (H) and ``supported``. Breakpoints
    ``fluxDVec``, ``fluxQVec`` (Vs); over them ``idOfFlux``, ``iqOfFlux`` (A) and
    ``supportedOfFlux``. Where the pole pairs are known breakpoints ``torqueVec`` (Nm) and the least
    currents for them, ``idOfTorque``, ``iqOfTorque`` (A), ``torque`` over currents (Nm) and
    ``polePairs``. Where known ``Rs`` (ohm), ``RsTemperature`` (degC), ``RsCoefficient`` (1/K) and
    ``magnetTemperature`` (degC); ``temperatures`` is a text that says the same.
    """
    tables: dict[str, Any] = {
        "idVec": grid.i_d,
        "iqVec": grid.i_q,
        "fluxD": grid.psi[0],
        "fluxQ": grid.psi[1],
        "supported": grid.supported.astype(float),
        "fluxDVec": inverse.psi_d,
        "fluxQVec": inverse.psi_q,
        "idOfFlux": inverse.current[0],
        "iqOfFlux": inverse.current[1],
        "supportedOfFlux": inverse.supported.astype(float),
    }
    if mtpa is not None:
        i_d, i_q = mtpa.current
        tables |= {"torqueVec": mtpa.torque, "idOfTorque": i_d, "iqOfTorque": i_q}
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
    return tables | {name: fact for name, fact in facts.items() if fact is not None}


def over_turn(turned: AngleGrid | None) -> dict[str, Any]:
    """Return what depends on the angle, by name; nothing where nothing does.

    ``angleVec`` (electrical degrees, 0 to 360); over i_d, i_q and it ``fluxDOfAngle``,
    ``fluxQOfAngle`` (Vs) and, with pole pairs, ``torqueOfAngle`` (Nm).
    """
    if turned is None:
        return {}
    tables = {
        "angleVec": turned.angle,
        "fluxDOfAngle": turned.psi[0],
        "fluxQOfAngle": turned.psi[1],
    }
    return tables if turned.torque is None else tables | {"torqueOfAngle": turned.torque}


def _entries(grid: FluxGrid) -> FloatArray:
    return grid.inductance.reshape(4, *grid.supported.shape)
