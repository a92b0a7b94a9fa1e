"""What the balance leaves over as a function of the currents: planted, and not there."""

from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest

from penode.bench.drive import Drive
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.bench.sensors import CurrentSensors
from penode.horizon.consensus import LEFT_OUT
from penode.pmsm.balance.calibration import AS_RECORDED
from penode.pmsm.balance.left_over import LeftOver, _functions, _repeats, left_over
from penode.pmsm.balance.start import weak_start
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES, less_voltage, with_vector
from penode.pmsm.recording.imperfections import Accuracy
from penode.predictors.base import Predictor
from penode.training.weak_form import HannWindow

SIZE = 0.3


@pytest.fixture(scope="module")
def run():
    """One second of a clean recording at one speed."""
    drive = Drive(current_sensors=CurrentSensors(noise=0.1))
    reference = Lissajous(200.0, 40.0, 43.0)
    return simulate(TRACTION_300A, reference, speed_rpm=800, duration=1.0, drive=drive, seed=1)


@pytest.fixture(scope="module")
def slow_run():
    """One second of a recording that moves slowly, without noise."""
    reference = Lissajous(240.0, 14.0, 15.0)
    return simulate(TRACTION_300A, reference, speed_rpm=1500, duration=1.0, seed=1)


def planted(experiment):
    """Return a voltage (time, 2), V, that is a gradient of the currents: no flux map makes it."""
    d, q = experiment.stack(CURRENTS).T / 100.0
    return SIZE * np.stack([-np.sin(2 * d) * np.cos(q), np.sin(d) ** 2 * np.sin(q)], axis=1)


def found(experiment, known=()):
    machine = weak_start([experiment], "coenergy", angle_orders=(6, 12)).machine
    return left_over([experiment], Predictor(experiment.time_step), known, machine)


def test_noise_is_not_taken_for_something_left_over(run):
    assert found(run) == ()


@pytest.mark.slow
def test_noise_that_columns_share_with_the_equations_is_not_taken_for_something(slow_run):
    # Of recorded currents, functions and columns have the noise of each equation in them: 83 mV
    # seemed left over of this recording.
    machine = weak_start([slow_run], "coenergy", angle_orders=(6, 12)).machine
    noise = np.random.default_rng(0).normal(0, 0.3, (2, len(slow_run)))
    noisy = with_vector(slow_run, CURRENTS, lambda i: i + noise[0] + 1j * noise[1])
    known = AS_RECORDED.rows(Accuracy(), [noisy])
    assert left_over([noisy], Predictor(noisy.time_step), known, machine) == ()


def test_a_planted_voltage_is_found_with_its_size(run):
    rows = found(less_voltage(run, planted(run)))
    assert {row.source for row in rows} == {LEFT_OUT}
    assert {row.remedy for row in rows} == {"Train with a recording at another speed as well."}
    size = float(rows[0].accuracy.split(" mV")[0]) / 1e3
    true = np.sqrt(np.mean(planted(run) ** 2))
    assert true / 3 < size < true * 3
    # The rows together are a process of this deviation at every current.
    moved = [row.applied(run, 1.0).stack(VOLTAGES) - run.stack(VOLTAGES) for row in rows]
    deviation = np.sqrt(np.sum(np.square(moved), axis=0))
    assert 0.9 * size < np.median(deviation) <= deviation.max() < 1.05 * size


@pytest.mark.slow
def test_of_a_model_that_ran_away_nothing_is_left_over(run):
    machine = weak_start([run], "coenergy", angle_orders=(6, 12)).machine
    away = eqx.tree_at(lambda one: one.terms[0].R, machine, np.array(1e300))
    assert left_over([run], Predictor(run.time_step), (), away) == ()


def test_without_the_rotors_angle_it_is_asked_for(run):
    loud = less_voltage(run, planted(run))
    kept = {name: one for name, one in loud.channels.items() if name != "theta_el"}
    bare = replace(loud, channels=kept)
    machine = weak_start([bare], "coenergy").machine
    rows = left_over([bare], Predictor(bare.time_step), (), machine)
    assert rows
    assert all(row.remedy.startswith("Record theta_el: ") for row in rows)


@pytest.mark.slow
def test_what_a_known_imperfection_explains_is_its_own(run):
    class Known:
        @staticmethod
        def applied(experiment, count):
            return less_voltage(experiment, -count * planted(experiment))

    # Beside it is what predicted currents are off by, as no prediction has the voltage in it.
    rows = found(less_voltage(run, planted(run)), (Known,))
    assert all(float(row.accuracy.split(" mV")[0]) < 1e3 * SIZE / 20 for row in rows)


def test_overlapping_equations_count_as_often_as_their_noise_is_new():
    window = HannWindow(1e-4, 28)
    noise = np.random.default_rng(0).normal(size=(40_000, 2))
    # A quarter of a window's shift: (integral of w)^2 over a quarter of that of w^2.
    assert _repeats(window.of_supply(noise).ravel()) == pytest.approx(8 / 3, rel=0.1)
    assert _repeats(window.of_store(noise).ravel()) == 1.0


def test_the_functions_are_a_process_of_variance_one(run):
    currents = run.stack(CURRENTS)
    variance = np.sum(_functions(currents)(currents) ** 2, axis=2)
    assert variance.max() <= 1 + 1e-6
    assert np.median(variance) > 0.9


@pytest.mark.parametrize(
    ("volts", "said"), [(0.7512, "750 mV"), (0.0283, "28 mV"), (1.2e-5, "0.012")]
)
def test_the_size_is_two_digits_without_an_exponent(volts, said):
    assert LeftOver(volts, np.zeros_like, np.array([1.0, 2.0]))._size.startswith(said)
