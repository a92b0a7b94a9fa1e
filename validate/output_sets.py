"""Sets whose sensors read outputs, not states, simulated by SciPy; a public set written so.

A filter, a saturation and another filter (Wiener and Hammerstein) of which the end is read; a ship
of eight states that a log, a gyroscope, a compass and an inclinometer read; a servo recorded at two
sampling rates. ``python -m validate.public_sets`` identifies them, ``python -m benchmarks.peers``
beside others.
"""

from collections.abc import Callable
from dataclasses import fields
from typing import Any, ClassVar, TypeAlias

import jax.numpy as jnp
import numpy as np

from penode import Experiment, Model, physical
from penode.arrays import FloatArray, JaxArray
from penode.engine import Positive
from penode.models.inputs import Inputs
from validate.simulated_sets import simulated, steps

Simulated: TypeAlias = tuple[Model, list[Experiment], dict[str, float]]


class WienerHammerstein(Model):
    """A filter of second order, a saturation, and another filter."""

    states = ("x1", "v1", "x2", "v2")
    state_units = ("V", "V/s", "V", "V/s")
    inputs = ("u",)
    outputs: ClassVar = {"y": "V"}
    omega1: Any = physical("1/s", Positive())
    zeta1: Any = physical("1", Positive())
    level: Any = physical("V", Positive())
    omega2: Any = physical("1/s", Positive())
    zeta2: Any = physical("1", Positive())

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return the rates of both filters."""
        x1, v1, x2, v2 = x
        a1 = self.omega1**2 * (u[0] - x1) - 2 * self.zeta1 * self.omega1 * v1
        held = self.level * jnp.tanh(x1 / self.level)
        a2 = self.omega2**2 * (held - x2) - 2 * self.zeta2 * self.omega2 * v2
        return jnp.stack([v1, a1, v2, a2])

    def output(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return the end of the second filter."""
        return x[2:3]


class Ship(Model):
    """Surge, sway, yaw and roll of a ship, its rudder and its engine."""

    states = ("surge", "sway", "yaw", "heading", "rolling", "roll", "rudder", "shaft")
    state_units = ("m/s", "m/s", "rad/s", "rad", "rad/s", "rad", "rad", "1/s")
    inputs = ("helm", "telegraph")
    outputs: ClassVar = {
        "log": "m/s",
        "gyroscope": "rad/s",
        "compass": "rad",
        "inclinometer": "rad",
    }
    thrust: Any = physical("m", Positive())
    drag: Any = physical("1/m", Positive())
    leeway: Any = physical("1/m", Positive())
    side: Any = physical("1/rad m", Positive())
    damping: Any = physical("1/m", Positive())
    weather: Any = physical("1/m2", Positive())
    turn: Any = physical("1/rad m2", Positive())
    roll_damping: Any = physical("1/s", Positive())
    roll_stiffness: Any = physical("1/s2", Positive())
    arm: Any = physical("1/m", Positive())
    steering: Any = physical("s", Positive())
    engine: Any = physical("s", Positive())

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return the rates of speeds, angles, rudder and shaft."""
        surge, sway, yaw, _, rolling, roll, rudder, shaft = x
        ahead = self.thrust * shaft**2 - self.drag * surge**2 + sway * yaw
        aside = surge * (self.side * surge * rudder - self.leeway * sway - 0.6 * yaw)
        about = surge * (self.weather * sway - self.damping * yaw - self.turn * surge * rudder)
        heel = self.arm * surge * yaw - self.roll_damping * rolling - self.roll_stiffness * roll
        moved = (u[0] - rudder) / self.steering, (u[1] - shaft) / self.engine
        return jnp.stack([ahead, aside, about, yaw, heel, rolling, *moved])

    def output(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return what log, gyroscope, compass and inclinometer read."""
        return jnp.stack([x[0], x[2], x[3], x[5]])


class Servo(Model):
    """A motor with a current and dry friction; encoder and current are read."""

    states = ("angle", "speed", "amperes")
    state_units = ("rad", "rad/s", "A")
    inputs = ("voltage",)
    outputs: ClassVar = {"encoder": "rad", "current": "A"}
    R: Any = physical("ohm", Positive())
    L: Any = physical("H", Positive())
    k: Any = physical("Nm/A", Positive())
    J: Any = physical("kg m2", Positive())
    coulomb: Any = physical("Nm", Positive())

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return the rates of angle, speed and current."""
        rub = self.coulomb * jnp.tanh(x[1])
        current = (u[0] - self.R * x[2] - self.k * x[1]) / self.L
        return jnp.stack([x[1], (self.k * x[2] - rub) / self.J, current])

    def output(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return what encoder and current sensor read."""
        return jnp.stack([x[0], x[2]])


FILTERS = {"omega1": 50.0, "zeta1": 0.3, "level": 0.8, "omega2": 120.0, "zeta2": 0.5}
SHIP = {
    "thrust": 0.032, "drag": 0.002, "leeway": 0.02, "side": 0.004, "damping": 0.02,
    "weather": 4e-4, "turn": 3e-4, "roll_damping": 0.06, "roll_stiffness": 0.36, "arm": 0.05,
    "steering": 3.0, "engine": 8.0,
}  # fmt: skip
SERVO = {"R": 1.0, "L": 0.01, "k": 0.05, "J": 5e-5, "coulomb": 0.02}

#: Deviations of the noise of what sensors read.
NOISE = {
    "wiener_hammerstein": {"y": 0.01},
    "ship": {"log": 0.05, "gyroscope": 5e-4, "compass": 2e-3, "inclinometer": 2e-3},
    "two_rates": {"encoder": 2e-3, "current": 0.05},
}


def filters(m: Any, x: Any, u: Any, p: Any) -> list[Any]:
    """Return the rates of both filters by the functions of a module, parameters in order."""
    omega1, zeta1, level, omega2, zeta2 = p
    x1, v1, x2, v2 = x
    first = omega1**2 * (u[0] - x1) - 2 * zeta1 * omega1 * v1
    held = level * m.tanh(x1 / level)
    return [v1, first, v2, omega2**2 * (held - x2) - 2 * zeta2 * omega2 * v2]


def course(m: Any, x: Any, u: Any, p: Any) -> list[Any]:
    """Return the same of the ship."""
    thrust, drag, leeway, side, damping, weather, turn, loss, stiffness, arm, steering, engine = p
    surge, sway, yaw, _, rolling, roll, rudder, shaft = x
    return [
        thrust * shaft**2 - drag * surge**2 + sway * yaw,
        surge * (side * surge * rudder - leeway * sway - 0.6 * yaw),
        surge * (weather * sway - damping * yaw - turn * surge * rudder),
        yaw,
        arm * surge * yaw - loss * rolling - stiffness * roll,
        rolling,
        (u[0] - rudder) / steering,
        (u[1] - shaft) / engine,
    ]


def servo(m: Any, x: Any, u: Any, p: Any) -> list[Any]:
    """Return the same of the servo."""
    R, L, k, J, coulomb = p
    _, speed, current = x
    torque = k * current - coulomb * m.tanh(speed)
    return [speed, torque / J, (u[0] - R * current - k * speed) / L]


def _path(
    rates: Callable[..., list[Any]],
    truth: dict[str, float],
    first: list[float],
    step: float,
    *u: FloatArray,
) -> FloatArray:
    """Return the states (state, time) that SciPy makes of inputs (time,)."""

    def plain(x: Any, now: Any, p: dict[str, float]) -> list[Any]:
        return rates(np, x, now, p.values())

    return simulated(plain, truth, first, step, np.stack(u, axis=1))


def _read(
    name: str, step: float, seed: int, clean: dict[str, FloatArray], given: dict[str, FloatArray]
) -> Experiment:
    """Return a recording of clean quantities (time,), noise added, and of inputs as given."""
    random = np.random.default_rng(10 + seed)
    noise = NOISE[name]
    channels = {key: x + random.normal(0, noise[key], x.shape) for key, x in clean.items()}
    return Experiment(f"{name} {seed}", step, channels | given)


def wiener_hammerstein(samples: int = 4000) -> Simulated:
    """Return the start, a recording and one to test, 8 s each, and the truth."""
    runs = []
    for seed in (1, 2):
        u = steps(seed, -2.0, 2.0, 20, samples)
        y = _path(filters, FILTERS, [0.0] * 4, 2e-3, u)[2]
        runs.append(_read("wiener_hammerstein", 2e-3, seed, {"y": y}, {"u": u}))
    return WienerHammerstein(80.0, 0.5, 1.5, 80.0, 0.5), runs, FILTERS


def ship(samples: int = 1500) -> Simulated:
    """Return the start, a recording and one to test, 12 min each, and the truth."""
    runs = []
    for seed in (1, 2):
        given = {
            "helm": steps(seed, -0.3, 0.3, 40, samples),
            "telegraph": steps(5 + seed, 1.2, 2.0, 150, samples),
        }
        first = [6.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.5]
        x = _path(course, SHIP, first, 0.5, *given.values())
        clean = {"log": x[0], "gyroscope": x[2], "compass": x[3], "inclinometer": x[5]}
        runs.append(_read("ship", 0.5, seed, clean, given))
    guess = (0.05, 0.003, 0.03, 0.006, 0.03, 2e-4, 5e-4, 0.1, 0.5, 0.03, 5.0, 5.0)
    return Ship(*guess), runs, SHIP


def two_rates(samples: int = 2000) -> Simulated:
    """Return the start, a recording at 1 kHz, one to test, one at 200 Hz, and the truth."""
    runs = []
    for seed, step, count in ((1, 1e-3, samples), (2, 1e-3, samples), (3, 5e-3, 3 * samples // 5)):
        u = steps(seed, -10.0, 10.0, round(0.05 / step), count)
        x = _path(servo, SERVO, [0.0, 0.0, 0.0], step, u)
        clean = {"encoder": x[0], "current": x[2]}
        runs.append(_read("two_rates", step, seed, clean, {"voltage": u}))
    return Servo(2.0, 0.02, 0.03, 1e-4, 0.01), runs, SERVO


SETS: dict[str, Callable[..., Simulated]] = {
    "wiener_hammerstein": wiener_hammerstein,
    "ship": ship,
    "two_rates": two_rates,
}


def with_outputs(start: Model) -> Model:
    """Return a model whose measured states are outputs of their names, and no state a channel."""
    units = dict(zip(start.states, start.state_units, strict=True))
    read = {name: unit for name, unit in units.items() if name not in start.unmeasured}
    rows = np.array([start.states.index(name) for name in read])
    kind: Any = type(start)

    class Read(kind):  # type: ignore[misc]
        unmeasured, outputs = (), read

        def output(self, x: JaxArray, u: Inputs) -> JaxArray:
            """Return the states that sensors read."""
            return x[rows]

    return Read(**{part.name: getattr(start, part.name) for part in fields(start)})
