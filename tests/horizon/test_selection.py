"""Selectors on ladders made by hand, and the paired deviation against Monte Carlo."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import norm

from penode.data.windows import Windows
from penode.horizon.ladder import Climb, HorizonFit
from penode.horizon.selection import (
    Choice,
    Longest,
    Plateau,
    _expected_errors,
    believable,
    choose,
    paired_deviation,
)
from penode.training.covariance import ScoreSeries
from penode.training.plan import Plan, Solution, Stage

SAMPLES = 4000


def windows_of(horizon):
    starts = np.arange(0, SAMPLES - horizon, horizon)
    return Windows(
        np.zeros((SAMPLES, 1)), np.zeros((SAMPLES, 0)), starts, 0 * starts, horizon, 1, 1
    )


def rung(horizon, values, deviation, influence=None):
    """Make a rung; without an influence, independent ones of the deviation stated."""
    values, deviation = np.atleast_1d(values).astype(float), np.atleast_1d(deviation).astype(float)
    windows = windows_of(horizon)
    if influence is None:
        count = len(windows)
        noise = np.random.default_rng(horizon).normal(size=(1, count))
        influence = noise * deviation[0] / np.sqrt(count)
    solution = Solution(np.zeros(1), None, 1, "Made by hand.")
    nothing = (None, None)  # neither is looked at
    given = values, deviation, deviation, influence, windows, ScoreSeries.of_windows(windows)
    return HorizonFit(horizon, solution, *given, *nothing)


def ladder(horizons, values, deviations):
    return [rung(*row) for row in zip(horizons, values, deviations, strict=True)]


# --- paired deviation -------------------------------------------------------------------------


def shares(noise, horizon, gain):
    """Return gain times the noise each window covers, (1, window); the last one takes the rest."""
    starts = windows_of(horizon).starts
    return gain * np.add.reduceat(noise, starts)[None]


@pytest.mark.parametrize("correlation", [0.0, 0.8])
@pytest.mark.parametrize(("gain", "own"), [(1.0, 0.5), (3.0, 0.0), (-1.0, 1.0)])
def test_paired_deviation_is_that_of_the_difference(correlation, gain, own):
    """Two rungs that share one noise, and a part of which is their own; what is shared cancels."""
    random = np.random.default_rng(5)
    differences, stated = [], []
    for _ in range(400):
        common, private = lfilter([1.0], [1.0, -correlation], random.normal(size=(2, SAMPLES)))
        a = rung(2, 0.0, 1.0, shares(common, 2, 1.0))
        b = rung(20, 0.0, 1.0, shares(common, 20, gain) + shares(own * private, 20, 1.0))
        differences.append(a.influence.sum() - b.influence.sum())
        stated.append(paired_deviation(a, b)[0])
    known = np.sqrt(SAMPLES * ((1 - gain) ** 2 + own**2)) / (1 - correlation)
    # 400 repetitions know a deviation to 3.5 %. The finite bandwidth costs about 4 %, and what the
    # bins of 16 samples make of windows of 20 adds up to 13 %.
    assert np.std(differences) == pytest.approx(known, rel=0.12)
    assert 0.93 * known < np.sqrt(np.mean(np.square(stated))) < 1.15 * known


def test_what_two_horizons_share_cancels(rng):
    noise = rng.normal(size=SAMPLES)
    a, b = (rung(h, 0.0, 1.0, shares(noise, h, 1.0)) for h in (2, 4))
    alone = np.sqrt(SAMPLES)
    assert paired_deviation(a, b)[0] < 0.02 * alone


def test_paired_deviation_has_one_entry_a_physical_parameter(rng):
    influence = rng.normal(size=(3, len(windows_of(2))))
    a = rung(2, np.zeros(7), np.ones(7), influence)
    assert paired_deviation(a, a).shape == (3,)
    np.testing.assert_array_equal(paired_deviation(a, a), 0.0)


# --- plateau ----------------------------------------------------------------------------------


def test_consistent_rungs_give_the_shortest_of_the_surest():
    choice = Plateau(averaged=True).select(
        ladder([1, 2, 4, 8, 16], [0.2] * 5, [0.05, 0.03, 0.011, 0.010, 0.012])
    )
    assert (choice.index, choice.verdict) == (2, "plateau")
    assert choice.agreeing == (0, 1, 2, 3, 4)
    assert "H = 1 to 16" in choice.reason
    assert "H = 4" in choice.reason


def test_equally_sure_rungs_give_one_step():
    choice = Plateau(averaged=True).select(ladder([1, 2, 4, 8], [0.2] * 4, [0.01] * 4))
    assert (choice.index, choice.verdict) == (0, "H = 1 suffices")
    assert "H = 1 to 8, and their weighted mean is the answer, also " in choice.reason
    assert choice.reason.endswith("as residuals do, is shown at H = 1.")


def test_a_tie_is_a_factor():
    made = ladder([1, 2, 4, 8], [0.2] * 4, [0.02, 0.014, 0.012, 0.01])
    chosen = [Plateau(tie=tie, averaged=True).select(made) for tie in (1.0, 1.25, 1.5, 2.1)]
    assert [choice.index for choice in chosen] == [3, 2, 1, 0]


def test_the_surest_rung_is_the_answer_unless_the_mean_is():
    made = ladder([1, 2, 4, 8, 16], [0.2] * 5, [0.05, 0.03, 0.011, 0.010, 0.012])
    choice = Plateau().select(made)
    assert (choice.index, choice.verdict, choice.averaged) == (3, "plateau", False)
    assert choice.agreeing == (0, 1, 2, 3, 4)
    assert "H = 1 to 16, and that of H = 8, the surest, is the answer" in choice.reason
    assert "shown at" not in choice.reason


def test_how_sure_a_rung_is_all_parameters_say_and_none_that_is_learned():
    made = [
        rung(h, [0.2, 0.3, 0.0], [*own, learned])
        for h, own, learned in [
            (1, (1e-2, 1e-4), 9.0),
            (4, (1.1e-2, 1e-5), 9.0),
            (16, (1e-2, 1e-4), 1.0),
        ]
    ]
    two = [replace(r, influence=np.vstack([r.influence, r.influence / 100])) for r in made]
    assert Plateau().select(two).index == 1


def test_horizons_beyond_the_plateau_are_named():
    choice = Plateau().select(ladder([1, 2, 4, 8, 16], [0.2] * 4 + [0.9], [0.01] * 5))
    assert "(those at 16 differ by more than chance)" in choice.reason
    assert "differ" not in Plateau().select(ladder([1, 2, 4], [0.2] * 3, [0.01] * 3)).reason


def test_a_rung_without_an_interval_is_in_no_plateau_and_is_named():
    made = ladder([1, 2, 4, 8, 16], [0.2] * 5, [0.01] * 5)
    unknown = np.array([np.inf])
    made[0] = replace(made[0], deviation=unknown, working=unknown)
    choice = Plateau().select(made)
    assert choice.reason.startswith("Estimates agree from H = 2 to 16, ")
    assert "(at H = 1 it has no interval, and no weight)" in choice.reason
    assert choice.agreeing == (1, 2, 3, 4)
    assert "no weight" not in Plateau().select(made[1:]).reason


def test_drifting_estimates_are_no_plateau():
    horizons = [1, 2, 4, 8, 16]
    choice = Plateau().select(ladder(horizons, 0.1 * np.arange(5), [0.01] * 5))
    assert choice.verdict == "no plateau"
    assert choice.agreeing == (0, 1, 2, 3, 4)
    assert "range" in choice.reason


@pytest.mark.parametrize(
    ("horizons", "split", "expected"),
    [
        ([1, 2, 4, 8, 16, 32, 64], 3, (3, 4, 5, 6)),  # the second is longer
        ([1, 2, 4, 8, 16, 32, 64], 4, (0, 1, 2, 3)),  # the first is longer
        ([1, 2, 4, 8, 16, 32], 3, (3, 4, 5)),  # the later of two as long
        ([1, 2, 3, 4, 5, 20, 90], 5, (0, 1, 2, 3, 4)),  # more rungs and a wider factor
        ([1, 2, 3, 4, 10, 30, 90], 4, (4, 5, 6)),  # fewer rungs, but a wider factor
    ],
)
def test_of_two_plateaus_the_one_longer_in_log_h_is_taken(horizons, split, expected):
    values = [0.1] * split + [0.5] * (len(horizons) - split)
    choice = Plateau().select(ladder(horizons, values, [0.01] * len(horizons)))
    assert choice.agreeing == expected
    assert choice.index == expected[0]
    assert choice.verdict == ("plateau" if expected[0] else "H = 1 suffices")


@pytest.mark.parametrize(("deviation", "expected"), [(0.01, (3, 4, 5, 6)), (0.02, (0, 1, 2))])
def test_a_surer_plateau_is_taken_before_a_longer_one(deviation, expected):
    """Two-sided: where long horizons scatter more, the short ones are believed."""
    horizons = [1, 2, 4, 8, 16, 32, 64]
    values = [0.1] * 3 + [0.5] * 4
    choice = Plateau().select(ladder(horizons, values, [0.01] * 3 + [deviation] * 4))
    assert choice.agreeing == expected


def test_rungs_apart_by_less_than_a_deviation_agree(rng):
    """Though the difference itself is known far better."""
    noise = rng.normal(size=SAMPLES)
    made = [rung(h, 0.4 * k, 1.0, shares(noise, h, 1.0)) for k, h in enumerate((1, 2, 4))]
    assert Plateau().select(made).agreeing == (0, 1, 2)
    made[2] = rung(4, 1.2, 1.0, shares(noise, 4, 1.0))
    assert Plateau().select(made).verdict == "no plateau"


@pytest.mark.parametrize("horizons", [[1, 2, 3], [1, 4], [7]])
def test_few_rungs_or_a_narrow_span_are_no_plateau(horizons):
    choice = Plateau().select(ladder(horizons, [0.2] * len(horizons), [0.01] * len(horizons)))
    assert choice.verdict == "no plateau"
    assert choice.agreeing == tuple(range(len(horizons)))


def test_one_rung_is_not_blamed_on_the_horizon():
    assert "depend on the horizon" not in Plateau().select(ladder([7], [0.2], [0.01])).reason


def test_how_much_is_a_plateau_is_settable():
    made = ladder([1, 2, 3], [0.2] * 3, [0.01] * 3)
    assert Plateau(factor=3.0).select(made).verdict == "H = 1 suffices"
    assert Plateau(factor=3.0, rungs=4).select(made).verdict == "no plateau"


@pytest.mark.parametrize("count", [2, 5])
@pytest.mark.parametrize("physical", [1, 2])
def test_the_level_is_shared_by_all_pairs_and_parameters(count, physical):
    """Alone two rungs part at 1.96 deviations of their difference; among 5 of them, at 2.81."""
    random, horizons, made = np.random.default_rng(3), [1, 2, 4, 8, 16][:count], []
    for horizon in horizons:
        influence = random.normal(size=(physical, len(windows_of(horizon))))
        made.append(rung(horizon, np.zeros(physical), np.ones(physical), influence))
    pairs = count * (count - 1) / 2
    closest = min(paired_deviation(other, made[-1])[0] for other in made[:-1])
    limit = norm.isf(0.05 / 2 / pairs / physical) * closest
    for factor, agreeing in ((0.99, count), (1.01, count - 1)):
        values = made[-1].values.copy()
        values[0] = factor * limit
        last = rung(horizons[-1], values, np.ones(physical), made[-1].influence)
        choice = Plateau(rungs=1, factor=1.0).select([*made[:-1], last])
        assert len(choice.agreeing) == agreeing


def test_all_physical_parameters_must_agree(rng):
    def two(horizon, drift):
        influence = 0.01 * rng.normal(size=(2, len(windows_of(horizon))))
        return rung(horizon, [0.2, drift], [0.01, 0.01], influence)

    made = [two(h, drift) for h, drift in zip((1, 2, 4, 8), (0.0, 9.0, 18.0, 27.0), strict=True)]
    assert Plateau().select(made).verdict == "no plateau"
    still = [two(h, 0.0) for h in (1, 2, 4, 8)]
    assert Plateau().select(still).verdict != "no plateau"


def test_the_learned_map_has_a_vote():
    """The physical parameter is as sure everywhere; the map is best known at H = 4."""
    maps = [9.0, 9.0, 1.0, 9.0]
    made = [rung(h, [0.2, 0.0, 0.0], [0.01, m, m]) for h, m in zip((1, 2, 4, 8), maps, strict=True)]
    assert Plateau(averaged=True).select(made).index == 2


def test_a_rung_away_from_the_consensus_is_less_sure():
    """It agrees with the rest within its deviation of the difference, but sits at one side."""
    wide = 0.01 * np.random.default_rng(0).normal(size=(1, len(windows_of(1))))
    made = [rung(1, 0.205, 0.001, wide), *ladder([2, 4, 8], [0.2] * 3, [0.001] * 3)]
    made[1:] = [rung(r.horizon, r.values, r.deviation, 20 * r.influence) for r in made[1:]]
    choice = Plateau(averaged=True).select(made)
    assert choice.agreeing == (0, 1, 2, 3)
    assert choice.index == 1


# --- a horizon that was asked for -------------------------------------------------------------


def test_longest_is_the_last_rung():
    choice = Longest().select(ladder([1, 8, 50], [0.0, 5.0, 9.0], [0.1] * 3))
    assert choice == Choice(2, "fixed", "The horizon was set to 50 by the user.", (2,))


def test_a_map_whose_deviation_is_no_number_leaves_a_choice():
    rungs = ladder((1, 8, 50), 3 * [[1.0, np.nan]], 3 * [[0.1, np.nan]])
    choice = Plateau().select(rungs)
    assert isinstance(choice, Choice)
    assert 0 <= choice.index < 3


def test_a_parameter_that_ran_away_at_one_horizon_is_expected_to_err_there_without_a_warning():
    rungs = ladder((1, 4, 16), [2.0, 2.0, 1e200], [0.1, 0.1, np.inf])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        errors = _expected_errors(rungs)
    assert 0.09 < errors[0] == errors[1] < 0.2
    assert errors[2] > 1e100


def test_a_collapsed_deviation_is_not_believed():
    rungs = ladder((1, 8, 50, 200), (1.0, 1.0, 5.0, 1.0), (0.3, 0.2, 1e-9, 0.1))
    climb = believable(Climb(tuple(rungs)))
    assert [r.working[0] for r in climb.fits] == [0.3, 0.2, np.inf, 0.1]
    assert np.isinf(climb.fits[2].deviation[0])
    whole = Climb(tuple(ladder((1, 8), (1.0, 1.0), (0.3, 0.01))))
    assert believable(whole) is whole


@pytest.mark.parametrize(("claimed", "believed"), [(1.9e-4, False), (2.1e-4, True)])
def test_a_deviation_collapses_below_a_thousandth_of_the_median(claimed, believed):
    """Each parameter by itself; infinite ones have no part in the median."""
    first = np.array([np.inf, np.inf, np.inf, 0.2, 0.2, claimed])
    deviations = np.column_stack([first, np.ones(6)])
    rungs = ladder((1, 2, 4, 8, 16, 32), np.ones((6, 2)), deviations)
    rungs = [replace(r, influence=np.ones((2, len(r.windows)))) for r in rungs]
    last = believable(Climb(tuple(rungs))).fits[-1]
    np.testing.assert_array_equal(np.isfinite(last.working), [believed, True])
    np.testing.assert_array_equal(np.isfinite(last.deviation), [believed, True])
    assert rungs[-1].working[0] == claimed, "the climb that came is as it was"


def test_a_collapsed_climb_remembers_that_it_was_interrupted():
    rungs = ladder((1, 8, 50), (1.0, 1.0, 1.0), (0.3, 0.2, 1e-9))
    assert believable(Climb(tuple(rungs), interrupted=True)).interrupted


def test_a_rung_whose_free_run_is_unstable_is_not_believed():
    rungs = ladder((1, 8, 50, 200), (1.0, 1.0, 1.2, 1.0), (0.3, 0.2, 0.01, 0.1))
    errors = ([2.0, 0.1], [1.0, 0.1], [1.0, 1e9], [1.0, 0.3])
    known = tuple(replace(r, free_run=np.array(e)) for r, e in zip(rungs, errors, strict=True))
    climb = believable(Climb(known))
    assert [r.working[0] for r in climb.fits] == [0.3, 0.2, np.inf, 0.1]
    astray = tuple(replace(r, free_run=np.array([np.inf, 1.0])) for r in rungs)
    assert believable(Climb(astray)).fits == astray, "where all are, it says nothing of one"


def test_what_was_interrupted_is_preliminary():
    made, plan = ladder([1, 2, 4, 8], [0.2] * 4, [0.01] * 4), Plan((Stage(50, None),))
    whole = choose(Plateau(), Climb(tuple(made)), plan)
    assert whole == Plateau().select(made)
    stopped = choose(Plateau(), Climb(tuple(made), interrupted=True), plan)
    assert stopped.verdict == "stopped"
    assert stopped.reason == f"The ladder was not climbed to its end. So far: {whole.reason}"
    assert (stopped.index, stopped.agreeing) == (whole.index, whole.agreeing)
    named = choose(Longest(), Climb(tuple(made), interrupted=True), plan)
    assert named.reason == "The horizon asked for, 50, was not reached."


@pytest.mark.parametrize(("surer", "expected"), [(1.04, (3, 4, 5, 6)), (1.06, (0, 1, 2))])
def test_a_run_that_is_hardly_surer_does_not_outweigh_a_longer_one(surer, expected):
    values, deviations = [0.1] * 3 + [0.5] * 4, [0.01] * 3 + [0.01 * surer] * 4
    choice = Plateau().select(ladder([1, 2, 4, 8, 16, 32, 64], values, deviations))
    assert choice.agreeing == expected
