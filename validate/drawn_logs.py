"""Logs drawn over four simulators, by number: files, and the truth that the estimator never sees.

Even numbers are logs of the plant of `validate.sampled_drive`, its kinds in turn, at seeds held
out. Odd ones are in turn imperfect drives and campaigns of penode's bench, recordings of the bench
that a logger or a wrong convention has changed, and, where they are recorded, drives that other
people's simulators simulate (docs/validation/other-simulators.md).
"""

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from penode.data.experiment import Experiment
from penode.data.save import save
from validate import imperfect_drives
from validate.drawn_recordings import draw_campaign, draw_recording
from validate.other_simulators import kinds as other_kinds
from validate.sampled_drive.kinds import HELD_OUT, KINDS, draw
from validate.sampled_drive.log import Log
from validate.sampled_drive.machines import draw_machine

PLANT, BENCH = "sampled drive", "bench"
OTHERS = Path("out") / "validate" / "other_simulators"
#: What is wrong with logs of other people's simulators that have no right answer.
_WRONG_ELSEWHERE = ("noise", "reversed", "shaft", "per unit")
#: Kinds that only change a log, so that the bench's can be changed so too.
CHANGES = tuple(name for name, k in KINDS.items() if k.change and not (k.machine or k.drive))


@dataclass(frozen=True)
class DrawnLog:
    """Files to identify together, and what is known of them.

    Attributes
    ----------
    simulator, kind : str
    seed : int
        Of simulator and kind: with both it makes the log again.
    files : tuple of Path
    resistance : float or None
        In ohm, in the units of the log; None where there is none.
    refuse : bool
        Whether the only right end is a refusal.
    flux_map : dict of str to list, or None
        Samples of the true map.
    """

    simulator: str
    kind: str
    seed: int
    files: tuple[Path, ...]
    resistance: float | None
    refuse: bool
    flux_map: dict[str, list[float]] | None = None


def of_plant(index: int, folder: Path) -> DrawnLog:
    """Write the log of `validate.sampled_drive` whose kind and held-out seed an index names."""
    names = list(KINDS)
    return of_kind(names[index % len(names)], HELD_OUT + index // len(names), folder)


def of_kind(kind: str, seed: int, folder: Path) -> DrawnLog:
    """Write the log of a kind of `validate.sampled_drive` at a seed."""
    drawn = draw(kind, seed)
    truth = drawn.truth
    files, known = drawn.write(folder, "log"), None if kind == "noise alone" else truth["R"]
    return DrawnLog(PLANT, kind, seed, files, known, KINDS[kind].refuse, truth["flux_map"])


def of_imperfect_drive(index: int, folder: Path) -> DrawnLog:
    """Write a recording of the bench with imperfections drawn."""
    run, truth, _, _ = imperfect_drives.draw(HELD_OUT + index)
    return _saved("imperfect drive", HELD_OUT + index, [run], truth, folder)


def of_campaign(index: int, folder: Path) -> DrawnLog:
    """Write one to three recordings of a machine of the bench."""
    campaign = draw_campaign(HELD_OUT + index)
    truth = campaign.machine.resistance
    return _saved("campaign", HELD_OUT + index, list(campaign.runs), truth, folder)


def of_changed_log(index: int, folder: Path) -> DrawnLog:
    """Write a recording of the bench as a logger or a wrong convention makes it."""
    name, seed = CHANGES[index % len(CHANGES)], HELD_OUT + index
    kind, drawn = KINDS[name], draw_recording(seed)
    c, machine = drawn.run.channels, drawn.machine
    times = drawn.run.time_step * np.arange(len(drawn.run))
    link = np.full(len(times), 400.0)
    u, i = c["u_d"] + 1j * c["u_q"], c["i_d"] + 1j * c["i_q"]
    log = Log(times, u, i, c["omega_el"], c["theta_el"], link)
    random = np.random.default_rng([seed, 8])
    assert kind.change
    rated = replace(draw_machine(random), rated_current=300.0, rated_voltage=200.0)
    log = kind.change(log, replace(rated, pole_pairs=machine.pole_pairs), random)
    file = folder / "log.csv"
    log.write(file)
    known = None if name == "noise alone" else machine.resistance * kind.scale
    return DrawnLog(BENCH, name, seed, (file,), known, kind.refuse)


def _saved(
    kind: str, seed: int, runs: list[Experiment], resistance: float, folder: Path
) -> DrawnLog:
    files = tuple(folder / f"run{k + 1}.csv" for k in range(len(runs)))
    for run, file in zip(runs, files, strict=True):
        save(run, file)
    return DrawnLog(BENCH, kind, seed, files, resistance, refuse=False)


def recorded_elsewhere() -> list[dict[str, Any]]:
    """Return the truths of what other people's simulators recorded, none where nothing is."""
    file = OTHERS / "truth.json"
    if not file.exists():
        return []
    known = json.loads(file.read_text())["recordings"]
    return [known[number] for number in sorted(known, key=int)]


def of_other_simulator(index: int, folder: Path) -> DrawnLog | None:
    """Copy what another simulator recorded, None beyond the last."""
    truths = recorded_elsewhere()
    if index >= len(truths):
        return None
    truth = truths[index]
    files = tuple(folder / name for name in truth["files"])
    for file in files:
        shutil.copy(OTHERS / file.name, file)
    wrong = {kind.name: kind.wrong for kind in other_kinds.KINDS}[truth["kind"]]
    refuse = wrong in _WRONG_ELSEWHERE
    found = (truth["simulator"], truth["kind"], truth["number"], files, truth["R"], refuse)
    return DrawnLog(*found, truth["flux_map"])


_ODD: tuple[Callable[[int, Path], DrawnLog | None], ...] = (
    of_imperfect_drive,
    of_campaign,
    of_changed_log,
    of_other_simulator,
)


def draw_log(number: int, folder: Path) -> DrawnLog:
    """Write the log of a number into a folder, made if absent.

    Parameters
    ----------
    number : int
        From 0 on.
    folder : Path
    """
    folder.mkdir(parents=True, exist_ok=True)
    if number % 2 == 0:
        return of_plant(number // 2, folder)
    index, which = divmod(number // 2, len(_ODD))
    # Where nothing is recorded elsewhere, or no more, the bench steps in with seeds of its own.
    return _ODD[which](index, folder) or of_changed_log(1000 + index, folder)
