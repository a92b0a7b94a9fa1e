"""Silverbox, a hard spring (Wigren, Schoukens; nonlinearbenchmark.org): 07_silverbox.py FOLDER."""

import sys

import jax.numpy as jnp
import numpy as np

from penode import Experiment, Model, engine, identify, physical


class CubicSpring(Model):
    """y'' = gain (u + offset) - d y' - w2 y - k3 y^3."""

    states, state_units, unmeasured, inputs = ("y", "v"), ("V", "V/s"), ("v",), ("u",)
    gain: object = physical("1/s2")
    d: object = physical("1/s", engine.Positive())
    w2: object = physical("1/s2", engine.Positive())
    k3: object = physical("1/(V s)2")
    offset: object = physical("V")

    def derivative(self, x, u):
        """Return speed and acceleration."""
        spring = self.w2 * x[0] + self.k3 * x[0] ** 3
        return jnp.stack([x[1], self.gain * (u[0] + self.offset) - self.d * x[1] - spring])


def load(folder):
    """Return the start and the multisines for estimation and test."""
    u, y = np.loadtxt(f"{folder}/multisine.csv", delimiter=",", skiprows=1, usecols=(0, 1)).T
    run = Experiment("multisine", 1 / 610.35, {"u": u, "y": y})
    start = CubicSpring(1e5, 50.0, 2e5, 1e5, 0.0)
    return start, run.between(0, 65062), run.between(65062, 86750)


if __name__ == "__main__":
    start, train, test = load(sys.argv[1])
    print(identify(start, [train], validation=[test]))
