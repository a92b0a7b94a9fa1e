"""What is measured of a fit, beside the truth of the bench that it never saw."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from penode.arrays import FloatArray
from penode.bench.run import Recording
from penode.fit.fit import Fit

_GRID = 61


@dataclass(frozen=True)
class Measures:
    """How good a fit is, in SI units; a one-step or free-run error is infinite after a divergence.

    ``flux_mae`` is the mean absolute error of psi_d and psi_q over the excited region in Vs,
    ``trained`` the RMSE in A over the horizon (steps) on the windows trained on; one-step errors
    are mean squares in A^2, free-run errors RMSE in A, by unseen recording; ``magnet_flux`` is the
    data sheet's.
    """

    resistance: float
    deviation: float
    true_resistance: float
    horizon: int
    verdict: str
    flux_mae: float
    magnet_flux: float
    trained: float
    one_step_train: float
    one_step: Mapping[str, float]
    free_run: Mapping[str, float]
    others: Mapping[str, float]

    @property
    def error(self) -> float:
        """Relative error of R."""
        return self.resistance / self.true_resistance - 1

    @property
    def flux_share(self) -> float:
        """Error of the map over psi_PM."""
        return self.flux_mae / self.magnet_flux

    @property
    def unseen_one_step(self) -> float:
        """Mean of the one-step errors over the unseen recordings, in A^2."""
        return float(np.mean(list(self.one_step.values()))) if self.one_step else np.nan

    @property
    def unseen_free_run(self) -> float:
        """Median of the free-run errors over the unseen recordings, in A."""
        return float(np.median(list(self.free_run.values()))) if self.free_run else np.nan

    def plain(self) -> dict[str, Any]:
        """Return what JSON can hold."""
        return asdict(self)

    @classmethod
    def restored(cls, record: Mapping[str, Any]) -> "Measures":
        """Return measures from what `plain` gave; a number that was not finite is infinite."""
        values = {name: _finite(value) for name, value in record.items()}
        return cls(**values)


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _finite(inner) for name, inner in value.items()}
    return np.inf if value is None else value


def measure(fit: Fit, recording: Recording) -> Measures:
    """Measure a fit whose comparisons hold the recording learned from and the unseen ones."""
    truth = recording.truth
    points = _excited_points(fit)
    gap = fit.flux_map(*points.T).T - truth.flux_map(*points.T)
    seen = [c for c in fit.comparisons if c.role == "train"]
    rungs = {rung.horizon: rung.rmse for rung in fit.horizon.ladder}
    unseen = [c for c in fit.comparisons if c.role != "train"]
    return Measures(
        resistance=fit.parameters["R"].value,
        deviation=fit.parameters["R"].std,
        true_resistance=truth.resistance,
        horizon=fit.horizon.selected,
        verdict=fit.horizon.verdict,
        flux_mae=float(np.mean(np.abs(gap))),
        magnet_flux=truth.machine.magnet_flux_linkage,
        trained=rungs[fit.horizon.selected],
        one_step_train=float(np.mean([c.one_step_rmse**2 for c in seen])),
        one_step={c.name: c.one_step_rmse**2 for c in unseen},
        free_run={c.name: c.free_run_rmse for c in unseen},
        others={name: p.value for name, p in fit.parameters.items() if name != "R"},
    )


def _excited_points(fit: Fit) -> FloatArray:
    limit = np.abs(fit.excited).max()
    axis = np.linspace(-limit, limit, _GRID)
    points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.asarray(points[fit.supported(points)])
