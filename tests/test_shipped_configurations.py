"""Every configuration that penode ships: simulated and identified by the command, files and all."""

import tomllib
from pathlib import Path

import pytest
from validate.command import Ended, identify, run

from penode.bench.config import shipped_configs
from penode.bench.machines import MACHINES

CONFIGS = shipped_configs()


def through(config: object, folder: Path, *options: object) -> Ended:
    """Simulate a configuration and identify its recording."""
    simulated = run("simulate", config, "--out", folder / "run.csv")
    assert simulated.status == 0, simulated.printed
    return identify([folder / "run.csv"], folder / "result", *options)


def check(ended: Ended) -> None:
    """The command ended as it promises, with everything that belongs to a result."""
    assert ended.status in (0, 1), ended.printed
    assert not [line for line in ended.warned if line.startswith("RuntimeWarning")]
    assert "please send in" not in ended.printed
    assert ended.result is not None
    for name in ("result.json", "flux_map.csv", "fit", "report.html"):
        assert (ended.out / name).exists(), name


def error(ended: Ended, name: str) -> float:
    machine = tomllib.loads(CONFIGS[name].read_text())["machine"]
    return ended.result["parameters"]["R"]["value"] / MACHINES[machine].resistance - 1


#: The one with every part of a bench; `make validate` has all.
SHORT = [
    pytest.param(name, marks=() if name == "paper_testbench" else pytest.mark.slow)
    for name in CONFIGS
]


@pytest.mark.parametrize("name", SHORT)
def test_a_short_recording_of_it_ends_with_a_result(name, tmp_path):
    """Less of it, and few unknowns; calibration, checkpoint, map and report are the same."""
    text = CONFIGS[name].read_text()
    duration, part = tomllib.loads(text)["duration"], 1.2 if name == "paper_testbench" else 0.5
    short = text.replace(f"duration = {duration}", f"duration = {part}", 1)
    (tmp_path / "short.toml").write_text(short)
    few = ("--horizon", 1, "--no-inverter", "--angle-orders", "none")
    ended = through(tmp_path / "short.toml", tmp_path, *few)
    check(ended)
    structure = ended.result["provenance"]["structure"]
    sensors = any(one.startswith("The gains of the current sensors differ") for one in structure)
    assert sensors == (name == "paper_testbench")


@pytest.mark.slow
@pytest.mark.parametrize("name", CONFIGS)
def test_its_resistance_is_right_or_refused(name, tmp_path):
    ended = through(name, tmp_path)
    check(ended)
    if ended.status == 0:
        assert abs(error(ended, name)) < 0.02
