"""Samples at the voltage limit: found by what acts, left out, and what lies between them is used.

The bench logs what acts. What its controller asked for is computed anew here, from the log, by the
controller's law with back-calculation, and checked by limiting it again.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

from penode.bench import run as bench_run
from penode.bench.drive import Drive
from penode.bench.inverter import Circle, Hexagon, Inverter
from penode.bench.machines import TRACTION_300A
from penode.bench.run import simulate
from penode.errors import InputError
from penode.pmsm.balance.usable import usable_stretches
from penode.pmsm.balance.voltage_limit import below_limit
from penode.pmsm.machine.frames import abc_from_dq
from penode.pmsm.recording_check import check_recordings
from penode.pmsm.study import identify
from penode.pmsm.study_settings import Study

LINK = 150.0
VOLTAGES, CURRENTS = ("u_d", "u_q"), ("i_d", "i_q")
R = TRACTION_300A.resistance


def steps(time):
    """Return another point of the disc of 240 A every 30 ms, and a ripple around it."""
    levels = np.random.default_rng(1).uniform(-1.0, 1.0, (100, 2))
    levels /= np.maximum(np.hypot(*levels.T), 1.0)[:, None]
    ripple = 40.0 * np.stack([np.sin(2 * np.pi * 37.0 * time), np.sin(2 * np.pi * 43.0 * time)], 1)
    return 240.0 * levels[(time / 0.03).astype(int)] + ripple


def asked(run, drive):
    """Return the voltages (time, 2) that the bench's controller asked for."""
    inductance = drive.tuning * np.array([TRACTION_300A.inductance_d, TRACTION_300A.inductance_q])
    gain, magnet = 2.0 * drive.bandwidth * inductance, [TRACTION_300A.magnet_flux_linkage, 0.0]
    currents, acting = run.stack(CURRENTS), run.stack(VOLTAGES)
    psi = inductance * currents + magnet
    induced = run.channels["omega_el"][:, None] * np.stack([-psi[:, 1], psi[:, 0]], axis=1)
    error = steps(run.time_step * np.arange(len(run))) - currents
    wanted, integral = np.empty_like(acting), np.zeros(2)
    for k in range(len(run)):
        wanted[k] = gain * error[k] + integral + induced[k]
        back = (acting[k] - wanted[k]) / gain
        integral += run.time_step * drive.bandwidth**2 * inductance * (error[k] + back)
    return wanted


def logged(inverter):
    """Return a recording as it acts, and as it is commanded, with u_dc."""
    drive = Drive(current_noise=0.3, dc_voltage=LINK, inverter=inverter)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bench_run, "_SATURATED_SHARE", 1.0)
        run = simulate(TRACTION_300A, steps, speed_rpm=1500.0, duration=1.5, drive=drive, seed=1)
    run = replace(run, channels={**run.channels, "u_dc": np.full(len(run), LINK)})
    u_d, u_q = asked(run, drive).T
    return run, replace(run, channels={**run.channels, "u_d": u_d, "u_q": u_q})


@pytest.fixture(scope="module")
def circle():
    return logged(Inverter(limit=Circle()))


def limited(acting, command):
    """Return at which samples the command is not what acts."""
    apart = np.abs(acting.stack(VOLTAGES) - command.stack(VOLTAGES)).max(axis=1)
    return apart > 1e-6 * LINK


def rows(stretches):
    return np.concatenate([e.place.row + np.arange(len(e)) for e in stretches])


def test_the_command_limited_again_is_what_acts(circle):
    acting, command = circle
    length = np.hypot(*command.stack(VOLTAGES).T)
    factor = np.minimum(1.0, LINK / np.sqrt(3.0) / length)[:, None]
    np.testing.assert_allclose(factor * command.stack(VOLTAGES), acting.stack(VOLTAGES), atol=1e-9)
    assert 0.05 < limited(acting, command).mean() < 0.2


@pytest.mark.parametrize(
    "inverter",
    [
        pytest.param(Inverter(limit=Circle()), marks=pytest.mark.slow),
        pytest.param(Inverter(limit=Circle(), delay=1), marks=pytest.mark.slow),
        Inverter(limit=Hexagon()),
    ],
    ids=["circle", "a sample late", "hexagon"],
)
def test_all_that_did_not_act_is_left_out_and_counted(inverter):
    acting, command = logged(inverter)
    used = below_limit([command])
    beyond = limited(acting, command)
    assert not beyond[rows(used)].any()
    left_out = len(command) - len(rows(used))
    assert left_out < 0.4 * len(command)
    (sentence,) = {reason for e in used for reason in e.place.reasons}
    counted, other = (int(sentence.split(w)[0].split()[-1]) for w in (" of 15000", " samples betw"))
    assert counted + other == left_out
    assert beyond.sum() <= counted < beyond.sum() + 0.05 * len(command)
    assert f"{len(used)} stretches are used" in sentence


def test_what_acts_at_the_limit_stays(circle):
    acting, _ = circle
    assert below_limit([acting]) == [acting]
    assert usable_stretches([acting]) == (acting,)


def test_a_limit_below_that_of_the_inverter_is_found(circle):
    """With 15 % more dc link the same limiter keeps to half of it."""
    _, command = circle
    higher = np.full(len(command), LINK * 2.0 / np.sqrt(3.0))
    used = below_limit([replace(command, channels={**command.channels, "u_dc": higher})])
    assert re.search(r"at the voltage limit, 0\.(49|50) of u_dc", used[0].place.reasons[0])


def test_phases_are_looked_at_in_dq(circle):
    _, command = circle
    theta = command.channels["theta_el"]
    u_a, u_b, u_c = abc_from_dq(command.stack(VOLTAGES), theta).T
    kept = {name: command.channels[name] for name in (*CURRENTS, "omega_el", "theta_el", "u_dc")}
    phases = replace(command, channels={**kept, "u_a": u_a, "u_b": u_b, "u_c": u_c})
    np.testing.assert_array_equal(rows(below_limit([phases])), rows(below_limit([command])))


def test_the_limit_and_gaps_are_one_mechanism(circle):
    _, command = circle
    halves = [command.between(0, 7000, "A gap."), command.between(8000, 15000, "A gap.")]
    used = below_limit(halves)
    assert set(rows(used)) <= set(rows(halves))
    assert all(e.place.reasons[0] == "A gap." and len(e.place.reasons) == 2 for e in used)


STUDY = Study(horizon=1, candidates=(), angle_orders=())


@pytest.mark.slow
def test_resistance_is_right_without_the_samples_at_the_limit(circle):
    _, command = circle
    fit = identify([command], study=STUDY)
    low, high = fit.parameters["R"].interval_95
    assert fit.horizon.answered
    assert fit.horizon.objections == ()
    assert low < R < high
    assert high - low < 0.1 * R
    assert "are at the voltage limit, 0.57 of u_dc" in fit.provenance["structure"][0]
    left = len(command) - sum(len(c.measured) for c in fit.comparisons)
    assert fit.horizon.reason.endswith(f"{left} of 15000 samples were left out.")


def test_without_the_dc_link_it_is_refused_and_the_limiter_named(circle):
    _, command = circle
    blind = {name: values for name, values in command.channels.items() if name != "u_dc"}
    with pytest.raises(InputError, match="from before the voltage limiter \\(with u_dc"):
        identify([replace(command, channels=blind)], study=STUDY)


def test_a_check_says_how_many(circle):
    _, command = circle
    found = check_recordings([command])
    assert "are at the voltage limit, 0.57 of u_dc" in found.sentences[0]
    assert found.good
    assert found.verdict.endswith(" of 15000 samples were left out.")
