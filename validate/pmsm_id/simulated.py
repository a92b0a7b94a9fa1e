"""What a simulator made of a task: the log's file, and what is known of it."""

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from validate.other_simulators.drive_log import SETTLING, DriveLog
from validate.pmsm_id.tasks import FOLDER, NAME_PLATE, QUERIES, REFUSE, Task, tasks

#: How near a current must have been recorded for the map to be asked for there, over the largest.
_NEAR = 0.04


@dataclass(frozen=True)
class Simulated:
    """A log and the truth behind it.

    Attributes
    ----------
    log : DriveLog
    resistance : float
        In ohm.
    pole_pairs : int
    current, psi : ndarray of complex, shape (point,)
        Samples of the flux map, mean over the angle, in A and Vs.
    """

    log: DriveLog
    resistance: float
    pole_pairs: int
    current: np.ndarray
    psi: np.ndarray

    def name_plate(self, random: np.random.Generator) -> dict[str, float]:
        """Return R, inductances and magnet, each off by up to a fifth."""
        scale = np.abs(self.current).max()
        near = np.abs(self.current) < 0.25 * scale
        i, psi = self.current[near], self.psi[near]
        (l_d, psi_m), (l_q, _) = np.polyfit(i.real, psi.real, 1), np.polyfit(i.imag, psi.imag, 1)
        right = {"R": self.resistance, "L_d": l_d, "L_q": l_q, "psi_PM": psi_m}
        off = 1 + random.uniform(-NAME_PLATE, NAME_PLATE, len(right))
        return {name: float(x * by) for (name, x), by in zip(right.items(), off, strict=True)}

    def asked(self, random: np.random.Generator) -> np.ndarray:
        """Return which samples of the map lie where the log was, at most `QUERIES`."""
        seen = np.stack([self.log.current.real, self.log.current.imag], axis=-1)[::10]
        points = np.stack([self.current.real, self.current.imag], axis=-1)
        away = cKDTree(seen).query(points)[0]
        inside = np.flatnonzero(away < _NEAR * np.abs(self.log.current).max())
        return np.sort(random.permutation(inside)[:QUERIES])


def write(
    made: Iterable[tuple[Task, Simulated]], folder: Path
) -> Iterable[tuple[dict[str, Any], dict[str, Any]]]:
    """Write logs; yield the entry of each in ``tasks.json`` and in ``truth.json``."""
    folder.mkdir(parents=True, exist_ok=True)
    for task, one in made:
        whole = replace(one, log=one.log.after(SETTLING))
        wrong = task.kind == REFUSE
        turned = replace(whole.log, speed=-whole.log.speed) if wrong else whole.log
        turned.write(folder / task.file)
        kept, plate = whole.asked(task.random(2)), whole.name_plate(task.random(3))
        i, psi = whole.current[kept], whole.psi[kept]
        at = {"i_d": i.real.tolist(), "i_q": i.imag.tolist()}
        told = {"pole_pairs": one.pole_pairs, "name_plate": plate, "currents": at}
        known = {"R": one.resistance, "psi_d": psi.real.tolist(), "psi_q": psi.imag.tolist()}
        about = {"simulator": task.simulator, "machine": task.machine, "kind": task.kind}
        yield (
            {"log": task.number, "file": task.file, **told},
            {"log": task.number, **about, **known},
        )


def written() -> set[int]:
    """Return the numbers of the logs that are there."""
    file = FOLDER / "tasks.json"
    return {one["log"] for one in json.loads(file.read_text())} if file.exists() else set()


def write_missing(simulators: Mapping[str, Callable[[Task], Simulated]]) -> None:
    """Write the logs of simulators that are not there, and what is known of them."""
    there = written()
    made = (
        (task, simulators[task.simulator](task))
        for task in tasks()
        if task.simulator in simulators and task.number not in there
    )
    for told, known in write(made, FOLDER):
        save([known], FOLDER / "truth.json")
        save([told], FOLDER / "tasks.json")
        print(told["file"], flush=True)


def save(entries: Iterable[dict[str, Any]], file: Path) -> None:
    """Add entries to a file of a list of them, in place of those of the same logs."""
    known = {one["log"]: one for one in json.loads(file.read_text())} if file.exists() else {}
    known |= {one["log"]: one for one in entries}
    file.write_text(json.dumps([known[number] for number in sorted(known)]))
