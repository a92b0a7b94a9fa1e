"""Shared by the tests: a seeded generator, and models beside plain NumPy twins of their equations.

A twin takes the raw parameters as (parameter, ...) arrays that may be complex, and states and
inputs that broadcast against them, so that one complex step differentiates it to the last digit
without any of penode's or JAX's code.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import settings
from scipy.optimize import least_squares

from penode import Experiment, Fit, Model, Predictor, identify, ladder_plan, parameter, physical
from penode.arrays import Leaf, float64, start_jax
from penode.bench.drive import Drive
from penode.bench.inverter import DeadTime, Inverter
from penode.bench.machines import COMSOL_300A, TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.cli.compilation_cache import use_compilation_cache
from penode.data.windows import cut
from penode.fit.fit import Estimate, HorizonChoice
from penode.models.layout import Layout
from penode.models.networks import ConvexGradient, TanhLayers
from penode.models.parameters import with_batch_axis
from penode.models.transforms import Positive
from penode.pmsm.machine.flux_maps import FluxMap
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.terms import Resistance
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import EULER, RK4
from penode.training.covariance import Reported
from penode.training.plan import Problem
from penode.training.residuals import Objective
from penode.validation.comparison import StationaryComparison
from penode.validation.residual_tests import Spectrum

settings.register_profile("seeded", derandomize=True, database=None, deadline=None)
settings.load_profile("seeded")

# Many tests compile the same programs: keep them all, small ones too, between tests, workers, runs,
# checkouts and the processes that tests start, which read the environment. To write them costs
# nothing measurable; a test that finds them there takes 40 % less time.
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
if folder := use_compilation_cache():
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)

# Before anything else asks JAX, so that loops of the tests' own programs are functions too.
start_jax()

SEED = 20_250_301

#: Files that take longest: begun first, so that both processes end at about one time.
LONG = (
    "test_docs.py",
    "test_shipped_configurations.py",
    "test_examples.py",
    "test_notebooks.py",
    "test_main.py",
    "test_calibration.py",
    "test_outputs.py",
    "test_kalman.py",
    "test_measured_outputs.py",
)


def pytest_collection_modifyitems(items):
    """Order the files; within a file nothing changes."""
    items.sort(key=lambda item: item.path.name not in LONG)


@pytest.fixture
def rng() -> np.random.Generator:
    """Return the same random numbers for every test."""
    return np.random.default_rng(SEED)


# --- models -----------------------------------------------------------------------------------


class Duffing(Model):
    """m x'' = force - c x' - spring(x), the spring learned."""

    states: ClassVar[tuple[str, ...]] = ("x", "v")
    inputs: ClassVar[tuple[str, ...]] = ("force",)
    state_units: ClassVar[tuple[str, ...]] = ("m", "m/s")
    map_units: ClassVar[dict[str, str]] = {"spring": "N"}

    spring: TanhLayers
    mass: Leaf = physical("kg", Positive())
    damping: Leaf = physical("N s/m")

    def derivative(self, x, u):
        return jnp.stack([x[1], (u[0] - self.damping * x[1] - self.learned(x)[0]) / self.mass])

    def learned(self, x):
        return self.spring.value_and_jacobian(x[:1])[0]

    def maps(self):
        return {"spring": self._force}

    def _force(self, x):
        with float64():
            return np.asarray(with_batch_axis(self).learned(jnp.asarray(x)[None]))[0]


class LinearMachine(Model):
    """Voltage equation of a machine without saturation; every parameter is physical."""

    states: ClassVar[tuple[str, ...]] = ("i_d", "i_q")
    inputs: ClassVar[tuple[str, ...]] = ("u_d", "u_q", "omega_el")
    state_units: ClassVar[tuple[str, ...]] = ("A", "A")

    L_d: Leaf = physical("H", Positive())
    L_q: Leaf = physical("H", Positive())
    R: Leaf = physical("ohm")
    psi: Leaf = parameter(unit="Vs", group="magnet", physical=True)

    def derivative(self, x, u):
        v_d = u[0] - self.R * x[0] + u[2] * self.L_q * x[1]
        v_q = u[1] - self.R * x[1] - u[2] * (self.L_d * x[0] + self.psi)
        return jnp.stack([v_d / self.L_d, v_q / self.L_q])


# --- their twins ------------------------------------------------------------------------------


def duffing_twin(raw, x, u):
    w1, w2, b1, b2, (mass, damping) = np.split(raw, [3, 6, 9, 10])
    spring = np.sum(w2 * np.tanh(w1 * x[0] + b1), axis=0) + b2[0]
    return np.stack(np.broadcast_arrays(x[1], (u[0] - damping * x[1] - spring) / np.exp(mass)))


def linear_machine_twin(raw, x, u):
    l_d, l_q, R, psi = np.exp(raw[0]), np.exp(raw[1]), raw[2], raw[3]
    return np.stack(
        [
            (u[0] - R * x[0] + u[2] * l_q * x[1]) / l_d,
            (u[1] - R * x[1] - u[2] * (l_d * x[0] + psi)) / l_q,
        ]
    )


def machine_twin(network, current_scale, flux_scale):
    def derivative(raw, x, u):
        value, slope = network(raw[:-1], x / current_scale)
        psi, ((a, b), (c, d)) = flux_scale * value, flux_scale / current_scale * slope
        v_d = u[0] - raw[-1] * x[0] + u[2] * psi[1]
        v_q = u[1] - raw[-1] * x[1] - u[2] * psi[0]
        return np.stack([d * v_d - b * v_q, a * v_q - c * v_d]) / (a * d - b * c)

    return derivative


def tanh_layers_twin(raw, x):
    """Value and Jacobian of the layers 2-4-3-2."""
    w1, w2, w3, b1, b2, b3 = np.split(raw, np.cumsum([8, 12, 6, 4, 3]))
    rest = raw.shape[1:]
    w1, w2, w3 = (w.reshape(-1, n, *rest) for w, n in ((w1, 2), (w2, 4), (w3, 3)))
    first = np.tanh(np.einsum("ij...,j...->i...", w1, x) + b1)
    second = np.tanh(np.einsum("ij...,j...->i...", w2, first) + b2)
    chain = ("ij...,j...,jk...,k...,kl...->il...", w3, 1 - second**2, w2, 1 - first**2, w1)
    return np.einsum("ij...,j...->i...", w3, second) + b3, np.einsum(*chain)


def convex_gradient_twin(raw, x):
    """Value and Jacobian of two inputs and three units."""
    offset, factor, directions, bias, gain = np.split(raw, [2, 5, 11, 14])
    low, mixed, high = np.exp(factor[0]), factor[1], np.exp(factor[2])
    stiffness = np.array([[low * low, low * mixed], [low * mixed, mixed**2 + high**2]])
    directions, gain = directions.reshape(3, 2, *raw.shape[1:]), np.exp(gain)
    hidden = np.tanh(np.einsum("ij...,j...->i...", directions, x) + bias)
    linear = offset + np.einsum("ij...,j...->i...", stiffness, x)
    value = linear + np.einsum("ji...,j...->i...", directions, gain * hidden)
    slope = np.einsum("ji...,j...,jk...->ik...", directions, gain * (1 - hidden**2), directions)
    return value, stiffness + slope


# --- systems ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class System:
    """A model, its NumPy twin, and recordings at which both are compared (not its own runs)."""

    model: Model
    twin: Callable[..., np.ndarray]
    experiments: tuple[Experiment, ...]
    scale: np.ndarray
    time_step: float

    def windows(self, horizon, experiments=None):
        experiments = experiments or self.experiments
        return cut(experiments, self.model.states, self.model.inputs, horizon)

    def recorded_again(self, noise=0.0, seed=SEED):
        """Return the recordings with the inputs kept and the states those of the twin."""
        random, found = np.random.default_rng(seed), []
        for run in self.experiments:
            start = run.stack(self.model.states)[0]
            states = self.simulate(start, run.stack(self.model.inputs))
            states = states + noise * self.scale * random.normal(size=states.shape)
            channels = {**run.channels, **dict(zip(self.model.states, states.T, strict=True))}
            found.append(Experiment(run.name, run.time_step, channels))
        return tuple(found)

    @property
    def raw(self) -> np.ndarray:
        return Layout(self.model).raw(self.model)

    def step(self, solver, raw, x, u):
        """Return the next sample of x (state, ...), by the textbook formula of the method."""
        if solver == "euler":
            return x + self.time_step * self.twin(raw, x, u)
        return rk4(lambda z: self.twin(raw, z, u), x, self.time_step)

    def simulate(self, start, inputs):
        """Return the states (time, state) of the twin under inputs (time, input), by RK4."""
        states = [np.asarray(start, dtype=float)]
        for u in inputs[:-1]:
            states.append(self.step("rk4", self.raw, states[-1], u))
        return np.array(states)

    def sensitivities(self, solver, raw, windows):
        """Return residuals and S = -dr/draw, (step, state, window) and (..., parameter, ...).

        One complex step a parameter through a plain loop over the horizon.
        """
        shifted = raw[:, None, None] + 1e-30j * np.eye(len(raw))[:, :, None]
        x = windows.states.T[:, None, windows.starts] + np.zeros((1, len(raw), 1))
        residuals, slopes = [], []
        for k in range(windows.horizon):
            x = self.step(solver, shifted, x, windows.inputs.T[:, None, windows.starts + k])
            measured = windows.states.T[:, windows.starts + k + 1]
            residuals.append((measured - x[:, 0].real) / self.scale[:, None])
            slopes.append(x.imag / 1e-30 / self.scale[:, None, None])
        return np.array(residuals), np.array(slopes)


def rk4(derivative, x, h):
    k1 = derivative(x)
    k2 = derivative(x + h / 2 * k1)
    k3 = derivative(x + h / 2 * k2)
    k4 = derivative(x + h * k3)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def recordings(model, time_step, amplitude, lengths=(230, 150)):
    """Return smooth recordings with a little noise, one row of amplitude a channel."""
    random = np.random.default_rng(SEED)
    names = (*model.states, *model.inputs)
    found = []
    for number, length in enumerate(lengths):
        time = np.arange(length)[:, None]
        period, phase = random.uniform(20, 60, len(names)), random.uniform(0, 6, len(names))
        smooth = np.sin(2 * np.pi * time / period + phase)
        values = (smooth + 0.05 * random.normal(size=smooth.shape)) * amplitude
        channels = dict(zip(names, values.T, strict=True))
        found.append(Experiment(f"run{number}.csv", time_step, channels))
    return tuple(found)


def duffing():
    spring = TanhLayers.random((1, 3, 1), seed=4)
    model = Duffing(spring, mass=0.7, damping=0.3)
    amplitude, scale = np.array([1.0, 1.5, 2.0]), np.array([0.5, 2.0])
    return System(model, duffing_twin, recordings(model, 0.05, amplitude), scale, 0.05)


def linear_machine():
    model = LinearMachine(L_d=2e-3, L_q=3e-3, R=0.2, psi=0.05)
    amplitude = np.array([10.0, 12.0, 5.0, 6.0, 200.0])
    runs = recordings(model, 1e-4, amplitude)
    return System(model, linear_machine_twin, runs, np.ones(2), 1e-4)


def machine(network, twin):
    model = Machine(FluxMap(network, 100.0, 0.4), (Resistance(0.05),))
    amplitude = np.array([60.0, 70.0, 40.0, 50.0, 100.0])
    runs = recordings(model, 1e-4, amplitude)
    return System(model, machine_twin(twin, 100.0, 0.4), runs, np.ones(2), 1e-4)


def coenergy():
    network = replace(ConvexGradient.random(2, 3, seed=1), offset=np.array([0.3, -0.1]))
    return machine(network, convex_gradient_twin)


def mlp():
    """Return a draw whose L is not singular within 120 A."""
    network = TanhLayers.random((2, 4, 3, 2), seed=532)
    return machine(network, tanh_layers_twin)


SYSTEMS = {
    "duffing": duffing,
    "linear machine": linear_machine,
    "coenergy machine": coenergy,
    "mlp machine": mlp,
}


@pytest.fixture(scope="session", params=list(SYSTEMS))
def system(request) -> System:
    """Return each system in turn."""
    return SYSTEMS[request.param]()


@pytest.fixture(scope="session")
def systems() -> dict[str, System]:
    """Return all systems by name."""
    return {name: make() for name, make in SYSTEMS.items()}


# --- one fit, shared --------------------------------------------------------------------------

MASS, DAMPING = 0.7, 0.3


def cubic_spring(x):
    return 2.0 * x + 1.5 * x**3


def oscillation(name, samples, phase):
    """Record x and v of a mass on a cubic spring with noise of 2 mm, the force held."""
    step, time = 0.05, 0.05 * np.arange(samples)
    shape = ((1.5, 3.1, phase), (1.0, 1.7, 0.0), (0.8, 7.3, 0.0))
    force = sum(a * np.sin(2 * np.pi * time / period + p) for a, period, p in shape)
    states = [np.zeros(2)]
    for f in force[:-1]:

        def derivative(z, f=f):
            return np.array([z[1], (f - DAMPING * z[1] - cubic_spring(z[0])) / MASS])

        x = states[-1]
        for _ in range(4):
            x = rk4(derivative, x, step / 4)
        states.append(x)
    noise = 2e-3 * np.random.default_rng([SEED, samples]).normal(size=(samples, 2))
    x, v = (np.array(states) + noise).T
    return Experiment(name, step, {"x": x, "v": v, "force": force})


@dataclass(frozen=True)
class ObservedFit:
    """A fit, the recording behind it, and the events its observer received."""

    fit: Fit
    recording: Experiment
    events: list


@pytest.fixture(scope="session")
def oscillator() -> ObservedFit:
    """Return the fit of `Duffing` to a mass on a cubic spring, on a short ladder, beside points."""
    start = Duffing(TanhLayers.random((1, 3, 1), seed=1), mass=1.0, damping=0.1)
    recording, events = oscillation("train.csv", 800, 1.0), []
    fit = identify(
        start,
        [recording],
        plan=ladder_plan((1, 2, 4, 8, 16)),
        validation=[oscillation("unseen.csv", 300, 2.0)],
        observer=events.append,
    )
    at, ones = np.array([[0.1, 0.0], [0.3, 0.0]]), np.ones((2, 1))
    near = (at[:, :1], at[:, :1] + 0.01, at[:, :1] - 0.02, 0.015 * ones)
    points = StationaryComparison("springs.csv", ("position",), ("m",), at, *near)
    return ObservedFit(replace(fit, stationary=points), recording, events)


# --- compiled once, or quickly ----------------------------------------------------------------


@pytest.fixture(scope="module")
def quickly_compiled():
    """Compile a module's programs without optimisation: they run shortly."""
    option = "jax_disable_most_optimizations"
    before = jax.config.values[option]
    jax.config.update(option, True)
    yield
    jax.config.update(option, before)


@pytest.fixture(scope="session")
def objective_of():
    """Return a function that gives the one objective of a system and solver, compiled once."""
    known = {}

    def find(system, solver="rk4"):
        key = (type(system.model), solver, jax.tree.structure(system.model))
        if key not in known:
            tableau = {"euler": EULER, "rk4": RK4}[solver]
            predictor = Predictor(system.time_step, RungeKutta(tableau))
            known[key] = Objective(predictor, system.model, system.scale)
        return known[key]

    return find


@pytest.fixture(scope="session")
def problem_of(objective_of):
    """Return a function that makes the problem of a system over its own or other recordings."""
    reported = {}

    def make(system, horizon, *, experiments=None, groups=None):
        objective, windows = objective_of(system), system.windows(horizon, experiments)
        points = system.experiments[0].stack(system.model.states)[::40]
        watched = reported.setdefault(objective, Reported(objective.layout, points))
        return Problem(objective, watched, windows, objective.layout.members(groups))

    return make


# --- a machine's fit without training ------------------------------------------------------------


@pytest.fixture(scope="session")
def true_map():
    """Return psi (2, ...) and L (2, 2, ...) of the COMSOL machine, averaged over the angle."""
    angles = np.linspace(0, np.pi / 3, 24, endpoint=False)

    def mean(current):
        return jax.vmap(lambda angle: COMSOL_300A.coenergy(*current, angle))(angles).mean()

    def over(function):
        compiled = jax.jit(jax.vmap(function, -1, -1))

        def evaluate(i_d, i_q):
            with float64():
                current = np.stack(np.broadcast_arrays(np.asarray(i_d, float), i_q))
                found = np.asarray(compiled(jnp.asarray(current.reshape(2, -1))))
            return found.reshape(*found.shape[:-1], *current.shape[1:])

        return evaluate

    return over(jax.grad(mean)), over(jax.hessian(mean))


@pytest.fixture(scope="session")
def machine_fit(true_map) -> Fit:
    """Return a fit whose map is a network put through the COMSOL machine's own within 300 A."""
    radius, turn = np.meshgrid(np.linspace(0, 300, 16), np.linspace(0, 2 * np.pi, 48))
    visited = np.stack([radius * np.cos(turn), radius * np.sin(turn)]).reshape(2, -1)
    visited = visited[:, visited[0] < 150]
    psi = true_map[0](*visited)
    draw = FluxMap(ConvexGradient.random(2, 12, 0), 300.0, 0.08)
    layout = Layout(draw)

    def residual(raw):
        model = layout.model(layout.values(raw)[:, None])
        found, _ = model.flux_and_inductance(jnp.asarray(visited))
        return (found - psi).ravel() / 0.08

    with float64():
        value, slope = jax.jit(residual), jax.jit(jax.jacfwd(residual))
        best = least_squares(value, layout.raw(draw), jac=slope, method="lm", max_nfev=200).x
        flux = layout.plain_model(best)
    estimate = Estimate(0.01, 1e-4, (0.0098, 0.0102), "ohm", 0.9)
    return Fit(
        Machine(flux, (Resistance(0.01),)),
        {"R": estimate},
        HorizonChoice(50, "plateau", "Horizons agree.", ()),
        visited.T,
        (),
        Spectrum("run.csv", np.zeros(1), np.zeros((1, 2))),
        provenance={"pole_pairs": 5},
    )


# --- recordings of the simulated bench, made once -------------------------------------------


@pytest.fixture(scope="session")
def slow_run() -> Experiment:
    """The paper's hard case: one speed, slow trajectory, unmodelled harmonics."""
    return simulate(TRACTION_300A, Lissajous(240.0, 14.0, 15.0), speed_rpm=1500.0, duration=1.0)


@pytest.fixture(scope="session")
def fast_run() -> Experiment:
    """The well-designed case: low speed, fast trajectory."""
    return simulate(TRACTION_300A, Lissajous(200.0, 140.0, 150.0), speed_rpm=150.0, duration=1.0)


@pytest.fixture(scope="session")
def unseen_run() -> Experiment:
    """Another speed and trajectory."""
    return simulate(TRACTION_300A, Lissajous(200.0, 40.0, 33.0), speed_rpm=900.0, duration=0.3)


@pytest.fixture(scope="session")
def dead_time_run() -> Experiment:
    """A drive with 0.6 us of dead time: 2.4 V at 400 V and 10 kHz."""
    drive = Drive(inverter=Inverter(dead_time=DeadTime(0.6e-6)))
    reference = Lissajous(240.0, 50.0, 43.0)
    return simulate(TRACTION_300A, reference, speed_rpm=1000.0, duration=0.5, drive=drive)
