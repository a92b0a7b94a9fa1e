"""The knee of an inverter's voltage: its kind, width and phases from the recording."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from validate.sampled_drive.kinds import draw

from penode.arrays import float64
from penode.bench.drive import Drive
from penode.bench.inverter import DeviceDrop, Inverter
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.load import load
from penode.pmsm.balance.calibration_fit import calibration_of
from penode.pmsm.balance.doubt import Doubt, probability
from penode.pmsm.balance.knee import _Search, spread_over_knees, with_knee
from penode.pmsm.balance.term_evidence import judged
from penode.pmsm.machine.dead_time import TAILS, DeadTime, PhaseDeadTime
from penode.pmsm.machine.term_registry import physical_values
from penode.pmsm.recording.imperfections import Accuracy
from penode.pmsm.study import identify
from penode.pmsm.study_settings import Study

VOLTAGES = ("u_d", "u_q")


def behind(devices):
    """Return 0.5 s at 600 rpm behind an inverter with these devices, noise 0.05 A."""
    drive = Drive(current_noise=0.05, inverter=Inverter(devices=devices))
    reference = Lissajous(240.0, 50.0, 43.0)
    return simulate(TRACTION_300A, reference, speed_rpm=600.0, duration=0.5, drive=drive, seed=5)


def knee(term, current):
    """Return a knee in units of its voltage at phase currents in A."""
    x, s = current / float(term.dead_time_current), float(term.dead_time_softness or 0.0)
    sign, _ = TAILS[term.dead_time_tail]
    with float64():
        return (1 - s) * np.tanh(x) + s * np.asarray(sign(jnp.asarray(x)))


@pytest.fixture(scope="module")
def soft_run():
    return behind(DeviceDrop(1.0, current_scale=8.0, phase_factors=(1.0, 1.15, 0.9), soft=True))


@pytest.fixture(scope="module")
def sharp_run():
    return behind(DeviceDrop(3.0, current_scale=8.0))


def test_a_soft_knee_whose_phases_differ(soft_run):
    term = with_knee([soft_run], ()).term
    assert isinstance(term, PhaseDeadTime)
    assert 0.4 < float(term.dead_time_softness) <= 1.0  # training refines it
    current = np.linspace(-240.0, 240.0, 97)
    true = 2 / np.pi * np.arctan(current / 8.0)
    np.testing.assert_allclose(knee(term, current), true, atol=0.03)
    found = np.array([*physical_values((term,)).values()])
    np.testing.assert_allclose(found, [1.0, 1.15, 0.9], rtol=0.05)
    shares = np.array([1.0, 1.15, 0.9]) / 3.05
    np.testing.assert_allclose(found / found.sum(), shares, rtol=0.01)


def test_a_sharp_knee_whose_phases_agree(sharp_run):
    shaped = with_knee([sharp_run], ())
    term = shaped.term
    assert isinstance(term, DeadTime)
    assert term.dead_time_softness is None
    for doubt in shaped.doubts:
        assert doubt.weight < np.sqrt(0.5)
    assert float(term.dead_time_current) == pytest.approx(8.0, rel=0.35)
    assert float(term.dead_time_voltage) == pytest.approx(3.0, rel=0.03)
    assert isinstance(with_knee([sharp_run], (), by_phase=True).term, PhaseDeadTime)


def test_a_tail_that_cannot_be_excluded_is_trained_or_in_doubt():
    """Of 1 V a tail is more than a tenth as likely as a tanh, of 1.6 V less; R differs by 3 %."""
    trained = with_knee([behind(DeviceDrop(1.0, current_scale=8.0))], ())
    assert 0.05 < float(trained.term.dead_time_softness) < 0.3
    assert max(doubt.weight**2 for doubt in trained.doubts) == pytest.approx(0.5, abs=0.1)
    shaped = with_knee([behind(DeviceDrop(1.6, current_scale=8.0))], ())
    doubt, *_ = shaped.doubts
    assert shaped.term.dead_time_softness is None
    assert float(doubt.term.dead_time_softness) > 0.01
    assert 0.01 < doubt.weight**2 < 0.1


def test_another_tail_without_softness_is_in_doubt_as_a_whole(monkeypatch):
    """Of a knee that is sharp by either tail, half a doubt would be none: both are one shape."""
    run, best = behind(DeviceDrop(0.5, current_scale=8.0)), _Search.best

    def without_softness(search):
        sharp, *tails = best(search)
        for k in (0, 2):
            tails[k] = replace(tails[k], term=replace(tails[k].term, dead_time_softness=0.0))
        return sharp, *tails

    monkeypatch.setattr(_Search, "best", without_softness)
    monkeypatch.setattr(_Search, "share", lambda *_: 0.5)
    shaped = with_knee([run], ())
    assert shaped.term.dead_time_softness is not None
    doubt = next(one for one in shaped.doubts if one.term.junction_voltage is None)
    assert doubt.term.dead_time_tail != shaped.term.dead_time_tail
    assert doubt.term.dead_time_softness > 0
    moved = doubt.applied(run, 1.0).stack(VOLTAGES) - run.stack(VOLTAGES)
    assert np.abs(moved).max() > 1e-3


@pytest.mark.slow
def test_nodes_that_the_current_recharges(tmp_path):
    """Of another plant, beside junctions of 0.84 V."""
    drawn = draw("dead time", 2)
    run = load(*drawn.write(tmp_path, "log"))
    placed = calibration_of([run], (DeadTime(),))
    term = with_knee([placed.acting(placed.applied(run))], ()).term
    assert term.dead_time_tail == "node"
    assert float(term.dead_time_softness) > 0.95
    assert float(term.dead_time_current) == pytest.approx(0.02 * drawn.machine.rated_current, 0.05)
    drop = 3e-3 * drawn.machine.rated_voltage / 16
    assert float(term.junction_voltage) == pytest.approx(drop, rel=0.1)


@pytest.mark.slow
def test_junctions_in_a_drive_of_20_volts(tmp_path):
    """Of 0.7 V, another plant's; a knee alone makes R a tenth too large."""
    drawn = draw("junctions at 20 V", 2)
    run = load(*drawn.write(tmp_path, "log"))
    found = judged([run], (), DeadTime())
    assert found.term.junction_voltage == pytest.approx(0.7 / 16, rel=0.25)
    assert found.balance.resistance == pytest.approx(drawn.truth["R"], rel=0.03)
    assert "the drop of junctions rises by" in found.reason
    assert {doubt.source for doubt in found.doubts} == {"tail of the knee"}
    assert found.doubts[-1].term.junction_folds == 20.0
    plain = judged([run], (), DeadTime(dead_time_current=0.56, dead_time_softness=1.0))
    assert plain.balance.resistance > 1.05 * drawn.truth["R"]


def test_the_knee_frees_the_resistance_of_its_bias(soft_run):
    """A sharp knee of the same width makes R of 10 mohm 4 % too large."""
    right = judged([soft_run], (), DeadTime())
    wrong = judged([soft_run], (), DeadTime(dead_time_current=8.0))
    assert abs(right.balance.resistance / TRACTION_300A.resistance - 1) < 0.02
    assert wrong.balance.resistance / TRACTION_300A.resistance - 1 > 0.03
    assert "Its knee, where the current changes sign, is soft" in right.reason
    assert "proportion to the current is in R" in right.reason


@pytest.mark.slow
def test_training_finds_knee_phases_and_resistance(soft_run):
    study = Study(horizon=2, angle_orders=(6, 12), accuracy=Accuracy.exact())
    fit = identify([soft_run], study=study)
    assert fit.parameters["R"].value == pytest.approx(TRACTION_300A.resistance, rel=5e-3)
    for phase, voltage in zip("abc", (1.0, 1.15, 0.9), strict=True):
        found = fit.parameters[f"dead_time_voltage_{phase}"]
        assert found.value == pytest.approx(voltage, rel=5e-3)
    low, high = fit.parameters["R"].interval_95
    assert low < TRACTION_300A.resistance < high
    (dead,) = (term for term in fit.model.terms if isinstance(term, PhaseDeadTime))
    assert float(dead.dead_time_current) == pytest.approx(8.0, rel=0.1)
    assert float(dead.dead_time_softness) == pytest.approx(1.0, abs=0.15)


def test_what_the_balance_owes_to_its_knee(soft_run):
    """It is no more than what ends of the family differ by, and nothing without a dead time."""
    spread = spread_over_knees([soft_run], True, (DeadTime(dead_time_current=8.0),))
    assert 0.03 < spread["R"] / TRACTION_300A.resistance < 0.1
    assert spread_over_knees([soft_run], True, ()) == {}


def test_a_doubt_takes_the_voltage_of_its_term_off_the_recording(sharp_run):
    """Half probable: its root mean square over acting and not acting is 0.707 of it."""
    term, other = DeadTime(2.0, 5.0), DeadTime(1.0, 5.0)
    doubt = Doubt("dead time", "Record longer.", term, None, np.sqrt(0.5))
    assert doubt.imperfection.accuracy == "left out, 50 % probable"
    assert replace(doubt, instead=other).imperfection.accuracy == "another shape, 50 % probable"
    change = doubt.applied(sharp_run, 1.0).stack(VOLTAGES) - sharp_run.stack(VOLTAGES)
    current = sharp_run.stack(("i_d", "i_q"))
    along = np.sum(change * current, axis=1) / np.hypot(*current.T)
    large = np.hypot(*current.T) > 100.0
    assert along[large].mean() == pytest.approx(-4 / np.pi * 2.0 * np.sqrt(0.5), rel=0.01)
    instead = Doubt("dead time", "Record longer.", term, other, np.sqrt(0.5))
    half = instead.applied(sharp_run, 1.0).stack(VOLTAGES) - sharp_run.stack(VOLTAGES)
    np.testing.assert_allclose(half, 0.5 * change, atol=1e-12)


def test_probability_of_a_parameter():
    """Of 1000 equations an estimate at its deviation speaks against it, at five for it."""
    assert probability(0.0, 1e4) == pytest.approx(1 / 101)
    assert probability(np.sqrt(2 * np.log(100)), 1e4) == pytest.approx(0.5)
    assert probability(1.0, 1000.0) < 0.06
    assert probability(5.0, 1000.0) > 0.999
    assert probability(-5.0, 1000.0) == probability(5.0, 1000.0)
    assert probability(1e9, 1000.0) == pytest.approx(1.0)


def test_what_speaks_for_a_term_that_is_left_out_stays_as_a_doubt(slow_run):
    left_out = judged([slow_run], (), DeadTime())
    assert left_out.term is None
    (doubt,) = left_out.doubts
    assert doubt.source == "dead time"
    assert 0.1 < doubt.weight < np.sqrt(0.5)
    assert doubt.applied(slow_run, 1.0).channels.keys() == slow_run.channels.keys()
