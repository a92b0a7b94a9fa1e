"""Heat transfer of a temperature lab: how the horizon decides whether U comes out right.

    python examples/03_tclab.py DATA.csv [FIGURE.png]

DATA.csv is the step test of the Temperature Control Lab (github.com/APMonitor/arduino): two heaters
and two temperatures, one sample a second. The sensors lag behind the heaters and the model does not
know it, so one-step training finds a heat transfer coefficient U far too small; from horizons of a
few minutes on it stands still.
"""

import sys

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import penode
from penode.engine import LevenbergMarquardt, Positive

MASS, HEAT_CAPACITY = 4e-3, 500.0  # kg, J/(kg K)
AREA, SHARED_AREA = 1e-3, 2e-4  # m2
RADIATION = 0.9 * 5.670374e-8  # emissivity times Stefan and Boltzmann's constant, W/(m2 K4)
AMBIENT = 296.15  # K

HORIZONS = (1, 2, 5, 10, 20, 50, 100, 200, 300)


class TemperatureLab(penode.Model):
    """Energy balance of two heaters with convection and radiation."""

    states = ("T1", "T2")
    inputs = ("Q1", "Q2")
    state_units = ("K", "K")

    U: object = penode.physical("W/(m2 K)", Positive())
    alpha1: object = penode.physical("W/%", Positive())
    alpha2: object = penode.physical("W/%", Positive())

    def derivative(self, x, u):
        """Return dT/dt (2, batch) in K/s from T (2, batch) in K and heater powers in %."""

        def flow(other, own, area):
            return area * (self.U * (other - own) + RADIATION * (other**4 - own**4))

        exchange = flow(x[1], x[0], SHARED_AREA)
        heat_1 = flow(AMBIENT, x[0], AREA) + exchange + self.alpha1 * u[0]
        heat_2 = flow(AMBIENT, x[1], AREA) - exchange + self.alpha2 * u[1]
        return jnp.stack([heat_1, heat_2]) / (MASS * HEAT_CAPACITY)


def load(path):
    """Return the recording in K, s and %."""
    time, *columns = np.loadtxt(path, delimiter=",", skiprows=1, usecols=range(5)).T
    names = ("Q1", "Q2", "T1", "T2")
    channels = dict(zip(names, columns, strict=True))
    channels |= {name: channels[name] + 273.15 for name in ("T1", "T2")}
    return penode.Experiment("tclab", float(np.mean(np.diff(time))), channels)


def sweep(run, horizons=HORIZONS):
    """Return the fit of a climbed ladder; every sample starts a window, as it is short."""
    stages = tuple(penode.Stage(h, LevenbergMarquardt()) for h in horizons)
    plan = penode.Plan(stages, penode.Jittered(stride=1))
    start = TemperatureLab(U=10.0, alpha1=0.01, alpha2=0.0075)  # the text book's values
    return penode.identify(start, [run], plan=plan)


def main(data, out="tclab.png"):
    """Print U over the horizon and draw it."""
    ladder = sweep(load(data)).horizon.ladder
    print("   H  U in W/(m2 K)  free run in K")
    for rung in ladder:
        print(f"{rung.horizon:4}  {rung.parameters['U']:13.2f}  {rung.free_run_rmse:13.2f}")
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    axes.semilogx([r.horizon for r in ladder], [r.parameters["U"] for r in ladder], "o-")
    axes.set(xlabel="horizon in samples of 1 s", ylabel="U in W/(m²K)", ylim=(0, None))
    axes.grid(alpha=0.3)
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    main(*sys.argv[1:])
