"""The references against their formulas and their limits."""

import numpy as np
import pytest

from penode.bench.references import (
    GENERATOR,
    MOTOR,
    WHOLE_DISC,
    Domain,
    Injection,
    Lissajous,
    Spiral,
    Steps,
    stationary_grid,
)
from penode.errors import InputError

TIME = np.arange(20000) * 1e-4


def test_it_follows_the_formula_and_stays_in_the_disc():
    i_d, i_q = Lissajous(300.0, rate_d=14.0, rate_q=15.0)(TIME).T
    np.testing.assert_allclose(i_q, 300.0 * np.sin(15.0 * TIME), atol=1e-12)
    np.testing.assert_allclose(
        i_d, 300.0 * np.abs(np.cos(15.0 * TIME)) * np.sin(14.0 * TIME), atol=1e-5
    )
    length = np.hypot(i_d, i_q)
    assert length.max() <= 300.0 * (1 + 1e-12)
    assert i_d.min() < -295.0
    assert i_d.max() > 295.0


@pytest.mark.parametrize(
    "reference",
    [
        Lissajous(300.0, 90.0, 97.0, domain)
        for domain in (WHOLE_DISC, MOTOR, GENERATOR, Domain((-0.9, 0.3), (0.2, 0.7)))
    ]
    + [
        Spiral(300.0, 40.0, 0.7),
        stationary_grid(300.0, points=9, dwell=0.01),
        Injection((100.0, 50.0), 200.0, (-150.0, 80.0)),
    ],
)
def test_the_current_stays_within_the_amplitude(reference):
    rows = reference(TIME)
    assert rows.shape == (20000, 2)
    assert np.hypot(*rows.T).max() <= 300.0 * (1 + 1e-12)
    assert np.hypot(*rows.T).max() > 200.0


@pytest.mark.parametrize(("domain", "sign"), [(MOTOR, 1), (GENERATOR, -1)])
def test_motor_and_generator_fill_their_quarter(domain, sign):
    rows = Lissajous(300.0, 90.0, 97.0, domain)(TIME)
    assert rows[:, 0].max() <= 0.0
    assert (sign * rows[:, 1]).min() >= 0.0
    angles = np.arctan2(sign * rows[:, 1], -rows[:, 0])
    filled = np.histogram2d(np.hypot(*rows.T), angles, bins=4, range=[[0, 300], [0, np.pi / 2]])
    assert filled[0].min() > 20


def test_a_spiral_goes_out_and_back():
    radius = np.hypot(*Spiral(250.0, 100.0, 1.0)(TIME).T)
    np.testing.assert_allclose(radius, 250.0 * np.abs(np.sin(np.pi * TIME)), atol=1e-10)


def test_steps_hold_each_point_and_begin_again():
    points = ((0.0, 0.0), (-50.0, 100.0), (20.0, -30.0))
    steps = Steps(points, dwell=0.1)
    assert steps.duration == pytest.approx(0.3)
    rows = steps(TIME[:6000])
    np.testing.assert_array_equal(rows[999:1001], [points[0], points[1]])
    np.testing.assert_array_equal(rows[[2999, 3000]], [points[2], points[0]])


def test_a_stationary_grid_covers_the_disc_in_small_steps():
    grid = stationary_grid(100.0, points=11, dwell=0.05)
    points = np.array(grid.points)
    assert len(points) == 81
    assert np.hypot(*points.T).max() <= 100.0
    assert len(set(grid.points)) == 81
    motor = np.array(stationary_grid(100.0, points=5, dwell=0.05, domain=MOTOR).points)
    assert motor[:, 0].max() == 0.0
    assert motor[:, 1].min() == 0.0


def test_an_injection_is_a_sine_around_a_point():
    rows = Injection((10.0, 5.0), 100.0, (-20.0, 30.0))(TIME[:100])
    wave = np.sin(2 * np.pi * 100.0 * TIME[:100])
    np.testing.assert_allclose(rows, np.stack([-20 + 10 * wave, 30 + 5 * wave], axis=1))


def test_what_cannot_be_is_refused():
    with pytest.raises(InputError, match=r"d axis must rise within -1 and 1, got 0\.5 to -0\.5"):
        Domain(d=(0.5, -0.5))
    with pytest.raises(InputError, match="got 0 points for 1 s each"):
        Steps((), 1.0)
    with pytest.raises(InputError, match="points an axis must be >= 2, got 1"):
        stationary_grid(100.0, points=1, dwell=1.0)
