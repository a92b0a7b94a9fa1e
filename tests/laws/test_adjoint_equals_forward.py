"""Reverse mode and forward sensitivities differentiate one loss: gradient = -2 descent / count."""

import numpy as np
import pytest


@pytest.mark.parametrize(
    ("name", "solver", "horizon"),
    [
        ("duffing", "rk4", 7),
        ("linear machine", "euler", 23),
        ("coenergy machine", "euler", 7),
        ("mlp machine", "euler", 1),
    ],
)
def test_gradient_is_the_descent(systems, objective_of, name, solver, horizon):
    system = systems[name]
    windows, objective = system.windows(horizon), objective_of(system, solver)
    terms = objective.gauss_newton(system.raw, windows)
    loss, gradient = objective.loss_and_gradient(system.raw, windows)
    assert loss == pytest.approx(terms.loss, rel=1e-12)
    size = np.sqrt(np.diag(terms.normal) / terms.count * terms.loss)
    off = np.abs(gradient + 2 * terms.descent / terms.count) / size
    assert off.max() < 1e-10
