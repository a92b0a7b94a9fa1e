"""Living things and oscillators of their own: what penode is given, and the plants."""

from collections.abc import Mapping, Sequence
from typing import Any

from penode.arrays import JaxArray
from penode.models.inputs import Inputs
from validate.physics.kind import Kind
from validate.physics.signals import sines, steps

Numbers, Named = Sequence[float], Mapping[str, float]

_ATTACK = 0.5  # 1/s, of the predator that is not measured
_GLUCOSE = 90.0  # mg/dl at rest


def _lotka_volterra(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    prey, predator = x
    return (m.a - m.b * predator) * prey, (m.d * prey - m.c) * predator


def _lotka_volterra_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    met = x[0] * x[1]
    return p["a"] * x[0] - p["b"] * met, p["d"] * met - p["c"] * x[1]


def _predator_prey(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    prey, predator = x
    eaten = _ATTACK * prey * predator / (1 + prey / m.half)
    return m.a * prey * (1 - prey / u["capacity"]) - eaten, m.d * eaten - m.c * predator


def _predator_prey_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    meal = 0.5 * p["half"] * x[0] / (p["half"] + x[0])
    growth = p["a"] * x[0] - p["a"] * x[0] * x[0] / u[0]
    return growth - meal * x[1], (p["d"] * meal - p["c"]) * x[1]


def _sir(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    s, i = x
    caught = m.beta * u["contacts"] * s * i
    return m.waning * (1 - s - i) - caught, caught - m.gamma * i


def _sir_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    healed, spread = 1.0 - x[0] - x[1], p["beta"] * u[0] * x[0]
    return p["waning"] * healed - spread * x[1], (spread - p["gamma"]) * x[1]


def _glucose(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    glucose, action, insulin = x
    return (
        m.p1 * (_GLUCOSE - glucose) - action * glucose + u["meal"],
        m.p3 * insulin - m.p2 * action,
        u["infusion"] - m.n * insulin,
    )


def _glucose_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    infusion, meal = u
    taken = (p["p1"] + x[1]) * x[0]
    return meal + 90.0 * p["p1"] - taken, -p["p2"] * x[1] + p["p3"] * x[2], infusion - p["n"] * x[2]


def _fitzhugh_nagumo(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    v, w = x
    return v - v**3 / 3 - w + u["current"], m.rate * (v + m.a - m.b * w)


def _fitzhugh_nagumo_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    return u[0] + x[0] * (1 - x[0] * x[0] / 3) - x[1], p["rate"] * (x[0] + p["a"] - p["b"] * x[1])


def _van_der_pol(m: Any, x: JaxArray, u: Inputs) -> Sequence[JaxArray]:
    y, z = x
    return m.mu * (y - y**3 / 3 - z), (m.w * y - m.gain * u["drive"]) / m.mu


def _van_der_pol_plant(x: Numbers, u: Numbers, p: Named) -> Numbers:
    cubic = x[0] * x[0] * x[0] / 3
    return -p["mu"] * (cubic - x[0] + x[1]), p["w"] / p["mu"] * x[0] - p["gain"] / p["mu"] * u[0]


LOTKA_VOLTERRA = Kind(
    "lotka_volterra", _lotka_volterra, _lotka_volterra_plant,
    {"prey": "", "predator": ""}, {"prey": (0.8, 2), "predator": (0.5, 1.5)}, {},
    {"a": ("1/s", 0.5, 1), "b": ("1/s", 0.3, 0.6), "c": ("1/s", 0.5, 1), "d": ("1/s", 0.3, 0.6)},
    step=0.1, samples=800,
)  # fmt: skip
PREDATOR_PREY = Kind(
    "predator_prey", _predator_prey, _predator_prey_plant,
    {"prey": "", "predator": ""}, {"prey": (1, 2), "predator": (0.5, 1.5)},
    {"capacity": steps(2, 6, 40)},
    {"a": ("1/s", 0.8, 1.5), "half": ("", 2, 4), "c": ("1/s", 0.3, 0.6), "d": ("", 0.6, 1)},
    step=0.1, samples=1500, measured=("prey",),
)  # fmt: skip
SIR = Kind(
    "sir", _sir, _sir_plant,
    {"susceptible": "", "infected": ""}, {"susceptible": (0.5, 0.8), "infected": (0.01, 0.05)},
    {"contacts": steps(0.5, 1.5, 20)},
    {"beta": ("1/d", 0.3, 0.6), "gamma": ("1/d", 0.1, 0.2), "waning": ("1/d", 0.01, 0.03)},
    step=1.0, samples=800, measured=("infected",),
)  # fmt: skip
GLUCOSE = Kind(
    "glucose", _glucose, _glucose_plant,
    {"glucose": "mg/dl", "action": "1/min", "insulin": "mU/l"},
    {"glucose": (80, 120), "action": (0, 0.01), "insulin": (0, 10)},
    {"infusion": steps(0, 10, 30), "meal": steps(0, 6, 40)},
    {
        "p1": ("1/min", 0.02, 0.04), "p2": ("1/min", 0.02, 0.05),
        "p3": ("l/(mU min2)", 1e-5, 3e-5), "n": ("1/min", 0.1, 0.2),
    },
    step=1.0, samples=1000, measured=("glucose", "insulin"),
)  # fmt: skip
FITZHUGH_NAGUMO = Kind(
    "fitzhugh_nagumo", _fitzhugh_nagumo, _fitzhugh_nagumo_plant,
    {"v": "", "w": ""}, {"v": (-1, 1), "w": (-0.5, 0.5)}, {"current": steps(0.4, 0.9, 80)},
    {"rate": ("1/s", 0.05, 0.12), "a": ("", 0.5, 0.8), "b": ("", 0.5, 0.9)},
    step=0.2, samples=2000, measured=("v",),
)  # fmt: skip
#: Slow ramps and jumps: at a jump rate times sampling interval is 0.3 to 0.7.
VAN_DER_POL = Kind(
    "van_der_pol", _van_der_pol, _van_der_pol_plant,
    {"y": "", "z": ""}, {"y": (-2, 2), "z": (-0.5, 0.5)}, {"drive": sines(0, 1, 100, 1500)},
    {"mu": ("1/s", 5, 12), "w": ("1/s2", 0.7, 1.4), "gain": ("1/s2", 0.5, 1.2)},
    step=0.02, samples=4000,
)  # fmt: skip
