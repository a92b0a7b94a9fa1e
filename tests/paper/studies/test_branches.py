"""Branching training: what is shared changes nothing, and is trained once."""

from dataclasses import dataclass

import numpy as np
import pytest

from penode.data.experiment import Experiment
from penode.data.windows import Contiguous
from penode.horizon.ladder import LadderProblem
from penode.paper.studies.branches import Branches
from penode.pmsm.balance.start import nominal_start
from penode.training.plan import Plan, Solution, Stage

pytestmark = pytest.mark.usefixtures("quickly_compiled")

CALLS = []


@dataclass(frozen=True)
class Nudge:
    """An optimiser that multiplies all parameters by a factor, and counts."""

    factor: float

    def minimise(self, problem, raw, progress=None):
        CALLS.append(problem.windows.horizon)
        moved = raw * self.factor
        return Solution(moved, problem.gauss_newton(moved), 1, "moved")


def plan(*stages):
    return Plan(tuple(Stage(h, Nudge(factor)) for h, factor in stages), Contiguous())


@pytest.fixture(scope="module")
def begun(unseen_run):
    run = Experiment("run", 1e-4, {n: v[:300] for n, v in unseen_run.channels.items()})
    start = nominal_start([run], 4)
    return start, LadderProblem.of(start, [run], plan((1, 1.0)), lambda event: None)


def test_a_branch_ends_where_its_plan_would_by_itself(begun, tmp_path):
    start, problem = begun
    CALLS.clear()
    branches = Branches.at(tmp_path / "branches.json", {"seed": 4})
    short = branches.train(problem, start, plan((1, 1.001), (2, 1.002)), ())
    assert CALLS == [1, 2]
    assert short.parameters["R"].value == pytest.approx(start.terms[0].R * 1.001 * 1.002, rel=1e-12)
    assert short.horizon.selected == 2
    assert [rung.horizon for rung in short.horizon.ladder] == [2]
    assert not any("not tried" in warning for warning in short.warnings)

    other = branches.train(problem, start, plan((1, 1.001), (3, 1.005)), ())
    assert CALLS == [1, 2, 3]  # what both have in common is taken over
    assert other.parameters["R"].value == pytest.approx(start.terms[0].R * 1.001 * 1.005, rel=1e-12)

    again = Branches.at(branches.path, {"seed": 4})
    longer = again.train(problem, start, plan((1, 1.001), (3, 1.005), (4, 1.0)), ())
    assert CALLS == [1, 2, 3, 4]  # from the file too
    assert longer.parameters["R"].value == pytest.approx(other.parameters["R"].value, rel=1e-12)

    again.train(problem, start, plan((1, 1.003), (3, 1.005)), ())
    assert CALLS == [1, 2, 3, 4, 1, 3]  # another first stage is no common one


def test_ends_of_another_training_or_damaged_ones_are_left(tmp_path):
    path = tmp_path / "branches.json"
    for damaged in ("{]", "[]", '{"given": {}, "ends": 3}'):
        path.write_text(damaged)
        assert Branches.at(path, {}).ends == {}
    branches = Branches.at(path, {"share": 1.0})
    branches.keep("1:epochs=2", np.array([1.0, 2.5]))
    known = Branches.at(path, {"share": 1.0}).ends
    np.testing.assert_array_equal(known["1:epochs=2"], [1.0, 2.5])
    assert Branches.at(path, {"share": 0.1}).ends == {}
