"""What agreeing rungs say together, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from penode.arrays import float64
from penode.data.windows import Windows
from penode.horizon.consensus import Consensus, settled
from penode.horizon.ladder import RungFit
from penode.models.layout import Layout
from penode.training.plan import Solution
from penode.training.residuals import GaussNewtonTerms

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
    return RungFit(horizon, solution, values, known, known, influence, windows, None, None)


def white(seed):
    return np.random.default_rng(seed).normal(size=SAMPLES)


def test_independent_rungs_are_surer_together():
    """Their mean is weighted by precision, and its variance is one over the sum of precisions."""
    rungs = [rung(h, 5.0, s, white(h)) for h, s in ((1, 0.4), (4, 0.2), (16, 0.1))]
    found = Consensus.of(rungs)
    np.testing.assert_allclose(found.values, [5.0])
    known = (0.4**-2 + 0.2**-2 + 0.1**-2) ** -0.5
    np.testing.assert_allclose(found.deviation, [known], rtol=0.15)


def test_what_rungs_share_does_not_average_out():
    noise = white(3)
    rungs = [rung(1, 5.0, 0.2, noise), rung(1, 5.0, 0.2, noise), rung(1, 5.0, 0.2, noise)]
    np.testing.assert_allclose(Consensus.of(rungs).deviation, [0.2], rtol=0.1)


def test_what_rungs_differ_by_widens_the_interval():
    values, deviations = np.array([1.0, 2.0, 4.0]), np.array([1e-3, 2e-3, 1e-3])
    rungs = [
        rung(h, v, s, white(h)) for h, v, s in zip((1, 4, 16), values, deviations, strict=True)
    ]
    found = Consensus.of(rungs)
    middle = np.average(values, weights=deviations**-2.0)
    spread = np.sqrt(np.average((values - middle) ** 2, weights=deviations**-2.0))
    np.testing.assert_allclose(found.values, [middle])
    np.testing.assert_allclose(found.deviation, [spread], rtol=1e-5)


def test_one_rung_is_its_own_consensus():
    found = Consensus.of([rung(3, 7.0, 0.5, white(1))])
    np.testing.assert_allclose(found.values, [7.0])
    np.testing.assert_allclose(found.deviation, [0.5], rtol=0.1)


def unknown(made, working):
    return replace(made, deviation=np.array([np.inf]), working=np.array([working]))


def test_a_rung_that_is_decided_by_one_window_does_not_count():
    known = rung(4, 5.0, 0.2, white(1))
    found = Consensus.of([unknown(rung(1, 9.0, 0.1, white(2)), np.inf), known])
    np.testing.assert_allclose(found.values, [5.0])
    np.testing.assert_allclose(found.deviation, [0.2], rtol=0.1)


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
    np.testing.assert_allclose(found.deviation, [np.hypot(0.2, spread)])


@pytest.mark.parametrize("held", [False, True])
def test_what_is_not_physical_follows_to_where_the_loss_is_least(systems, rng, held):
    """Against a quadratic loss minimised with the physical parameters given."""
    model = systems["duffing"].model
    layout = Layout(model)
    raw = layout.raw(model)
    moving = np.ones(layout.size, dtype=bool)
    moving[:2] = not held
    root = rng.normal(size=(40, int(moving.sum())))
    terms = GaussNewtonTerms(0.0, 40, root.T @ root, np.zeros(root.shape[1]), root.T)
    made = replace(rung(1, 1.0, 1.0, white(1)), solution=Solution(raw, terms, 1, "Made by hand."))
    with float64():
        before = np.asarray(layout.physical_values(layout.values(raw)))
        wanted = before * np.array([1.1, 0.9])
        found = settled(layout, made, moving, wanted)
        np.testing.assert_allclose(layout.physical_values(layout.values(found)), wanted)
    step = (found - raw)[moving]
    given = layout.physical_members[moving]
    np.testing.assert_array_equal((found - raw)[~moving], 0.0)
    known = np.linalg.lstsq(root[:, ~given], -root[:, given] @ step[given], rcond=None)[0]
    np.testing.assert_allclose(step[~given], known, rtol=1e-8)
