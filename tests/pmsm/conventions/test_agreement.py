"""Recordings of one machine: those in another state are named, other speeds and drives are not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from penode.bench.drive import DEFAULT_DRIVE
from penode.bench.inverter import DeadTime, Inverter
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.bench.winding import IronLoss, Winding
from penode.pmsm.conventions.agreement import _differences, disagreement_of
from penode.pmsm.machine.term_registry import TERMS
from penode.pmsm.recording.channels import drive_recording

DEAD = Inverter(dead_time=DeadTime(7e-7))


@cache
def recorded(name, temperature=20.0, rpm=600.0, machine=TRACTION_300A, **drive):
    """Return a recording of half a second, winding and magnets at one temperature."""
    asked = {"winding": Winding(temperature=temperature), "magnet_temperature": temperature}
    drive = replace(DEFAULT_DRIVE, current_noise=0.2, **{**asked, **drive})
    seed = sum(map(ord, name))
    run = simulate(
        machine, Lissajous(150, 60, 65), speed_rpm=rpm, duration=0.5, drive=drive, seed=seed
    )
    return replace(drive_recording(run), name=name)


def number_before(unit, text):
    return float(text.split(f" {unit}")[0].split()[-1])


@pytest.mark.parametrize("rpm", [600.0, pytest.param(-1500.0, marks=pytest.mark.slow)])
def test_a_warmer_recording_is_named_with_both_temperatures(rpm):
    """Copper +0.39 %/K and these magnets -0.11 %/K, of which -0.1 %/K is assumed."""
    cold, hot = recorded("cold.csv"), recorded("hot.csv", 80.0, rpm)
    (found,) = disagreement_of([cold, hot])
    assert found.recording == "hot.csv"
    evidence = found.evidence
    assert number_before("K warmer and of magnets", evidence) == pytest.approx(60, abs=15)
    assert number_before("K warmer", evidence.split("magnets")[-1]) == pytest.approx(66, abs=3)
    assert "mΩ in cold.csv" in evidence
    assert "identify them one by one" in found.sentence
    if rpm == 600.0:
        assert float(evidence.split()[2]) == pytest.approx(10 * (1 + 0.0039 * 60), rel=0.01)


def test_a_colder_one_is_colder():
    (found,) = disagreement_of([recorded("hot.csv", 80.0), recorded("cold.csv")])
    assert found.recording == "cold.csv"
    assert "K colder" in found.evidence
    assert "warmer" not in found.evidence


@pytest.mark.slow
def test_of_several_those_that_differ_from_the_first_are_named():
    runs = [recorded("a.csv"), recorded("b.csv"), recorded("c.csv", 50.0), recorded("d.csv")]
    assert [found.recording for found in disagreement_of(runs)] == ["c.csv"]


def test_five_kelvin_are_no_disagreement():
    assert disagreement_of([recorded("a.csv"), recorded("b.csv", 25.0)]) == ()


@pytest.mark.parametrize(
    "rpm", [-300.0, *(pytest.param(rpm, marks=pytest.mark.slow) for rpm in (200.0, 1800.0))]
)
def test_another_speed_behind_dead_time_is_no_disagreement(rpm):
    runs = [recorded("a.csv", inverter=DEAD), recorded("b.csv", rpm=rpm, inverter=DEAD)]
    assert disagreement_of(runs) == ()


@pytest.mark.parametrize(
    ("first", "other", "here", "there"),
    [
        ("compensated.csv", "plain.csv", 3, 0),
        ("plain.csv", "compensated.csv", 0, 3),
    ],
)
def test_voltages_of_which_one_is_compensated_are_named(first, other, here, there):
    """By what a phase has of 400 V for 0.7 us of each 100 us; the mean is of all currents."""
    runs = [recorded(n, inverter=DEAD) if n == "plain.csv" else recorded(n) for n in (first, other)]
    (found,) = disagreement_of(runs)
    assert found.recording == other
    assert float(found.evidence.split()[3]) == pytest.approx(here, abs=0.4)
    assert float(found.evidence.split(f"of {first} ")[1].split()[0]) == pytest.approx(
        there, abs=0.4
    )
    assert "only one of them were compensated" in found.evidence
    assert "log all voltages at one point" in found.sentence


def test_little_dead_time_beside_the_drop_in_r_is_no_disagreement():
    """0.04 V of 400 V for 0.01 us, 17 deviations, where R drops 1.6 V."""
    little = Inverter(dead_time=DeadTime(1e-8))
    runs = [recorded("a.csv"), recorded("b.csv", inverter=little)]
    assert disagreement_of(runs) == ()
    (_, _, dead_time) = _differences(runs)[0]
    assert abs(dead_time.value) > 6 * dead_time.deviation


def test_iron_loss_at_another_speed_is_no_temperature():
    """R is 86 % larger there, nine deviations."""
    iron = IronLoss(10.0)
    slow, fast = (recorded(f"{n}.csv", rpm=n, iron_loss=iron) for n in (300.0, 2000.0))
    assert disagreement_of([slow, fast]) == ()


def test_another_machine_is_not_called_warm():
    other = recorded("other.csv", machine=replace(TRACTION_300A, resistance=0.02))
    (found,) = disagreement_of([recorded("a.csv"), other])
    assert "which no temperature explains: another machine" in found.evidence


def test_nothing_is_compared_where_a_term_follows_the_temperature():
    runs = [recorded("cold.csv"), recorded("hot.csv", 80.0)]
    assert disagreement_of(runs, (TERMS["temperature_resistance"](),)) == ()


def test_one_recording_and_its_stretches_are_not_compared():
    run = recorded("a.csv")
    assert disagreement_of([run]) == ()
    assert disagreement_of([run.between(0, 2500), run.between(2500, 5000)]) == ()


def test_of_stretches_the_longest_is_compared_and_the_recording_named():
    hot = recorded("hot.csv", 80.0)
    (found,) = disagreement_of([recorded("a.csv"), hot.between(0, 600), hot.between(700, 5000)])
    assert found.recording == "hot.csv"


def test_at_standstill_nothing_is_compared():
    still = recorded("still.csv", 80.0)
    still = replace(still, channels={**still.channels, "omega_el": np.zeros(len(still))})
    assert disagreement_of([recorded("a.csv"), still]) == ()
