"""Drawn benches measured at operating points: ``python -m validate.operating_points [COUNT]``.

``... beside [COUNT]``: points with their torque and a recording of 1 s of the same machine with
the same gains, by ``penode identify run.csv --points points.csv``, report included, beside what the
recording and the points say alone (COUNT 20).

``... torque [COUNT]``: the recording alone, with the shaft's torque and without it (COUNT 20).

Each of COUNT (200) draws is one of the bench's machines at 24 to 60 points over its currents, at
one speed or at three, whose voltages, currents and torque are means over seconds. What the bench
has of every imperfection is drawn from an ordinary bench's accuracy: gains of currents, voltages,
speed and torque, the angle of the d axis, when the voltages act, iron loss, friction, and an
inverter that takes or gives some hundredths of the voltage. The plant is written down here and
shares nothing with what identifies it. Every draw is written as a CSV file and identified with its
torque and without it, as ``penode identify`` does but for the report; every tenth by the command
itself, report included.

Printed is a line a draw, and of both how many verdicts are positive, how many of their intervals of
R and of the inverter's voltage cover, the median width and the largest error.
"""

import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, float64
from penode.bench.drive import Drive
from penode.bench.machines import MACHINES, Machine, machine
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.bench.sensors import CurrentSensors
from penode.data.experiment import Experiment
from penode.data.save import save
from penode.fit.fit import Fit
from penode.fit.outcome import AGREED
from penode.pmsm.points.identify import ANSWERED, identify_points
from penode.pmsm.points.operating_points import load_runs
from penode.pmsm.study_file import load_study
from validate.command import identify

COUNT = 200
_ANGLES = np.linspace(0.0, 2 * np.pi, 12, endpoint=False)


@dataclass(frozen=True, eq=False)
class Bench:
    """Columns of a table of operating points, and the truth behind them."""

    columns: Mapping[str, FloatArray]
    pole_pairs: int
    # R in ohm and the inverter's voltage along the current in V.
    truth: Mapping[str, float]
    of: Machine
    # Gains of currents, voltages and speed.
    gains: FloatArray


def flux(of: Machine, currents: FloatArray) -> FloatArray:
    """Return the flux linkage d + j q in Vs, averaged over the angle, at currents d + j q in A."""

    def energy(pair: jax.Array, angle: jax.Array) -> jax.Array:
        return of.coenergy(pair[0], pair[1], angle)

    with float64():
        slope = jax.vmap(jax.vmap(jax.grad(energy), (0, None)), (None, 0))
        pairs = jnp.stack([currents.real, currents.imag], axis=1)
        mean = np.asarray(slope(pairs, jnp.asarray(_ANGLES))).mean(axis=0)
    return np.asarray(mean[:, 0] + 1j * mean[:, 1])


def drawn(number: int) -> Bench:
    """Return a bench by its number."""
    random = np.random.default_rng([36, number])
    of = machine(random.choice(list(MACHINES)))
    count = int(random.integers(24, 61))
    size = of.current_limit * np.sqrt(random.uniform(0.02, 1.0, count))
    through = size * np.exp(1j * random.uniform(np.pi / 2 - 1.7, 3 * np.pi / 2 + 0.2, count))
    rated = of.dc_voltage / np.sqrt(3) / of.magnet_flux_linkage
    speeds = [random.uniform(0.2, 0.6)] if random.random() < 0.5 else [0.1, 0.3, 0.5]
    speed = rated * random.choice(speeds, count) * (1 + 0.005 * random.normal(size=count))
    friction = random.uniform(0.0, 0.01) * 1.5 * of.pole_pairs * of.magnet_flux_linkage
    friction *= of.current_limit
    psi = flux(of, through)
    induced = 1j * speed * psi
    conductance = random.uniform(0.0, 0.03) * np.abs(through).max() / np.abs(induced).max()
    current = through + conductance * induced
    largest = float(np.abs(induced).max())
    lost = random.normal() * 0.02 * largest
    bent = current / np.hypot(np.abs(current), 0.01 * of.current_limit)
    voltage = of.resistance * current + lost * bent + induced
    torque = 1.5 * of.pole_pairs * np.imag(np.conj(psi) * through) - friction
    gains = 1 + random.normal(size=4) * [0.005, 0.005, 0.0005, 0.005]
    turned = np.exp(-1j * np.deg2rad(0.5) * random.normal())
    late = np.exp(-1j * speed * 50e-6 * random.normal())
    noise = random.uniform(0.0005, 0.005, 3) * [of.current_limit, largest, np.abs(torque).max()]

    def read(vector: FloatArray, deviation: float) -> FloatArray:
        more = random.normal(size=count) + 1j * random.normal(size=count)
        return np.asarray(vector * turned + deviation * more)

    current, voltage = (
        read(gains[0] * current, 0.1 * noise[0]),
        read(gains[1] * voltage * late, noise[1]),
    )
    columns = {
        "i_d": current.real, "i_q": current.imag, "u_d": voltage.real, "u_q": voltage.imag,
        "omega_el": gains[2] * speed,
        "torque": gains[3] * torque + noise[2] * random.normal(size=count),
    }  # fmt: skip
    truth = {"R": of.resistance, "inverter_voltage": lost}
    return Bench(columns, of.pole_pairs, truth, of, gains[:3])


def recorded(bench: Bench, number: int) -> Experiment:
    """Return a recording of the machine, by sensors of the same gains."""
    of, random = bench.of, np.random.default_rng([37, number])
    rate = float(np.exp(random.uniform(np.log(12), np.log(120))))
    reference = Lissajous(0.7 * of.current_limit, rate, rate * 13 / 12)
    rated = of.dc_voltage / np.sqrt(3) / of.magnet_flux_linkage / of.pole_pairs
    sensors = CurrentSensors(noise=2e-3 * of.current_limit)
    speed_rpm = float(random.uniform(0.05, 0.25) * rated * 30 / np.pi)
    what = {"speed_rpm": speed_rpm, "duration": 1.0, "seed": number}
    run = simulate(of, reference, **what, drive=Drive(current_sensors=sensors))
    kinds = (("i_d", "i_q"), ("u_d", "u_q"), ("omega_el",))
    scaled = {
        name: gain * run.channels[name]
        for gain, names in zip(bench.gains, kinds, strict=True)
        for name in names
    }
    return replace(run, channels={**run.channels, **scaled})


@dataclass(frozen=True)
class Outcome:
    """What became of a draw."""

    verdict: str
    resistance: bool
    # Whether the interval of the inverter's voltage covers, where it is asked for.
    inverter: bool
    # Half width of the interval of R over R.
    width: float
    # By how much R errs, over R.
    error: float

    @classmethod
    def of(cls, fit: Fit, truth: Mapping[str, float]) -> "Outcome":
        """Return the outcome of a fit beside its truth."""
        inside = []
        for name, true in truth.items():
            low, high = fit.parameters[name].interval_95
            inside.append(low <= true <= high)
        resistance, true = fit.parameters["R"], truth["R"]
        half = resistance.interval_95[1] - resistance.value
        covers = inside if len(inside) > 1 else [*inside, True]
        return cls(fit.horizon.verdict, *covers, half / true, resistance.value / true - 1)


def beside(number: int) -> dict[str, Outcome]:
    """Identify a recording alone, its points alone, and both together, by the command."""
    bench, found = drawn(number), {}
    options = ["--pole-pairs", str(bench.pole_pairs)]
    with tempfile.TemporaryDirectory() as folder:
        run, points = Path(folder) / "run.csv", Path(folder) / "points.csv"
        save(recorded(bench, number), run)
        _write(points, bench.columns)
        both = ["--points", str(points)]
        cases = {"recording": (run, []), "points": (points, []), "both": (run, both)}
        for name, (file, more) in cases.items():
            ended = identify([file], Path(folder) / name, *options, *more)
            found[name] = Outcome.of(ended.fit(), {"R": bench.truth["R"]})
    return found


def with_torque(number: int) -> dict[str, tuple[Outcome, float, float, float]]:
    """Identify a recording with the shaft's torque and without, by the command.

    Of both the outcome, the root mean square of the map's error and of its half width over the
    largest flux linkage, and the share of its 95 % bands that cover, at recorded currents.
    """
    bench, run, found = drawn(number), recorded(drawn(number), number), {}
    random = np.random.default_rng([38, number])
    gain = bench.gains[0]
    current = (run.channels["i_d"] + 1j * run.channels["i_q"]) / gain
    torque = 1.5 * bench.pole_pairs * np.imag(np.conj(flux(bench.of, current)) * current)
    largest = np.abs(torque).max()
    torque = (1 + 0.005 * random.normal()) * (torque - random.uniform(0.0, 0.01) * largest)
    torque = torque + 0.01 * largest * random.normal(size=len(torque))
    places = run.stack(("i_d", "i_q"))[::200]
    truth = flux(bench.of, places[:, 0] + 1j * places[:, 1])
    with tempfile.TemporaryDirectory() as folder:
        for name, more in (("without", {}), ("with", {"torque": torque})):
            file = Path(folder) / f"{name}.csv"
            save(replace(run, channels={**run.channels, **more}), file)
            ended = identify([file], Path(folder) / name, "--pole-pairs", str(bench.pole_pairs))
            fit = ended.fit()
            gap = fit.flux_map(*places.T) - np.stack([truth.real, truth.imag])
            half = 1.96 * fit.learned_deviation(places).T
            sizes = [float(np.sqrt(np.mean(one**2)) / np.abs(truth).max()) for one in (gap, half)]
            outcome = Outcome.of(fit, {"R": bench.truth["R"]})
            found[name] = outcome, *sizes, float(np.mean(np.abs(gap) <= half))
    return found


def main_torque(count: int) -> None:
    """Print a line a draw, and what the torque brings."""
    every = []
    for number in range(count):
        every.append(with_torque(number))
        parts = [
            f"{name} {o.verdict} R {100 * o.error:+.2f} ± {100 * o.width:.2f} %, map "
            f"{100 * error:.3f} ± {100 * half:.3f} %, {100 * covered:.0f} % cover"
            for name, (o, error, half, covered) in every[-1].items()
        ]
        print(f"{number:3d} {'; '.join(parts)}", flush=True)
    for name in every[0]:
        sure = [one[name] for one in every if one[name][0].verdict in AGREED]
        print(
            f"{name} torque: {len(sure)} of {count} positive, intervals of R cover in "
            f"{100 * np.mean([one[0].resistance for one in sure]):.0f} %, bands of the map in "
            f"{100 * np.mean([one[3] for one in sure]):.0f} %; half width of R "
            f"{100 * np.median([one[0].width for one in sure]):.2f} %, of the map "
            f"{100 * np.median([one[2] for one in sure]):.3f} %, its error "
            f"{100 * np.median([one[1] for one in sure]):.3f} %"
        )


def _write(file: Path, columns: Mapping[str, FloatArray]) -> None:
    rows = np.column_stack(list(columns.values()))
    np.savetxt(file, rows, "%.9g", ",", header=",".join(columns), comments="")


def main_beside(count: int) -> None:
    """Print a line a draw, and how many intervals cover, how wide in the median, how many wider."""
    every = []
    for number in range(count):
        every.append(beside(number))
        parts = [
            f"{name} {o.verdict} {100 * o.error:+.2f} ± {100 * o.width:.2f} %"
            f"{'' if o.resistance else ' *'}"
            for name, o in every[-1].items()
        ]
        print(f"{number:3d} {'; '.join(parts)}", flush=True)
    for name in every[0]:
        sure = [one[name] for one in every if one[name].verdict in (ANSWERED, *AGREED)]
        covered = np.mean([one.resistance for one in sure])
        width = np.median([one.width for one in sure])
        print(
            f"{name}: {len(sure)} of {count} positive, {100 * covered:.0f} % cover, half width "
            f"{100 * width:.2f} %"
        )
    wider = [one["both"].width / min(one["recording"].width, one["points"].width) for one in every]
    print(f"both over the narrower of either: {np.median(wider):.2f}, at most {max(wider):.2f}")


def identified(bench: Bench, torque: bool, command: bool) -> Outcome:
    """Write a bench as a CSV file and identify it."""
    columns = {n: v for n, v in bench.columns.items() if torque or n != "torque"}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "points.csv"
        _write(file, columns)
        options = ["--pole-pairs", str(bench.pole_pairs)]
        if command:
            return Outcome.of(identify([file], Path(folder) / "out", *options).fit(), bench.truth)
        study = load_study(None, {"pole_pairs": bench.pole_pairs})
        _, points = load_runs([file], study.mapping)
        assert points is not None
        return Outcome.of(identify_points(points, study.study), bench.truth)


def main(count: int) -> None:
    """Identify every draw with its torque and without, and print what became of them."""
    found: dict[bool, list[Outcome]] = {True: [], False: []}
    for number in range(count):
        bench = drawn(number)
        for torque, outcomes in found.items():
            one = identified(bench, torque, number % 10 == 0)
            outcomes.append(one)
            print(
                f"{number:3d} {'with' if torque else 'without':7s} torque {one.verdict:16s} "
                f"R {100 * one.error:+.1f} ± {100 * one.width:.1f} %"
                f"{'' if one.resistance else ' *'}{'' if one.inverter else ' inverter *'}",
                flush=True,
            )
    print_table(found)


def print_table(found: Mapping[bool, Sequence[Outcome]]) -> None:
    """Print of both how many are positive and how many of their intervals cover."""
    for torque, outcomes in found.items():
        sure = [one for one in outcomes if one.verdict == ANSWERED]
        covered, inverter = (
            100 * np.mean([getattr(one, name) for one in sure])
            for name in ("resistance", "inverter")
        )
        print(
            f"{'with' if torque else 'without'} torque: {len(sure)} of {len(outcomes)} positive; "
            f"intervals of R cover in {covered:.1f} %, of the inverter's voltage in "
            f"{inverter:.1f} %; half width of R {100 * np.median([o.width for o in sure]):.1f} %, "
            f"largest error {100 * max(abs(o.error) for o in sure):.1f} %"
        )


if __name__ == "__main__":
    modes = {"beside": main_beside, "torque": main_torque}
    if sys.argv[1:2] and sys.argv[1] in modes:
        modes[sys.argv[1]](int(sys.argv[2]) if len(sys.argv) > 2 else 20)
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else COUNT)
