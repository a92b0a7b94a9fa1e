"""The objective against a NumPy twin differentiated by complex steps."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from penode import Predictor
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import EULER
from penode.training import chunks
from penode.training.chunks import CHUNK
from penode.training.gauss_newton_terms import GaussNewtonTerms
from penode.training.residuals import Objective

HORIZONS = (1, 7, 23)
SYSTEMS = ("duffing", "linear machine", "coenergy machine", "mlp machine")


def expected_terms(system, solver, windows):
    residual, slope = system.sensitivities(solver, system.raw, windows)
    normal = np.einsum("kspw,ksqw->pq", slope, slope)
    scores = np.einsum("kspw,ksw->pw", slope, residual)
    return GaussNewtonTerms(np.mean(residual**2), residual.size, normal, scores.sum(axis=1), scores)


def assert_terms_equal(found, expected, accuracy):
    """Compare to an accuracy relative to each parameter's own size, whatever its unit."""
    size = np.sqrt(np.diag(expected.normal))
    residual = np.sqrt(expected.loss * expected.count)
    assert found.count == expected.count
    assert found.loss == pytest.approx(expected.loss, rel=accuracy)
    off = np.abs(found.normal - expected.normal) / np.outer(size, size)
    assert off.max() < accuracy
    assert (np.abs(found.descent - expected.descent) / size).max() < accuracy * residual
    assert found.scores.shape == expected.scores.shape
    assert (np.abs(found.scores - expected.scores) / size[:, None]).max() < accuracy * residual


def test_window_counts_are_not_whole_chunks(systems):
    """So that the padding of the last chunk is at work in the tests below."""
    counts = [len(systems["duffing"].windows(h)) for h in HORIZONS]
    assert counts[0] > counts[1] > CHUNK > counts[2]
    assert all(count % CHUNK for count in counts)


@pytest.mark.parametrize("horizon", HORIZONS)
@pytest.mark.parametrize(
    ("name", "solver"),
    [
        pytest.param(name, solver, marks=pytest.mark.slow if repeating else ())
        for name in SYSTEMS
        for solver in ("euler", "rk4")
        for repeating in [solver == "euler" and name != "duffing"]
    ],
)
def test_gauss_newton_terms(systems, name, solver, horizon, objective_of):
    system = systems[name]
    windows = system.windows(horizon)
    found = objective_of(system, solver).gauss_newton(system.raw, windows)
    assert_terms_equal(found, expected_terms(system, solver, windows), accuracy=1e-10)
    assert found.finite


def test_the_descent_alone_is_that_of_the_terms(system, objective_of):
    objective, windows = objective_of(system), system.windows(7)
    terms = objective.gauss_newton(system.raw, windows)
    np.testing.assert_array_equal(objective.descent(system.raw, windows), terms.descent)


def test_whole_chunks_and_a_single_window(systems, objective_of):
    system = systems["linear machine"]
    many = system.windows(2)
    for count in (1, CHUNK - 1, CHUNK, CHUNK + 1, 2 * CHUNK):
        part = replace(many, starts=many.starts[:count], recording=many.recording[:count])
        found = objective_of(system).gauss_newton(system.raw, part)
        assert_terms_equal(found, expected_terms(system, "rk4", part), accuracy=1e-10)


@pytest.fixture
def other_chunks():
    """Return a function after which programs are laid out and compiled anew; it acts at the end."""

    def forget():
        chunks._laid_out.cache_clear()
        chunks._sum_over_chunks.clear_cache()

    yield forget
    forget()


@pytest.mark.parametrize(
    ("free", "samples", "width"),
    [(0, 5000, CHUNK), (0, 4096, CHUNK // 2), (14, 5000, CHUNK // 2), (44, 5000, 4)],
)
def test_starts_that_are_estimated_make_chunks_narrower(free, samples, width):
    """Their sensitivities lie in the caches beside those of the parameters."""
    model, layout = SimpleNamespace(states=("x",) * 50), SimpleNamespace(size=2)
    error = SimpleNamespace(model=model, layout=layout, free=np.arange(free))
    assert chunks._width(error, samples) == width


def test_chunks_of_long_recordings_are_wider(systems, objective_of, other_chunks, monkeypatch):
    system = systems["linear machine"]
    many, count, objective = system.windows(2), 2 * CHUNK + 1, objective_of(system)
    windows = replace(many, starts=many.starts[:count], recording=many.recording[:count])
    for longest, width in ((10**9, CHUNK // 2), (0, 2 * CHUNK)):
        monkeypatch.setattr(chunks, "_LONG", longest)
        other_chunks()
        assert chunks._width(objective.error, 1000) == width
        found = objective.gauss_newton(system.raw, windows)
        assert_terms_equal(found, expected_terms(system, "rk4", windows), accuracy=1e-10)


def test_scale_divides_the_residuals(systems):
    system, scale = systems["linear machine"], np.array([0.1, 5.0])
    windows = system.windows(3)
    objective = Objective(Predictor(system.time_step, RungeKutta(EULER)), system.model, scale)
    residual, _ = system.sensitivities("euler", system.raw, windows)
    found = objective.gauss_newton(system.raw, windows)
    assert found.loss == pytest.approx(np.mean((residual / scale[:, None]) ** 2), rel=1e-12)


@pytest.mark.parametrize("field", ["loss", "normal"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_terms_are_finite_when_all_of_them_are(field, value):
    sound = GaussNewtonTerms(1.0, 4, np.eye(2), np.ones(2), np.ones((2, 2)))
    assert sound.finite
    broken = {"loss": value, "normal": np.full((2, 2), value)}[field]
    assert not replace(sound, **{field: broken}).finite


def test_a_padding_window_does_not_speak(systems, objective_of):
    """Sample 0 starts no window here, and the rollout from it overflows."""
    system = systems["linear machine"]
    windows = system.windows(7)
    states = windows.states.copy()
    states[0] = 1e307
    part = replace(windows, states=states, starts=[20, 40, 60], recording=[0, 0, 0])
    found = objective_of(system).gauss_newton(system.raw, part)
    assert_terms_equal(found, expected_terms(system, "rk4", part), accuracy=1e-10)
