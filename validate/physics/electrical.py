"""Electrical physics: what penode is given, and the plants."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from penode.arrays import JaxArray
from penode.models.inputs import Inputs
from validate.physics.kind import Kind
from validate.physics.signals import ramps, steps

Numbers, Named = Sequence[float], Mapping[str, float]


def _dc_motor(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    i, w = x
    return (
        (u["voltage"] - m.R * i - m.k * w) / m.L,
        (m.k * i - m.b * w - u["load"]) / m.J,
    )


def _dc_motor_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    matrix = np.array([[-p["R"] / p["L"], -p["k"] / p["L"]], [p["k"] / p["J"], -p["b"] / p["J"]]])
    return matrix @ x + [u[0] / p["L"], -u[1] / p["J"]]


def _boost_converter(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    i, v = x
    off = 1.0 - u["duty"]
    return (u["supply"] - m.r * i - off * v) / m.L, (off * i - v / m.load) / m.C


def _boost_converter_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    duty, supply = u
    coil = supply - x[1] + duty * x[1] - x[0] * p["r"]
    return coil / p["L"], ((1 - duty) * x[0] * p["load"] - x[1]) / (p["load"] * p["C"])


def _rlc_ladder(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    i1, v1, i2, v2 = x
    return (
        (u["source"] - m.R * i1 - v1) / m.L1,
        (i1 - i2) / m.C1,
        (v1 - v2) / m.L2,
        (i2 - v2 / m.load) / m.C2,
    )


def _rlc_ladder_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    stores = np.array([p["L1"], p["C1"], p["L2"], p["C2"]])
    matrix = np.diag([1.0, 1.0, 1.0], -1) - np.diag([1.0, 1.0, 1.0], 1)
    matrix[0, 0], matrix[3, 3] = -p["R"], -1 / p["load"]
    return (matrix @ x + [u[0], 0, 0, 0]) / stores


def _battery(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    both, fast = x
    fast_rate = (u["current"] - fast / m.R1) / m.C1
    return fast_rate + (u["current"] - (both - fast) / m.R2) / m.C2, fast_rate


def _battery_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    one = u[0] / p["C1"] - x[1] / (p["R1"] * p["C1"])
    two = u[0] / p["C2"] - (x[0] - x[1]) / (p["R2"] * p["C2"])
    return one + two, one


DC_MOTOR = Kind(
    "dc_motor", _dc_motor, _dc_motor_plant,
    {"current": "A", "speed": "rad/s"}, {"current": (0, 0), "speed": (0, 0)},
    {"voltage": steps(-12, 12, 15), "load": steps(-0.2, 0.2, 40)},
    {
        "R": ("ohm", 0.5, 1.5), "L": ("H", 2e-3, 6e-3), "k": ("Vs", 0.05, 0.1),
        "J": ("kg m2", 1e-4, 4e-4), "b": ("Nms", 1e-4, 5e-4),
    },
    step=1e-3, samples=1500,
)  # fmt: skip
#: The current settles within a sample: its rate times the sampling interval is 2.6 to 6.
DC_MOTOR_COARSE = DC_MOTOR.variant(
    "dc_motor_coarse",
    parameters={**DC_MOTOR.parameters, "R": ("ohm", 0.8, 1.2), "L": ("H", 2e-4, 3e-4)},
)
BOOST_CONVERTER = Kind(
    "boost_converter", _boost_converter, _boost_converter_plant,
    {"current": "A", "voltage": "V"}, {"current": (1, 4), "voltage": (15, 25)},
    {"duty": steps(0.3, 0.6, 40), "supply": steps(11, 13, 100)},
    {
        "L": ("H", 1e-4, 3e-4), "C": ("F", 1e-4, 4e-4), "r": ("ohm", 0.05, 0.2),
        "load": ("ohm", 5, 15),
    },
    step=5e-5, samples=2000,
)  # fmt: skip
RLC_LADDER = Kind(
    "rlc_ladder", _rlc_ladder, _rlc_ladder_plant,
    {"i1": "A", "v1": "V", "i2": "A", "v2": "V"}, dict.fromkeys(("i1", "v1", "i2", "v2"), (0, 0)),
    {"source": ramps(-10, 10, 15)},
    {
        "R": ("ohm", 20, 60), "L1": ("H", 5e-4, 2e-3), "C1": ("F", 5e-7, 2e-6),
        "L2": ("H", 5e-4, 2e-3), "C2": ("F", 5e-7, 2e-6), "load": ("ohm", 50, 150),
    },
    step=5e-6, samples=2000, measured=("i1", "v2"),
)  # fmt: skip
BATTERY = Kind(
    "battery", _battery, _battery_plant,
    {"drop": "V", "fast": "V"}, {"drop": (0, 0), "fast": (0, 0)}, {"current": steps(-50, 50, 40)},
    {
        "R1": ("ohm", 0.01, 0.03), "C1": ("F", 1e3, 3e3), "R2": ("ohm", 0.02, 0.05),
        "C2": ("F", 8e3, 2e4),
    },
    step=2.0, samples=2500, measured=("drop",),
)  # fmt: skip
