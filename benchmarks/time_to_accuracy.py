"""Time to an answer: penode's default against the paper's training in torchdiffeq.

``taskset -c 0 python -m benchmarks.time_to_accuracy`` where benchmarks/requirements.txt is
installed. The paper's training (`penode.paper.conventional.trained_methods`: Adam, horizon grown to
100, 20 mini-batches) takes hours in torchdiffeq, so its time is extrapolated: penode runs the
recipe whole; torchdiffeq runs the first epochs at each horizon from where penode stood then, must
give the same losses, and is timed; its time is the sum over horizons of epochs times seconds an
epoch.

The error is the root mean square over 1 to 100 steps ahead: on a recording that nobody trained on,
at another speed and along another trajectory, for the default; on the training recording where
Levenberg-Marquardt trains the recipe's own network, from the best of three starts: from one it may
end in a poor minimum, which Adam's noise leaves. penode's times are cold, with compilation.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from benchmarks.problem import Problem, clock, paper_recording, problem_of, verdict
from benchmarks.torch_problem import closed_form, cramer, derivative_of, leaves_of, loss_of
from penode.arrays import FloatArray, float64
from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.experiment import Experiment
from penode.data.windows import Windows
from penode.fit.fit import Fit
from penode.horizon.ladder import ladder_plan
from penode.horizon.selection import Longest
from penode.identify import identify as identify_model
from penode.models.layout import Layout
from penode.paper.conventional.trained_methods import PaperRecipe
from penode.pmsm.balance.start import nominal_start
from penode.pmsm.machine.model import Machine
from penode.pmsm.study import identify
from penode.pmsm.study_settings import Study
from penode.predictors.one_step import RungeKutta
from penode.predictors.tableaus import RK4_38
from penode.training import plan
from penode.training.covariance import Reported
from penode.training.first_order import FirstOrder
from penode.training.multi_start import BestOf

HORIZON = 100
EPOCHS_TIMED = 2
#: Largest relative difference of the losses of penode's and torchdiffeq's epochs.
TOLERANCE = 1e-6
GOAL = 100
#: Ladder of Levenberg-Marquardt on the recipe's network.
LADDER = (1, 5, 18, 50, HORIZON)


@dataclass(frozen=True, eq=False)
class Training:
    """One horizon of the recipe as penode ran it: where it began and what each epoch gave."""

    horizon: int
    start: FloatArray
    losses: list[float]
    raws: list[FloatArray]


def errors_on(run: Experiment, machine: Machine, raws: Sequence[FloatArray]) -> list[float]:
    """Return the RMSE in A, 1 to 100 steps ahead, on a recording, at each raw vector."""
    problem = problem_of(run, machine)
    windows = problem.windows(HORIZON)
    losses = [problem.objective.loss_and_gradient(raw, windows)[0] for raw in raws]
    return np.sqrt(losses).tolist()


def machine_at(problem: Problem, raw: FloatArray) -> Machine:
    """Return the machine of a raw vector."""
    with float64():
        return problem.objective.layout.plain_model(raw)


def by_penode(problem: Problem, recipe: PaperRecipe) -> list[Training]:
    """Run the recipe whole."""
    objective, raw, done = problem.objective, problem.raw, []
    reported = Reported(objective.layout, problem.windows(1).states[::200])
    for stage in recipe.plan.stages:
        part = Training(stage.horizon, raw, [], [])
        moving = np.ones(len(raw), dtype=bool)
        made = plan.Problem(objective, reported, problem.windows(stage.horizon), moving)

        def tell(raw: FloatArray, loss: float, part: Training = part) -> None:
            part.losses.append(loss)
            part.raws.append(raw)

        raw = stage.optimiser.minimise(made, raw, tell).raw
        done.append(part)
    return done


def by_torchdiffeq(
    problem: Problem, windows: Windows, start: FloatArray, optimiser: FirstOrder
) -> tuple[list[float], float]:
    """Return the losses of the first epochs and the seconds an epoch."""
    there = problem_of(problem.run, machine_at(problem, start))
    leaves, scale = leaves_of(there), optimiser.physical_scale
    moved = [*leaves[:-1], (leaves[-1].detach() / scale).requires_grad_()]
    loss_at = loss_of(windows, derivative_of(problem, closed_form, cramer))
    adam = torch.optim.Adam(moved, lr=PaperRecipe.rate)
    random, losses = np.random.default_rng(optimiser.seed), []
    began = clock()
    for _ in range(EPOCHS_TIMED):
        order = random.permutation(len(windows))
        for part in np.array_split(order, min(optimiser.batches, len(windows))):
            adam.zero_grad()
            loss = loss_at([*moved[:-1], scale * moved[-1]], np.sort(part))
            loss.backward()
            adam.step()
        losses.append(loss.item())
    return losses, (clock() - began) / EPOCHS_TIMED


def epoch_times(problem: Problem, recipe: PaperRecipe, done: list[Training]) -> list[float]:
    """Return torchdiffeq's seconds an epoch at each horizon, or refuse if it trains otherwise."""
    seconds = []
    for stage, part in zip(recipe.plan.stages, done, strict=True):
        windows = problem.windows(part.horizon)
        losses, each = by_torchdiffeq(problem, windows, part.start, stage.optimiser)
        error = np.abs(np.array(losses) / part.losses[: len(losses)] - 1).max()
        if not error < TOLERANCE:
            raise SystemExit(f"H = {part.horizon}: losses differ by {error:.1e}; nothing is timed.")
        print(
            f"H = {part.horizon:3d}: {len(part.losses):3d} epochs of {each:6.2f} s in torchdiffeq, "
            f"timed over {len(losses)}; their losses agree to {error:.0e}",
            flush=True,
        )
        seconds.append(each)
    return seconds


def first_epoch(errors: list[float], wanted: float) -> int | None:
    """Return how many epochs bring the error down to what is wanted, None if all do not."""
    good = [epoch for epoch, error in enumerate(errors, start=1) if error <= wanted]
    return good[0] if good else None


def by_default(run: Experiment) -> Fit:
    """Return what a user gets with a map of the currents alone, as the recipe's is."""
    return identify([run], study=Study(candidates=(), angle_orders=()))


def by_second_order(run: Experiment) -> Fit:
    """Return the recipe's network trained by Levenberg-Marquardt, the best of three starts."""
    start, *others = (nominal_start([run], PaperRecipe.seed + k) for k in range(3))
    climb = ladder_plan(LADDER)
    first, *later = climb.stages
    several = replace(first, optimiser=BestOf(first.optimiser, tuple(others)))
    whole = replace(climb, stages=(several, *later))
    return identify_model(start, [run], plan=whole, purpose=Longest())


def print_machine(name: str, seconds: float, machine: Machine, runs: Sequence[Experiment]) -> None:
    """Print the time, the errors in A and the resistance."""
    raw = Layout(machine).raw(machine)
    training, unseen = (errors_on(run, machine, [raw])[0] for run in runs)
    truth = TRACTION_300A.resistance
    print(
        f"{name:>34}: {seconds:6.1f} s, error {training:6.3f} A in training, {unseen:6.3f} A "
        f"unseen, R {1e3 * float(machine.R):6.2f} of {1e3 * truth:g} mohm",
        flush=True,
    )


def compare(
    name: str, seconds: float, wanted: float, errors: list[float], epochs: FloatArray
) -> None:
    """Print when the paper's training is as good, and how long torchdiffeq takes until then."""
    count = first_epoch(errors, wanted)
    theirs = float(epochs[:count].sum())
    story = f"reaches it in epoch {count}," if count else "never does; all its epochs: at least"
    print(
        f"{name}, error {wanted:.3f} A in {seconds:.1f} s: the paper's training {story} "
        f"{theirs:.0f} s (extrapolated), {theirs / seconds:.0f}x, "
        f"goal {GOAL}x {verdict(theirs / seconds >= GOAL)}"
    )


def timed(call: Callable[[Experiment], Fit], run: Experiment) -> tuple[float, Machine]:
    """Return seconds and the machine found."""
    began = clock()
    fit = call(run)
    return clock() - began, fit.model


def main() -> None:
    """Print times and errors of both sides, and the ratios."""
    torch.set_num_threads(1)
    run = paper_recording()
    unseen = simulate(TRACTION_300A, Lissajous(200.0, 40.0, 33.0), speed_rpm=900.0, duration=0.5)
    default, second = timed(by_default, run), timed(by_second_order, run)
    print_machine("default", *default, (run, unseen))
    print_machine("recipe's network, second order", *second, (run, unseen))
    recipe = PaperRecipe(HORIZON)
    problem = problem_of(run, nominal_start([run], recipe.seed), RungeKutta(RK4_38))
    began = clock()
    done = by_penode(problem, recipe)
    own, raws = clock() - began, [raw for part in done for raw in part.raws]
    print_machine(
        "paper's training, run by penode", own, machine_at(problem, raws[-1]), (run, unseen)
    )
    each = epoch_times(problem, recipe, done)
    epochs = np.concatenate([[s] * len(p.losses) for s, p in zip(each, done, strict=True)])
    print(f"whole recipe in torchdiffeq, EXTRAPOLATED from these epochs: {epochs.sum():.0f} s")
    for name, (seconds, machine), measured in (
        ("default, unseen recording", default, unseen),
        ("recipe's network by second order, training recording", second, run),
    ):
        wanted = errors_on(measured, machine, [Layout(machine).raw(machine)])[0]
        compare(name, seconds, wanted, errors_on(measured, problem.machine, raws), epochs)


if __name__ == "__main__":
    main()
