"""Simulate and write the recordings: ``python -m validate.other_simulators.record --thor FILE``.

Runs where motulator and gym-electric-motor are installed, on Python 3.12 or later, and needs no
penode. Writes a CSV file a recording and ``truth.json`` to ``out/validate/other_simulators``.
"""

import argparse
import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from validate.other_simulators import gem_drive, motulator_drive
from validate.other_simulators.drive_log import SETTLING, TIME_STEP, DriveLog
from validate.other_simulators.machines import GEM, Machine
from validate.other_simulators.plan import Planned, plan
from validate.other_simulators.references import PROFILES, REFERENCES, Profile, Reference
from validate.other_simulators.wrong_logs import WRONG, bases

FOLDER = Path("out") / "validate" / "other_simulators"


def flux_of(machine: Machine, current: np.ndarray, thor: Path) -> np.ndarray:
    """Return the flux linkage of a machine in Vs at currents in A, complex."""
    if machine.simulator == GEM:
        return gem_drive.flux_of(machine, current)
    return motulator_drive.flux_of(machine, current, thor)


def link_voltage(planned: Planned, reference: Reference, profile: Profile, thor: Path) -> float:
    """Return the DC-link voltage: the machine's, or one that falls short as the kind wants."""
    weak = planned.kind.drive.get("weak")
    if weak is None:
        return planned.machine.link_voltage
    times = np.arange(0, planned.kind.duration, 1e-3)
    current = np.array([reference(t) for t in times])
    speed = planned.machine.pole_pairs * np.array([profile(t) for t in times])
    needed = np.abs(1j * speed * flux_of(planned.machine, current, thor))
    utilised = 0.5 if planned.machine.simulator == GEM else 1 / np.sqrt(3)
    return float(np.quantile(needed, 1 - weak) / utilised)


def record(planned: Planned, part: int, thor: Path) -> tuple[DriveLog, float]:
    """Return the log of a recording, as its kind wants it, and the mean resistance in ohm."""
    kind = planned.kind
    speed = planned.speeds_rpm[part] * np.pi / 30
    profile = PROFILES[kind.profile](speed, kind.duration)
    figure = REFERENCES[kind.reference](
        planned.amplitude, float(np.sign(speed)), planned.random(40 + part)
    )
    run = (planned, part, figure, profile, link_voltage(planned, figure, profile, thor))
    if planned.machine.simulator == GEM:
        log, resistance = gem_drive.simulate(*run)
    else:
        log, resistance = motulator_drive.simulate(*run, thor)
    log = WRONG[kind.wrong](log.after(SETTLING), planned, part)
    return log, float(np.mean(resistance[SETTLING:]))


def truth_of(planned: Planned, resistance: float, files: list[str], thor: Path) -> dict[str, Any]:
    """Return what is known of a recording, in the units of its log."""
    machine, kind = planned.machine, planned.kind
    if machine.simulator == GEM:
        current, psi = gem_drive.flux_map(machine)
    else:
        current, psi = motulator_drive.flux_map(machine, thor)
    volt, ampere, _ = bases(planned) if kind.wrong == "per unit" else (1.0, 1.0, 1.0)
    samples = {"i_d": current.real / ampere, "i_q": current.imag / ampere}
    samples |= {"psi_d": psi.real / volt, "psi_q": psi.imag / volt}
    return {
        "number": planned.number,
        "half": planned.half,
        "kind": kind.name,
        "machine": machine.name,
        "simulator": machine.simulator,
        "pole_pairs": machine.pole_pairs,
        "speeds_rpm": planned.speeds_rpm,
        "files": files,
        "R": None if kind.wrong == "noise" else resistance * ampere / volt,
        "flux_map": {name: [float(f"{x:.9g}") for x in some] for name, some in samples.items()},
    }


def write(planned: Planned, folder: Path, thor: Path) -> dict[str, Any]:
    """Write the files of what was planned and return its truth."""
    files, means = [], []
    for part in range(len(planned.speeds_rpm)):
        log, mean = record(planned, part, thor)
        files.append(f"{planned.number:02d}{'ab'[part]}.csv")
        means.append(mean)
        log.write(folder / files[-1])
    return truth_of(planned, float(np.mean(means)), files, thor)


def main() -> None:
    """Write all recordings and the truth; recordings that are there are made again."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--thor", type=Path, required=True, help="thor.mat of motulator's examples")
    parser.add_argument("--out", type=Path, default=FOLDER)
    parser.add_argument("--repetition", type=int, default=0, help="draw the kinds anew")
    parser.add_argument("numbers", type=int, nargs="*", help="some recordings alone")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    file = asked.out / "truth.json"
    truths = json.loads(file.read_text())["recordings"] if file.exists() else {}
    versions = {n: version(n) for n in ("motulator", "gym-electric-motor", "numpy", "scipy")}
    for planned in plan(asked.repetition):
        if not asked.numbers or planned.number in asked.numbers:
            truths[str(planned.number)] = write(planned, asked.out, asked.thor)
            head = {"time_step": TIME_STEP, "versions": versions, "recordings": truths}
            file.write_text(json.dumps(head))
            print(f"{planned.number:2d} {planned.kind.name}, {planned.machine.name}", flush=True)


if __name__ == "__main__":
    main()
