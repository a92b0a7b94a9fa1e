"""Every check of a fit: a good one raises nothing, and damaged predictions only objections.

No check raises an exception or a NumPy warning, whatever predictions hold.
"""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from penode import Experiment
from penode.fit.outcome import Objection
from penode.horizon.objections import CHECKS, objections, with_objections
from penode.pmsm.precheck.objections import machine_checks
from penode.validation.comparison import Comparison

STEP, COUNT = 1e-4, 4000


@pytest.fixture(scope="module")
def machine_run():
    """A recording whose currents swing, with the voltages that R and L explain."""
    time, random = STEP * np.arange(COUNT), np.random.default_rng(3)
    speed = 600.0
    i_d, i_q = 100 * np.sin(90 * time), 100 * np.sin(95 * time + 1)
    L, R, psi = 1e-3, 0.1, 0.05
    u_d = R * i_d + L * np.gradient(i_d, STEP) - speed * L * i_q
    u_q = R * i_q + L * np.gradient(i_q, STEP) + speed * (L * i_d + psi)
    i_d, i_q = (one + 0.05 * random.normal(size=COUNT) for one in (i_d, i_q))
    channels = {"i_d": i_d, "i_q": i_q, "u_d": u_d, "u_q": u_q, "omega_el": np.full(COUNT, speed)}
    return Experiment("run.csv", STEP, channels)


@pytest.fixture(scope="module")
def machine(machine_fit, machine_run):
    """A machine's fit with small, white errors."""
    measured, random = machine_run.stack(("i_d", "i_q")), np.random.default_rng(4)
    parts = (measured + size * random.normal(size=measured.shape) for size in (0.1, 0.3))
    names, units = ("i_d", "i_q"), ("A", "A")
    seen = Comparison("run.csv", "train", STEP, names, units, measured, *parts)
    return replace(machine_fit, comparisons=(seen,))


@pytest.fixture(scope="module", params=["any model", "machine"])
def examined(request):
    """Return a fit, the recording behind it, and every check that its kind has."""
    if request.param == "machine":
        fit, run = (request.getfixturevalue(name) for name in ("machine", "machine_run"))
        return fit, run, (*CHECKS, *machine_checks([]))
    observed = request.getfixturevalue("oscillator")
    return observed.fit, observed.recording, CHECKS


def examine(fit, run, checks):
    """Return what all checks raise; a warning is an error here."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return objections(fit, [run], checks)


def constant(values):
    return np.full_like(values, values[0, 0])


def with_one(value):
    def changed(values):
        values = values.copy()
        values[len(values) // 2, 0] = value
        return values

    return changed


def diverging(values):
    grown = values * np.exp(np.minimum(np.arange(len(values)), 700))[:, None]
    grown[-1] = np.inf
    return grown


#: What happens to a prediction: measured -> predicted.
DAMAGES = {
    "exact": lambda measured: measured.copy(),
    "constant": constant,
    "zero": np.zeros_like,
    "one nan": with_one(np.nan),
    "one infinite": with_one(-np.inf),
    "one huge": with_one(1e200),
    "all nan": lambda measured: np.full_like(measured, np.nan),
    "diverging": diverging,
}


def test_a_good_fit_raises_nothing(examined):
    fit, run, checks = examined
    assert examine(fit, run, checks) == ()
    assert with_objections(fit, ()) is fit


@pytest.mark.parametrize("part", ["one_step", "free_run"])
@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_predictions_raise_objections_at_most(examined, damage, part):
    fit, run, checks = examined
    seen = next(one for one in fit.comparisons if one.role == "train")
    damaged = replace(seen, **{part: DAMAGES[damage](seen.measured)})
    raised = examine(replace(fit, comparisons=(damaged,)), run, checks)
    for one in raised:
        assert isinstance(one, Objection)
        assert "nan" not in f"{one.reason} {one.repair}".lower().split()
    if damage in ("all nan", "diverging", "zero", "constant") and part == "free_run":
        assert raised
    if damage == "exact":
        assert raised == ()


@pytest.mark.parametrize("state", [0, 1])
def test_a_channel_that_never_moves_raises_no_warning(examined, state):
    fit, run, checks = examined
    seen = next(one for one in fit.comparisons if one.role == "train")
    parts = {}
    for name in ("measured", "one_step", "free_run"):
        parts[name] = getattr(seen, name).copy()
        parts[name][:, state] = 0.0
    still = {
        seen.states[state]: np.zeros(len(run)),
        **dict.fromkeys(fit.model.inputs, run.channels[fit.model.inputs[0]] * 0.0),
    }
    quiet = replace(run, channels={**run.channels, **still})
    raised = examine(replace(fit, comparisons=(replace(seen, **parts),)), quiet, checks)
    assert all(isinstance(one, Objection) for one in raised)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 0.0])
def test_estimates_that_are_no_numbers_raise_no_warning(examined, value):
    fit, run, checks = examined
    estimates = {
        name: replace(one, value=value, std=value, interval_95=(value, value))
        for name, one in fit.parameters.items()
    }
    raised = examine(replace(fit, parameters=estimates), run, checks)
    assert all(isinstance(one, Objection) for one in raised)


def test_every_objection_turns_a_verdict_and_is_told_once(examined):
    fit, _, _ = examined
    raised = (Objection("first", "It is so.", "Do this."), Objection("second", "And so.", "That."))
    judged = with_objections(fit, raised)
    assert judged.horizon.verdict == "implausible"
    assert judged.horizon.reason == "First: It is so. Do this."
    assert judged.warnings[0] == "Second: And so. That."
