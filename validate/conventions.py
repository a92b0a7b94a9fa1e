"""Wrong conventions over drawn recordings: ``python -m validate.conventions [FIRST COUNT]``.

Each recording is a built-in machine on a trajectory, at a speed and behind a drive drawn at random:
dead time, current sensors, resolver and speed sensor are imperfect in four of five. Each is checked
as it is (any finding is a false alarm), and with each convention broken (anything but its own name
is a miss, or more than it a surplus). For a delay that cannot be told, the check has to say so.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from penode.bench.drive import Drive
from penode.bench.inverter import DeadTime, Inverter
from penode.bench.machines import MACHINES, Machine
from penode.bench.references import MOTOR, WHOLE_DISC, Domain, Lissajous
from penode.bench.run import simulate
from penode.bench.sensors import CurrentSensors, Resolver, SpeedSensor
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.pmsm.conventions.check import check_conventions
from penode.pmsm.machine.frames import abc_from_dq
from penode.pmsm.recording.name_plate import NamePlate

FIRST, COUNT = 24, 20
_U, _I = ("u_d", "u_q"), ("i_d", "i_q")
_DOMAINS = (WHOLE_DISC, WHOLE_DISC, MOTOR, Domain(d=(-1.0, 0.0)))


def draw(seed: int) -> tuple[Machine, Experiment]:
    """Record a built-in machine, 1 s long; a drive that cannot follow is drawn again."""
    random = np.random.default_rng([77, seed])
    while True:
        machine = list(MACHINES.values())[random.integers(4)]
        limit = machine.current_limit
        amplitude = float(random.uniform(0.35, 0.9) * limit)
        on = 0.0 if random.random() < 0.2 else 1.0
        dead_time = float(random.uniform(0, 1.5e-6)) * on
        sensors = CurrentSensors(
            gain=tuple(1 + on * random.uniform(-0.01, 0.01, 3)),
            offset=tuple(on * random.uniform(-0.003, 0.003, 3) * limit),
            noise=float(on * random.uniform(0, 0.002) * limit),
        )
        resolver = Resolver(
            offset=float(on * random.uniform(-0.009, 0.009)),
            orders=(
                (1.0, float(on * random.uniform(0, 0.0087)), float(random.uniform(0, 6))),
                (2.0, float(on * random.uniform(0, 0.006)), float(random.uniform(0, 6))),
            ),
            growth=0.002,
        )
        speed = SpeedSensor(
            noise=float(on * random.uniform(0, 0.005)),
            orders=((1.0, float(on * random.uniform(0, 0.002)), 0.0),),
        )
        drive = Drive(
            inverter=Inverter(dead_time=DeadTime(dead_time)),
            current_sensors=sensors,
            resolver=resolver,
            speed_sensor=speed,
            tuning=float(random.uniform(0.6, 1.0)),
        )
        rpm = float(random.choice((-1, 1)) * np.exp(random.uniform(np.log(150), np.log(3500))))
        rate = float(np.exp(random.uniform(np.log(10), np.log(150))))
        reference = Lissajous(amplitude, rate, rate * 13 / 12, _DOMAINS[random.integers(4)])
        what = {"speed_rpm": rpm, "duration": 1.0, "drive": drive, "seed": seed}
        try:
            return machine, simulate(machine, reference, **what)
        except InputError:
            continue


def _changed(run: Experiment, **channels: np.ndarray) -> Experiment:
    return replace(run, channels={**run.channels, **channels})


def _scaled(run: Experiment, factor: float, *names: str) -> Experiment:
    return _changed(run, **{name: factor * run.channels[name] for name in names})


def _blind(run: Experiment) -> Experiment:
    return replace(run, channels={n: x for n, x in run.channels.items() if n != "theta_el"})


def _phases(run: Experiment, *kept: str) -> Experiment:
    theta = run.channels["theta_el"]
    channels = {name: run.channels[name] for name in ("theta_el", *kept)}
    for kind in "ui":
        three = abc_from_dq(run.stack((f"{kind}_d", f"{kind}_q")), theta)
        channels |= {f"{kind}_{phase}": x for phase, x in zip("abc", three.T, strict=True)}
    return replace(run, channels=channels)


def _exchanged(run: Experiment, one: str, other: str) -> Experiment:
    return _changed(run, **{one: run.channels[other], other: run.channels[one]})


def _late(run: Experiment, samples: int, *names: str) -> Experiment:
    moved = _changed(run, **{name: np.roll(run.channels[name], samples) for name in names})
    return replace(moved, channels={n: x[3:-3] for n, x in moved.channels.items()})


def _aside(run: Experiment, random: np.random.Generator) -> Experiment:
    offset = np.radians(random.choice((-1, 1)) * random.uniform(10, 180))
    theta = np.mod(run.channels["theta_el"] + offset, 2 * np.pi)
    return _changed(_phases(run), theta_el=theta)


def _of_shaft(run: Experiment, pairs: int) -> Experiment:
    theta = np.mod(np.unwrap(run.channels["theta_el"]) / pairs, 2 * np.pi)
    return _changed(_phases(run), theta_el=theta)


@dataclass(frozen=True)
class Wrong:
    """One broken convention: the name it should get, empty for none, and how it is broken.

    ``how`` takes a recording, the pole pairs and a generator.
    """

    name: str
    how: Callable[[Experiment, int, np.random.Generator], Experiment]


WRONG = {
    "clean, dq": Wrong("", lambda e, p, r: e),
    "clean, dq without angle": Wrong("", lambda e, p, r: _blind(e)),
    "clean, phases": Wrong("", lambda e, p, r: _phases(e)),
    "clean, phases and speed": Wrong("", lambda e, p, r: _phases(e, "omega_el")),
    "current phases swapped": Wrong(
        "swapped phases",
        lambda e, p, r: _exchanged(_phases(e), *r.permutation(["i_a", "i_b", "i_c"])[:2]),
    ),
    "voltage phases swapped": Wrong(
        "swapped phases",
        lambda e, p, r: _exchanged(_phases(e), *r.permutation(["u_a", "u_b", "u_c"])[:2]),
    ),
    "negative i_q": Wrong("negative q current", lambda e, p, r: _scaled(e, -1, "i_q")),
    "negative u_q": Wrong("negative q voltage", lambda e, p, r: _scaled(_blind(e), -1, "u_q")),
    "mechanical speed": Wrong(
        "mechanical speed for electrical", lambda e, p, r: _scaled(e, 1 / p, "omega_el")
    ),
    "mechanical speed without angle": Wrong(
        "mechanical speed for electrical", lambda e, p, r: _scaled(_blind(e), 1 / p, "omega_el")
    ),
    "mechanical angle": Wrong("mechanical angle for electrical", lambda e, p, r: _of_shaft(e, p)),
    "voltages in rms": Wrong("rms for peak (voltages)", lambda e, p, r: _scaled(e, 0.5**0.5, *_U)),
    "currents in rms": Wrong("rms for peak (currents)", lambda e, p, r: _scaled(e, 0.5**0.5, *_I)),
    "voltages late": Wrong("one-sample delay", lambda e, p, r: _late(e, 1, *_U)),
    "voltages early": Wrong("one-sample delay", lambda e, p, r: _late(e, -1, *_U)),
    "phase voltages late": Wrong(
        "one-sample delay", lambda e, p, r: _late(_phases(e), 1, "u_a", "u_b", "u_c")
    ),
    "reversed speed": Wrong("reversed speed", lambda e, p, r: _scaled(e, -1, "omega_el")),
    "reversed speed without angle": Wrong(
        "reversed speed", lambda e, p, r: _scaled(_blind(e), -1, "omega_el")
    ),
    "degrees": Wrong("degrees for radians", lambda e, p, r: _scaled(e, 180 / np.pi, "theta_el")),
    "degrees, phases": Wrong(
        "degrees for radians", lambda e, p, r: _scaled(_phases(e), 180 / np.pi, "theta_el")
    ),
    "offset angle, 10 to 180 deg": Wrong("offset angle", lambda e, p, r: _aside(e, r)),
    "kA": Wrong("kA for A", lambda e, p, r: _scaled(e, 1e-3, *_I)),
    "u_q in mV": Wrong("different units (voltages)", lambda e, p, r: _scaled(e, 1e-3, "u_q")),
    "i_d in mA": Wrong(
        "different units (currents)", lambda e, p, r: _scaled(_blind(e), 1e-3, "i_d")
    ),
    "i_q in rms": Wrong("rms beside peak (currents)", lambda e, p, r: _scaled(e, 0.5**0.5, "i_q")),
    "duty": Wrong("duty for volts", lambda e, p, r: _scaled(e, 1 / 400, *_U)),
}


def main() -> None:
    """Print what was not found as it should be, then the table."""
    first, count = (int(text) for text in sys.argv[1:3]) if len(sys.argv) > 2 else (FIRST, COUNT)
    tally = {case: np.zeros(4, dtype=int) for case in WRONG}
    for seed in range(first, first + count):
        machine, run = draw(seed)
        plate = NamePlate(machine.magnet_flux_linkage, machine.resistance)
        for case, wrong in WRONG.items():
            random = np.random.default_rng([seed, len(case)])
            pairs = machine.pole_pairs if random.random() < 0.5 else None
            with threadpool_limits(1, "blas"):
                found = check_conventions(wrong.how(run, machine.pole_pairs, random), pairs, plate)
            names = [broken.name for broken in found.broken]
            hit = not wrong.name or wrong.name in names
            surplus = [name for name in names if name != wrong.name]
            told = not any("a delay" in sentence for sentence in found.undetermined)
            said = not hit and wrong.name == "one-sample delay" and not told
            tally[case] += (1, not hit and not said, said, bool(surplus))
            if not hit or surplus:
                what = "untold" if said else "missed" if not hit else "surplus"
                print(f"{seed:3d} {run.name}, {case}: {what} {', '.join(surplus)}", flush=True)
    print(f"{'':32s} recordings  missed  said untold  surplus")
    for case, (number, missed, untold, surplus) in tally.items():
        print(f"{case:32s} {number:10d} {missed:7d} {untold:12d} {surplus:8d}")


if __name__ == "__main__":
    main()
