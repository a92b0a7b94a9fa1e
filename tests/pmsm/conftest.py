"""Recordings of the simulated bench, made once."""

import pytest

from penode.bench.drive import Drive
from penode.bench.inverter import DeadTime, Inverter
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.experiment import Experiment


@pytest.fixture(scope="session")
def slow_run() -> Experiment:
    """The paper's hard case: one speed, slow trajectory, unmodelled harmonics."""
    return simulate(TRACTION_300A, Lissajous(240.0, 14.0, 15.0), speed_rpm=1500.0, duration=1.0)


@pytest.fixture(scope="session")
def fast_run() -> Experiment:
    """The well-designed case: low speed, fast trajectory."""
    return simulate(TRACTION_300A, Lissajous(200.0, 140.0, 150.0), speed_rpm=150.0, duration=1.0)


@pytest.fixture(scope="session")
def unseen_run() -> Experiment:
    """Another speed and trajectory."""
    return simulate(TRACTION_300A, Lissajous(200.0, 40.0, 33.0), speed_rpm=900.0, duration=0.3)


@pytest.fixture(scope="session")
def dead_time_run() -> Experiment:
    """A drive with 0.6 us of dead time: 2.4 V at 400 V and 10 kHz."""
    drive = Drive(inverter=Inverter(dead_time=DeadTime(0.6e-6)))
    reference = Lissajous(240.0, 50.0, 43.0)
    return simulate(TRACTION_300A, reference, speed_rpm=1000.0, duration=0.5, drive=drive)
