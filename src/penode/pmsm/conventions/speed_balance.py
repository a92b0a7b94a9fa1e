"""The voltage balance of a recording for any factor of its speed, in milliseconds a factor.

u = R i + f omega J psi(i) + d psi(i)/dt with a polynomial coenergy, R and the mean of a dead time
is linear but for f, so that the sums over windows are made once. When the voltage acts and how far
it is turned are free beside, within a prior: neither may decide on a sign or on pole pairs.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from penode.arrays import FloatArray, IntArray
from penode.data.experiment import Experiment
from penode.pmsm.balance.voltage_balance import PolynomialMap
from penode.pmsm.machine.frames import quarter_turned
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES
from penode.training.weak_form import OVERLAP, HannWindow

#: Degree of the coenergy: where a convention is right a better map leaves much less.
_DEGREE = 6
#: Fraction of the largest current below which the mean dead-time voltage fades.
_FADE = 0.02
#: Deviation in samples of the prior of delay and turn.
_TIMING = 2.0
#: Added to normal equations of unit columns, so that a column of zeros does no harm.
_RIDGE = 1e-12
#: Range of one current over that of the other below which its axis is not excited.
_AT_REST = 0.01
#: Currents at which the differential inductance is looked at.
_POINTS = 200


@dataclass(frozen=True, eq=False)
class Trial:
    """What the balance makes of a recording at one factor of the speed."""

    # What it leaves of the voltages (root mean square), as a fraction of them.
    residual: float
    # Fraction of the visited currents at which d psi / d i is positive definite, as it must be.
    definite: float
    # Flux linkage at no current (2,), Vs.
    magnet: FloatArray

    @property
    def misfit(self) -> float:
        """The residual, doubled where no d psi / d i is positive definite: smaller is better."""
        return self.residual * (2.0 - self.definite)


@dataclass(frozen=True, eq=False)
class SpeedBalance:
    """Sums over windows of `length` samples of one recording."""

    experiment: Experiment
    length: int

    def at(self, factor: float = 1.0) -> Trial:
        """Return the balance with a factor on the speed."""
        matrix = np.concatenate(
            [self._others, factor * self._turn, factor * self._rotating + self._stored], axis=1
        )
        size = np.linalg.norm(matrix, axis=0)
        scaled = matrix / np.where(size > 0, size, 1.0)
        gram = scaled.T @ scaled + _RIDGE * np.eye(len(size))
        moment = scaled.T @ self._target
        left = self._target - scaled @ np.linalg.solve(gram, moment)
        # Delay and turn stand third and fourth; equations that overlap count as one.
        prior = _norm(left) * np.sqrt(4 * OVERLAP / len(left)) / _TIMING
        timing = np.arange(2, 4)
        gram[timing, timing] += (prior / np.where(size > 0, size, np.inf)[timing]) ** 2
        solution = np.linalg.solve(gram, moment)
        left = self._target - scaled @ solution
        solution = solution / np.where(size > 0, size, 1.0)
        map_of = solution[4:]
        slopes = (self._slopes @ map_of)[:, self._moving][:, :, self._moving]
        symmetric = 0.5 * (slopes + slopes.transpose(0, 2, 1))
        return Trial(
            residual=_norm(left) / max(_norm(self._target), 1e-300),
            definite=float(np.mean(np.linalg.eigvalsh(symmetric)[:, 0] > 0.0)),
            magnet=(self._polynomial.basis(np.zeros((1, 2))) @ map_of)[0],
        )

    @cached_property
    def _currents(self) -> FloatArray:
        return self.experiment.stack(CURRENTS)

    @cached_property
    def _moving(self) -> IntArray:
        """Which axes have current that moves: of the other no inductance is in the recording."""
        ranges = np.ptp(self._currents, axis=0)
        return np.flatnonzero(ranges > _AT_REST * ranges.max())

    @cached_property
    def _reach(self) -> float:
        return float(np.hypot(*self._currents.T).max())

    @cached_property
    def _polynomial(self) -> PolynomialMap:
        return PolynomialMap(True, self._reach, _DEGREE)

    @cached_property
    def _slopes(self) -> FloatArray:
        some = self._currents[:: max(len(self._currents) // _POINTS, 1)]
        return self._polynomial.slopes(some)

    @cached_property
    def _window(self) -> HannWindow:
        return HannWindow(self.experiment.time_step, self.length)

    @cached_property
    def _target(self) -> FloatArray:
        return -self._window.of_held(self.experiment.stack(VOLTAGES)).ravel()

    @cached_property
    def _stored(self) -> FloatArray:
        return _rows(self._window.of_store(self._basis))

    @cached_property
    def _rotating(self) -> FloatArray:
        speed = self.experiment.channels["omega_el"][:, None, None]
        return _rows(self._window.of_supply(-speed * np.moveaxis(_turned(self._basis), 0, 1)))

    @cached_property
    def _basis(self) -> FloatArray:
        return self._polynomial.basis(self._currents)

    @cached_property
    def _others(self) -> FloatArray:
        """Columns of R, dead time and delay."""
        length = np.hypot(np.hypot(*self._currents.T), _FADE * self._reach)
        supplied = np.stack([-self._currents, -self._currents / length[:, None]], axis=2)
        later = self.experiment.time_step * self.experiment.stack(VOLTAGES)
        return np.concatenate(
            [
                _rows(self._window.of_supply(supplied)),
                _rows(self._window.of_store(later[..., None])),
            ],
            axis=1,
        )

    @cached_property
    def _turn(self) -> FloatArray:
        turned = quarter_turned(self.experiment.stack(VOLTAGES).T).T
        along = self.experiment.time_step * self.experiment.channels["omega_el"][:, None] * turned
        return _rows(self._window.of_supply(along[..., None]))


def _turned(basis: FloatArray) -> FloatArray:
    """Return J psi of each coefficient, (2, time, coefficient)."""
    return np.asarray(quarter_turned(np.moveaxis(basis, 1, 0)))


def _rows(sums: FloatArray) -> FloatArray:
    return sums.reshape(-1, sums.shape[-1])


def _norm(vector: FloatArray) -> float:
    return float(np.linalg.norm(vector))
