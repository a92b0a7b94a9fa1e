"""Kind of physics: a model, a plant, ranges to draw from; and one draw of it."""

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import jax.numpy as jnp
import numpy as np

from penode import Experiment, Model, physical
from penode.arrays import FloatArray, JaxArray
from penode.engine import Positive
from penode.models.inputs import Inputs
from validate.physics.misfits import Misfit, Plant
from validate.physics.signals import Path, Signal
from validate.physics.simulate import simulate

#: Rates of a model's states from model, states and inputs, in the arithmetic of JAX.
Rates = Callable[[Any, JaxArray, Inputs], Sequence[JaxArray]]
Ranges = Mapping[str, tuple[float, float]]

#: How far off training starts, and noise over the deviation of what is measured.
_OFF, _NOISE = (0.25, 0.6), (0.005, 0.03)


@dataclass(frozen=True, eq=False)
class Kind:
    """One kind of physics.

    Attributes
    ----------
    name : str
    rates : callable
        The equation, for penode.
    plant : callable
        The same for the simulator, written anew.
    states : mapping of str to str
        Units.
    first : mapping of str to (float, float)
        Range of each state at the first sample.
    inputs : mapping of str to callable
        How each is drawn.
    parameters : mapping of str to (str, float, float)
        Unit and range of each, SI units; all above zero.
    step : float
        Sampling interval, s.
    samples : int
        Of a recording.
    measured : tuple of str
        States; all by default.
    misfit : Misfit
        What the plant has beside.
    """

    name: str
    rates: Rates
    plant: Plant
    states: Mapping[str, str]
    first: Ranges
    inputs: Mapping[str, Signal]
    parameters: Mapping[str, tuple[str, float, float]]
    step: float
    samples: int
    measured: tuple[str, ...] = ()
    misfit: Misfit = field(default_factory=Misfit)
    model: type[Model] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "measured", self.measured or tuple(self.states))
        object.__setattr__(self, "model", model_of(self))

    @property
    def misfits(self) -> bool:
        """Whether the plant has what the model has not."""
        return type(self.misfit) is not Misfit

    def variant(self, name: str, **changes: Any) -> "Kind":
        """Return a kind with some attributes exchanged."""
        return replace(self, name=name, **changes)


def model_of(kind: Kind) -> type[Model]:
    """Return the `penode.Model` that a user would write: names, units, and `derivative`."""

    def derivative(self: Model, x: JaxArray, u: Inputs) -> JaxArray:
        return jnp.stack(jnp.broadcast_arrays(*kind.rates(self, x, u)))

    body: dict[str, Any] = {
        "__annotations__": dict.fromkeys(kind.parameters, Any),
        "__module__": __name__,
        "states": tuple(kind.states),
        "inputs": tuple(kind.inputs),
        "state_units": tuple(kind.states.values()),
        "unmeasured": tuple(name for name in kind.states if name not in kind.measured),
        "derivative": derivative,
    }
    body |= {name: physical(unit, Positive()) for name, (unit, *_) in kind.parameters.items()}
    return type(Model)("".join(map(str.capitalize, kind.name.split("_"))), (Model,), body)


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording and what is behind it.

    Attributes
    ----------
    experiment : Experiment
    first : ndarray, shape (state,)
    drive : tuple of Path
        Inputs as they are recorded.
    states : ndarray, shape (sample, measured state)
        Without noise.
    """

    experiment: Experiment
    first: FloatArray
    drive: tuple[Path, ...]
    states: FloatArray


@dataclass(frozen=True, eq=False)
class Draw:
    """One draw of a kind.

    Attributes
    ----------
    truth : mapping of str to float
        Parameters of the plant, SI units; of one that misfits those without what it has beside.
    start : Model
        Where training begins.
    train, test : Recording
    noise : ndarray, shape (measured state,)
        Deviations, in the states' units.
    """

    kind: Kind
    truth: Mapping[str, float]
    start: Model
    train: Recording
    test: Recording
    noise: FloatArray


def draw(kind: Kind, number: int) -> Draw:
    """Return a draw: parameters, starts, excitation and noise come from name and number alone."""
    random = np.random.default_rng([zlib.crc32(kind.name.encode()), number])
    truth = {name: _between(random, *ends) for name, (_, *ends) in kind.parameters.items()}
    off = {name: 1 + random.choice([-1, 1]) * random.uniform(*_OFF) for name in truth}
    start = kind.model(**{name: value * off[name] for name, value in truth.items()})
    runs = [_run(kind, truth, random) for _ in range(2)]
    level = [_between(random, *_NOISE) for _ in kind.measured]
    noise = level * runs[0].states.std(axis=0)
    train, test = (_recorded(kind, run, noise, random) for run in runs)
    return Draw(kind, truth, start, train, test, noise)


def rows(kind: Kind) -> list[int]:
    """Return the places of the measured states."""
    return [list(kind.states).index(name) for name in kind.measured]


def _run(kind: Kind, truth: Mapping[str, float], random: np.random.Generator) -> Recording:
    first = np.array([random.uniform(*ends) for ends in kind.first.values()])
    drive = tuple(signal(random, kind.samples) for signal in kind.inputs.values())
    states = simulate(
        kind.misfit.plant(kind.plant), truth, [*first, *np.zeros(kind.misfit.more)],
        kind.misfit.drive(drive), kind.step, kind.samples,
    )  # fmt: skip
    assert np.isfinite(states).all(), f"the plant of {kind.name} runs away"
    return Recording(Experiment("", kind.step, {}), first, drive, states[:, rows(kind)])


def _recorded(
    kind: Kind, run: Recording, noise: FloatArray, random: np.random.Generator
) -> Recording:
    noisy = run.states + noise * random.standard_normal(run.states.shape)
    channels = dict(zip(kind.measured, noisy.T, strict=True))
    pairs = zip(kind.inputs, run.drive, strict=True)
    channels |= {name: path.sampled(kind.samples) for name, path in pairs}
    return replace(run, experiment=Experiment(kind.name, kind.step, channels))


def _between(random: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(random.uniform(np.log(low), np.log(high))))
