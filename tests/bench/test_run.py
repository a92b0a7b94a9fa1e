"""The recording: conventions, tracking, harmonics, noise and refusals."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from penode.bench.coenergy_table import true_flux_map
from penode.bench.drive import Drive
from penode.bench.inverter import DeadTime, Inverter, StationaryHold
from penode.bench.machines import TRACTION_300A, torque
from penode.bench.references import Lissajous
from penode.bench.rig import rig_of
from penode.bench.run import record, simulate
from penode.bench.sensors import CurrentSensors, Quantisation
from penode.bench.shaft import FreeShaft, Shaft, SpeedPoints, SpeedRipple
from penode.bench.truth import truth_of
from penode.bench.winding import IronLoss, Warming, Winding
from penode.errors import InputError

LISSAJOUS = Lissajous(300.0, rate_d=14.0, rate_q=15.0)
OMEGA = 2 * np.pi * 25.0 * 5
ROWS = 4000


def held(i_d, i_q):
    return lambda time: np.tile([i_d, i_q], (len(time), 1)).astype(float)


@pytest.fixture(scope="module")
def paper_run():
    return simulate(TRACTION_300A, LISSAJOUS, speed_rpm=1500.0, duration=2.0)


@pytest.fixture(scope="module")
def steady_run():
    return simulate(TRACTION_300A, held(-150.0, 200.0), speed_rpm=1500.0, duration=0.4)


def test_channels_and_conventions(paper_run):
    assert tuple(paper_run.channels) == ("u_d", "u_q", "i_d", "i_q", "omega_el", "theta_el")
    assert len(paper_run) == 20000
    assert paper_run.time_step == 1e-4
    assert paper_run.name == "traction_300A at 1500 rpm"
    assert paper_run.source.path == "simulated"
    assert len(paper_run.source.sha256) == 64
    np.testing.assert_allclose(paper_run.channels["omega_el"], OMEGA, rtol=1e-15)
    theta = paper_run.channels["theta_el"]
    assert theta.min() >= 0.0
    assert theta.max() < 2 * np.pi
    np.testing.assert_allclose(np.diff(np.unwrap(theta)), OMEGA * 1e-4, atol=1e-11)


def test_lissajous_is_tracked_without_touching_a_limit(paper_run):
    current = paper_run.stack(["i_d", "i_q"])
    error = np.linalg.norm(current - LISSAJOUS(1e-4 * np.arange(20000)), axis=1)
    assert np.sqrt(np.mean(error**2)) < 0.02 * 300.0
    assert error.max() < 0.05 * 300.0
    assert np.hypot(*paper_run.stack(["u_d", "u_q"]).T).max() < 100.0


def ends_by_scipy(run, rows, lag=0):
    """Return the current after each row, from its current and the voltage ``lag`` rows before."""
    voltage, current = run.stack(["u_d", "u_q"]), run.stack(["i_d", "i_q"])
    theta = run.channels["theta_el"]
    rig = rig_of(TRACTION_300A, Drive(), Shaft(), OMEGA)
    ends = []
    with jax.enable_x64(True):

        @jax.jit
        def derivative(current, voltage, theta):
            state = rig.plant.rest(theta, jnp.asarray(OMEGA))._replace(current=current)
            return rig.plant.slope(state, rig.voltages(voltage), jnp.zeros(())).current

        for k in rows:
            solution = solve_ivp(
                lambda t, i, k: derivative(i, voltage[k - lag], theta[k] + OMEGA * t),
                (0.0, 1e-4),
                current[k],
                method="DOP853",
                rtol=1e-11,
                atol=1e-9,
                args=(k,),
            )
            ends.append(solution.y[:, -1])
    return np.array(ends)


def test_row_k_holds_the_voltage_from_k_to_k_plus_1(paper_run):
    """The next row's current follows from this row's, by scipy on the plant's equation."""
    rows = np.array([0, 777, 1999, 12345])
    expected = paper_run.stack(["i_d", "i_q"])[rows + 1]
    np.testing.assert_allclose(ends_by_scipy(paper_run, rows), expected, atol=3e-6)


def test_with_a_delay_the_voltage_of_the_row_before_acts():
    drive = Drive(inverter=Inverter(delay=1))
    run = simulate(TRACTION_300A, LISSAJOUS, speed_rpm=1500.0, duration=0.2, drive=drive)
    rows = np.array([1, 777, 1500])
    expected = run.stack(["i_d", "i_q"])[rows + 1]
    np.testing.assert_allclose(ends_by_scipy(run, rows, lag=1), expected, atol=3e-6)
    # Until the first voltage acts, the believed induced one of no current does.
    assert np.abs(run.stack(["i_d", "i_q"])[1]).max() < 3.0


def test_a_stationary_hold_asks_for_more_and_half_a_sample_ahead(steady_run):
    drive = Drive(inverter=Inverter(StationaryHold()))
    run = simulate(TRACTION_300A, held(-150.0, 200.0), speed_rpm=1500.0, duration=0.4, drive=drive)
    ideal, real = (one.stack(["u_d", "u_q"])[-2000:] @ [1, 1j] for one in (steady_run, run))
    half = OMEGA * 1e-4 / 2
    expected = ideal.mean() * np.exp(1j * half) * half / np.sin(half)
    assert real.mean() == pytest.approx(expected, rel=1e-3)


def test_the_filter_shows_less_than_there_is():
    drive = Drive(current_sensors=CurrentSensors(cutoff_hz=1000.0), bandwidth=600.0)
    made = record(TRACTION_300A, held(-100.0, 120.0), speed_rpm=1500.0, duration=0.4, drive=drive)
    seen = made.experiment.stack(["i_d", "i_q"])[-2000:].mean(axis=0) @ [1, 1j]
    true = made.truth.trace.current[-2000:].mean(axis=0) @ [1, 1j]
    assert seen / true == pytest.approx(1 / (1 + 1j * OMEGA / (2 * np.pi * 1000.0)), rel=1e-4)


def test_a_profile_is_followed_through_standstill():
    profile = SpeedPoints((0.05, 0.15), (600.0, -600.0))
    made = record(TRACTION_300A, held(-50.0, 80.0), speed_rpm=profile, duration=0.2)
    time = 1e-4 * np.arange(2000)
    omega = made.experiment.channels["omega_el"]
    np.testing.assert_allclose(omega, profile(time) * np.pi / 30 * 5, atol=1e-9)
    turned = np.unwrap(made.experiment.channels["theta_el"])
    step = 1e-4 * (omega[1:] + omega[:-1]) / 2
    np.testing.assert_allclose(np.diff(turned), step, atol=1e-9)
    assert made.experiment.name == "traction_300A at varying speed"
    assert made.truth.mean_speed_rpm == pytest.approx(0.0, abs=0.5)
    current = made.experiment.stack(["i_d", "i_q"])
    assert np.abs(current[400:] - [-50.0, 80.0]).max() < 10.0


def test_ripple_of_the_true_speed_is_of_its_mechanical_order():
    speed = SpeedRipple(1500.0, ((1, 0.01, 0.0), (3, 0.002, 1.0)))
    run = simulate(TRACTION_300A, held(-50.0, 80.0), speed_rpm=speed, duration=0.2)
    lines = np.abs(np.fft.rfft(run.channels["omega_el"])) / 1000
    np.testing.assert_allclose(lines[[5, 10, 15]] / OMEGA, [0.01, 0.0, 0.002], atol=1e-6)


def test_a_free_shaft_accelerates_as_the_mean_torque_says():
    shaft = FreeShaft(inertia=0.05, load_torque=20.0, start_rpm=300.0)
    made = record(TRACTION_300A, held(-100.0, 150.0), speed_rpm=shaft, duration=0.2)
    trace = made.truth.trace
    nm = torque(TRACTION_300A, *trace.current.T, trace.theta_el)
    gained = 5 * np.concatenate([[0.0], np.cumsum((nm[1:] + nm[:-1]) / 2 - 20.0)]) * 1e-4 / 0.05
    start = 300.0 * np.pi / 30 * 5
    np.testing.assert_allclose(trace.omega_el, start + gained, rtol=2e-3)
    assert trace.omega_el[-1] > 2 * start


def test_chunks_change_nothing(monkeypatch):
    drive = Drive(current_noise=0.5, inverter=Inverter(delay=1))
    runs = []
    for rows in (1000, 700):
        monkeypatch.setattr("penode.bench.run._CHUNK", rows)
        runs.append(
            simulate(TRACTION_300A, LISSAJOUS, speed_rpm=1500.0, duration=0.2, drive=drive, seed=5)
        )
    for name, values in runs[0].channels.items():
        np.testing.assert_array_equal(values, runs[1].channels[name])


def test_warm_magnets_and_winding_are_in_the_truth():
    drive = Drive(
        winding=Winding(100.0, (1.0, 1.04, 0.99), Warming(2000.0, 0.05, ambient=60.0)),
        magnet_temperature=120.0,
        inverter=Inverter(StationaryHold(1.5), dead_time=DeadTime(1e-6), delay=1),
    )
    made = record(
        TRACTION_300A, held(-100.0, 150.0), speed_rpm=1000.0, duration=0.2, drive=drive, seed=4
    )
    told = json.loads(json.dumps(truth_of(made.truth), allow_nan=False))
    mean = 10e-3 * (1 + 3.93e-3 * (np.mean(made.truth.trace.temperature) - 20))
    assert told["resistance"] == pytest.approx(mean * 3.03 / 3, rel=1e-12)
    np.testing.assert_allclose(told["phase_resistances"], mean * np.array([1, 1.04, 0.99]))
    assert told["temperature"][0] == 100.0
    assert told["temperature"][1] != 100.0
    assert told["mean_speed_rpm"] == pytest.approx(1000.0)
    assert told["dead_time_voltage"] == pytest.approx(4.0)
    assert told["voltage_delay_samples"] == 1
    assert told["voltage_hold"] == "stationary"
    assert told["seed"] == 4
    assert told["machine"]["coenergy"]["kind"] == type(TRACTION_300A.coenergy).__name__
    hold = {"kind": "StationaryHold", "advance": 1.5}
    assert told["drive"]["inverter"]["hold"] == hold
    cold = true_flux_map(TRACTION_300A, np.array(-100.0), np.array(150.0))
    warm = made.truth.flux_map(np.array(-100.0), np.array(150.0))
    np.testing.assert_allclose(warm - cold, [-1.1e-3 * 100 * 58e-3, 0.0], atol=1e-12)


def test_ripple_lies_on_the_multiples_of_six(steady_run):
    """Two hundred milliseconds are 25 electrical periods, so line n omega is bin 25 n."""
    voltage = steady_run.stack(["u_d", "u_q"])[-2000:]
    lines = np.abs(np.fft.rfft(voltage, axis=0)) / 1000.0
    energy = (lines[1:] ** 2).sum()
    on_orders = (lines[25 * 6 :: 25 * 6] ** 2).sum()
    assert on_orders / energy > 1 - 1e-9
    assert np.all(lines[25 * 6] > 0.5)
    assert np.all(lines[25 * 12] > 0.1)


def test_steady_run_reaches_its_reference(steady_run):
    mean = steady_run.stack(["i_d", "i_q"])[-2000:].mean(axis=0)
    np.testing.assert_allclose(mean, [-150.0, 200.0], atol=1e-6)


def test_running_backwards_mirrors_the_q_axis(steady_run):
    """W(i_d, -i_q, -theta) = W(i_d, i_q, theta) makes reversal a change of signs."""
    reversed_run = simulate(TRACTION_300A, held(-150.0, -200.0), speed_rpm=-1500.0, duration=0.4)
    for name, sign in {"u_d": 1, "i_d": 1, "u_q": -1, "i_q": -1, "omega_el": -1}.items():
        np.testing.assert_allclose(
            reversed_run.channels[name], sign * steady_run.channels[name], atol=1e-8
        )


def test_seed_decides_the_noise_and_nothing_else_does():
    def noisy(seed):
        drive = Drive(current_noise=0.5)
        reference = held(-150.0, 200.0)
        return simulate(
            TRACTION_300A, reference, speed_rpm=1500.0, duration=0.4, drive=drive, seed=seed
        )

    first, again, other = noisy(7), noisy(7), noisy(8)
    assert first.source.sha256 == again.source.sha256
    assert np.array_equal(first.channels["i_d"], again.channels["i_d"])
    assert not np.array_equal(first.channels["i_d"], other.channels["i_d"])


def test_noise_is_white_of_the_given_size_and_seen_by_the_controller():
    drive = Drive(current_noise=0.5, bandwidth=1e-3)
    rest = simulate(TRACTION_300A, held(0.0, 0.0), speed_rpm=0.0, duration=0.4, drive=drive)
    noise = rest.channels["i_d"]
    assert noise.std() == pytest.approx(0.5, rel=0.04)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.05
    drive = Drive(current_noise=0.5)
    seen = simulate(TRACTION_300A, held(0.0, 0.0), speed_rpm=0.0, duration=0.4, drive=drive)
    k_p = 2 * 1000.0 * 0.8 * TRACTION_300A.inductance_q
    slope = np.polyfit(seen.channels["i_q"], seen.channels["u_q"], 1)[0]
    assert slope == pytest.approx(-k_p, rel=0.1)


def test_jax_settings_are_left_alone(steady_run):
    assert not jax.config.jax_enable_x64
    assert steady_run.channels["i_d"].dtype == np.float64


def test_too_fast_for_the_dc_link_is_refused():
    with pytest.raises(InputError, match=r"at 9000 rpm: the voltage stays at its limit of 230.9 V"):
        simulate(TRACTION_300A, held(0.0, 250.0), speed_rpm=9000.0, duration=0.1)


def test_a_reference_above_the_machine_is_refused():
    with pytest.raises(InputError, match=r"300 A that the machine permits, got 390 A at t = 0 s"):
        simulate(TRACTION_300A, held(-390.0, 0.0), speed_rpm=1500.0, duration=0.4)


def test_currents_that_leave_the_machine_are_refused():
    """A full step overshoots behind a delay, though the loop is stable."""
    drive = Drive(bandwidth=2000.0, tuning=1.0, inverter=Inverter(delay=1))
    with pytest.raises(InputError, match=r"leave the simulated machine's range of 375 A at t = "):
        simulate(TRACTION_300A, held(300.0, 0.0), speed_rpm=1500.0, duration=0.1, drive=drive)


@pytest.mark.parametrize(("bandwidth", "delay"), [(15_000.0, 0), (4_000.0, 1), (1_000.0, 12)])
def test_an_unstable_current_loop_is_refused(bandwidth, delay):
    drive = Drive(bandwidth=bandwidth, inverter=Inverter(delay=delay))
    with pytest.raises(
        InputError, match=r"the current loop is unstable at i_d = .*\(a pole of mod"
    ):
        simulate(TRACTION_300A, LISSAJOUS, speed_rpm=1500.0, duration=0.4, drive=drive)


@pytest.mark.parametrize(
    ("drive", "sentence"),
    [
        (Drive(dc_voltage=-1.0), "dc_voltage of Drive must be > 0, got -1.0"),
        (Drive(bandwidth=np.nan), "bandwidth of Drive must be > 0, got nan"),
        (Drive(inverter=Inverter(delay=-1)), "delay of Inverter must be 0, 1, 2, .* got -1"),
        (
            Drive(inverter=Inverter(dead_time=DeadTime(6e-5))),
            "less than half of the switching period of 0.0001 s, got 6e-05 s",
        ),
        (
            Drive(current_sensors=CurrentSensors(gain=(1.0, 0.0, 1.0))),
            r"gain of CurrentSensors must be three numbers > 0, .* got \(1",
        ),
        (
            Drive(current_sensors=CurrentSensors(quantisation=Quantisation(400.0, 0))),
            "bits of Quantisation must be a whole number from 1 to 32, got 0",
        ),
        (Drive(iron_loss=IronLoss(0.0)), "resistance of IronLoss must be > 0, got 0.0"),
    ],
)
def test_a_drive_that_cannot_be_is_refused(drive, sentence):
    with pytest.raises(InputError, match=sentence):
        simulate(TRACTION_300A, LISSAJOUS, speed_rpm=1500.0, duration=0.4, drive=drive)


def test_a_shaft_without_inertia_is_refused():
    with pytest.raises(InputError, match="inertia of FreeShaft must be > 0, got 0"):
        simulate(TRACTION_300A, LISSAJOUS, speed_rpm=FreeShaft(0), duration=0.4)


def test_a_profile_that_is_no_speed_a_row_is_refused():
    with pytest.raises(InputError, match=r"for each of the 4001 times, got shape \(3,\)"):
        simulate(TRACTION_300A, LISSAJOUS, speed_rpm=lambda time: time[:3], duration=0.4)


@pytest.mark.parametrize("duration", [0.0, -1.0, 5e-5, np.nan, np.inf])
def test_a_run_without_rows_is_refused(duration):
    with pytest.raises(InputError, match=r"at least one time step of 0\.0001 s, got"):
        simulate(TRACTION_300A, LISSAJOUS, speed_rpm=1500.0, duration=duration)


def test_a_speed_that_is_not_finite_is_refused():
    with pytest.raises(InputError, match="the speed must be finite and at most"):
        simulate(TRACTION_300A, LISSAJOUS, speed_rpm=np.inf, duration=0.4)


@pytest.mark.parametrize("rows", [lambda t: t, lambda t: np.full((len(t), 2), np.nan)])
def test_a_reference_that_is_not_two_finite_currents_is_refused(rows):
    with pytest.raises(InputError, match="must be finite i_d and i_q in A for each of the 4000"):
        simulate(TRACTION_300A, rows, speed_rpm=1500.0, duration=0.4)


def test_a_speed_that_no_machine_has_is_refused():
    with pytest.raises(InputError, match=r"at most 1e\+06 rpm, got 1e\+300 rpm"):
        simulate(TRACTION_300A, LISSAJOUS, speed_rpm=1e300, duration=0.4)


def test_more_samples_than_a_computer_holds_are_refused():
    with pytest.raises(InputError, match=r"1e\+300 s .* more than 1e\+08 samples"):
        simulate(TRACTION_300A, Lissajous(100.0, 14.0, 15.0), speed_rpm=1500.0, duration=1e300)
