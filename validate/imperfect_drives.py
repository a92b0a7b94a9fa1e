"""Coverage on drives with every imperfection drawn.

``python -m validate.imperfect_drives [N] [K]``: N draws from number K on. Each imperfection is
there in every second draw: a delay of 0 to 1.45 samples, a hold in the stationary frame, an
inverter with a knee of either kind and phases that differ, iron loss, gains within the declared
accuracy, an angle offset to 2 degrees, a winding that warms. R's truth is its mean over the
recording. The width of its interval is compared with that of an identification that is given which
terms are absent (``--no-inverter``, ``--hold dq``). Both are runs of ``penode identify`` from a
file, report included; behind ``!!`` stands what neither should show. Ctrl-C prints the table so
far; the same command goes on.
"""

from dataclasses import replace

import numpy as np

from penode.bench.drive import Drive
from penode.bench.inverter import DeviceDrop, Inverter, RotorHold, StationaryHold
from penode.bench.machines import Machine
from penode.bench.references import Lissajous
from penode.bench.run import record
from penode.bench.sensors import CurrentSensors, Resolver
from penode.bench.winding import IronLoss, Warming, Winding
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.fit.outcome import AGREED
from validate.drawn_recordings import draw_machine
from validate.identified import Identified, identified
from validate.ledger import Record, run_draws

COUNT = 200


def draw_drive(random: np.random.Generator) -> tuple[Drive, frozenset[str]]:
    """Return a drive, and the names of the imperfections that it has."""
    names = ("delay", "hold", "inverter", "iron", "angle", "drift")
    there = frozenset(name for name in names if random.random() < 0.5)
    threshold, width = float(random.uniform(0.2, 2.0)), float(random.uniform(1.0, 15.0))
    a, b = (float(x) for x in random.uniform(0.9, 1.1, 2))
    devices = DeviceDrop(threshold, 0.0, width, (1.0, a, b), bool(random.random() < 0.5))
    inverter = Inverter(
        hold=StationaryHold(0.0) if "hold" in there else RotorHold(),
        devices=devices if "inverter" in there else None,
        delay=int(random.integers(0, 2)) if "delay" in there else 0,
    )
    gains = 1 + 0.005 * random.normal() + 0.002 * random.normal(size=3)
    offset = np.deg2rad(float(random.uniform(-2.0, 2.0)))
    warming = Warming(float(np.exp(random.uniform(np.log(25.0), np.log(250.0)))), 1.0)
    iron = IronLoss(float(np.exp(random.uniform(np.log(50.0), np.log(500.0)))))
    a, b, c = (float(gain) for gain in gains)
    drive = Drive(
        current_sensors=CurrentSensors(gain=(a, b, c), noise=0.1),
        inverter=inverter,
        resolver=Resolver(offset) if "angle" in there else None,
        iron_loss=iron if "iron" in there else None,
        winding=Winding(20.0, warming=warming if "drift" in there else None),
    )
    return drive, there


def draw(number: int) -> tuple[Experiment, float, frozenset[str], Machine]:
    """Return a recording of 1 s, the mean of R, what its drive has, and the machine."""
    random = np.random.default_rng([number, 7])
    while True:
        machine, (drive, there) = draw_machine(random), draw_drive(random)
        speed = float(np.exp(random.uniform(np.log(300), np.log(2500))))
        rate = float(np.exp(random.uniform(np.log(12), np.log(120))))
        reference = Lissajous(float(random.uniform(150, 250)), rate, rate * 13 / 12)
        what = {"speed_rpm": speed, "duration": 1.0, "drive": drive, "seed": number}
        gain, part = 1 + 0.005 * random.normal(), float(random.uniform(0.0, 0.45))
        try:
            made = record(machine, reference, **what)
        except InputError:
            continue
        run = _logged(made.experiment, float(gain), part if "delay" in there else 0.0)
        temperature = float(np.mean(made.truth.trace.temperature))
        return run, machine.resistance_at(temperature), there, machine


def _logged(run: Experiment, gain: float, part: float) -> Experiment:
    """Return a log whose voltages are read with a gain, a part of a sample before they act."""
    channels = dict(run.channels)
    for name in ("u_d", "u_q"):
        log = channels[name].copy()
        for k in range(1, len(log)):
            log[k] = (channels[name][k] - part * log[k - 1]) / (1 - part)
        channels[name] = gain * log
    return replace(run, channels=channels)


def result_of(number: int) -> Record:
    """Identify one draw, with nothing given and with what is absent given."""
    run, truth, there, _ = draw(number)
    done = identified(f"imperfect_drives/{number}", [run])
    absent = [] if "inverter" in there else ["--no-inverter"]
    absent += [] if there & {"delay", "hold", "iron", "angle"} else ["--hold", "dq"]
    known = identified(f"imperfect_drives/{number}_known", [run], *absent)
    return record_of(done, known, truth, there)


def record_of(done: Identified, known: Identified, truth: float, there: frozenset[str]) -> Record:
    """Return what became of a draw, identified with nothing given and with what is absent."""
    record: Record = {
        "there": sorted(there),
        "verdict": done.verdict,
        "why": done.why,
        "noted": "; ".join(filter(None, [done.noted, known.noted])),
        "told_std": np.inf if known.fit is None else known.fit.parameters["R"].std / truth,
        "seconds": done.seconds + known.seconds,
    }
    return record | done.resistance(truth)


def line_of(one: Record) -> str:
    """Return one line of the list."""
    told, noted = ", ".join(one["there"]) or "none", one["noted"] and f"  !! {one['noted']}"
    if "error" not in one:
        what = f"{one['verdict']}: {one['why']}"
        return f"{one['draw']:3d} {what} [{told}] {one['seconds']:.0f} s{noted}"
    return (
        f"{one['draw']:3d} R {100 * one['error']:+6.2f} % (std {100 * one['std']:.2f} %, told "
        f"{100 * one['told_std']:.2f} %) {'covered' if one['covered'] else 'MISSED'} "
        f"{one['verdict']} {one['objections'] or ''} [{told}] {one['seconds']:.0f} s{noted}"
    )


def print_table(draws: list[Record]) -> None:
    """Print coverage and widths."""
    good = [one for one in draws if one["verdict"] in AGREED]
    print(f"{len(good)} of {len(draws)} verdicts are positive;")
    if noted := sum(bool(one["noted"]) for one in draws):
        print(f"{noted} of {len(draws)} ended otherwise than promised or with a warning;")
    if good:
        print(f"95 % intervals of R cover in {100 * np.mean([g['covered'] for g in good]):.1f} %;")
        ratio = np.median([one["std"] / one["told_std"] for one in good])
        print(f"median width over that of what is told: {ratio:.2f};")
        print(f"median |error| {100 * np.median([abs(one['error']) for one in good]):.2f} %.")


if __name__ == "__main__":
    run_draws("imperfect_drives", COUNT, result_of, line_of, print_table)
