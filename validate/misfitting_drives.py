"""Coverage on drives that no candidate explains.

``python -m validate.misfitting_drives [N] [K]``: N draws from number K on. The drives are those of
`validate.imperfect_drives` (delays of whole samples only, no gain of the voltages), but each has
one law that penode does not know, in turn: a knee of the inverter ``x / (1 + |x|^p)^(1/p)``,
neither tanh nor arctan nor the tail of a node; an iron current that grows with a power of the
induced voltage that is not one, as hysteresis (less) and excess loss make it; angle harmonics of a
coenergy at orders that are not 6, 12, 18 or 24. Each is one run of ``penode identify`` from a file,
nothing given, report included. Ctrl-C prints the table so far; the same command goes on.
"""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.bench.coenergies import SaturatingCoenergy
from penode.bench.drive import Drive
from penode.bench.inverter import DeviceDrop
from penode.bench.machines import Machine
from penode.bench.references import Lissajous
from penode.bench.run import record
from penode.bench.winding import IronLoss
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.fit.outcome import AGREED
from validate.drawn_recordings import draw_machine
from validate.identified import Identified, identified
from validate.imperfect_drives import draw_drive
from validate.ledger import Record, run_draws

COUNT = 150
LAWS = ("knee", "iron", "orders")


class PowerKnee(DeviceDrop):
    """``u_0 x / (1 + |x|^p)^(1/p)`` a phase, ``x = i/i_0``; the smaller p, the slower."""

    exponent: float = 2.0

    def drop(self, current: JaxArray) -> JaxArray:
        """Return the voltages (3,), V, lost at phase currents (3,), A."""
        scaled = current / self.current_scale
        # The square keeps the derivative at zero current finite.
        size = (scaled**2 + 1e-12) ** (self.exponent / 2)
        threshold = self.threshold * jnp.stack(self.phase_factors)
        return threshold * scaled / (1 + size) ** (1 / self.exponent)


class PowerIron(IronLoss):
    """``i = e/R (|e|/e_0)^q``: q = 0 is eddy currents, -0.5 excess loss, to -1 hysteresis."""

    exponent: float = 0.0
    # e_0, V.
    reference: float = 20.0

    def current(self, induced: JaxArray) -> JaxArray:
        """Return the current (2,), A, that the iron draws at omega J psi (2,), V."""
        size = jnp.sqrt(induced @ induced + 1e-6) / self.reference
        return induced / self.resistance * size**self.exponent


def with_law(
    random: np.random.Generator, law: str, machine: Machine, drive: Drive, speed_rpm: float
) -> tuple[Machine, Drive, str]:
    """Return machine and drive with a law that is no candidate, and what it is."""
    if law == "knee":
        a, b, exponent = (float(x) for x in random.uniform([0.9, 0.9, 0.7], [1.1, 1.1, 4.0]))
        threshold, width = float(random.uniform(0.2, 2.0)), float(random.uniform(1.0, 15.0))
        knee = PowerKnee(threshold, 0.0, width, (1.0, a, b), exponent=exponent)
        inverter = eqx.tree_at(
            lambda one: one.devices, drive.inverter, knee, is_leaf=lambda leaf: leaf is None
        )
        told = f"{threshold:.2f} V, {width:.1f} A, exponent {exponent:.1f}"
        return machine, replace(drive, inverter=inverter), told
    if law == "iron":
        resistance = float(np.exp(random.uniform(np.log(50.0), np.log(500.0))))
        exponent = float(random.uniform(-0.9, 0.6))
        induced = speed_rpm * np.pi / 30 * machine.pole_pairs * machine.magnet_flux_linkage
        iron = PowerIron(resistance, exponent, float(induced))
        told = f"{resistance:.0f} ohm at {induced:.0f} V, exponent {exponent:+.1f}"
        return machine, replace(drive, iron_loss=iron), told
    order = int(random.choice((2, 3, 4, 8, 9, 10, 15, 30)))
    share, angle = float(random.uniform(0.002, 0.01)), float(random.uniform(0, 2 * np.pi))
    size = share * machine.magnet_flux_linkage
    extra = (order, float(size * np.cos(angle)), float(size * np.sin(angle)))
    iron_map = machine.coenergy
    assert isinstance(iron_map, SaturatingCoenergy)
    iron_map = replace(iron_map, harmonics=(*iron_map.harmonics, extra))
    told = f"order {order}, {100 * share:.1f} % of psi_PM"
    return replace(machine, coenergy=iron_map), drive, told


def draw(number: int) -> tuple[Experiment, float, str, str]:
    """Return a recording of 1 s, the mean of R, the law's name and what it is."""
    random, law = np.random.default_rng([number, 36]), LAWS[number % len(LAWS)]
    while True:
        machine, (drive, there) = draw_machine(random), draw_drive(random)
        speed = float(np.exp(random.uniform(np.log(300), np.log(2500))))
        machine, drive, told = with_law(random, law, machine, drive, speed)
        rate = float(np.exp(random.uniform(np.log(12), np.log(120))))
        reference = Lissajous(float(random.uniform(150, 250)), rate, rate * 13 / 12)
        what = {"speed_rpm": speed, "duration": 1.0, "drive": drive, "seed": number}
        try:
            made = record(machine, reference, **what)
        except InputError:
            continue
        instead = {"knee": "inverter", "iron": "iron", "orders": ""}[law]
        beside = ", ".join(sorted(there - {instead}))
        temperature = float(np.mean(made.truth.trace.temperature))
        told = f"{told}; {speed:.0f} rpm; {beside or 'nothing beside'}"
        return made.experiment, machine.resistance_at(temperature), law, told


def result_of(number: int) -> Record:
    """Identify one draw with nothing given."""
    run, truth, law, told = draw(number)
    return record_of(identified(f"misfitting_drives/{number}", [run]), truth, law, told)


def record_of(done: Identified, truth: float, law: str, told: str) -> Record:
    """Return what became of a draw."""
    made: Record = {"law": law, "there": told, "verdict": done.verdict, "why": done.why}
    made |= {"noted": done.noted, "seconds": done.seconds}
    return made | done.resistance(truth)


def line_of(one: Record) -> str:
    """Return one line of the list."""
    noted = one["noted"] and f"  !! {one['noted']}"
    head, tail = f"{one['draw']:3d} {one['law']:6s}", f"[{one['there']}] {one['seconds']:.0f} s"
    if "error" not in one:
        return f"{head} {one['verdict']}: {one['why']} {tail}{noted}"
    covered = "covered" if one["covered"] else "MISSED"
    said = ", ".join(one["objections"])
    return (
        f"{head} R {100 * one['error']:+6.2f} % (std {100 * one['std']:.2f} %) {covered} "
        f"{one['verdict']} {said} {tail}{noted}"
    )


def print_table(draws: list[Record]) -> None:
    """Print coverage by law, then of all."""
    for law in (*dict.fromkeys(one["law"] for one in draws), "all"):
        of_it = [one for one in draws if law in (one["law"], "all")]
        good = [one for one in of_it if one["verdict"] in AGREED]
        if good:
            covered = sum(one["covered"] for one in good)
            error = 100 * np.median([abs(one["error"]) for one in good])
            print(
                f"{law:6s} {len(good)} of {len(of_it)} positive, {covered} cover "
                f"({100 * covered / len(good):.0f} %), median |error| {error:.2f} %, "
                f"std {100 * np.median([one['std'] for one in good]):.2f} %"
            )


if __name__ == "__main__":
    run_draws("misfitting_drives", COUNT, result_of, line_of, print_table)
