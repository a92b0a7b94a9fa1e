"""What the loss at a horizon weighs: exact on linear systems, W_H itself for white residuals."""

import warnings
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import pytest

from penode import Experiment, Jittered, Model, Predictor, physical
from penode.arrays import Leaf
from penode.data.windows import cut
from penode.horizon.loss_weighting import linearised, loss_weighting, weight_matrix
from penode.predictors.multistep import AdamsBashforth
from penode.predictors.tableaus import AB2
from penode.training.loss import Loss
from penode.training.residuals import Objective
from penode.validation.comparison import Comparison
from penode.validation.free_run import compare

STEP, SPEED, SAMPLES = 1e-4, 150.0, 400


class Lag(Model):
    """x' = b u - a x."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ("u",)
    state_units: ClassVar[tuple[str, ...]] = ("K",)

    a: Leaf = physical("1/s")
    b: Leaf = physical("K/s")

    def derivative(self, x, u):
        return jnp.stack([self.b * u[0] - self.a * x[0]])


def kicks(rng, states, horizon):
    """Return what disturbs each step: nothing in the first and the last H samples."""
    found = rng.normal(size=(SAMPLES, states))
    found[: horizon + 2] = found[-horizon - 2 :] = 0.0
    return found


def machine_case(systems, rng, horizon):
    """Return model, predictor and a recording of the linear machine, disturbed in its middle."""
    system = systems["linear machine"]
    inputs = np.column_stack([rng.normal(0, 5, (SAMPLES, 2)), np.full(SAMPLES, SPEED)])
    states = [np.array([3.0, -2.0])]
    for u, kick in zip(inputs[:-1], kicks(rng, 2, horizon)[1:], strict=True):
        states.append(system.step("rk4", system.raw, states[-1], u) + kick)
    names = (*system.model.states, *system.model.inputs)
    rows = np.column_stack([states, inputs]).T
    channels = dict(zip(names, rows, strict=True))
    return system.model, Predictor(STEP), Experiment("run.csv", STEP, channels)


def multistep_case(systems, rng, horizon):
    """Return the same of a lag under the second-order Adams-Bashforth method."""
    u, x, step = rng.normal(size=SAMPLES), np.zeros(SAMPLES), 0.02
    slope = np.zeros(SAMPLES)
    for k, kick in enumerate(kicks(rng, 1, horizon)[1:, 0]):
        slope[k] = 2.0 * u[k] - 3.0 * x[k]
        x[k + 1] = x[k] + step * (1.5 * slope[k] - 0.5 * slope[k - 1] if k else slope[k]) + kick
    recording = Experiment("run.csv", step, {"x": x, "u": u})
    return Lag(3.0, 2.0), Predictor(step, AdamsBashforth(AB2)), recording


@pytest.mark.parametrize("horizon", [1, 7, 23])
@pytest.mark.parametrize(
    ("make", "free"),
    [
        (machine_case, {}),
        (machine_case, {"i_d": 0.5, "i_q": 0.5}),
        (machine_case, {"i_q": 0.2}),
        (multistep_case, {}),
    ],
)
def test_the_loss_is_the_weighted_spectrum_of_one_step_errors(systems, rng, make, free, horizon):
    model, predictor, run = make(systems, rng, horizon)
    scale = np.full(len(model.states), 0.5)
    every = cut(
        [run], model.states, model.inputs, horizon, past=predictor.past, placement=Jittered(0, 1)
    )
    objective = Objective(predictor, model, scale, Loss(free_starts=free))
    terms = objective.gauss_newton(objective.layout.raw(model), every)
    comparison = compare(predictor, model, run)
    residual = ((comparison.measured - comparison.one_step) / scale)[predictor.past :]
    spectrum = np.fft.fft(residual, axis=0)
    matrices = linearised(predictor, model, run, scale)
    starts = objective.error.start_stiffness
    weight = weight_matrix(matrices, len(scale), horizon, len(residual), starts)
    summed = np.einsum("fi,fij,fj->", spectrum.conj(), weight, spectrum) * horizon / len(residual)
    assert summed.real == pytest.approx(terms.loss * terms.count, rel=1e-8)
    assert abs(summed.imag) < 1e-9 * summed.real


def test_the_linear_machine_has_one_matrix_the_exponential_series(systems, rng):
    model, predictor, run = machine_case(systems, rng, 1)
    found = linearised(predictor, model, run, np.array([1.0, 4.0]))
    rate = np.array(
        [
            [-model.R / model.L_d, SPEED * model.L_q / model.L_d],
            [-SPEED * model.L_d / model.L_q, -model.R / model.L_q],
        ]
    )
    z = rate * STEP
    matrix = np.eye(2) + z @ (np.eye(2) + z @ (np.eye(2) + z @ (np.eye(2) + z / 4) / 3) / 2)
    assert found.shape == (64, 2, 2)
    scaled = matrix * np.array([[1.0, 4.0], [0.25, 1.0]])
    np.testing.assert_allclose(found, np.broadcast_to(scaled, found.shape), rtol=0, atol=1e-13)


def rotation(decay, turn):
    """Return the matrix of the complex factor decay * exp(j turn)."""
    cosine, sine = decay * np.cos(turn), decay * np.sin(turn)
    return np.array([[[cosine, -sine], [sine, cosine]]])


def comparison_of(residual, units=("A", "A")):
    rows = np.vstack([np.zeros((1, residual.shape[1])), residual])
    states = tuple(f"x{k}" for k in range(residual.shape[1]))
    return Comparison("run.csv", "train", STEP, states, units, rows, rows * 0, rows * 0)


@pytest.mark.parametrize("horizon", [1, 5, 60])
def test_a_rotation_has_the_closed_form_at_signed_frequencies(rng, horizon):
    """W_H = (1/H) sum_k |(1 - (a/q)^k) / (1 - a/q)|^2, centred where the model turns."""
    a = 0.99 * np.exp(-0.4j)
    residual = rng.normal(size=(901, 2))
    view = loss_weighting(comparison_of(residual), rotation(0.99, -0.4), [horizon])
    ratio = a * np.exp(-2j * np.pi * view.frequency * STEP)
    k = np.arange(1, horizon + 1)[:, None]
    expected = np.mean(np.abs((1 - ratio**k) / (1 - ratio)) ** 2, axis=0)
    assert view.signals == ("x0 + j x1",)
    np.testing.assert_allclose(view.weight[0, :, 0], expected, rtol=1e-9)
    if horizon > 1:
        peak = view.frequency[view.weight[0, :, 0].argmax()]
        assert peak == pytest.approx(-0.4 / (2 * np.pi * STEP), abs=STEP**-1 / 901)


def test_of_a_white_residual_the_weighted_spectrum_is_the_weight(rng):
    residual = 0.3 * rng.normal(size=(60_000, 2))
    view = loss_weighting(comparison_of(residual), rotation(0.98, -0.2), [1, 20])
    level = 2 * 0.3**2 / 60_000
    found, expected = (
        values[:, :, 0].reshape(2, 60, 1000).mean(axis=2)
        for values in (view.weighted / level, view.weight)
    )
    np.testing.assert_allclose(found, expected, rtol=0.15)
    assert view.power.sum() == pytest.approx(np.mean(np.sum(residual**2, axis=1)), rel=0.02)


def test_states_of_two_units_are_seen_one_by_one(rng):
    matrices = np.array([[[0.9, 0.0], [0.0, 0.5]]])
    view = loss_weighting(comparison_of(rng.normal(size=(500, 2)), ("m", "m/s")), matrices, [4])
    turn = np.exp(-2j * np.pi * view.frequency * STEP)
    assert view.signals == ("x0", "x1")
    assert view.unit == ""
    assert view.frequency[[0, -1]] == pytest.approx([0.0, 0.5 / STEP])
    for state, a in enumerate((0.9, 0.5)):
        filters = [sum((a * turn) ** j for j in range(k)) for k in (1, 2, 3, 4)]
        expected = np.mean(np.abs(filters) ** 2, axis=0)
        np.testing.assert_allclose(view.weight[0, :, state], expected, rtol=1e-9)


def test_a_line_in_the_passband_takes_the_loss_over(rng):
    """A faint line where the model turns, and a strong one far away."""
    time = STEP * np.arange(20_000)
    slow, fast = (np.exp(2j * np.pi * f * time) for f in (-310.0, 2000.0))
    signal = 0.1 * slow + 1.0 * fast
    residual = np.column_stack([signal.real, signal.imag]) + 0.01 * rng.normal(size=(20_000, 2))
    matrices = rotation(0.999, -2 * np.pi * 310 * STEP)
    view = loss_weighting(comparison_of(residual), matrices, [1, 100], base=50.0)
    strong, faint = view.lines
    assert (strong.order, faint.order) == (
        pytest.approx(40, abs=0.01),
        pytest.approx(-6.2, abs=0.01),
    )
    assert view.fractions(strong) == pytest.approx([0.99, 0.03], abs=0.02)
    assert view.fractions(faint) == pytest.approx([0.01, 0.97], abs=0.02)
    assert (strong.share, faint.amplitude) == (
        pytest.approx(0.99, abs=0.01),
        pytest.approx(0.1, rel=0.02),
    )


def test_errors_that_grow_without_bound_give_no_warning():
    """Warnings of a library would stand beside the sentences of the command."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        weights = weight_matrix(np.full((3, 2, 2), 1e80), 2, 6, 16)
    assert not np.isfinite(weights).all()


#: One-step matrices whose errors grow too far for numbers, of every kind.
UNBOUNDED = {
    "overflow": np.full((3, 2, 2), 1e80),
    "rank one, which adding a start's cost does not cure": np.ones((3, 2, 2)),
    "growth of 1e17": rotation(1.9, -0.4),
    "one direction alone": np.array([[[3.0, 0.0], [0.0, 0.5]]]),
    "not a number": np.full((1, 2, 2), np.nan),
    "infinite": np.array([[[np.inf, -np.inf], [np.inf, 0.0]]]),
}


@pytest.mark.parametrize("starts", [None, np.ones(2), np.array([1.0, np.inf])])
@pytest.mark.parametrize("kind", UNBOUNDED)
def test_the_weight_of_an_unstable_rung_is_not_available(rng, kind, starts):
    """At H = 1 it is, with starts as measured; nothing warns and nothing is singular."""
    matrices = UNBOUNDED[kind]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        residual = rng.normal(size=(500, 2)) + np.sin(np.arange(500))[:, None]
        view = loss_weighting(comparison_of(residual), matrices, [1, 60], starts=starts)
        (line, *_) = view.lines
        fractions = view.fractions(line)
    assert view.available[0] or starts is not None
    assert not view.available[1]
    assert np.isfinite(fractions).tolist() == view.available.tolist()
    known = view.at(view.available)
    assert known.horizons == (1,)[: view.available.sum()]
    assert known.weight.shape == (len(known.horizons), *view.weight.shape[1:])


def test_a_stable_model_has_its_weight_over_thousands_of_steps(rng):
    view = loss_weighting(
        comparison_of(rng.normal(size=(9001, 2))), rotation(1.0, -0.4), [4500], starts=np.ones(2)
    )
    assert view.available.all()


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
def test_a_residual_that_is_not_finite_has_no_lines_and_no_weight(rng, value):
    residual = rng.normal(size=(500, 2))
    residual[17, 0] = value
    with np.errstate(invalid="ignore"):
        comparison = comparison_of(residual)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        view = loss_weighting(comparison, rotation(0.9, 0.1), [1, 5])
    assert (view.lines, view.available.any()) == ((), False)
