"""Every imperfection of a recording: none of it changes nothing, little of it acts in proportion.

And the simulated bench, which shares no code with the estimator, makes recordings with several at
once; what is known of them takes them off again, in the right order.
"""

from dataclasses import fields

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from penode import Experiment
from penode.arrays import float64
from penode.bench.drive import Drive
from penode.bench.inverter import Inverter, StationaryHold
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import record
from penode.bench.sensors import CurrentSensors, Resolver
from penode.pmsm.balance.calibration import Calibration
from penode.pmsm.recording.accuracy import Accuracy

STEP, COUNT = 1e-4, 400
SIZES = Accuracy(**{one.name: 0.01 for one in fields(Accuracy)})


class Linkage:
    """Stands for the map of the weak form: omega J psi of a linear machine."""

    def rotation(self, run):
        current = run.channels["i_d"] + 1j * run.channels["i_q"]
        return 1j * run.channels["omega_el"] * (0.05 + 2e-4 * current)


#: What a calibration leaves: a deviation of everything, beside iron that takes current.
LEFT = Calibration(
    iron=0.02,
    linkage=Linkage(),
    resistance=0.01,
    deviation={"turn": 0.1, "iron": 0.005, "rotation_alone": 0.5, "mismatch": 0.01},
)


@pytest.fixture(scope="module")
def run():
    time = STEP * np.arange(COUNT)
    channels = {
        "i_d": -40 + 20 * np.sin(90 * time),
        "i_q": 60 * np.cos(70 * time),
        "u_d": 5 + 30 * np.sin(50 * time),
        "u_q": 90 + 10 * np.cos(40 * time),
        "omega_el": np.full(COUNT, 700.0),
        "theta_el": 0.3 + 700.0 * time,
    }
    return Experiment("run.csv", STEP, channels)


def every(run):
    return (*SIZES.imperfections([run]), *LEFT.imperfections)


def change(one, run, deviations):
    """Return what so many deviations change, (channel, time), each channel over its largest."""
    changed = one.applied(run, deviations)
    assert set(changed.channels) == set(run.channels)
    return np.stack(
        [
            (changed.channels[name] - values) / np.abs(values).max()
            for name, values in run.channels.items()
        ]
    )


def test_every_accuracy_has_its_imperfection(run):
    for one in fields(Accuracy):
        alone = Accuracy(**{f.name: 0.01 * (f.name == one.name) for f in fields(Accuracy)})
        assert alone.imperfections([run]), one.name
    assert len(LEFT.imperfections) == 3


def test_none_of_it_changes_nothing(run):
    for one in every(run):
        assert np.abs(change(one, run, 0.0)).max() < 1e-15, one.source


def test_little_of_it_acts_in_proportion_and_the_other_way_round(run):
    little = 1e-4
    for one in every(run):
        once, twice, back = (change(one, run, n * little) for n in (1, 2, -1))
        size = np.abs(once).max()
        assert size > 1e-9, one.source
        assert np.abs(twice - 2 * once).max() < 1e-3 * size, one.source
        assert np.abs(back + once).max() < 1e-3 * size, one.source


def test_a_recording_is_left_as_it_was(run):
    before = {name: values.copy() for name, values in run.channels.items()}
    for one in every(run):
        one.applied(run, 1.0)
    for name, values in run.channels.items():
        np.testing.assert_array_equal(values, before[name])


# --- what the bench does, and what takes it off --------------------------------------------------

GAINS, OFFSETS, ANGLE = np.array([1.02, 0.97, 1.01]), np.array([3.0, -1.0, -2.0]), np.deg2rad(3.0)


@pytest.fixture(scope="module")
def imperfect():
    """0.1 s behind unequal current sensors, a turned resolver, a delay and a stationary hold."""
    drive = Drive(
        current_sensors=CurrentSensors(gain=tuple(GAINS), offset=tuple(OFFSETS)),
        resolver=Resolver(float(ANGLE)),
        inverter=Inverter(StationaryHold(0.0), delay=1),
    )
    reference = Lissajous(150.0, 90.0, 99.0)
    return record(TRACTION_300A, reference, speed_rpm=1200.0, duration=0.1, drive=drive)


@pytest.fixture(scope="module")
def corrected(imperfect):
    """The recording as what is known of its drive corrects it, each sample's mean voltage."""
    rotation = np.exp(2j * np.pi / 3 * np.arange(3))
    known = Calibration(
        delay=1.0,
        hold="stationary",
        turn=-1.0,
        angle=-ANGLE,
        mismatch=complex(GAINS @ rotation.conj() / 3 / GAINS.mean()),
        offset=complex(2 / 3 * OFFSETS @ rotation),
    )
    return known.acting(known.applied(imperfect.experiment))


def voltage(trace):
    """Return the mean voltage (2, time - 1) in V over each sample, from the true currents.

    R i + d psi/dt + omega J psi of the machine that was simulated, by the trapezoidal rule.
    """
    psi_of = jax.jit(jax.vmap(jax.grad(TRACTION_300A.coenergy, argnums=(0, 1))))
    with float64():
        psi = np.stack(psi_of(*jnp.asarray(trace.current.T), jnp.asarray(trace.theta_el)))
    i, omega = trace.current.T, trace.omega_el

    def mean(x):
        return 0.5 * (x[:, 1:] + x[:, :-1])

    turned = omega * np.stack([-psi[1], psi[0]])
    return TRACTION_300A.resistance * mean(i) + np.diff(psi) / STEP + mean(turned)


def test_currents_and_angle_are_those_of_the_machine(imperfect, corrected):
    trace, later = imperfect.truth.trace, slice(1, len(imperfect.experiment))
    measured = imperfect.experiment.stack(("i_d", "i_q"))
    assert np.abs(measured - trace.current[: len(measured)]).max() > 3.0
    wanted = GAINS.mean() * trace.current[later]
    np.testing.assert_allclose(corrected.stack(("i_d", "i_q")), wanted, atol=1e-6)
    turned = np.exp(1j * (corrected.channels["theta_el"] - trace.theta_el[later]))
    np.testing.assert_allclose(turned, 1.0, atol=1e-9)


def test_voltages_are_those_that_acted(imperfect, corrected):
    wanted = voltage(imperfect.truth.trace)[:, 1:]
    found = corrected.stack(("u_d", "u_q")).T[:, : wanted.shape[1]]
    raw = imperfect.experiment.stack(("u_d", "u_q")).T[:, 1 : wanted.shape[1] + 1]
    wanted = wanted[:, : found.shape[1]]
    error, before = (np.abs(one - wanted)[:, 5:].max() for one in (found, raw))
    assert before > 3.0
    assert error < 0.05
