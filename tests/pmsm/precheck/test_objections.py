"""Each objection is raised by what it is about, and by nothing that a good fit shows."""

from dataclasses import replace

import numpy as np
import pytest

from penode import Experiment
from penode.fit.fit import Estimate, HorizonChoice, HorizonSummary
from penode.fit.outcome import Contribution, Objection
from penode.horizon.objections import CHECKS, few_samples_decide, objections, with_objections
from penode.pmsm.conventions.check import check_conventions, judge
from penode.pmsm.machine.frames import abc_from_dq
from penode.pmsm.machine.holds import turned_voltage
from penode.pmsm.precheck.objections import (
    machine_checks,
    per_unit,
    uncertain_resistance,
    voltage_limit,
)
from penode.pmsm.recording.name_plate import NamePlate
from penode.pmsm.recording_check import check_recordings
from penode.validation.comparison import Comparison

COUNT, STEP = 4000, 1e-4


def summary(horizon, deviation):
    return HorizonSummary(horizon, {"R": 0.01}, {"R": deviation}, 0.1, 0.1, 2, "Done.")


@pytest.fixture
def run(rng):
    """Return a recording in which currents swing, and the voltages that R and L explain."""
    time = STEP * np.arange(COUNT)
    i_d, i_q = 100 * np.sin(90 * time), 100 * np.sin(95 * time + 1)
    u_d, u_q = 2 * i_d + rng.normal(size=COUNT), i_q + 20 + rng.normal(size=COUNT)
    channels = {"i_d": i_d, "i_q": i_q, "u_d": u_d, "u_q": u_q, "omega_el": np.full(COUNT, 600.0)}
    return Experiment("run.csv", STEP, channels)


@pytest.fixture
def fit(machine_fit, run, rng):
    """Return a fit with small, white errors."""
    measured = run.stack(("i_d", "i_q"))
    one_step, free_run = (measured + s * rng.normal(size=measured.shape) for s in (0.1, 0.3))
    names, units = ("i_d", "i_q"), ("A", "A")
    comparison = Comparison("run.csv", "train", STEP, names, units, measured, one_step, free_run)
    ladder = tuple(summary(h, 1e-4) for h in (1, 8, 50))
    choice = HorizonChoice(50, "plateau", "Horizons agree.", ladder, (1, 8, 50))
    return replace(machine_fit, horizon=choice, comparisons=(comparison,))


def comparing(fit, **changed):
    return replace(fit, comparisons=(replace(fit.comparisons[0], **changed),))


def names(fit, run, checks=CHECKS):
    return [found.name for found in objections(fit, [run], checks)]


def test_nothing_speaks_against_a_good_fit(fit, run):
    assert names(fit, run, (*CHECKS, per_unit, voltage_limit)) == []
    assert with_objections(fit, ()) is fit


@pytest.mark.parametrize(
    ("estimate", "name", "verdict"),
    [
        ((-0.002, -0.003, -0.001), "impossible value", "implausible"),
        ((0.01, -np.inf, np.inf), "impossible value", "implausible"),
        ((0.01, -0.001, 0.021), "not determined", "not identifiable"),
    ],
)
def test_a_resistance_that_may_not_be_positive(fit, run, estimate, name, verdict):
    value, low, high = estimate
    wrong = replace(fit, parameters={"R": Estimate(value, 1e-3, (low, high), "ohm")})
    assert names(wrong, run) == [name]
    judged = with_objections(wrong, list(objections(wrong, [run], CHECKS)))
    assert judged.horizon.verdict == verdict
    assert judged.horizon.reason.startswith(f"{name.capitalize()}: R ")


def test_what_is_wrong_goes_before_what_is_not_determined(fit):
    raised = [
        Objection("wide", "A.", "B.", "not identifiable"),
        Objection("wrong", "C.", "D."),
    ]
    judged = with_objections(fit, raised)
    assert judged.horizon.verdict == "implausible"
    assert judged.horizon.reason == "Wrong: C. D."
    assert judged.warnings[0] == "Wide: A. B."


def test_a_free_run_that_diverges_or_leaves_the_measured_states(fit, run):
    comparison = fit.comparisons[0]
    diverged = comparison.free_run.copy()
    diverged[100:] = np.nan
    assert names(comparing(fit, free_run=diverged), run) == ["free run fails"]
    astray = comparison.free_run + 0.6 * comparison.measured
    assert names(comparing(fit, free_run=astray), run) == ["free run fails"]


def test_channels_that_explain_nothing(fit, run, rng):
    noise = 100 * rng.normal(size=(COUNT, 2))
    still = np.zeros_like(noise)
    found = names(comparing(fit, measured=noise, one_step=still, free_run=still), run)
    assert found == ["nothing explained"]


def test_a_state_of_noise_beside_one_that_is_explained_is_no_objection(fit, run, rng):
    """As i_d of a recording along the q axis."""
    comparison = fit.comparisons[0]
    changed = {
        name: np.column_stack([0.1 * rng.normal(size=COUNT), getattr(comparison, name)[:, 1]])
        for name in ("measured", "one_step", "free_run")
    }
    assert names(comparing(fit, **changed), run) == []


def test_few_samples_that_decide_are_named_with_row_and_channel(fit, run):
    measured = fit.comparisons[0].measured.copy()
    measured[1234, 1] = 900.0
    (found,) = objections(comparing(fit, measured=measured), [run], CHECKS)
    assert found.name == "outliers"
    assert "channel i_q at data row 1235" in found.reason


def test_a_residual_that_follows_an_input(fit, run):
    comparison = fit.comparisons[0]
    one_step = comparison.measured + 0.01 * run.stack(("u_d", "u_q"))
    free_run = comparison.measured + 20.0 * np.sin(np.arange(COUNT))[:, None]
    (first, *_) = objections(comparing(fit, one_step=one_step, free_run=free_run), [run], CHECKS)
    assert first.name == "dependent residual"


def test_errors_at_the_largest_voltages(fit, run):
    voltage = np.hypot(*run.stack(("u_d", "u_q")).T)
    high = np.roll(voltage > np.quantile(voltage, 0.9), 1)[:, None]
    one_step = fit.comparisons[0].measured + np.where(high, 1.0, 0.1) * np.array([1.0, -1.0])
    compared = comparing(fit, one_step=one_step)
    (found,) = objections(compared, [run], (voltage_limit,))
    assert found.name == "voltage limit"
    assert "Record u_dc beside" in found.repair
    linked = replace(run, channels={**run.channels, "u_dc": np.full(len(run), 600.0)})
    (found,) = objections(compared, [linked], (voltage_limit,))
    assert found.repair.startswith("Record the voltage behind the limiter")


def test_one_spike_at_a_large_voltage_is_no_limiter(fit, run):
    voltage = np.hypot(run.channels["u_d"], run.channels["u_q"])
    one_step = fit.comparisons[0].one_step.copy()
    one_step[1 + np.argmax(voltage)] += 1e4
    assert names(comparing(fit, one_step=one_step), run, (few_samples_decide,)) == ["outliers"]
    assert names(comparing(fit, one_step=one_step), run, (voltage_limit,)) == []


def test_per_unit(fit, run):
    channels = dict(run.channels)
    small = {n: c / 100 for n, c in channels.items() if n != "omega_el"}
    scaled = replace(run, channels={**channels, **small})
    assert names(fit, scaled, (per_unit,)) == ["per unit"]
    (objection,) = per_unit(fit, [scaled])
    assert "u_base and i_base, what 1 is in V and A" in objection.repair


def and_at_rest(run):
    """Return a recording in two stretches, the second a thousandth of the first."""
    quiet = replace(run, channels={n: 1e-3 * v for n, v in run.channels.items()})
    return [one.between(0, COUNT) for one in (run, quiet)]


def test_a_stretch_at_rest_is_not_taken_for_per_unit(fit, run):
    stretches = and_at_rest(run)
    assert list(per_unit(fit, stretches)) == []
    (found,) = per_unit(fit, [stretches[1], stretches[1]])
    assert found.reason.startswith("run.csv: ")


def test_errors_at_the_largest_voltages_are_those_of_the_whole_recording(fit, run, rng):
    """The stretch at rest errs at its own largest voltages, which are small ones."""
    stretches, seen = and_at_rest(run), fit.comparisons[0]
    own = np.hypot(*stretches[1].stack(("u_d", "u_q")).T)
    high = np.roll(own > np.quantile(own, 0.9), 1)[:, None]
    measured = stretches[1].stack(("i_d", "i_q"))
    ahead = measured + np.where(high, 0.1, 0.01) * np.array([1.0, -1.0])
    alone = replace(seen, measured=measured, one_step=ahead, recording="run.csv")
    whole = replace(fit, comparisons=(replace(seen, recording="run.csv"), alone))
    assert objections(whole, stretches, (voltage_limit,)) == ()
    by_itself = replace(fit, comparisons=(alone,))
    assert len(objections(by_itself, stretches[1:], (voltage_limit,))) == 1


def test_a_convention_that_the_recording_breaks(fit, slow_run):
    u_d, u_q = (np.roll(slow_run.channels[n], 3) for n in ("u_d", "u_q"))
    late = replace(slow_run, channels={**slow_run.channels, "u_d": u_d, "u_q": u_q})
    assert names(fit, slow_run, machine_checks(check_conventions(slow_run).broken)[:1]) == []
    (found,) = objections(fit, [late], machine_checks(check_conventions(late).broken)[:1])
    assert found.name == "delay of 3 samples"


@pytest.mark.parametrize(("share", "objected"), [(0.7, True), (0.9, False), (1.4, True)])
def test_a_name_plate_is_contradicted_where_the_whole_interval_lies_elsewhere(
    fit, slow_run, share, objected
):
    resistance = fit.parameters["R"]
    plate = NamePlate(resistance=resistance.value / share)
    check, other = (machine_checks(plate=one)[-2] for one in (plate, NamePlate(0.1)))
    assert (names(fit, slow_run, [check]) == ["name plate"]) is objected
    unsure = replace(resistance, interval_95=(0.0, 9.0 * resistance.value))
    assert names(replace(fit, parameters={"R": unsure}), slow_run, [check]) == []
    assert names(fit, slow_run, [other]) == []


def test_a_recording_that_is_not_predicted_is_compared_with_those_trained_on(fit, slow_run):
    """One of warmer magnets here; where it is predicted nothing is said of it."""
    speed = slow_run.channels["omega_el"]
    weaker = {**slow_run.channels, "u_q": slow_run.channels["u_q"] - 0.005 * speed}
    other = replace(slow_run, name="other.csv", channels=weaker)
    check = machine_checks(unseen=[other])[-1]
    free_run = fit.comparisons[0].measured + 80.0
    failing = replace(fit.comparisons[0], name="other.csv", role="validation", free_run=free_run)
    unlike = replace(fit, comparisons=(*fit.comparisons, failing))
    assert len(list(check(unlike, [slow_run, replace(other, name="trained.csv")]))) == 1
    (found,) = check(unlike, [slow_run])
    assert found.name == "recordings that disagree"
    assert found.reason.startswith("other.csv: R is ")
    assert found.repair.startswith("Identify them one by one")
    assert list(check(fit, [slow_run])) == []


def test_conventions_are_tested_where_the_voltage_acts(slow_run):
    """At 6000 rpm half a sample's turn looks like an angle with an offset of more than 5 deg."""
    fast = turned_voltage(slow_run, 2.0)  # as half a sample does at four times the speed
    assert [b.name for b in check_conventions(fast).broken] == ["offset angle"]
    found, calibration = judge([fast])
    assert found.broken == ()
    assert calibration["turn"] == pytest.approx(-2.0, abs=0.05)


def in_phases(run, kinds):
    """Return a recording with phase channels in place of those in dq."""
    channels = dict(run.channels)
    for kind in kinds:
        dq = np.stack([channels.pop(f"{kind}_{axis}") for axis in "dq"], axis=-1)
        phases = abc_from_dq(dq, run.channels["theta_el"]).T
        channels |= {f"{kind}_{name}": row for name, row in zip("abc", phases, strict=True)}
    return replace(run, channels=channels)


def test_a_recording_that_cannot_be_mapped_has_its_convention_named(slow_run):
    """In degrees, the angle turns too fast for a speed to be made of it."""
    run = in_phases(slow_run, "ui")
    wrong = {**run.channels, "theta_el": np.degrees(run.channels["theta_el"])}
    del wrong["omega_el"]
    checked = check_recordings([replace(run, channels=wrong)])
    assert "degrees" in checked.broken[0].name
    assert not checked.drives


def test_phases_that_dq_was_made_from_are_no_second_measurement(slow_run):
    found, _ = judge([in_phases(turned_voltage(slow_run, 0.5), "u")], hold="stationary")
    assert any("Values are taken as peak" in sentence for sentence in found.undetermined)


@pytest.mark.parametrize("verdict", ["plateau", "fixed", "H = 1 suffices", "predicts best"])
def test_an_objection_turns_the_verdict(fit, verdict):
    both = [Objection(n, f"The {n} is wrong.", "Mend it.") for n in ("first", "second")]
    said = with_objections(replace(fit, horizon=replace(fit.horizon, verdict=verdict)), both)
    assert said.horizon.verdict == "implausible"
    assert not said.horizon.answered
    assert said.horizon.reason == "First: The first is wrong. Mend it."
    assert said.warnings[0] == "Second: The second is wrong. Mend it."
    assert [one["name"] for one in said.result()["horizon"]["objections"]] == ["first", "second"]


@pytest.mark.parametrize("verdict", ["no plateau", "not identifiable", "stopped"])
def test_a_verdict_without_an_answer_stays_and_the_objection_is_a_warning(fit, verdict):
    before = replace(fit, horizon=replace(fit.horizon, verdict=verdict))
    said = with_objections(before, [Objection("first", "It is wrong.", "Mend it.")])
    assert said.horizon.verdict == verdict
    assert said.warnings[0].startswith("First: It is wrong.")


def with_resistance(fit, deviation, verdict="plateau"):
    rows = (
        Contribution("tail of the knee", deviation, remedy="The inverter's data sheet."),
        Contribution("statistics", 1e-5, remedy="Record longer."),
    )
    estimate = Estimate.of(0.01, deviation, "ohm", budget=rows)
    horizon = replace(fit.horizon, verdict=verdict)
    return replace(fit, parameters={**fit.parameters, "R": estimate}, horizon=horizon)


def test_a_resistance_that_nobody_could_use_is_no_answer(fit):
    said = uncertain_resistance(with_resistance(fit, 0.052 * 0.01)).horizon
    assert (said.verdict, said.answered) == ("not identifiable", False)
    assert "± 1.0\N{NO-BREAK SPACE}mΩ only, more than 10 % of its value" in said.reason
    assert said.reason.endswith("tail of the knee. The inverter's data sheet.")


@pytest.mark.parametrize(
    ("deviation", "verdict"),
    [(0.05 * 0.01, "plateau"), (1.0, "fixed"), (1.0, "no plateau"), (1.0, "implausible")],
)
def test_any_other_verdict_on_the_resistance_stays(fit, deviation, verdict):
    before = with_resistance(fit, deviation, verdict)
    assert uncertain_resistance(before) is before
