"""How much it takes for an objection: thresholds from both sides, by signals made to measure."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from penode import Experiment
from penode.data.experiment import Stretch
from penode.horizon.objections import (
    dependent_residual,
    few_samples_decide,
    impossible_values,
    trained_on,
    unexplained,
)
from penode.validation.comparison import Comparison

COUNT = 2001
WAVE = np.sqrt(2) * np.sin(2 * np.pi * np.arange(COUNT) / 29)  # deviation 1, whole periods


def alternating(*sizes):
    """Return errors of exactly these root mean squares that no channel explains."""
    return np.outer((-1.0) ** np.arange(COUNT), sizes)


def fitted(one_step=None, free_run=None, measured=None, role="train"):
    """Return a fit of two states that move by 1; what is given are the errors of its runs."""
    measured = np.column_stack([WAVE, np.roll(WAVE, 7)]) if measured is None else measured
    step, free = (alternating(1e-3, 1e-3) if e is None else e for e in (one_step, free_run))
    names, units = ("x", "v"), ("m", "m/s")
    parts = (measured, measured - step, measured - free)
    seen = Comparison("run.csv", role, 1e-3, names, units, *parts)
    model, horizon = SimpleNamespace(inputs=("u",)), SimpleNamespace(ladder=())
    return SimpleNamespace(comparisons=(seen,), model=model, horizon=horizon)


def recorded(fit, **inputs):
    states = dict(zip(("x", "v"), fit.comparisons[0].measured.T, strict=True))
    return [Experiment("run.csv", 1e-3, {**states, "u": np.roll(WAVE, 3), **inputs})]


def found(check, fit, **inputs):
    return [one.name for one in check(fit, recorded(fit, **inputs))]


def test_recordings_that_were_not_trained_on_are_not_judged():
    unseen = fitted(role="validation")
    assert list(trained_on(unseen, [])) == []
    with pytest.raises(ValueError, match="longer"):
        list(trained_on(unseen, recorded(unseen)))


# --- free runs --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("free", "ahead", "raised"),
    [
        ((0.49, 0.49), (1e-3, 1e-3), []),
        ((0.51, 0.49), (1e-3, 1e-3), ["free run fails"]),
        ((0.51, 0.49), (0.052, 0.052), []),  # as far as ten steps: nobody could do better
        ((0.51, 0.51), (0.052, 0.052), ["nothing explained"]),
        ((0.51, 0.51), (0.052, 0.049), ["free run fails"]),
    ],
)
def test_a_free_run_may_err_by_half_of_what_a_state_moves(free, ahead, raised):
    fit = fitted(one_step=alternating(*ahead), free_run=alternating(*free))
    assert found(unexplained, fit) == raised


def test_only_the_states_that_fail_are_named():
    """Of x single steps are as bad, for which the free run cannot be blamed."""
    fit = fitted(one_step=alternating(0.2, 1e-3), free_run=alternating(0.6, 0.6))
    (one,) = unexplained(fit, recorded(fit))
    assert "the free run of v errs" in one.reason


# --- isolated samples -------------------------------------------------------------------------


def with_outliers(far, typical, rows=(1500,), quiet=0):
    """Return errors of one typical size with large ones in x, the first few rows without any."""
    # The typical error is the median over 0.6745, so that it is the deviation of normal noise.
    errors = 0.6745 * alternating(typical, typical)
    errors[:quiet] = 0.0
    errors[list(rows), 0] = far * typical
    return errors


@pytest.mark.parametrize(
    ("typical", "far", "raised"),
    [
        (4e-3, 50, ["outliers"]),
        (4e-3, 40, []),  # 1600 of 3420 squares, less than half
        (1.2e-3, 90, ["outliers"]),
        (1e-3, 90, []),  # less than a tenth of what the state moves
    ],
)
def test_an_outlier_decides_and_is_visible(typical, far, raised):
    fit = fitted(one_step=with_outliers(far, typical))
    assert found(few_samples_decide, fit) == raised


@pytest.mark.parametrize(("far", "raised"), [(32, ["outliers"]), (28, [])])
def test_an_outlier_is_thirty_typical_errors_away(far, raised):
    """Though two of them hold most of the squares, as half of the errors are none."""
    fit = fitted(one_step=with_outliers(far, 4e-3, (1400, 1500), quiet=980))
    assert found(few_samples_decide, fit) == raised


@pytest.mark.parametrize(("count", "raised"), [(2, ["outliers"]), (5, [])])
def test_few_are_one_sample_in_a_thousand(count, raised):
    rows = 100 * np.arange(1, count + 1)
    assert found(few_samples_decide, fitted(one_step=with_outliers(500, 1e-3, rows))) == raised


def test_a_short_recording_has_no_isolated_samples():
    fit = fitted(one_step=with_outliers(500, 1e-3, (500,)))
    seen = fit.comparisons[0]
    parts = [getattr(seen, name)[:1000] for name in ("measured", "one_step", "free_run")]
    short = Comparison("run.csv", "train", 1e-3, seen.states, seen.units, *parts)
    fit = SimpleNamespace(comparisons=(short,), model=fit.model, horizon=fit.horizon)
    assert list(few_samples_decide(fit, [None])) == []


# --- what explains a residual -----------------------------------------------------------------


def explained(share, channel, rng):
    """Return one-step errors of x of which a channel, one sample before, explains the share."""
    cause = channel[:-1] - channel[:-1].mean()
    rest = rng.normal(size=COUNT - 1)
    basis, _ = np.linalg.qr(np.column_stack([np.ones(COUNT - 1), cause, rest]))
    parts = np.sqrt(share) * basis[:, 1] + np.sqrt(1 - share) * basis[:, 2]
    errors = alternating(0.0, 1e-3)
    errors[1:, 0] = parts + 0.1  # a constant error is no matter of dependence
    return errors


@pytest.mark.parametrize(("share", "raised"), [(0.27, True), (0.23, False)])
@pytest.mark.parametrize("name", ["u", "time"])
def test_a_channel_may_explain_a_quarter_of_the_residual(share, raised, name, rng):
    white = rng.normal(size=COUNT)
    channel = {"u": white, "time": np.arange(COUNT)}[name]
    errors = explained(share, channel, rng)
    fit = fitted(one_step=errors, free_run=alternating(0.1, 0.1))
    told = list(dependent_residual(fit, recorded(fit, u=white)))
    assert len(told) == raised
    for one in told:
        assert f"{name} explains 27 % of the one-step residual of x." in one.reason


def test_a_residual_that_harms_no_free_run_is_no_objection(rng):
    channel = rng.normal(size=COUNT)
    errors = explained(0.9, channel, rng)
    for free, raised in ((0.051, ["dependent residual"]), (0.049, [])):
        fit = fitted(one_step=errors, free_run=alternating(free, free))
        assert found(dependent_residual, fit, u=channel) == raised


# --- values beyond their limits ---------------------------------------------------------------


@pytest.mark.parametrize(("low", "raised"), [(1e-9, 0), (0.0, 1)])
def test_a_value_is_shown_to_be_above_its_limit_by_its_whole_interval(systems, low, raised):
    estimate = SimpleNamespace(value=0.5, unit="ohm", interval_95=(low, 1.0))
    for name, limited in (("coenergy machine", True), ("linear machine", False)):
        fit = SimpleNamespace(model=systems[name].model, parameters={"R": estimate})
        assert len(list(impossible_values(fit, []))) == (raised and limited)


# --- recordings in stretches --------------------------------------------------------------------


def in_stretches(count=20, rest=(3,), free=0.1, one_step=0.01, measured=None, bad=()):
    """Return a fit of one recording in stretches, of which some are at rest but for noise."""
    rng = np.random.default_rng(4)
    seen, experiments = [], []
    for k in range(count):
        moving = np.column_stack([WAVE, np.roll(WAVE, 7)])
        states = 0.02 * rng.normal(size=moving.shape) if k in rest else moving
        step, run = alternating(one_step, one_step), alternating(free, free)
        run = run * (20.0 if k in bad else 1.0)
        seen.append(
            Comparison(
                f"run.csv part {k}", "train", 1e-3, ("x", "v"), ("m", "m/s"),
                states, states - step, states - run, "run.csv",
            )
        )  # fmt: skip
        channels = {"x": states[:, 0], "v": states[:, 1], "u": np.roll(states[:, 0], 3)}
        place = Stretch("run.csv", 3000 * k, 3.0 * k, 3.0 * count)
        experiments.append(Experiment(f"run.csv part {k}", 1e-3, channels, stretch=place))
    fit = SimpleNamespace(**{**vars(fitted()), "comparisons": tuple(seen)})
    return fit, experiments


@pytest.mark.parametrize("one_step", [0.1, 0.01])
def test_a_stretch_at_rest_is_no_cause_for_an_objection(one_step):
    """Its free run errs by five times what it moves, of all that the recording moves by a tenth."""
    fit, experiments = in_stretches(one_step=one_step)
    assert list(unexplained(fit, experiments)) == []


def test_a_stretch_whose_free_run_fails_is_named_once():
    fit, experiments = in_stretches(bad=(7, 11))
    (one,) = unexplained(fit, experiments)
    assert one.name == "free run fails"
    assert one.reason.startswith("run.csv part 7: the free run of x, v errs")


def test_every_recording_is_judged_by_itself():
    fit, experiments = in_stretches(rest=())
    quiet, still = in_stretches(count=1, rest=(0,))
    parts = (*fit.comparisons, replace(quiet.comparisons[0], recording="quiet.csv", name="quiet"))
    both = SimpleNamespace(comparisons=parts, model=fit.model, horizon=fit.horizon)
    still = [replace(one, stretch=replace(one.stretch, recording="quiet.csv")) for one in still]
    (one,) = unexplained(both, [*experiments, *still])
    assert one.reason.startswith("quiet: ")


def test_an_outlier_in_a_stretch_is_named_by_its_row_in_the_file():
    fit, experiments = in_stretches(count=4, one_step=1e-3)
    fit.comparisons[2].one_step[501, 1] += 50.0
    (one,) = few_samples_decide(fit, experiments)
    assert "channel v at data row 6502." in one.reason
    assert one.reason.startswith("4 stretches of run.csv: ")


def test_a_residual_is_explained_over_a_whole_recording_or_not_at_all(rng):
    """In one stretch of twenty the input explains half of it, in all together a fortieth."""
    fit, experiments = in_stretches(rest=())
    for k, (seen, run) in enumerate(zip(fit.comparisons, experiments, strict=True)):
        noise = 0.1 * rng.normal(size=seen.measured.shape)
        noise[1:, 0] += 0.1 * run.channels["u"][:-1] * (k == 3)
        seen.one_step[:] = seen.measured - noise
    assert list(dependent_residual(fit, experiments)) == []
    for seen, run in zip(fit.comparisons, experiments, strict=True):
        seen.one_step[1:, 0] -= 0.1 * run.channels["u"][:-1]
    assert [one.name for one in dependent_residual(fit, experiments)] == ["dependent residual"]
