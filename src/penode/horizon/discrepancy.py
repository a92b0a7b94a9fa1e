"""Discrepancy: what the model leaves out, as an unknown smooth function, and what it could hide.

A model that misfits has parameters that are none of nature's: they make up for what is missing.
What is missing is taken as a Gaussian process of states and inputs in the derivative (M. C. Kennedy
and A. O'Hagan, J. R. Stat. Soc. B 63 (2001) 425, doi:10.1111/1467-9868.00294). Its amplitudes are
what the chosen horizon's residuals make most likely, and zero where they are noise. The parameters
stay as they are; their deviations grow by what the process could stand in for (J. Brynjarsdottir
and A. O'Hagan, Inverse Probl. 30 (2014) 114007, doi:10.1088/0266-5611/30/11/114007).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve, eigh

from penode.arrays import BoolArray, FloatArray, float64, on_device
from penode.data.windows import Windows
from penode.horizon.ladder import HorizonFit, LadderProblem
from penode.models.discrepancy import GROUP, Discrepant, spline_basis
from penode.models.explicit_time import driving_channels
from penode.training.covariance import ScoreSeries
from penode.training.evidence import Information, Rows, beyond_rounding, process_rows
from penode.training.gauss_newton_terms import MOST_PARAMETERS, inverse_normal
from penode.training.learned_effect import LearnedEffect, Visits
from penode.training.plan import Plan, Problem, Stage
from penode.training.residuals import Objective

#: Cells of each spline, and points at which it is believed to be a Gaussian process.
_CELLS, _POINTS = 6, 19
#: Amplitudes in deviations of the derivative, the first as good as zero; lengths in ranges.
_AMPLITUDES, _LENGTHS = 10.0 ** np.array([-6.0, *np.arange(-3.0, 0.6, 0.25)]), (0.25, 1.0)
#: Log evidence from which something is left over.
_DECISIVE = 3.0
#: Deviations of a mean square by which the error grows where something may be left over.
_GROWS = 2.0
#: Rounds in which the amplitude of each spline is sought.
_ROUNDS = 2


def what_is_left_out(
    problem: LadderProblem, plan: Plan, rungs: Sequence[HorizonFit], chosen: int
) -> FloatArray | None:
    """Return what a discrepancy adds to the physical parameters' covariance, SI units.

    Shape (physical, physical). It is looked for at the last rung up to the chosen one whose windows
    are enough to show how their residuals vary; None where many states and inputs would make it
    larger than a normal matrix can be.
    """
    physical = len(problem.objective.layout.physical)
    nothing = np.zeros((physical, physical))
    if len(rungs) > 1 and not _error_grows(problem, rungs):
        return nothing
    rungs = rungs[: chosen + 1]
    enough = [k for k, rung in enumerate(rungs) if _many_windows(rung)]
    if not enough:
        return nothing
    rung, stage = rungs[enough[-1]], plan.stages[enough[-1]]
    beside = _Beside.of(problem, rung, stage)
    if beside is None:
        return nothing
    if len(beside.raw) > MOST_PARAMETERS:
        return None
    terms = beside.problem.gauss_newton(beside.raw)
    if not terms.finite:
        return nothing
    data = Information.of(terms, beside.left_over, ScoreSeries.of_windows(rung.windows))
    rows = beside.most_likely(data)
    if rows is None:
        return nothing
    covariance = np.linalg.inv(data.matrix + rows.slopes.T @ rows.slopes)
    others = ~beside.left_over
    inverse = inverse_normal(terms.normal[others][:, others])
    slopes = beside.problem.reported_jacobian(beside.raw)[:physical][:, others]
    follow = slopes @ inverse @ terms.normal[others][:, ~others]
    shift = follow @ covariance @ data.slope
    return np.asarray(follow @ covariance @ follow.T + np.outer(shift, shift))


def _error_grows(problem: LadderProblem, rungs: Sequence[HorizonFit]) -> bool:
    """Return whether the error grows with the horizon by more than chance.

    White noise of the sensors is all that a right model leaves, as large at every horizon: of the
    values in a window those are spent that its start takes. Of sensors that are not alike it may
    take the noisiest, so a short window's error may be less by that part. The longest windows show
    it: shorter ones err no more, unless training fell short there.
    """
    error = problem.objective.error
    windows = [rung.windows.steps * len(error.compared) for rung in rungs]
    predicted = np.array([values.mean() for values in windows])
    left = np.array([np.maximum(values - error.spent, 0).mean() for values in windows])
    kept = left > 0
    losses = np.array([rung.solution.terms.loss for rung in rungs])
    variance = (losses * predicted)[kept] / left[kept]
    floor = variance * (1 + len(error.free) / left[kept])
    values = len(rungs[0].windows.states) * len(error.compared)
    return bool(variance[-1] > (1 + _GROWS * np.sqrt(2 / values)) * floor.min())


@dataclass(frozen=True, eq=False)
class _Beside:
    """A rung's problem with something left over; `raw` is the rung's, with nothing left over."""

    problem: Problem
    raw: FloatArray
    left_over: BoolArray
    # How many splines, one for each derivative and channel.
    blocks: int

    @classmethod
    def of(cls, problem: LadderProblem, rung: HorizonFit, stage: Stage) -> "_Beside | None":
        objective = rung.objective or problem.objective
        raw, layout = rung.solution.raw, objective.layout
        visits = Visits.of(objective.error, raw, rung.windows)
        effect = LearnedEffect.of(layout, raw, visits)
        rates = np.flatnonzero(np.abs(effect.by_values(visits)).max(axis=(1, 2)) > 0)
        if not (len(rates) and np.isfinite(effect.scale).all()):
            return None
        count = len(driving_channels(rung.model))
        windows = _with_changes(rung.windows, count)
        inputs = windows.inputs[:, : 2 * count]
        low = np.concatenate([visits.states.min(axis=0), inputs.min(axis=0)])
        high = np.concatenate([visits.states.max(axis=0), inputs.max(axis=0)])
        high = np.where(high > low, high, low + 1.0)
        shape = (len(rates), len(low), _CELLS + 3)
        scale = effect.scale[rates]
        with float64():
            model = Discrepant(rung.model, tuple(rates.tolist()), np.zeros(shape), scale, low, high)
        wide = Objective(
            objective.predictor, model, objective.scale, objective.loss, layout.experiments
        )
        extended = np.concatenate([raw, np.zeros(np.prod(shape)), scale, low, high])
        left_over = wide.layout.members((GROUP,))
        moving = left_over.copy()
        moving[: len(raw)] = layout.members(stage.groups)
        reported = problem.reported.of_layout(wide.layout)
        return cls(
            Problem(wide, reported, windows, moving),
            extended,
            left_over[moving],
            shape[0] * shape[1],
        )

    def most_likely(self, data: Information) -> Rows | None:
        """Return the belief that makes the residuals most likely; None if that is nothing."""

        def alike(length: float) -> tuple[float, float, FloatArray]:
            white = _white(length)
            together = block_diag(*[white.T @ white] * self.blocks)
            likely = _evidence(data.matrix, data.slope, together)
            return likely.max(), float(_AMPLITUDES[np.argmax(likely)]), white

        _, amplitude, white = max(map(alike, _LENGTHS), key=lambda one: one[0])
        found, own = np.full(self.blocks, amplitude), white.T @ white
        for k in list(range(self.blocks)) * _ROUNDS:
            block = np.repeat(np.arange(self.blocks) == k, len(own))
            beside = block_diag(*(own / a**2 for a in found))[~block][:, ~block]
            found[k] = _AMPLITUDES[np.argmax(_evidence(*_marginal(data, block, beside), own))]
        slopes = block_diag(*(white / a for a in found))
        best = Rows(slopes, np.zeros(len(slopes)))
        return best if best.evidence(data) > _DECISIVE else None


def _evidence(matrix: FloatArray, slope: FloatArray, prior: FloatArray) -> FloatArray:
    """Return the log evidence of each amplitude, up to a constant, of a Gaussian's parameters.

    Their information is `matrix`, the slope of their log likelihood `slope`, and `prior` the
    inverse covariance of amplitude 1.
    """
    known, directions = eigh(matrix, prior)
    known, along = np.maximum(known, 0.0)[:, None], (directions.T @ slope)[:, None]
    squares = _AMPLITUDES**2
    fitted = along**2 * squares / (1 + known * squares) - np.log1p(known * squares)
    return np.asarray(0.5 * fitted.sum(axis=0))


def _marginal(
    data: Information, block: BoolArray, beside: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return information and slope of a block, all others estimated with their prior."""
    matrix, others = data.matrix, ~block
    factor = cho_factor(beyond_rounding(matrix[others][:, others] + beside), lower=True)
    follow = cho_solve(factor, matrix[others][:, block]).T
    return (
        matrix[block][:, block] - follow @ matrix[others][:, block],
        data.slope[block] - follow @ data.slope[others],
    )


def _many_windows(rung: HorizonFit) -> bool:
    return ScoreSeries.of_windows(rung.windows).long_enough


def _with_changes(windows: Windows, count: int) -> Windows:
    """Return windows that have what each input changed by in a sample as a further one.

    A hold may have prepared inputs between samples too, `count` by `count` beside those at them.
    """
    inputs = windows.inputs.reshape(len(windows.inputs), -1, max(count, 1))
    changes = np.diff(inputs, axis=0, prepend=inputs[:1])
    both = np.concatenate([inputs, changes], axis=2)
    return replace(windows, inputs=both.reshape(len(both), -1))


_UNIT = np.zeros(1), np.ones(1)


def _white(length: float) -> FloatArray:
    place = np.linspace(0.0, 1.0, _POINTS)
    with float64():
        basis = np.asarray(spline_basis(on_device(place[None]), *_UNIT, _CELLS))[0].T
    return process_rows(place[:, None], length, basis[None])[0]
