"""Public benchmark data by default: ``python -m validate.public_sets [FOLDER] [NAME ...]``.

Each set is a model written from its documentation and `penode.identify` with nothing given beside;
official splits. FOLDER holds ``tanks/dataBenchmark.csv`` (Schoukens and Noël), ``silverbox/
multisine.csv`` (Wigren and Schoukens), ``bouc_wen/{train,test}.h5`` (Noël and Schoukens) and
``emps/DATA_EMPS{,_PULSES}.mat`` (Janot, Gautier and Brunot), all of nonlinearbenchmark.org. Printed
are horizon, verdict, hold, seconds, the free run's error on the test with its start estimated, and
the parameters with their 95 % half widths.
"""

import importlib.util
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import ClassVar

import h5py
import jax.numpy as jnp
import numpy as np

from penode import Experiment, Model, Predictor, identify, physical
from penode.arrays import JaxArray, Leaf
from penode.engine import FirstOrderHold, Positive, ZeroOrderHold, compare
from penode.models.inputs import Inputs

FOLDER = Path("../shared/data/benchmarks")
#: Level of the rim in V, and what of a level above it runs over, 1/s.
_RIM, _SPILL = 10.0, 0.2


class Tanks(Model):
    """Two tanks in cascade, the lower level measured; the upper one runs over, partly below."""

    states: ClassVar[tuple[str, ...]] = ("upper", "lower")
    inputs: ClassVar[tuple[str, ...]] = ("pump",)
    state_units: ClassVar[tuple[str, ...]] = ("V", "V")
    unmeasured: ClassVar[tuple[str, ...]] = ("upper",)

    k1: Leaf = physical("V^0.5/s", Positive())
    k2: Leaf = physical("V^0.5/s", Positive())
    k3: Leaf = physical("V^0.5/s", Positive())
    k4: Leaf = physical("1/s", Positive())
    k5: Leaf = physical("", Positive())

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return the rates of the levels."""
        upper, lower = jnp.sqrt(jnp.maximum(x, 1e-3))
        over = _SPILL * jnp.maximum(x[0] - _RIM, 0.0)
        into = self.k2 * upper - self.k3 * lower + self.k5 * over
        return jnp.stack([self.k4 * u[0] - self.k1 * upper - over, into])


class CubicSpring(Model):
    """y'' = gain (u + offset) - d y' - w2 y - k3 y^3, y measured (Silverbox)."""

    states: ClassVar[tuple[str, ...]] = ("y", "v")
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("V", "V/s")
    unmeasured: ClassVar[tuple[str, ...]] = ("v",)

    gain: Leaf = physical("1/s2")
    d: Leaf = physical("1/s", Positive())
    w2: Leaf = physical("1/s2", Positive())
    k3: Leaf = physical("1/(V s)2")
    offset: Leaf = physical("V")

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return speed and acceleration."""
        spring = self.w2 * x[0] + self.k3 * x[0] ** 3
        return jnp.stack([x[1], self.gain * (u[0] + self.offset) - self.d * x[1] - spring])


class Hysteresis(Model):
    """m y'' + c y' + k y + z = u, z' = alpha y' - beta |y'| z - delta y' |z| (Bouc-Wen)."""

    states: ClassVar[tuple[str, ...]] = ("y", "v", "z")
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("m", "m/s", "N")
    unmeasured: ClassVar[tuple[str, ...]] = ("v", "z")

    m: Leaf = physical("kg", Positive())
    c: Leaf = physical("Ns/m", Positive())
    k: Leaf = physical("N/m", Positive())
    alpha: Leaf = physical("N/m", Positive())
    beta: Leaf = physical("1/m")
    delta: Leaf = physical("1/m")

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return speed, acceleration and the rate of the restoring force."""
        y, v, z = x
        lost = self.beta * jnp.sqrt(v**2 + 1e-12) * z + self.delta * v * jnp.sqrt(z**2 + 1e-12)
        force = u[0] - self.k * y - self.c * v - z
        return jnp.stack([v, force / self.m, self.alpha * v - lost])


@dataclass(frozen=True, eq=False)
class PublicSet:
    """A model where training begins, and the recordings.

    Attributes
    ----------
    start : Model
    train, test : Experiment
    unit : float
        By which the error is divided, SI units.
    """

    start: Model
    train: Experiment
    test: Experiment
    unit: float


def tanks(folder: Path) -> PublicSet:
    """Return the cascaded tanks with overflow; errors in V."""
    c = np.genfromtxt(folder / "tanks" / "dataBenchmark.csv", delimiter=",", names=True)
    train, test = (
        Experiment(half, 4.0, {"pump": c[f"u{half}"], "lower": c[f"y{half}"]})
        for half in ("Est", "Val")
    )
    return PublicSet(Tanks(0.05, 0.05, 0.05, 0.05, 0.5), train, test, 1.0)


def silverbox(folder: Path) -> PublicSet:
    """Return the multisines of the Silverbox; errors in mV."""
    file = folder / "silverbox" / "multisine.csv"
    u, y = np.loadtxt(file, delimiter=",", skiprows=1, usecols=(0, 1)).T
    train, test = (
        Experiment(name, 1 / 610.35, {"u": u[rows], "y": y[rows]})
        for name, rows in (("train", slice(65062)), ("test", slice(65062, 86750)))
    )
    return PublicSet(CubicSpring(1e5, 50.0, 2e5, 1e5, 0.0), train, test, 1e-3)


def bouc_wen(folder: Path) -> PublicSet:
    """Return the multisines of the hysteretic oscillator; errors in 10 um."""
    runs = []
    for name in ("train", "test"):
        with h5py.File(folder / "bouc_wen" / f"{name}.h5") as file:
            c = {key: np.ravel(file["multisine"][key][()]) for key in ("u", "y", "fs")}
        runs.append(Experiment(name, 1 / float(c["fs"][0]), {"u": c["u"], "y": c["y"]}))
    start = Hysteresis(1.5, 5.0, 3e4, 3e4, 500.0, -500.0)
    return PublicSet(start, *runs, 1e-5)


def emps(folder: Path) -> PublicSet:
    """Return the electro-mechanical positioner, tested on its pulses; errors in mm."""
    example = _example("02_emps")
    files = (folder / "emps" / f"DATA_EMPS{end}.mat" for end in ("", "_PULSES"))
    start = example.Positioner(M=80.0, Fv=150.0, Fc=10.0, offset=0.0)
    return PublicSet(start, *(example.load(file) for file in files), 1e-3)


HOLDS = {str(hold): hold for hold in (ZeroOrderHold(), FirstOrderHold())}
SETS: dict[str, Callable[[Path], PublicSet]] = {
    "tanks": tanks,
    "silverbox": silverbox,
    "bouc_wen": bouc_wen,
    "emps": emps,
}


def line_of(name: str, one: PublicSet) -> str:
    """Identify a set by default and return its line."""
    began = time.monotonic()
    fit = identify(one.start, [one.train])
    seconds = time.monotonic() - began
    hold = HOLDS[fit.provenance["hold"]]
    predictor = Predictor(one.test.time_step, hold=hold)
    errors = []
    for model in (fit.model, fit.simulation):
        free = compare(predictor, model, one.test, free=model.states)
        errors.append(np.sqrt(np.mean((free.measured - free.free_run)[:, 0] ** 2)) / one.unit)
    found = ", ".join(
        f"{key} {number.value:.4g} ± {1.96 * number.std:.2g}"
        for key, number in fit.parameters.items()
    )
    kind, choice = type(hold).__name__, fit.horizon
    return (
        f"{name:10s} H {choice.selected:4d} {choice.verdict:14s} {kind:14s} "
        f"{seconds:4.0f} s  test {errors[0]:.3f}, simulation {errors[1]:.3f}; {found}"
    )


def _example(name: str) -> ModuleType:
    file = Path(__file__).parents[1] / "examples" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main(arguments: list[str]) -> None:
    """Print a line a set."""
    folder = Path(arguments[0]) if arguments else FOLDER
    for name in arguments[1:] or SETS:
        print(line_of(name, SETS[name](folder)), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
