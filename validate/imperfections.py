"""Imperfect drives, identified with nothing given: ``python -m validate.imperfections [NAME ...]``.

One recording of 1.2 s at one speed of the built-in traction machine for each imperfection, written
to a file and identified by ``penode identify``, report included. Printed are the error of R with
its interval, that of the map in per cent of the magnet's flux linkage (mean absolute, in the
excited region), the verdict, and what the recording was corrected by; behind ``!!`` an exit status
that the command does not promise, a part of the report that was left out, a warning of Python. The
bench shares no code with the estimator.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from penode.bench.coenergy_table import true_flux_map
from penode.bench.drive import Drive
from penode.bench.inverter import DeadTime, DeviceDrop, Inverter, StationaryHold
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import record, simulate
from penode.bench.sensors import CurrentSensors, Resolver
from penode.bench.winding import IronLoss, Warming, Winding
from penode.data.experiment import Experiment
from penode.fit.fit import Fit
from penode.pmsm.result_files import GRID
from validate.identified import Identified, identified

MACHINE, SPEED, DURATION = TRACTION_300A, 1500.0, 1.2
REFERENCE = Lissajous(240.0, 14.0, 15.0)
#: Thresholds that differ from phase to phase, with a knee that large currents still round.
SOFT = DeviceDrop(1.0, 0.0, 15.0, (1.0, 1.15, 0.9), soft=True)
#: What every case shares: noise of the current sensors.
IDEAL = Drive(current_noise=0.05)


def held(advance: float, delay: int = 0) -> Drive:
    """Return a drive whose inverter holds the voltage in the stationary frame."""
    return replace(IDEAL, inverter=Inverter(StationaryHold(advance), delay=delay))


def recorded(drive: Drive = IDEAL) -> Experiment:
    """Return the recording of a drive."""
    return simulate(MACHINE, REFERENCE, speed_rpm=SPEED, duration=DURATION, drive=drive, seed=1)


def warmed() -> tuple[Experiment, float]:
    """Return a recording of a winding that warms, and its mean resistance."""
    drive = replace(IDEAL, winding=Winding(20.0, warming=Warming(30.0, 1.0)))
    made = record(MACHINE, REFERENCE, speed_rpm=SPEED, duration=DURATION, drive=drive, seed=1)
    temperature = float(np.mean(made.truth.trace.temperature))
    return made.experiment, MACHINE.resistance_at(temperature)


def late(samples: float) -> Experiment:
    """Return a log whose voltages stand so many samples before those that act."""
    run = recorded()
    whole, part = int(samples), samples % 1.0
    channels = dict(run.channels)
    for name in ("u_d", "u_q"):
        log = channels[name].copy()
        if part:  # of two logged voltages the mean acts: logged = (acting - part before) / rest
            for k in range(1, len(log)):
                log[k] = (channels[name][k] - part * log[k - 1]) / (1 - part)
        channels[name] = np.roll(log, -whole)
    keep = slice(0, len(run) - whole)
    return replace(run, channels={name: values[keep] for name, values in channels.items()})


def scaled(names: Sequence[str], factor: float) -> Experiment:
    """Return a log with channels that are read too large."""
    run = recorded()
    changed = {name: factor * run.channels[name] for name in names}
    return replace(run, channels={**run.channels, **changed})


def lagging_speed() -> Experiment:
    """Return a log of a swinging speed behind a filter of 5 Hz."""

    def speed(time: np.ndarray) -> np.ndarray:
        return SPEED * (1 + 0.1 * np.sin(2 * np.pi * 2.0 * time))

    run = simulate(MACHINE, REFERENCE, speed_rpm=speed, duration=DURATION, drive=IDEAL, seed=1)
    memory, slow = run.channels["omega_el"][0], []
    for value in run.channels["omega_el"]:
        memory += 2 * np.pi * 5.0 * run.time_step * (value - memory)
        slow.append(memory)
    return replace(run, channels={**run.channels, "omega_el": np.array(slow)})


CASES: dict[str, Callable[[], Experiment | tuple[Experiment, float]]] = {
    "none": recorded,
    "stationary hold": lambda: recorded(held(0.0)),
    "stationary hold, 1 sample": lambda: recorded(held(0.0, 1)),
    "1.5 act, 1 compensated": lambda: recorded(held(1.0, 1)),
    "delay of 1 sample": lambda: late(1.0),
    "delay of 0.4 samples": lambda: late(0.4),
    "delay of 1.4 samples": lambda: late(1.4),
    "angle 2 degrees": lambda: recorded(replace(IDEAL, resolver=Resolver(np.deg2rad(2.0)))),
    "angle -5 degrees": lambda: recorded(replace(IDEAL, resolver=Resolver(np.deg2rad(-5.0)))),
    "iron loss 50 ohm": lambda: recorded(replace(IDEAL, iron_loss=IronLoss(50.0))),
    "iron loss 10 ohm": lambda: recorded(replace(IDEAL, iron_loss=IronLoss(10.0))),
    "hold, delay, angle, iron": lambda: recorded(
        replace(held(0.0, 1), resolver=Resolver(np.deg2rad(2.0)), iron_loss=IronLoss(20.0))
    ),
    "R drifts": warmed,
    "dead time": lambda: recorded(replace(IDEAL, inverter=Inverter(dead_time=DeadTime(0.6e-6)))),
    "device drops": lambda: (
        recorded(replace(IDEAL, inverter=Inverter(devices=DeviceDrop(0.9, 1e-3)))),
        MACHINE.resistance + 1e-3,  # the on-resistance is part of R
    ),
    "soft knee": lambda: recorded(
        replace(IDEAL, inverter=Inverter(devices=DeviceDrop(1.0, 0.0, 5.0, soft=True)))
    ),
    "soft knee by phase": lambda: recorded(replace(IDEAL, inverter=Inverter(devices=SOFT))),
    "soft knee, delay, angle": lambda: recorded(
        replace(
            IDEAL,
            inverter=Inverter(StationaryHold(0.0), devices=SOFT, delay=1),
            resolver=Resolver(np.deg2rad(2.0)),
        )
    ),
    "one phase's gain 1 %": lambda: recorded(
        replace(IDEAL, current_sensors=CurrentSensors(gain=(1.01, 1.0, 1.0)))
    ),
    "all current gains 1 %": lambda: scaled(("i_d", "i_q"), 1.01),
    "voltage gain 1 %": lambda: scaled(("u_d", "u_q"), 1.01),
    "speed behind 5 Hz": lagging_speed,
}


def map_error(fit: Fit) -> float:
    """Return the mean absolute error of the map in the excited region, % of psi_PM."""
    low, high = fit.excited.min(axis=0), fit.excited.max(axis=0)
    axes = [np.linspace(a, b, GRID) for a, b in zip(low, high, strict=True)]
    mesh = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    mesh = mesh[fit.supported(mesh)]
    psi = np.asarray(true_flux_map(MACHINE, *mesh.T)).reshape(len(mesh), 2)
    gap = fit.flux_map(*mesh.T).T - psi
    return 100 * float(np.abs(gap).mean()) / MACHINE.magnet_flux_linkage


def text_of(name: str, done: Identified, true: float) -> str:
    """Return the line of a case, and what the recording was corrected by below it."""
    fit, end = done.fit, f"{done.seconds:5.0f}  {done.verdict}{done.told}"
    if fit is None:
        return f"{name:25} {'-':>8} {'-':>8} {'-':>8} {'-':>9} {end}: {done.why}"
    estimate = fit.parameters["R"]
    low, high = (100 * (bound / true - 1) for bound in estimate.interval_95)
    line = (
        f"{name:25} {100 * (estimate.value / true - 1):+8.2f} {low:+8.2f} {high:+8.2f} "
        f"{map_error(fit):9.4f} {end}"
    )
    reasons = [
        f"    {reason}"
        for reason in fit.provenance["structure"]
        if not reason.startswith(("Dead time was left out", "Angle harmonics"))
    ]
    return "\n".join([line, *reasons])


def main() -> None:
    """Print a line an imperfection, and what was found of it."""
    print("                           R in %    95 % interval     map in %   s  verdict")
    for name in sys.argv[1:] or CASES:
        made = CASES[name]()
        run, true = made if isinstance(made, tuple) else (made, MACHINE.resistance)
        print(text_of(name, identified(f"imperfections/{name}", [run]), true), flush=True)


if __name__ == "__main__":
    main()
