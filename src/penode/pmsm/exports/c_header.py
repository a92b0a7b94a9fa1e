"""C99 header: tables over even axes, in float or in 16-bit integers, and their look-up.

Written with MISRA C in mind: no allocation, recursion, pointer or loop; explicit conversions; one
return a function. A look-up is without search and clamped at the edges, and takes what is not a
number for the lowest value. The text is ``flux_map.h.template``.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files
from textwrap import wrap
from typing import Any

import numpy as np

from penode.arrays import FloatArray
from penode.pmsm.exports.control_tables import InverseMap, TorquePerAmpere
from penode.pmsm.machine.flux_grid import FluxGrid

#: Largest count of a table, at which no torque exceeds 16 bits; bits behind the point of a place.
_MOST, _BITS = 32_000, 32
#: Points of a cell's side at which the inverse is tested.
_FINE = 8


def encode(
    grid: FluxGrid,
    name: str,
    inverse: InverseMap,
    mtpa: TorquePerAmpere | None,
    *,
    fixed: bool = False,
) -> str:
    """Return the header of a map on even currents with zero among them; names start with ``name``.

    It has ``NAME_flux(i_d, i_q)`` in Vs, ``NAME_current(psi_d, psi_q)`` in A,
    ``NAME_inductance(i_d, i_q)`` in H, ``NAME_is_supported(i_d, i_q)``,
    ``NAME_current_is_supported(psi_d, psi_q)``; with pole pairs ``NAME_torque(i_d, i_q)`` in Nm and
    ``NAME_mtpa(torque)`` in A; and where known the constants ``NAME_RESISTANCE`` (ohm),
    ``NAME_RESISTANCE_TEMPERATURE`` (degC), ``NAME_RESISTANCE_COEFFICIENT`` (1/K),
    ``NAME_MAGNET_TEMPERATURE`` (degC) and ``NAME_POLE_PAIRS``. What C does not allow in a name
    becomes ``_``. ``fixed`` makes them functions of 16-bit counts, without the inductances;
    ``NAME_AMPERE_PER_COUNT``, ``NAME_VOLT_SECOND_PER_COUNT`` and ``NAME_NEWTON_METRE_PER_COUNT``
    say what one is, and the head what rounding costs.
    """
    # Imported here, as most commands write no header.
    from jinja2 import Environment, StrictUndefined

    text = files("penode.pmsm.exports").joinpath("flux_map.h.template").read_text(encoding="utf-8")
    setup = Environment(
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True, undefined=StrictUndefined
    )
    written = _Counts.of(grid, inverse) if fixed else _Floats()
    prefix = identifier(name)
    made = setup.from_string(text).render(
        written.facts(grid, inverse) | _there_and_back(grid, inverse),
        name=prefix,
        NAME=prefix.upper(),
        fixed=fixed,
        rows=len(grid.i_d),
        columns=len(grid.i_q),
        points=0 if mtpa is None else len(mtpa.torque),
        range=f"i_d {_range(grid.i_d)}, i_q {_range(grid.i_q)} A",
        temperatures=wrap(grid.temperatures.sentences, 90),
        dead_time=grid.dead_time_voltage is not None,
        constants=_constants(grid, prefix.upper(), written.units(grid.pole_pairs)),
        torques="" if mtpa is None else _range(mtpa.torque),
        supported_torques="" if mtpa is None else mtpa.supported,
        torque_factor="" if mtpa is None else _float(1.5 * (grid.pole_pairs or 0)),
        axes={
            "i_d": written.axis(grid.i_d, "current"),
            "i_q": written.axis(grid.i_q, "current"),
            "psi_d": written.axis(inverse.psi_d, "flux"),
            "psi_q": written.axis(inverse.psi_q, "flux"),
            "torque": "" if mtpa is None else written.axis(mtpa.torque, "torque"),
        },
        tables={
            "flux": _points(grid.psi, written.literal("flux")),
            "inductance": _points(
                grid.inductance.reshape(4, *grid.supported.shape), written.literal("inductance")
            ),
            "current": _points(inverse.current, written.literal("current")),
            "mtpa": mtpa and _point_rows(mtpa.current, written.literal("current")),
            "supported": _flags(grid.supported),
            "flux_supported": _flags(inverse.supported),
        },
        within={
            "currents": _within(written, "current", i_d=grid.i_d, i_q=grid.i_q),
            "fluxes": _within(written, "flux", psi_d=inverse.psi_d, psi_q=inverse.psi_q),
        },
    )
    return re.sub(r"\n{3,}", "\n\n", made)


def _there_and_back(grid: FluxGrid, inverse: InverseMap) -> dict[str, str]:
    """Return by how much a current is off behind both look-ups, at some points of each cell, A."""
    # Imported here, as most commands write no header.
    from scipy.interpolate import RegularGridInterpolator

    def looked_up(axes: tuple[FloatArray, FloatArray], table: FloatArray, at: FloatArray) -> Any:
        return RegularGridInterpolator(axes, np.moveaxis(table, 0, -1), bounds_error=False)(at)

    currents, fluxes = (grid.i_d, grid.i_q), (inverse.psi_d, inverse.psi_q)
    fine = [np.linspace(axis[0], axis[-1], _FINE * (len(axis) - 1) + 1) for axis in currents]
    at = np.stack(np.meshgrid(*fine, indexing="ij"), axis=-1).reshape(-1, 2)
    backed = looked_up(currents, np.where(grid.supported, grid.psi, np.nan), at)
    table = np.where(inverse.supported, inverse.current, np.nan)
    off = np.hypot(*(looked_up(fluxes, table, backed) - at).T)
    off = off[np.isfinite(off)]
    if not off.size:
        return {"back": "", "usual": ""}
    # Two digits, rounded up.
    return {"back": f"{1.05 * off.max():.2g}", "usual": f"{np.sqrt(np.mean(off**2)):.2g}"}


def identifier(name: str) -> str:
    """Return a name as C allows it: ASCII letters, digits and ``_``, a letter first."""
    legal = re.sub(r"\W", "_", name, flags=re.ASCII)
    return legal if re.match("[A-Za-z]", legal) else f"map_{legal}"


class _Floats:
    """Numbers as float."""

    def facts(self, grid: FluxGrid, inverse: InverseMap) -> dict[str, Any]:
        return {"number": "float", "wide": "float", "errors": ()}

    def units(self, pole_pairs: int | None) -> dict[str, float]:
        return {}

    def axis(self, values: FloatArray, quantity: str) -> str:
        """Return cells a unit and the place of zero."""
        step = (values[-1] - values[0]) / (len(values) - 1)
        zero = round(-values[0] / step, 9)  # a whole number where zero is a point
        return f"{_float(1 / step)}, {_float(zero)}"

    def literal(self, quantity: str) -> Callable[[float], str]:
        return _float


@dataclass(frozen=True)
class _Counts:
    """Numbers as 16-bit counts of ``current`` (A) and ``flux`` (Vs)."""

    current: float
    flux: float
    torque: float

    @classmethod
    def of(cls, grid: FluxGrid, inverse: InverseMap) -> "_Counts":
        backed = inverse.current[:, inverse.supported]
        current = max(float(np.abs(one).max(initial=0)) for one in (grid.mesh, backed)) / _MOST
        flux = float(np.abs(grid.psi).max()) / _MOST
        return cls(current, flux, 1.5 * (grid.pole_pairs or 1) * current * flux * 2**16)

    def facts(self, grid: FluxGrid, inverse: InverseMap) -> dict[str, Any]:
        currents, fluxes = (grid.i_d, grid.i_q), (inverse.psi_d, inverse.psi_q)
        psi = np.where(grid.supported, self.counts(grid.psi, "flux"), np.nan)
        current = np.where(inverse.supported, self.counts(inverse.current, "current"), np.nan)
        errors = (
            self.flux * _rounding(psi, currents, self.current),
            self.current * _rounding(current, fluxes, self.flux),
        )
        # Two digits, rounded up.
        shown = [f"{1.05 * error:.1e}" for error in errors]
        return {"number": "int16_t", "wide": "int32_t", "errors": shown}

    def units(self, pole_pairs: int | None) -> dict[str, float]:
        units = {"AMPERE_PER_COUNT": self.current, "VOLT_SECOND_PER_COUNT": self.flux}
        return units | ({} if pole_pairs is None else {"NEWTON_METRE_PER_COUNT": self.torque})

    def counts(self, values: FloatArray, quantity: str) -> FloatArray:
        """Return whole counts of a quantity, the largest there is beyond it."""
        unit = getattr(self, quantity)
        return np.asarray(np.clip(np.round(values / unit), -_MOST, _MOST))

    def axis(self, values: FloatArray, quantity: str) -> str:
        """Return the first and the last value, and cells a count."""
        first, last = self.counts(values[[0, -1]], quantity)
        per_count = int((len(values) - 1) * 2**_BITS / (last - first))
        return f"{first:.0f}, {last:.0f}, {per_count}U"

    def literal(self, quantity: str) -> Callable[[float], str]:
        if quantity == "inductance":
            return str
        return lambda value: f"{self.counts(np.asarray(value), quantity):.0f}"


def _rounding(table: FloatArray, axes: tuple[FloatArray, FloatArray], unit: float) -> float:
    """Return a bound of the error of a look-up by rounding, in counts of the table, NaN left out.

    Half a count of a point, one of each interpolation, and what a cell's rise makes of a place that
    is off by a count of the axis and the last bit.
    """
    places = [2.0**-15 + unit * (len(axis) - 1) / np.ptp(axis) for axis in axes]
    rises = [float(np.nanmax(np.abs(np.diff(table, axis=k + 1)))) for k in range(2)]
    return 0.5 + 2 + sum(rise * place for rise, place in zip(rises, places, strict=True))


def _constants(grid: FluxGrid, prefix: str, units: dict[str, float]) -> str:
    known = grid.temperatures
    floats = {
        "RESISTANCE": grid.resistance,
        "RESISTANCE_TEMPERATURE": known.resistance,
        "RESISTANCE_COEFFICIENT": known.coefficient,
        "MAGNET_TEMPERATURE": known.magnets,
        "DEAD_TIME_VOLTAGE": grid.dead_time_voltage,
        **units,
    }
    facts = {key: _float(value) for key, value in floats.items() if value is not None}
    if grid.pole_pairs is not None:
        facts["POLE_PAIRS"] = f"{grid.pole_pairs}U"
    return "".join(f"#define {prefix}_{key} ({value})\n" for key, value in facts.items())


def _within(written: "_Floats | _Counts", quantity: str, **axes: FloatArray) -> str:
    """Return the condition that values lie on their axes."""
    show = written.literal(quantity)
    return "\n        && ".join(
        f"({name} >= {show(axis[0])}) && ({name} <= {show(axis[-1])})"
        for name, axis in axes.items()
    )


def _range(currents: FloatArray) -> str:
    return f"{currents[0]:.6g} to {currents[-1]:.6g}"


def _point_rows(values: FloatArray, show: Callable[[float], str]) -> str:
    """Return values (entry, point) as initialisers, one point a line."""
    return ",\n".join("    {" + ", ".join(map(show, one)) + "}" for one in values.T)


def _points(values: FloatArray, show: Callable[[float], str]) -> str:
    """Return values (entry, row, column) as initialisers, one point a line."""
    points = [["{" + ", ".join(map(show, one)) + "}" for one in row] for row in values.T]
    by_row = zip(*points, strict=True)
    return _nested([",\n     ".join(row) for row in by_row])


def _flags(supported: Any) -> str:
    return _nested([", ".join(f"{int(one)}U" for one in row) for row in supported])


def _nested(rows: list[str]) -> str:
    return "    {" + "},\n    {".join(rows) + "}"


def _float(value: float) -> str:
    text = f"{np.float32(value):.9g}"
    return (text if re.search(r"[.e]", text) else f"{text}.0") + "F"
