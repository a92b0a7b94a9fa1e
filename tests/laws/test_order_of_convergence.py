"""Every method converges at the order its table claims."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from penode.predictors import tableaus
from penode.predictors.one_step import runge_kutta_step

#: All methods that ship, and one that a user might add.
METHODS = [t for t in vars(tableaus).values() if isinstance(t, tableaus.ButcherTableau)]
METHODS.append(
    tableaus.ButcherTableau(
        "kutta 3/8", 4, ((1 / 3,), (-1 / 3, 1.0), (1.0, -1.0, 1.0)), (1 / 8, 3 / 8, 3 / 8, 1 / 8)
    )
)
#: Steps over the span: fine enough for the leading term, coarse enough to stay above rounding.
STEPS = {1: (4000, 8000), 2: (200, 400), 4: (100, 200)}


def pendulum(x):
    """Driven, damped, at large swing: nonlinear in both states."""
    return np.stack([x[1], 0.4 - 0.3 * x[1] * np.abs(x[1] + 3.0) - np.sin(x[0])])


def test_all_shipped_methods_are_measured():
    assert {"euler", "rk4"} <= {method.name for method in METHODS}


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
def test_order_of_convergence(method):
    span, start = 3.0, np.array([2.0, -0.5])
    exact = solve_ivp(
        lambda t, x: pendulum(x), (0, span), start, method="DOP853", rtol=1e-13, atol=1e-14
    ).y[:, -1]
    errors = []
    for steps in STEPS[method.order]:
        x = start
        for _ in range(steps):
            x = runge_kutta_step(method, pendulum, x, span / steps)
        errors.append(np.linalg.norm(x - exact))
    assert errors[1] > 1e-12
    assert np.log2(errors[0] / errors[1]) == pytest.approx(method.order, abs=0.1)
