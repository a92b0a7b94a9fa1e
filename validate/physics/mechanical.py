"""Mechanical physics: what penode is given, and the plants."""

from collections.abc import Mapping, Sequence
from math import cos, sin, sqrt
from typing import Any

import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.models.inputs import Inputs
from validate.physics.kind import Kind
from validate.physics.signals import ramps, sines, steps

Numbers, Named = Sequence[float], Mapping[str, float]

_G = 9.81  # m/s2
_BODY = 300.0  # kg, of the quarter car
_PISTON, _SUPPLY, _SPRING = 1e-3, 1e7, 2e4  # m2, Pa, N/m


def _pendulum(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    return x[1], m.gain * u["torque"] - m.damping * x[1] - m.w2 * jnp.sin(x[0])


def _pendulum_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    angle, speed = x
    return speed, -p["w2"] * sin(angle) - p["damping"] * speed + p["gain"] * u[0]


def _two_mass(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    motor, twist, load = x
    shaft = m.k * twist + m.d * (motor - load)
    return (u["torque"] - shaft - m.b * motor) / m.J1, motor - load, shaft / m.J2


def _two_mass_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    k, d, b, one, two = p["k"], p["d"], p["b"], p["J1"], p["J2"]
    matrix = np.array(
        [[-(d + b) / one, -k / one, d / one], [1, 0, -1], [d / two, k / two, -d / two]]
    )
    return matrix @ x + [u[0] / one, 0, 0]


def _three_mass(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    y, v = x[:3], x[3:]
    one, two, three = m.k1 * y[0], m.k2 * (y[1] - y[0]), m.k3 * (y[2] - y[1])
    forces = (u["force"] - one + two, three - two, -three)
    return *v, *((f - m.d * s) / m.m for f, s in zip(forces, v, strict=True))


def _three_mass_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    springs = np.diag([p["k1"] + p["k2"], p["k2"] + p["k3"], p["k3"]])
    springs -= np.diag([p["k2"], p["k3"]], 1) + np.diag([p["k2"], p["k3"]], -1)
    place, speed = np.array(x[:3]), np.array(x[3:])
    push = np.array([u[0], 0, 0])
    return [*speed, *((push - springs @ place - p["d"] * speed) / p["m"])]


def _duffing(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    y, v = x
    return v, m.gain * u["force"] - m.d * v - m.a * y - m.b * y**3


def _duffing_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    stiffness = p["a"] + p["b"] * x[0] * x[0]
    return x[1], p["gain"] * u[0] - stiffness * x[0] - p["d"] * x[1]


def _quarter_car(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    body, wheel, rising, bouncing = x
    strut = m.k * (wheel - body) + m.c * (bouncing - rising)
    return rising, bouncing, strut / _BODY, (m.tyre * (u["road"] - wheel) - strut) / m.wheel


def _quarter_car_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    k, c, t, w = p["k"], p["c"], p["tyre"], p["wheel"]
    above = (-k * x[0] + k * x[1] - c * x[2] + c * x[3]) / 300.0
    below = (k * x[0] - (k + t) * x[1] + c * x[2] - c * x[3] + t * u[0]) / w
    return x[2], x[3], above, below


def _crane(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    _, angle, v, turn = x
    s, c = jnp.sin(angle), jnp.cos(angle)
    load = m.load * s * (_G * c + m.length * turn**2)
    a = (u["force"] - m.drag * v + load) / (m.cart + m.load * s**2)
    return v, turn, a, -(a * c + _G * s) / m.length


def _crane_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    _, angle, v, turn = x
    load, length, total = p["load"], p["length"], p["cart"] + p["load"]
    off = load * length * cos(angle)
    push = u[0] - p["drag"] * v + load * length * turn * turn * sin(angle)
    fall = -load * 9.81 * length * sin(angle)
    inertia = load * length * length
    det = total * inertia - off * off
    return v, turn, (inertia * push - off * fall) / det, (total * fall - off * push) / det


def _cylinder(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    place, speed, pressure = x
    drop = 1.0 - jnp.sign(u["valve"]) * pressure / _SUPPLY
    flow = m.q * u["valve"] * jnp.sqrt(jnp.maximum(drop, 1e-3))
    force = _PISTON * pressure - _SPRING * place - m.b * speed
    return speed, force / m.m, m.E * (flow - _PISTON * speed - m.leak * pressure)


def _cylinder_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    open_to = 1e7 - x[2] if u[0] > 0 else 1e7 + x[2]
    oil = p["q"] * u[0] * sqrt(max(open_to, 1e4) / 1e7) - 1e-3 * x[1] - p["leak"] * x[2]
    return x[1], (1e-3 * x[2] - 2e4 * x[0] - p["b"] * x[1]) / p["m"], p["E"] * oil


PENDULUM = Kind(
    "pendulum", _pendulum, _pendulum_plant,
    {"angle": "rad", "speed": "rad/s"}, {"angle": (-0.5, 0.5), "speed": (-1, 1)},
    {"torque": steps(-1.2, 1.2, 30)},
    {"w2": ("1/s2", 20, 60), "damping": ("1/s", 0.3, 1), "gain": ("1/(kg m2)", 5, 15)},
    step=0.02, samples=1000,
)  # fmt: skip
PENDULUM_ANGLE = PENDULUM.variant(
    "pendulum_angle", measured=("angle",), inputs={"torque": sines(0, 0.8, 25, 250)}
)
TWO_MASS = Kind(
    "two_mass", _two_mass, _two_mass_plant,
    {"motor": "rad/s", "twist": "rad", "load": "rad/s"},
    {"motor": (0, 0), "twist": (0, 0), "load": (0, 0)},
    {"torque": steps(-1, 1, 20)},
    {
        "J1": ("kg m2", 1e-3, 3e-3), "J2": ("kg m2", 2e-3, 6e-3), "k": ("Nm/rad", 5, 15),
        "d": ("Nms/rad", 0.005, 0.02), "b": ("Nms/rad", 0.01, 0.03),
    },
    step=0.002, samples=2000, measured=("motor",),
)  # fmt: skip
THREE_MASS = Kind(
    "three_mass", _three_mass, _three_mass_plant,
    {"y1": "m", "y2": "m", "y3": "m", "v1": "m/s", "v2": "m/s", "v3": "m/s"},
    dict.fromkeys(("y1", "y2", "y3", "v1", "v2", "v3"), (0, 0)),
    {"force": steps(-10, 10, 30)},
    {
        "m": ("kg", 0.7, 1.5), "k1": ("N/m", 60, 150), "k2": ("N/m", 60, 150),
        "k3": ("N/m", 60, 150), "d": ("Ns/m", 0.3, 1),
    },
    step=0.02, samples=1500, measured=("y1", "y2", "y3"),
)  # fmt: skip
DUFFING = Kind(
    "duffing", _duffing, _duffing_plant,
    {"y": "m", "v": "m/s"}, {"y": (-0.3, 0.3), "v": (-1, 1)}, {"force": sines(0, 3, 20, 200)},
    {
        "a": ("1/s2", 30, 80), "b": ("1/(m s)2", 30, 80), "d": ("1/s", 0.5, 2),
        "gain": ("1/kg", 5, 15),
    },
    step=0.02, samples=1500, measured=("y",),
)  # fmt: skip
QUARTER_CAR = Kind(
    "quarter_car", _quarter_car, _quarter_car_plant,
    {"body": "m", "wheel": "m", "rising": "m/s", "bouncing": "m/s"},
    dict.fromkeys(("body", "wheel", "rising", "bouncing"), (0, 0)),
    {"road": ramps(-0.03, 0.03, 10)},
    {
        "k": ("N/m", 15e3, 25e3), "c": ("Ns/m", 800, 1800), "tyre": ("N/m", 150e3, 250e3),
        "wheel": ("kg", 35, 60),
    },
    step=0.005, samples=3000, measured=("body", "wheel"),
)  # fmt: skip
CRANE = Kind(
    "crane", _crane, _crane_plant,
    {"place": "m", "angle": "rad", "speed": "m/s", "turn": "rad/s"},
    {"place": (0, 0), "angle": (-0.2, 0.2), "speed": (0, 0), "turn": (0, 0)},
    {"force": steps(-6, 6, 20)},
    {
        "cart": ("kg", 1, 3), "load": ("kg", 0.3, 1), "length": ("m", 0.5, 1.2),
        "drag": ("Ns/m", 1, 4),
    },
    step=0.02, samples=1000, measured=("place", "angle"),
)  # fmt: skip
HYDRAULIC_CYLINDER = Kind(
    "hydraulic_cylinder", _cylinder, _cylinder_plant,
    {"place": "m", "speed": "m/s", "pressure": "Pa"},
    {"place": (0, 0), "speed": (0, 0), "pressure": (0, 0)}, {"valve": sines(0, 1.2, 40, 800)},
    {
        "m": ("kg", 20, 60), "b": ("Ns/m", 500, 1500), "E": ("Pa/m3", 5e12, 1.5e13),
        "q": ("m3/s", 1e-4, 3e-4), "leak": ("m3/(s Pa)", 3e-12, 1e-11),
    },
    step=0.001, samples=3000, measured=("place", "pressure"),
)  # fmt: skip
