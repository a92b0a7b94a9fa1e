"""Positioner with friction (Janot, Gautier, Brunot; nonlinearbenchmark.org): 02_emps.py FOLDER."""

import sys

import jax.numpy as jnp
from scipy.io import loadmat

from penode import Experiment, Model, engine, identify, physical


class Positioner(Model):
    """M dv/dt = force - Fv v - Fc sign(v) - offset, dq/dt = v."""

    states, state_units, inputs = ("q", "v"), ("m", "m/s"), ("force",)
    unmeasured = ("v",)
    M: object = physical("kg", engine.Positive())  # known: 95.11 ± 0.11
    Fv: object = physical("Ns/m")  # known: 203.5 ± 1.1
    Fc: object = physical("N")  # known: 20.39 ± 0.1
    offset: object = physical("N")  # known: -3.16 ± 0.04

    def derivative(self, x, u):
        """Return the rates of q and v."""
        friction = self.Fv * x[1] + self.Fc * jnp.tanh(x[1] / 2e-4) + self.offset
        return jnp.stack([x[1], (u[0] - friction) / self.M])


def load(folder):
    """Yield the start and the recordings; the speed is not measured."""
    yield Positioner(M=80.0, Fv=150.0, Fc=10.0, offset=0.0)
    for name in ("DATA_EMPS", "DATA_EMPS_PULSES"):
        file = loadmat(f"{folder}/{name}.mat")
        q, force = file["qm"].ravel(), (file["gtau"] * file["vir"]).ravel()
        yield Experiment(name, 1e-3, {"q": q, "force": force})


if __name__ == "__main__":
    start, train, test = load(sys.argv[1])
    print(identify(start, [train], validation=[test]))
