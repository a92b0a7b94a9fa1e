"""Machines, drives and recordings drawn at random."""

from dataclasses import dataclass, replace

import numpy as np

from penode.bench.coenergies import SaturatingCoenergy
from penode.bench.drive import DEFAULT_DRIVE, Drive
from penode.bench.inverter import DeadTime, Inverter
from penode.bench.machines import TRACTION_300A, Machine
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.bench.sensors import CurrentSensors
from penode.data.experiment import Experiment
from penode.errors import InputError

_SCALED = (
    "leakage_d",
    "leakage_q",
    "shared_flux",
    "shared_current_d",
    "shared_current_q",
    "magnet_current",
    "own_flux",
    "own_current",
    "cross_flux",
    "cross_current",
    "magnet_flux",
)


@dataclass(frozen=True, eq=False)
class Drawn:
    """A recording drawn at random and the truth behind it.

    Attributes
    ----------
    machine : Machine
    run : Experiment
    description : str
        What was drawn, in a line.
    """

    machine: Machine
    run: Experiment
    description: str


def draw_machine(random: np.random.Generator) -> Machine:
    """Return an invented machine: every property of the iron by 0.75 to 1.33 of a traction motor's.

    The resistance is log-uniform over 3 to 20 mohm; the 6th harmonic has 0.3 to 2 % of the
    magnet's flux linkage, the 12th 0.4 of that.
    """
    iron = TRACTION_300A.coenergy
    assert isinstance(iron, SaturatingCoenergy)
    factors = np.exp(random.uniform(-np.log(4 / 3), np.log(4 / 3), len(_SCALED)))
    scaled = {n: float(f * getattr(iron, n)) for n, f in zip(_SCALED, factors, strict=True)}
    share = float(random.uniform(0.003, 0.02)) * TRACTION_300A.magnet_flux_linkage
    angle_6, angle_12 = random.uniform(0, 2 * np.pi, 2)
    harmonics = tuple(
        (order, float(part * share * np.cos(angle)), float(part * share * np.sin(angle)))
        for order, part, angle in ((6, 1.0, angle_6), (12, 0.4, angle_12))
    )
    return replace(
        TRACTION_300A,
        name="drawn",
        resistance=float(np.exp(random.uniform(np.log(3e-3), np.log(20e-3)))),
        coenergy=replace(iron, **scaled, harmonics=harmonics),
    )


def draw_recording(seed: int, drive: Drive = DEFAULT_DRIVE, duration: float = 1.0) -> Drawn:
    """Record a machine drawn at random on a trajectory and at a speed drawn at random.

    Parameters
    ----------
    seed : int
        Of every draw.
    drive : Drive
        The bench; ideal but for current noise of 0 to 0.3 A by default.
    duration : float
        s.

    Notes
    -----
    A drive that cannot follow its reference, at its voltage limit for instance, is drawn again.
    """
    random = np.random.default_rng(seed)
    for _ in range(20):
        machine = draw_machine(random)
        speed = float(random.choice((-1, 1)) * np.exp(random.uniform(np.log(300), np.log(3000))))
        rate = float(np.exp(random.uniform(np.log(12), np.log(120))))
        amplitude = float(random.uniform(150, 250))
        noise = float(random.uniform(0, 0.3))
        reference = Lissajous(amplitude, rate, rate * 13 / 12)
        noisy = replace(drive, current_noise=noise)
        what = {"speed_rpm": speed, "duration": duration, "drive": noisy, "seed": seed}
        try:
            run = simulate(machine, reference, **what)
        except InputError:
            continue
        told = f"{speed:5.0f} rpm, {rate:3.0f} rad/s, {amplitude:3.0f} A, noise {noise:.2f} A"
        return Drawn(machine, run, f"R {1e3 * machine.resistance:5.2f} mohm, {told}")
    raise RuntimeError(f"seed {seed}: no drive could follow its reference in 20 draws.")


@dataclass(frozen=True, eq=False)
class Campaign:
    """One to three recordings of one machine behind one imperfect drive, and the truth.

    Attributes
    ----------
    machine : Machine
    runs : tuple of Experiment
    hidden : Experiment
        At one speed from 1000 rpm, on a trajectory so slow that R and a skew part of a map can
        stand in for each other.
    dead_time_voltage : float
        V.
    description : str
        What was drawn, in a line.
    """

    machine: Machine
    runs: tuple[Experiment, ...]
    hidden: Experiment
    dead_time_voltage: float
    description: str


def draw_campaign(seed: int, duration: float = 1.0) -> Campaign:
    """Record a machine drawn at random, at one to three speeds, behind a drive drawn at random.

    Dead time 0 to 1 us at 400 V and 10 kHz, phase-current noise 0.1 to 0.2 % and offsets up to
    0.3 % of the amplitude, speeds log-uniform over 300 to 3000 rpm of either sign.

    Parameters
    ----------
    seed : int
        Of every draw.
    duration : float
        Of each recording, in s.
    """
    random = np.random.default_rng([seed, 6])
    while True:
        machine = draw_machine(random)
        drive, told = _draw_drive(random)
        count = int(random.integers(1, 4))
        try:
            runs = tuple(_draw_run(random, machine, drive, duration) for _ in range(count))
            slow = Lissajous(float(random.uniform(150, 250)), 14.0, 15.0)
            speed = float(random.uniform(1000, 2500))
            hidden = simulate(machine, slow, speed_rpm=speed, duration=duration, drive=drive)
        except InputError:
            continue
        speeds = ", ".join(f"{_rpm(run, machine):.0f}" for run in runs)
        named = tuple(replace(run, name=f"run {k + 1}") for k, run in enumerate(runs))
        text = f"R {1e3 * machine.resistance:5.2f} mohm, {told}, {speeds} rpm"
        dead = drive.inverter.dead_time
        lost = drive.dc_voltage * dead.duration / drive.time_step if dead else 0.0
        return Campaign(machine, named, hidden, lost, text)


def _draw_drive(random: np.random.Generator) -> tuple[Drive, str]:
    dead_time, noise = float(random.uniform(0, 1e-6)), float(random.uniform(0.2, 0.4))
    a, b = (float(x) for x in random.uniform(-0.6, 0.6, 2))
    drive = replace(
        DEFAULT_DRIVE,
        inverter=Inverter(dead_time=DeadTime(dead_time)),
        current_sensors=CurrentSensors(offset=(a, b, 0.0), noise=noise),
    )
    return drive, f"dead time {1e6 * dead_time:.2f} us, offsets {a:+.2f} {b:+.2f} A"


def _draw_run(
    random: np.random.Generator, machine: Machine, drive: Drive, duration: float
) -> Experiment:
    speed = float(random.choice((-1, 1)) * np.exp(random.uniform(np.log(300), np.log(3000))))
    rate = float(np.exp(random.uniform(np.log(12), np.log(120))))
    reference = Lissajous(float(random.uniform(150, 250)), rate, rate * 13 / 12)
    seed = int(random.integers(2**31))
    what = {"speed_rpm": speed, "duration": duration, "drive": drive, "seed": seed}
    return simulate(machine, reference, **what)


def _rpm(run: Experiment, machine: Machine) -> float:
    return float(np.mean(run.channels["omega_el"]) * 30 / np.pi / machine.pole_pairs)
