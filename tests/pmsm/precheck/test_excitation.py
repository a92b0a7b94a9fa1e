"""What recordings cover, against shapes whose areas and frequencies are known."""

import numpy as np
import pytest

from penode import Experiment
from penode.pmsm.precheck.excitation import excitation_of

COUNT, STEP = 4000, 1e-4
TIME = STEP * np.arange(COUNT)


def recording(current, speed=300.0):
    """Return a recording of complex currents i_d + j i_q."""
    channels = {"i_d": np.real(current), "i_q": np.imag(current)}
    return Experiment("run.csv", STEP, {**channels, "omega_el": np.broadcast_to(speed, COUNT)})


def test_the_share_of_the_disc_is_that_of_the_hull_of_all_recordings_together():
    """Two triangles that make a square of side 2 in a disc of radius sqrt(2)."""
    corners = np.array([1 + 1j, -1 + 1j, -1 - 1j, 1 - 1j])
    one, two = (corners[np.arange(COUNT) % 3 + first] for first in (0, 1))
    found = excitation_of([recording(50 * one), recording(50 * two)])
    assert found.largest_current == pytest.approx(50 * np.sqrt(2.0))
    assert found.fraction == pytest.approx(2 / np.pi)
    assert excitation_of([recording(50 * one)]).fraction == pytest.approx(1 / np.pi)
    assert len(found.hull) == 4


def without_holes(found):
    """Return the advice but for that on holes."""
    return [sentence for sentence in found.advice if "holes" not in sentence]


@pytest.mark.parametrize("empty", range(4))
def test_the_quarter_that_was_not_visited_is_named(empty):
    """Three quarters in shares of 20, 30 and 50 %."""
    quarters = ["d > 0 and i_q > 0", "d < 0 and i_q > 0", "d < 0 and i_q < 0", "d > 0 and i_q < 0"]
    others = [k for k in range(4) if k != empty]
    at = np.repeat(others, [COUNT // 5, COUNT * 3 // 10, COUNT // 2])
    found = excitation_of([recording(1j**at * (1 + 1j), np.linspace(-300.0, 300.0, COUNT))])
    shares = np.zeros(4)
    shares[others] = 0.2, 0.3, 0.5
    np.testing.assert_allclose(found.quarters, shares)
    (sentence,) = without_holes(found)
    assert f"with i_{quarters[empty]}, so the map says nothing there" in sentence


@pytest.mark.parametrize(("radius", "share"), [(20.0, 0.0), (60.0, 0.16)])
def test_a_hole_in_the_hull_is_found_where_no_current_is_near(radius, share):
    """A disc of 100 A without one around (10, -20) A, of which 20 A at the rim are near enough."""
    random = np.random.default_rng(3)
    points = random.uniform(-100, 100, 20 * COUNT) + 1j * random.uniform(-100, 100, 20 * COUNT)
    beside = np.abs(points - (10 - 20j)) > radius
    currents = points[(np.abs(points) < 100) & beside][:COUNT]
    found = excitation_of([recording(currents, np.linspace(-300.0, 300.0, COUNT))])
    assert found.holes.fraction == pytest.approx(share, abs=0.02)
    named = [sentence for sentence in found.advice if "holes" in sentence]
    assert len(named) == bool(share)
    if share:
        np.testing.assert_allclose(found.holes.middle, [10, -20], atol=5)
        assert "the largest is around i_d" in named[0]


@pytest.mark.parametrize(("rate", "slow"), [(40.0, 20.0), (200.0, 35.0)])
def test_nine_tenths_of_the_power_decide_how_fast_the_currents_are(rate, slow):
    """A wave that carries a fifth of the power counts, one that carries a twentieth does not."""
    large, small = np.exp(2j * np.pi * slow * TIME), np.exp(2j * np.pi * rate * TIME)
    for share, expected in ((0.2, rate), (0.05, slow)):
        current = 7.0 + np.sqrt(1 - share) * large + np.sqrt(share) * small
        found = excitation_of([recording(current), recording(0.1 * np.exp(1j * TIME))])
        assert found.current_rate == pytest.approx(2 * np.pi * expected, rel=0.03)


def test_speeds_are_medians_and_their_range_has_no_spikes():
    circle = 50 * np.exp(300j * TIME)
    spiked = np.where(np.arange(COUNT) % 50 == 0, 9e3, 300.0)
    found = excitation_of([recording(circle, spiked), recording(circle, -250.0)])
    assert found.speeds == (300.0, -250.0)
    assert found.speed_range == (-250.0, 300.0)
    assert without_holes(found) == []
    (only,) = without_holes(excitation_of([recording(circle, spiked)]))
    assert only.startswith("There is one speed only")


@pytest.mark.parametrize(("other", "one_speed"), [(245.0, True), (235.0, False), (-300.0, False)])
def test_speeds_a_fifth_apart_are_two(other, one_speed):
    circle = 50 * np.exp(300j * TIME)
    found = excitation_of([recording(circle), recording(circle, other)])
    assert bool(without_holes(found)) == one_speed
