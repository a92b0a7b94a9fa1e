"""The public sets as a peer is given them: a model of plain arithmetic, arrays, starts and scales.

A derivative is written once for CasADi and JAX: `m` is the module of its functions. The holds and
the scales of what is not measured were chosen by hand, for the best score.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from validate.public_sets import PublicSet

from penode import Experiment
from penode.arrays import BoolArray, FloatArray
from penode.models.transforms import Positive
from validate import output_sets


def tanks(m, x, u, p):
    k1, k2, k3, k4, k5 = p
    upper, lower = (m.sqrt(m.fmax(level, 1e-3)) for level in x)
    over = 0.2 * m.fmax(x[0] - 10.0, 0.0)
    return [k4 * u[0] - k1 * upper - over, k2 * upper - k3 * lower + k5 * over]


def silverbox(m, x, u, p):
    gain, d, w2, k3, offset = p
    return [x[1], gain * (u[0] + offset) - d * x[1] - w2 * x[0] - k3 * x[0] ** 3]


def bouc_wen(m, x, u, p):
    mass, c, k, alpha, beta, delta = p
    y, v, z = x
    lost = beta * m.sqrt(v**2 + 1e-12) * z + delta * v * m.sqrt(z**2 + 1e-12)
    return [v, (u[0] - k * y - c * v - z) / mass, alpha * v - lost]


def emps(m, x, u, p):
    mass, viscous, coulomb, offset = p
    friction = viscous * x[1] + coulomb * m.tanh(x[1] / 2e-4) + offset
    return [x[1], (u[0] - friction) / mass]


def tclab(m, x, u, p):
    U, alpha1, alpha2, tau = p
    t1, t2, h1, h2 = x

    def flow(other, own, area):
        return area * (U * (other - own) + 0.9 * 5.670374e-8 * (other**4 - own**4))

    between = flow(h2, h1, 2e-4)
    heat1 = flow(296.15, h1, 1e-3) + between + alpha1 * u[0]
    heat2 = flow(296.15, h2, 1e-3) - between + alpha2 * u[1]
    return [(h1 - t1) / tau, (h2 - t2) / tau, heat1 / 2.0, heat2 / 2.0]


def rlc(m, x, u, p):
    R, C, L, share, knee, steep = p
    saturated = 0.5 - m.atan(steep * (m.fabs(x[1]) - knee)) / np.pi
    return [x[1] / C, (u[0] - x[0] - R * x[1]) / (L * (share * saturated + 1 - share))]


def two_mass(m, x, u, p):
    J1, J2, stiffness, damping, viscous, coulomb = p
    shaft = stiffness * x[1] + damping * (x[0] - x[2])
    load = viscous * x[2] + coulomb * m.tanh(x[2] / 0.05)
    return [(u[0] - shaft) / J1, x[0] - x[2], (shaft - load) / J2]


def van_de_vusse(m, x, u, p):
    k1, k2, k3 = p
    a, b = x
    return [u[0] * (5.1 - a) - k1 * a - k3 * a**2, k1 * a - k2 * b - u[0] * b]


def lotka_volterra(m, x, u, p):
    birth, death, growth = p
    prey, predator = x
    return [prey * (birth - predator), predator * (growth * prey - death)]


@dataclass(frozen=True)
class ByHand:
    """What a peer needs beside the equation.

    Attributes
    ----------
    derivative : callable
    unmeasured : mapping of str to tuple of float
        Guess and scale of a state that no sensor reads.
    straight : bool
        Inputs go on straight between samples, else they stand still.
    rate_of : mapping of str to str
        States that are the rate of a measured one.
    reads : mapping of str to str
        The channel of a measured state, where it has another name.
    zero : float
        Scale of a parameter that starts at zero.
    exact, simulated : bool
        For IPOPT: the exact Hessian, else Gauss and Newton's; the search begins at simulated
        states, else at measured ones.
    """

    derivative: Callable[..., list]
    unmeasured: dict[str, tuple[float, float]]
    straight: bool = False
    rate_of: Mapping[str, str] = field(default_factory=dict)
    reads: Mapping[str, str] = field(default_factory=dict)
    zero: float = 1.0
    exact: bool = False
    simulated: bool = False


MODELS = {
    "tanks": ByHand(tanks, {"upper": (5.0, 3.0)}, exact=True),
    "silverbox": ByHand(
        silverbox, {"v": (0.0, 20.0)}, straight=True, rate_of={"v": "y"}, zero=1e-2
    ),
    "bouc_wen": ByHand(
        bouc_wen, {"v": (0.0, 0.1), "z": (0.0, 10.0)}, straight=True, rate_of={"v": "y"}
    ),
    "emps": ByHand(emps, {"v": (0.0, 0.05)}, rate_of={"v": "q"}),
    "tclab": ByHand(tclab, {"H1": (300.0, 10.0), "H2": (300.0, 10.0)}),
    "rlc": ByHand(rlc, {}, simulated=True),
    "two_mass": ByHand(two_mass, {"twist": (0.0, 0.01), "load": (0.0, 5.0)}),
    "van_de_vusse": ByHand(van_de_vusse, {"a": (2.0, 1.0)}),
    "lotka_volterra": ByHand(lotka_volterra, {"predator": (1.0, 1.0)}),
    "wiener_hammerstein": ByHand(
        output_sets.filters,
        {"x1": (0.0, 1.0), "v1": (0.0, 50.0), "v2": (0.0, 50.0)},
        rate_of={"v2": "x2"},
        reads={"x2": "y"},
    ),
    "ship": ByHand(
        output_sets.course,
        {"sway": (0.0, 1.0), "rolling": (0.0, 0.02), "rudder": (0.0, 0.2), "shaft": (1.5, 0.3)},
        rate_of={"rolling": "roll"},
        reads={"surge": "log", "yaw": "gyroscope", "heading": "compass", "roll": "inclinometer"},
    ),
    "two_rates": ByHand(
        output_sets.servo,
        {"speed": (0.0, 50.0)},
        rate_of={"speed": "angle"},
        reads={"angle": "encoder", "amperes": "current"},
    ),
}


@dataclass(frozen=True, eq=False)
class Problem:
    """A recording and where the search begins.

    A parameter p of theta is start * exp(theta) where it is positive, else start + scale * theta;
    the state at the first sample is guess + spread * theta.
    """

    by_hand: ByHand
    start: FloatArray
    scale: FloatArray
    positive: BoolArray
    time_step: float
    inputs: FloatArray  # (time, input)
    outputs: FloatArray  # (time, output)
    rows: tuple[int, ...]
    guess: FloatArray
    spread: FloatArray
    rates: dict[int, int]  # states that are the rate of an output

    def parameters(self, m: Any, theta: Any) -> list:
        """Return the parameters of theta by the functions of a module."""
        entries = zip(self.start, self.scale, self.positive, range(len(self.start)), strict=True)
        return [a * m.exp(theta[k]) if up else a + b * theta[k] for a, b, up, k in entries]

    @property
    def weights(self) -> FloatArray:
        """One over the deviations of the outputs."""
        return 1 / np.std(self.outputs, axis=0)

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers of states, inputs and parameters."""
        return len(self.guess), self.inputs.shape[1], len(self.start)

    def fixed(self, theta: FloatArray) -> "Problem":
        """Return the same with the parameters of theta."""
        return self.with_parameters([float(value) for value in self.parameters(np, theta)])

    def with_parameters(self, known: Sequence[float]) -> "Problem":
        """Return the same with other parameters at theta = 0."""
        return replace(self, start=np.array(known))


def problem_of(name: str, one: PublicSet, run: Experiment) -> Problem:
    """Return a recording of a public set as a peer is given it."""
    by_hand, model = MODELS[name], one.start
    settings = {part.name: part.metadata.get("setting") for part in fields(model)}
    names = [key for key, setting in settings.items() if setting and setting.physical]
    start = np.array([float(getattr(model, key)) for key in names])
    positive = [isinstance(settings[key].transform, Positive) for key in names]
    measured = [key for key in model.states if key not in by_hand.unmeasured]
    read = {key: run.channels[by_hand.reads.get(key, key)] for key in measured}
    first = {key: (values[0], np.std(values)) for key, values in read.items()}
    guess, spread = np.array([{**by_hand.unmeasured, **first}[s] for s in model.states]).T
    columns = [run.channels[key] for key in model.inputs] or [np.zeros(len(run))]
    rates = {model.states.index(v): measured.index(y) for v, y in by_hand.rate_of.items()}
    return Problem(
        by_hand=by_hand,
        start=start,
        scale=np.where(start == 0, by_hand.zero, np.abs(start)),
        positive=np.array(positive),
        time_step=run.time_step,
        inputs=np.stack(columns, axis=1),
        outputs=np.stack([*read.values()], axis=1),
        rows=tuple(model.states.index(key) for key in measured),
        guess=guess,
        spread=spread,
        rates=rates,
    )
