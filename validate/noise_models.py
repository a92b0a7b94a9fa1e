"""Noise models: ``python -m validate.noise_models [DRAWS] [FIRST] [NAME ...] [--alone]``.

Three models whose outputs are not states: an oscillator whose position is measured, a heater seen
through a thermistor in a divider, and a motor with a shunt and a tachometer. Noise acts on their
states between samples, and what the sensors add is white and correlated in time. Each draw is
fitted by the default plan with the model alone and with an extended Kalman filter around it, which
begins at three times the noise there is. A table says how many 95 % intervals of positive verdicts
contain the truth, and how wide they are: the median deviation over that of the model alone. With
``--alone`` no filter is fitted, which takes a twentieth of the time. Ctrl-C prints the table so
far; the same command goes on.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np

from penode import Experiment, Model, identify, physical
from penode.arrays import Leaf
from penode.engine import ExtendedKalman
from penode.fit.outcome import AGREED
from validate.ledger import Ledger, Record

#: Steps of the simulation in a sample, samples of a recording and those that an input is held for.
_FINE, _SAMPLES, _HELD = 8, 2000, 20


class Oscillator(Model):
    """A mass on a spring whose position is measured."""

    states: ClassVar = ("place", "rate")
    state_units: ClassVar = ("m", "m/s")
    inputs: ClassVar = ("force",)
    outputs: ClassVar = {"position": "m"}

    stiffness: Leaf = physical("1/s2")
    damping: Leaf = physical("1/s")

    def derivative(self, x, u):  # type: ignore[no-untyped-def]
        """Return the rates, (state, batch)."""
        return jnp.stack([x[1], u[0] - self.stiffness * x[0] - self.damping * x[1]])

    def output(self, x, u):  # type: ignore[no-untyped-def]
        """Return the position, (1, batch)."""
        return x[:1]


class Heater(Model):
    """A heated body in a shell; a thermistor in a divider of 5 V is in the shell."""

    states: ClassVar = ("body", "shell")
    state_units: ClassVar = ("K", "K")
    inputs: ClassVar = ("power",)
    outputs: ClassVar = {"divider": "V"}

    capacity: Leaf = physical("J/K")
    loss: Leaf = physical("W/K")

    def derivative(self, x, u):  # type: ignore[no-untyped-def]
        """Return the rates, (state, batch)."""
        flow = 2.0 * (x[0] - x[1])
        return jnp.stack([(u[0] - flow) / self.capacity, (flow - self.loss * x[1]) / 4.0])

    def output(self, x, u):  # type: ignore[no-untyped-def]
        """Return the divider's voltage, (1, batch)."""
        return 5.0 / (1.0 + 2.0 * jnp.exp(-0.04 * x[1:]))


class Motor(Model):
    """A motor of known inertia and inductance with a shunt and a tachometer."""

    states: ClassVar = ("current", "speed")
    state_units: ClassVar = ("A", "rad/s")
    inputs: ClassVar = ("voltage",)
    outputs: ClassVar = {"shunt": "V", "tachometer": "V"}

    resistance: Leaf = physical("ohm")
    constant: Leaf = physical("Vs")
    friction: Leaf = physical("Nms")

    def derivative(self, x, u):  # type: ignore[no-untyped-def]
        """Return the rates, (state, batch)."""
        current = (u[0] - self.resistance * x[0] - self.constant * x[1]) / 0.01
        return jnp.stack([current, (self.constant * x[0] - self.friction * x[1]) / 2e-4])

    def output(self, x, u):  # type: ignore[no-untyped-def]
        """Return what shunt and tachometer read, (2, batch)."""
        return jnp.stack([0.1 * x[0], 0.02 * x[1]])


@dataclass(frozen=True)
class Case:
    """A model, its truth and where training begins, and the noise of its recordings."""

    model: Callable[..., Model]
    truth: dict[str, float]
    start: dict[str, float]
    step: float
    # Of the input: mean and deviation.
    drive: tuple[float, float]
    # Of the states, SI units per root second.
    process: tuple[float, ...]
    # Deviations of white and of correlated noise of each output, and its time constant in s.
    white: tuple[float, ...]
    correlated: tuple[float, ...]
    time_constant: float


CASES = {
    "oscillator": Case(
        Oscillator,
        {"stiffness": 4.0, "damping": 0.5},
        {"stiffness": 2.5, "damping": 1.0},
        0.05,
        (0.0, 2.0),
        (0.0, 0.25),
        (0.01,),
        (0.03,),
        0.4,
    ),
    "heater": Case(
        Heater,
        {"capacity": 20.0, "loss": 0.5},
        {"capacity": 14.0, "loss": 0.8},
        1.0,
        (15.0, 8.0),
        (0.15, 0.05),
        (0.005,),
        (0.01,),
        6.0,
    ),
    "motor": Case(
        Motor,
        {"resistance": 1.5, "constant": 0.06, "friction": 3e-4},
        {"resistance": 1.0, "constant": 0.04, "friction": 6e-4},
        0.002,
        (0.0, 6.0),
        (0.5, 30.0),
        (0.003, 0.01),
        (0.005, 0.02),
        0.01,
    ),
}


def recorded(case: Case, seed: int) -> Experiment:
    """Return a recording with noise of states and sensors."""
    random = np.random.default_rng([seed, 11])
    truth, fine = case.model(**case.truth), case.step / _FINE
    mean, deviation = case.drive
    held = mean + deviation * random.normal(size=_SAMPLES // _HELD)
    drive = np.maximum(held, 0.0) if mean else held
    drive, x, read = drive.repeat(_HELD), np.zeros(2), []
    for now in drive:
        given = np.array([[now]])
        read.append(_output(truth, x, given))
        for _ in range(_FINE):
            noise = np.asarray(case.process) * np.sqrt(fine) * random.normal(size=2)
            middle = x + fine / 2 * _rate(truth, x, given)
            x = x + fine * _rate(truth, middle, given) + noise
    measured = np.array(read)
    kept = np.exp(-case.step / case.time_constant)
    slow = np.zeros(measured.shape[1])
    for row in measured:
        slow = kept * slow + np.sqrt(1 - kept**2) * random.normal(size=len(slow))
        row += np.asarray(case.white) * random.normal(size=len(slow)) + case.correlated * slow
    channels = dict(zip(truth.outputs, measured.T, strict=True))
    return Experiment("run", case.step, {**channels, truth.inputs[0]: drive})


def _rate(model: Any, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the derivative (state,) by NumPy alone."""
    if isinstance(model, Oscillator):
        return np.array([x[1], u[0, 0] - model.stiffness * x[0] - model.damping * x[1]])
    if isinstance(model, Heater):
        flow = 2.0 * (x[0] - x[1])
        return np.array([(u[0, 0] - flow) / model.capacity, (flow - model.loss * x[1]) / 4.0])
    current = (u[0, 0] - model.resistance * x[0] - model.constant * x[1]) / 0.01
    return np.array([current, (model.constant * x[0] - model.friction * x[1]) / 2e-4])


def _output(model: Any, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return what sensors read (output,) by NumPy alone."""
    if isinstance(model, Oscillator):
        return x[:1].copy()
    if isinstance(model, Heater):
        return 5.0 / (1.0 + 2.0 * np.exp(-0.04 * x[1:]))
    return np.array([0.1 * x[0], 0.02 * x[1]])


def filtered(case: Case, start: Model) -> Model:
    """Return a start's filter, which begins at three times of what noise there is."""
    process, white = 3 * np.array(case.process), 3 * np.array(case.white)
    slow = 3 * np.array(case.correlated)
    return ExtendedKalman(start, process, white, slow, 3 * case.time_constant)


def result_of(name: str, kinds: Sequence[str], seed: int) -> Record:
    """Return verdict, values, deviations and coverage of a draw's fits."""
    case, made = CASES[name], dict[str, Any]()
    run, start = recorded(case, seed), case.model(**case.start)
    noisy = filtered(case, start)
    for kind in kinds:
        fit = identify({"alone": start, "noise model": noisy}[kind], [run])
        made[kind] = {
            "verdict": fit.horizon.verdict,
            "objections": [one.name for one in fit.horizon.objections],
            "std": [fit.parameters[n].std for n in case.truth],
            "error": [fit.parameters[n].value - v for n, v in case.truth.items()],
            "covered": [
                bool(fit.parameters[n].interval_95[0] < v < fit.parameters[n].interval_95[1])
                for n, v in case.truth.items()
            ],
        }
    return made


def print_table(name: str, draws: list[Record]) -> None:
    """Print coverage, verdicts, errors and deviations of one model."""
    parameters = list(CASES[name].truth)
    for kind in (one for one in ("alone", "noise model") if one in draws[0]):
        good = [d[kind] for d in draws if d[kind]["verdict"] in AGREED]
        covered = np.array([one["covered"] for one in good])
        error = np.array([one["error"] for one in good])
        ratio = np.array([np.divide(d[kind]["std"], d["alone"]["std"]) for d in draws])
        share = 100 * covered.mean(axis=0) if len(good) else np.full(len(parameters), np.nan)
        rms = np.sqrt(np.mean(error**2, axis=0)) / list(CASES[name].truth.values())
        each = "; ".join(
            f"{p} {s:.0f} %, error {100 * e:.2f} %, deviation {w:.2f}"
            for p, s, e, w in zip(parameters, share, rms, np.median(ratio, axis=0), strict=True)
        )
        print(f"{name}, {kind}: {len(good)} of {len(draws)} positive; covered: {each}", flush=True)


def main() -> None:
    """Make draws and print the tables."""
    asked = [one for one in sys.argv[1:] if one != "--alone"]
    alone = len(asked) < len(sys.argv) - 1
    kinds = ("alone",) if alone else ("alone", "noise model")
    count = int(asked[0]) if asked else 200
    first = int(asked[1]) if len(asked) > 1 else 1
    for name in asked[2:] or CASES:
        ledger, draws = Ledger(f"noise_models_{name}{'_alone' * alone}"), list[Record]()
        try:
            for seed in range(first, first + count):
                draws.append(ledger.of(seed, partial(result_of, name, kinds), alike=True))
                one = draws[-1]
                said = ", ".join(
                    f"{kind} {one[kind]['verdict']} {one[kind]['covered']}" for kind in kinds
                )
                print(f"{name} {seed}: {said}", flush=True)
        except KeyboardInterrupt:
            pass
        if draws:
            print_table(name, draws)


if __name__ == "__main__":
    main()
