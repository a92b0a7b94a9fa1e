"""The recording: conventions, tracking, harmonics, noise and refusals."""

import jax
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from penode.errors import InputError
from penode.pmsm.bench.machines import TRACTION_300A
from penode.pmsm.bench.plant import plant_of
from penode.pmsm.bench.references import Lissajous
from penode.pmsm.bench.run import Drive, simulate

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


def test_row_k_holds_the_voltage_from_k_to_k_plus_1(paper_run):
    """The next row's current follows from this row's, by scipy on the plant's equation."""
    voltage, current = paper_run.stack(["u_d", "u_q"]), paper_run.stack(["i_d", "i_q"])
    theta = paper_run.channels["theta_el"]
    with jax.enable_x64(True):
        plant = plant_of(TRACTION_300A, time_step=1e-4, omega_el=OMEGA)
        derivative = jax.jit(plant.derivative)
        for k in (0, 777, 12345):
            solution = solve_ivp(
                lambda t, i, k: derivative(i, voltage[k], theta[k] + OMEGA * t, OMEGA),
                (0.0, 1e-4),
                current[k],
                method="DOP853",
                rtol=1e-11,
                atol=1e-9,
                args=(k,),
            )
            np.testing.assert_allclose(solution.y[:, -1], current[k + 1], atol=3e-6)


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
        simulate(TRACTION_300A, held(0.0, 250.0), speed_rpm=9000.0, duration=0.4)


def test_currents_that_leave_the_machine_are_refused():
    with pytest.raises(InputError, match=r"leave the simulated machine's range of 375 A at t = "):
        simulate(TRACTION_300A, held(-390.0, 0.0), speed_rpm=1500.0, duration=0.4)


@pytest.mark.parametrize("duration", [0.0, -1.0, 5e-5, np.nan, np.inf])
def test_a_run_without_rows_is_refused(duration):
    with pytest.raises(InputError, match="hold no sample"):
        simulate(TRACTION_300A, LISSAJOUS, speed_rpm=1500.0, duration=duration)


def test_a_speed_that_is_not_finite_is_refused():
    with pytest.raises(InputError, match="the speed is not finite"):
        simulate(TRACTION_300A, LISSAJOUS, speed_rpm=np.inf, duration=0.4)


@pytest.mark.parametrize("rows", [lambda t: t, lambda t: np.full((len(t), 2), np.nan)])
def test_a_reference_that_is_not_two_finite_currents_is_refused(rows):
    with pytest.raises(InputError, match="return finite i_d and i_q in A for each of the 4000"):
        simulate(TRACTION_300A, rows, speed_rpm=1500.0, duration=0.4)
