"""Ten wrong conventions are found by name, and clean recordings are left alone."""

from dataclasses import replace

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from penode.bench.drive import Drive
from penode.bench.inverter import DeadTime, Inverter, RotorHold, StationaryHold
from penode.bench.machines import BRUSA_250A, COMSOL_300A, TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.bench.sensors import CurrentSensors, Resolver, SpeedSensor
from penode.data.experiment import Experiment
from penode.pmsm.balance.calibration import AS_RECORDED, Calibration
from penode.pmsm.balance.trial_balance import imitated_lag
from penode.pmsm.balance.voltage_balance import harmonic_window
from penode.pmsm.conventions import balance, check
from penode.pmsm.conventions.balance import judge_delay, judge_hold
from penode.pmsm.conventions.check import check_conventions, judge
from penode.pmsm.conventions.cures import _scales
from penode.pmsm.conventions.motion import OfShaft, find_stepped_angle
from penode.pmsm.conventions.phases import find_uneven_phases
from penode.pmsm.machine.frames import abc_from_dq, dq_from_abc
from penode.pmsm.recording.name_plate import NO_PLATE, NamePlate
from penode.pmsm.study import identify
from penode.pmsm.study_settings import Study

#: Machine, speed in rpm, rate in rad/s, dead time in s.
DRAWN = {
    "traction": (TRACTION_300A, -900.0, 45.0, 0.5e-6),
    "comsol": (COMSOL_300A, 2100.0, 90.0, 0.3e-6),
    "brusa": (BRUSA_250A, 700.0, 95.0, 0.2e-6),
}


#: The two others in `make validate`.
SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("traction", "comsol")]


@pytest.fixture(scope="module", params=["brusa", *SLOW])
def drawn(request):
    """Return a machine and its recording behind a drive with every imperfection on."""
    machine, rpm, rate, dead_time = DRAWN[request.param]
    limit = machine.current_limit
    drive = Drive(
        inverter=Inverter(dead_time=DeadTime(dead_time)),
        current_sensors=CurrentSensors(
            gain=(1.0, 1.01, 0.99), offset=(0.003 * limit, -0.002 * limit, 0.0), noise=0.001 * limit
        ),
        resolver=Resolver(orders=((1.0, 0.005, 0.0), (2.0, 0.0035, 1.0)), growth=0.002),
        speed_sensor=SpeedSensor(noise=0.002, orders=((1.0, 0.002, 0.0),)),
    )
    reference = Lissajous(0.7 * limit, rate, 13 / 12 * rate)
    run = simulate(machine, reference, speed_rpm=rpm, duration=0.5, drive=drive, seed=5)
    return machine, run


@pytest.fixture(autouse=True)
def _one_thread():
    with threadpool_limits(limits=1, user_api="blas"):
        yield


def changed(run: Experiment, **channels) -> Experiment:
    return replace(run, channels={**run.channels, **channels})


def scaled(run: Experiment, factor: float, *names: str) -> Experiment:
    return changed(run, **{name: factor * run.channels[name] for name in names})


def without(run: Experiment, *names: str) -> Experiment:
    kept = {name: values for name, values in run.channels.items() if name not in names}
    return replace(run, channels=kept)


def in_phases(run: Experiment) -> Experiment:
    """Return the recording in phase quantities, its speed left to the angle."""
    theta, phases = run.channels["theta_el"], {}
    for kind in "ui":
        three = abc_from_dq(run.stack((f"{kind}_d", f"{kind}_q")), theta)
        phases |= {f"{kind}_{phase}": x for phase, x in zip("abc", three.T, strict=True)}
    return replace(run, channels={**phases, "theta_el": theta})


def shifted(run: Experiment, samples: int, *names: str) -> Experiment:
    late = {name: np.roll(run.channels[name], samples) for name in names}
    moved = changed(run, **late)
    return replace(moved, channels={n: x[2:-2] for n, x in moved.channels.items()})


def exchanged(run: Experiment, one: str, other: str) -> Experiment:
    return changed(run, **{one: run.channels[other], other: run.channels[one]})


def names_of(run: Experiment, *known) -> list[str]:
    return [found.name for found in check_conventions(run, *known).broken]


def test_clean_recordings_are_silent(drawn):
    machine, run = drawn
    plate = NamePlate(machine.magnet_flux_linkage, machine.resistance)
    for clean in (run, without(run, "theta_el"), in_phases(run)):
        found = check_conventions(clean, machine.pole_pairs, plate)
        assert found.broken == ()
        assert found.undetermined == ()


def test_a_name_plate_of_another_machine_is_named(drawn):
    """Twice the resistance, or a third more flux linkage, that the recording has."""
    machine, run = drawn
    for plate, ratio, name in (
        (NamePlate(None, 2 * machine.resistance), 0.5, "R"),
        (NamePlate(machine.magnet_flux_linkage / 1.33), 1.33, "the magnet's flux linkage"),
    ):
        found = check_conventions(run, machine.pole_pairs, plate)
        assert found.broken == ()
        (said,) = (s for s in found.undetermined if "name plate;" in s)
        assert said.startswith(f"{run.name}: {name} is ")
        assert float(said.split(f"{name} is ")[1].split()[0]) == pytest.approx(ratio, rel=0.1)


def test_swapped_phases(drawn):
    run = in_phases(drawn[1])
    for one, other in (("i_a", "i_b"), ("u_b", "u_c")):
        (found,) = check_conventions(exchanged(run, one, other)).broken
        assert found.name == "swapped phases"
        assert set(found.channels) == {one, other}


def test_negative_q(drawn):
    run = drawn[1]
    assert names_of(scaled(run, -1.0, "i_q")) == ["negative q current"]
    assert names_of(scaled(run, -1.0, "u_q")) == ["negative q voltage"]


def test_mechanical_speed_and_angle(drawn):
    machine, run = drawn
    pairs = machine.pole_pairs
    of_shaft = scaled(run, 1 / pairs, "omega_el")
    (found,) = check_conventions(of_shaft).broken
    assert found.name == "mechanical speed for electrical"
    assert f"pole_pairs = {pairs}" in found.fix
    (found,) = check_conventions(of_shaft, pairs).broken
    assert found.fix == "give omega_el mechanical = true"
    blind = without(of_shaft, "theta_el")
    assert names_of(blind, pairs) == ["mechanical speed for electrical"]
    theta = np.mod(np.unwrap(run.channels["theta_el"]) / pairs, 2 * np.pi)
    for angle in (changed(run, theta_el=theta), changed(in_phases(run), theta_el=theta)):
        assert names_of(angle) == ["mechanical angle for electrical"]


def test_wrong_pole_pairs_with_a_speed_of_the_shaft_and_an_angle(drawn):
    """The speed is mechanical and said to be; the angle shows how many pole pairs there are."""
    machine, run = drawn
    pairs = machine.pole_pairs
    for wrong in (pairs - 1, pairs + 1, 2 * pairs):
        slower = scaled(run, wrong / pairs, "omega_el")
        found = check_conventions(slower, wrong, of_shaft=("omega_el",)).broken
        assert [one.name for one in found] == ["wrong pole pairs"]
        assert found[0].fix.startswith(f"give pole_pairs = {pairs} in place of {wrong}; or, ")


def test_what_is_said_already_is_not_advised(drawn):
    """Of one electrical and one mechanical column an entry is taken away, not given."""
    machine, run = drawn
    pairs = machine.pole_pairs
    turned = changed(run, theta_el=np.unwrap(run.channels["theta_el"]) * pairs)
    (found,) = check_conventions(turned, pairs, of_shaft=("omega_el", "theta_el")).broken
    assert found.fix.startswith("take mechanical = true away from theta_el")
    (found,) = check_conventions(turned, pairs, of_shaft=("theta_el",)).broken
    assert found.name == "electrical angle for mechanical"
    assert "give" not in found.fix
    assert "correct the time" not in found.fix


@pytest.mark.parametrize(("factor", "unit"), [(30 / np.pi, "rpm"), (np.pi / 30, "rad/s")])
def test_a_speed_read_in_a_wrong_unit(drawn, factor, unit):
    run = drawn[1]
    (found,) = check_conventions(scaled(run, factor, "omega_el")).broken
    assert found.name == "unit of the speed"
    assert found.fix == f'give omega_el unit = "{unit}"'


def test_a_wrong_sampling_time_is_named_beside_wrong_pole_pairs(drawn):
    """The ratio alone cannot tell one from the other."""
    run = drawn[1]
    slow = replace(run, time_step=1.25 * run.time_step)
    (found,) = check_conventions(slow, 5, of_shaft=("omega_el",)).broken
    assert "give pole_pairs = 4 in place of 5; or, " in found.fix
    assert f"{run.time_step:.4g} s a sample in place of {slow.time_step:.4g} s" in found.fix
    counted = replace(run, time_step=1.0)
    (found, *_) = check_conventions(counted, 5, of_shaft=("omega_el",)).broken
    assert f"{run.time_step:.4g} s a sample in place of 1 s" in found.fix


def test_of_currents_in_phases_the_phases_are_named(drawn):
    run = drawn[1]
    phases = {f"i_{phase}": in_phases(run).channels[f"i_{phase}"] for phase in "abc"}
    turned = without(changed(run, **phases), "i_d", "i_q")
    counted = scaled(turned, -1.0, "i_a", "i_b", "i_c")
    (found,) = check_conventions(counted).broken
    assert found.fix.startswith("give i_a, i_b and i_c sign = -1")
    assert "Values of u_d and u_q are taken as peak" in check_conventions(turned).undetermined[-1]


def test_rms_shows_against_a_name_plate_or_phases_and_not_without(drawn):
    machine, run = drawn
    plate = NamePlate(machine.magnet_flux_linkage, machine.resistance)
    root = 2**-0.5
    for names, word in ((("u_d", "u_q"), "voltages"), (("i_d", "i_q"), "currents")):
        rms = scaled(run, root, *names)
        assert names_of(rms, None, plate) == [f"rms for peak ({word})"]
        assert not any("name plate;" in s for s in check_conventions(rms, None, plate).undetermined)
        assert names_of(changed(rms, **in_phases(run).channels)) == [f"rms for peak ({word})"]
        alone = check_conventions(rms)
        assert alone.broken == ()
        assert "Values are taken as peak" in alone.undetermined[-1]
        (given,) = check_conventions(scaled(run, 1 / root, *names), None, plate).broken
        assert given.name == f"peak for rms ({word})"
        assert given.fix.startswith(f"remove rms = true from {' and '.join(names)} where")
        assert "correct the name plate" in given.fix
    both = scaled(run, root, "u_d", "u_q", "i_d", "i_q")
    assert names_of(both, None, plate) == ["rms for peak (voltages)", "rms for peak (currents)"]
    evidence = check_conventions(both, None, plate).broken[1].evidence
    assert evidence.endswith("and 0.71 times where the voltages alone are wrong")
    both = scaled(scaled(run, root, "u_d", "u_q"), 1 / root, "i_d", "i_q")
    assert names_of(both, None, plate) == ["rms for peak (voltages)", "peak for rms (currents)"]


@pytest.mark.parametrize("samples", [1, -1])
def test_one_sample_delay(drawn, samples):
    run = drawn[1]
    (found,) = check_conventions(shifted(run, samples, "u_d", "u_q")).broken
    assert found.name == "one-sample delay"
    assert found.fix.endswith(f"delay = {samples}")
    late = shifted(in_phases(run), samples, "u_a", "u_b", "u_c")
    assert names_of(late) == ["one-sample delay"]


def test_exchanged_channels(drawn):
    run = drawn[1]
    assert names_of(exchanged(run, "i_d", "i_q")) == ["exchanged currents"]
    assert names_of(exchanged(run, "u_d", "u_q")) == ["exchanged voltages"]
    both = exchanged(exchanged(run, "i_d", "i_q"), "u_d", "u_q")
    assert names_of(both) == ["exchanged axes"]


@pytest.mark.parametrize("kinds", ["i", "u", "ui"])
def test_phases_exchanged_before_dq_was_made(drawn, kinds):
    """What is logged in dq still shows it, where the angle is logged beside."""
    theta = drawn[1].channels["theta_el"]
    run = exchanged(in_phases(drawn[1]), f"{kinds[0]}_a", f"{kinds[0]}_b")
    if kinds == "ui":
        run = exchanged(run, "i_a", "i_b")
    dq = {"theta_el": theta, "omega_el": drawn[1].channels["omega_el"]}
    for kind in "ui":
        three = run.stack([f"{kind}_{phase}" for phase in "abc"])
        dq[f"{kind}_d"], dq[f"{kind}_q"] = dq_from_abc(three, theta).T
    (found,) = check_conventions(replace(run, channels=dq)).broken
    assert found.name == "swapped phases"
    assert "phases a and b of the" in found.fix


@pytest.mark.parametrize("of_shaft", [False, True])
def test_wrong_pole_pairs_without_an_angle(drawn, of_shaft):
    """One pole pair too few, of a speed of the shaft or not; a delay is not claimed beside."""
    machine, run = drawn
    taken = machine.pole_pairs - 1
    wrong = without(scaled(run, taken / machine.pole_pairs, "omega_el"), "theta_el")
    found = check_conventions(wrong, taken, of_shaft=("omega_el",) if of_shaft else ())
    if machine.name == "traction_300A":  # too slow: dead time and delay explain as much
        assert found.broken == () or found.broken[0].name == "wrong pole pairs"
        return
    assert [b.name for b in found.broken][:1] == ["wrong pole pairs"]
    number = f"pole_pairs = {machine.pole_pairs}" if of_shaft else f"with {machine.pole_pairs} pole"
    assert number in found.broken[0].fix


@pytest.mark.parametrize("speed_rpm", [700.0, 1500.0])
def test_poles_for_pole_pairs_without_an_angle(speed_rpm):
    """The harmonics of the right speed, which is lower, stay out of the trial."""
    machine, shaft = COMSOL_300A, ("omega_el",)
    slow = Lissajous(150.0, 9.0, 10.0)
    run = without(simulate(machine, slow, speed_rpm=speed_rpm, duration=1.0, seed=4), "theta_el")
    pairs = machine.pole_pairs
    assert check_conventions(run, pairs, of_shaft=shaft).broken == ()
    (found,) = check_conventions(scaled(run, 2.0, "omega_el"), 2 * pairs, of_shaft=shaft).broken
    assert found.fix == f"give pole_pairs = {pairs} in place of {2 * pairs}"


def test_pole_pairs_and_a_unit_that_are_as_good_are_both_named():
    """Small currents in noise hardly tell 8 pole pairs from rpm for rad/s, which is 9.5 times."""
    small = Lissajous(0.02 * BRUSA_250A.current_limit, 14.0, 15.0)
    noisy = Drive(current_noise=0.5)
    run = simulate(BRUSA_250A, small, speed_rpm=600.0, duration=0.3, drive=noisy, seed=4)
    wrong = without(scaled(run, 2 * np.pi / 60, "omega_el"), "theta_el")
    (found,) = check_conventions(wrong).broken
    assert found.name == "mechanical speed for electrical"
    assert found.fix.endswith('; or give omega_el unit = "rad/s", which is as good')


def test_a_phase_that_is_still_at_standstill_is_none_in_another_unit():
    """Current along q at an angle of zero: phase a has none."""
    current = np.sin(np.arange(100.0))
    channels = {"i_a": 0 * current, "i_b": current, "i_c": -current, "omega_el": 0 * current}
    assert find_uneven_phases(Experiment("still", 1e-4, channels)) is None
    turning = Experiment("turning", 1e-4, {**channels, "omega_el": 500 + 0 * current})
    assert find_uneven_phases(turning).channels == ("i_a", "i_b", "i_c")


@pytest.mark.parametrize("kind", "iu")
def test_a_phase_in_another_unit_is_named(drawn, kind):
    wrong = scaled(in_phases(drawn[1]), 1e-3, f"{kind}_a")
    (found,) = check_conventions(wrong).broken
    assert found.name == "different units of phases"
    assert f"{kind}_a" in found.fix
    assert f"{kind}_a reaches" in found.evidence


@pytest.mark.parametrize("name", ["winding_temperature", "magnet_temperature"])
@pytest.mark.parametrize("kelvin", [-212.0, 600.0])
def test_a_temperature_that_no_machine_has_is_named(drawn, name, kelvin):
    usual = changed(drawn[1], **{name: np.full(len(drawn[1]), 60.0)})
    assert check_conventions(usual).broken == ()
    (found,) = check_conventions(changed(usual, **{name: np.full(len(usual), kelvin)})).broken
    assert found.channels == (name,)
    assert '"degC", "K"' in found.fix


def test_signs_are_named_beside_the_most_pole_pairs(drawn):
    """With 24 every other factor of the speed is below one."""
    turned = scaled(drawn[1], -1.0, "i_q")
    found = check_conventions(turned, 24, of_shaft=("omega_el",)).broken
    assert [one.name for one in found] == ["negative q current"]


@pytest.mark.parametrize(("factor", "unit"), [(2 * np.pi / 60, "rad/s"), (60 / (2 * np.pi), "rpm")])
def test_a_unit_of_the_speed_that_no_angle_shows_is_named(drawn, factor, unit):
    """Alone, and beside a sign: at once, or after that is set right."""
    wrong = without(scaled(drawn[1], factor, "omega_el"), "theta_el")
    (found,) = check_conventions(wrong).broken
    assert f'give omega_el unit = "{unit}"' in found.fix
    (both,) = check_conventions(scaled(wrong, -1.0, "i_q")).broken
    together = f'give omega_el unit = "{unit}", and give i_q sign = -1'
    assert both.fix.startswith((together, "give i_q sign = -1"))


def test_a_speed_at_the_end_of_the_range_is_not_determined():
    """Harmonics that are sampled rarely are smaller, the larger the speed is taken for."""
    run = simulate(
        TRACTION_300A, Lissajous(150.0, 9.0, 10.0), speed_rpm=3000.0, duration=1.0, seed=4
    )
    doubled = without(scaled(run, 2.0, "omega_el"), "theta_el")
    found = check_conventions(doubled, 2 * TRACTION_300A.pole_pairs, of_shaft=("omega_el",))
    assert found.broken == ()
    assert "without theta_el neither the pole pairs" in found.undetermined[0]


def test_pole_pairs_that_slow_currents_do_not_show_are_said_to_be_undetermined():
    drive = Drive(inverter=Inverter(dead_time=DeadTime(1.0e-6)), current_noise=0.5)
    slow = Lissajous(150.0, 9.0, 10.0)
    run = simulate(TRACTION_300A, slow, speed_rpm=2000.0, duration=1.0, drive=drive, seed=3)
    found = check_conventions(without(run, "theta_el"))
    assert found.broken == ()
    assert "without theta_el neither the pole pairs that omega_el" in found.undetermined[0]
    assert not any("pole pairs" in sentence for sentence in check_conventions(run).undetermined)
    assert judge([without(run, "theta_el")])[1] == AS_RECORDED


@pytest.mark.parametrize("what", ["noise", "currents of another recording"])
def test_what_is_no_synchronous_machine(drawn, what):
    random, run = np.random.default_rng(1), drawn[1]
    currents = run.stack(("i_d", "i_q"))
    other = currents[::-1] if what != "noise" else 50.0 * random.normal(size=currents.shape)
    (found,) = check_conventions(changed(run, i_d=other[:, 0], i_q=other[:, 1])).broken
    assert found.name == "no synchronous machine"


def test_a_delay_that_feedback_of_noise_imitates_is_not_claimed():
    """Currents are nearly at rest, so that the voltage is mostly the answer to their noise."""
    drive = Drive(current_noise=1.0, tuning=1.0)
    quiet = Lissajous(15.0, 6.0, 7.0)
    run = simulate(TRACTION_300A, quiet, speed_rpm=400.0, duration=0.5, drive=drive, seed=1)
    assert imitated_lag([run], harmonic_window) > 1.0
    found, _, why = judge_delay([run], in_phases=False)
    assert found is None
    assert "training refuses them if they stand a whole sample off" in why
    calibration = judge([run])[1]
    assert calibration["delay"] == 0.0


@pytest.mark.parametrize(("made", "given"), [("dq", "stationary"), ("stationary", "dq")])
def test_a_hold_that_the_recording_contradicts_is_named(made, given):
    inverter = Inverter(hold=RotorHold() if made == "dq" else StationaryHold())
    drive = Drive(current_noise=0.1, inverter=inverter)
    run = simulate(
        TRACTION_300A, Lissajous(150.0, 17.0, 11.0), speed_rpm=1500.0, duration=0.5, drive=drive
    )
    found, calibration = judge([run], hold=given)
    (broken,) = found.broken
    assert broken.name == "frame of the hold"
    assert (
        f"as held in the {made} frame, and the study file has hold = {given!r}" in broken.evidence
    )
    assert calibration.drive.hold == given
    for hold in (made, None):
        found, calibration = judge([run], hold=hold)
        assert found.broken == ()
        assert calibration.drive.hold == made


@pytest.mark.parametrize(
    ("turned", "hold", "broken"),
    [
        ((-0.5, 0.01), "dq", True),
        ((0.5, 0.01), "dq", True),  # a whole sample of rotation ahead is no frame
        ((0.02, 0.01), "stationary", True),
        ((0.02, 0.01), "dq", False),
        ((-0.5, 0.11), "dq", False),
        ((-0.5, 0.09), "dq", True),
        (None, "stationary", False),
    ],
)
def test_a_hold_is_contradicted_by_five_deviations_of_the_turn(slow_run, turned, hold, broken):
    found = judge_hold([slow_run], hold, Calibration(turned=turned))
    assert (found is not None) == broken


@pytest.mark.parametrize(("lag", "side"), [(1.4, "late"), (-1.4, "early")])
def test_a_lag_of_no_whole_number_is_said_to_be_none(slow_run, monkeypatch, lag, side):
    monkeypatch.setattr(balance, "mean_lag", lambda *_: (lag, 0.02))
    found, _, why = judge_delay([slow_run], in_phases=False)
    assert found is None
    assert f"as 1.4 ± 0.039 samples {side}, which is no whole number" in why


def test_reversed_speed(drawn):
    run = scaled(drawn[1], -1.0, "omega_el")
    assert names_of(run) == ["reversed speed"]
    assert names_of(without(run, "theta_el")) == ["reversed speed"]


def test_degrees_for_radians(drawn):
    run = drawn[1]
    degrees = np.degrees(run.channels["theta_el"])
    assert names_of(changed(run, theta_el=degrees)) == ["degrees for radians"]
    assert names_of(changed(in_phases(run), theta_el=degrees)) == ["degrees for radians"]
    counted_on = np.degrees(np.unwrap(run.channels["theta_el"]))
    assert names_of(changed(run, theta_el=counted_on)) == ["degrees for radians"]


@pytest.mark.parametrize("offset", [20.0, -90.0])
def test_offset_angle(drawn, offset):
    run = in_phases(drawn[1])
    aside = changed(run, theta_el=run.channels["theta_el"] + np.radians(offset))
    (found,) = check_conventions(aside).broken
    assert found.name == "offset angle"
    told = float(found.fix.removeprefix("subtract ").split()[0])
    assert told == pytest.approx(offset, abs=2.0)


def test_scales(drawn):
    run = drawn[1]
    assert names_of(scaled(run, 1e-3, "i_d", "i_q")) == ["kA for A"]
    (found,) = check_conventions(scaled(run, 1 / 400, "u_d", "u_q")).broken
    assert found.name == "duty for volts"
    assert "u_base, what 1 is in V" in found.fix


def test_currents_counted_out_of_the_machine(drawn):
    run = scaled(drawn[1], -1.0, "i_d", "i_q")
    assert names_of(run) == ["currents counted out of the machine"]


def test_two_errors_are_both_named(drawn):
    run = drawn[1]
    wrong = scaled(changed(run, theta_el=np.degrees(run.channels["theta_el"])), -1.0, "i_q")
    assert names_of(wrong) == ["degrees for radians", "negative q current"]


def test_a_delay_that_does_not_show_is_said_to_be_untold():
    drive = Drive(inverter=Inverter(dead_time=DeadTime(1.4e-6)), current_noise=0.3)
    reference = Lissajous(120.0, 11.0, 12.0)
    run = simulate(TRACTION_300A, reference, speed_rpm=300.0, duration=0.5, drive=drive)
    found = check_conventions(run)
    assert found.broken == ()
    assert any("shows the instant of the voltages to ±" in one for one in found.undetermined)
    recorded = [check._as_recorded(run, OfShaft())]
    for known in (True, False):
        said = check._placed(recorded, NO_PLATE, known=known).undetermined
        assert any("the instant of the voltages" in one for one in said) != known


@pytest.mark.parametrize("count", [8, 9, 15])
def test_a_recording_shorter_than_a_window_leaves_the_delay_untold(slow_run, count):
    """Eight samples are the fewest that are read."""
    channels = {name: values[:count] for name, values in slow_run.channels.items()}
    found = check_conventions(replace(slow_run, channels=channels))
    assert f"cannot be determined from {count} samples" in " ".join(found.undetermined)


@pytest.mark.parametrize(("lag", "deviation", "late"), [(0.7, 0.19, False), (0.7, 0.1, True)])
def test_a_delay_is_named_from_five_deviations(slow_run, monkeypatch, lag, deviation, late):
    module = "penode.pmsm.conventions.balance.mean_lag"
    monkeypatch.setattr(module, lambda run, in_phases: (lag, deviation))
    found, _, why = judge_delay([slow_run], False)
    assert (found is not None) == late
    assert why == ""


# --- an angle in steps --------------------------------------------------------------------------


def hall(run: Experiment, unit: float = 1.0) -> Experiment:
    """Return phases, and the angle of three Hall sensors: the middle of one of six sectors."""
    theta, sector = run.channels["theta_el"], np.pi / 3
    channels = {"theta_el": unit * (np.floor(theta / sector) + 0.5) * sector}
    for kind in "ui":
        phases = abc_from_dq(run.stack((f"{kind}_d", f"{kind}_q")), theta).T
        channels |= {f"{kind}_{name}": values for name, values in zip("abc", phases, strict=True)}
    return replace(run, channels=channels)


@pytest.mark.parametrize("unit", [1.0, 180.0 / np.pi])
def test_the_angle_of_hall_sensors_is_refused_by_name(drawn, unit):
    _, run = drawn
    (found,) = check_conventions(hall(run, unit)).broken
    assert found.name == "stepped angle"
    assert "the angle takes 6 values only" in found.evidence
    beside = changed(run, theta_el=hall(run).channels["theta_el"])
    assert [b.name for b in check_conventions(beside).broken] == ["stepped angle"]


@pytest.mark.slow
def test_the_verdict_on_hall_sensors_is_that_name(unseen_run):
    study = Study(horizon=1, candidates=(), angle_orders=(), hold="dq", train_anyway=True)
    assert [b.name for b in judge([hall(unseen_run)], **study.conventions)[0].broken] == [
        "stepped angle"
    ]
    fit = identify([hall(unseen_run)], study=study)
    assert not fit.horizon.answered
    assert fit.horizon.objections[0].name == "stepped angle"


def test_angles_of_few_values_that_do_not_jump_are_left_alone(drawn):
    """A rotor at rest between two values of its encoder, and samples in step with the turn."""
    _, run = drawn
    count = len(run)
    random = np.random.default_rng(0)
    for theta in (
        np.where(random.random(count) < 0.1, 0.5, 0.501),
        0.5 + 0.001 * random.integers(0, 4, count),
        np.round(2 * np.pi * (np.arange(count) % 20) / 20, 6),
    ):
        assert find_stepped_angle(changed(run, theta_el=theta)) is None


@pytest.mark.parametrize("name", ["u_d", "u_q", "i_d", "i_q"])
@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_one_axis_in_another_unit(drawn, name, factor):
    found, *larger = check_conventions(scaled(drawn[1], factor, name)).broken
    kind = "currents" if name[0] == "i" else "voltages"
    assert found.name == f"different units ({kind})"
    assert {one.name for one in larger} <= {f"{kind} beyond any drive"}
    small = name if factor < 1 else name[:2] + ("q" if name[2] == "d" else "d")
    assert f"{small} is 1000 times too small" in found.fix


def test_the_unit_of_an_axis_is_asked_where_it_is_much_smaller(drawn):
    assert not any(cure.name.startswith("different units") for cure in _scales(drawn[1]))
    (found,) = (c for c in _scales(scaled(drawn[1], 1e-3, "u_d")) if c.name.startswith("different"))
    assert found.fix.startswith("give u_d and u_q the units")


@pytest.mark.parametrize("name", ["u_d", "u_q", "i_d", "i_q"])
def test_one_axis_in_rms(name):
    run = simulate(
        TRACTION_300A, Lissajous(180.0, 12.0, 15.0), speed_rpm=900.0, duration=1.0, seed=4
    )
    (found,) = check_conventions(scaled(run, 0.5**0.5, name)).broken
    assert found.name.startswith("rms beside peak")
    assert found.fix.startswith(f"give {name} rms = true")


def test_values_beyond_any_drive(drawn):
    found = check_conventions(scaled(drawn[1], 1e3, "i_d", "i_q")).broken
    assert [one.name for one in found] == ["currents beyond any drive"]
    assert '"A" where the study file has "kA"' in found[0].fix
