"""Recordings that were not trained on: predicted or not, by their noise, region and stretches."""

import warnings
from types import SimpleNamespace

import numpy as np
import pytest

from penode.horizon.held_out_check import validation_fails
from penode.horizon.objections import CHECKS
from penode.validation.comparison import Comparison
from penode.validation.coverage import supported

COUNT = 2000
TIME = np.arange(COUNT)
#: Two states of deviation 10 that go around, whole periods.
SWING = 10 * np.sqrt(2) * np.stack([np.sin(TIME / 200 * np.pi), np.cos(TIME / 200 * np.pi)], axis=1)


def errors(size):
    """Return errors of exactly this root mean square in both states, from the second sample on."""
    made = size * np.outer((-1.0) ** TIME, np.ones(2))
    made[0] = 0.0
    return made


def seen(role, measured=SWING, step=1e-3, free=1e-2, name="", recording="", units=("A", "A")):
    """Return a recording whose runs err by so much."""
    parts = (measured, measured - errors(step), measured - errors(free))
    return Comparison(name or role, role, 1e-3, ("i_d", "i_q"), units, *parts, recording)


def fitted(*comparisons, train=None):
    train = train or seen("train")
    visited = np.concatenate([part * train.measured[::5] for part in np.linspace(0, 1, 9)])
    return SimpleNamespace(
        model=SimpleNamespace(states=("i_d", "i_q")),
        horizon=SimpleNamespace(ladder=()),
        comparisons=(train, *comparisons),
        excited=visited,
        supported=lambda points: supported(visited, points),
    )


def raised(*comparisons, train=None):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = list(validation_fails(fitted(*comparisons, train=train), []))
    assert {one.name for one in found} <= {"validation fails"}
    return [one.reason for one in found]


def test_it_is_one_of_the_checks_of_every_fit():
    assert validation_fails in CHECKS


@pytest.mark.parametrize(("free", "fails"), [(2.4, False), (2.6, True), (np.inf, True)])
def test_a_free_run_may_err_by_a_quarter_of_what_the_state_moves(free, fails):
    assert bool(raised(seen("validation", free=free))) == fails


@pytest.mark.parametrize(("usual", "free", "fails"), [(0.4, 3.9, False), (0.4, 4.1, True)])
def test_or_by_ten_times_that_of_training(usual, free, fails):
    assert bool(raised(seen("validation", free=free), train=seen("train", free=usual))) == fails


def test_but_never_by_more_than_half():
    poor = seen("train", free=4.0)
    assert raised(seen("validation", free=4.9), train=poor) == []
    assert raised(seen("validation", free=5.1), train=poor)


def test_the_sentence_has_the_errors_of_both():
    (reason,) = raised(seen("validation", free=68.6, name="other.csv"))
    assert reason.replace("i_q", "i_d") == (
        "other.csv: the free run of i_d, which moves by 10 A (rms), errs by 68.6 A (rms) on this "
        "recording, which was not trained on; in training it errs by 0.01 A."
    )
    (reason,) = raised(seen("validation", free=1e9))
    assert "diverges on this recording" in reason


def test_every_recording_is_judged_by_itself():
    runs = [seen("validation", free=free, name=f"{free}.csv") for free in (0.1, 5.0, 0.2, 6.0)]
    assert [reason.split(":")[0] for reason in raised(*runs)] == ["5.0.csv", "6.0.csv"]


@pytest.mark.parametrize("free", [0.5, 1.5])
def test_a_small_or_still_recording_is_measured_by_what_training_moved(free):
    """Magnets 2 % weaker are the same error in A at small currents as at large ones."""
    assert raised(seen("validation", 0.05 * SWING, free=free)) == []
    assert raised(seen("validation", 0.0 * SWING, free=free)) == []
    assert raised(seen("validation", 0.05 * SWING, free=3.0))


# --- noise ------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1.0, 4.0])
def test_noise_of_the_recording_itself_excuses_errors(size, rng):
    """The prediction from noisy samples errs by the noise of both."""
    noise = size * rng.normal(size=SWING.shape)
    run = Comparison(
        "noisy", "validation", 1e-3, ("i_d", "i_q"), ("A", "A"), SWING + noise,
        np.r_[SWING[:1], SWING[1:] + noise[:-1]], SWING,
    )  # fmt: skip
    assert raised(run) == []


# --- single steps -----------------------------------------------------------------------------


@pytest.mark.parametrize(("step", "fails"), [(0.9, False), (1.1, True)])
def test_single_steps_may_err_by_a_tenth_of_what_the_state_moves(step, fails):
    """A step moves the states by 0.16 here, so that the tenth counts."""
    assert bool(raised(seen("validation", step=step))) == fails


def test_single_steps_may_err_by_half_of_what_a_step_moves(rng):
    """Steps of 3 A: a tenth of what the state moves is less."""
    turned = 0.3 * TIME
    fast = 10 * np.sqrt(2) * np.stack([np.sin(turned), np.cos(turned)], axis=1)
    train = seen("train", fast)
    assert raised(seen("validation", fast, step=1.4), train=train) == []
    assert raised(seen("validation", fast, step=1.6), train=train)


def test_single_steps_that_err_as_in_training_are_no_failure():
    poor = seen("train", step=1.0)
    assert raised(seen("validation", step=1.4), train=poor) == []
    (reason,) = raised(seen("validation", step=2.2), train=poor)
    assert "err by 1.96 A on this recording, which was not trained on, and by 1 A in" in reason


# --- where training has not been --------------------------------------------------------------


def test_a_free_run_beyond_the_excited_region_is_excused_unless_steps_inside_fail():
    far = 3 * SWING
    far[:400] /= 3  # begins inside
    assert raised(seen("validation", far, free=np.inf)) == []
    assert raised(seen("validation", far, free=np.inf, step=0.5))


def test_steps_beyond_the_excited_region_are_excused():
    assert raised(seen("validation", 3 * SWING, step=50.0)) == []


# --- stretches and units ----------------------------------------------------------------------


def test_stretches_are_judged_together():
    """One of ten is at rest; another that fails alone is a small part of the whole."""
    size = [0.01] * 9
    parts = [
        seen("validation", SWING * (k > 0), free=free, name=f"part {k}", recording="run.csv")
        for k, free in enumerate([2.6, *size])
    ]
    assert raised(*parts) == []
    parts = [seen("validation", free=2.6, name=f"{k}", recording="run.csv") for k in range(4)]
    (reason,) = raised(*parts)
    assert reason.startswith("4 stretches of run.csv: ")


def test_a_state_at_rest_beside_another_of_its_unit_is_measured_by_that():
    lame = SWING * [1e-3, 1.0]
    train = seen("train", lame, free=1e-3)
    assert raised(seen("validation", lame, free=0.4), train=train) == []
    assert raised(seen("validation", lame, free=0.6), train=train)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200, -1e300])
def test_predictions_that_are_no_numbers_raise_no_warning(value):
    run = seen("validation")
    run.one_step[700, 0] = value
    assert isinstance(raised(run), list)
    run.free_run[700:] = value
    assert raised(run)
