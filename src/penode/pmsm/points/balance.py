"""The balance of operating points: one linear Gaussian regression with priors from physics.

At a point nothing changes: u = sum of drops with d psi/dt = 0, and the torque of the shaft is
1.5 p psi x i less friction. Both are linear in the terms' physical parameters, in the coefficients
of a mirror symmetric map and in the size of each imperfection of the bench. Imperfections have the
deviations of the declared accuracy as priors, the map that of a smooth coenergy. Its strength and
the noise of voltages and torque are what makes the points most likely.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, ClassVar

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.pmsm.balance.smoothing import Roughness, lowest
from penode.pmsm.balance.voltage_balance import term_columns
from penode.pmsm.machine.coenergy_map import MEAN, CoenergyPart, columns, roughness
from penode.pmsm.machine.linkage import Linkage
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES, vector_of
from penode.pmsm.machine.term_registry import physical_values
from penode.pmsm.machine.terms import SPEED, Term
from penode.pmsm.recording.drive_mapping import TORQUE
from penode.pmsm.recording.imperfection import Change, DriveImperfection, KnownDrive, map_at
from penode.pmsm.recording.imperfections import IMPERFECTIONS, Accuracy

#: Largest inverter voltage that is expected, over the largest voltage.
_INVERTER = 0.05
#: Deviation of when the voltages act, s: a common sample.
_VOLTAGE_TIME = 50e-6
#: Share of the current that the iron usually takes.
_IRON = 0.02
#: Steps a decade, and decades, between which noise and strength are sought; noise is over the
#: largest value of its kind, strength over that at which the largest voltage is as rough as it is.
_STEPS, _FIRST, _LIMITS = 8, (-2, -2, -2, 3), (-7, 9)
#: Rounds in which map and imperfections that need it follow each other.
_ROUNDS = 3


class _VoltageTime(DriveImperfection):
    """Time in s by which voltages act later than the angle that turned them into dq was read."""

    name, source = "voltage_time", "when the voltages act"
    remedy = "Measure the torque, or repeat points at another speed."
    unit: ClassVar[tuple[float, str]] = (1e6, "us")

    def change(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Change:
        turned = size * experiment.channels[SPEED.name]
        return Change(voltage=1j * turned * vector_of(experiment, VOLTAGES))


@dataclass(frozen=True, eq=False)
class PointsSolution:
    """Machine, imperfections and noise that make operating points most likely.

    `mean` and `covariance` are of all coefficients: the terms' physical parameters, what belongs to
    the torque, the imperfections in deviations, the map in Vs.
    """

    mean: FloatArray
    covariance: FloatArray
    # Deviation of u_d and u_q in V, and of a torque in Nm.
    noise: FloatArray
    # -2 log likelihood.
    evidence: float


@dataclass(frozen=True, eq=False)
class Solved:
    """A balance that is solved: over all noise, at the most likely one, and its equations."""

    solution: PointsSolution
    likeliest: PointsSolution
    # What each coefficient adds to each equation, (equation, coefficient).
    matrix: FloatArray


@dataclass(frozen=True, eq=False)
class PointsBalance:
    """Operating points of one machine, and what is asked of them.

    Attributes
    ----------
    points : Experiment
        A sample a point, of no clock.
    terms : tuple of Term
        Completed and prepared.
    accuracy : Accuracy
        Of the bench.
    pole_pairs : int or None
        None leaves the torque out.
    scales : (float, float)
        Currents in A and flux linkage in Vs that the map is scaled by.
    """

    points: Experiment
    terms: tuple[Term, ...]
    accuracy: Accuracy
    pole_pairs: int | None
    scales: tuple[float, float]

    #: Noise over what points show alone, whose map follows a part of it.
    noises: ClassVar[tuple[float, ...]] = (1.0, 1.5, 2.2, 3.3)
    source: ClassVar[str] = "operating points"
    subject: ClassVar[str] = "the points are"
    remedy: ClassVar[str] = "Record more operating points."
    contradiction: ClassVar[str] = (
        "Check units, signs and temperature of both, or identify them one by one."
    )

    @property
    def name(self) -> str:
        """Of the table."""
        return self.points.name

    @property
    def title(self) -> str:
        """Of the equations."""
        return self.name

    @property
    def about(self) -> str:
        """What narrows the map."""
        return f"{self.name}: {len(self.points)} operating points narrow R and the map"

    @property
    def at(self) -> FloatArray:
        """Currents of the points (point, 2), A."""
        return self.points.stack(CURRENTS)

    @property
    def quantities(self) -> dict[str, str]:
        """Units of what is measured."""
        return dict.fromkeys(VOLTAGES, "V") | ({TORQUE: "Nm"} if self.torque else {})

    @property
    def torque(self) -> bool:
        """Whether the torque is an output."""
        return self.pole_pairs is not None and TORQUE in self.points.channels

    @cached_property
    def part(self) -> CoenergyPart:
        """The map's splines, their coefficients zero."""
        return CoenergyPart.zero(MEAN, True)

    @cached_property
    def imperfections(self) -> dict[str, tuple[DriveImperfection, float]]:
        """Each imperfection of the bench that can be seen here, and its deviation, SI units."""
        drive = KnownDrive()
        left = self.accuracy.deviations([self.points])
        left["iron_of_rotation"] = _IRON * IMPERFECTIONS["iron"].scale([self.points], drive)
        found: dict[str, tuple[DriveImperfection, float]] = {
            name: (one, left[name])
            for name, one in IMPERFECTIONS.items()
            if left.get(name) and one.recorded([self.points]) and name != "delay"
        }
        return {**found, _VoltageTime.name: (_VoltageTime(), _VOLTAGE_TIME)}

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all coefficients but the map's."""
        of_torque = ("friction_torque", "torque_gain") if self.torque else ()
        return (*physical_values(self.terms), *of_torque, *self.imperfections)

    @property
    def known(self) -> FloatArray:
        """Of each equation, what no coefficient changes: a voltage in V."""
        return np.concatenate([self._columns[0].ravel(), np.zeros(len(self.points) * self.torque)])

    @cached_property
    def target(self) -> FloatArray:
        """Voltages by point and axis, less what is known, and torques behind them."""
        torque = [self.points.channels[TORQUE]] if self.torque else []
        return np.concatenate([self._voltages.ravel(), *torque]) - self.known

    @property
    def outputs(self) -> tuple[slice, ...]:
        """Where u_d, u_q and the torques, if there are any, are among the equations."""
        voltages = 2 * len(self.points)
        both = slice(0, voltages, 2), slice(1, voltages, 2)
        return (*both, slice(voltages, None)) if self.torque else both

    @cached_property
    def likeliest(self) -> tuple[PointsSolution, "_Search", FloatArray]:
        """The solution with the most likely noise; map and imperfections follow each other.

        Behind it are the last search and its steps of noise and strength.
        """
        drive: KnownDrive | None = None
        steps = _STEPS * np.array([*_FIRST[: len(self.outputs)], _FIRST[-1]])
        for _ in range(_ROUNDS):
            search = _Search.of(self, self._matrix(drive, self._basis))
            steps = search.most_likely(steps)
            likeliest = search.solution(steps)
            drive = self._drive(likeliest)
        return likeliest, search, steps

    def solve(self) -> Solved:
        """Solve for map, parameters and imperfections."""
        likeliest, search, steps = self.likeliest
        return Solved(search.around(steps), likeliest, search.matrix)

    @property
    def noise(self) -> FloatArray:
        """Deviation of the noise of u_d and u_q in V, and of the torque in Nm."""
        return self.likeliest[0].noise

    def rows(self, slopes: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """Return what each coefficient adds to each equation, of another map.

        Its slopes (point, 2, coefficient) are what its coefficients add to the flux linkage in Vs.
        """
        return self._matrix(self._drive(self.likeliest[0]), slopes(self.at))

    def prior_deviations(self, flat: float) -> FloatArray:
        """Return those of all coefficients but the map's; `flat` of what nothing is believed of."""
        return np.where(self._precision > 0, np.maximum(self._precision, 1e-300) ** -0.5, flat)

    def left(
        self, flux: Callable[[FloatArray], FloatArray], values: Mapping[str, float]
    ) -> FloatArray:
        """Return what a flux linkage (point, 2) in Vs and parameters leave of each equation."""
        psi = flux(self.at)
        _, by_parameter, by_psi = self._columns
        names = list(physical_values(self.terms))
        known = np.array([values.get(name, 0.0) for name in names])
        said = by_parameter @ known + np.einsum("pij,pj->pi", by_psi, psi)
        i_d, i_q = self.at.T
        torque = 1.5 * (self.pole_pairs or 0) * (psi[:, 0] * i_q - psi[:, 1] * i_d)
        return self.target - np.concatenate([said.ravel(), *([torque] if self.torque else [])])

    def _drive(self, solution: PointsSolution) -> KnownDrive:
        place = self.names.index("R") if "R" in self.names else None
        table = solution.mean[len(self.names) :] * self.scales[1]
        part = replace(self.part, coefficients=table.reshape(self.part.coefficients.shape))
        resistance = 0.0 if place is None else float(solution.mean[place])
        return KnownDrive(resistance, Linkage(part, self.scales[0]))

    @cached_property
    def _voltages(self) -> FloatArray:
        return self.points.stack(VOLTAGES)

    @cached_property
    def _columns(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return term_columns(self.points, self.terms)

    @cached_property
    def _basis(self) -> FloatArray:
        """What each coefficient of the own map adds to psi, (point, 2, coefficient), Vs."""
        return self.scales[1] * columns(self.part, self.points.stack(CURRENTS) / self.scales[0])

    def _matrix(self, drive: KnownDrive | None, basis: FloatArray) -> FloatArray:
        """Return what each coefficient adds to voltages and torques; the map's last."""
        _, by_parameter, by_psi = self._columns
        count = len(self.points)
        zeros = np.zeros((count, 2, 2 * self.torque))
        changes = [self._changed(one, std, drive) for one, std in self.imperfections.values()]
        supplied = np.stack([-voltage for voltage, _ in changes], axis=2)
        voltages = np.concatenate([by_parameter, zeros, supplied, by_psi @ basis], axis=2)
        rows = voltages.reshape(2 * count, -1)
        if not self.torque:
            return rows
        gain = self.accuracy.declared["torque_gain"]
        own = -np.stack([np.ones(count), gain * self.points.channels[TORQUE]], axis=1)
        i_d, i_q = self.points.stack(CURRENTS).T[:, :, None]
        speed = self.points.channels[SPEED.name][:, None]
        power = by_parameter[:, 0] * i_d + by_parameter[:, 1] * i_q
        by_speed = np.divide(power, speed, out=np.zeros_like(power), where=speed != 0)
        induced = [term.induced for term in self.terms for _ in physical_values((term,))]
        of_terms = 1.5 * (self.pole_pairs or 0) * by_speed * np.array(induced)
        parts = [of_terms, own, np.stack([t for _, t in changes], axis=1)]
        crossed = 1.5 * (self.pole_pairs or 0) * (basis[:, 0] * i_q - basis[:, 1] * i_d)
        return np.concatenate([rows, np.concatenate([*parts, crossed], axis=1)])

    def _changed(
        self, one: DriveImperfection, size: float, drive: KnownDrive | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return what an imperfection adds to the balance (point, 2), V, and the torque (point,).

        Nothing where no map is known yet.
        """
        count = len(self.points)
        if drive is None:
            return np.zeros((count, 2)), np.zeros(count)
        change = one.change(self.points, size, drive)
        _, supplied = change.column(self.points, drive)
        other = change.applied(self.points)
        torque = self._torque(other, drive) - self._torque(self.points, drive)
        return supplied, torque

    def _torque(self, points: Experiment, drive: KnownDrive) -> FloatArray:
        (psi_d, psi_q), _ = map_at(points, drive)
        i_d, i_q = points.stack(CURRENTS).T
        return np.asarray(1.5 * (self.pole_pairs or 0) * (psi_d * i_q - psi_q * i_d))

    @cached_property
    def _precision(self) -> FloatArray:
        """Inverse squared prior deviation of all coefficients but the map's; 0 for flat ones."""
        largest = float(np.hypot(*self._voltages.T).max())
        known = {"inverter_voltage": _INVERTER * largest, "torque_gain": 1.0}
        known |= dict.fromkeys(self.imperfections, 1.0)
        return np.array([known.get(name, np.inf) ** -2.0 for name in self.names])


@dataclass(frozen=True, eq=False)
class _Search:
    """The likelihood of points over noise and strength of the map's prior."""

    balance: PointsBalance
    matrix: FloatArray
    target: FloatArray
    largest: FloatArray
    penalty: Roughness
    even: float

    @classmethod
    def of(cls, balance: PointsBalance, matrix: FloatArray) -> "_Search":
        penalty = Roughness.of(len(balance.names), roughness(balance.part))
        voltages = 2 * len(balance.points)
        of_map = matrix[:voltages, penalty.first :]
        highest = np.abs(balance.target[:voltages]).max()
        largest = [
            highest,
            highest,
            *([np.abs(balance.target[voltages:]).max()] if balance.torque else []),
        ]
        even = float(np.sum(of_map**2) / np.trace(penalty.matrix))
        return cls(balance, matrix, balance.target, np.maximum(largest, 1e-300), penalty, even)

    @cached_property
    def _outputs(self) -> list[tuple[int, FloatArray, FloatArray, float]]:
        """Of each output the number of its equations, and their normal equations."""
        parts = [(self.matrix[rows], self.target[rows]) for rows in self.balance.outputs]
        return [(len(y), a.T @ a, a.T @ y, float(y @ y)) for a, y in parts]

    def most_likely(self, first: FloatArray) -> FloatArray:
        """Return the steps of noise and strength at which the points are most likely."""
        limits = (_STEPS * _LIMITS[0], _STEPS * _LIMITS[1])
        return lowest(lambda steps: self.at(steps)[0], first, limits)

    def noise(self, steps: FloatArray) -> FloatArray:
        """Return the deviation of each output."""
        return np.asarray(self.largest * 10.0 ** (steps[:-1] / _STEPS))

    def solution(self, steps: FloatArray) -> PointsSolution:
        """Return the solution at steps of noise and strength."""
        evidence, mean, factor, size = self.at(steps)
        inverse = cho_solve(factor, np.eye(len(size)), check_finite=False)
        return PointsSolution(
            mean / size, inverse / np.outer(size, size), self.noise(steps), evidence
        )

    def at(self, steps: FloatArray) -> tuple[float, FloatArray, Any, FloatArray]:
        """Return -2 log likelihood at steps of noise and strength, and the scaled solution.

        Mean (coefficient,), Cholesky's factor of the precision, and what both are divided by.
        """
        precision, right = (np.zeros_like(one) for one in self._outputs[0][1:3])
        energy = spread = 0.0
        for (equations, normal, own, square), deviation in zip(
            self._outputs, self.noise(steps), strict=True
        ):
            precision += normal / deviation**2
            right += own / deviation**2
            energy += square / deviation**2
            spread += 2 * equations * float(np.log(deviation))
        count, place = len(self.balance.names), self.penalty.place
        precision[np.arange(count), np.arange(count)] += self.balance._precision
        # Not over the noise: what is believed of the map does not move with it.
        strength = self.even / self.largest[0] ** 2 * 10.0 ** (steps[-1] / _STEPS)
        precision[place, place] += strength * self.penalty.matrix
        size = np.sqrt(np.maximum(np.diag(precision), 1e-300))
        scaled = precision / np.outer(size, size)
        scaled[np.diag_indices_from(scaled)] += 1e-12
        factor = cho_factor(scaled, lower=True, check_finite=False)
        right = right / size
        mean = cho_solve(factor, right, check_finite=False)
        volume = 2 * float(np.sum(np.log(np.diag(factor[0]))) + np.sum(np.log(size)))
        prior = self.penalty.rank * np.log(strength) + self.penalty.volume
        evidence = energy - float(right @ mean) + spread + volume - float(prior)
        return evidence, mean, factor, size

    def around(self, best: FloatArray) -> PointsSolution:
        """Return the mean over noise and strength around the most likely."""
        steps = product((-1, 0, 1), repeat=len(best))
        return mixed(self.solution(best + np.array(step)) for step in steps)


def mixed(solutions: Iterable[PointsSolution]) -> PointsSolution:
    """Return the mean of solutions weighed by their likelihood, what they differ by in its spread.

    Its likelihood is the mean of theirs.
    """
    every = list(solutions)
    evidence = np.array([one.evidence for one in every])
    likely = np.exp(0.5 * (evidence.min() - evidence))
    weight = likely / likely.sum()
    mean = weight @ np.stack([one.mean for one in every])
    apart = np.stack([one.mean - mean for one in every])
    within = sum(w * one.covariance for w, one in zip(weight, every, strict=True))
    noise = np.sqrt(weight @ np.stack([one.noise**2 for one in every]))
    covariance = within + (weight * apart.T) @ apart
    return PointsSolution(mean, covariance, noise, evidence.min() - 2 * np.log(likely.mean()))


def left_out(
    matrix: FloatArray, target: FloatArray, solution: PointsSolution, deviation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return each equation's prediction without it, and the deviation of the difference."""
    leverage = np.einsum("ij,jk,ik->i", matrix, solution.covariance, matrix) / deviation**2
    free = np.maximum(1.0 - leverage, 1e-9)
    residual = (target - matrix @ solution.mean) / free
    return target - residual, deviation / np.sqrt(free)


def contributions(
    covariance: FloatArray, of: int, sources: Sequence[int]
) -> tuple[FloatArray, float]:
    """Return what each source adds to a coefficient's deviation, one after the other, and the rest.

    The squares add up to the variance.
    """
    chosen = [*sources, of]
    part = covariance[np.ix_(chosen, chosen)]
    size = np.sqrt(np.diag(part))
    factor = np.linalg.cholesky(part / np.outer(size, size) + 1e-12 * np.eye(len(size)))
    row = size[-1] * factor[-1]
    return np.asarray(row[:-1]), float(row[-1])
