"""One recording beside its predictions, and the errors between them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from penode.arrays import FloatArray
from penode.errors import require_extra
from penode.validation.metrics import NORMAL_95, rmse

if TYPE_CHECKING:
    import polars as pl

#: No residual is larger where it is squared: over a typical one too, the sum is still a number.
HUGE = 1e60
#: Error over the largest value measured in its unit from which a free run has diverged.
_DIVERGED = 1e3


@dataclass(frozen=True, eq=False)
class Comparison:
    """One recording beside its predictions.

    Attributes
    ----------
    name : str
        The recording.
    role : str
        ``"train"`` or ``"validation"``.
    time_step : float
        Sampling interval in s; row k of the arrays is at time k * time_step.
    states, units : tuple of str
        Names and SI units of the columns: the states that are measured, or the model's outputs.
    measured, one_step, free_run : ndarray, shape (time, state)
        What was measured, less the sensor errors the model knows; prediction of each sample from
        the measured one before it (nan where a state is neither measured nor guessed); prediction
        of the whole recording from its first sample alone, or from the start that fits it best
        where states are not measured (not finite after a divergence).
    recording : str
        The recording that it is a stretch of; itself where empty.
    start : ndarray, shape (state,)
        The state that the free run starts from, SI units; None where it was not kept.
    """

    name: str
    role: str
    time_step: float
    states: tuple[str, ...]
    units: tuple[str, ...]
    measured: FloatArray
    one_step: FloatArray
    free_run: FloatArray
    recording: str = ""
    start: FloatArray | None = None

    def to_frame(self) -> "pl.DataFrame":
        """Return a row a sample: time (s); STATE, STATE_one_step and STATE_free_run, SI units."""
        require_extra("polars", "tables", "a table")
        import polars as pl

        columns = {"time": self.time_step * np.arange(len(self.measured))}
        for k, name in enumerate(self.states):
            columns[name] = self.measured[:, k]
            columns[f"{name}_one_step"] = self.one_step[:, k]
            columns[f"{name}_free_run"] = self.free_run[:, k]
        return pl.DataFrame(columns)

    @property
    def one_step_errors(self) -> dict[str, float]:
        """Root mean squared one-step error of each state, in its unit."""
        return self._errors(self.one_step)

    @property
    def free_run_errors(self) -> dict[str, float]:
        """Root mean squared free-run error of each state, in its unit; infinite if it diverged."""
        largest, errors = np.abs(self.measured).max(axis=0), self._errors(self.free_run)
        limits = {
            unit: _DIVERGED
            * max(size for size, own in zip(largest, self.units, strict=True) if own == unit)
            for unit in self.units
        }
        units = zip(errors.items(), self.units, strict=True)
        return {name: np.inf if e > limits[unit] > 0 else e for (name, e), unit in units}

    @property
    def one_step_residual(self) -> FloatArray:
        """Measured less predicted one step ahead, (time - 1, state), from the second sample on."""
        return np.asarray((self.measured - self.one_step)[1:])

    @property
    def unit(self) -> str | None:
        """The unit that all states share; None where they differ."""
        return self.units[0] if len(set(self.units)) == 1 else None

    @property
    def one_step_rmse(self) -> float:
        """Root mean squared one-step error over all states; nan where their units differ."""
        return self._pooled(self.one_step)

    @property
    def free_run_rmse(self) -> float:
        """The same of the free run; infinite if it diverged."""
        return np.inf if self.unit and self.diverged else self._pooled(self.free_run)

    @property
    def diverged(self) -> bool:
        """Whether the free run errs by a thousand times what was measured, or has no numbers."""
        return not np.isfinite(list(self.free_run_errors.values())).all()

    def metrics(self) -> dict[str, Any]:
        """Return the errors of each state, and together where the states share a unit."""
        one_step, free_run = self.one_step_errors, self.free_run_errors
        each = {
            name: {"unit": unit, "one_step_rmse": one_step[name], "free_run_rmse": free_run[name]}
            for name, unit in zip(self.states, self.units, strict=True)
        }
        if self.unit is None:
            return {"states": each}
        return {
            f"one_step_rmse_{self.unit}": self.one_step_rmse,
            f"free_run_rmse_{self.unit}": self.free_run_rmse,
            "states": each,
        }

    def _errors(self, predicted: FloatArray) -> dict[str, float]:
        pairs = zip(self.states, self.measured[1:].T, predicted[1:].T, strict=True)
        return {name: rmse(column, other) for name, column, other in pairs}

    def _pooled(self, predicted: FloatArray) -> float:
        return rmse(self.measured[1:], predicted[1:]) if self.unit is not None else np.nan


@dataclass(frozen=True, eq=False)
class StationaryComparison:
    """Points at which nothing changes, beside what the model says of them.

    Attributes
    ----------
    name : str
        Of the table.
    quantities, units : tuple of str
        Names and SI units of the columns.
    states : ndarray, shape (point, state)
        Where the points are, SI units.
    measured, fitted, without : ndarray, shape (point, quantity)
        Measured; said by the model; said by a model fitted without the point.
    deviation : ndarray, shape (point, quantity)
        Of the difference between the measured one and that without the point.
    distance : float
        Of all points together from the model without any, in standard deviations (rms) of that
        difference; nan where it is not known.
    """

    name: str
    quantities: tuple[str, ...]
    units: tuple[str, ...]
    states: FloatArray
    measured: FloatArray
    fitted: FloatArray
    without: FloatArray
    deviation: FloatArray
    distance: float = float("nan")

    @property
    def covered(self) -> dict[str, float]:
        """Share of points that lie within the 95 % band of the model without them."""
        gap = np.abs(self.measured - self.without) <= NORMAL_95 * self.deviation
        return dict(zip(self.quantities, gap.mean(axis=0).tolist(), strict=True))

    def metrics(self) -> dict[str, Any]:
        """Return of each quantity the errors, fitted and without the point, and the share."""
        rows = zip(self.quantities, self.units, strict=True)
        return {
            name: {
                "unit": unit,
                "rmse": rmse(self.measured[:, k], self.fitted[:, k]),
                "rmse_without": rmse(self.measured[:, k], self.without[:, k]),
                "within_95": self.covered[name],
            }
            for k, (name, unit) in enumerate(rows)
        }


def finite_residual(comparison: Comparison) -> FloatArray:
    """Return one-step residuals, (time - 1, state), a diverged prediction as a huge one."""
    residual = np.nan_to_num(comparison.one_step_residual, posinf=HUGE, neginf=-HUGE)
    return np.asarray(np.clip(residual, -HUGE, HUGE))


def by_recording(comparisons: Sequence[Comparison]) -> tuple[Comparison, ...]:
    """Return comparisons, the stretches of a recording as one with the errors of all."""
    return tuple(together(stretches) for stretches in stretches_of(comparisons))


def stretches_of(comparisons: Sequence[Comparison]) -> list[list[Comparison]]:
    """Return comparisons, those of a recording and role together."""
    groups: dict[tuple[object, str], list[Comparison]] = {}
    for place, one in enumerate(comparisons):
        groups.setdefault((one.recording or place, one.role), []).append(one)
    return list(groups.values())


def together(stretches: Sequence[Comparison]) -> Comparison:
    """Return stretches of one recording as one, but their first samples, which nothing predicts."""
    first, *others = stretches
    if not others:
        return first
    measured, one_step, free_run = (
        np.concatenate([getattr(first, name), *(getattr(one, name)[1:] for one in others)])
        for name in ("measured", "one_step", "free_run")
    )
    name = f"{len(stretches)} stretches of {first.recording}"
    return replace(first, name=name, measured=measured, one_step=one_step, free_run=free_run)
