"""What check proves in seconds ends identify before training, with the same sentence."""

import json
from dataclasses import replace

import pytest

from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.save import save


@pytest.fixture(scope="module")
def run():
    return simulate(TRACTION_300A, Lissajous(220.0, 60.0, 65.0), speed_rpm=900.0, duration=0.4)


def _reversed(channels):
    return {**channels, "omega_el": -channels["omega_el"]}


def _exchanged(channels):
    return {**channels, "i_d": channels["i_q"], "i_q": channels["i_d"]}


def _four_for_five(channels):
    speed = 0.8 * channels["omega_el"]
    return {**{n: x for n, x in channels.items() if n != "theta_el"}, "omega_el": speed}


WRONG = {
    "reversed speed": _reversed,
    "exchanged currents": _exchanged,
    "wrong pole pairs": _four_for_five,
}


@pytest.mark.parametrize("name", list(WRONG))
def test_identify_refuses_with_the_sentence_of_check(run, penode, tmp_path, name):
    wrong, out = tmp_path / "wrong.csv", tmp_path / "result"
    save(replace(run, channels=WRONG[name](run.channels)), wrong)
    checked = json.loads(penode("check", wrong, "--json").stdout)
    assert [one["name"] for one in checked["conventions"]] == [name]
    done = penode("identify", wrong, "--out", out)
    assert done.returncode == 2
    (found,) = checked["conventions"]
    sentence = f"{found['recording']}: {name}: {found['evidence']}; {found['fix']}."
    assert sentence in " ".join(done.stderr.split())
    assert "--train-anyway" in done.stderr
    assert not (out / "result.json").exists()


@pytest.mark.slow
def test_training_all_the_same_gives_a_verdict_that_names_it(run, penode, tmp_path):
    wrong, out = tmp_path / "wrong.csv", tmp_path / "result"
    save(replace(run, channels=_exchanged(run.channels)), wrong)
    plain = ("--horizon", "1", "--no-inverter", "--angle-orders", "none", "--hold", "dq")
    done = penode("identify", wrong, "--out", out, "--train-anyway", *plain)
    assert done.returncode == 1
    horizon = json.loads((out / "result.json").read_text())["horizon"]
    assert "exchanged currents" in [one["name"] for one in horizon["objections"]]
    assert (out / "report.html").exists()


def test_two_temperatures_are_named_before_training(penode, tmp_path):
    files = []
    for name, warmer in (("cold.csv", 1.0), ("hot.csv", 1.234)):
        machine = replace(TRACTION_300A, resistance=warmer * TRACTION_300A.resistance)
        reference = Lissajous(200.0, 60.0, 65.0)
        files.append(tmp_path / name)
        save(simulate(machine, reference, speed_rpm=900.0, duration=0.4), files[-1])
    done = penode("identify", *files, "--out", tmp_path / "result")
    assert done.returncode == 2
    assert "as of copper 60 K warmer" in " ".join(done.stderr.split())
