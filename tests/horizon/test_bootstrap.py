"""Bootstrap over windows, beside least squares of the same draws."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from tests.horizon.test_profile import PLAN, STEP, Decay, errors, fit, run  # noqa: F401 (fixtures)

from penode import Experiment, InputError, identify
from penode.engine import bootstrap
from penode.horizon.bootstrap import resampled

DRAWS, SEED = 6, 4


def test_every_draw_is_least_squares_of_its_windows(fit, run):  # noqa: F811
    told = []
    found = bootstrap(fit, [run], draws=DRAWS, seed=SEED, plan=PLAN, progress=told.append)
    random, block = np.random.default_rng(SEED), int(len(run) ** 0.6)
    deviation = np.array(list(fit.horizon.ladder[0].std.values()))
    for values in found.values:
        drawn = resampled(len(run) - 1, block, random)
        expected = least_squares(lambda p, at=drawn: errors(p, run)[at], [1.0, 1.0], xtol=1e-14).x
        assert np.abs((values - expected) / deviation).max() < 0.1  # where training stops
    assert told == list(range(1, DRAWS + 1))
    assert found.parameters == ("rate", "gain")
    assert found.horizon == 1
    assert found.std["rate"] == pytest.approx(np.std(found.values[:, 0], ddof=1))
    low, high = found.interval_95["gain"]
    assert found.values[:, 1].min() <= low < high <= found.values[:, 1].max()


def test_it_spreads_as_the_reported_deviation_says():
    random = np.random.default_rng(5)
    u, x = np.sign(random.normal(size=400)).repeat(5), [0.0]
    for held in u[:-1]:
        x.append(held * 2.0 + (x[-1] - held * 2.0) * np.exp(-0.7 * STEP) + 0.02 * random.normal())
    long = Experiment("long", STEP, {"x": np.array(x), "u": u})
    known = identify(Decay(1.0, 1.0), [long], plan=PLAN)
    found = bootstrap(known, [long], draws=60, plan=PLAN)
    for name, deviation in known.horizon.ladder[0].std.items():
        assert 0.7 < found.std[name] / deviation < 1.4


def test_blocks_are_whole_and_go_round():
    drawn = resampled(10, 4, np.random.default_rng(0))
    begins = np.random.default_rng(0).integers(10, size=3)
    wanted = [(begin + k) % 10 for begin in begins for k in range(4)][:10]
    assert drawn.tolist() == sorted(wanted)


def test_bad_requests_are_refused(fit, run):  # noqa: F811
    with pytest.raises(InputError, match="draws must be >= 2, got 1"):
        bootstrap(fit, [run], draws=1, plan=PLAN)
    with pytest.raises(InputError, match=r"five blocks of 7 samples .* got 30 "):
        bootstrap(fit, [run.part(0, 30)], draws=2, plan=PLAN)
