"""The second plant against closed forms, its own energy, and numerical derivatives."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from validate.sampled_drive import kinds, library, other_machines
from validate.sampled_drive.drive import Drive, Plant, duties, simulate
from validate.sampled_drive.machines import Machine, draw_machine


def drawn(seed: int, **fixed: float) -> Machine:
    return draw_machine(np.random.default_rng(seed), harmonics=0.02, skewed=True, **fixed)


def linear() -> Machine:
    machine = drawn(1, voltage=200.0, current=100.0, frequency=100.0)
    knees = dict.fromkeys(("knee_d", "knee_q", "knee_s"), 1000000000.0)
    iron = machine.iron | knees | {"magnet_current": 0.0, "magnet": 0.2}
    return replace(machine, iron=iron, harmonics=np.zeros((0, 5)))


@pytest.mark.parametrize("seed", range(3))
def test_fluxes_and_inductances_are_derivatives_of_one_coenergy(seed):
    machine, random = drawn(seed), np.random.default_rng(seed)
    rated, step = machine.rated_current, 1e-5
    for d, q, angle in random.uniform(-1, 1, (5, 3)) * (rated, rated, np.pi):
        at = machine.jet(d, q, angle)

        def slopes(*names, point=(d, q, angle)):
            found = []
            for axis, size in enumerate((step * rated, step * rated, step)):
                shift = np.zeros(3)
                shift[axis] = size
                above, below = machine.jet(*(point + shift)), machine.jet(*(point - shift))
                found.append([(above[n] - below[n]) / (2 * size) for n in names])
            return np.array(found)

        flux, linkage = slopes("w")[:, 0], np.hypot(at["psi_d"], at["psi_q"])
        np.testing.assert_allclose(flux[:2], [at["psi_d"], at["psi_q"]], atol=1e-7 * linkage)
        np.testing.assert_allclose(flux[2], at["slope_w"], atol=1e-6 * linkage * rated)
        jacobian = slopes("psi_d", "psi_q")
        wanted = [[at["l_dd"], at["l_dq"]], [at["l_dq"], at["l_qq"]]]
        np.testing.assert_allclose(jacobian[:2], wanted, rtol=0, atol=1e-7 * at["l_qq"])
        np.testing.assert_allclose(jacobian[2], [at["slope_d"], at["slope_q"]], atol=1e-6 * linkage)
        assert np.all(np.linalg.eigvalsh(wanted) > 0)


def test_what_goes_in_is_heat_field_and_torque():
    machine, drive = drawn(4), Drive(rate=1e6)
    plant, speed, period = Plant(machine, drive), machine.base_speed / 3, 1e-6
    link, angle = 2 * machine.rated_voltage, 0.3
    voltage = 0.3 * machine.rated_voltage * np.exp(0.4j)
    powers, fields = [], []
    for _ in range(4000):
        current = plant.current(angle, speed)
        jet = machine.jet(current.real, current.imag, angle)
        supplied = (voltage * np.exp(-1j * angle) * np.conj(current)).real
        turning = jet["psi_d"] * current.imag - jet["psi_q"] * current.real + jet["slope_w"]
        powers.append(supplied - machine.resistance * abs(current) ** 2 - speed * turning)
        stored = jet["psi_d"] * current.real + jet["psi_q"] * current.imag - jet["w"]
        fields.append(stored)
        plant.advance(duties(voltage, link), link, angle, speed)
        angle += speed * period
    gained = np.trapezoid(powers, dx=period)
    assert np.ptp(fields) > 0
    assert gained == pytest.approx(fields[-1] - fields[0], abs=1e-6 * np.ptp(fields))


def test_a_settled_drive_has_the_voltage_of_the_steady_state():
    machine, drive = linear(), Drive(noise=0.0)
    speed, wanted = 0.4 * machine.base_speed, (-0.3 + 0.5j) * machine.rated_current

    def reference(times):
        return np.full(len(times), wanted)

    log = simulate(machine, drive, np.full(4000, speed), reference, np.random.default_rng(0))
    jet, last = machine.jet(0.0, 0.0), log.voltage[-100:].mean()
    flux = complex(jet["l_dd"] * wanted.real + 0.2, jet["l_qq"] * wanted.imag)
    half = speed / drive.rate / 2  # the voltage stands while the rotor turns
    assert log.current[-1] == pytest.approx(wanted, rel=1e-3)
    assert last * np.sin(half) / half == pytest.approx(
        machine.resistance * wanted + 1j * speed * flux, rel=1e-3
    )


@pytest.mark.parametrize("fraction", [0.01, 0.05, 0.4])
def test_legs_that_switch_lose_in_the_mean_what_the_averaged_ones_lose(fraction):
    machine = linear()
    ends = []
    for switched in (False, True):
        drive = Drive(dead_time=2e-6, swing=0.05, switched=switched)
        plant = Plant(machine, drive)
        plant.state[0] = fraction * machine.rated_current
        plant.advance([0.5, 0.5, 0.5], 400.0, 0.0, 0.0)
        ends.append(complex(*plant.state))
    start = fraction * machine.rated_current
    assert ends[1] - start == pytest.approx(ends[0] - start, rel=0.02)


def test_an_induction_machine_settles_where_its_equivalent_circuit_does():
    machine, period = linear(), 1e-4
    count = 15_000
    wanted = np.full(count, 1j * 0.4 * machine.rated_current)
    speed = np.full(count, 0.2 * machine.base_speed)
    log = other_machines.induction(machine, speed, wanted, np.zeros(count, complex), period)
    base = machine.rated_voltage / machine.rated_current / machine.base_speed
    main, own, rotor = 2.0 * base, 2.08 * base, 0.8 * machine.resistance
    current = (0.35 + 0.4j) * machine.rated_current
    turning = speed[0] + rotor / own * current.imag / current.real
    flux = own * current.real + 1j * (own - main**2 / own) * current.imag
    assert log.current[-1] == pytest.approx(current, rel=1e-3)
    assert log.voltage[-1] == pytest.approx(
        machine.resistance * current + 1j * turning * flux, rel=1e-3
    )


@pytest.mark.parametrize("name", kinds.KINDS)
def test_every_kind_is_drawn_again_from_its_seed(name, monkeypatch):
    short = replace(kinds.KINDS[name], duration=0.06)
    monkeypatch.setitem(kinds.KINDS, name, short)
    one, again, other = (kinds.draw(name, seed) for seed in (3, 3, 4))
    for log, same in zip(one.logs, again.logs, strict=True):
        assert np.array_equal(log.current, same.current)
        assert np.all(np.isfinite(log.current))
        assert np.all(np.isfinite(log.voltage))
    assert one.machine.resistance != other.machine.resistance or "resistance" in short.machine
    assert len(one.logs[0].time) > 20


def test_a_warmer_machine_has_more_resistance_and_less_magnet():
    machine = drawn(2)
    hot = kinds._warmed(machine, 60.0)
    assert hot.resistance == pytest.approx(1.2358 * machine.resistance)
    assert hot.flux(0j).real == pytest.approx(0.934 * machine.flux(0j).real)


def test_a_file_has_the_columns_and_their_units(tmp_path):
    drawn_log = kinds.draw("degrees for radians", 0)
    (file,) = drawn_log.write(tmp_path, "log")
    table = np.genfromtxt(file, delimiter=",", names=True)
    log = drawn_log.logs[0]
    np.testing.assert_allclose(table["i_q"], log.current.imag, rtol=1e-7)
    turned = np.exp(1j * np.deg2rad(table["theta_el"]))
    np.testing.assert_allclose(turned, np.exp(1j * log.angle), atol=1e-6)
    assert table["theta_el"].max() > 180


def test_without_a_compiler_the_plant_says_so(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda _name: None)
    with pytest.raises(RuntimeError, match="no C compiler"):
        library.plant.__wrapped__()
