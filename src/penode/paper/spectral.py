"""Selection by a forecast of the bias: lines of the residual, and noise on the windows' starts.

The rung that lines can bias least, at worst, is taken for the truth. Its one-step residual is split
into lines and the rest, the model is simulated with each part as a disturbance, and one
Gauss-Newton step from the truth on that simulated recording gives the bias of the parameters at
every horizon.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, float64
from penode.data.experiment import Experiment
from penode.data.windows import Windows
from penode.horizon.ladder import HorizonFit
from penode.horizon.loss_weighting import linearised, loss_weighting
from penode.horizon.selection import Choice
from penode.models.base import Model
from penode.models.layout import Layout
from penode.models.parameters import with_batch_axis
from penode.predictors.base import Predictor
from penode.predictors.rollout import rollout
from penode.training.covariance import Reported
from penode.training.gauss_newton_terms import residual_scale
from penode.training.loss import DEFAULT_LOSS, Loss
from penode.training.residuals import Objective
from penode.validation.free_run import compare
from penode.validation.residual_lines import find_lines, power_spectrum

#: An expected error within this factor of the least is as good.
_TIE = 1.25
#: Rungs and factor in H that make a plateau, as in `penode.horizon.selection.Plateau`.
_RUNGS, _FACTOR = 3, 4.0


@dataclass(frozen=True, eq=False)
class BiasForecast:
    """Bias of the physical parameters at each horizon, as forecast, beside their chance; SI units.

    Attributes
    ----------
    horizons : tuple of int
    lines : ndarray, shape (horizon, physical)
        Expected shift by the lines of the residual.
    starts : ndarray, shape (horizon, physical)
        Expected shift by noise on the measured states that windows start from, if all of the
        residual between the lines is such noise: errors in variables.
    chance : ndarray, shape (horizon, physical)
        HAC deviation.
    """

    horizons: tuple[int, ...]
    lines: FloatArray
    starts: FloatArray
    chance: FloatArray

    @property
    def expected(self) -> FloatArray:
        """Root of the sum of squares, shape (horizon, physical)."""
        return np.asarray(np.sqrt(self.lines**2 + self.starts**2 + self.chance**2))


@dataclass(frozen=True, eq=False)
class Spectral:
    """The shortest horizon whose expected error, from lines, noise and starts, is as small as any.

    For models whose every state is measured, trained on errors as they are.

    Attributes
    ----------
    experiments : sequence of Experiment
        The recordings trained on.
    seed : int
        Of the noise put on the states.
    loss : Loss
        What the rungs were trained with, such as a plan's; estimated starts follow a disturbance,
        and leave less of it to the parameters.
    """

    experiments: Sequence[Experiment]
    seed: int = 0
    loss: Loss = DEFAULT_LOSS

    def select(self, rungs: Sequence[HorizonFit]) -> Choice:
        """Return the choice among rungs, shortest horizon first."""
        known = [k for k, rung in enumerate(rungs) if _is_known(rung)]
        if not known:
            reason = "No horizon has an estimate to compare."
            return Choice(len(rungs) - 1, "no plateau", reason, tuple(range(len(rungs))))
        if len(known) < len(rungs):
            choice = self.select([rungs[k] for k in known])
            agreeing = tuple(known[k] for k in choice.agreeing)
            return replace(choice, index=known[choice.index], agreeing=agreeing)
        forecast = self.forecast(rungs)
        expected = np.exp(np.mean(np.log(np.maximum(forecast.expected, 1e-300)), axis=1))
        index = int(np.argmax(expected <= _TIE * expected.min()))
        steady = np.abs(forecast.lines) + np.abs(forecast.starts) <= 2 * forecast.chance
        agreeing = tuple(int(k) for k in np.flatnonzero(steady.all(axis=1)))
        chosen = rungs[index].horizon
        span = rungs[agreeing[-1]].horizon / rungs[agreeing[0]].horizon if agreeing else 0.0
        if index not in agreeing or len(agreeing) < _RUNGS or span < _FACTOR:
            reason = (
                f"Lines of the residual or noise on the starts bias the estimate at nearly every "
                f"horizon; at H = {chosen} least."
            )
            return Choice(index, "no plateau", reason, tuple(range(len(rungs))))
        low, high = rungs[agreeing[0]].horizon, rungs[agreeing[-1]].horizon
        reason = (
            f"From H = {low} to {high} neither lines of the residual nor noise on the starts bias "
            f"the estimate by more than chance; H = {chosen} is the shortest whose expected error "
            f"is as small as any."
        )
        return Choice(index, "plateau" if chosen > 1 else "H = 1 suffices", reason, agreeing)

    def forecast(self, rungs: Sequence[HorizonFit]) -> BiasForecast:
        """Return the bias of the physical parameters to expect at each rung, shortest first."""
        physical = len(rungs[0].influence)
        chance = np.stack([rung.working[:physical] for rung in rungs])
        truth = rungs[int(np.argmin(self._worst(rungs)))]
        lines, noise = self._disturbances(truth)
        biases = partial(_Reference.of(truth, self.loss).biases, rungs)
        quiet = _simulated(truth, [np.zeros_like(part) for part in lines])
        both = [biases(quiet + sign * np.concatenate(noise)) for sign in (1, -1)]
        prior = biases(quiet)  # what penalties alone would do
        return BiasForecast(
            horizons=tuple(rung.horizon for rung in rungs),
            lines=biases(_simulated(truth, lines)) - prior,
            starts=np.mean(both, axis=0) - prior,
            chance=chance,
        )

    def _worst(self, rungs: Sequence[HorizonFit]) -> FloatArray:
        """Return the logarithm of what lines can bias at most at each rung, shape (rung,).

        By Cauchy and Schwarz |A^-1 S'r|^2 <= A^-1 r'r, r being the lines' part of the residual.
        """
        longest, horizons = rungs[-1], [rung.horizon for rung in rungs]
        predictor, model, states = longest.predictor, longest.model, longest.windows.states
        error = _Reference.of(longest, self.loss).objective.error
        lines = np.zeros(len(rungs))
        for experiment in self.experiments:
            matrices = linearised(predictor, model, experiment, np.asarray(error.scale))
            seen = compare(predictor, model, experiment)
            view = loss_weighting(seen, matrices, horizons, starts=error.start_stiffness)
            held = sum((view.fractions(line) for line in view.lines), np.zeros(len(rungs)))
            lines += np.nan_to_num(held, nan=1.0)  # not available: as much as all of the loss
        reported = Reported(Layout(model), states[:1])
        worst = []
        for rung, fraction in zip(rungs, lines / len(self.experiments), strict=True):
            terms = rung.solution.terms
            slopes = reported.jacobian(rung.solution.raw)[: len(rung.influence)]
            reach = np.diag(slopes @ terms.inverse @ slopes.T)
            squares = reach * terms.loss * terms.count * fraction
            worst.append(np.log(np.maximum(squares, 1e-300)).mean())
        return np.array(worst)

    def _disturbances(self, truth: HorizonFit) -> tuple[list[FloatArray], list[FloatArray]]:
        """Return the lines (time, state), and noise on the states as large as the rest allows."""
        random, lines, noise = np.random.default_rng(self.seed), [], []
        for experiment in self.experiments:
            seen = compare(truth.predictor, truth.model, experiment)
            residual = seen.measured - seen.one_step
            residual[: truth.predictor.past] = 0.0
            line = _lines(residual, experiment.time_step)
            # The residual of white noise n on the sensors is about n(k) - n(k - 1).
            deviation = (residual - line).std(axis=0) / np.sqrt(2)
            lines.append(line)
            noise.append(deviation * random.standard_normal(residual.shape))
        return lines, noise


def _is_known(rung: HorizonFit) -> bool:
    """Return whether a rung's physical parameters and their deviations are numbers."""
    parts = (rung.values[: len(rung.influence)], rung.working, rung.influence)
    return not any(np.isnan(part).any() for part in parts)


def _lines(residual: FloatArray, time_step: float) -> FloatArray:
    """Return the part of a residual (time, state) that stands out of its spectrum's floor."""
    count = len(residual)
    frequency = np.fft.rfftfreq(count, time_step).astype(np.float64)
    chosen = np.zeros((len(frequency), residual.shape[1]), dtype=bool)
    power = power_spectrum(residual)[: len(frequency)]
    for line in find_lines(frequency, power):
        chosen[:, line.signal] |= (frequency >= line.low) & (frequency <= line.high)
    spectrum = np.fft.rfft(residual, axis=0)
    return np.asarray(np.fft.irfft(np.where(chosen, spectrum, 0.0), count, axis=0))


def _simulated(truth: HorizonFit, disturbances: Sequence[FloatArray]) -> FloatArray:
    """Return the states (time, state) of all recordings, simulated with disturbances."""
    windows, first, parts = truth.windows, 0, []
    for disturbance in disturbances:
        at = slice(first, first + len(disturbance))
        with float64():
            recorded = (windows.states[at].T, windows.inputs[at].T, disturbance.T)
            run = _disturbed(truth.predictor, with_batch_axis(truth.model), *recorded)
        parts.append(np.asarray(run).T)
        first = at.stop
    return np.concatenate(parts)


@partial(jax.jit, static_argnums=0)
def _disturbed(
    predictor: Predictor, model: Model, states: JaxArray, inputs: JaxArray, disturbance: JaxArray
) -> JaxArray:
    """Simulate (state, time) from the first samples, adding a disturbance to each prediction."""
    past = predictor.past

    def at(record: JaxArray, k: JaxArray) -> JaxArray:
        return jax.lax.dynamic_slice_in_dim(record, k, 1, axis=1)

    def step(k: JaxArray, history: JaxArray) -> tuple[JaxArray, None]:
        now = k + past - 1
        ahead = predictor.step(model, history, lambda offset: at(inputs, now + offset))
        return ahead.at[0].add(at(disturbance, k + past)), None

    def visit(k: JaxArray, history: JaxArray, _: None, path: JaxArray) -> JaxArray:
        return jax.lax.dynamic_update_slice_in_dim(path, history[0], k + past, axis=1)

    start = jnp.stack([states[:, past - 1 - j][:, None] for j in range(past)])
    return rollout(step, start, states.shape[1] - past, visit, states)


@dataclass(frozen=True, eq=False)
class _Reference:
    """The objective at the rung taken for the truth."""

    objective: Objective
    raw: FloatArray
    slopes: FloatArray

    @classmethod
    def of(cls, truth: HorizonFit, loss: Loss) -> "_Reference":
        states = truth.windows.states
        scale = residual_scale(truth.model, states, loss)
        objective = Objective(truth.predictor, truth.model, scale, loss)
        raw = objective.layout.raw(truth.model)
        slopes = Reported(objective.layout, states[:1]).jacobian(raw)
        return cls(objective, raw, slopes[: len(objective.layout.physical)])

    def biases(self, rungs: Sequence[HorizonFit], states: FloatArray) -> FloatArray:
        """Return one Gauss-Newton step on simulated states at each rung, (rung, physical)."""
        return np.stack([self._bias(replace(rung.windows, states=states)) for rung in rungs])

    def _bias(self, windows: Windows) -> FloatArray:
        terms = self.objective.gauss_newton(self.raw, windows)
        return np.asarray(self.slopes @ (terms.inverse @ terms.descent))
