"""What agreeing rungs say together, against closed forms."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import equinox as eqx
import numpy as np
import pytest

from penode.arrays import Leaf, float64
from penode.data.windows import Windows
from penode.horizon import consensus
from penode.horizon.consensus import (
    BETWEEN,
    Consensus,
    averaged,
    between_recordings,
    map_weights,
    retrained,
)
from penode.horizon.ladder import HorizonFit
from penode.models.layout import Layout
from penode.models.parameters import physical
from penode.models.polynomials import Polynomial
from penode.training.covariance import Reported, ScoreSeries, reported_covariance
from penode.training.plan import DIVERGED, Problem, Solution, ignore_progress
from penode.training.second_order import LevenbergMarquardt

SAMPLES = 4000


def rung(horizon, value, deviation, noise):
    """Make a rung whose windows contributed white noise of the deviation."""
    starts = np.arange(0, SAMPLES - horizon, horizon)
    windows = Windows(
        np.zeros((SAMPLES, 1)), np.zeros((SAMPLES, 0)), starts, 0 * starts, horizon, 1, 1
    )
    influence = noise[None, : len(starts)] * deviation / np.sqrt(len(starts))
    values, known = np.array([value]), np.array([deviation])
    solution = Solution(np.zeros(1), None, 1, "Made by hand.")
    series = ScoreSeries.of_windows(windows)
    given = values, known, known, influence, windows, series
    return HorizonFit(horizon, solution, *given, None, None)


class PolynomialSpring(eqx.Module):
    """A spring that is linear in its coefficients, and a mass."""

    spring: Polynomial
    mass: Leaf = physical("kg")


def white(seed):
    return np.random.default_rng(seed).normal(size=SAMPLES)


def typical(made):
    """Return the root mean square of deviations that rungs of many draws of noise give."""
    return np.sqrt(np.mean([Consensus.of(made(seed)).deviation ** 2 for seed in range(200)]))


#: What a deviation of white noise is reported as: the quantile of few bandwidths, and what two
#: bandwidths of it differ by through chance.
REPORTED = {"rtol": 0.04}
FEW = 1.09


def test_independent_rungs_are_surer_together():
    """Their mean is weighted by precision, and its variance is one over the sum of precisions."""
    pairs = ((1, 0.4), (4, 0.2), (16, 0.1))

    def made(seed):
        return [rung(h, 5.0, s, white([seed, h])) for h, s in pairs]

    np.testing.assert_allclose(Consensus.of(made(0)).values, [5.0])
    known = (0.4**-2 + 0.2**-2 + 0.1**-2) ** -0.5
    np.testing.assert_allclose(typical(made), FEW * known, **REPORTED)


def test_what_a_prior_adds_is_shared_by_all_rungs():
    rungs = [replace(rung(h, 5.0, 1e-3, white(h)), prior=np.array([[0.04]])) for h in (1, 4, 16)]
    np.testing.assert_allclose(Consensus.of(rungs).deviation, [0.2], rtol=1e-3)


def test_no_deviation_is_finer_than_five_digits_of_the_value():
    rungs = [rung(h, 5.0, 1e-9, white(h)) for h in (1, 4, 16)]
    for found in (Consensus.of(rungs), Consensus.around(rungs[1], rungs)):
        np.testing.assert_allclose(found.deviation, [5e-5])


def test_what_rungs_share_does_not_average_out():
    of_all = typical(lambda seed: [rung(1, 5.0, 0.2, white(seed))] * 3)
    np.testing.assert_allclose(of_all, FEW * 0.2, **REPORTED)


def test_what_rungs_differ_by_widens_the_interval():
    values, deviations = np.array([1.0, 2.0, 4.0]), np.array([1e-3, 2e-3, 1e-3])
    rungs = [
        rung(h, v, s, white(h)) for h, v, s in zip((1, 4, 16), values, deviations, strict=True)
    ]
    found = Consensus.of(rungs)
    middle = np.average(values, weights=deviations**-2.0)
    spread = np.sqrt(np.average((values - middle) ** 2, weights=deviations**-2.0))
    np.testing.assert_allclose(found.values, [middle])
    np.testing.assert_allclose(found.deviation, [spread * np.sqrt(0.5)], rtol=1e-5)


def test_one_rung_is_its_own_consensus():
    found = Consensus.of([rung(3, 7.0, 0.5, white(1))])
    np.testing.assert_allclose(found.values, [7.0])
    of_one = typical(lambda seed: [rung(3, 7.0, 0.5, white(seed))])
    np.testing.assert_allclose(of_one, FEW * 0.5, **REPORTED)


def unknown(made, working):
    return replace(made, deviation=np.array([np.inf]), working=np.array([working]))


def test_a_rung_that_is_decided_by_one_window_does_not_count():
    known = rung(4, 5.0, 0.2, white(1))
    found = Consensus.of([unknown(rung(1, 9.0, 0.1, white(2)), np.inf), known])
    np.testing.assert_allclose(found.values, [5.0])
    np.testing.assert_allclose(found.deviation, Consensus.of([known]).deviation)


@pytest.mark.parametrize(("working", "promised"), [(0.1, False), (1.0, True)])
def test_nothing_is_promised_where_most_of_the_weight_is_on_rungs_that_do_not_know(
    working, promised
):
    rungs = [rung(4, 5.0, 0.2, white(1)), unknown(rung(9, 5.0, working, white(2)), working)]
    found = Consensus.of(rungs)
    np.testing.assert_allclose(found.values, [5.0])
    assert np.isfinite(found.deviation).all() == promised


def test_a_chosen_rung_is_less_sure_by_the_spread():
    rungs = [rung(1, 1.0, 0.1, white(1)), rung(5, 2.0, 0.2, white(2))]
    found = Consensus.around(rungs[1], rungs)
    np.testing.assert_allclose(found.values, [2.0])
    spread = np.sqrt(0.8 * 0.2)  # of two points, one apart, with weights 100 and 25
    own = reported_covariance(rungs[1].influence, rungs[1].series.lags)[0, 0]
    np.testing.assert_allclose(found.deviation, [np.sqrt(own + spread**2)])


def test_maps_are_weighed_by_their_precision():
    """Deviations of a map add in squares; one of which nothing is known does not count."""
    made = rung(1, 1.0, 1.0, white(1))
    known = [[9.0, 0.3, 0.4], [0.1, 1.0, 0.0], [1.0, np.inf, 1.0]]
    weights = map_weights([replace(made, working=np.array(one)) for one in known])
    np.testing.assert_allclose(weights, [0.8, 0.2, 0.0], atol=1e-30)


def test_the_mean_map_follows_the_physical_parameters_along_the_valley(rng):
    """Two coefficients of three move, to where a quadratic loss is least with p held."""
    layout = Layout(PolynomialSpring(Polynomial(1, 2, rng.normal(size=(1, 3))), 1.3))
    physical, moving = layout.physical_members, np.ones(4, dtype=bool)
    coefficients = np.flatnonzero(~physical)
    moving[coefficients[-1]] = False
    problem = Problem(SimpleNamespace(layout=layout), None, None, moving)
    slopes = rng.normal(size=(20, 3))
    terms = SimpleNamespace(normal=slopes.T @ slopes)
    raws = rng.normal(size=(2, 4))
    rungs = [
        replace(
            rung(1, 1.0, 1.0, white(1)),
            solution=Solution(raw, terms, 1, ""),
            working=np.array([1.0, deviation]),
        )
        for raw, deviation in zip(raws, [1.0, 2.0], strict=True)
    ]
    found = averaged(problem, rungs[0], rungs, np.array([0.7]))
    middle = 0.8 * raws[0] + 0.2 * raws[1]
    assert found[physical] == pytest.approx(0.7)
    c, p = np.flatnonzero(~physical[moving]), np.flatnonzero(physical[moving])
    rows = slopes[:, p] @ (middle[physical] - 0.7)
    expected = np.linalg.lstsq(slopes[:, c], rows, rcond=None)[0]
    np.testing.assert_allclose((found - middle)[coefficients], [*expected, 0.0], atol=1e-12)


@pytest.mark.parametrize("held", [False, True])
def test_what_is_not_physical_follows_to_where_the_loss_is_least(systems, objective_of, held):
    """Physical parameters are as given, and the loss no longer falls along any other."""
    system = systems["duffing"]
    objective = objective_of(system)
    layout, windows = objective.layout, system.windows(4)
    moving = np.ones(layout.size, dtype=bool)
    moving[:2] = not held
    problem = Problem(objective, Reported(layout, np.zeros((1, 2))), windows, moving)
    made = replace(rung(4, 1.0, 1.0, white(1)), solution=Solution(system.raw, None, 1, ""))
    with float64():
        before = np.asarray(layout.physical_values(layout.values(system.raw)))
        wanted = before * np.array([1.05, 0.95])
        found = retrained(problem, made, wanted, LevenbergMarquardt(200, tolerance=1e-6))
        np.testing.assert_allclose(layout.physical_values(layout.values(found)), wanted)
    np.testing.assert_array_equal((found - system.raw)[~moving], 0.0)
    replaced = objective.gauss_newton(layout.with_physical(system.raw, wanted), windows)
    after = objective.gauss_newton(found, windows)
    assert after.loss < replaced.loss
    others = moving & ~layout.physical_members
    assert np.abs(after.descent[others]).max() < 0.2 * np.abs(replaced.descent[others]).max()


def test_a_rung_that_is_its_own_consensus_is_not_trained_again(systems, objective_of):
    system = systems["duffing"]
    objective, windows = objective_of(system), system.windows(4)
    everything = np.ones(objective.layout.size, dtype=bool)
    problem = Problem(objective, None, windows, everything)
    with float64():
        values = np.asarray(objective.layout.physical_values(objective.layout.values(system.raw)))
    solution = Solution(system.raw, None, 1, "")
    made = replace(rung(4, 1.0, 1.0, white(1)), values=values, solution=solution)
    np.testing.assert_allclose(retrained(problem, made, values, None), system.raw, rtol=1e-12)


@dataclass
class Diverging:
    """An optimiser that goes astray."""

    def minimise(self, problem, raw, progress=ignore_progress):
        return Solution(raw + 1.0, None, 1, DIVERGED)


def test_training_that_diverges_leaves_the_learned_where_they_were(systems, objective_of):
    system = systems["duffing"]
    objective, windows = objective_of(system), system.windows(4)
    layout = objective.layout
    problem = Problem(objective, None, windows, np.ones(layout.size, dtype=bool))
    made = replace(rung(4, 1.0, 1.0, white(1)), solution=Solution(system.raw, None, 1, ""))
    wanted = np.array([0.8, 0.2])
    with float64():
        found = retrained(problem, made, wanted, Diverging())
        np.testing.assert_array_equal(found, layout.with_physical(system.raw, wanted))


# --- recordings that disagree -----------------------------------------------------------------


def of_recordings(moved, deviation, noise, horizon=10):
    """A rung of recordings of equal length, which would move its value by `moved`."""
    count = len(moved)
    each = SAMPLES // count
    inside = np.arange(0, each - horizon, horizon)
    starts = np.concatenate([k * each + inside for k in range(count)])
    recording = np.repeat(np.arange(count), len(inside))
    windows = Windows(
        np.zeros((SAMPLES, 1)), np.zeros((SAMPLES, 0)), starts, recording, horizon, 1, 1
    )
    influence = noise[: len(starts)] * deviation / np.sqrt(len(starts))
    influence = influence - influence.mean() + np.repeat(moved, len(inside)) / len(inside)
    series = ScoreSeries.of_windows(windows)
    made = rung(horizon, 1.0, deviation, noise)
    return replace(made, windows=windows, influence=influence[None], series=series)


def test_recordings_that_disagree_count_as_one_draw_each():
    moved = np.array([0.3, -0.5, 0.2])
    made = of_recordings(moved, 0.05, white(1))
    (row,) = between_recordings([made], np.ones((1, 1))).values()
    clustered = 1.5 * np.sum(moved**2)
    assert row[0, 0] == pytest.approx(clustered - 0.05**2, rel=0.15)
    assert BETWEEN in Consensus.around(made, [made]).parts
    assert BETWEEN in Consensus.of([made, made]).parts


def test_recordings_that_agree_are_rarely_said_not_to():
    fired = [
        bool(between_recordings([of_recordings(np.zeros(k), 0.05, white(s))], np.ones((1, 1))))
        for s in range(150)
        for k in (2, 4)
    ]
    assert np.mean(fired) < 0.1


def test_one_recording_disagrees_with_nothing():
    made = of_recordings(np.zeros(1), 0.05, white(2))
    assert between_recordings([made], np.ones((1, 1))) == {}


def test_a_recording_without_a_window_of_a_long_horizon_is_left_out_there():
    long = of_recordings(np.array([0.4, -0.4]), 0.05, white(3))
    short = of_recordings(np.array([0.4, -0.4]), 0.05, white(4))
    alone = short.windows.recording == 0
    lost = replace(
        short,
        windows=short.windows.among(alone),
        influence=short.influence[:, alone],
        series=ScoreSeries.of_windows(short.windows.among(alone)),
    )
    both = between_recordings([long, lost], np.array([[1.0], [0.0]]))
    np.testing.assert_allclose(both[BETWEEN], between_recordings([long], np.ones((1, 1)))[BETWEEN])


def test_rungs_beyond_any_number_have_an_unknown_spread_without_a_warning():
    values = np.array([[1e200, 1.0], [-1e200, 3.0]])
    with np.errstate(all="raise"):
        middle, spread = consensus._middle(values, np.full((2, 2), 0.5))
    np.testing.assert_allclose(middle, [0.0, 2.0])
    assert not np.isfinite(spread[0, 0])
    assert spread[1, 1] == pytest.approx(1.0)
