"""What recordings have to be corrected by: estimated, applied, and left alone."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter, savgol_filter

from penode.bench.drive import Drive
from penode.bench.inverter import DeviceDrop, Inverter, RotorHold, StationaryHold
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.bench.sensors import Resolver
from penode.bench.winding import IronLoss
from penode.models.inputs import Inputs
from penode.pmsm import Accuracy
from penode.pmsm.balance.calibration import Calibration
from penode.pmsm.balance.calibration_fit import _Estimate, _timing_sentences, calibration_of
from penode.pmsm.machine.holds import HOLDS, mean_over_samples, turned_voltage
from penode.pmsm.machine.space_vectors import CURRENTS, in_frame_ahead, vector_of
from penode.pmsm.recording.imperfection import Change, DriveImperfection, KnownDrive
from penode.pmsm.recording.imperfections import IMPERFECTIONS

VOLTAGES = ("u_d", "u_q")
LAG = IMPERFECTIONS["speed_lag"]


def recorded(run, change):
    """Return a recording whose voltages (time, 2) are another function of those that act."""
    u_d, u_q = change(run.stack(VOLTAGES)).T
    return replace(run, channels={**run.channels, "u_d": u_d, "u_q": u_q})


def early_by_a_fraction(acting):
    """Return a voltage of which 0.6 of a sample acts, and 0.4 of the sample before."""
    log = acting.copy()
    for k in range(1, len(log)):
        log[k] = (acting[k] - 0.4 * log[k - 1]) / 0.6
    return log


def test_a_voltage_in_place_is_left_alone(slow_run, fast_run, dead_time_run):
    for run in (slow_run, fast_run, dead_time_run):
        assert calibration_of([run]) == Calibration()


def test_without_the_rotors_angle_an_inverter_hides_no_offset_of_the_axes():
    devices = DeviceDrop(2.0, 0.0, 12.0, (1.0, 1.0, 1.0), False)
    drive = Drive(
        inverter=Inverter(devices=devices), resolver=Resolver(np.radians(-2.0)), current_noise=0.1
    )
    reference = Lissajous(200.0, 15.0, 16.25)
    run = simulate(TRACTION_300A, reference, speed_rpm=300.0, duration=1.0, drive=drive, seed=1)
    bare = {name: one for name, one in run.channels.items() if name != "theta_el"}
    found = calibration_of([replace(run, channels=bare)])
    assert set(found.sizes) == {"angle"}
    assert np.degrees(found["angle"].real) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("samples", [1, 2, -1])
def test_a_whole_delay(slow_run, samples):
    result = calibration_of([recorded(slow_run, lambda u: np.roll(u, -samples, axis=0))])
    assert (result["delay"], result.drive.hold, result["turn"]) == (samples, "dq", 0.0)
    assert f"a delay of {samples}" in result.reasons[0]


def test_a_fraction_of_a_sample(slow_run):
    run = recorded(slow_run, early_by_a_fraction)
    result = calibration_of([run])
    assert result["delay"] == pytest.approx(0.4, abs=0.03)
    applied = Calibration({"delay": 0.4}).applied(run)
    np.testing.assert_allclose(applied.stack(VOLTAGES), slow_run.stack(VOLTAGES)[1:], atol=1e-9)
    np.testing.assert_array_equal(applied.channels["i_d"], slow_run.channels["i_d"][1:])


def test_a_hold_in_the_stationary_frame(slow_run):
    """A recording whose voltage, turned ahead by half a sample, has the mean that acted."""
    run = turned_voltage(slow_run, 0.5)
    result = calibration_of([run])
    assert (result["delay"], result.drive.hold, result["turn"]) == (0.0, "stationary", 0.0)
    acting = result.acting(result.applied(run)).stack(VOLTAGES)
    np.testing.assert_allclose(acting, slow_run.stack(VOLTAGES), rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize(
    ("hold", "expected"),
    [
        (StationaryHold(0.5), ("stationary", 0.5)),
        pytest.param(RotorHold(), ("dq", 0.0), marks=pytest.mark.slow),
    ],
)
def test_a_hold_about_the_middle_of_a_sample(hold, expected):
    """Of 12 samples a turn: the balance sees a small turn, about R T / (12 L) of a sample."""
    machine = replace(TRACTION_300A, resistance=0.1)
    drive = Drive(dc_voltage=2000.0, current_noise=0.2, inverter=Inverter(hold=hold))
    way = Lissajous(150.0, 30.0, 25.0)
    result = calibration_of([simulate(machine, way, speed_rpm=10000, duration=0.5, drive=drive)])
    assert (result["delay"], result.drive.hold, result["turn"], result["angle"]) == (
        0.0,
        *expected,
        0.0,
    )
    assert (result.drive.ripple < 0) == (expected[0] == "stationary")


@pytest.mark.parametrize("turn", [1, -1])
def test_a_hold_in_the_stationary_frame_with_a_whole_sample_of_rotation(slow_run, turn):
    """A command that the controller turned ahead by one sample too much or too little."""
    result = calibration_of([turned_voltage(slow_run, 0.5 - turn)])
    assert (result["delay"], result.drive.hold, result["turn"]) == (0.0, "stationary", float(turn))
    assert "turn" not in result.deviation


def test_another_turn(slow_run):
    run = turned_voltage(slow_run, 1.0)
    result = calibration_of([run])
    assert result["turn"] == pytest.approx(-1.0, abs=0.03)
    applied = Calibration({"turn": -1.0}).applied(run)
    np.testing.assert_allclose(applied.stack(VOLTAGES), slow_run.stack(VOLTAGES), atol=1e-9)


@pytest.mark.parametrize("delay", [1.0, -1.0, 2.3, -0.7])
def test_what_is_applied_keeps_rows_together(slow_run, delay):
    applied = Calibration({"delay": delay}).applied(slow_run)
    lengths = {len(channel) for channel in applied.channels.values()}
    assert len(lengths) == 1
    first = slow_run.channels["theta_el"].tolist().index(applied.channels["theta_el"][0])
    position = np.arange(len(applied)) + first - delay
    expected = np.interp(position, np.arange(len(slow_run)), slow_run.channels["u_q"])
    np.testing.assert_allclose(applied.channels["u_q"], expected, rtol=1e-9, atol=1e-9)


def test_a_standstill_shows_no_turn(slow_run):
    still = replace(slow_run, channels={**slow_run.channels, "omega_el": np.zeros(len(slow_run))})
    assert calibration_of([still])["turn"] == 0.0


def test_the_mean_over_a_sample_is_that_of_the_hold(slow_run):
    names = (*VOLTAGES, "omega_el")
    rows = slow_run.stack(names)[100:104].T
    fractions = (np.arange(400) + 0.5) / 400
    hold, step = HOLDS["stationary"], slow_run.time_step
    held = [hold(lambda k: Inputs(rows, names), 0, f, step)[VOLTAGES] for f in fractions]
    result = mean_over_samples(slow_run).stack(VOLTAGES)[100:104].T
    np.testing.assert_allclose(result, np.mean(held, axis=0), rtol=1e-5)


# --- the angle, the iron and the speed ----------------------------------------------------------


def test_an_angle_offset_is_estimated_beside_the_timing(fast_run):
    """The recording's d axis lies 2 degrees behind that of the machine."""
    behind = in_frame_ahead(fast_run, np.deg2rad(-2.0))
    for run, delay in ((behind, 0.0), (recorded(behind, lambda u: np.roll(u, -1, axis=0)), 1.0)):
        result = calibration_of([run])
        assert np.rad2deg(result["angle"]) == pytest.approx(2.0, abs=0.05)
        assert (result["delay"], result["turn"], result.drive.hold) == (delay, 0.0, "dq")
        assert result.reasons[-1].startswith("The d axis lies ")
        assert "° before that of the recording" in result.reasons[-1]
    corrected = Calibration({"angle": np.deg2rad(2.0)}).applied(behind)
    for name, values in fast_run.channels.items():
        np.testing.assert_allclose(corrected.channels[name], values, atol=1e-9)


def test_currents_sampled_late_are_no_angle(slow_run):
    """Turn and angle that cancel leave the voltages where they are, and turn the currents alone."""
    run = IMPERFECTIONS["sampling"].corrected(slow_run, -1.0, KnownDrive())
    turn = float(np.median(slow_run.channels["omega_el"])) * slow_run.time_step
    result = calibration_of([run])
    assert (result["delay"], result["turn"], result.drive.hold) == (0.0, 0.0, "dq")
    assert abs(result["angle"]) < 0.1 * turn  # not the whole of it


def test_a_hold_and_an_angle_that_nearly_cancel_are_both_found(slow_run):
    """The hold turns voltages back by half of what the rotor turns, the angle by most of that."""
    turn = float(np.median(slow_run.channels["omega_el"])) * slow_run.time_step
    run = in_frame_ahead(turned_voltage(slow_run, 0.5), 0.42 * turn)
    result = calibration_of([run])
    assert (result["delay"], result["turn"], result.drive.hold) == (0.0, 0.0, "stationary")
    assert result["angle"] == pytest.approx(-0.42 * turn, rel=0.02)


SLOWLY = [pytest.param(degrees, marks=pytest.mark.slow) for degrees in (-5.0, 4.0)]


@pytest.mark.parametrize("degrees", [*SLOWLY, 10.0])
def test_a_large_angle_is_no_delay_and_no_iron_loss(degrees):
    """Taken to first order alone it leaves enough for both."""
    drive = Drive(current_noise=0.05, resolver=Resolver(float(np.deg2rad(degrees))))
    figure = Lissajous(240.0, 14.0, 15.0)
    run = simulate(TRACTION_300A, figure, speed_rpm=1500.0, duration=1.2, drive=drive, seed=1)
    result = calibration_of([run])
    assert np.rad2deg(result["angle"]) == pytest.approx(-degrees, abs=0.01)
    assert (result["delay"], result["turn"], result["iron"], result["current_mismatch"]) == (
        0.0,
        0.0,
        0.0,
        0.0,
    )
    assert result.deviation["delay"] < 0.04
    assert result.deviation["iron"] < 1e-4
    assert [reason[:10] for reason in result.reasons] == ["Each volta", "The d axis"]


def with_iron(run, conductance, resistance):
    """Return the currents at the terminals of a machine whose iron takes part of them.

    The recorded voltages act from one sample to the next, on a machine of this resistance; the
    terminals carry conductance times the voltage behind it more, which drops in the resistance.
    """
    acting = run.stack(VOLTAGES)
    before = np.concatenate([acting[:1], acting[:-1]])
    induced = 0.5 * (acting + before) - resistance * run.stack(("i_d", "i_q"))
    channels = dict(run.channels)
    for axis, name in enumerate("dq"):
        channels[f"i_{name}"] = channels[f"i_{name}"] + conductance * induced[:, axis]
        drop = resistance * conductance * induced[:, axis]
        channels[f"u_{name}"] = channels[f"u_{name}"] + drop
    return replace(run, channels=channels)


def test_iron_loss_is_estimated_and_taken_off_the_currents(slow_run):
    conductance, resistance = 0.03, TRACTION_300A.resistance
    run = with_iron(slow_run, conductance, resistance)
    result = calibration_of([run])
    assert result["iron"] == pytest.approx(conductance, rel=0.05)
    assert abs(result["iron"] - conductance) < 4 * result.deviation["iron"]
    assert result.drive.resistance == pytest.approx(resistance, rel=0.2)
    assert (result["delay"], result["turn"], result.drive.hold, result["angle"]) == (
        0.0,
        0.0,
        "dq",
        0.0,
    )
    assert "ohm in parallel" in result.reasons[-1]
    drive = replace(result.drive, resistance=resistance)
    corrected = Calibration({"iron": conductance}, drive).applied(run)
    for name in ("i_d", "i_q", *VOLTAGES):
        largest = np.abs(run.channels[name] - slow_run.channels[name]).max()
        np.testing.assert_allclose(
            corrected.channels[name], slow_run.channels[name], atol=0.01 * largest
        )


@pytest.mark.parametrize("by_rotation", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_what_the_iron_takes_current_by_is_decided_by_the_recording(by_rotation):
    """Slow rotation and fast currents: much of the induced voltage is that of changing flux."""
    losses = IronLoss(1 / 0.03) if by_rotation else None
    drive = Drive(current_noise=0.05, iron_loss=losses)
    figure = Lissajous(200.0, 130.0, 120.0)
    run = simulate(TRACTION_300A, figure, speed_rpm=600.0, duration=1.0, drive=drive, seed=2)
    if not by_rotation:
        run = with_iron(run, 0.03, TRACTION_300A.resistance)
    result = calibration_of([run])
    kinds = {True: "iron_of_rotation", False: "iron"}
    assert result[kinds[by_rotation]] == pytest.approx(0.03, rel=0.03)
    assert not result[kinds[not by_rotation]]
    assert "iron_of_change" not in result.deviation
    assert (result["delay"], result["turn"], result["angle"]) == (0.0, 0.0, 0.0)


def test_iron_loss_of_the_other_kind_is_what_changes_with_it(slow_run):
    """Taken wholly back, the loss by all of the induced voltage is that by the rotation."""
    drive = calibration_of([with_iron(slow_run, 0.03, TRACTION_300A.resistance)]).drive
    unsure = Calibration({"iron": 0.003}, drive, {"iron_of_change": -0.003})
    (row,) = unsure.rows(Accuracy.exact(), [slow_run])
    assert (row.source, row.accuracy) == ("kind of iron loss", "3 mS")
    by_all = unsure.applied(slow_run)
    by_rotation = Calibration({"iron_of_rotation": 0.003}, drive).applied(slow_run)
    other = row.applied(by_all, 1.0)
    for name in ("i_d", "i_q", *VOLTAGES):
        apart = np.abs(by_all.channels[name] - by_rotation.channels[name]).max()
        np.testing.assert_allclose(
            other.channels[name], by_rotation.channels[name], atol=0.05 * apart
        )


def test_a_speed_that_lags_is_replaced_by_the_slope_of_the_angle(slow_run):
    """A recording whose speed swings, and a speed channel behind a filter of 5 Hz."""
    time = slow_run.time_step * np.arange(len(slow_run))
    swing = 40.0 * np.sin(2 * np.pi * 3 * time)
    angle = np.cumsum(slow_run.channels["omega_el"] + swing) * slow_run.time_step
    turning = {**slow_run.channels, "omega_el": slow_run.channels["omega_el"] + swing}
    turning |= {"theta_el": angle}
    sloped = LAG.corrected(replace(slow_run, channels=turning), 1.0, KnownDrive()).channels[
        "omega_el"
    ]
    np.testing.assert_allclose(sloped[100:-100], turning["omega_el"][100:-100], atol=0.05)


def test_slopes_are_those_of_the_filter_of_savitzky_and_golay(slow_run, rng):
    angle = np.cumsum(rng.uniform(0.0, 0.3, len(slow_run)))
    run = replace(slow_run, channels={**slow_run.channels, "theta_el": angle})
    wanted = savgol_filter(angle, 51, 3, deriv=1, delta=run.time_step)
    speed = LAG.corrected(run, 1.0, KnownDrive()).channels["omega_el"]
    np.testing.assert_allclose(speed, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


def test_the_slope_is_taken_where_it_explains_more(unseen_run):
    lagging = lfilter([0.01], [1, -0.99], unseen_run.channels["omega_el"] * 0 + 1.0)
    speed = unseen_run.channels["omega_el"] * (0.95 + 0.05 * lagging)
    slow = replace(unseen_run, channels={**unseen_run.channels, "omega_el": speed})
    assert calibration_of([slow])["speed_lag"]
    assert not calibration_of([unseen_run])["speed_lag"]


def test_an_angle_that_is_worse_than_the_speed_is_not_differentiated(unseen_run, rng):
    noisy = unseen_run.channels["theta_el"] + 0.1 * rng.normal(size=len(unseen_run))
    run = replace(unseen_run, channels={**unseen_run.channels, "theta_el": noisy})
    assert not calibration_of([run])["speed_lag"]


def test_a_machine_without_saliency_cannot_tell_iron_from_a_delay():
    """Its inductance is one number: the plain timing is the answer, not the pair that fits best."""
    coenergy = replace(
        TRACTION_300A.coenergy,
        harmonics=(),
        leakage_d=150e-6,
        leakage_q=150e-6,
        own_flux=0.0,
        cross_flux=0.0,
        shared_flux=1e-9,
        magnet_flux=40e-3,
    )
    surface = replace(TRACTION_300A, name="surface", coenergy=coenergy, angle_orders=())
    run = simulate(surface, Lissajous(200.0, 40.0, 33.0), speed_rpm=900.0, duration=0.5)
    result = calibration_of([recorded(run, lambda u: np.roll(u, -1, axis=0))])
    assert (result["delay"], result["turn"], result["iron"]) == (1.0, 0.0, 0.0)
    assert result.deviation["iron"] < 0.03  # the balance alone shows 0.2 ± 1.2 S


def test_what_is_left_of_the_corrections_joins_the_budget(slow_run):
    known = Calibration(
        {"delay": 0.4, "turn": 0.3, "iron": 0.02},
        KnownDrive(resistance=0.01),
        {"delay": 0.01, "turn": 0.004, "iron": 1e-3, "angle": np.deg2rad(0.1)},
    )
    exact = Accuracy.exact().deviations([slow_run])
    assert known.left(exact) == {"turn": 0.004, "delay": 0.01, "iron": 1e-3}
    usual = known.left(Accuracy().deviations([slow_run]))
    assert usual["angle"] == np.deg2rad(0.1)
    origins = {row.source: row.origin for row in known.rows(Accuracy(speed_gain=1e-3), [slow_run])}
    assert origins["gain of the speed"] == "declared"
    assert origins["gain of the currents"] == "assumed"
    assert origins["angle of the d axis"] == "estimated"
    assert origins["iron loss"] == "estimated"
    turn, delay, iron = known.rows(Accuracy.exact(), [slow_run])
    assert (turn.source, delay.source, iron.source, iron.accuracy) == (
        "turn of the voltage",
        "delay of the voltage",
        "iron loss",
        "1 mS",
    )
    once = turn.applied(slow_run, 2.0)
    np.testing.assert_allclose(
        once.stack(VOLTAGES), turned_voltage(slow_run, 0.008).stack(VOLTAGES), rtol=1e-4
    )
    more = Calibration({"iron": 1e-3}, known.drive).applied(slow_run)
    np.testing.assert_allclose(
        iron.applied(slow_run, 1.0).stack(VOLTAGES), more.stack(VOLTAGES), rtol=1e-12
    )
    declared = Accuracy().deviations([slow_run])
    assert Calibration().left(declared) == declared


def test_a_recording_that_shows_its_angle_narrows_what_is_declared(fast_run):
    result = calibration_of([fast_run])
    assert result == Calibration()
    declared = Accuracy().deviations([fast_run])
    narrowed = result.left(declared)
    assert 0 < narrowed["angle"] < np.deg2rad(0.1)
    assert 0 < narrowed["delay"] <= 0.02
    assert 0 < narrowed["current_mismatch"] < 0.001
    assert 0 < narrowed["current_offset"] < declared["current_offset"]
    gains = ("current_gain", "voltage_gain", "speed_gain")
    assert all(narrowed[name] == declared[name] for name in gains)
    exact = result.left(Accuracy.exact().deviations([fast_run]))
    assert set(exact) == {"iron"}


# --- the current sensors ------------------------------------------------------------------------


def measured(run, gains, offsets):
    """Return a recording of phases with gains and offsets of their own, by phase arithmetic."""
    angles = run.channels["theta_el"] - 2 * np.pi / 3 * np.arange(3)[:, None]
    d, q = run.channels["i_d"], run.channels["i_q"]
    phases = np.cos(angles) * d - np.sin(angles) * q
    read = np.asarray(gains)[:, None] * phases + np.asarray(offsets)[:, None]
    channels = {
        "i_d": 2 / 3 * np.sum(np.cos(angles) * read, axis=0),
        "i_q": -2 / 3 * np.sum(np.sin(angles) * read, axis=0),
    }
    return replace(run, channels={**run.channels, **channels})


@pytest.mark.parametrize(
    ("gains", "offsets"),
    [((1.01, 1.0, 1.0), (0, 0, 0)), ((1, 1, 1), (2.0, 0, 0)), ((0.99, 1.01, 1.0), (0, -1.0, 1.0))],
)
def test_what_differs_between_the_phases_is_taken_off(slow_run, gains, offsets):
    """A gain that all phases share stays; a common offset is no current."""
    result = calibration_of([measured(slow_run, gains, offsets)])
    corrected = result.applied(measured(slow_run, gains, offsets))
    common = np.mean(gains)
    apart = corrected.stack(("i_d", "i_q")) - common * slow_run.stack(("i_d", "i_q"))
    recorded = measured(slow_run, gains, offsets).stack(("i_d", "i_q"))
    before = recorded - common * slow_run.stack(("i_d", "i_q"))
    assert np.sqrt(np.mean(apart**2)) < 0.03 * np.sqrt(np.mean(before**2))
    assert (result["delay"], result["turn"], result["iron"], result["angle"]) == (
        0.0,
        0.0,
        0.0,
        0.0,
    )
    assert bool(result["current_mismatch"]) == (gains != (1, 1, 1))
    assert bool(result["current_offset"]) == any(offsets)


def test_an_applied_mismatch_and_offset_are_exactly_undone(slow_run):
    run = measured(slow_run, (1.05, 0.97, 1.0), (3.0, -1.0, 0.0))
    rotation = np.exp(2j * np.pi / 3 * np.arange(3))
    mismatch = np.array([1.05, 0.97, 1.0]) @ rotation.conj() / 3
    common = (1.05 + 0.97 + 1.0) / 3
    offset = 2 / 3 * np.array([3.0, -1.0, 0.0]) @ rotation
    known = Calibration({"current_mismatch": mismatch / common, "current_offset": offset})
    np.testing.assert_allclose(
        known.applied(run).stack(("i_d", "i_q")),
        common * slow_run.stack(("i_d", "i_q")),
        atol=1e-9,
    )


def test_without_an_angle_no_sensor_is_corrected(slow_run):
    run = measured(slow_run, (1.01, 1.0, 1.0), (2.0, 0, 0))
    channels = {name: values for name, values in run.channels.items() if name != "theta_el"}
    result = calibration_of([replace(run, channels=channels)])
    assert (result["current_mismatch"], result["current_offset"]) == (0.0, 0.0)
    left = result.left(Accuracy().deviations([run]))
    assert left["current_mismatch"] == Accuracy().declared["current_mismatch"]


# --- an imperfection that nobody knew of --------------------------------------------------------


class Eccentric(DriveImperfection):
    """A resolver whose angle errs once a turn: a frame ahead by Re(size exp(-j theta)), rad."""

    name, source, remedy = "eccentricity", "eccentricity of the resolver", "Centre the resolver."
    unit, axes, channels = (float(np.rad2deg(1.0)), "°"), (1.0, 1j), ("theta_el",)
    credible, beside = (1e-4, 0.1), True

    def change(self, experiment, size, drive):
        error = np.real(size * np.exp(-1j * experiment.channels["theta_el"]))
        current, voltage = (
            -1j * error * vector_of(experiment, pair) for pair in (CURRENTS, VOLTAGES)
        )
        return Change(current, voltage, angle=error)


def test_a_new_imperfection_is_one_object_and_one_line(slow_run, monkeypatch):
    """It is estimated beside all others, corrected and named, and what is left is in the budget."""
    one, size = Eccentric(), 0.003 - 0.004j
    run = one.corrected(slow_run, -size, KnownDrive())
    monkeypatch.setitem(IMPERFECTIONS, one.name, one)
    result = calibration_of([run])
    assert result["eccentricity"] == pytest.approx(size, abs=2e-4)
    assert (result["delay"], result["turn"], result["angle"]) == (0.0, 0.0, 0.0)
    assert result.reasons[1].startswith("eccentricity of the resolver: 0.28")
    apart = result.applied(run).stack(VOLTAGES) - slow_run.stack(VOLTAGES)
    assert np.abs(apart).max() < 0.1 * np.abs(run.stack(VOLTAGES) - slow_run.stack(VOLTAGES)).max()
    rows = [row.source for row in result.rows(Accuracy(), [run])]
    assert rows.count("eccentricity of the resolver") == 2


def test_what_the_test_of_the_hold_shows_is_said(slow_run):
    free = _Estimate({}, {}, 0.0, KnownDrive())
    said = [
        next(_timing_sentences(Calibration(turned=turned), (0.0, 0.01), free))
        for turned in ((0.002, 0.0004), None)
    ]
    assert "it seems turned by 0.0020 ± 0.0004 (std) samples of rotation" in said[0]
    assert said[1].endswith("In which frame it is held does not show.")
    assert calibration_of([slow_run]).turned[0] == pytest.approx(0.0, abs=0.01)
    assert calibration_of([turned_voltage(slow_run, 0.5)]).turned[0] == pytest.approx(
        -0.5, abs=0.01
    )
