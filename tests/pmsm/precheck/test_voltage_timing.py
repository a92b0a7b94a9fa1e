"""Voltages a sample off, which noise hides from the balance, are named by simulated currents."""

from dataclasses import replace

import numpy as np
import pytest

from penode.bench.drive import Drive
from penode.bench.machines import COMSOL_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.pmsm import identify
from penode.pmsm.balance.calibration import Calibration
from penode.pmsm.precheck.voltage_timing import voltage_timing
from penode.pmsm.study_settings import Study

QUICK = Study(terms=(), train_anyway=True)


@pytest.fixture(scope="module")
def noisy():
    """Return a recording whose controller answers much noise."""
    drive = Drive(current_noise=0.6)
    return simulate(
        COMSOL_300A, Lissajous(180.0, 9.0, 10.0), speed_rpm=1000.0, duration=0.3, drive=drive
    )


def shifted(run, samples):
    moved = {n: np.roll(run.channels[n], samples) for n in ("u_d", "u_q")}
    channels = {n: v[3:-3] for n, v in {**run.channels, **moved}.items()}
    return replace(run, channels=channels)


@pytest.fixture(autouse=True)
def short_ladder(monkeypatch):
    monkeypatch.setattr("penode.pmsm.study_settings.HORIZONS", (1, 4, 12))


def delays(fit):
    """Return what is said of a delay after training."""
    return [o for o in fit.horizon.objections if "delay" in o.name and "predictions" in o.reason]


@pytest.mark.parametrize(
    ("samples", "name", "side"),
    [
        (-1, "one-sample delay", "a sample later"),
        pytest.param(1, "one-sample delay", "a sample earlier", marks=pytest.mark.slow),
        (2, "delay of 2 samples", "2 samples earlier"),
    ],
)
def test_samples_are_named_where_the_balance_cannot(noisy, samples, name, side):
    (found,) = delays(identify([shifted(noisy, samples)], study=QUICK))
    assert found.name == name
    assert f"act {side} than recorded, predictions over 12 steps err by" in found.reason
    assert f"delay = {samples} in the study file" in found.repair
    assert found.verdict == "implausible"


@pytest.mark.parametrize("orders", [pytest.param(None, marks=pytest.mark.slow), ()])
def test_voltages_in_place_are_left_alone(noisy, orders):
    """Without harmonics the model misfits, and a delay would stand in for some of it."""
    assert not delays(identify([noisy], study=replace(QUICK, angle_orders=orders)))


def test_where_the_balance_shows_the_delay_nothing_is_looked_at():
    assert len(voltage_timing(None, Calibration(deviation={"delay": 0.2}))) == 1
    assert voltage_timing(None, Calibration(deviation={"delay": 0.05})) == ()
    assert voltage_timing(None, Calibration({"delay": 0.5}, deviation={"delay": 0.2})) == ()


def test_few_steps_say_nothing_of_the_delay(noisy):
    fit = identify([shifted(noisy, -1)], study=replace(QUICK, horizon=3))
    assert not delays(fit)
