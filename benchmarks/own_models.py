"""Time and memory of fits of own models over their size: ``python -m benchmarks.own_models``.

Each row is a process of its own, cold: a chain of masses of which six positions are measured, a
long recording of a lag, and an oscillator whose spring a network learns beside the damping. Before
a row counts, its physical parameters have to be right within three deviations and 2 %.
"""

import sys
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np

import penode
from benchmarks.scale import cost
from penode.data.experiment import Experiment
from penode.engine import TanhLayers

#: Kind and sizes: masses, samples, neurons in each of two layers.
ROWS = {"chain": (3, 6, 12, 25), "lag": (10_000, 100_000, 1_000_000), "network": (6, 20, 100)}
_MEASURED, _SEED = 6, 20_261_128


def rk4(derivative, x, u, step):
    """Return the next sample of x (state,), the textbook's way."""
    k1 = derivative(x, u)
    k2 = derivative(x + step / 2 * k1, u)
    k3 = derivative(x + step / 2 * k2, u)
    return x + step / 6 * (k1 + 2 * k2 + 2 * k3 + derivative(x + step * k3, u))


def recorded(derivative, start, force, step, noise):
    """Return states (time, state) under a held force (time,), with white noise."""
    x = np.asarray(start, dtype=float)
    states = np.empty((len(force), len(x)))
    for k, u in enumerate(force):
        states[k] = x
        for _ in range(4):
            x = rk4(derivative, x, u, step / 4)
    return states + noise * np.random.default_rng(_SEED).normal(size=states.shape)


def held_force(samples, hold):
    """Return a random force of one value each `hold` samples."""
    drawn = np.random.default_rng(_SEED).normal(size=samples // hold + 1)
    return np.repeat(drawn, hold)[:samples]


def chain(masses):
    """Return a driven chain of masses at a wall, six positions measured."""
    names = tuple(f"x{k}" for k in range(masses)), tuple(f"v{k}" for k in range(masses))
    measured = np.unique(np.linspace(0, masses - 1, _MEASURED).round().astype(int))
    hidden = [name for k, name in enumerate(names[0]) if k not in measured]

    class Chain(penode.Model):
        states: ClassVar = (*names[0], *names[1])
        inputs: ClassVar = ("force",)
        state_units: ClassVar = ("m",) * masses + ("m/s",) * masses
        unmeasured: ClassVar = (*hidden, *names[1])

        stiffness: object = penode.physical("1/s^2")
        damping: object = penode.physical("1/s")

        def derivative(self, x, u):
            place, speed = x[:masses], x[masses:]
            left = jnp.concatenate([jnp.zeros_like(place[:1]), place[:-1]])
            right = jnp.concatenate([place[1:], place[-1:]])
            rate = self.stiffness * (left - 2 * place + right) - self.damping * speed
            return jnp.concatenate([speed, rate.at[-1].add(u[0])])

    def true(x, force):
        place, speed = x[:masses], x[masses:]
        around = np.concatenate([[0.0], place, place[-1:]])
        rate = 400.0 * np.diff(around, 2) - 2.0 * speed
        rate[-1] += force
        return np.concatenate([speed, rate])

    force = held_force(2000, 10)
    states = recorded(true, np.zeros(2 * masses), force, 0.01, 1e-4)
    channels = {f"x{k}": states[:, k] for k in measured} | {"force": force}
    return Chain(300.0, 1.0), Experiment("chain", 0.01, channels), (400.0, 2.0)


class Lag(penode.Model):
    """x' = rate (force - x)."""

    states: ClassVar = ("x",)
    inputs: ClassVar = ("force",)
    state_units: ClassVar = ("V",)

    rate: object = penode.physical("1/s")

    def derivative(self, x, u):
        return self.rate * (u[0] - x[0])[None]


def lag(samples):
    """Return a lag and its answer to a held input in closed form."""
    force, x, kept = held_force(samples, 10), np.zeros(samples), np.exp(-2.0 * 0.01)
    for k in range(samples - 1):
        x[k + 1] = force[k] + kept * (x[k] - force[k])
    x += 1e-2 * np.random.default_rng(_SEED).normal(size=samples)
    return Lag(1.0), Experiment("lag", 0.01, {"x": x, "force": force}), (2.0,)


class Sprung(penode.Model):
    """x'' = force - damping x' - x - what is learned of x."""

    states: ClassVar = ("x", "v")
    inputs: ClassVar = ("force",)
    state_units: ClassVar = ("m", "m/s")
    unmeasured: ClassVar = ("v",)

    spring: TanhLayers
    damping: object = penode.physical("1/s")

    def derivative(self, x, u):
        learned = self.spring.value_and_jacobian(x[:1])[0][0]
        return jnp.stack([x[1], u[0] - self.damping * x[1] - x[0] - learned])


def network(neurons):
    """Return an oscillator whose spring hardens and saturates; the position is measured."""

    def true(x, force):
        rest = np.tanh(3 * x[0]) + 0.3 * x[0] ** 3
        return np.array([x[1], force - 0.4 * x[1] - x[0] - rest])

    step, random = 0.02, np.random.default_rng(_SEED)
    time = step * np.arange(6000)
    lines = random.uniform(0.05, 1.5, 12), random.normal(size=12), random.uniform(0, 6, 12)
    force = sum(a * np.sin(2 * np.pi * f * time + p) for f, a, p in zip(*lines, strict=True))
    states = recorded(true, np.zeros(2), force, step, 0.002)
    run = Experiment("sprung", step, {"x": states[:, 0], "force": force})
    return Sprung(TanhLayers.random((1, neurons, neurons, 1), seed=0), 0.2), run, (0.4,)


MODELS = {"chain": chain, "lag": lag, "network": network}


def fitted(kind, size):
    """Identify by the default; raise SystemExit unless what is physical comes out right."""
    start, run, truth = MODELS[kind](size)
    fit = penode.identify(start, [run])
    for (name, found), true in zip(fit.parameters.items(), truth, strict=True):
        off = abs(found.value - true)
        if not (off < 3 * found.std and off < 0.02 * true):
            raise SystemExit(f"{kind} {size}: {name} = {found.value} ± {found.std}, not {true}.")
    return fit


def main():
    """Print a row for each kind and size."""
    print("| model | size | parameters | peak | processor | clock |\n|---|---|---|---|---|---|")
    for kind, sizes in ROWS.items():
        for size in sizes:
            start = MODELS[kind](min(size, 20_000))[0]
            count = sum(np.size(leaf) for leaf in jax.tree.leaves(start))
            taken = cost("benchmarks.own_models", [kind, str(size)])
            print(
                f"| {kind} | {size} | {count} | {taken.memory:.0f} MB | {taken.processor:.0f} s "
                f"| {taken.clock:.0f} s |",
                flush=True,
            )


if __name__ == "__main__":
    if len(sys.argv) > 1:
        fitted(sys.argv[1], int(sys.argv[2]))
    else:
        main()
