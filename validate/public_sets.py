"""Data sets by default: ``python -m validate.public_sets [FOLDER] [NAME ...]``.

Each set is a model written from its documentation and `penode.identify` with nothing given beside;
official splits. FOLDER holds ``tanks/dataBenchmark.csv`` (Schoukens and Noël), ``silverbox/
multisine.csv`` (Wigren and Schoukens), ``bouc_wen/{train,test}.h5`` (Noël and Schoukens) and
``emps/DATA_EMPS{,_PULSES}.mat`` (Janot, Gautier and Brunot), all of nonlinearbenchmark.org,
``tclab/data.csv`` (APMonitor) and ``rlc/RLC_data_{id,test}.csv`` (forgi86), as the scripts of
examples/ read them. Six more are simulated by SciPy, three of them with sensors that read outputs.
Names with a plus have a learned part beside the textbook's law, those that end in ``/outputs`` have
outputs in place of measured states; they run only when they are named; ``all`` names every set.

Printed are horizon, verdict, hold, seconds, the free run's error on the test with its start
estimated, one per measured channel, of the model reported and of the one for simulation
(``purpose="simulation"``, from the same climb), and the parameters with their 95 % half widths, the
truth behind them where it is known.
"""

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from penode import Experiment, Fit, Model, Predictor, identify
from penode.arrays import FloatArray
from penode.engine import (
    BandLimitedHold,
    FirstOrderHold,
    RungeKutta,
    Substeps,
    ZeroOrderHold,
    compare,
)
from penode.predictors.tableaus import RK4
from validate import output_sets, simulated_sets
from validate.examples import example
from validate.learned_sets import LEARNED

RK = RungeKutta(RK4)
FOLDER = Path("../shared/data/benchmarks")


@dataclass(frozen=True, eq=False)
class PublicSet:
    """A model where training begins, and the recordings.

    Attributes
    ----------
    start : Model
    train, test : Experiment
    units : tuple of float
        By which the error of each measured channel is divided, SI units; 0 leaves one out.
    known : mapping of str to float
        Parameters that are known, SI units.
    beside : tuple of Experiment
        Recordings trained on beside.
    """

    start: Model
    train: Experiment
    test: Experiment
    units: tuple[float, ...] = (1.0,)
    known: Mapping[str, float] = field(default_factory=dict)
    beside: tuple[Experiment, ...] = ()


def _official(script: str, units: tuple[float, ...], **known: float) -> Callable[[Path], PublicSet]:
    """Return the function that reads a set as an example does; its folder has the same name."""

    def read(folder: Path) -> PublicSet:
        start, train, test = example(script).load(folder / script[3:])
        return PublicSet(start, train, test, units, known)

    return read


def _simulated(name: str) -> Callable[[Path], PublicSet]:
    """Return the function that simulates a set, wherever the others' files are."""

    def make(_: Path) -> PublicSet:
        start, (train, test, *beside), known = (simulated_sets.SETS | output_sets.SETS)[name]()
        count = len(start.outputs) or len(start.states) - len(start.unmeasured)
        return PublicSet(start, train, test, (1.0,) * count, known, tuple(beside))

    return make


def _with_part(name: str) -> Callable[[Path], PublicSet]:
    """Return the function that reads a set and puts a learned part into its model."""

    def read(folder: Path) -> PublicSet:
        plain = SETS[name.split("+")[0]](folder)
        start = LEARNED[name](plain.start)
        count = len(start.states) - len(start.unmeasured)
        return replace(plain, start=start, units=plain.units[:count])

    return read


def _with_outputs(name: str) -> Callable[[Path], PublicSet]:
    """Return the function that reads a set and writes its sensors as outputs."""

    def read(folder: Path) -> PublicSet:
        plain = SETS[name](folder)
        return replace(plain, start=output_sets.with_outputs(plain.start))

    return read


PLAIN: dict[str, Callable[[Path], PublicSet]] = {
    "tanks": _official("06_tanks", (1.0,)),
    "silverbox": _official("07_silverbox", (1e-3,)),
    "bouc_wen": _official(
        "08_bouc_wen", (1e-5,), m=2.0, c=10.0, k=5e4, alpha=5e4, beta=800.0, delta=-1100.0
    ),
    "emps": _official("02_emps", (1e-3,), M=95.11, Fv=203.5, Fc=20.39, offset=-3.16),
    "tclab": _official("03_tclab", (1.0, 1.0)),
    "rlc": _official(
        "01_rlc", (1.0, 1.0), R=3.0, C=270e-9, L=50e-6, share=0.9, knee=5.0, steep=5.0
    ),
    **{name: _simulated(name) for name in (*simulated_sets.SETS, *output_sets.SETS)},
}
SETS: dict[str, Callable[[Path], PublicSet]] = {
    **PLAIN,
    **{name: _with_part(name) for name in LEARNED},
    **{f"{name}/outputs": _with_outputs(name) for name in PLAIN if name not in output_sets.SETS},
}


HOLDS = {str(one): one for one in (ZeroOrderHold(), FirstOrderHold(), BandLimitedHold())}
SOLVERS = {str(one): one for one in (Substeps(RK, 2**k) for k in range(5))}


def errors(one: PublicSet, fit: Fit, model: Model | None = None) -> list[float]:
    """Return the free run's error on the test, its start estimated, for each channel.

    Parameters
    ----------
    one : PublicSet
    fit : Fit
        Which solver and hold are used.
    model : Model, optional
        The fit's by default.
    """
    model = model or fit.model
    solver, hold = SOLVERS[fit.provenance["solver"]], HOLDS[fit.provenance["hold"]]
    predictor = Predictor(one.test.time_step, solver, hold)
    free = compare(predictor, model, one.test, free=model.states)
    return scaled_errors(one.units, free.measured - free.free_run)


def scaled_errors(units: Sequence[float], gap: FloatArray) -> list[float]:
    """Return the root mean square of each channel (time, channel) in its unit, if that is not 0."""
    rms = np.sqrt(np.mean(gap**2, axis=0))
    return [float(e / unit) for e, unit in zip(rms, units, strict=True) if unit]


def line_of(name: str, one: PublicSet) -> str:
    """Identify a set by default and return its line."""
    began = time.monotonic()
    try:
        fit = identify(one.start, [one.train, *one.beside])
    except Exception as error:  # a line for each set, whatever it meets
        return f"{name:19s} !! {type(error).__name__}: {error}"
    seconds = time.monotonic() - began
    parameters, simulation = (
        " / ".join(f"{error:.3f}" for error in errors(one, fit, model))
        for model in (fit.model, fit.simulation)
    )
    found = ", ".join(
        f"{key} {number.value:.4g} ± {1.96 * number.std:.2g}"
        + (f" ({one.known[key]:.4g})" if key in one.known else "")
        for key, number in fit.parameters.items()
    )
    steps = SOLVERS[fit.provenance["solver"]]
    hold = type(HOLDS[fit.provenance["hold"]]).__name__.removesuffix("Hold")
    hold += f" {steps.count} sub-steps" if isinstance(steps, Substeps) else ""
    return (
        f"{name:19s} H {fit.horizon.selected:4d} {fit.horizon.verdict:16s} {hold:12s} "
        f"{seconds:4.0f} s  test {parameters}, simulation {simulation}; {found}"
    )


def main(arguments: list[str]) -> None:
    """Print a line a set."""
    folder = Path(arguments[0]) if arguments else FOLDER
    names = arguments[1:] or list(PLAIN)
    for name in SETS if names == ["all"] else names:
        print(line_of(name, SETS[name](folder)), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
