"""Study files: what is read, what overrides, and a sentence for everything else."""

import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from penode.errors import InputError
from penode.horizon.selection import Plateau
from penode.pmsm.machine.dead_time import DeadTime
from penode.pmsm.recording.imperfections import Accuracy
from penode.pmsm.study_file import load_study
from penode.pmsm.study_settings import Study

TIME = np.arange(200) * 1e-4
FILE = {
    "t": TIME,
    "Id": 50 * np.sin(60 * TIME),
    "Iq": 40 * np.cos(50 * TIME),
    "Ud": np.sin(30 * TIME),
    "Uq": 30 + np.cos(20 * TIME),
    "n": np.full(200, 1000.0),
}
CHANNELS = """
[channels]
i_d = "Id"
i_q = "Iq"
u_d = "Ud"
u_q = "Uq"
"""
SPEED = 'omega_el = { column = "n", unit = "rpm", mechanical = true }\n'


@pytest.fixture
def config(tmp_path):
    pl.DataFrame(FILE).write_csv(tmp_path / "run.csv")

    def write(text: str) -> Path:
        path = tmp_path / "study.toml"
        path.write_text(text)
        return path

    return write


def refusal(path: Path, load_too: bool = False) -> str:
    def run() -> None:
        study = load_study(path)
        if load_too:
            study.load(path.parent / "run.csv")

    with pytest.raises(InputError) as caught:
        run()
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert sentence.endswith(".")
    return sentence


def test_settings_and_channels_are_read(config):
    path = config(
        'flux_map = "spline"\nhorizon = 9\npole_pairs = 3\nseed = 4\ninverter = true\n'
        f'hold = "stationary"\n{CHANNELS}{SPEED}'
    )
    asked = load_study(path)
    assert asked.study == Study(
        "spline",
        9,
        3,
        4,
        terms=(DeadTime(),),
        candidates=(),
        hold="stationary",
        of_shaft=("omega_el",),
    )
    run = asked.load(path.parent / "run.csv")
    np.testing.assert_allclose(run.channels["omega_el"], 3 * 1000 * np.pi / 30, rtol=1e-14)
    np.testing.assert_array_equal(run.channels["i_d"], FILE["Id"])


def test_an_empty_file_is_the_default_study_on_canonical_columns(config):
    asked = load_study(config(""))
    assert asked.study == load_study().study == Study()
    assert Study().selector(()) == Plateau(averaged=True)
    assert not asked.mapping.channels


def test_the_accuracy_of_the_bench_replaces_the_assumed_one(config):
    text = "[accuracy]\ncurrent_gain = 0.002\ndelay = 0"
    asked = load_study(config(text)).study
    assert asked.accuracy == Accuracy(current_gain=0.002, delay=0.0)
    assert load_study(config("")).study.accuracy == Accuracy()
    assert load_study(config(text), {"horizon": 3}).study.accuracy == asked.accuracy


def test_auto_and_angle_orders(config):
    asked = load_study(config('horizon = "auto"\nangle_orders = [6, 12]\n'))
    assert asked.study.horizon is None
    assert asked.study.angle_orders == (6, 12)


def test_options_override_the_file(config):
    path = config('horizon = 9\nseed = 4\nflux_map = "mlp"\n')
    asked = load_study(path, {"horizon": None, "seed": 7})
    assert asked.study == Study("mlp", None, seed=7)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("horizn = 3", ["horizn is unknown", "did you mean horizon?"]),
        ('horizon = "long"', ["horizon must be a whole number >= 1 or 'auto', got 'long'"]),
        ("horizon = 0", ["horizon must be", ">= 1", "got 0"]),
        ("seed = true", ["seed must be a whole number", "got True"]),
        ("seed = -1", ["seed must be a whole number >= 0, got -1"]),
        ("pole_pairs = 0", ["pole_pairs must be a whole number >= 1, got 0"]),
        (
            'flux_map = "coenrgy"',
            ["flux_map must be one of", "got 'coenrgy' (did you mean coenergy?)"],
        ),
        ("angle_orders = [6.5]", ["angle_orders[0] must be a whole number, got 6.5"]),
        (
            "angle_orders = [100000]",
            ["angle orders must be distinct whole numbers from 1 to 1000", "got"],
        ),
        ('resample = "cubic"', ["resample must be 'linear', got 'cubic'"]),
        ("channels = 3", ["channels must be a table, got 3"]),
        ("[channels]\nid = 'Id'", ["channels.id is unknown (did you mean i_d?)"]),
        ("[channels]\ni_d = 3", ["channels.i_d must be text or a table, got 3"]),
        (
            "[channels]\ni_d = { colum = 'Id' }",
            ["channels.i_d.colum is unknown (did you mean column?)"],
        ),
        (
            "[channels]\nt = { column = 't', time_step = 1e-4 }",
            ["channels.t.time_step is unknown; time_step belongs above all tables"],
        ),
        ("[channels]\ni_d = { unit = 'A' }", ["channels.i_d.column is missing"]),
        (
            "[channels]\ni_d = { column = 'Id', sign = 2 }",
            ["channels.i_d.sign must be -1 or 1, got 2"],
        ),
        (
            "[channels]\ni_d = { column = 'Id', scale = 0.0 }",
            ["channels.i_d: scale must be a number other than 0, got 0.0"],
        ),
        (
            "[channels]\ni_d = { column = 'Id', delay = 0.5 }",
            ["channels.i_d.delay must be a whole number, got 0.5"],
        ),
        ("[channels]\ni_a = { column = 'Ia', rms = true }", ["rms = true", "i_a", "u_d, u_q"]),
        ("[channels]\ni_d = { column = 'Id', mechanical = true }", ["mechanical", "omega_el"]),
        (f"{CHANNELS}{SPEED}", ["omega_el is mechanical", "pole_pairs"]),
        (
            "[channels]\nt = { column = 't', delay = 1 }",
            ["channels.t.delay is unknown", "column, unit, scale"],
        ),
        ("horizon = ", ["not a TOML file"]),
        ("seed = 1\nseed = 2", ["not a TOML file (an entry is given twice; remove one, "]),
        ("[accuracy]\nvoltage_gain = -1", ["accuracy voltage_gain", "must be >= 0"]),
        ('[accuracy]\nangle = "1 deg"', ["accuracy", "angle", "number"]),
        ("[accuracy]\ngain = 0.01", ["accuracy", "gain"]),
    ],
)
def test_what_cannot_be_meant_is_refused_with_the_file_and_the_entry(config, text, words):
    sentence = refusal(config(text))
    for word in ("study.toml: ", *words):
        assert word in sentence


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (CHANNELS, ["no channel omega_el", "[channels]"]),
        (f'{CHANNELS}omega_el = "Drehzahl"', ["no column Drehzahl for channel omega_el", "t, Id"]),
        (f'{CHANNELS}omega_el = {{ column = "n", unit = "rpn" }}', ["'rpn'", "did you mean rpm?"]),
        (f'{CHANNELS}omega_el = {{ column = "n", unit = "A" }}', ["'A'", "column n", "rpm"]),
        (f'{CHANNELS}omega_el = "n"\nt = "zeit"', ["no column zeit"]),
        ("", ["no column u_d, u_q, i_d, i_q, omega_el", "t, Id", "penode init"]),
    ],
)
def test_what_the_recording_does_not_have_is_refused(config, text, words):
    sentence = refusal(config(text), load_too=True)
    for word in ("run.csv: ", *words):
        assert word in sentence


def test_a_study_file_that_is_not_there(tmp_path):
    assert "cannot be read" in refusal(tmp_path / "gone.toml")


def test_the_blocks_of_the_how_to_are_study_files(config):
    page = Path(__file__).parents[2] / "docs" / "how-to" / "map-your-channels.md"
    whole, duty, bases, resample, steady = re.findall(
        r"```toml\n(.*?)```", page.read_text(), flags=re.DOTALL
    )
    assert load_study(config(whole)).mapping.channels["omega_el"].mechanical
    assert load_study(config(duty)).mapping.channels["duty_a"].origin.unit == "%"
    assert load_study(config(duty)).mapping.constants == {"u_dc": 400}
    assert set(load_study(config(bases)).mapping.constants) == {"u_base", "i_base", "omega_base"}
    assert load_study(config(resample)).mapping.resample
    assert load_study(config(steady)).mapping.constants == {"time_step": 1e-4}
