"""The kinds of logs that data loggers make, and a log of a kind at a seed."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from validate.sampled_drive import other_machines, references, wrong_logs
from validate.sampled_drive.drive import Drive, simulate
from validate.sampled_drive.log import Log
from validate.sampled_drive.machines import Machine, draw_machine

#: Seeds below are for developing; from here on they are for judging and never looked at before.
HELD_OUT = 1000
#: Change of a copper winding and of a magnet by a kelvin.
_COPPER, _MAGNET = 3.93e-3, -1.1e-3

Change = Callable[[Log, Machine, np.random.Generator], Log]


@dataclass(frozen=True)
class Kind:
    """How logs of a kind are made.

    Attributes
    ----------
    refuse : bool
        Whether the only right end is a refusal: the log is not one of the machine that it says.
    machine : mapping of str to float
        What `draw_machine` does not draw.
    drive : mapping
        Entries of `Drive`.
    speeds : tuple of float
        Range of the speed as a fraction of base speed; its sign is drawn.
    rpm : float
        Speed of the shaft in place of a range.
    reference, profile : str
        Names of functions in `references`.
    duration : float
        s.
    change : callable or None
        What the logger or a wrong convention makes of the log.
    kelvin : tuple of float
        Temperature of the winding and the magnet above the machine's, one a recording.
    other : callable or None
        Of `other_machines`, in place of the synchronous machine.
    scale : float
        Of R in the log's units.
    """

    refuse: bool = False
    machine: dict[str, Any] = field(default_factory=dict)
    drive: dict[str, Any] = field(default_factory=dict)
    speeds: tuple[float, float] = (0.1, 0.5)
    rpm: float = 0.0
    reference: str = "wander"
    profile: str = "constant"
    duration: float = 1.0
    change: Change | None = None
    kelvin: tuple[float, ...] = (0.0,)
    other: Callable[..., Log] | None = None
    scale: float = 1.0


_LOW = {"voltage": 200.0, "current": 250.0, "frequency": 150.0}
_FAST = {"frequency": 10e3 / 12 / 0.7, "reactance": 0.3}

KINDS: dict[str, Kind] = {
    "clean": Kind(),
    "command": Kind(change=wrong_logs.command),
    "every 5th sample": Kind(change=wrong_logs.every(5), duration=2.0),
    "means of 5": Kind(change=wrong_logs.means_of_5, duration=2.0),
    "valley rows": Kind(drive={"rate": 20e3}, change=wrong_logs.every(2)),
    "12 samples a turn": Kind(machine=_FAST, drive={"bandwidth": 0.02}, speeds=(0.7, 0.7)),
    "drone at 40 kHz": Kind(
        machine={"voltage": 22.0, "current": 40.0, "frequency": 1000.0, "pole_pairs": 7},
        drive={"rate": 40e3},
        duration=0.4,
    ),
    "23 pole pairs": Kind(machine={"pole_pairs": 23}),
    "60 pole pairs": Kind(machine={"pole_pairs": 60}),
    "wind generator": Kind(
        machine={
            "resistance": 1e-3,
            "voltage": 400.0,
            "current": 2000.0,
            "frequency": 25.0,
            "pole_pairs": 40,
        },
        drive={"rate": 5e3},
        duration=2.0,
    ),
    "servo of 10 ohm": Kind(
        machine={
            "resistance": 10.0,
            "voltage": 300.0,
            "current": 1.5,
            "frequency": 200.0,
            "reactance": 0.2,
        }
    ),
    "driving cycle": Kind(
        drive={"rate": 5e3}, reference="torque", profile="cycle", speeds=(0.5, 0.7), duration=24.0
    ),
    "sensorless angle": Kind(drive={"angle_per_load": 0.12}),
    "switched at 60 rpm": Kind(
        machine={**_LOW, "pole_pairs": 5},
        drive={"switched": True, "dead_time": 2e-6, "swing": 0.03, "on_state": 4e-3},
        rpm=60.0,
    ),
    "link ripple": Kind(drive={"ripple": 0.03}),
    "lost rows": Kind(change=wrong_logs.lost_rows),
    "jitter of the stamps": Kind(change=wrong_logs.jitter),
    "10 bits": Kind(drive={"bits": 10, "offset": 0.005}),
    "warming magnet": Kind(drive={"magnet_loss": 0.06}),
    "skewed harmonics": Kind(machine={"harmonics": 0.02, "skewed": True}),
    "current in 5 % of the time": Kind(reference="pulses", duration=2.0),
    "oscillating control": Kind(drive={"bandwidth": 0.125}),
    "dead time": Kind(drive={"dead_time": 1.5e-6, "swing": 0.02, "on_state": 3e-3}),
    "junctions at 20 V": Kind(
        machine={"voltage": 20.0}, drive={"dead_time": 1.5e-6, "swing": 0.02, "on_state": 0.035}
    ),
    "iron loss": Kind(drive={"iron_loss": 0.01}),
    "offset of phase b": Kind(drive={"offset": 0.01}),
    "gain of phase b": Kind(drive={"gain": 1.01}),
    "currents in kA": Kind(refuse=True, change=wrong_logs.in_kiloamperes, scale=1e3),
    "induction machine": Kind(refuse=True, other=other_machines.induction),
    "dc machine": Kind(refuse=True, other=other_machines.direct_current),
    "exchanged phases": Kind(refuse=True, change=wrong_logs.exchanged_phases),
    "swapped d and q": Kind(refuse=True, change=wrong_logs.swapped),
    "swapped currents": Kind(refuse=True, change=wrong_logs.swapped_currents),
    "noise alone": Kind(refuse=True, change=wrong_logs.noise),
    "shaft's speed": Kind(refuse=True, change=wrong_logs.shaft_speed),
    "shaft's speed, no angle": Kind(refuse=True, change=wrong_logs.shaft_speed_no_angle),
    "4 pole pairs for 5": Kind(True, {"pole_pairs": 5}, change=wrong_logs.pole_pairs_4_for_5),
    "4 pole pairs for 5, no angle": Kind(
        True, {"pole_pairs": 5}, change=wrong_logs.pole_pairs_4_for_5_no_angle
    ),
    "reversed speed": Kind(refuse=True, change=wrong_logs.reversed_speed),
    "degrees for radians": Kind(refuse=True, change=wrong_logs.degrees),
    "20 and 80 degrees": Kind(refuse=True, kelvin=(0.0, 60.0)),
}


@dataclass(frozen=True)
class Drawn:
    """Logs of one machine and what is known of it.

    Attributes
    ----------
    kind : str
    seed : int
    machine : Machine
    logs : tuple of Log
    """

    kind: str
    seed: int
    machine: Machine
    logs: tuple[Log, ...]

    @property
    def truth(self) -> dict[str, Any]:
        """What is known: R in the log's units, the map's samples in A and Vs."""
        kind, machine = KINDS[self.kind], self.machine
        rise = 1 + _COPPER * float(np.mean(kind.kelvin))
        grid = machine.rated_current * np.linspace(-1, 1, 9)
        currents = [complex(d, q) for d in grid for q in grid]
        flux = [machine.flux(current) for current in currents]
        return {
            "kind": self.kind,
            "seed": self.seed,
            "expectation": "refuse" if kind.refuse else "answer",
            "R": machine.resistance * rise * kind.scale,
            "pole_pairs": machine.pole_pairs,
            "rated_current": machine.rated_current,
            "flux_map": {
                "i_d": [i.real for i in currents],
                "i_q": [i.imag for i in currents],
                "psi_d": [psi.real for psi in flux],
                "psi_q": [psi.imag for psi in flux],
            },
        }

    def write(self, folder: Path, name: str) -> tuple[Path, ...]:
        """Write the logs as CSV and the truth beside them; return the files of the logs."""
        folder.mkdir(parents=True, exist_ok=True)
        ends = [""] if len(self.logs) == 1 else [f"_{k + 1}" for k in range(len(self.logs))]
        files = tuple(folder / f"{name}{end}.csv" for end in ends)
        for log, file in zip(self.logs, files, strict=True):
            log.write(file)
        (folder / f"{name}.json").write_text(json.dumps(self.truth))
        return files


def draw(kind_name: str, seed: int) -> Drawn:
    """Return the logs of a kind at a seed; the same ones whenever it is asked for.

    Parameters
    ----------
    kind_name : str
        Key of `KINDS`.
    seed : int
        Below `HELD_OUT` for developing, from there on for judging.
    """
    kind = KINDS[kind_name]
    random = np.random.default_rng([seed, *kind_name.encode()])
    machine = draw_machine(random, **kind.machine)
    logs = tuple(_log(kind, _warmed(machine, kelvin), random) for kelvin in kind.kelvin)
    return Drawn(kind_name, seed, machine, logs)


def _warmed(machine: Machine, kelvin: float) -> Machine:
    """Return the machine with winding and magnet warmer than they were."""
    lost = _MAGNET * kelvin * machine.flux(0j).real
    iron = machine.iron | {"magnet": machine.iron["magnet"] + lost}
    return replace(machine, resistance=machine.resistance * (1 + _COPPER * kelvin), iron=iron)


def _log(kind: Kind, machine: Machine, random: np.random.Generator) -> Log:
    drive = Drive(**kind.drive)
    times = np.arange(round(kind.duration * drive.rate)) / drive.rate
    speed = random.uniform(*kind.speeds) * machine.base_speed
    if kind.rpm:
        speed = kind.rpm * np.pi / 30 * machine.pole_pairs
    speeds = references.PROFILES[kind.profile](random.choice((-1, 1)) * speed, times, random)
    amplitude = random.uniform(0.6, 0.9) * machine.rated_current
    wanted = references.REFERENCES[kind.reference](amplitude, random)
    if kind.other is None:
        log = simulate(machine, drive, speeds, wanted, random)
    else:
        noise = drive.noise * machine.rated_current * random.normal(size=(2, len(times)))
        asked = wanted(times)
        log = kind.other(machine, speeds, asked, noise[0] + 1j * noise[1], 1 / drive.rate)
    log = log.rows(slice(round(0.02 * drive.rate), None))  # the control has taken hold
    return kind.change(log, machine, random) if kind.change else log
