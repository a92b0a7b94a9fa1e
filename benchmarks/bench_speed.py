"""Speed and memory of the simulated bench: ``taskset -c 0 python -m benchmarks.bench_speed``.

2 s at 10 kHz on one core after compilation, with dead time and sensors, beside the ideal drive.
Accuracy comes first: the sampled currents are compared with those of a run on 16 times as many
integration steps, and nothing is timed where they differ by more than 1e-4 of the current limit.
"""

import resource
import statistics
import time
from dataclasses import replace

import numpy as np

from penode.bench import rig
from penode.bench.drive import Drive
from penode.bench.inverter import DeadTime, DeviceDrop, Inverter, StationaryHold
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.bench.sensors import CurrentSensors, Quantisation, Resolver, SpeedSensor
from penode.bench.winding import IronLoss, Warming, Winding
from penode.data.experiment import Experiment

IDEAL = Drive()
REAL = Drive(
    inverter=Inverter(StationaryHold(1.5), dead_time=DeadTime(0.5e-6), delay=1),
    current_sensors=CurrentSensors(
        gain=(1.0, 1.01, 0.99),
        offset=(0.9, -0.6, 0.0),
        noise=0.4,
        quantisation=Quantisation(400.0, 12),
    ),
    resolver=Resolver(0.002, ((1.0, 0.005, 0.3), (2.0, 0.004, 1.0)), growth=1 / 300),
    speed_sensor=SpeedSensor(0.002, ((1.0, 0.001, 0.0),)),
)
EVERYTHING = replace(
    REAL,
    inverter=replace(REAL.inverter, devices=DeviceDrop(1.0, 1e-3)),
    current_sensors=CurrentSensors(noise=0.4, cutoff_hz=3000.0),
    winding=Winding(80.0, (1.0, 1.02, 0.98), Warming(2000.0, 0.05)),
    iron_loss=IronLoss(20.0),
)
DRIVES = {"ideal": IDEAL, "dead time and sensors": REAL, "everything": EVERYTHING}
REPEATS = 5
BUDGET_S = 2.0


def recorded(drive: Drive, duration: float = 2.0) -> Experiment:
    """Return the paper's run on a drive."""
    reference = Lissajous(300.0, 14.0, 15.0)
    return simulate(TRACTION_300A, reference, speed_rpm=1500.0, duration=duration, drive=drive)


def check_accuracy(name: str, drive: Drive, duration: float = 0.2) -> float:
    """Return the largest current error in A, against 16 times as many steps."""
    # Quantisation and noise would hide, or amplify, what the integration leaves.
    sensors = drive.current_sensors
    if sensors is not None:
        drive = replace(drive, current_sensors=replace(sensors, noise=0.0, quantisation=None))
    coarse, steps = recorded(drive, duration), rig.substeps
    rig.substeps = lambda *inputs: 16 * steps(*inputs)
    try:
        fine = recorded(drive, duration)
    finally:
        rig.substeps = steps
    currents = [run.stack(["i_d", "i_q"]) for run in (coarse, fine)]
    error = float(np.abs(currents[0] - currents[1]).max())
    if error > 1e-4 * TRACTION_300A.current_limit:
        raise SystemExit(f"{name}: currents differ by {error:.1e} A; nothing is timed.")
    return error


def median_time(drive: Drive) -> float:
    """Return the median wall time in s of the 2 s run, after one run to compile."""
    recorded(drive)
    times = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        recorded(drive)
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def peak_mebibytes() -> float:
    """Return the largest memory this process has held in MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Print accuracy, times, ratios and memory."""
    print(f"2 s at 10 kHz, {TRACTION_300A.name}, 1500 rpm, medians of {REPEATS}, after compilation")
    errors = {name: check_accuracy(name, drive) for name, drive in DRIVES.items()}
    times = {name: median_time(drive) for name, drive in DRIVES.items()}
    for name, seconds in times.items():
        print(
            f"{name:>22}: {seconds:5.2f} s  {seconds / times['ideal']:5.2f}x ideal   "
            f"integration error {errors[name]:.0e} A"
        )
    verdict = "within" if times["dead time and sensors"] < BUDGET_S else "over"
    print(f"dead time and sensors: {verdict} the budget of {BUDGET_S:g} s")
    before = peak_mebibytes()
    rows = len(recorded(REAL, 60.0))
    channels = rows * 6 * 8 / 2**20
    print(
        f"60 s ({rows} rows, {channels:.0f} MiB of channels): peak memory {before:.0f} -> "
        f"{peak_mebibytes():.0f} MiB"
    )


if __name__ == "__main__":
    main()
