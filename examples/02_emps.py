"""An electro-mechanical positioner: its mass at many horizons, and its friction as a learned curve.

    python examples/02_emps.py DATA_EMPS.mat DATA_EMPS_PULSES.mat [FIGURE.png]

The files are those of Janot, Gautier and Brunot (2019), nonlinearbenchmark.org. The mass is right
at short horizons and drifts at long ones: what textbook friction lacks is slow. With a learned
friction curve and long horizons the model simulates a recording it has not seen.
"""

import sys

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from scipy.io import loadmat
from scipy.signal import butter, filtfilt

import penode
from penode import Predictor
from penode.engine import Longest, Loss, Positive, Smoothness, Spline, compare

HORIZONS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000)


class Positioner(penode.Model):
    """M dv/dt = force - Fv v - Fc sign(v) - offset, dq/dt = v."""

    states = ("q", "v")
    inputs = ("force",)
    state_units = ("m", "m/s")

    M: object = penode.physical("kg", Positive())
    Fv: object = penode.physical("Ns/m")
    Fc: object = penode.physical("N")
    offset: object = penode.physical("N")

    def derivative(self, x, u):
        """Return (dq/dt, dv/dt)."""
        friction = self.Fv * x[1] + self.Fc * jnp.tanh(x[1] / 2e-4) + self.offset
        return jnp.stack([x[1], (u[0] - friction - self.learned(x).sum(axis=0)) / self.M])


class Learned(Positioner):
    """The same with a friction curve beside the textbook's; speeds at windows' starts estimated."""

    unmeasured = ("v",)
    curve: Spline

    def learned(self, x):
        """Return the force (1, batch) in N that the textbook's friction lacks."""
        return self.curve.value_and_jacobian(x[1:])[0]


def load(path):
    """Return a recording: position, force, and the speed by differentiation below 100 Hz."""
    file = loadmat(path)
    position, force = file["qm"].ravel(), (file["gtau"] * file["vir"]).ravel()
    speed = np.gradient(filtfilt(*butter(4, 100, fs=1000), position), 1e-3)
    return penode.Experiment(str(path), 1e-3, {"q": position, "v": speed, "force": force})


def sweep(run, horizons=HORIZONS):
    """Return the fit of the four parameters up a ladder."""
    start = Positioner(M=80.0, Fv=150.0, Fc=10.0, offset=0.0)
    return penode.identify(start, [run], plan=penode.ladder_plan(horizons))


def learn_friction(run, horizons=(20, 200, 1000, 2000)):
    """Return the fit with a smooth friction curve, windows a quarter of a second apart."""
    points = np.linspace(-0.13, 0.13, 53)[:, None] * [0.0, 1.0]
    loss = Loss(penalties=(Smoothness(points, step=np.array([0.0, 0.01]), weight=1e-7),))
    start = Learned(95.0, 205.0, 20.0, -3.0, Spline.zero((-0.13,), (0.13,), (12,), 1))
    stages = penode.ladder_plan(horizons).stages
    plan = penode.Plan(stages, penode.Jittered(stride=250), loss=loss)
    return penode.identify(start, [run], plan=plan, purpose=Longest())


def main(data, pulses, out="emps.png"):
    """Print mass over horizon and the simulation error, and draw both."""
    run, pulses = load(data), load(pulses)
    ladder = sweep(run).horizon.ladder
    print(*(f"H = {r.horizon:4}: M = {r.parameters['M']:.2f} kg" for r in ladder), sep="\n")
    unseen = compare(Predictor(1e-3), learn_friction(run).model, pulses)
    print(f"open-loop simulation of the pulses: {1e3 * unseen.free_run_rmse:.2f} mm")
    figure, (mass, error) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    mass.semilogx([r.horizon for r in ladder], [r.parameters["M"] for r in ladder], "o-")
    mass.axhspan(0.995 * 95.11, 1.005 * 95.11, alpha=0.2)
    mass.set(xlabel="horizon in samples of 1 ms", ylabel="M in kg")
    error.plot(1e-3 * np.arange(len(pulses)), 1e3 * (unseen.measured - unseen.free_run))
    error.set(xlabel="time in s", ylabel="simulation error in mm")
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    main(*sys.argv[1:])
