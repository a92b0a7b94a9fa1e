"""The voltage balance of a recording for any factor of its speed, in milliseconds a factor.

With a polynomial coenergy, R and the mean of a dead time it is linear in all but the factor, and in
that too: the sums over windows are made at standstill and at the speed as recorded. When the
voltage acts and how far it is turned are free beside, within a prior: neither may decide on a sign
or on pole pairs.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from penode.arrays import FloatArray, IntArray
from penode.data.experiment import Experiment
from penode.pmsm.balance.trial_balance import Trial, trial_form
from penode.pmsm.balance.voltage_balance import BalanceForm, equations_of, term_columns
from penode.pmsm.conventions.broken_convention import with_channels
from penode.pmsm.machine.space_vectors import CURRENTS
from penode.pmsm.machine.terms import SPEED
from penode.pmsm.recording.imperfection import UNKNOWN_DRIVE
from penode.pmsm.recording.imperfections import IMPERFECTIONS
from penode.training.weak_form import OVERLAP, WeakRegression

#: Degree of the coenergy: where a convention is right a better map leaves much less.
_DEGREE = 6
#: Columns beside those of terms and map, and the deviation in samples of their prior.
_BESIDE, _TIMING = ("delay", "turn"), 2.0
#: Added to normal equations of unit columns, so that a column of zeros does no harm.
_RIDGE = 1e-12
#: Range of one current over that of the other below which its axis is not excited.
_AT_REST = 0.01
#: Currents at which the differential inductance is looked at.
_POINTS = 200


@dataclass(frozen=True, eq=False)
class SpeedBalance:
    """Sums over windows of `length` samples of one recording."""

    experiment: Experiment
    length: int

    def at(self, factor: float = 1.0) -> Trial:
        """Return the balance with a factor on the speed."""
        at_rest, as_recorded = self._sums
        matrix = (1.0 - factor) * at_rest.matrix + factor * as_recorded.matrix
        target, size = at_rest.target, np.linalg.norm(matrix, axis=0)
        scaled = matrix / np.where(size > 0, size, 1.0)
        gram = scaled.T @ scaled + _RIDGE * np.eye(len(size))
        moment = scaled.T @ target
        left = target - scaled @ np.linalg.solve(gram, moment)
        prior = _norm(left) * np.sqrt(4 * OVERLAP / len(left)) / _TIMING
        timing = np.arange(len(_BESIDE))
        gram[timing, timing] += (prior / np.where(size > 0, size, np.inf)[timing]) ** 2
        solution = np.linalg.solve(gram, moment)
        left = target - scaled @ solution
        weights = (solution / np.where(size > 0, size, 1.0))[len(_BESIDE) + 2 :]
        slopes = self._slopes @ weights
        symmetric = 0.5 * (slopes + slopes.transpose(0, 2, 1))
        moving = np.ix_(np.arange(len(symmetric)), *2 * (self._moving,))
        return Trial(
            residual=_norm(left) / max(_norm(target), 1e-300),
            definite=float(np.mean(np.linalg.eigvalsh(symmetric[moving])[:, 0] > 0.0)),
            magnet=(self._form.polynomial.basis(np.zeros((1, 2))) @ weights)[0],
        )

    @cached_property
    def _form(self) -> BalanceForm:
        return trial_form([self.experiment], _DEGREE)

    @cached_property
    def _slopes(self) -> FloatArray:
        """Return the slopes of the map at some of the currents, by its coefficients."""
        currents = self.experiment.stack(CURRENTS)
        return self._form.polynomial.slopes(currents[:: max(len(currents) // _POINTS, 1)])

    @cached_property
    def _moving(self) -> IntArray:
        """Which axes have current that moves: of the other no inductance is in the recording."""
        ranges = np.ptp(self.experiment.stack(CURRENTS), axis=0)
        return np.flatnonzero(ranges > _AT_REST * ranges.max())

    @cached_property
    def _sums(self) -> tuple[WeakRegression, WeakRegression]:
        """The equations at standstill and at the speed as recorded."""
        still = with_channels(self.experiment, {SPEED.name: np.zeros(len(self.experiment))})
        known, by_parameter, by_psi = term_columns(self.experiment, self._form.terms)
        basis = self._form.basis(self.experiment)

        def equations(experiment: Experiment, slope: FloatArray) -> WeakRegression:
            beside = [
                column
                for name in _BESIDE
                for column in IMPERFECTIONS[name].columns(experiment, UNKNOWN_DRIVE)
            ]
            columns = known, by_parameter, slope
            return equations_of(experiment, columns, basis, self.length, beside)

        # Of the terms rotation alone has the speed in it, and the flux linkage.
        return equations(still, np.zeros_like(by_psi)), equations(self.experiment, by_psi)


def _norm(vector: FloatArray) -> float:
    return float(np.linalg.norm(vector))
