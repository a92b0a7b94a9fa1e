"""Golden results: ``python -m validate.golden [--keep]``.

Fourteen recordings of the bench that end well go through the command; what ``result.json`` says of
them is compared with ``validate/golden.json``, number by number, and the largest relative
difference of each is printed. ``--keep`` writes that file anew. A change that is not meant to
change answers leaves all of them within 1e-9.
"""

import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from penode.bench.config import load_config
from penode.bench.drive import DEFAULT_DRIVE
from penode.bench.inverter import DeadTime, Inverter, StationaryHold
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.bench.sensors import CurrentSensors, Resolver
from penode.bench.winding import IronLoss
from penode.data.experiment import Experiment
from penode.data.save import save
from validate.command import identify
from validate.drawn_recordings import draw_recording

FOLDER = Path("out") / "validate" / "golden"
KEPT = Path(__file__).with_name("golden.json")

Recordings = Callable[[], list[Experiment]]


def standstill(of_d: float, of_q: float) -> list[Experiment]:
    """Return sines of current at standstill, 150 A in an axis that has any."""

    def reference(time: np.ndarray) -> np.ndarray:
        d = 150.0 * np.sin(2 * np.pi * 20.0 * time) * np.cos(2 * np.pi * 1.3 * time)
        q = 150.0 * np.sin(2 * np.pi * 13.0 * time) * np.cos(2 * np.pi * 1.1 * time)
        return np.stack([of_d * d, of_q * q], axis=1)

    drive = replace(DEFAULT_DRIVE, current_noise=0.05)
    still = {"speed_rpm": 0.0, "duration": 0.4, "drive": drive, "seed": 2}
    return [simulate(TRACTION_300A, reference, **still)]


def dead_time(**changed: Any) -> list[Experiment]:
    """Return a recording of 1 s behind an inverter with dead time and sensors with noise."""
    inverter = Inverter(dead_time=DeadTime(0.5e-6), **changed)
    drive = replace(DEFAULT_DRIVE, inverter=inverter, current_sensors=CurrentSensors(noise=0.2))
    locus = Lissajous(220.0, 40.0, 33.0)
    return [simulate(TRACTION_300A, locus, speed_rpm=900.0, duration=1.0, drive=drive, seed=4)]


def imperfect(speed_rpm: float = 1200.0, **changed: Any) -> list[Experiment]:
    """Return a recording of 1 s of a drive with one imperfection."""
    drive = replace(DEFAULT_DRIVE, current_sensors=CurrentSensors(noise=0.1), **changed)
    locus = Lissajous(200.0, 55.0, 61.0)
    return [simulate(TRACTION_300A, locus, speed_rpm=speed_rpm, duration=1.0, drive=drive, seed=6)]


def in_phases(experiments: list[Experiment]) -> list[Experiment]:
    """Return recordings with phase quantities in place of dq ones."""
    return [_in_phases(experiment) for experiment in experiments]


def _in_phases(experiment: Experiment) -> Experiment:
    theta = experiment.channels["theta_el"]
    turns = theta[:, None] - 2 * np.pi / 3 * np.arange(3)
    channels = {"theta_el": theta, "omega_el": experiment.channels["omega_el"]}
    for kind in "ui":
        d, q = experiment.stack((f"{kind}_d", f"{kind}_q")).T[:, :, None]
        three = d * np.cos(turns) - q * np.sin(turns)
        channels |= {f"{kind}_{name}": phase for name, phase in zip("abc", three.T, strict=True)}
    return replace(experiment, channels=channels)


RECORDINGS: dict[str, Recordings] = {
    "the paper's simulation": lambda: [load_config("paper_simulation").record().experiment],
    "well designed": lambda: [load_config("well_designed").record().experiment],
    "clean, drawn 1": lambda: [draw_recording(1).run],
    "clean, drawn 2": lambda: [draw_recording(2).run],
    "drawn 3, 4 s": lambda: [draw_recording(3, duration=4.0).run],
    "two speeds": lambda: [*imperfect(), *imperfect(speed_rpm=1800.0)],
    "dead time": dead_time,
    "dead time, stationary hold": lambda: dead_time(hold=StationaryHold(0.0)),
    "phases": lambda: in_phases([draw_recording(4).run]),
    "standstill": lambda: standstill(1.0, 1.0),
    "one axis at standstill": lambda: standstill(1.0, 0.0),
    "delay of a sample": lambda: imperfect(inverter=Inverter(delay=1)),
    "angle off by a degree": lambda: imperfect(resolver=Resolver(np.deg2rad(1.0))),
    "iron loss": lambda: imperfect(iron_loss=IronLoss(150.0)),
}


def numbers_of(document: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Yield every number of a JSON document with its path."""
    if isinstance(document, dict):
        for name, entry in document.items():
            yield from numbers_of(entry, f"{path}/{name}")
    elif isinstance(document, list):
        for place, entry in enumerate(document):
            yield from numbers_of(entry, f"{path}/{place}")
    elif isinstance(document, (int, float)):
        yield path, float(document)


def answer_of(name: str) -> dict[str, Any]:
    """Return what the command says of a recording: verdict, horizons, parameters, errors, map."""
    folder, files = FOLDER / name.replace(" ", "_").replace("'", ""), []
    for place, experiment in enumerate(RECORDINGS[name]()):
        files.append(folder / f"run{place}.csv")
        save(experiment, files[-1])
    ended = identify(files, folder / "result")
    if ended.result is None:
        return {"status": ended.status, "refusal": ended.last_line}
    kept = ("horizon", "parameters", "metrics")
    told = {key: ended.result[key] for key in kept}
    told["horizon"] = {k: v for k, v in told["horizon"].items() if k in ("selected", "verdict")} | {
        "ladder": [
            {k: rung[k] for k in ("horizon", "parameters", "std", "rmse") if k in rung}
            for rung in told["horizon"]["ladder"]
        ]
    }
    rows = (ended.out / "flux_map.csv").read_text().splitlines()[1::97]
    told["map"] = [[float(value) for value in row.split(",")] for row in rows]
    return {"status": ended.status, **told}


def difference(kept: dict[str, Any], now: dict[str, Any]) -> tuple[float, str]:
    """Return the largest relative difference of two answers, and where it is."""
    before, after = dict(numbers_of(kept)), dict(numbers_of(now))
    if before.keys() != after.keys():
        return np.inf, min(before.keys() ^ after.keys())
    apart = {
        path: abs(after[path] - value) / max(abs(value), 1e-12)
        for path, value in before.items()
        if not (np.isnan(value) and np.isnan(after[path]))
    }
    worst = max(apart, key=lambda path: apart[path])
    return apart[worst], worst


def main() -> None:
    """Keep the answers, or compare them with those kept."""
    keep = "--keep" in sys.argv[1:]
    kept = {} if keep else json.loads(KEPT.read_text())
    answers = {}
    for name in RECORDINGS:
        answers[name] = answer_of(name)
        head = f"{name:28s} exit status {answers[name]['status']}"
        if keep:
            verdict = answers[name].get("horizon", answers[name])
            print(head, verdict.get("verdict", answers[name].get("refusal")), flush=True)
        else:
            apart, where = difference(kept[name], answers[name])
            print(f"{head}, largest difference {apart:.1e} at {where}", flush=True)
    if keep:
        KEPT.write_text(json.dumps(answers, indent=1) + "\n")


if __name__ == "__main__":
    main()
