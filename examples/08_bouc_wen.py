"""Hysteretic oscillator (Noël, Schoukens; nonlinearbenchmark.org): 08_bouc_wen.py FOLDER."""

import sys

import h5py
import jax.numpy as jnp
import numpy as np

from penode import Experiment, Model, engine, identify, physical


class Hysteresis(Model):
    """m y'' + c y' + k y + z = u, z' = alpha y' - beta |y'| z - delta y' |z|."""

    states, state_units, unmeasured, inputs = ("y", "v", "z"), ("m", "m/s", "N"), ("v", "z"), ("u",)
    m: object = physical("kg", engine.Positive())  # true: 2
    c: object = physical("Ns/m", engine.Positive())  # true: 10
    k: object = physical("N/m", engine.Positive())  # true: 5e4
    alpha: object = physical("N/m", engine.Positive())  # true: 5e4
    beta: object = physical("1/m")  # true: 800
    delta: object = physical("1/m")  # true: -1100

    def derivative(self, x, u):
        """Return speed, acceleration and the rate of the restoring force."""
        y, v, z = x
        lost = self.beta * jnp.sqrt(v**2 + 1e-12) * z + self.delta * v * jnp.sqrt(z**2 + 1e-12)
        return jnp.stack([v, (u[0] - self.k * y - self.c * v - z) / self.m, self.alpha * v - lost])


def load(folder):
    """Yield the start and the multisines for training and test."""
    yield Hysteresis(1.5, 5.0, 3e4, 3e4, 500.0, -500.0)
    for name in ("train", "test"):
        with h5py.File(f"{folder}/{name}.h5") as file:
            yield Experiment(name, 1 / 750, {c: np.ravel(file["multisine"][c]) for c in "uy"})


if __name__ == "__main__":
    start, train, test = load(sys.argv[1])
    print(identify(start, [train], validation=[test]))
