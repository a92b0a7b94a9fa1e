"""The text of a study file: every line that it offers can be used as it stands."""

import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from penode.data.table import Table
from penode.pmsm.machine.flux_maps import FLUX_MAPS
from penode.pmsm.machine.holds import HOLDS
from penode.pmsm.recording.channel_guess import ChannelGuess
from penode.pmsm.recording.drive_mapping import RECORDED
from penode.pmsm.recording.guess import StudyGuess, guess_study
from penode.pmsm.recording.imperfections import DEFAULT_ACCURACY
from penode.pmsm.recording.name_plate import NamePlate
from penode.pmsm.recording.study_text import study_text
from penode.pmsm.study_file import load_study
from penode.pmsm.study_settings import DEFAULT_STUDY

NAMES = ("t", "u_d", "u_q", "i_d", "i_q", "omega_el", "theta_el")
TEXT = study_text(guess_study(Table({name: np.zeros(0) for name in NAMES})), "run.csv", "s.toml")
OFFERED = re.findall(r"^# (\w+ = [^.\n]*?\S)(?:  #.*)?$", TEXT.split("[channels]")[0], re.MULTILINE)


@pytest.fixture
def study(tmp_path):
    def load(text):
        path = tmp_path / "study.toml"
        path.write_text(text, encoding="utf-8")
        return load_study(path)

    return load


def test_the_settings_are_the_defaults(study):
    """But for the seed and the map, which are given, everything is left to the data."""
    assert study(TEXT).study == DEFAULT_STUDY


@pytest.mark.parametrize(
    ("numbers", "step"),
    [
        ({"log.Ts": 1e-4}, 1e-4),
        ({"gain": 3.0, "f_s": 8000.0}, 1.25e-4),
        ({"Ts": 100.0}, None),
        ({"fs": 0.0}, None),
        ({"gain": 1e-4}, None),
    ],
)
def test_a_number_of_the_file_is_the_time_step(study, numbers, step):
    table = Table({n: np.zeros(0) for n in NAMES if n != "t"}, numbers=numbers)
    guess = guess_study(table)
    text = study_text(guess, "run.mat", "s.toml")
    assert study(text).mapping.constants.get("time_step") == step
    assert ("t" in guess.missing) == (step is None)
    timed = Table({n: np.zeros(0) for n in NAMES}, numbers=numbers)
    assert guess_study(timed).time_step is None


@pytest.mark.parametrize("line", OFFERED)
def test_a_setting_that_is_offered_is_one(study, line):
    assert study(TEXT.replace(f"# {line}", line)) != study(TEXT)


def test_settings_are_offered_for_all_that_is_decided_from_the_data():
    found = {line.split(" = ")[0] for line in OFFERED}
    assert found == {"hold", "inverter", "terms", "angle_orders", "u_dc"}


def test_every_map_and_hold_that_is_named_exists():
    (named,) = re.findall(r'flux_map = "(\w+)"  # default; or (.*)', TEXT)
    assert set(named[1].split(", ")) | {named[0]} == set(FLUX_MAPS)
    for hold in re.findall(r'^# hold = "(\w+)".*or "(\w+)"', TEXT, re.MULTILINE)[0]:
        assert hold in HOLDS


def test_the_accuracies_are_those_assumed_and_each_can_be_given(study):
    own = re.sub(
        r"^# (\[(?:accuracy|name_plate)\]|\w+ = [\d.]+  # [\w ,;]+)$",
        r"\1",
        TEXT,
        flags=re.MULTILINE,
    )
    assert set(tomllib.loads(own)["accuracy"]) == set(DEFAULT_ACCURACY.declared)
    assert study(own).study.accuracy == DEFAULT_ACCURACY
    assert study(own).study.name_plate == NamePlate(0.1, 0.01)


def guessed(unused=(), **changed):
    """Return a guess of columns that are called as the channels, but for some."""
    channels = {name: ChannelGuess(name, RECORDED[name], ("by its name",)) for name in NAMES}
    return StudyGuess({**channels, **changed}, (), unused, None, False)


@pytest.mark.parametrize("odd", ['a "b"', "c\\d", "Länge ψ [°]", "e#f", "g\nh", "i\x7fj", "k\x01"])
def test_any_name_of_a_column_survives(study, odd):
    """As the column of a channel, among those it was preferred to, and as one not used."""
    turning = ChannelGuess(odd, "rad", (f"by its name, before {odd}", "rad, as usual"))
    text = study_text(guessed((odd,), theta_el=turning), f"{odd}.csv", "s.toml")
    assert study(text).mapping.channels["theta_el"].origin.column == odd


def test_a_temperature_that_is_not_used_may_be_the_windings(study):
    """One that was guessed is there already."""
    heat = {"Tw [°C]": "degC"}
    text = study_text(replace(guessed(("Tw [°C]",)), heat=heat), "run.csv", "s.toml")
    line = '# winding_temperature = { column = "Tw [°C]", unit = "degC" }'
    assert line in text
    found = study(text.replace(line, line[2:])).mapping.channels["winding_temperature"]
    assert (found.origin.column, found.origin.unit) == ("Tw [°C]", "degC")
    known = guessed(winding_temperature=ChannelGuess("T", "degC", ("by its name",)))
    assert line not in study_text(replace(known, heat=heat), "run.csv", "s.toml")


def test_sign_and_shaft_are_written_and_read_back(study):
    speed = ChannelGuess("n", "rpm", ("by its name",), sign=-1, mechanical=True)
    text = study_text(guessed(omega_el=speed), "run.csv", "s.toml")
    assert "# pole_pairs =" in text
    channel = study(text.replace("# pole_pairs =", "pole_pairs = 4")).mapping.channels["omega_el"]
    assert channel.mechanical
    assert channel.origin.sign == -1
    assert channel.origin.unit == "rpm"


def test_what_is_missing_has_a_line_to_fill_in(study):
    guess = guess_study(Table({name: np.zeros(0) for name in NAMES if name != "u_q"}))
    text = study_text(guess, "run.csv", "s.toml")
    assert "# not found, and needed: u_q in V.\n" in text
    filled = study(text.replace('# u_q = "..."', 'u_q = "my column"'))
    assert filled.mapping.channels["u_q"].origin.column == "my column"
