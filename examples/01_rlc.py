"""A series RLC circuit whose inductance saturates: R, C and the curve L(i) from noisy data.

    python examples/01_rlc.py IDENTIFICATION.csv TEST.csv [FIGURE.png]

The files are those of github.com/forgi86/sysid-neural-continuous; 10 V and 1 A of noise are added,
which spoils the estimates unless windows are long or, as here, each corrects its own start.
"""

import sys

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import penode
import penode.engine as engine

CURRENT, INDUCTANCE = 5.0, 50e-6  # scales inside the network: A, H


class Circuit(penode.Model):
    """L(i) di/dt = u - v - R i and C dv/dt = i."""

    states = ("v", "i")
    inputs = ("u",)
    state_units = ("V", "A")

    inductance: engine.TanhLayers
    R: object = penode.physical("ohm", engine.Positive())
    C: object = penode.physical("F", engine.Positive())

    def learned(self, x):
        """Return L (1, batch) in H, an even function of the current."""
        even = jnp.sqrt(1 + (x[1:] / CURRENT) ** 2) - 2
        return INDUCTANCE * jnp.exp(self.inductance.value_and_jacobian(even)[0])

    def derivative(self, x, u):
        """Return (dv/dt, di/dt) from v in V, i in A and the source u in V."""
        return jnp.stack([x[1] / self.C, (u[0] - x[0] - self.R * x[1]) / self.learned(x)[0]])

    def maps(self):
        """Return ``inductance_at(i)`` in H."""
        batched = engine.with_batch_axis(self)
        return {"inductance_at": lambda i: batched.learned(np.stack([0 * i, i]))[0]}


def load(path, noise=(10.0, 1.0), seed=0):
    """Return a recording with noise of these deviations in V and A."""
    time, v, i, u = np.loadtxt(path, delimiter=",", skiprows=1, usecols=range(4)).T
    random = np.random.default_rng(seed)
    v, i = (c + s * random.normal(size=len(c)) for c, s in zip((v, i), noise, strict=True))
    return penode.Experiment(str(path), float(np.mean(np.diff(time))), {"v": v, "i": i, "u": u})


def true_inductance(current):
    """Return the simulated L(i) in H."""
    return INDUCTANCE * (0.9 * (np.arctan(-5 * (np.abs(current) - 5)) / np.pi + 0.5) + 0.1)


def inductance_error(fit, run):
    """Return the rms error of L(i) over the middle 95 % of the currents, as a fraction of L(0)."""
    current = np.linspace(*np.quantile(run.channels["i"], (0.025, 0.975)), 200)
    error = fit.inductance_at(current) - true_inductance(current)
    return float(np.sqrt(np.mean(error**2)) / true_inductance(0.0))


def identify(run, unseen=(), horizons=(30, 100, 300)):
    """Return the fit at the longest horizon, both states free at each window's start."""
    start, *others = (
        Circuit(engine.TanhLayers.random((1, 6, 1), k), R=2.0, C=300e-9) for k in range(3)
    )
    climb = engine.LevenbergMarquardt(100, tolerance=0.01)
    optimisers = [engine.BestOf(climb, tuple(others)), *[climb] * (len(horizons) - 1)]
    loss = engine.Loss(
        free_starts={"v": np.inf, "i": np.inf}, penalties=(engine.WeightDecay(3e-6),)
    )
    plan = penode.Plan(tuple(map(penode.Stage, horizons, optimisers)), loss=loss)
    return penode.identify(start, [run], plan=plan, purpose=engine.Longest(), validation=unseen)


def main(data, test, out="rlc.png"):
    """Print R and C, and draw the curve."""
    run = load(data)
    fit = identify(run, [load(test, noise=(0.0, 0.0))])
    for name, found in fit.parameters.items():
        print(f"{name} = {found.value:.4g} {found.unit}, deviation {found.std:.2g}")
    print(f"L(i) to {inductance_error(fit, run):.1%} of L(0), rms over the excited range")
    current = np.linspace(-20.0, 20.0, 400)
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    for curve, label in ((fit.inductance_at, "identified"), (true_inductance, "simulated")):
        axes.plot(current, 1e6 * curve(current), label=label)
    axes.set(xlabel="current in A", ylabel="inductance in µH")
    axes.legend()
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    main(*sys.argv[1:])
