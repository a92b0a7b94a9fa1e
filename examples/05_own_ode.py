"""Your own equation with a network in it: a pendulum whose friction nobody knows.

    python examples/05_own_ode.py [FIGURE.png]

Only the angle is measured. The speed is declared unmeasured: each window estimates the speed it
starts with, and the estimate is eliminated before the shared parameters see it.
"""

import sys

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp

import penode
from penode.engine import BestOf, LevenbergMarquardt, Positive, TanhLayers, with_batch_axis

STEP = 0.01  # s


class Pendulum(penode.Model):
    """angle'' = -g/l sin(angle) + b torque - friction(speed)."""

    states = ("angle", "speed")
    inputs = ("torque",)
    state_units = ("rad", "rad/s")
    unmeasured = ("speed",)

    friction: TanhLayers
    stiffness: object = penode.physical("1/s2", Positive())
    gain: object = penode.physical("1/(kg m2)", Positive())

    def learned(self, x):
        """Return the friction (1, batch) in rad/s2, an odd function of the speed."""
        forward, back = (self.friction.value_and_jacobian(s * x[1:])[0] for s in (1, -1))
        return 2.0 * (forward - back)

    def derivative(self, x, u):
        """Return (speed, acceleration)."""
        pull = self.stiffness * jnp.sin(x[0]) + self.learned(x)[0]
        return jnp.stack([x[1], self.gain * u[0] - pull])

    def maps(self):
        """Return ``friction_at(speed)`` in rad/s2."""
        batched = with_batch_axis(self)
        return {"friction_at": lambda v: batched.learned(np.stack([0 * v, v]))[0]}


def true_friction(speed):
    """Return what the simulated bearing does, in rad/s2."""
    return 0.3 * speed + 0.8 * np.tanh(speed / 0.4)


def record(seed, samples=3000):
    """Return a recording of the angle with noise of 1 mrad, the torque held in random steps."""
    random = np.random.default_rng(seed)
    torque = np.repeat(random.uniform(-8.0, 8.0, samples // 60 + 1), 60)[:samples]
    time = STEP * np.arange(samples)

    def derivative(t, x):
        push = 1.5 * torque[min(int(t / STEP + 1e-9), samples - 1)]
        return [x[1], push - 9.0 * np.sin(x[0]) - true_friction(x[1])]

    path = solve_ivp(derivative, (0, time[-1]), [0, 0], t_eval=time, max_step=STEP, rtol=1e-8)
    angle = path.y[0] + 1e-3 * random.normal(size=samples)
    return penode.Experiment(f"pendulum {seed}", STEP, {"angle": angle, "torque": torque})


def identify(run, horizons=(12, 25, 50, 100)):
    """Return the fit."""
    start, *others = (
        Pendulum(TanhLayers.random((1, 6, 1), seed), stiffness=7.0, gain=1.0) for seed in range(4)
    )
    first = penode.Stage(horizons[0], BestOf(LevenbergMarquardt(), tuple(others)))
    later = tuple(penode.Stage(h, LevenbergMarquardt()) for h in horizons[1:])
    plan = penode.Plan((first, *later))
    return penode.identify(start, [run], plan=plan, validation=[record(2)])


def main(out="pendulum.png"):
    """Print stiffness (true 9) and gain (true 1.5) and draw the friction."""
    fit = identify(record(1))
    for name, found in fit.parameters.items():
        low, high = found.interval_95
        print(f"{name} = {found.value:.3f} {found.unit}, 95 % interval {low:.3f} .. {high:.3f}")
    speed = np.linspace(-4, 4, 200)
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    axes.plot(speed, fit.friction_at(speed), label="learned")
    axes.plot(speed, true_friction(speed), "--", label="simulated")
    axes.set(xlabel="speed in rad/s", ylabel="friction in rad/s²")
    axes.legend()
    figure.savefig(out, dpi=120)


if __name__ == "__main__":
    main(*sys.argv[1:])
