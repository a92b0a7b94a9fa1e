"""Laws of every imperfection of a recording, and of a drive that has several at once.

Its column in the weak form is the derivative of the residual by the size applied; a recording made
with a size, corrected by the size that is estimated from it, gives R back; a sign that is wrong is
caught by both. And the simulated bench, which shares no code with the estimator, makes recordings
with several at once; what is known of them takes them off again, in the right order.
"""

from dataclasses import replace

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
from penode.pmsm.recording.imperfection import KnownDrive
from penode.pmsm.recording.imperfections import IMPERFECTIONS, Accuracy
from penode.training.weak_form import HannWindow

STEP, COUNT, LENGTH, R = 1e-4, 3000, 120, 0.1
#: Sizes as large as in a poor drive, SI units.
SIZES = {
    "current_gain": 0.02,
    "voltage_gain": 0.02,
    "speed_gain": 0.01,
    "current_offset": 1.0 - 2.0j,
    "current_mismatch": 0.01 + 0.02j,
    "speed_lag": 1.0,
    "angle": 0.03,
    "sampling": 0.3,
    "turn": 0.3,
    "delay": 0.4,
    "iron": 0.03,
    "iron_of_rotation": 0.03,
    "iron_of_change": 0.03,
    "resistance_drift": 0.02,
    "magnet_drift": 2e-3,
}
EVERY = pytest.mark.parametrize("name", IMPERFECTIONS)


class Linkage:
    """Stands for the map of the weak form: one with saliency, saturation and cross-coupling."""

    def at(self, run):
        d, q = run.channels["i_d"], run.channels["i_q"]
        psi = np.stack([0.05 + 2e-4 * d - 3e-7 * q**2, 5e-4 * q - 6e-7 * d * q], axis=1)
        slope = np.empty((len(d), 2, 2))
        slope[:, 0, 0], slope[:, 0, 1] = 2e-4, -6e-7 * q
        slope[:, 1, 0], slope[:, 1, 1] = -6e-7 * q, 5e-4 - 6e-7 * d
        return psi, slope

    def rotation(self, run):
        psi = self.at(run)[0]
        return 1j * run.channels["omega_el"] * (psi[:, 0] + 1j * psi[:, 1])


DRIVE = KnownDrive(R, Linkage())


def recorded(lag=0.0):
    """Return a recording that obeys the voltage equation, with a speed that lags by seconds."""
    time = STEP * np.arange(COUNT)
    current = np.stack([-40 + 20 * np.sin(90 * time), 60 * np.cos(70 * time)], axis=1)
    rate = np.stack([1800 * np.cos(90 * time), -4200 * np.sin(70 * time)], axis=1)
    channels = {"i_d": current[:, 0], "i_q": current[:, 1]}
    channels["omega_el"] = 700 + 60 * np.sin(30 * time)
    channels["theta_el"] = 0.3 + 700 * time - 2 * np.cos(30 * time)
    run = Experiment("run.csv", STEP, channels)
    induced = DRIVE.linkage.rotation(run)
    rise = np.einsum("tij,tj->ti", DRIVE.linkage.at(run)[1], rate)
    u = R * current + rise + np.stack([induced.real, induced.imag], axis=1)
    channels |= {"u_d": u[:, 0], "u_q": u[:, 1]}
    return replace(run, channels={**channels, "omega_el": 700 + 60 * np.sin(30 * (time - lag))})


@pytest.fixture(scope="module")
def run():
    return recorded()


def residual(run, resistance=R):
    """Return what the balance leaves in each window and axis, of the known map."""
    window = HannWindow(STEP, LENGTH)
    psi, turned = DRIVE.linkage.at(run)[0], DRIVE.linkage.rotation(run)
    left = run.stack(("u_d", "u_q")) - resistance * run.stack(("i_d", "i_q"))
    left = left - np.stack([turned.real, turned.imag], axis=1)
    return (window.of_supply(left) + window.of_store(psi)).ravel()


def columns(one, run):
    window = HannWindow(STEP, LENGTH)
    pairs = one.columns(run, DRIVE)
    return np.stack([(window.of_supply(r) + window.of_store(s)).ravel() for s, r in pairs], axis=1)


def made(name):
    """Return a recording of a drive with the imperfection."""
    if name == "speed_lag":
        return recorded(lag=2e-3)
    return IMPERFECTIONS[name].corrected(recorded(), -SIZES[name], DRIVE)


def check_columns(one, run):
    """Compare columns with differences of the residual."""
    for axis, column in zip(one.axes, columns(one, run).T, strict=True):
        size = 1e-3 * abs(SIZES[one.name]) * axis
        more, less = (one.change(run, n * size, DRIVE).applied(run) for n in (1, -1))
        slope = (residual(more) - residual(less)) / (2 * abs(size))
        assert np.linalg.norm(column - slope) < 0.02 * np.linalg.norm(slope), one.name


def check_resistance(one, imperfect):
    """Estimate size and R from a recording, three times anew, and compare them with the truth."""
    size, axes = 0.0, np.array(one.axes)
    for _ in range(3):
        run = one.corrected(imperfect, size, DRIVE) if size else imperfect
        of_r = -HannWindow(STEP, LENGTH).of_supply(run.stack(("i_d", "i_q"))).reshape(-1, 1)
        matrix = np.concatenate([columns(one, run), of_r], axis=1)
        found = np.linalg.lstsq(matrix, -residual(run, 0.0), rcond=None)[0]
        size = size + complex(axes @ found[:-1])
    assert abs(size - SIZES[one.name]) < 0.03 * abs(SIZES[one.name]), one.name
    assert found[-1] == pytest.approx(R, rel=5e-3), one.name


@EVERY
def test_a_column_is_the_derivative_of_the_residual(run, name):
    check_columns(IMPERFECTIONS[name], recorded(2e-3) if name == "speed_lag" else run)


@EVERY
def test_a_recording_corrected_by_its_estimate_gives_the_resistance(name):
    check_resistance(IMPERFECTIONS[name], made(name))


def planted(name, method):
    """Return an imperfection with a wrong sign in one of its methods."""
    kind = type(IMPERFECTIONS[name])

    class Wrong(kind):
        def columns(self, experiment, drive):
            pairs = super().columns(experiment, drive)
            return [(-s, -r) for s, r in pairs] if method == "columns" else pairs

        def corrected(self, experiment, size, drive):
            sign = -1 if method == "corrected" else 1
            return super().corrected(experiment, sign * size, drive)

    return Wrong()


@EVERY
def test_a_sign_that_is_wrong_is_caught(run, name):
    one = recorded(2e-3) if name == "speed_lag" else run
    with pytest.raises(AssertionError):
        check_columns(planted(name, "columns"), one)
    for method in ("columns", "corrected"):
        with pytest.raises(AssertionError):
            check_resistance(planted(name, method), made(name))


@EVERY
def test_a_correction_is_its_change_to_first_order(run, name):
    """None of it changes nothing, little of it acts in proportion, and the recording is kept."""
    one, before = IMPERFECTIONS[name], {n: v.copy() for n, v in run.channels.items()}
    size = 1e-4 * SIZES[name]
    first, whole = one.change(run, size, DRIVE).applied(run), one.corrected(run, size, DRIVE)
    twice = one.change(run, 2 * size, DRIVE).applied(run)
    nothing = one.change(run, 0.0, DRIVE).applied(run)
    later = len(run) - len(whole)
    for key, values in before.items():
        np.testing.assert_array_equal(run.channels[key], values)
        np.testing.assert_allclose(nothing.channels[key], values, rtol=1e-15)
        once = first.channels[key] - values
        scale = max(np.abs(once).max(), 1e-9 * np.abs(values).max())
        np.testing.assert_allclose(twice.channels[key] - values, 2 * once, atol=1e-3 * scale)
        apart = whole.channels[key] - first.channels[key][later:]
        assert np.abs(apart).max() < 2e-3 * scale, key


def test_every_imperfection_has_its_rows(run):
    left = dict.fromkeys(IMPERFECTIONS, 0.01)
    shown = Calibration({}, DRIVE, left)
    alone = {row.source for row in shown.rows(Accuracy.exact(), [run])}
    declared = set(Accuracy().declared)
    assert alone.isdisjoint(IMPERFECTIONS[name].source for name in declared & set(IMPERFECTIONS))
    assert declared - set(IMPERFECTIONS) == {"torque_gain"}  # in no balance of voltages
    rows = shown.rows(Accuracy(), [run])
    assert {row.source for row in rows} == {one.source for one in IMPERFECTIONS.values()}
    assert len(rows) == sum(len(one.axes) for one in IMPERFECTIONS.values())


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
    sizes = {
        "delay": 1.0,
        "turn": -1.0,
        "angle": -ANGLE,
        "current_mismatch": complex(GAINS @ rotation.conj() / 3 / GAINS.mean()),
        "current_offset": complex(2 / 3 * OFFSETS @ rotation),
    }
    known = Calibration(sizes, KnownDrive(hold="stationary"))
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
