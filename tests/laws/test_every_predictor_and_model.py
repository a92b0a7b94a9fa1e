"""Every predictor with every model: all ways to differentiate the one loss agree.

Forward sensitivities against J'J and J'r of the stacked residuals of a plain Python loop over
`Predictor.step`, reverse mode against both, and all of them against central differences.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from penode import Jittered, Predictor
from penode.arrays import float64
from penode.data.windows import cut
from penode.predictors.band_limited import BandLimitedHold
from penode.predictors.holds import FirstOrderHold, ZeroOrderHold
from penode.predictors.implicit import ImplicitMidpoint, Trapezoidal
from penode.predictors.multistep import AdamsBashforth
from penode.predictors.one_step import RungeKutta, Substeps
from penode.predictors.tableaus import AB2, AB4, DOPRI5, EULER, MIDPOINT, RK4
from penode.training.residuals import Objective

pytestmark = pytest.mark.usefixtures("quickly_compiled")

HORIZON, ACCURACY = 3, 1e-10

PREDICTORS = {
    "euler": (RungeKutta(EULER), ZeroOrderHold()),
    "midpoint, straight input": (RungeKutta(MIDPOINT), FirstOrderHold()),
    "rk4": (RungeKutta(RK4), ZeroOrderHold()),
    "dopri5, straight input": (RungeKutta(DOPRI5), FirstOrderHold()),
    "ab2": (AdamsBashforth(AB2), ZeroOrderHold()),
    "ab4, straight input": (AdamsBashforth(AB4), FirstOrderHold()),
    "implicit midpoint": (ImplicitMidpoint(), ZeroOrderHold()),
    "trapezoidal, straight input": (Trapezoidal(), FirstOrderHold()),
    "sub-steps, straight input": (Substeps(RungeKutta(EULER), 2), FirstOrderHold()),
    "rk4, band-limited input": (RungeKutta(RK4), BandLimitedHold()),
    "implicit midpoint, band-limited input": (ImplicitMidpoint(), BandLimitedHold()),
    "sub-steps, band-limited input": (Substeps(RungeKutta(EULER), 2), BandLimitedHold()),
}


MODELS = ("duffing", "linear machine", "coenergy machine", "mlp machine")

# Every pair is checked by `make validate`; a predictor of each kind by every `make test`.
QUICK = {
    ("coenergy machine", "rk4"),
    ("linear machine", "ab4, straight input"),
    ("linear machine", "sub-steps, straight input"),
    ("duffing", "implicit midpoint"),
    ("mlp machine", "euler"),
    ("duffing", "rk4, band-limited input"),
}
PAIRS = [
    pytest.param(model, name, marks=() if (model, name) in QUICK else pytest.mark.slow)
    for model in MODELS
    for name in PREDICTORS
]


def windows_of(system, predictor):
    """Return 43 windows, fewer than one chunk."""
    names = (system.model.states, system.model.inputs)
    options = {"past": predictor.past, "prepared": predictor.prepared}
    windows = cut(system.experiments, *names, HORIZON, placement=Jittered(1), **options)
    return replace(windows, starts=windows.starts[::3], recording=windows.recording[::3])


def plain_loop(objective, windows, scale):
    """Return the function from raw parameters to all residuals."""
    states, inputs = jnp.asarray(windows.states.T), jnp.asarray(windows.inputs.T)
    past, starts = objective.predictor.past, windows.starts

    def residuals(raw):
        model = objective.layout.model(objective.layout.values(raw)[:, None])
        history, found = jnp.stack([states[:, starts - j] for j in range(past)]), []
        for k in range(HORIZON):
            drive = lambda offset, at=starts + k: inputs[:, at + offset]  # noqa: E731
            history = objective.predictor.step(model, history, drive)
            found.append((states[:, starts + k + 1] - history[0]) / scale[:, None])
        return jnp.stack(found).ravel()

    return residuals


def test_no_model_is_left_out(systems):
    assert set(MODELS) == set(systems)


@pytest.mark.parametrize(("model", "name"), PAIRS)
def test_forward_reverse_differences_and_a_plain_loop_agree(systems, model, name, rng):
    system = systems[model]
    predictor = Predictor(system.time_step, *PREDICTORS[name])
    objective = Objective(predictor, system.model, system.scale)
    windows, raw = windows_of(system, predictor), system.raw
    with float64():
        residuals = plain_loop(objective, windows, system.scale)
        both = jax.jit(lambda raw: (residuals(raw), jax.jacfwd(residuals)(raw)))
        r, jacobian = (np.asarray(part) for part in both(raw))
    size = np.linalg.norm(jacobian, axis=0)
    unit = size * np.linalg.norm(r)

    terms = objective.gauss_newton(raw, windows)
    assert terms.count == r.size
    assert terms.loss == pytest.approx(np.mean(r**2), rel=ACCURACY)
    off = (terms.normal - jacobian.T @ jacobian) / np.outer(size, size)
    assert np.abs(off).max() < ACCURACY
    assert (np.abs(terms.descent + jacobian.T @ r) < ACCURACY * unit).all()

    loss, gradient = objective.loss_and_gradient(raw, windows)
    assert loss == pytest.approx(terms.loss, rel=ACCURACY)
    assert (np.abs(terms.descent + r.size / 2 * gradient) < ACCURACY * unit).all()

    along = 1e-5 * np.linalg.norm(r) / size * rng.normal(size=len(raw))
    ahead, behind = (objective.loss_and_gradient(raw + s * along, windows)[0] for s in (1, -1))
    slack = 1e-6 * np.linalg.norm(along * unit) / r.size
    assert (ahead - behind) / 2 == pytest.approx(gradient @ along, abs=slack)
