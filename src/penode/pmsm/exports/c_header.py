"""C99 header: float tables over even currents, and their bilinear look-up without search.

Written with MISRA C in mind: no allocation, recursion, pointer or loop; explicit conversions; one
return a function. The look-up is clamped at the edges, and takes what is not a number for the
lowest current. Its text is ``flux_map.h.template``.
"""

import re
from importlib.resources import files
from string import Template
from textwrap import wrap

import numpy as np

from penode.arrays import FloatArray
from penode.pmsm.machine.flux_grid import FluxGrid


def encode(grid: FluxGrid, name: str) -> str:
    """Return the header of a map on even currents with zero among them; names start with ``name``.

    It has ``NAME_flux(i_d, i_q)`` in Vs, ``NAME_inductance(i_d, i_q)`` in H,
    ``NAME_is_supported(i_d, i_q)``, and where known the constants ``NAME_RESISTANCE`` (ohm),
    ``NAME_RESISTANCE_TEMPERATURE`` (degC), ``NAME_RESISTANCE_COEFFICIENT`` (1/K),
    ``NAME_MAGNET_TEMPERATURE`` (degC) and ``NAME_POLE_PAIRS``. What C does not allow in a name
    becomes ``_``.
    """
    prefix = identifier(name)
    known = grid.temperatures
    floats = {
        "RESISTANCE": grid.resistance,
        "RESISTANCE_TEMPERATURE": known.resistance,
        "RESISTANCE_COEFFICIENT": known.coefficient,
        "MAGNET_TEMPERATURE": known.magnets,
    }
    facts = {key: _float(value) for key, value in floats.items() if value is not None}
    if grid.pole_pairs is not None:
        facts["POLE_PAIRS"] = f"{grid.pole_pairs}U"
    entries = grid.inductance.reshape(4, *grid.supported.shape)
    text = files("penode.pmsm.exports").joinpath("flux_map.h.template").read_text(encoding="utf-8")
    return Template(text).substitute(
        _axis("d", grid.i_d) | _axis("q", grid.i_q),
        name=prefix,
        NAME=prefix.upper(),
        rows=f"{len(grid.i_d)}U",
        columns=f"{len(grid.i_q)}U",
        range=f"i_d {_range(grid.i_d)}, i_q {_range(grid.i_q)} A",
        within=_within(grid),
        temperatures="\n".join(f" * {line}" for line in wrap(known.sentences, 90)),
        constants="".join(
            f"#define {prefix.upper()}_{key} ({value})\n" for key, value in facts.items()
        ),
        flux=_points(grid.psi),
        inductance=_points(entries),
        supported=_nested([", ".join(f"{int(one)}U" for one in row) for row in grid.supported]),
    )


def identifier(name: str) -> str:
    """Return a name as C allows it: ASCII letters, digits and ``_``, a letter first."""
    legal = re.sub(r"\W", "_", name, flags=re.ASCII)
    return legal if re.match("[A-Za-z]", legal) else f"map_{legal}"


def _axis(axis: str, currents: FloatArray) -> dict[str, str]:
    return {
        f"{axis}_per_ampere": _float(1 / (currents[1] - currents[0])),
        f"{axis}_zero": _float(float(np.flatnonzero(currents == 0)[0])),
    }


def _within(grid: FluxGrid) -> str:
    """Return the condition that currents lie on the grid."""
    sides = (("i_d", grid.i_d), ("i_q", grid.i_q))
    return "\n        && ".join(
        f"({name} >= {_float(axis[0])}) && ({name} <= {_float(axis[-1])})" for name, axis in sides
    )


def _range(currents: FloatArray) -> str:
    return f"{currents[0]:.6g} to {currents[-1]:.6g}"


def _points(values: FloatArray) -> str:
    """Return values (entry, row, column) as initialisers, one point a line."""
    points = [["{" + ", ".join(map(_float, one)) + "}" for one in row] for row in values.T]
    by_row = zip(*points, strict=True)
    return _nested([",\n     ".join(row) for row in by_row])


def _nested(rows: list[str]) -> str:
    return "    {" + "},\n    {".join(rows) + "}"


def _float(value: float) -> str:
    text = f"{np.float32(value):.9g}"
    return (text if re.search(r"[.e]", text) else f"{text}.0") + "F"
