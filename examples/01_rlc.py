"""RLC circuit with a saturating inductance (forgi86/sysid-neural-continuous): 01_rlc.py FOLDER."""

import sys

import jax.numpy as jnp
import numpy as np

from penode import Experiment, Model, engine, identify, physical


class Circuit(Model):
    """L(i) di/dt = u - v - R i, C dv/dt = i, L falling by a share around the current of a knee."""

    states, state_units, inputs = ("v", "i"), ("V", "A"), ("u",)
    R: object = physical("ohm", engine.Positive())  # true: 3
    C: object = physical("F", engine.Positive())  # true: 270e-9
    L: object = physical("H", engine.Positive())  # true: 50e-6
    share: object = physical("")  # true: 0.9
    knee: object = physical("A")  # true: 5
    steep: object = physical("1/A", engine.Positive())  # true: 5

    def derivative(self, x, u):
        """Return the rates of v and i."""
        fallen = 0.5 + jnp.arctan(self.steep * (jnp.abs(x[1]) - self.knee)) / jnp.pi
        inductance = self.L * (1.0 - self.share * fallen)
        return jnp.stack([x[1] / self.C, (u[0] - x[0] - self.R * x[1]) / inductance])


def load(folder):
    """Yield the start, a recording with noise of 10 V and 1 A, and one without."""
    yield Circuit(R=2.0, C=300e-9, L=60e-6, share=0.8, knee=4.0, steep=2.0)
    for name, noise in (("id", ([10.0], [1.0])), ("test", ([0.0], [0.0]))):
        _, *vi, u, _ = np.loadtxt(f"{folder}/RLC_data_{name}.csv", delimiter=",", skiprows=1).T
        v, i = np.random.default_rng(0).normal(vi, noise)
        yield Experiment(name, 5e-7, {"v": v, "i": i, "u": u})


if __name__ == "__main__":
    start, train, test = load(sys.argv[1])
    print(identify(start, [train], validation=[test]))
