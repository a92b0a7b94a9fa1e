"""Physics of processes, tanks, heat and reactors: what penode is given, and the plants."""

from collections.abc import Mapping, Sequence
from math import exp, sqrt
from typing import Any

import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.models.inputs import Inputs
from validate.physics.kind import Kind
from validate.physics.signals import ramps, steps

Numbers, Named = Sequence[float], Mapping[str, float]

_RENEWAL, _FEED, _REFERENCE = 0.01, 350.0, 350.0  # 1/s, K, K
_ENZYME = 0.2  # mol/m3


def _three_tanks(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    one, two, three = jnp.sqrt(jnp.maximum(x, 1e-3))
    return (
        m.pump * u["voltage"] - m.c1 * one,
        m.c1 * one - m.c2 * two,
        m.c2 * two - m.c3 * three,
    )


def _three_tanks_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    out = [p[name] * sqrt(max(level, 1e-3)) for name, level in zip(("c1", "c2", "c3"), x)]  # noqa: B905
    return p["pump"] * u[0] - out[0], out[0] - out[1], out[1] - out[2]


def _thermal_four(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    one, two, three = m.g1 * (x[0] - x[1]), m.g2 * (x[1] - x[2]), m.g3 * (x[2] - x[3])
    flows = (u["heat"] - one, one - two, two - three, three - m.loss * x[3])
    return tuple(flow / m.C for flow in flows)


def _chain(conductances: Numbers, loss: float) -> np.ndarray:
    """Return the matrix of heat flows of nodes in a row, the last of which loses heat."""
    inner = np.array(conductances)
    diagonal = np.append(inner, loss) + np.insert(inner, 0, 0.0)
    return np.diag(inner, 1) + np.diag(inner, -1) - np.diag(diagonal)


def _thermal_four_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    flows = _chain([p["g1"], p["g2"], p["g3"]], p["loss"]) @ x
    flows[0] += u[0]
    return flows / p["C"]


def _thermal_six(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    between = m.g * (x[:-1] - x[1:])
    into = [u["heat"], *between]
    out = [*between, m.loss * x[5]]
    flows = [a - b for a, b in zip(into, out, strict=True)]
    return [flow / (m.wall if k % 2 else m.room) for k, flow in enumerate(flows)]


def _thermal_six_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    flows = _chain([p["g"]] * 5, p["loss"]) @ x
    flows[0] += u[0]
    return flows / np.array([p["room"], p["wall"]] * 3)


def _cstr(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    c, temperature = x
    rate = m.k * jnp.exp(m.E * (1 / _REFERENCE - 1 / temperature)) * c
    cooling = m.cooling * (temperature - u["jacket"])
    return (
        _RENEWAL * (u["feed"] - c) - rate,
        _RENEWAL * (_FEED - temperature) + m.heat * rate - cooling,
    )


def _cstr_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    jacket, feed = u
    reacted = p["k"] * x[0] * exp(p["E"] * (x[1] - 350.0) / (350.0 * x[1]))
    warm = 3.5 - (0.01 + p["cooling"]) * x[1] + p["cooling"] * jacket + p["heat"] * reacted
    return 0.01 * feed - 0.01 * x[0] - reacted, warm


def _michaelis_menten(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    s, c, product = x
    binding = m.on * s * (_ENZYME - c) - m.off * c
    return u["feed"] - binding, binding - m.cat * c, m.cat * c - m.out * product


def _michaelis_menten_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    on, off, cat = p["on"], p["off"], p["cat"]
    free = 0.2 - x[1]
    substrate = u[0] - on * free * x[0] + off * x[1]
    return substrate, on * free * x[0] - (off + cat) * x[1], cat * x[1] - p["out"] * x[2]


THREE_TANKS = Kind(
    "three_tanks", _three_tanks, _three_tanks_plant,
    {"upper": "m", "middle": "m", "lower": "m"},
    {"upper": (2, 6), "middle": (2, 6), "lower": (2, 6)}, {"voltage": steps(1, 5, 25)},
    {
        "pump": ("m/(V s)", 0.15, 0.3), "c1": ("m^0.5/s", 0.25, 0.4), "c2": ("m^0.5/s", 0.25, 0.4),
        "c3": ("m^0.5/s", 0.25, 0.4),
    },
    step=1.0, samples=1200, measured=("upper", "lower"),
)  # fmt: skip
THERMAL_FOUR = Kind(
    "thermal_four", _thermal_four, _thermal_four_plant,
    {"T1": "K", "T2": "K", "T3": "K", "T4": "K"}, dict.fromkeys(("T1", "T2", "T3", "T4"), (0, 0)),
    {"heat": steps(0, 100, 40)},
    {
        "C": ("J/K", 50, 150), "g1": ("W/K", 2, 6), "g2": ("W/K", 2, 6), "g3": ("W/K", 2, 6),
        "loss": ("W/K", 0.5, 2),
    },
    step=2.0, samples=2000, measured=("T1", "T4"),
)  # fmt: skip
#: Rooms and thin walls by turns: of a wall rate times sampling interval is 0.8 to 3.
THERMAL_SIX = Kind(
    "thermal_six", _thermal_six, _thermal_six_plant,
    {f"T{k}": "K" for k in range(1, 7)}, {f"T{k}": (0, 0) for k in range(1, 7)},
    {"heat": ramps(0, 100, 60)},
    {
        "room": ("J/K", 50, 150), "wall": ("J/K", 2, 4), "g": ("W/K", 3, 6),
        "loss": ("W/K", 0.5, 2),
    },
    step=0.5, samples=4000, measured=("T1", "T3", "T6"),
)  # fmt: skip
CSTR = Kind(
    "cstr", _cstr, _cstr_plant,
    {"c": "mol/m3", "T": "K"}, {"c": (0.5, 0.9), "T": (330, 350)},
    {"jacket": steps(290, 330, 30), "feed": steps(0.6, 1.4, 50)},
    {
        "k": ("1/s", 3e-3, 8e-3), "E": ("K", 5000, 9000), "heat": ("K m3/mol", 60, 120),
        "cooling": ("1/s", 0.01, 0.02),
    },
    step=5.0, samples=1500,
)  # fmt: skip
CSTR_TEMPERATURE = CSTR.variant("cstr_temperature", measured=("T",))
#: The complex follows the substrate within some samples: their rates are apart by a hundred.
MICHAELIS_MENTEN = Kind(
    "michaelis_menten", _michaelis_menten, _michaelis_menten_plant,
    {"s": "mol/m3", "complex": "mol/m3", "product": "mol/m3"},
    {"s": (0, 0.1), "complex": (0, 0.02), "product": (0, 0.5)}, {"feed": steps(0.02, 0.28, 25)},
    {
        "on": ("m3/(mol s)", 100, 300), "off": ("1/s", 1, 3), "cat": ("1/s", 1.6, 3),
        "out": ("1/s", 0.1, 0.3),
    },
    step=0.02, samples=2000, measured=("s", "product"),
)  # fmt: skip
