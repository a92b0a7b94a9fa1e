"""Peers on JAX: diffrax with optimistix' Levenberg-Marquardt, and jax-sysid's L-BFGS."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jax_sysid.models import Model

from benchmarks.diffrax_gradient import HAIR, ClassicRungeKutta
from benchmarks.peer_models import Problem

jax.config.update("jax_enable_x64", True)  # as both peers do


class DiffraxOptimistix:
    """A step of the classic Runge-Kutta method a sample, forward mode, Levenberg-Marquardt."""

    def __init__(self, problem: Problem):
        self.problem = problem
        parameters = len(problem.start)
        u, wanted = jnp.asarray(problem.inputs), jnp.asarray(problem.outputs)
        samples, rows = len(u), np.array(problem.rows)

        def field(t, x, p):
            k = jnp.minimum((t + HAIR).astype(int), samples - 2)
            held = u[k] + (t - k) * (u[k + 1] - u[k]) if problem.by_hand.straight else u[k]
            return problem.time_step * jnp.stack(problem.by_hand.derivative(jnp, x, held, p))

        def residual(theta, _):
            path = diffrax.diffeqsolve(
                diffrax.ODETerm(field),
                ClassicRungeKutta(),
                t0=0.0,
                t1=samples - 1.0,
                dt0=1.0,
                y0=problem.guess + problem.spread * theta[parameters:],
                args=problem.parameters(jnp, theta),
                saveat=diffrax.SaveAt(t0=True, steps=True),
                adjoint=diffrax.ForwardMode(),
                max_steps=samples,
            ).ys[:samples, rows]
            error = jnp.clip((path - wanted) * problem.weights, -1e6, 1e6)
            return jnp.nan_to_num(error, nan=1e6)

        @eqx.filter_jit
        def fit(theta):
            solver = optimistix.LevenbergMarquardt(rtol=1e-7, atol=1e-7)
            found = optimistix.least_squares(residual, solver, theta, max_steps=300, throw=False)
            return found.value

        self.fit = fit

    def solve(self) -> Problem:
        """Return the problem with the parameters found."""
        theta = self.fit(jnp.zeros(len(self.problem.start) + len(self.problem.guess)))
        return self.problem.fixed(np.asarray(theta)[: len(self.problem.start)])


class JaxSysid:
    """The Runge-Kutta step as jax-sysid's state function, its L-BFGS, no regularisation."""

    def __init__(self, problem: Problem):
        self.problem = problem
        _, inputs, _ = problem.sizes
        rows, h = np.array(problem.rows), problem.time_step

        def step(scaled, both, params):
            p, x = problem.parameters(jnp, params[0]), problem.guess + problem.spread * scaled
            now, then = both[:inputs], both[inputs:]
            middle, end = ((now + then) / 2, then) if problem.by_hand.straight else (now, now)

            def f(x, u):
                return jnp.stack(problem.by_hand.derivative(jnp, x, u, p))

            k1 = f(x, now)
            k2 = f(x + h / 2 * k1, middle)
            k3 = f(x + h / 2 * k2, middle)
            k4 = f(x + h * k3, end)
            ahead = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            return (ahead - problem.guess) / problem.spread

        def output(scaled, both, params):
            return (problem.guess + problem.spread * scaled)[rows] * problem.weights

        self.step, self.output = step, output
        self.both = np.hstack([problem.inputs, np.roll(problem.inputs, -1, axis=0)])

    def solve(self) -> Problem:
        """Return the problem with the parameters found."""
        states, inputs, parameters = self.problem.sizes
        model = Model(
            states, len(self.problem.rows), 2 * inputs, state_fcn=self.step, output_fcn=self.output
        )
        model.init(params=[np.zeros(parameters)], x0=np.zeros(states))
        model.loss(rho_x0=0.0, rho_th=0.0, xsat=1e6)
        model.optimization(adam_epochs=0, lbfgs_epochs=2000, iprint=-1, memory=20, lbfgs_tol=1e-12)
        model.fit(self.problem.outputs * self.problem.weights, self.both)
        return self.problem.fixed(np.asarray(model.params[0]))
