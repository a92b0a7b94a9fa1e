"""Recordings at standstill, of both axes or of one: R and incremental inductance, no magnet."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest

from penode.bench.coenergies import SaturatingCoenergy
from penode.bench.coenergy_table import true_flux_map
from penode.bench.drive import Drive
from penode.bench.inverter import DeadTime, Inverter
from penode.bench.machines import TRACTION_300A, Machine
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.errors import InputError
from penode.pmsm import export
from penode.pmsm.balance.voltage_balance import BalanceForm
from penode.pmsm.recording.imperfections import Accuracy
from penode.pmsm.result_files import flux_map_csv
from penode.pmsm.study import identify
from penode.pmsm.study_settings import Study

R = TRACTION_300A.resistance
SCOPE = "R and incremental inductance: the recording has no information on the permanent magnet"


def injected(of_d, of_q):
    """Return sines of current at standstill, 150 A where an axis has them, with noise of 0.05 A."""

    def reference(time):
        sine = 150.0 * np.sin(2 * np.pi * 20.0 * time) * np.cos(2 * np.pi * 1.3 * time)
        other = 150.0 * np.sin(2 * np.pi * 13.0 * time) * np.cos(2 * np.pi * 1.1 * time)
        return np.stack([of_d * sine, of_q * other], axis=1)

    drive = Drive(current_noise=0.05)
    return simulate(TRACTION_300A, reference, speed_rpm=0.0, duration=0.3, drive=drive, seed=2)


def at_rest(run, axis):
    """Return a recording with one axis exactly at zero, as commissioning tests log it."""
    nothing = {f"{kind}_{axis}": np.zeros(len(run)) for kind in "ui"}
    return replace(run, channels={**run.channels, **nothing})


def two_samples_late(run):
    """Return a log whose voltages stand two samples before those that act."""
    channels = dict(run.channels)
    for name in ("u_d", "u_q"):
        channels[name] = np.roll(channels[name], -2)
    return replace(run, channels={name: values[:-2] for name, values in channels.items()})


def sines(amplitude):
    def reference(time):
        d, q = (np.sin(2 * np.pi * f * time) for f in (20.0, 13.0))
        slow = [np.cos(2 * np.pi * f * time) for f in (1.3, 1.1)]
        return amplitude * np.stack([d * slow[0], q * slow[1]], axis=1)

    return reference


#: A machine without magnets, whose d axis saturates.
RELUCTANCE = Machine(
    name="reluctance_20A",
    resistance=0.5,
    pole_pairs=2,
    current_limit=20.0,
    magnet_flux_linkage=0.0,
    inductance_d=45e-3,
    inductance_q=9e-3,
    angle_orders=(6,),
    coenergy=SaturatingCoenergy(
        magnet_flux=0.0,
        leakage_d=4e-3,
        leakage_q=6e-3,
        shared_flux=0.35,
        shared_current_d=9.0,
        shared_current_q=40.0,
        magnet_current=0.0,
        own_flux=0.02,
        own_current=5.0,
        cross_flux=0.01,
        cross_current=12.0,
        harmonics=((6, 1e-3, -1e-3),),
        harmonic_current=20.0,
    ),
)

STUDY = Study(horizon=1, candidates=(), angle_orders=(), accuracy=Accuracy.exact())


def rows_of(fit):
    return list(csv.DictReader(io.StringIO(flux_map_csv(fit))))


@pytest.fixture(scope="module")
def one_axis():
    return identify([at_rest(injected(1.0, 0.0), "q")], study=STUDY)


@pytest.fixture(scope="module")
def both_axes():
    return identify([two_samples_late(injected(1.0, 1.0))], study=STUDY)


def test_one_axis_alone_gives_resistance_and_inductance(one_axis):
    assert one_axis.horizon.verdict == "fixed"
    assert one_axis.horizon.objections == ()
    assert one_axis.parameters["R"].value == pytest.approx(R, rel=1e-2)
    assert one_axis.provenance["structure"][0].startswith(SCOPE)
    psi = [np.asarray(true_flux_map(TRACTION_300A, i, 0.0)).ravel()[0] for i in (-101.0, -99.0)]
    expected = (psi[1] - psi[0]) / 2.0
    found = one_axis.differential_inductance(-100.0, 0.0)[0, 0]
    assert found == pytest.approx(expected, rel=0.02)


def test_nothing_is_written_of_an_axis_at_rest(one_axis):
    rows = rows_of(one_axis)
    assert {float(row["i_q"]) for row in rows} == {0.0}
    assert all(
        row[name] == "nan" for row in rows for name in ("delta_psi_q", "l_dq", "l_qd", "l_qq")
    )
    assert all(np.isfinite(float(row["l_dd"])) for row in rows)
    assert any(row["supported"] == "1" for row in rows)


@pytest.mark.slow
def test_both_axes_with_a_voltage_two_samples_late(both_axes):
    assert both_axes.horizon.objections == ()
    assert both_axes.parameters["R"].value == pytest.approx(R, rel=1e-2)
    reasons = both_axes.provenance["structure"]
    assert any("a delay of 2" in reason for reason in reasons)


def test_no_constant_is_invented_and_none_exported(both_axes, tmp_path):
    np.testing.assert_allclose(both_axes.flux_map(0.0, 0.0), 0.0, atol=1e-9)
    rows = rows_of(both_axes)
    assert "psi_d" not in rows[0]
    assert all(np.isfinite(float(row["l_qq"])) for row in rows)
    inside = [row for row in rows if row["supported"] == "1"]
    points = np.array([[float(row[n]) for n in ("i_d", "i_q")] for row in inside])
    psi = np.asarray(true_flux_map(TRACTION_300A, *points.T)).reshape(len(points), 2)
    psi = psi - np.asarray(true_flux_map(TRACTION_300A, 0.0, 0.0)).reshape(1, 2)
    found = np.array([[float(row[f"delta_psi_{axis}"]) for axis in "dq"] for row in inside])
    assert np.abs(found - psi).mean() < 2e-3 * TRACTION_300A.magnet_flux_linkage
    with pytest.raises(InputError, match="the rotor stood still"):
        export(both_axes, "npz", tmp_path / "map.npz")
    assert not (tmp_path / "map.npz").exists()


def test_a_slow_locus_at_standstill_shows_the_resistance():
    """Windows as long as a period leave hardly more equations than the map has unknowns."""
    locus = Lissajous(150.0, 9.0, 11.0)
    run = simulate(TRACTION_300A, locus, speed_rpm=0.0, duration=0.5, seed=3)
    solved = BalanceForm.of([run], True).solve([run])
    assert solved.independence["R"] > 0.1
    assert solved.resistance == pytest.approx(R, rel=1e-3)


@pytest.mark.slow
def test_a_reluctance_machine_whose_voltage_acts_two_samples_late():
    """All is left to the data; what the balance leaves of a saturated map looks like dead time."""
    drive = Drive(current_noise=0.01, bandwidth=400.0, inverter=Inverter(delay=2))
    run = simulate(RELUCTANCE, sines(14.0), speed_rpm=0.0, duration=0.5, drive=drive, seed=2)
    fit = identify([run], study=Study(horizon=8))
    low, high = fit.parameters["R"].interval_95
    assert fit.horizon.objections == ()
    assert low < RELUCTANCE.resistance < high
    assert high - low < 0.05 * RELUCTANCE.resistance
    reasons = fit.provenance["structure"]
    assert any("taken into account as a delay of 2" in reason for reason in reasons)
    assert any("Dead time was left out" in reason for reason in reasons)
    inductance = fit.differential_inductance(5.0, -3.0)
    at = [np.ravel(true_flux_map(RELUCTANCE, 5.0 + i, -3.0)) for i in (-0.01, 0.01)]
    np.testing.assert_allclose(inductance[:, 0], (at[1] - at[0]) / 0.02, rtol=0.02, atol=1e-4)
    psi = np.asarray(fit.flux_map(0.0, 0.0))
    np.testing.assert_allclose(psi, 0.0, atol=1e-9)


@pytest.mark.slow
def test_injected_sines_with_dead_time_that_sets_in_softly():
    """Taken for sharp, or left out, the dead time of 2.4 V would be read as resistance."""
    inverter = Inverter(dead_time=DeadTime(0.6e-6, current_scale=20.0))
    drive = Drive(current_noise=0.05, inverter=inverter)
    run = simulate(TRACTION_300A, sines(150.0), speed_rpm=0.0, duration=0.5, drive=drive, seed=2)
    fit = identify([run], study=Study(horizon=1, angle_orders=()))
    low, high = fit.parameters["R"].interval_95
    assert fit.horizon.objections == ()
    assert low < R < high
    assert fit.parameters["R"].value == pytest.approx(R, rel=0.05)
    assert any(
        "Its knee, where the current changes sign, is soft" in reason
        for reason in fit.provenance["structure"]
    )
