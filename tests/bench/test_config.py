"""Simulations as TOML files."""

import numpy as np
import pytest

from penode.bench.config import KINDS, load_config, shipped_configs
from penode.bench.inverter import StationaryHold
from penode.bench.machines import MACHINES
from penode.bench.references import GENERATOR, MOTOR, WHOLE_DISC
from penode.bench.shaft import FreeShaft, SpeedPoints, SpeedRipple
from penode.errors import InputError

MINIMAL = """
machine = "traction_300A"
speed_rpm = 900.0
duration = 0.01
[reference]
kind = "lissajous"
amplitude = 100.0
rate_d = 140.0
rate_q = 150.0
"""


@pytest.fixture
def load(tmp_path):
    def write_and_load(text):
        path = tmp_path / "case.toml"
        path.write_text(text)
        return load_config(path)

    return write_and_load


def test_shipped_configurations_are_the_papers():
    assert set(shipped_configs()) == {"paper_simulation", "paper_testbench", "well_designed"}
    slow = load_config("paper_simulation")
    assert (slow.speed_rpm, slow.duration, slow.drive.time_step) == (1500.0, 2.0, 1e-4)
    assert (slow.reference.rate_d, slow.reference.rate_q) == (14.0, 15.0)
    rough = load_config("paper_testbench")
    assert (rough.speed_rpm.rpm, rough.duration) == (1000.0, 6.0)
    assert rough.reference.rate_d == pytest.approx(49 / 12)
    assert rough.reference.rate_q == pytest.approx(50 / 12)
    for part in (rough.drive.current_sensors, rough.drive.resolver, rough.drive.speed_sensor):
        assert part is not None
    assert rough.drive.inverter.dead_time is not None


def test_what_is_found_in_an_imported_map_is_told(load, tmp_path):
    axis = np.linspace(-200.0, 200.0, 21)
    i_d, i_q = (a.ravel() for a in np.meshgrid(axis, axis, indexing="ij"))
    text = MINIMAL.replace(
        '"traction_300A"', "{ map = 'm.csv', resistance = 0.01, pole_pairs = 4 }"
    )
    for skew, told in ((0.0, False), (3e-5, True)):  # H: the second map is no gradient
        psi = (0.05 + 2e-4 * i_d + skew * i_q, 4e-4 * i_q - skew * i_d)
        table = np.column_stack([i_d, i_q, *psi])
        header = "i_d,i_q,psi_d,psi_q"
        np.savetxt(tmp_path / "m.csv", table, delimiter=",", header=header, comments="")
        simulation = load(text)
        assert any("recipro" in warning for warning in simulation.warnings) == told


def test_nothing_more_than_asked_for_is_set(load):
    simulation = load(MINIMAL)
    assert simulation.machine is MACHINES["traction_300A"]
    assert simulation.drive.inverter.dead_time is None
    assert simulation.drive.current_sensors is None


def test_kinds_nest(load):
    text = MINIMAL + 'domain = "motor"\n[drive.inverter.hold]\nkind = "stationary"\nadvance = 1.5\n'
    simulation = load(text)
    assert simulation.reference.domain == MOTOR
    assert isinstance(simulation.drive.inverter.hold, StationaryHold)
    assert simulation.drive.inverter.hold.advance == 1.5


@pytest.mark.parametrize(
    ("text", "speed"),
    [
        ("1200", 1200.0),
        (
            "{ kind = 'points', times = [0, 1], rpm = [-9, 9] }",
            SpeedPoints((0.0, 1.0), (-9.0, 9.0)),
        ),
        (
            "{ kind = 'ripple', rpm = 600, orders = [[1, 0.01, 0.5], [2, 0.001, 0]] }",
            SpeedRipple(600.0, ((1.0, 0.01, 0.5), (2.0, 0.001, 0.0))),
        ),
        ("{ kind = 'free', inertia = 0.02, start_rpm = 50 }", FreeShaft(0.02, start_rpm=50.0)),
    ],
)
def test_a_speed_is_a_number_or_one_of_its_kinds(load, text, speed):
    found = load(MINIMAL.replace("speed_rpm = 900.0", f"speed_rpm = {text}")).speed_rpm
    assert type(found) is type(speed)
    assert found == speed


@pytest.mark.parametrize(
    ("name", "domain"), [("whole", WHOLE_DISC), ("motor", MOTOR), ("generator", GENERATOR)]
)
def test_domains_go_by_their_names(load, name, domain):
    assert load(MINIMAL + f'domain = "{name}"\n').reference.domain is domain


def test_the_same_file_records_the_same_run(load):
    text = MINIMAL.replace("duration", "seed = 5\nduration") + "[drive]\ncurrent_noise = 0.3\n"
    one, two = load(text).record().experiment, load(text).record().experiment
    assert one.source.sha256 == two.source.sha256
    other = load(text.replace("seed = 5", "seed = 6")).record().experiment
    assert other.source.sha256 != one.source.sha256


@pytest.mark.parametrize("choices", KINDS.values(), ids=lambda c: "-".join(c))
def test_every_kind_can_be_called(choices):
    assert all(callable(make) for make in choices.values())


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("amplitude = 100.0", "amplitude = true", "amplitude"),
        ("amplitude = 100.0", 'amplitude = "a"', "amplitude"),
        ("[reference]", "[reference.x]", "reference"),
        ("speed_rpm = 900.0", "", "speed_rpm is missing"),
        ('machine = "traction_300A"', "", "machine"),
        ('machine = "traction_300A"', "machine = { map = 'gone.csv' }", "resistance"),
        ("duration = 0.01", "duration = 0.01\n[drive]\ndc = 3.0\n", "dc_voltage"),
        (
            "duration = 0.01",
            "duration = 0.01\nseed = -1",
            "case.toml: seed must be a whole number >= 0, got -1",
        ),
        ("amplitude = 100.0", "amplitude = [100.0]", r"reference\.amplitude"),
        (
            "duration = 0.01",
            "duration = [0.01]",
            r"duration must be a finite number, got \[0\.01\]",
        ),
        ("duration = 0.01", "duration = inf", "duration must be a finite number, got inf"),
        ("duration = 0.01", "duration = { x = 1.0 }", "duration must be a finite number, got {"),
        ("duration = 0.01", "duration = 0.01\ndrive = 3.0", "drive must be a table, got 3.0"),
        (
            "duration = 0.01",
            "duration = 0.01\n[drive]\ninverter = [1.0]",
            r"drive\.inverter must be a table, got \[1\.0\]",
        ),
        (
            "duration = 0.01",
            "duration = 0.01\n[drive.winding]\nphase_factors = [1.0, 1.1]",
            r"winding\.phase_factors must be a list of 3, got \[1\.0, 1\.1\]",
        ),
        (
            "duration = 0.01",
            "duration = 0.01\n[drive.resolver]\norders = [[1, 0.1, 0.0], [2, 0.1]]",
            r"resolver\.orders\[1\] must be a list of 3, got \[2, 0\.1\]",
        ),
        (
            "amplitude = 100.0",
            "amplitude = 9.0\ndomain = 'pump'",
            "must be 'generator' or 'motor' or 'whole' or a table, got 'pump'",
        ),
        (
            'kind = "lissajous"',
            'kind = ["lissajous"]',
            r"reference\.kind must be 'lissajous' or .*, got \['lissajous'\]",
        ),
        (
            "speed_rpm = 900.0",
            "speed_rpm = {}",
            r"speed_rpm\.kind is missing; it must be 'points' or 'ripple' or 'free'",
        ),
        (
            '"traction_300A"',
            "{ map = 'gone.csv', resistance = 0.01, pole_pairs = 4 }",
            r"machine.map: .*gone\.csv is not there; correct the path",
        ),
        (
            "amplitude = 100.0",
            "amplitude = 9.0\ndomain = { d = [0.5, -1] }",
            r"reference\.domain: domain: the d axis must rise .* got 0\.5 to -1",
        ),
        ("duration", "duratoin", "case.toml: duratoin is unknown .did you mean duration"),
        ("duration = 0.01", "duration = ", "case.toml: not a TOML file"),
    ],
)
def test_refusals_name_the_entry(load, old, new, words):
    with pytest.raises(InputError, match=words):
        load(MINIMAL.replace(old, new))
