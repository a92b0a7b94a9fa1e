"""Problems of the optimisers' tests."""

import pytest

from penode.training.covariance import Reported
from penode.training.plan import Problem


@pytest.fixture(scope="session")
def problem_of(objective_of):
    """Return a function that makes the problem of a system over its own or other recordings."""
    reported = {}

    def make(system, horizon, *, experiments=None, groups=None):
        objective, windows = objective_of(system), system.windows(horizon, experiments)
        points = system.experiments[0].stack(system.model.states)[::40]
        watched = reported.setdefault(objective, Reported(objective.layout, points))
        return Problem(objective, watched, windows, objective.layout.members(groups))

    return make
