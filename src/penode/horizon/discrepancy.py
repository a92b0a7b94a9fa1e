"""Discrepancy: what the model leaves out, as an unknown smooth function, and what it could hide.

A model that misfits has parameters that are none of nature's: they make up for what is missing.
What is missing is taken as a Gaussian process of states, inputs and past inputs in the derivative
(M. C. Kennedy and A. O'Hagan, J. R. Stat. Soc. B 63 (2001) 425, doi:10.1111/1467-9868.00294). Its
amplitudes are what the chosen horizon's residuals make most likely, and zero where they are noise;
what of it is there, one function or many, is averaged over by evidence (J. A. Hoeting et al., Stat.
Sci. 14 (1999) 382, doi:10.1214/ss/1009212519). The parameters stay as they are; their deviations
grow by what the process could stand in for (J. Brynjarsdottir and A. O'Hagan, Inverse Probl. 30
(2014) 114007, doi:10.1088/0266-5611/30/11/114007).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag, cholesky, eigh, solve_triangular
from scipy.signal import lfilter

from penode.arrays import BoolArray, FloatArray, float64, on_device
from penode.data.windows import Windows
from penode.horizon.ladder import HorizonFit, LadderProblem
from penode.models.discrepancy import ACTS, GROUP, Discrepant, spline_basis
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
#: Least weight of a belief that counts.
_COUNTS = 1e-4
#: Deviations of a mean square by which the error grows where something may be left over.
_GROWS = 2.0
#: Lags, one in samples and one in recordings.
_SHORT, _LONG = 3.0, 0.1


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
    terms = beside.problem.gauss_newton(beside.raw, rung.solution.terms)
    if not terms.finite:
        return nothing
    data = Information.of(terms, beside.left_over, ScoreSeries.of_windows(rung.windows))
    others = ~beside.left_over
    inverse = inverse_normal(terms.normal[others][:, others])
    slopes = beside.problem.reported_jacobian(beside.raw)[:physical][:, others]
    follow = slopes @ inverse @ terms.normal[others][:, ~others]
    return _averaged(_beliefs(data, beside.splines), follow)


def _averaged(beliefs: Sequence["_Belief"], follow: FloatArray) -> FloatArray:
    """Return what beliefs add to a covariance, by evidence; zero where nothing is likelier."""
    nothing = np.zeros((len(follow), len(follow)))
    evidence = np.array([belief.evidence for belief in beliefs])
    if evidence.max() <= 0.0:
        return nothing
    weights = np.exp(evidence - evidence.max())
    weights /= weights.sum()
    kept = [(w, one) for w, one in zip(weights, beliefs, strict=True) if w > _COUNTS]
    return np.asarray(sum((w * one.adds(follow) for w, one in kept), nothing))


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
    # How many, one for each derivative and channel.
    splines: int

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
        windows = _with_past(rung.windows, count)
        inputs = windows.inputs[:, : len(ACTS) * count]
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


@dataclass(frozen=True, eq=False)
class _Belief:
    """Which splines are there, and how large they are believed to be."""

    data: Information
    # Amplitudes (spline,), zero of those that are not there.
    size: FloatArray
    # Inverse covariances at amplitude 1, (spline, coefficient, coefficient).
    shape: FloatArray
    # Among how many each choice was made, and how many choices.
    rivals: int
    chosen: int = 0

    @property
    def there(self) -> BoolArray:
        """Which coefficients may differ from zero."""
        return np.repeat(self.size > 0, self.shape.shape[1])

    @property
    def prior(self) -> FloatArray:
        """Inverse covariance of the coefficients that are there."""
        used = self.size > 0
        return np.asarray(block_diag(*(self.shape[used] / self.size[used, None, None] ** 2)))

    @property
    def evidence(self) -> float:
        """Log evidence over that of nothing, less what choosing each spline gains by chance."""
        there, data = self.there, self.data
        if not there.any():
            return 0.0
        own = Information(data.matrix[there][:, there], data.slope[there], data.variance)
        slopes = np.asarray(np.linalg.cholesky(self.prior).T, dtype=float)
        return Rows(slopes, np.zeros(len(slopes))).evidence(own) - float(
            self.chosen * np.log(self.rivals)
        )

    def adds(self, follow: FloatArray) -> FloatArray:
        """Return what it adds to the covariance of what follows the coefficients, (..., all)."""
        there, data = self.there, self.data
        covariance = np.linalg.inv(data.matrix[there][:, there] + self.prior)
        follow = follow[:, there]
        shift = follow @ covariance @ data.slope[there]
        return np.asarray(follow @ covariance @ follow.T + np.outer(shift, shift))

    def with_one(
        self, splines: Sequence[int], shapes: Sequence[FloatArray]
    ) -> list[tuple[float, "_Belief"]]:
        """Return what each spline that is not there yet adds to the evidence, and with it."""
        matrix, slope, there = self.data.matrix, self.data.slope, self.there
        known = beyond_rounding(matrix[there][:, there] + self.prior)
        root = cholesky(known, lower=True)
        follow = solve_triangular(root, matrix[there], lower=True)
        slope = slope - follow.T @ solve_triangular(root, slope[there], lower=True)
        found = []
        for k in splines:
            block = slice(k * len(shapes[0]), (k + 1) * len(shapes[0]))
            own = matrix[block, block] - follow[:, block].T @ follow[:, block]
            for shape in shapes:
                likely = _evidence(own, slope[block], shape)
                best = int(np.argmax(likely))
                size, forms = self.size.copy(), self.shape.copy()
                size[k], forms[k] = _AMPLITUDES[best] if best else 0.0, shape
                gain = float(likely[best] - likely[0])
                found.append((gain, replace(self, size=size, shape=forms, chosen=self.chosen + 1)))
        return found


def _beliefs(data: Information, count: int) -> list[_Belief]:
    """Return what may be left out: nothing, all splines alike, some one by one, or any one."""
    shapes = [white.T @ white for white in map(_white, _LENGTHS)]
    rivals = count * len(shapes)
    nothing = _Belief(data, np.zeros(count), np.stack([shapes[0]] * count), rivals)
    single = [one for _, one in nothing.with_one(range(count), shapes)]
    together = [_alike(nothing, shape) for shape in shapes]
    something = [*together, _one_by_one(nothing, shapes), *single]
    return [nothing, *(one for one in something if one.there.any())]


def _alike(nothing: _Belief, shape: FloatArray) -> _Belief:
    """Return all splines, as large as each other."""
    data, count = nothing.data, len(nothing.size)
    likely = _evidence(data.matrix, data.slope, block_diag(*[shape] * count))
    best = int(np.argmax(likely))
    size = np.full(count, _AMPLITUDES[best] if best else 0.0)
    return replace(nothing, size=size, shape=np.stack([shape] * count), chosen=1)


def _one_by_one(found: _Belief, shapes: Sequence[FloatArray]) -> _Belief:
    """Return splines that enter one by one, as long as the best adds more than it costs."""
    while free := np.flatnonzero(found.size == 0).tolist():
        gain, better = max(found.with_one(free, shapes), key=lambda one: one[0])
        if gain <= np.log(found.rivals):
            break
        found = better
    return found


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


def _many_windows(rung: HorizonFit) -> bool:
    return ScoreSeries.of_windows(rung.windows).long_enough


def _with_past(windows: Windows, count: int) -> Windows:
    """Return windows that have `ACTS` of each input in its place.

    Lags are of three samples and of a tenth of a recording, and begin settled. A hold may have
    prepared inputs between samples too, `count` by `count` beside those at them.
    """
    inputs = windows.inputs.reshape(len(windows.inputs), -1, max(count, 1))
    begins = [0] if windows.begins is None else windows.begins
    long = max(_LONG * len(inputs) / len(begins), _SHORT)
    parts = []
    for own in np.split(inputs, begins[1:]):
        changes = np.diff(own, axis=0, prepend=own[:1])
        kept = np.exp(-1 / np.array([_SHORT, long]))
        lags = (lfilter([1 - a], [1, -a], own, axis=0, zi=a * own[:1])[0] for a in kept)
        parts.append(np.concatenate([own, changes, *lags], axis=2))
    together = np.concatenate(parts)
    return replace(windows, inputs=together.reshape(len(together), -1))


_UNIT = np.zeros(1), np.ones(1)


def _white(length: float) -> FloatArray:
    place = np.linspace(0.0, 1.0, _POINTS)
    with float64():
        basis = np.asarray(spline_basis(on_device(place[None]), *_UNIT, _CELLS))[0].T
    return process_rows(place[:, None], length, basis[None])[0]
