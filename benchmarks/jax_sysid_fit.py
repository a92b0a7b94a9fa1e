"""Time to the same loss against jax-sysid: ``taskset -c 0 python -m benchmarks.jax_sysid_fit``.

The contiguous windows are the state of one large model, (2 x window,), whose state function is
penode's own step, so that only loss, derivatives and optimiser differ. jax-sysid runs L-BFGS on it
from the convex start, on parameters in small units, as its first step, of length 1, otherwise makes
an inductance singular and ends the search; penode's Levenberg-Marquardt is stopped when its loss is
as low. Times are cold. Nothing is printed unless penode finds the loss that jax-sysid ended with.

jax-sysid 1.1.0 asks for jax <= 0.4.31 and penode for jax >= 0.10, so pip refuses to have both; it
runs all the same once it is installed by hand:
``pip install --no-deps jax-sysid==1.1.0 jaxopt==0.8.5``, ``pip install flax joblib cloudpickle``.
"""

import numpy as np

from benchmarks.problem import Problem, clock, paper_problem
from penode.arrays import FloatArray
from penode.data.windows import Windows
from penode.training import plan
from penode.training.covariance import Reported
from penode.training.second_order import LevenbergMarquardt

try:
    from jax_sysid.models import Model
except ImportError as missing:
    raise SystemExit(f"{missing.name} is not installed; see the head of this file.") from None

HORIZON = 50
EVALUATIONS = (30, 300)
TOLERANCE = 1e-8
#: Of R in ohm and of the network's weights, for L-BFGS.
UNITS = (1e-4, 1e-2)


class ReachedLossError(Exception):
    """The loss is low enough."""


def by_jax_sysid(problem: Problem, windows: Windows, evaluations: int) -> tuple[FloatArray, float]:
    """Return the raw parameters that L-BFGS ends with and the seconds it took."""
    count, objective = len(windows), problem.objective
    scale = np.where(objective.layout.members(("physical",)), *UNITS)

    def state_fcn(x, u, params):
        model = objective.layout.model(objective.layout.values(scale * params[0])[:, None])
        drive = u.reshape(-1, count)
        return objective.predictor.step(model, x.reshape(1, 2, count), lambda _: drive)[0].ravel()

    at = np.arange(windows.horizon + 1)[:, None] + windows.starts
    inputs = windows.inputs[at].swapaxes(1, 2).reshape(len(at), -1)
    outputs = windows.states[at].swapaxes(1, 2).reshape(len(at), -1)
    size = outputs.shape[1]
    began = clock()
    model = Model(size, size, inputs.shape[1], state_fcn=state_fcn, y_in_x=True)
    model.init(params=[problem.raw / scale], x0=outputs[0])
    model.loss(
        output_loss=lambda found, wanted: ((found[1:] - wanted[1:]) ** 2).mean(),
        rho_x0=0.0,
        rho_th=0.0,
        train_x0=False,
    )
    model.optimization(adam_epochs=0, lbfgs_epochs=evaluations, iprint=-1, lbfgs_tol=1e-16)
    model.fit(outputs, inputs)
    seconds = clock() - began
    raw = scale * np.asarray(model.params[0])
    found = objective.loss_and_gradient(raw, windows)[0]
    if not abs(found / float(model.Jopt) - 1) < TOLERANCE:
        raise SystemExit(f"the losses differ, {found} and {model.Jopt}; nothing is timed.")
    return raw, seconds


def by_penode(problem: Problem, windows: Windows, wanted: float) -> float:
    """Return the seconds until the loss is as low as wanted; infinite if it never is."""
    objective = problem.objective
    reported = Reported(objective.layout, windows.states[::200])
    moving = np.ones(len(problem.raw), dtype=bool)

    def tell(_: FloatArray, loss: float) -> None:
        if loss <= wanted:
            raise ReachedLossError

    began = clock()
    try:
        LevenbergMarquardt(evaluations=100).minimise(
            plan.Problem(objective, reported, windows, moving), problem.raw, tell
        )
    except ReachedLossError:
        return clock() - began
    return float("inf")


def main() -> None:
    """Print losses, times and ratios."""
    print(f"Time to the same loss, H = {HORIZON}, 57 parameters, 20 000 transitions, cold")
    for evaluations in EVALUATIONS:
        problem = paper_problem()
        windows = problem.windows(HORIZON)
        raw, theirs = by_jax_sysid(problem, windows, evaluations)
        problem = paper_problem()
        ours = by_penode(problem, windows, problem.objective.loss_and_gradient(raw, windows)[0])
        first, last = (
            problem.objective.loss_and_gradient(where, windows)[0] for where in (problem.raw, raw)
        )
        print(
            f"L-BFGS, {evaluations:4d} iterations: loss {first:.3f} -> {last:.3f} A^2, jax-sysid "
            f"{theirs:6.1f} s, penode {ours:6.1f} s: {theirs / ours:.1f}x",
            flush=True,
        )


if __name__ == "__main__":
    main()
