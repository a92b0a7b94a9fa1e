"""penode check: findings as sentences or as JSON, a picture, and the exit status."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import pytest

from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.cli.check import _expected
from penode.data.save import save


@pytest.fixture(scope="module")
def run():
    reference = Lissajous(220.0, 60.0, 65.0)
    return simulate(TRACTION_300A, reference, speed_rpm=900.0, duration=0.5)


@pytest.fixture
def recording(run, tmp_path):
    path = tmp_path / "run.csv"
    save(run, path)
    return path


@pytest.mark.parametrize(
    ("half", "said"),
    [(0.24, ""), (0.26, "shows R to ± 26 % only; where training leaves much of that, record")],
)
def test_little_that_the_recording_shows_before_training_is_said(half, said):
    expected = SimpleNamespace(budget=[])
    check = SimpleNamespace(expected=expected, good=True, half_widths=(0.01, half))
    ((_, sentence),) = _expected(check)
    assert said in sentence
    assert ("only" in sentence) == bool(said)


def test_a_good_recording(recording, penode, tmp_path):
    picture = tmp_path / "cover.png"
    done = penode("check", recording, "--picture", picture)
    assert done.returncode == 0, done.stderr
    told = " ".join(done.stdout.split())
    assert (
        "Signs, units, order, timing and angle of the channels agree with physics, but for" in told
    )
    assert re.search(r"No coenergy map can imitate [\d.]+ % of the voltage of R[,;]", told)
    visited = [float(part) for part in re.findall(r"([\d.]+) % at i_d [<>] 0 and i_q", told)]
    assert len(visited) == 4
    assert sum(visited) == pytest.approx(100, abs=1)
    assert (
        "These recordings can be used as they are; what is undetermined is taken as recorded."
        in told
    )
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_without_an_angle_only_what_was_tested_agrees(run, penode, tmp_path):
    kept = {name: one for name, one in run.channels.items() if name != "theta_el"}
    save(replace(run, channels=kept), tmp_path / "bare.csv")
    told = " ".join(penode("check", tmp_path / "bare.csv").stdout.split())
    assert "Signs, units and order of the channels agree with physics" in told


def test_json_and_nothing_else(recording, penode):
    done = penode("check", recording, "--json")
    assert done.returncode == 0
    found = json.loads(done.stdout)
    assert found["good"]
    assert found["conventions"] == []
    assert found["identifiability"]["independence"]["R"] > 0.01
    assert found["excitation"]["share_of_disc"] > 0.5


def test_a_broken_convention_is_told_with_its_mend_and_the_mend_works(run, penode, tmp_path):
    wrong, picture = tmp_path / "wrong.csv", tmp_path / "cover.png"
    channels = {**run.channels, "i_q": -run.channels["i_q"]}
    save(replace(run, channels=channels), wrong)
    done = penode("check", wrong, "--picture", picture)
    assert done.returncode == 1
    told = " ".join(done.stdout.split())
    assert "negative q current" in told
    assert "give i_q sign = -1, or remove that where the study file has it." in told
    assert not picture.exists()
    assert "not drawn: what the recordings cover shows once they can be used" in told
    assert "not drawn" not in penode("check", wrong).stdout
    names = [n for n in run.channels if n != "i_q"]
    lines = ["[channels]", 'i_q = { column = "i_q", sign = -1 }']
    config = tmp_path / "study.toml"
    config.write_text("\n".join([*lines, *(f'{n} = "{n}"' for n in names)]))
    assert penode("check", wrong, "--config", config).returncode == 0


def test_data_that_cannot_tell(penode, tmp_path):
    path, config = tmp_path / "run.csv", tmp_path / "study.toml"
    slow = Lissajous(240.0, 14.0, 15.0)
    save(simulate(TRACTION_300A, slow, speed_rpm=1500.0, duration=1.0), path)
    config.write_text('flux_map = "mlp"\n')
    done = penode("check", path, "--config", config, "--json")
    assert done.returncode == 1
    found = json.loads(done.stdout)
    assert found["identifiability"]["indistinguishable"] == ["R"]
    assert "reciprocal map" in found["identifiability"]["repair"]
    assert found["verdict"] == "These recordings cannot distinguish R from the map."


def test_a_name_plate_tells_rms(run, penode, tmp_path):
    path, config = tmp_path / "run.csv", tmp_path / "study.toml"
    rms = {n: run.channels[n] / 2**0.5 for n in ("u_d", "u_q")}
    save(replace(run, channels={**run.channels, **rms}), path)
    config.write_text("[name_plate]\nmagnet_flux_linkage = 58e-3\n")
    done = penode("check", path, "--config", config)
    assert done.returncode == 1
    assert "rms for peak (voltages)" in " ".join(done.stdout.split())
    config.write_text("[name_plate]\nmagnet_flux = 58e-3\n")
    done = penode("check", path, "--config", config)
    assert done.returncode == 2
    assert "did you mean magnet_flux_linkage?" in done.stderr


def test_unusable_input(recording, penode, tmp_path):
    done = penode("check", tmp_path / "gone.csv")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    done = penode("check", recording, "--picture", "cover.pdf")
    assert done.returncode == 2
    assert "use .png" in done.stderr


OF_SHAFT = '{ column = "omega_el_of_logger", mechanical = true }'


def renamed(run, names, pole_pairs, folder, stem):
    """Save a recording under other names, and a study file that maps them."""
    channels = {names[name]: values for name, values in run.channels.items()}
    save(replace(run, channels=channels), folder / f"{stem}.csv")
    lines = [f'{n} = "{column}"' for n, column in names.items()]
    study = "\n".join([f"pole_pairs = {pole_pairs}", "[channels]", 't = "t"', *lines])
    (folder / f"{stem}.toml").write_text(study)
    return folder / f"{stem}.csv", folder / f"{stem}.toml"


def test_each_recording_is_read_by_the_first_study_file_that_fits_it(run, penode, tmp_path):
    names = dict.fromkeys(run.channels)
    first = {name: f"{name}_of_bench" for name in names}
    second = {name: f"{name}_of_logger" for name in names}
    a, of_a = renamed(run, first, 5, tmp_path, "a")
    b, of_b = renamed(run, second, 5, tmp_path, "b")
    done = penode("check", b, a, "--config", of_a, "--config", of_b)
    assert done.returncode == 0, done.stderr
    assert "pole_pairs = 5 is taken as given" in " ".join(done.stdout.split())
    of_b.write_text(of_b.read_text().replace(f'"{second["omega_el"]}"', OF_SHAFT))
    shaft = {**run.channels, "omega_el": run.channels["omega_el"] / 5}
    save(replace(run, channels={second[name]: values for name, values in shaft.items()}), b)
    mixed = penode("check", b, a, "--config", of_a, "--config", of_b)
    assert mixed.returncode == 0, mixed.stderr
    assert "is taken as given" not in " ".join(mixed.stdout.split())
    alone = penode("check", b, a, "--config", of_a)
    assert alone.returncode == 2
    assert alone.stderr.strip().count("\n") == 0
    assert "b.csv" in alone.stderr
    _, other = renamed(run, second, 4, tmp_path, "c")
    apart = penode("check", b, a, "--config", of_a, "--config", other)
    assert apart.returncode == 2
    assert "pole_pairs must be those of" in apart.stderr
