"""Selection by prediction: the horizon whose errors are least."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray, float64, on_device
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.horizon.ladder import HorizonFit
from penode.horizon.selection import Choice, Plateau, Selector
from penode.models.base import Model
from penode.models.explicit_time import driving_channels
from penode.models.measured import free_states, hidden_states
from penode.models.parameters import with_batch_axis
from penode.validation.free_run import compare
from penode.validation.look_ahead import look_ahead

#: The look-ahead of a simulation of the whole recording.
FREE_RUN = 0
#: Logarithm of the factor within which errors are equal, and the least mean square.
_EQUAL, _LEAST = 1e-6, 1e-300
#: Stretches of time by which chance is judged where there is a single recording.
_STRETCHES = 8


@dataclass(frozen=True, eq=False)
class HeldOut:
    """The horizon that predicts best, the shorter of two that are equal.

    A rung's error is the geometric mean, over states, look-aheads and recordings, of root mean
    squares. No tolerance: a shorter horizon is no simpler model, and where noise is most of an
    error, 1 % of it hides an error of the model of 14 % of that noise. The rungs that agree with
    the choice are those whose error is not above it by more than one standard error over the
    regimes: the recordings, or eight stretches of a single one. Never random samples, which would
    be predicted by their neighbours.

    Attributes
    ----------
    experiments : sequence of Experiment
        Predicted; with recordings not used for training this measures what generalises.
    look_aheads : tuple of int
        Steps; `FREE_RUN` simulates the whole recording from its first sample.
    """

    experiments: Sequence[Experiment]
    look_aheads: tuple[int, ...] = (1, 10, 100)

    def select(self, rungs: Sequence[HorizonFit]) -> Choice:
        """Return the choice among rungs, shortest horizon first."""
        errors = [self.squared_errors(rung) for rung in rungs]
        mean = np.array([_logarithms(each).mean() for each in errors])
        if not np.isfinite(mean).any():
            reason = "Every horizon's prediction diverges somewhere; check the model's map."
            return Choice(len(rungs) - 1, "no plateau", reason, tuple(range(len(rungs))))
        best = shortest_of_least(mean)
        excess, chance = excess_errors(errors, best)
        with np.errstate(invalid="ignore"):  # a rung that diverges has no deviation
            within = (excess <= chance) | (mean == mean[best])
        agreeing = tuple(int(k) for k in np.flatnonzero(within))
        what = " and ".join(_named(steps) for steps in self.look_aheads)
        others = [str(rungs[k].horizon) for k in agreeing if k != best]
        errs = "errs" if len(others) == 1 else "err"
        beside = f"; H = {', '.join(others)} {errs} more by no more than chance" if others else ""
        reason = f"H = {rungs[best].horizon} has the least error in {what}{beside}."
        return Choice(best, "predicts best", reason, agreeing)

    def squared_errors(self, rung: HorizonFit) -> list[FloatArray]:
        """Return each recording's squared errors of a rung, (look-ahead, time, state)."""
        return [
            np.stack([self._squares(rung, experiment, steps) for steps in self.look_aheads])
            for experiment in self.experiments
        ]

    def _squares(self, rung: HorizonFit, experiment: Experiment, steps: int) -> FloatArray:
        """Return the squared errors of each sample, (time, state)."""
        model, predictor = rung.model, rung.predictor.at(experiment.time_step)
        if steps == FREE_RUN or free_states(model):
            seen = compare(predictor, model, experiment)
            measured = seen.measured[predictor.past :]
            ahead = (seen.one_step if steps == 1 else seen.free_run)[predictor.past :]
        else:
            with float64():
                batched = with_batch_axis(model)
                states, inputs = (
                    on_device(experiment.stack(names).T)
                    for names in (model.states, driving_channels(model))
                )
                states = batched.corrected(states)
                predicted = look_ahead(predictor, batched, states, inputs, steps)
                measured, ahead = np.asarray(states).T[predictor.past :], np.asarray(predicted).T
        with np.errstate(invalid="ignore", over="ignore"):
            return np.asarray((measured - ahead) ** 2)


def shortest_of_least(logarithms: FloatArray) -> int:
    """Return the index of the first of the least logarithms of errors (rung,)."""
    return int(np.argmax(logarithms <= logarithms.min() + _EQUAL))


def excess_errors(errors: Sequence[list[FloatArray]], best: int) -> tuple[FloatArray, FloatArray]:
    """Return the logarithm of the factor by which each errs more than the best, and its deviation.

    Both are of the mean over regimes, (candidate,); errors are squared, one array (look-ahead,
    time, state) for each recording.
    """
    regimes = np.stack([_logarithms(_in_regimes(each)) for each in errors])
    excess = regimes - regimes[best]
    with np.errstate(invalid="ignore"):  # what diverges has no deviation
        deviation = excess.std(axis=1, ddof=1) / np.sqrt(regimes.shape[1])
        return np.asarray(excess.mean(axis=1)), np.asarray(deviation)


def _in_regimes(each: list[FloatArray]) -> list[FloatArray]:
    """Return squared errors in regimes: the recordings, or stretches of a single one."""
    return each if len(each) > 1 else np.array_split(each[0], _STRETCHES, axis=1)


def _logarithms(each: list[FloatArray]) -> FloatArray:
    """Return the mean logarithm of root mean squares, (regime,), of (look-ahead, time, state)."""
    with np.errstate(over="ignore"):
        logs = [0.5 * np.log(np.maximum(squares.mean(axis=1), _LEAST)).mean() for squares in each]
    return np.asarray(np.nan_to_num(logs, nan=np.inf, posinf=np.inf))


def _named(steps: int) -> str:
    if steps == FREE_RUN:
        return "free run"
    return "one step" if steps == 1 else f"{steps} steps"


#: Look-aheads that count for a purpose other than the physical parameters.
_LOOK_AHEADS = {"simulation": (FREE_RUN,), "one_step": (1,)}
#: What a horizon may be chosen for (paper, section 3.1).
PURPOSES = ("parameters", *_LOOK_AHEADS)


def selector_for(purpose: str | Selector, experiments: Sequence[Experiment]) -> Selector:
    """Return the rule that picks the horizon for one of `PURPOSES`, or the rule given."""
    if not isinstance(purpose, str):
        return purpose
    if purpose not in PURPOSES:
        raise InputError(f"purpose must be one of {', '.join(PURPOSES)}, got {purpose!r}.")
    if purpose == "parameters":
        return Plateau()
    return HeldOut(experiments, _LOOK_AHEADS[purpose])


def require_single_steps(
    purpose: str | Selector, model: Model, experiments: Sequence[Experiment]
) -> None:
    """Refuse to choose by single steps, which begin at states, where these are not recorded."""
    hidden = [n for n in hidden_states(model) if any(n not in e.channels for e in experiments)]
    if purpose == "one_step" and hidden:
        raise InputError(
            "purpose must be 'parameters' or 'simulation' where states are not measured, got "
            f"'one_step'; a single step is predicted from {', '.join(hidden)} too."
        )
