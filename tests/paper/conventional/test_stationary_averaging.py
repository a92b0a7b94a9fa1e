"""Stationary averaging against a machine in closed form and on the simulated bench."""

import numpy as np
import pytest

from penode.bench.coenergy_table import true_flux_map
from penode.bench.machines import TRACTION_300A
from penode.bench.references import stationary_grid
from penode.bench.run import simulate
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.paper.conventional.linear_maps import polynomial
from penode.paper.conventional.stationary_averaging import StationaryAveraging, operating_points

T, R, PSI, L_D, L_Q = 1e-4, 0.011, 0.06, 2e-4, 5e-4
#: A period of 80 samples.
OMEGA = 2 * np.pi / (80 * T)
STRAIGHT = polynomial(1, reciprocal=True)
POINTS = [(d, q) for d in (-100.0, 0.0, 50.0) for q in (-80.0, 0.0, 80.0)]


def held(points, omega=OMEGA, ripple=0.0, dwell=400):
    """A linear machine at rest at points, with ripple of the sixth order on the voltage."""
    currents = np.repeat(points, dwell, axis=0)
    omega = omega * np.ones(len(currents))
    wave = ripple * np.sin(6 * abs(OMEGA) * T * np.arange(len(currents)))
    i_d, i_q = currents.T
    u_d = R * i_d - omega * L_Q * i_q + wave
    u_q = R * i_q + omega * (PSI + L_D * i_d) + wave
    channels = {"i_d": i_d, "i_q": i_q, "u_d": u_d, "u_q": u_q, "omega_el": omega}
    return Experiment("held", T, channels)


def test_motor_and_generator_points_give_resistance_and_map_exactly():
    fit = StationaryAveraging(basis=STRAIGHT).identify([held(POINTS, ripple=20.0)])
    assert fit.parameters["R"].value == pytest.approx(R, rel=1e-10)
    np.testing.assert_allclose(fit.flux_map(30.0, -40.0), [PSI + 30 * L_D, -40 * L_Q], atol=1e-12)
    assert fit.provenance["operating_points"] == 9
    assert fit.provenance["averaged_to"] == 6


def test_it_is_the_average_of_motor_and_generator():
    """psi_d = (u_q+ + u_q-) / (2 omega) and psi_q = (u_d- - u_d+) / (2 omega), whatever R is."""
    motor, generator = held([(-60.0, 80.0)]), held([(-60.0, -80.0)])
    u_d, u_q = (
        np.array([e.channels[name][0] for e in (motor, generator)]) for name in ("u_d", "u_q")
    )
    expected = u_q.sum() / (2 * OMEGA), (u_d[1] - u_d[0]) / (2 * OMEGA)
    runs = [held([(-60.0, 80.0), (-60.0, -80.0), (40.0, 20.0), (40.0, -20.0), (0.0, 60.0)])]
    fit = StationaryAveraging(basis=STRAIGHT).identify(runs)
    np.testing.assert_allclose(fit.flux_map(-60.0, 80.0), expected, atol=1e-12)


def test_points_of_one_kind_are_refused():
    motor = held([(-100.0, 80.0), (0.0, 40.0), (50.0, 10.0), (20.0, 90.0), (-40.0, 20.0)])
    with pytest.raises(InputError, match="record motor and generator"):
        StationaryAveraging(basis=STRAIGHT).identify([motor])


def test_points_are_found_where_the_currents_stand(rng):
    run = held([(-100.0, 80.0), (20.0, -40.0)])
    found = operating_points(run)
    assert [point.current for point in found] == pytest.approx([-100 + 80j, 20 - 40j])
    assert all(point.samples == 240 for point in found)
    moving = Experiment("moving", T, {**run.channels, "i_d": np.linspace(-100, 100, len(run))})
    assert operating_points(moving) == ()
    with pytest.raises(InputError, match="stand still nowhere"):
        StationaryAveraging().identify([moving])


def test_the_map_must_not_have_more_coefficients_than_points():
    with pytest.raises(InputError, match="6 operating points cannot give a map of 27"):
        StationaryAveraging().identify([held(POINTS)])


def test_a_simulated_machine_with_slots_comes_out_right():
    grid = stationary_grid(200.0, points=5, dwell=0.04)
    run = simulate(TRACTION_300A, grid, speed_rpm=1500.0, duration=grid.duration)
    fit = StationaryAveraging(basis=polynomial(3, reciprocal=True)).identify([run])
    assert fit.parameters["R"].value == pytest.approx(TRACTION_300A.resistance, rel=0.02)
    points = np.array([[-100.0, 100.0], [0.0, -100.0], [100.0, 0.0], [0.0, 0.0]])
    truth = true_flux_map(TRACTION_300A, *points.T)
    np.testing.assert_allclose(fit.flux_map(*points.T).T, truth, atol=1e-3)
