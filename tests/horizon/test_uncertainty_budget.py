"""Uncertainty budgets: systematic errors against closed forms, and sums of squares."""

from dataclasses import replace

import numpy as np
import pytest

from penode import identify, ladder_plan
from penode.fit.fit import Fit
from penode.horizon.consensus import HORIZON, STATISTICS
from penode.horizon.identifiability import Start
from penode.horizon.ladder import LadderProblem, ignore_events
from penode.horizon.uncertainty_budget import Imperfection, budget, raw_shifts
from penode.training.second_order import LevenbergMarquardt

PLAN = ladder_plan((1, 4, 16))
CURRENTS, VOLTAGES = ("i_d", "i_q"), ("u_d", "u_q")


def gain(names, size, source="gain"):
    def applied(experiment, deviations):
        scaled = {n: (1 + size * deviations) * experiment.channels[n] for n in names}
        return replace(experiment, channels={**experiment.channels, **scaled})

    return Imperfection(source, f"{100 * size} %", "Calibrate.", applied)


@pytest.fixture(scope="module")
def recordings(systems):
    return systems["linear machine"].recorded_again(noise=0.01)


@pytest.fixture(scope="module")
def start(systems):
    return Start(systems["linear machine"].model)


@pytest.fixture(scope="module")
def fitted(start, recordings):
    """Fit with a gain of 2 % of the voltages and of 1 % of the currents in its budget."""
    imperfections = (gain(VOLTAGES, 0.02, "voltages"), gain(CURRENTS, 0.01, "currents"))
    return identify(replace(start, imperfections=imperfections), recordings, plan=PLAN)


def row(fit, name, source):
    (found,) = (one for one in fit.parameters[name].budget if one.source == source)
    return found


@pytest.mark.parametrize(("name", "by_current"), [("R", 1), ("L_d", 1), ("L_q", 1), ("psi", 0)])
def test_gains_move_the_parameters_of_a_linear_machine_by_closed_forms(fitted, name, by_current):
    """Voltages times 1 + g are those of a machine with R, L and psi times 1 + g."""
    value = abs(fitted.parameters[name].value)
    assert row(fitted, name, "voltages").std == pytest.approx(0.02 * value, rel=0.02)
    expected = 0.01 * by_current * value
    assert row(fitted, name, "currents").std == pytest.approx(expected, rel=0.02, abs=1e-4 * value)


def test_a_shift_is_the_slope_of_what_training_gives(start, recordings):
    """The offset of one current has no closed form: train again with it, to the last digit."""

    def applied(experiment, deviations):
        moved = experiment.channels["i_q"] + 0.1 * deviations
        return replace(experiment, channels={**experiment.channels, "i_q": moved})

    plan = ladder_plan((4,), LevenbergMarquardt(tolerance=1e-6))
    problem = LadderProblem.of(start.model, recordings, plan, ignore_events)

    def rung(deviations):
        runs = [applied(e, deviations) for e in recordings]
        raw = problem.objective.layout.raw(start.model)
        return replace(problem, experiments=runs).climb(plan, raw).fits[0]

    offset = Imperfection("offset", "0.1 A", "", applied)
    shift = raw_shifts(problem, plan, plan.stages[0], rung(0.0), [offset])[0]
    difference = (rung(0.2).solution.raw - rung(-0.2).solution.raw) / 0.4
    np.testing.assert_allclose(shift, difference, rtol=0.02)


def test_squares_of_the_budget_add_to_the_deviation(fitted):
    for estimate in fitted.parameters.values():
        rows = estimate.budget
        assert estimate.std == pytest.approx(np.sqrt(sum(one.std**2 for one in rows)))
        assert [one.std for one in rows] == sorted((one.std for one in rows), reverse=True)
        low, high = estimate.interval_95
        assert high - low == pytest.approx(2 * 1.96 * estimate.std)


def test_without_imperfections_the_budget_is_what_the_data_show(start, recordings, fitted):
    plain = identify(start, recordings, plan=PLAN)
    for name, estimate in plain.parameters.items():
        assert estimate.statistical_std == pytest.approx(estimate.std)
        assert not any(one.accuracy for one in estimate.budget)
        assert fitted.parameters[name].statistical_std == pytest.approx(estimate.std)
        assert fitted.parameters[name].value == estimate.value


def test_the_band_of_a_learned_map_holds_the_imperfections(systems):
    """A gain of the force scales all; no other part shows beside one of 10 000 %."""
    system = systems["duffing"]
    recordings = system.recorded_again(noise=1e-4)
    start = Start(system.model, imperfections=(gain(("force",), 100.0),))
    fit = identify(start, recordings, plan=ladder_plan((8,)))
    low, high = np.quantile(fit.excited[:, 0], (0.1, 0.9))
    at = np.array([[low, 0.0], [high, 0.0]])
    expected = 100.0 * np.abs(fit.spring(at[:, 0])).ravel()
    np.testing.assert_allclose(fit.learned_deviation(at)[:, 0], expected, rtol=0.03)


def test_a_budget_survives_saving(fitted, tmp_path):
    fitted.save(tmp_path)
    assert Fit.load(tmp_path).parameters == dict(fitted.parameters)


def test_imperfections_of_one_source_are_one_row():
    two = [gain(CURRENTS, 0.01, "mismatch"), gain(VOLTAGES, 0.01, "mismatch")]
    rows = budget({STATISTICS: 1.0, HORIZON: 7.0}, two, np.array([3.0, -4.0]))
    assert [(one.source, one.std) for one in rows] == [
        (HORIZON, 7.0),
        ("mismatch", 5.0),
        (STATISTICS, 1.0),
    ]


def test_a_shift_that_is_no_number_is_unbounded():
    (row,) = budget({}, [gain(CURRENTS, 0.01)], np.array([np.nan]))
    assert row.std == np.inf
