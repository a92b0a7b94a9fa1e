"""Control loci: closed forms of a machine without saturation, optimality, and a saturating fit."""

from dataclasses import replace

import numpy as np
import pytest

from penode.bench.machines import COMSOL_300A
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.pmsm.control.controlled_machine import (
    ControlledMachine,
    recorded_link_voltage,
    voltage_limit_of,
)
from penode.pmsm.control.loci import (
    _at_both_limits,
    base_speed,
    characteristic_current,
    control_loci,
    loci_csv,
    most_torque_over_speed,
    mtpa,
    mtpv,
    voltage_limit_curve,
)
from penode.pmsm.control.loci_picture import loci_picture
from penode.pmsm.machine.flux_grid import FluxGrid, even_axis
from penode.pmsm.study_settings import Study

#: Without saturation: H, H, Vs, pole pairs.
L_D, L_Q, PSI, PAIRS = 2e-4, 5e-4, 0.06, 4
LIMIT = 400.0


def linear_flux(i_d, i_q):
    return np.stack(np.broadcast_arrays(PSI + L_D * np.asarray(i_d), L_Q * np.asarray(i_q)))


def linear_inductance(i_d, i_q):
    one = np.ones(np.broadcast_shapes(np.shape(i_d), np.shape(i_q)))
    return np.stack([np.stack([L_D * one, 0 * one]), np.stack([0 * one, L_Q * one])])


LINEAR = ControlledMachine(linear_flux, linear_inductance, PAIRS)


def test_mtpa_without_saturation_is_the_closed_form():
    current = np.linspace(0, LIMIT, 9)
    locus = mtpa(LINEAR, current)
    saliency = L_Q - L_D
    i_d = (PSI - np.sqrt(PSI**2 + 8 * saliency**2 * current**2)) / (4 * saliency)
    i_q = np.sqrt(current**2 - i_d**2)
    np.testing.assert_allclose(locus.current, [i_d, i_q], rtol=1e-6, atol=1e-6 * LIMIT)
    torque = 1.5 * PAIRS * (PSI - saliency * i_d) * i_q
    np.testing.assert_allclose(locus.torque, torque, rtol=1e-6, atol=1e-9)


def test_mtpv_without_saturation_is_the_closed_form():
    flux = np.linspace(0.005, 0.05, 9)
    locus = mtpv(LINEAR, flux, LIMIT)
    saliency = L_Q - L_D
    root = np.sqrt((PSI * L_Q) ** 2 + 8 * (saliency * flux) ** 2)
    psi_d = (PSI * L_Q - root) / (4 * saliency)
    psi_q = np.sqrt(flux**2 - psi_d**2)
    expected = np.stack([(psi_d - PSI) / L_D, psi_q / L_Q])
    expected = expected[:, np.hypot(*expected) <= LIMIT]
    assert expected.shape[1] > 4
    np.testing.assert_allclose(locus.current, expected, rtol=1e-6)


def test_characteristic_current_without_saturation_is_the_closed_form():
    locus = characteristic_current(LINEAR, 100.0)
    np.testing.assert_allclose(locus.current[:, 0], [-PSI / L_D, 0.0], rtol=1e-9, atol=1e-9)


def test_base_speed_without_resistance_is_voltage_over_flux():
    psi = np.hypot(*mtpa(LINEAR, np.array([LIMIT])).flux_linkage)[0]
    assert base_speed(LINEAR, LIMIT, 200.0) == pytest.approx(200.0 / psi / PAIRS, rel=1e-9)


@pytest.mark.parametrize(("limit", "resistance"), [(LIMIT, 0.0), (LIMIT, 0.02), (200.0, 0.02)])
def test_most_torque_over_speed_is_found_by_trying_every_current(limit, resistance):
    machine = replace(LINEAR, resistance=resistance)
    base = base_speed(machine, limit, 200.0)
    speeds = base * np.array([0.0, 0.5, 1.0, 1.2, 1.7, 2.5, 4.0])
    locus = most_torque_over_speed(machine, speeds, limit, 200.0)
    radius, angle = np.meshgrid(limit * np.linspace(0, 1, 401), np.linspace(0, np.pi, 1601))
    tried = np.stack([radius * np.cos(angle), radius * np.sin(angle)])
    for k, speed in enumerate(speeds):
        volts = np.hypot(*machine.voltage(tried, speed * PAIRS))
        possible = np.where(volts <= 200.0, machine.torque(tried), -np.inf)
        if not np.isfinite(locus.torque[k]):
            assert possible.max() < 0.02 * locus.torque[0]
            continue
        assert locus.torque[k] == pytest.approx(possible.max(), rel=0.01)
        assert locus.torque[k] > possible.max() - 1e-9 * possible.max()
        assert np.hypot(*locus.current[:, k]) <= limit * (1 + 1e-9)
        used = np.hypot(*machine.voltage(locus.current[:, [k]], speed * PAIRS))[0]
        assert used <= 200.0 * (1 + 1e-9)


def test_where_the_full_current_needs_no_more_than_the_limit_it_is_kept():
    full = mtpa(LINEAR, np.array([LIMIT])).current[:, 0]
    enough, little = (_at_both_limits(LINEAR, 1000.0, limit, full) for limit in (1e3, 1e-3))
    assert np.array_equal(enough, full)
    assert np.isnan(little).all()
    assert np.isnan(_at_both_limits(LINEAR, 1000.0, 100.0, np.full(2, np.nan))).all()


def test_at_high_speed_the_operating_point_is_on_mtpv():
    speed = 5 * base_speed(LINEAR, LIMIT, 200.0)
    locus = most_torque_over_speed(LINEAR, np.array([speed]), LIMIT, 200.0)
    on_mtpv = mtpv(LINEAR, np.array([200.0 / speed / PAIRS]), LIMIT)
    np.testing.assert_allclose(locus.current, on_mtpv.current, rtol=1e-8)


def test_voltage_limit_curve_has_that_voltage_within_the_current_limit():
    machine = replace(LINEAR, resistance=0.02)
    speed = 1.5 * base_speed(machine, LIMIT, 200.0)
    locus = voltage_limit_curve(machine, speed, 200.0, LIMIT)
    within = locus.chosen(np.isfinite(locus.torque))
    volts = np.hypot(*machine.voltage(within.current, speed * PAIRS))
    np.testing.assert_allclose(volts, 200.0, rtol=1e-9)
    assert 80 < len(volts) < len(locus.torque)
    assert np.hypot(*within.current).max() <= LIMIT


def test_torque_slope_is_the_derivative_of_the_torque(machine_fit, rng):
    machine = ControlledMachine.of(machine_fit)
    current, step = rng.uniform(-150, 100, (2, 20)), 1e-3
    slope = machine.torque_slope(current)
    for axis in range(2):
        shift = step * np.eye(2)[:, [axis]]
        rise = machine.torque(current + shift) - machine.torque(current - shift)
        np.testing.assert_allclose(slope[axis], rise / (2 * step), rtol=1e-5, atol=1e-7)


@pytest.fixture(scope="module")
def loci_of():
    """Return a function that computes loci of a machine within 240 A and 120 V."""
    return lambda machine: control_loci(machine, 240.0, 120.0)


@pytest.fixture(scope="module")
def true_loci(true_map, loci_of):
    """Loci of the COMSOL machine on a fine table of its own map."""
    axis = even_axis(-330.0, 330.0, 201)
    mesh = np.stack(np.meshgrid(axis, axis, indexing="ij"))
    psi, inductance = (one(*mesh) for one in true_map)
    grid = FluxGrid(axis, axis, psi, inductance, np.ones(psi.shape[1:], dtype=bool))
    return loci_of(ControlledMachine(grid.flux_map, grid.differential_inductance, 5, 0.01))


@pytest.mark.slow
def test_loci_of_a_fit_are_those_of_the_machine_within_a_percent(machine_fit, true_loci, loci_of):
    loci = loci_of(ControlledMachine.of(machine_fit))
    assert COMSOL_300A.pole_pairs == 5
    np.testing.assert_allclose(loci.mtpa.torque, true_loci.mtpa.torque, rtol=0.01)
    error = np.hypot(*(loci.mtpa.current - true_loci.mtpa.current))
    # Around its maximum the torque is flat: an angle off by more costs less than a percent of it.
    assert error.max() < 0.02 * 240.0
    assert loci.base_speed == pytest.approx(true_loci.base_speed, rel=0.01)
    shared = slice(0, min(len(loci.over_speed.torque), len(true_loci.over_speed.torque)))
    torque, expected = loci.over_speed.torque[shared], true_loci.over_speed.torque[shared]
    assert len(torque) >= 60
    np.testing.assert_allclose(torque, expected, atol=0.01 * expected[0])


def test_points_beyond_the_recordings_are_flagged(machine_fit):
    inner = replace(machine_fit, excited=machine_fit.excited / 3)
    locus = mtpa(ControlledMachine.of(inner), np.array([50.0, 90.0, 130.0, 200.0]))
    np.testing.assert_array_equal(locus.supported, [True, True, False, False])


def test_csv_has_a_row_a_point(true_loci):
    lines = loci_csv(true_loci).splitlines()
    assert lines[0] == "locus,i_d,i_q,psi_d,psi_q,torque,speed_rpm,power,supported"
    rows = [line.split(",") for line in lines[1:]]
    names = [row[0] for row in rows]
    assert names.count("mtpa") == len(true_loci.mtpa.torque)
    assert names.count("over_speed") == len(true_loci.over_speed.torque)
    assert names.count("characteristic") == 1
    last = next(row for row in reversed(rows) if row[0] == "over_speed")
    assert float(last[7]) == pytest.approx(float(last[6]) * np.pi / 30 * float(last[5]), rel=1e-6)


def test_pictures_are_png(true_loci, machine_fit):
    machine = ControlledMachine.of(machine_fit)
    for loci in (true_loci, replace(true_loci, over_speed=None)):
        assert loci_picture(machine, loci, "COMSOL").startswith(b"\x89PNG")


def test_refusals(machine_fit):
    unknown = replace(machine_fit, provenance={})
    with pytest.raises(InputError, match="--pole-pairs"):
        ControlledMachine.of(unknown)
    with pytest.raises(InputError, match="--pole-pairs"):
        ControlledMachine.of(unknown, 0)
    with pytest.raises(InputError, match="current limit must be > 0 A, got -1"):
        control_loci(LINEAR, -1.0)
    with pytest.raises(InputError, match="raise it or lower the current limit"):
        control_loci(replace(LINEAR, resistance=1.0), 100.0, 90.0)


def test_the_link_of_the_recordings_gives_the_voltage_limit(machine_fit):
    runs = [
        Experiment(name, 1e-4, {"omega_el": np.ones(3), "u_dc": np.array(volts)})
        for name, volts in (("a", [299.0, 300.0, 301.0]), ("b", [300.0, 300.0, 700.0]))
    ]
    facts = Study().facts(runs, ())
    linked = replace(machine_fit, provenance=facts)
    assert voltage_limit_of(linked) == pytest.approx(300.0 / np.sqrt(3), rel=1e-12)
    runs[1] = Experiment("b", 1e-4, {"omega_el": np.ones(3)})
    assert recorded_link_voltage(runs) is None
    assert voltage_limit_of(machine_fit) is None


def test_resistance_that_is_not_known_is_left_out(machine_fit):
    lost = replace(machine_fit, horizon=replace(machine_fit.horizon, verdict="no plateau"))
    assert ControlledMachine.of(lost).resistance == 0.0
    assert ControlledMachine.of(machine_fit).resistance == 0.01
