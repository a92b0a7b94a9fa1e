"""Three sets simulated by SciPy: a two-mass drive, a stirred tank reactor, predator and prey.

``python -m validate.simulated_sets [NAME ...] [--draws 14]`` identifies each by default under as
many draws of the noise and prints by how many deviations each parameter errs, then how many
intervals (95 %) cover. The first draw is that of `validate.public_sets`.
"""

import argparse
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

from penode import Experiment, Model, identify, physical
from penode.arrays import FloatArray, JaxArray
from penode.engine import Positive
from penode.fit.outcome import NORMAL_95
from penode.models.inputs import Inputs

Rates = Callable[[Any, Any, Any], list[Any]]


class TwoMass(Model):
    """A motor turns a load over an elastic shaft; the load rubs; the motor's speed is measured."""

    states = ("motor", "twist", "load")
    state_units = ("rad/s", "rad", "rad/s")
    unmeasured = ("twist", "load")
    inputs = ("torque",)
    J1: Any = physical("kg m2", Positive())
    J2: Any = physical("kg m2", Positive())
    stiffness: Any = physical("Nm", Positive())
    damping: Any = physical("Nm s", Positive())
    viscous: Any = physical("Nm s", Positive())
    coulomb: Any = physical("Nm", Positive())

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return the rates of the speeds and of the twist."""
        shaft = self.stiffness * x[1] + self.damping * (x[0] - x[2])
        rub = self.viscous * x[2] + self.coulomb * jnp.tanh(x[2] / 0.05)
        return jnp.stack([(u[0] - shaft) / self.J1, x[0] - x[2], (shaft - rub) / self.J2])


class VanDeVusse(Model):
    """A -> B -> C and 2 A -> D in a stirred tank; the product B is measured."""

    states = ("a", "b")
    state_units = ("mol/l", "mol/l")
    unmeasured = ("a",)
    inputs = ("dilution",)
    k1: Any = physical("1/s", Positive())
    k2: Any = physical("1/s", Positive())
    k3: Any = physical("l/(mol s)", Positive())

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return the rates of the concentrations; 5.1 mol/l of A flow in."""
        a = u[0] * (5.1 - x[0]) - self.k1 * x[0] - self.k3 * x[0] ** 2
        return jnp.stack([a, self.k1 * x[0] - self.k2 * x[1] - u[0] * x[1]])


class PredatorPrey(Model):
    """Lotka and Volterra; the prey is counted, predators in units of what they eat."""

    states = ("prey", "predator")
    state_units = ("", "1/s")
    unmeasured = ("predator",)
    inputs = ()
    birth: Any = physical("1/s", Positive())
    death: Any = physical("1/s", Positive())
    growth: Any = physical("1/s", Positive())

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return the rates of both."""
        prey = x[0] * (self.birth - x[1])
        return jnp.stack([prey, x[1] * (self.growth * x[0] - self.death)])


def _two_mass(x: Any, u: Any, p: Any) -> list[Any]:
    shaft = p["stiffness"] * x[1] + p["damping"] * (x[0] - x[2])
    rub = p["viscous"] * x[2] + p["coulomb"] * np.tanh(x[2] / 0.05)
    return [(u - shaft) / p["J1"], x[0] - x[2], (shaft - rub) / p["J2"]]


def _reactor(x: Any, u: Any, p: Any) -> list[Any]:
    from_a = p["k1"] * x[0]
    return [u * (5.1 - x[0]) - from_a - p["k3"] * x[0] ** 2, from_a - p["k2"] * x[1] - u * x[1]]


def _species(x: Any, u: Any, p: Any) -> list[Any]:
    return [x[0] * (p["birth"] - x[1]), x[1] * (p["growth"] * x[0] - p["death"])]


def simulated(
    rates: Rates, truth: dict[str, float], first: list[float], step: float, u: FloatArray
) -> FloatArray:
    """Return the states (state, time) while every input stands still for a sample."""
    path = [np.array(first)]
    for held in u[:-1]:
        run = solve_ivp(
            lambda _, x, now=held: rates(x, now, truth), (0, step), path[-1],
            method="DOP853", rtol=1e-9, atol=1e-11,
        )  # fmt: skip
        path.append(run.y[:, -1])
    return np.array(path).T


def steps(seed: int, low: float, high: float, each: int, samples: int) -> FloatArray:
    """Return a signal of random steps."""
    levels = np.random.default_rng(seed).uniform(low, high, samples // each + 1)
    return np.repeat(levels, each)[:samples]


TWO_MASS = {
    "J1": 2e-3, "J2": 5e-3, "stiffness": 30.0, "damping": 0.02, "viscous": 0.01, "coulomb": 0.3,
}  # fmt: skip
REACTOR = {"k1": 50 / 3600, "k2": 100 / 3600, "k3": 10 / 3600}
SPECIES = {"birth": 0.8, "death": 0.5, "growth": 0.4}

#: Deviations of the noise, in the measured state's unit.
NOISE = {"two_mass": 0.2, "van_de_vusse": 0.01, "lotka_volterra": 0.03}


def _noisy(name: str, clean: FloatArray, seed: int, draw: int) -> FloatArray:
    """Return what a sensor reads of a quantity (time,), the draw of the noise numbered from 0."""
    random = np.random.default_rng(10 * (1 + draw) + seed)
    return clean + random.normal(0, NOISE[name], clean.shape)


def two_mass(
    samples: int = 2000, draw: int = 0
) -> tuple[Model, list[Experiment], dict[str, float]]:
    """Return the start, a recording and one to test, 2 s each, and the truth."""
    runs = []
    for seed in (1, 2):
        u = steps(seed, -2.0, 2.0, 25, samples)
        motor = simulated(_two_mass, TWO_MASS, [0.0, 0.0, 0.0], 1e-3, u)[0]
        motor = _noisy("two_mass", motor, seed, draw)
        runs.append(Experiment(f"two_mass {seed}", 1e-3, {"torque": u, "motor": motor}))
    return TwoMass(3e-3, 3e-3, 20.0, 0.05, 0.02, 0.1), runs, TWO_MASS


def van_de_vusse(
    samples: int = 600, draw: int = 0
) -> tuple[Model, list[Experiment], dict[str, float]]:
    """Return the start, a recording and one to test, 100 min each, and the truth."""
    runs = []
    for seed in (1, 2):
        u = steps(seed, 5 / 3600, 60 / 3600, 20, samples)
        b = simulated(_reactor, REACTOR, [2.0, 1.0], 10.0, u)[1]
        b = _noisy("van_de_vusse", b, seed, draw)
        runs.append(Experiment(f"reactor {seed}", 10.0, {"dilution": u, "b": b}))
    return VanDeVusse(0.02, 0.02, 2e-3), runs, REACTOR


def lotka_volterra(
    samples: int = 600, draw: int = 0
) -> tuple[Model, list[Experiment], dict[str, float]]:
    """Return the start, a recording and one to test from elsewhere, 60 s each, and the truth."""
    runs = []
    for seed, first in ((1, [2.0, 0.5]), (2, [1.0, 1.2])):
        prey = simulated(_species, SPECIES, first, 0.1, np.zeros(samples))[0]
        prey = _noisy("lotka_volterra", prey, seed, draw)
        runs.append(Experiment(f"prey {seed}", 0.1, {"prey": prey}))
    return PredatorPrey(1.0, 0.4, 0.5), runs, SPECIES


SETS = {"two_mass": two_mass, "van_de_vusse": van_de_vusse, "lotka_volterra": lotka_volterra}


def main(names: list[str], draws: int) -> None:
    """Print a line a draw of each set's noise, and how many intervals cover."""
    for name in names:
        covered = count = 0
        for draw in range(draws):
            start, (train, _), truth = SETS[name](draw=draw)
            fit = identify(start, [train])
            errors = {key: (p.value - truth[key]) / p.std for key, p in fit.parameters.items()}
            covered += sum(abs(error) <= NORMAL_95 for error in errors.values())
            count += len(errors)
            listed = ", ".join(f"{key} {error:+.2f}" for key, error in errors.items())
            print(
                f"{name} {draw}: H {fit.horizon.selected} {fit.horizon.verdict}, {listed}",
                flush=True,
            )
        print(f"{name}: {covered} of {count} intervals cover", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*", choices=[*SETS, []], metavar="NAME")
    parser.add_argument("--draws", type=int, default=14)
    given = parser.parse_args()
    main(given.names or list(SETS), given.draws)
