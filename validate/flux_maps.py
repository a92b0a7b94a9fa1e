"""Flux maps on machines of other classes and on thin data: ``python -m validate.flux_maps``.

Every recording is identified with the default map and with the convex network. The error is the
mean absolute one over the excited region, in per cent of the largest |psi| there; over the
rectangle around it the table must be finite, rise along its own axis and have a positive definite
differential inductance. ``python -m validate.flux_maps NAME ...`` runs some cases alone.
"""

import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from penode.bench.coenergies import SaturatingCoenergy
from penode.bench.drive import Drive
from penode.bench.machines import TRACTION_300A, Machine
from penode.bench.references import MOTOR, Lissajous, Reference, Steps
from penode.bench.run import simulate
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.pmsm.study import identify
from penode.pmsm.study_settings import Study
from validate.map_errors import error_and_coverage, rectangle

AMPLITUDE = 240.0


def iron(**changes: float) -> Machine:
    """Return the traction machine with other iron, without slots."""
    coenergy = TRACTION_300A.coenergy
    assert isinstance(coenergy, SaturatingCoenergy)
    return replace(
        TRACTION_300A,
        name="changed",
        coenergy=replace(coenergy, harmonics=(), **changes),
        angle_orders=(),
    )


def surface() -> Machine:
    """Return a machine without saliency: the same iron along both axes."""
    shared = {"shared_current_d": 300.0, "shared_current_q": 300.0, "magnet_current": 150.0}
    return iron(
        leakage_d=150e-6,
        leakage_q=150e-6,
        own_flux=0.0,
        cross_flux=0.0,
        magnet_flux=40e-3,
        **shared,
    )


def reluctance() -> Machine:
    """Return a machine without magnets."""
    return iron(magnet_flux=0.0, magnet_current=0.0, leakage_d=300e-6, shared_flux=15e-3)


def saturated() -> Machine:
    """Return a machine whose iron saturates at a third of the current."""
    return iron(
        shared_current_d=85.0,
        shared_current_q=75.0,
        magnet_current=85.0,
        own_current=45.0,
        cross_current=70.0,
    )


def only_d(time: np.ndarray) -> np.ndarray:
    """Return a sweep of i_q alone at i_d = 0."""
    return np.stack([np.zeros_like(time), AMPLITUDE * np.sin(15.0 * time)], axis=-1)


def staircase() -> Steps:
    """Return twenty operating points in the disc."""
    angle = 2.399963 * np.arange(20)
    radius = AMPLITUDE * np.sqrt((np.arange(20) + 0.5) / 20)
    points = zip(radius * np.cos(angle), radius * np.sin(angle), strict=True)
    return Steps(tuple((float(d), float(q)) for d, q in points), 0.05)


@dataclass(frozen=True)
class Case:
    """A machine and how it is recorded."""

    machine: Callable[[], Machine]
    reference: Reference
    duration: float = 1.0
    noise: float = 0.05

    def record(self) -> Experiment:
        """Return the recording."""
        drive = Drive(current_noise=self.noise)
        return simulate(
            self.machine(),
            self.reference,
            speed_rpm=1500.0,
            duration=self.duration,
            drive=drive,
            seed=1,
        )


SWEEP = Lissajous(AMPLITUDE, 14.0, 15.0)
CASES: dict[str, Case] = {
    "surface": Case(surface, SWEEP),
    "reluctance": Case(reluctance, SWEEP),
    "saturated": Case(saturated, SWEEP),
    "i_d = 0 only": Case(iron, only_d),
    "motor quadrant": Case(iron, Lissajous(AMPLITUDE, 14.0, 15.0, MOTOR)),
    "0.1 s": Case(iron, Lissajous(AMPLITUDE, 140.0, 150.0), duration=0.1),
    "20 points": Case(iron, staircase()),
    "3 % noise": Case(iron, SWEEP, noise=0.03 * AMPLITUDE),
}


def figures(fit: Fit, machine: Machine) -> Mapping[str, float]:
    """Return the error in per cent, its band's coverage, and the smallest inductances in mH."""
    error, covered = error_and_coverage(fit, machine)
    inductance = np.moveaxis(fit.differential_inductance(*rectangle(fit).T), -1, 0)
    return {
        "MAE %": 100 * error,
        "band %": 100 * covered,
        "L_d": 1e3 * float(inductance[:, 0, 0].min()),
        "L_q": 1e3 * float(inductance[:, 1, 1].min()),
        "L": 1e3 * float(np.linalg.eigvalsh(inductance)[:, 0].min()),
    }


def main() -> None:
    """Print a line a case and map."""
    for name in sys.argv[1:] or CASES:
        case = CASES[name]
        run, machine = case.record(), case.machine()
        for kind in ("coenergy", "convex"):
            began = time.perf_counter()
            try:
                fit = identify([run], study=Study(flux_map=kind))
            except InputError as error:
                print(f"{name:16} {kind:9} {error}", flush=True)
                continue
            wall = time.perf_counter() - began
            found = ", ".join(f"{k} {v:.3g}" for k, v in figures(fit, machine).items())
            error = 100 * (fit.parameters["R"].value / machine.resistance - 1)
            low, high = fit.parameters["R"].interval_95
            width = 50 * (high - low) / machine.resistance
            print(
                f"{name:16} {kind:9} {found}; R {error:+.3f} ± {width:.3f} %, "
                f"{fit.horizon.verdict}, {wall:.0f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
