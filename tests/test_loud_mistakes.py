"""A mistake in a model or a recording is one sentence with the fix, before anything compiles."""

import math
from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import penode
from penode import Experiment, InputError, Model, Start, identify, ladder_plan, physical
from penode.engine import Normal, Positive, TanhLayers
from penode.models.checked import require_sound

COUNT, STEP = 60, 0.1
TIME = STEP * np.arange(COUNT)
CHANNELS = {"p": np.sin(TIME), "v": np.cos(TIME), "F": np.cos(3 * TIME)}
RUN = Experiment("run", STEP, CHANNELS)

#: Durations of what was compiled since the process began.
COMPILED: list[float] = []


def _listen(event, seconds, **_):
    if event.endswith("backend_compile_duration"):
        COMPILED.append(seconds)


jax.monitoring.register_event_duration_secs_listener(_listen)


class Pendulum(Model):
    states: ClassVar = ("p", "v")
    inputs: ClassVar = ("F",)
    state_units: ClassVar = ("m", "m/s")

    k: object = physical("N/m")
    c: object = physical("Ns/m")

    def derivative(self, x, u):
        return jnp.stack([x[1], u["F"] - self.k * x[0] - self.c * x[1]])


class Loaded(Pendulum):
    m: object = physical("kg")


class Constant(Pendulum):
    m: object = 2.0


class Spring(eqx.Module):
    """A part of a model that is written by the user too."""

    def __call__(self, x):
        return np.tanh(x)


class Nested(Pendulum):
    spring: Spring

    def derivative(self, x, u):
        return jnp.stack([x[1], u["F"] - self.k * self.spring(x[0])])


def of(derivative, **fields):
    """Return a pendulum with another derivative or other class attributes."""
    return type("Mine", (Pendulum,), {"derivative": derivative, **fields})(3.0, 0.1)


def named(**fields):
    return type("Mine", (Pendulum,), fields)(3.0, 0.1)


def bare(**fields):
    """Return a model of these class attributes only."""
    fields = {"derivative": lambda self, x, u: -x, **fields}
    return type("Mine", (Model,), fields)()


def seen(output, **fields):
    """Return what identifies a pendulum of which only an output is measured."""
    fields = {"outputs": {"y": "m"}, **fields}
    return given(lambda: named(output=output, **fields), [recorded(y=np.sin(TIME))()])


def pull(self, x, u):
    return u["F"] - self.k * x[0] - self.c * x[1]


def branch(self, x, u):
    if x[0] > 0:
        return jnp.stack([x[1], pull(self, x, u)])
    return jnp.stack([x[1], u["F"]])


def loop(self, x, u):
    while self.k > 1:
        pass


def sign(self, x, u):
    return jnp.stack([x[1], max(x[0], 0.0)])


def assigned(self, x, u):
    x[0] = 0.0
    return x


def recorded(**channels):
    return lambda: Experiment("run", STEP, {**CHANNELS, **channels})


def given(model, experiments=(RUN,), **options):
    return lambda: identify(model(), list(experiments), plan=ladder_plan((1, 2)), **options)


def fails(derivative, **fields):
    return given(lambda: of(derivative, **fields))


CASES: dict[str, tuple[Callable, tuple[str, ...]]] = {
    # shape of the derivative
    "list": (fails(lambda s, x, u: [x[1], pull(s, x, u)]), ("derivative", "a list", "jnp.stack")),
    "tuple": (fails(lambda s, x, u: (x[1], x[0])), ("derivative", "a tuple", "jnp.stack")),
    "none": (fails(lambda s, x, u: None), ("derivative", "nothing", "p, v", "jnp.stack")),
    "missing state": (
        fails(lambda s, x, u: pull(s, x, u)[None]),
        ("Mine.derivative", "(1, batch)", "(2, batch)", "p, v"),
    ),
    "one row": (fails(lambda s, x, u: pull(s, x, u)), ("derivative", "(batch,)", "(2, batch)")),
    "extra state": (fails(lambda s, x, u: jnp.stack([*x, x[0]])), ("(3, batch)", "p, v")),
    "scalar row": (
        fails(lambda s, x, u: jnp.stack([1.0, x[0]])),
        ("derivative", "test_loud_mistakes.py", "jnp.stack([1.0, x[0]])", "0 * x[0] + 1.0"),
    ),
    "numpy result": (fails(lambda s, x, u: np.zeros(2)), ("derivative", "(2,)", "(2, batch)")),
    "complex": (fails(lambda s, x, u: 1j * x), ("derivative", "complex", "jnp.real")),
    "row beyond": (fails(lambda s, x, u: jnp.stack([x[1], x[2]])), ("x[2]", "beyond", "0 to 1")),
    "row before": (fails(lambda s, x, u: jnp.stack([x[1], x[-3]])), ("x[-3]", "beyond")),
    # values that are not known yet
    "if": (fails(branch), ("Mine.derivative, line", '"if x[0] > 0:"', "jnp.where")),
    "while": (fails(loop), ('"while self.k > 1:"', "jnp.where")),
    "max": (fails(sign), ("max(x[0], 0.0)", "jnp.maximum")),
    "numpy": (fails(lambda s, x, u: -np.sin(x)), ("-np.sin(x)", "jax.numpy")),
    "numpy stack": (fails(lambda s, x, u: np.stack([x[1], x[0]])), ("np.stack", "jax.numpy")),
    "math": (fails(lambda s, x, u: -math.sin(x[0]) * x), ("math.sin(x[0])", "jax.numpy")),
    "float": (fails(lambda s, x, u: float(s.k) * x), ("float(s.k)", "jax.numpy")),
    "nested": (given(lambda: Nested(3.0, 0.1, Spring())), ("return np.tanh(x)", "jax.numpy")),
    "assignment": (fails(assigned), ('"x[0] = 0.0"', "jnp.stack")),
    "typing error": (fails(lambda s, x, u: -s.kk * x), ("-s.kk * x", "no attribute 'kk'")),
    "learned": (
        given(lambda: of(Pendulum.derivative, learned=lambda self, x: np.sin(x))),
        ("Mine.learned", "np.sin(x)", "jax.numpy"),
    ),
    "corrected": (
        given(lambda: of(Pendulum.derivative, corrected=lambda self, x: x[0])),
        ("Mine.corrected", "(batch,)", "(2, batch)"),
    ),
    # x and u
    "exchanged": (
        fails(lambda self, u, x: -x),
        ("derivative(self, u, x)", "derivative(self, x, u)"),
    ),
    "exchanged in use": (fails(lambda s, x, u: -x["F"] * u), ('x["F"]', "u['F']")),
    "state by name": (fails(lambda s, x, u: -x["v"] * x), ('x["v"]', "x[1]")),
    "state of u": (fails(lambda s, x, u: -u["v"] * x), ("no input 'v'", "x[1]")),
    "input spelled": (fails(lambda s, x, u: -u["f"] * x), ("no input 'f'", "(did you mean F?)")),
    "input beyond": (fails(lambda s, x, u: u[1] * x), ("no input 1", "inputs are F")),
    "whole u": (fails(lambda s, x, u: x + u), ("x + u", 'u["F"]')),
    "t first": (
        fails(lambda self, t, x, u: -x),
        ("derivative(self, t, x, u) has its arguments exchanged", "derivative(self, x, u)"),
    ),
    "another argument": (
        fails(lambda self, x, u, theta: -x),
        ("takes x, u, theta beside self", "derivative(self, x, u, t)"),
    ),
    "no u": (fails(lambda self, x: -x), ("takes x beside self", "derivative(self, x, u)")),
    # names and units
    "no states": (given(lambda: bare(inputs=())), ("Mine has no states", "states = (")),
    "no units": (
        given(lambda: bare(states=("p",), inputs=())),
        ("no state_units", "state_units = ("),
    ),
    "no inputs": (
        given(lambda: bare(states=("p",), state_units=("m",))),
        ("Mine has no inputs", "inputs = ("),
    ),
    "states text": (given(lambda: named(states="p")), ("Mine.states", "'p'", "('p',)")),
    "inputs text": (given(lambda: named(inputs="F")), ("Mine.inputs", "'F'", "('F',)")),
    "units text": (given(lambda: named(state_units="m")), ("Mine.state_units", "('m',)")),
    "unit missing": (
        given(lambda: named(state_units=("m",))),
        ("state_units", "p, v", "each state"),
    ),
    "unit none": (given(lambda: named(state_units=("m", None))), ("state_units", "None", "quotes")),
    "twice": (given(lambda: named(states=("p", "p"))), ("p stands twice", "name of its own")),
    "both": (given(lambda: named(inputs=("p",))), ("p stands twice", "inputs p")),
    "unmeasured": (
        given(lambda: named(unmeasured=("V",))),
        ("V (did you mean v?)", "p, v"),
    ),
    "unmeasured text": (given(lambda: named(unmeasured="v")), ("unmeasured", "('v',)")),
    "all unmeasured": (given(lambda: named(unmeasured=("p", "v"))), ("measured", "`unmeasured`")),
    # outputs
    "output list": (
        seen(lambda s, x, u: [x[0]]),
        ("Mine.output", "a list", "each of the outputs y", "jnp.stack"),
    ),
    "output row": (seen(lambda s, x, u: x[0]), ("Mine.output", "(batch,)", "(1, batch)")),
    "output rows": (
        seen(lambda s, x, u: x),
        ("Mine.output", "(2, batch)", "(1, batch)", "outputs y"),
    ),
    "output if": (
        seen(lambda s, x, u: x[:1] if x[0] > 0 else -x[:1]),
        ("Mine.output, line", "jnp.where"),
    ),
    "output numpy": (seen(lambda s, x, u: np.sin(x[:1])), ("Mine.output", "jax.numpy")),
    "output beyond": (seen(lambda s, x, u: x[2][None]), ("Mine.output", "beyond", "0 to 1")),
    "output input": (
        seen(lambda s, x, u: u["f"][None]),
        ("Mine.output", "no input 'f'", "(did you mean F?)"),
    ),
    "output alone": (seen(lambda self, x: x[:1]), ("output takes x", "output(self, x, u)")),
    "no method": (
        given(lambda: named(outputs={"y": "m"}), [recorded(y=TIME)()]),
        ("Mine has outputs", "output(self, x, u)", "jnp.stack"),
    ),
    "no outputs": (
        seen(lambda s, x, u: x[:1], outputs={}),
        ("method `output`", "no outputs", 'outputs = {"y": "m"}'),
    ),
    "outputs tuple": (
        seen(lambda s, x, u: x[:1], outputs=("y",)),
        ("Mine.outputs", "('y',)", "no units", 'outputs = {"y": "m"}'),
    ),
    "outputs text": (seen(lambda s, x, u: x[:1], outputs="y"), ("Mine.outputs", "'y'", "unit")),
    "output unit": (
        seen(lambda s, x, u: x[:1], outputs={"y": None}),
        ("Mine.outputs", "'y': None", "SI unit"),
    ),
    "output and input": (
        seen(lambda s, x, u: x[:1], outputs={"F": "N"}),
        ("F stands twice", "inputs F", "name of its own"),
    ),
    "output of a state": (
        seen(lambda s, x, u: x[:1], outputs={"p": "mm"}),
        ("state p is in m", "mm", "one unit"),
    ),
    "output and unmeasured": (
        seen(lambda s, x, u: x[:1], unmeasured=("v",)),
        ("Mine has outputs", "`unmeasured`", "leave it out"),
    ),
    "output and corrected": (
        seen(lambda s, x, u: x[:1], corrected=lambda self, measured: measured),
        ("Mine has outputs", "`corrected`", "in `output`"),
    ),
    "output channel": (
        seen(lambda s, x, u: x[:1], outputs={"Y": "m"}),
        ("no channel Y (did you mean y?)",),
    ),
    "output unused": (
        given(
            lambda: type(
                "Mine", (Loaded,), {"outputs": {"y": "m"}, "output": lambda s, x, u: x[:1]}
            )(3.0, 0.1, 1.0),
            [recorded(y=TIME)()],
        ),
        ("Mine.m acts nowhere", "derivative or output"),
    ),
    "one step": (
        lambda: identify(
            named(outputs={"y": "m"}, output=lambda s, x, u: x[:1]),
            [Experiment("run", STEP, {"y": TIME, "F": TIME})],
            purpose="one_step",
        ),
        ("purpose must be 'parameters' or 'simulation'", "got 'one_step'", "p, v"),
    ),
    # parameters
    "no unit": (
        lambda: physical(),
        ("the unit must be text", "lambda: physical()", 'physical("kg")'),
    ),
    "unit number": (lambda: physical(1.0), ("got 1.0", "physical(1.0)", "text")),
    "transform class": (lambda: physical("kg", Positive), ("Positive", "Positive()")),
    "prior tuple": (lambda: physical("kg", prior=(1, 2)), ("(1, 2)", "Normal(mean, deviation)")),
    "parameter text": (lambda: Pendulum("a", 0.1), ("'a'", "a number")),
    "parameter array": (
        given(lambda: Pendulum([1.0, 2.0], 0.1)),
        ("k has shape (2,)", "one number"),
    ),
    "parameter nan": (given(lambda: Pendulum(np.nan, 0.1)), ("k must", "finite", "got nan")),
    "unused": (given(lambda: Loaded(3.0, 0.1, 1.0)), ("Loaded.m acts nowhere", "use it")),
    "plain number": (given(lambda: Constant(3.0, 0.1)), ("m = 2.0", "float", "penode.physical(")),
    # what identify is given
    "class": (given(lambda: Pendulum), ("class Pendulum", "Pendulum(k=..., c=...)")),
    "class in a start": (given(lambda: Start(Pendulum)), ("class Pendulum", "Pendulum(k=")),
    "function": (given(lambda: branch), ("branch", "instance", "penode.Model")),
    "recording": (lambda: identify(Pendulum(3.0, 0.1), RUN), ("one recording", "[experiment]")),
    "dictionaries": (given(lambda: Pendulum(3.0, 0.1), [CHANNELS]), ("dict", "penode.Experiment")),
    "nothing": (
        given(lambda: Pendulum(3.0, 0.1), []),
        ("one recording at least", "[penode.load(path)]"),
    ),
    "channel spelled": (
        given(lambda: Pendulum(3.0, 0.1), [Experiment("run", STEP, {"P": TIME, "v": TIME})]),
        ("no channel p (did you mean P?)", "P, v", "rename"),
    ),
    "nan": (
        given(lambda: Pendulum(3.0, 0.1), [recorded(p=np.where(TIME > 3, np.nan, TIME))()]),
        ("row 32", "channel p is nan", "cut"),
    ),
    # recordings
    "column": (recorded(p=TIME[:, None]), ("run: channel p", "(60, 1)", "ravel()")),
    "two columns": (recorded(p=np.ones((COUNT, 2))), ("channel p", "(60, 2)", "each column")),
    "scalar": (recorded(p=1.0), ("channel p", "shape ()")),
    "text": (recorded(p=[str(t) for t in TIME]), ("channel p is text", "astype(float)")),
    "complex channel": (recorded(p=TIME + 0j), ("channel p is complex", "values.real")),
    "objects": (recorded(p=np.array([None] * COUNT)), ("channel p is mixed", "array of floats")),
    "ragged": (recorded(p=[[1.0], [1.0, 2.0]]), ("channel p", "array of floats")),
    "booleans": (recorded(p=TIME > 1), ("channel p is boolean", "astype(float)")),
    "dates": (recorded(p=np.arange(COUNT).astype("M8[s]")), ("channel p", "dates", "time_step")),
    "masked": (recorded(p=np.ma.masked_array(TIME, TIME > 3)), ("channel p", "masked", "cut")),
    "none channel": (recorded(p=None), ("channel p", "NoneType", "array of floats")),
    "length": (recorded(p=TIME[1:]), ("run", "'p': 59", "'v': 60", "one length")),
    "channel number": (lambda: Experiment("run", STEP, {0: TIME}), ("got 0", "quotes")),
    "no mapping": (lambda: Experiment("run", STEP, [TIME]), ("channels is a list", "dictionary")),
    "step zero": (lambda: Experiment("run", 0.0, CHANNELS), ("above 0, got 0.0",)),
    "step text": (lambda: Experiment("run", "0.1", CHANNELS), ("one number above 0, got '0.1'",)),
    "step array": (lambda: Experiment("run", TIME, CHANNELS), ("got shape (60,)",)),
    "order": (lambda: Experiment(STEP, "run", CHANNELS), ("0.1", "name", "time_step, channels)")),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("case", CASES)
def test_a_mistake_is_one_sentence_with_the_fix(case):
    mistaken, words = CASES[case]
    before = len(COMPILED)
    with pytest.raises(InputError) as caught:
        mistaken()
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert sentence.endswith(".")
    for word in words:
        assert word in sentence
    assert len(COMPILED) == before


def test_what_compiles_is_counted():
    before = len(COMPILED)
    jax.jit(lambda x: x + 417.0)(1.0)
    assert len(COMPILED) == before + 1


# --- what is no mistake -------------------------------------------------------------------------


class Whole(Pendulum):
    """Everything that a model may have."""

    unmeasured: ClassVar = ("v",)

    spring: TanhLayers
    offset: object = penode.nuisance("m")
    g: float = 9.81
    order: int = 3
    kind: "str" = "cubic"

    def derivative(self, x, u):
        pull = self.k * x[0] ** self.order + self.learned(x)[0] + self.g
        return jnp.stack([x[1], jnp.where(x[0] > 0, u[0] - pull, -self.c * x[1])])

    def learned(self, x):
        return self.spring.value_and_jacobian(x[:1])[0]

    def corrected(self, measured):
        return jnp.stack([measured[0] - self.offset, measured[1]])


def test_a_sound_model_passes_and_compiles_nothing():
    before = len(COMPILED)
    require_sound(Whole(3.0, 0.1, TanhLayers.random((1, 3, 1), seed=0), 0.0))
    assert len(COMPILED) == before


def test_a_row_may_broadcast_over_the_batch():
    class Drift(Pendulum):
        def derivative(self, x, u):
            return jnp.stack([self.k, self.c])

    require_sound(Drift(1.0, 2.0))


def test_an_error_that_the_model_raises_itself_passes():
    def refuse(self, x, u):
        raise InputError("the table ends.")

    with pytest.raises(InputError) as caught:
        require_sound(of(refuse))
    assert str(caught.value) == "the table ends."


@pytest.mark.parametrize("value", [4.0, 4, np.float64(4), np.array(4.0), jnp.asarray(4.0)])
def test_a_field_annotated_float_is_a_constant(value):
    model = Whole(3.0, 0.1, TanhLayers.random((1, 3, 1), seed=0), 0.0, g=value)
    assert model.g == 4.0
    assert type(model.g) is float
    paths = jax.tree_util.tree_leaves_with_path(model)
    assert not [
        path for path, _ in paths if jax.tree_util.keystr(path) in (".g", ".order", ".kind")
    ]


def test_a_constant_that_is_no_number_is_refused():
    with pytest.raises(InputError, match=r"^g must be one number, got 'x'\.$"):
        Whole(3.0, 0.1, TanhLayers.random((1, 3, 1), seed=0), 0.0, g="x")


# --- priors act, and infinite intervals have their reason ---------------------------------------


class Decay(Model):
    """x' = b u - a x; written again below with parameters that act only together."""

    states: ClassVar = ("x",)
    inputs: ClassVar = ("u",)
    state_units: ClassVar = ("m",)

    a: object = physical("1/s")
    b: object = physical("1/s")

    def derivative(self, x, u):
        return -self.a * x + self.b * u.values


def driven(count=400, noise=0.02):
    """Record x' = u - 0.8 x under a held random input, solved exactly, with noise."""
    random = np.random.default_rng(5)
    u = np.repeat(random.normal(size=count // 5), 5)
    shrink, x = math.exp(-0.8 * STEP), np.zeros(count)
    for k in range(count - 1):
        x[k + 1] = shrink * x[k] + (1 - shrink) / 0.8 * u[k]
    x += noise * random.normal(size=count)
    return Experiment("driven", STEP, {"x": x, "u": u})


@pytest.fixture(scope="module")
def unbelieved():
    return identify(Decay(1.0, 0.5), [driven()], plan=ladder_plan((3,))).parameters["a"]


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_declared_prior_counts_like_a_measurement(unbelieved, sign):
    """As sure as the data and two deviations off, it moves the estimate by one, as Bayes has it."""
    value, std = unbelieved.value, unbelieved.std

    class Believed(Decay):
        a: object = physical("1/s", prior=Normal(value + 2 * sign * std, std))

    one = identify(Believed(1.0, 0.5), [driven()], plan=ladder_plan((3,))).parameters["a"]
    assert (one.value - value) / std == pytest.approx(sign, abs=0.15)
    assert one.std / std == pytest.approx(math.sqrt(0.5), abs=0.1)
    rows = {row.source: row.std for row in one.budget}
    assert 0 < rows["declared priors"] < one.std
    assert "prior of the learned map" not in rows


class Product(Model):
    states: ClassVar = ("x",)
    inputs: ClassVar = ("u",)
    state_units: ClassVar = ("m",)

    a: object = physical("1/s")
    c: object = physical("1")
    b: object = physical("1/s")

    def derivative(self, x, u):
        return -self.a * self.c * x + self.b * u.values


class KnownProduct(Product):
    c: object = physical("1", prior=Normal(2.0, 0.1))


def test_parameters_that_act_only_together_are_not_known():
    fit = identify(Product(1.0, 1.0, 0.5), [driven()], plan=ladder_plan((1, 2, 4)))
    assert [n for n, e in fit.parameters.items() if not np.isfinite(e.std)] == ["a", "c"]
    (reason,) = (w for w in fit.warnings if "infinite" in w)
    assert reason.startswith("The interval of a, c is infinite: a and c act only together")
    assert "prior" in reason


def test_a_prior_tells_them_apart():
    fit = identify(KnownProduct(1.0, 1.0, 0.5), [driven()], plan=ladder_plan((1, 2, 4)))
    assert not [w for w in fit.warnings if "infinite" in w]
    c, a = fit.parameters["c"], fit.parameters["a"]
    assert c.value == pytest.approx(2.0, abs=0.01)
    assert c.std == pytest.approx(0.1, rel=0.05)
    assert a.interval_95[0] < 0.4 < a.interval_95[1]


class Asleep(Decay):
    limit: object = physical("1/s")

    def derivative(self, x, u):
        return -self.a * x + self.b * u.values - self.limit * jnp.maximum(x - 100.0, 0.0)


def test_a_parameter_that_does_not_act_in_the_recordings_is_told():
    fit = identify(Asleep(1.0, 0.5, 1.0), [driven(120)], plan=ladder_plan((12,)))
    assert fit.parameters["limit"].std == np.inf
    assert any(
        w.startswith("The interval of limit is infinite: no prediction") for w in fit.warnings
    )


@pytest.mark.filterwarnings("error")
def test_samples_too_few_for_an_interval_are_told():
    """Without noise, so that residuals have no spread either; NumPy warns of nothing."""
    fit = identify(Decay(1.0, 0.5), [driven(60, noise=0.0)], plan=ladder_plan((12,)))
    unknown = [name for name, e in fit.parameters.items() if not np.isfinite(e.std)]
    assert unknown == ["a", "b"]
    assert any("60 samples are few beside" in w for w in fit.warnings)
