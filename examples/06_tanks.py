"""Cascaded tanks that run over (Schoukens, Noël; nonlinearbenchmark.org): 06_tanks.py FOLDER."""

import sys

import jax.numpy as jnp
import numpy as np

from penode import Experiment, Model, engine, identify, physical


class Tanks(Model):
    """Bernoulli's outflow; what is above the rim of the upper tank runs over, partly below."""

    states, state_units = ("upper", "lower"), ("V", "V")
    unmeasured, inputs = ("upper",), ("pump",)
    k1: object = physical("V^0.5/s", engine.Positive())
    k2: object = physical("V^0.5/s", engine.Positive())
    k3: object = physical("V^0.5/s", engine.Positive())
    k4: object = physical("1/s", engine.Positive())
    k5: object = physical("", engine.Positive())

    def derivative(self, x, u):
        """Return the rates of the levels."""
        upper, lower = jnp.sqrt(jnp.maximum(x, 1e-3))
        over = 0.2 * jnp.maximum(x[0] - 10.0, 0.0)
        into = self.k2 * upper - self.k3 * lower + self.k5 * over
        return jnp.stack([self.k4 * u[0] - self.k1 * upper - over, into])


def load(folder):
    """Yield the start and the official halves for estimation and validation."""
    c = np.genfromtxt(f"{folder}/dataBenchmark.csv", delimiter=",", names=True)
    yield Tanks(0.05, 0.05, 0.05, 0.05, 0.5)
    for end in ("Est", "Val"):
        yield Experiment(end, 4.0, {"pump": c[f"u{end}"], "lower": c[f"y{end}"]})


if __name__ == "__main__":
    start, train, test = load(sys.argv[1])
    print(identify(start, [train], validation=[test]))
