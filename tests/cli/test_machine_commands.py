"""export, loci and compare from the command line."""

from dataclasses import replace

import numpy as np
import pytest

from penode.pmsm.exports.formats import FORMATS
from penode.pmsm.study import flux_map_csv
from penode.training.archive import write_atomically


@pytest.fixture
def result(machine_fit, tmp_path):
    """Return a folder with a saved fit and its map."""
    folder = tmp_path / "result"
    machine_fit.save(folder)
    write_atomically(folder / "flux_map.csv", flux_map_csv(machine_fit))
    return folder


@pytest.mark.parametrize("to", list(FORMATS))
def test_every_format_is_written(result, penode, tmp_path, to):
    out = tmp_path / "new" / f"map{FORMATS[to].suffix}"
    done = penode("export", result, "--to", to, "--out", out)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert str(out) in done.stdout.replace("\n", "")
    assert out.stat().st_size > 1000
    told = "linear interpolation is within" in " ".join(done.stdout.split())
    assert told == (to not in ("csv", "onnx"))


def test_points_and_pole_pairs_are_taken(result, penode, tmp_path):
    out = tmp_path / "map.npz"
    done = penode("export", result, "--to", "npz", "--out", out, "--points", 9, "--pole-pairs", 3)
    assert done.returncode == 0, done.stderr
    assert "9 x 9" in done.stdout
    with np.load(out) as arrays:
        assert arrays["n_p"] == 3


def test_loci_are_told_drawn_and_tabulated(result, penode, tmp_path):
    out, table = tmp_path / "loci.png", tmp_path / "loci.csv"
    done = penode("loci", result, "--i-max", 240, "--u-max", 120, "--out", out, "--csv", table)
    assert done.returncode == 0, done.stderr
    for word in ("MTPA", "Nm at i_d", "characteristic", "base speed", "rpm"):
        assert word in done.stdout
    assert out.read_bytes().startswith(b"\x89PNG")
    assert table.read_text().startswith("locus,i_d")


def test_compare_with_a_fit_and_with_a_file(result, machine_fit, penode, tmp_path):
    other = tmp_path / "other"
    machine_fit.save(other)
    out = tmp_path / "difference.png"
    done = penode("compare", result, other, "--out", out)
    assert done.returncode == 0, done.stderr
    assert "they agree" in done.stdout
    assert "psi differs by" in done.stdout
    done = penode("compare", result, result / "flux_map.csv", "--out", out)
    assert done.returncode == 0, done.stderr
    assert "R " not in done.stdout
    assert out.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("export", "{}", "--to", "fmu", "--out", "map.fmu"), "choose one of csv"),
        (("export", "{}", "--to", "c", "--out", "map.c"), "use .h"),
        (("export", "absent", "--to", "c", "--out", "map.h"), "no such file"),
        (("loci", "{}", "--i-max", "-5", "--out", "loci.png"), "above zero"),
        (("loci", "{}", "--i-max", "5", "--out", "loci.pdf"), "use .png"),
        (("loci", "{}", "--i-max", "5", "--out", "a.png", "--csv", "a.txt"), "use .csv"),
        (("compare", "{}", "absent.csv", "--out", "a.png"), "cannot be read"),
        (("compare", "{}", "{}", "--out", "a.svg"), "use .png"),
    ],
)
def test_unusable_input_gets_one_sentence(result, penode, monkeypatch, tmp_path, arguments, word):
    monkeypatch.chdir(tmp_path)
    done = penode(*(one.format(result) for one in arguments))
    assert done.returncode == 2
    assert done.stderr.strip().count("\n") == 0, done.stderr
    assert word in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["result"]


def test_a_fit_of_no_machine_is_refused(oscillator, penode, tmp_path):
    oscillator.fit.save(tmp_path / "mass")
    done = penode("export", tmp_path / "mass", "--to", "c", "--out", tmp_path / "map.h")
    assert done.returncode == 2
    assert "spring" in done.stderr


def test_a_fit_without_answer_is_exported_with_a_warning(machine_fit, penode, tmp_path):
    lost = replace(machine_fit, horizon=replace(machine_fit.horizon, verdict="no plateau"))
    lost.save(tmp_path / "lost")
    out = tmp_path / "map.h"
    done = penode("export", tmp_path / "lost", "--to", "c", "--out", out)
    assert done.returncode == 0
    assert "no plateau" in done.stderr
    assert "RESISTANCE" not in out.read_text()
