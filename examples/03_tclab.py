"""Two heaters, sensors that lag (APMonitor/arduino), tested on half: 03_tclab.py FOLDER."""

import sys

import jax.numpy as jnp
import numpy as np

from penode import Experiment, Model, engine, identify, physical


class TemperatureLab(Model):
    """C dH/dt = alpha Q - loss(H) to the room and the other heater, tau dT/dt = H - T."""

    states, state_units = ("T1", "T2", "H1", "H2"), ("K",) * 4
    unmeasured, inputs = ("H1", "H2"), ("Q1", "Q2")
    U: object = physical("W/(m2 K)", engine.Positive())
    alpha1: object = physical("W/%", engine.Positive())
    alpha2: object = physical("W/%", engine.Positive())
    tau: object = physical("s", engine.Positive())

    def derivative(self, x, u):
        """Return the rates of the sensors' and the heaters' temperatures."""
        loss = [self.U * t + 0.9 * 5.670374e-8 * t**4 for t in (*x[2:], 296.15)]  # W/m2
        shared = 2e-4 * (loss[0] - loss[1])
        heat1 = self.alpha1 * u[0] - 1e-3 * (loss[0] - loss[2]) - shared
        heat2 = self.alpha2 * u[1] - 1e-3 * (loss[1] - loss[2]) + shared
        return jnp.stack([*(x[2:] - x[:2]) / self.tau, heat1 / 2.0, heat2 / 2.0])  # 2 J/K


def load(folder):
    """Return the start and the halves."""
    time, q1, q2, t1, t2 = np.loadtxt(f"{folder}/data.csv", delimiter=",", skiprows=1).T[:5]
    channels = {"Q1": q1, "Q2": q2, "T1": t1 + 273.15, "T2": t2 + 273.15}
    run = Experiment("tclab", float(np.mean(np.diff(time))), channels)
    return TemperatureLab(10.0, 0.01, 0.0075, 10.0), run.between(0, 300), run.between(300, 599)


if __name__ == "__main__":
    start, train, test = load(sys.argv[1])
    print(identify(start, [train], validation=[test]))
