"""The voltage balance in weak form: resistance, polynomial map and dead time by linear steps."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.pmsm.frames import abc_from_dq, dq_from_abc
from penode.training.weak_form import WeakRegression, join, weak_regression

#: Degree of the polynomial coenergy, and of the polynomials of a map without coenergy.
_DEGREE = {True: 8, False: 6}
#: Windows of the second step in periods of the highest order: short enough to see them.
_PERIODS = 1.2
_SHORTEST = 6


@dataclass(frozen=True, eq=False)
class PolynomialMap:
    """Flux map that is linear in its coefficients, on currents scaled to the unit disc.

    Attributes
    ----------
    reciprocal : bool
        Gradient of a polynomial coenergy, or two free polynomials.
    current_scale : float
        A (peak).
    degree : int or None
        Of the coenergy, or of the free polynomials; 8 and 6 if not given.
    """

    reciprocal: bool
    current_scale: float
    degree: int | None = None

    def basis(self, currents: FloatArray) -> FloatArray:
        """Return the map of each coefficient, shape (time, 2, coefficient), at (time, 2) in A."""
        x, y = (currents / self.current_scale).T
        degree = self.degree or _DEGREE[self.reciprocal]
        powers = [(m, n) for m in range(degree + 1) for n in range(degree + 1 - m)]
        if self.reciprocal:
            columns = [
                (m * x ** max(m - 1, 0) * y**n, n * x**m * y ** max(n - 1, 0))
                for m, n in powers
                if m + n > 0
            ]
        else:
            zero = np.zeros_like(x)
            columns = [(x**m * y**n, zero) for m, n in powers]
            columns += [(zero, x**m * y**n) for m, n in powers]
        return np.stack([np.stack(column, axis=1) for column in columns], axis=2)

    def slopes(self, currents: FloatArray) -> FloatArray:
        """Return the slopes of each coefficient's map over the currents, in 1/A.

        Parameters
        ----------
        currents : ndarray, shape (time, 2)
            A.

        Returns
        -------
        ndarray, shape (time, 2, 2, coefficient)
            Flux linkage first, then the current it is derived by; by central differences.
        """
        step = 1e-4 * self.current_scale
        shifts = step * np.eye(2)
        found = [self.basis(currents + d) - self.basis(currents - d) for d in shifts]
        return np.stack(found, axis=2) / (2 * step)


@dataclass(frozen=True, eq=False)
class BalanceSolution:
    """What the weak form finds of a machine.

    Attributes
    ----------
    form : BalanceForm
        What was asked for.
    resistance : float
        Ohm.
    dead_time_voltage : float
        dU in V; 0 without inverter term.
    mean : ndarray, shape (coefficient,)
        Coefficients of the map averaged over the angle, in Vs.
    harmonics : ndarray, shape (2 order, coefficient)
        Coefficients of cos and sin of each order, in Vs.
    deviation : mapping of str to float
        HAC deviation of R in ohm, and of dead_time_voltage in V where it was asked for.
    independence : mapping of str to float
        Share of each one's low-passed regressor that the others do not explain.
    equations : WeakRegression
        Behind all but the harmonics; the first column is R's.
    """

    form: "BalanceForm"
    resistance: float
    dead_time_voltage: float
    mean: FloatArray
    harmonics: FloatArray
    deviation: Mapping[str, float]
    independence: Mapping[str, float]
    equations: WeakRegression

    @property
    def physical(self) -> dict[str, tuple[float, float]]:
        """Value and HAC deviation of each physical parameter, SI units."""
        values = {"R": self.resistance, "dead_time_voltage": self.dead_time_voltage}
        return {name: (values[name], deviation) for name, deviation in self.deviation.items()}

    def flux(self, currents: FloatArray, theta_el: FloatArray) -> tuple[FloatArray, ...]:
        """Return the map found at currents (point, 2) in A and angles (point,) in rad.

        Returns
        -------
        tuple of ndarray
            psi (point, 2) in Vs, d psi / d i (point, 2, 2) in H, d psi / d theta (point, 2) in
            Vs/rad.
        """
        basis, slopes = self.form.polynomial.basis(currents), self.form.polynomial.slopes(currents)
        weights = np.tile(self.mean, (len(currents), 1))
        turning = np.zeros_like(weights)
        if self.form.angle_orders:
            weights = weights + _waves(theta_el, self.form.angle_orders) @ self.harmonics
            turning = _waves(theta_el, self.form.angle_orders, derivative=1) @ self.harmonics
        return (
            np.einsum("pic,pc->pi", basis, weights),
            np.einsum("pijc,pc->pij", slopes, weights),
            np.einsum("pic,pc->pi", basis, turning),
        )


@dataclass(frozen=True, eq=False)
class BalanceForm:
    """What the voltage balance is made of.

    Attributes
    ----------
    polynomial : PolynomialMap
        Basis of the mean map and of each harmonic's amplitude.
    angle_orders : tuple of int
        Harmonics of the electrical angle.
    dead_time_current : float or None
        i_0 in A as assumed; None leaves the inverter term out.
    """

    polynomial: PolynomialMap
    angle_orders: tuple[int, ...] = ()
    dead_time_current: float | None = None

    def solve(self, experiments: Sequence[Experiment]) -> BalanceSolution:
        """Find the coefficients, those of the harmonics after the others.

        Windows over whole periods of the sixth harmonic show the mean map, R and dU alone. What
        those leave in short windows is the harmonics'.

        Parameters
        ----------
        experiments : sequence of Experiment
            Recordings with i_d, i_q (A), u_d, u_q (V), omega_el (rad/s), and theta_el (rad) where
            it is needed.
        """
        slow = join([self._mean_equations(e, harmonic_window(e)) for e in experiments])
        found = slow.solve()
        names = ("R",) if self.dead_time_current is None else ("R", "dead_time_voltage")
        dropped = len(names)
        harmonics = np.zeros((0, len(found) - dropped))
        if self.angle_orders:
            fast = join([self._harmonic_equations(e, found) for e in experiments])
            harmonics = fast.solve().reshape(2 * len(self.angle_orders), -1)
        return BalanceSolution(
            form=self,
            resistance=float(found[0]),
            dead_time_voltage=float(found[1]) if dropped == 2 else 0.0,
            mean=found[dropped:],
            harmonics=harmonics,
            deviation={name: slow.deviation(k) for k, name in enumerate(names)},
            independence={name: slow.independence(k) for k, name in enumerate(names)},
            equations=slow,
        )

    def _mean_equations(self, experiment: Experiment, length: int) -> WeakRegression:
        """Return d psi/dt = u - R i - dU h - omega J psi; columns R, dU where asked for, map."""
        basis = self.polynomial.basis(experiment.stack(("i_d", "i_q")))
        return _equations(experiment, self._dropped(experiment), basis, length)

    def _harmonic_equations(self, experiment: Experiment, found: FloatArray) -> WeakRegression:
        """Return the balance that the coefficients found leave, in short windows."""
        length = _short_window(experiment, max(self.angle_orders))
        known = self._mean_equations(experiment, length)
        basis = self.polynomial.basis(experiment.stack(("i_d", "i_q")))
        waves = _waves(experiment.channels["theta_el"], self.angle_orders)
        full = (waves[:, None, :, None] * basis[:, :, None]).reshape(*basis.shape[:2], -1)
        unknown = _equations(experiment, full[..., :0], full, length)
        return WeakRegression(unknown.matrix, known.target - known.matrix @ found)

    def _dropped(self, experiment: Experiment) -> FloatArray:
        """Return i (A) and, where asked for, the dead time's h, shape (time, 2, 1 or 2)."""
        currents = experiment.stack(("i_d", "i_q"))
        if self.dead_time_current is None:
            return currents[..., None]
        theta_el = experiment.channels["theta_el"]
        signs = np.tanh(abc_from_dq(currents, theta_el) / self.dead_time_current)
        return np.stack([currents, dq_from_abc(signs, theta_el)], axis=2)


def _equations(
    experiment: Experiment, dropped: FloatArray, basis: FloatArray, length: int
) -> WeakRegression:
    """Return the weak form of d psi/dt = u - dropped - omega J psi, in columns of both."""
    drive = experiment.stack(("u_d", "u_q", "omega_el"))
    rotation = drive[:, 2, None, None] * np.stack([-basis[:, 1], basis[:, 0]], axis=1)
    stored = np.concatenate([np.zeros_like(dropped), basis], axis=2)
    supplied = np.concatenate([-dropped, -rotation], axis=2)
    return weak_regression(stored, supplied, drive[:, :2], experiment.time_step, length)


def _waves(theta_el: FloatArray, orders: Sequence[int], derivative: int = 0) -> FloatArray:
    """Return cos and sin of each order, or their slope over the angle, shape (time, 2 order)."""
    columns = [
        n**derivative * np.cos(n * theta_el + (derivative * np.pi / 2 - lag))
        for n in orders
        for lag in (0.0, np.pi / 2)
    ]
    return np.stack(columns, axis=1)


def harmonic_window(experiment: Experiment) -> int:
    """Return two periods of the sixth electrical harmonic in samples (8 to an eighth of the run).

    A Hann window of this length nulls the orders 6, 12, 18, ... of slotting and dead time.
    """
    longest = max((len(experiment) - 1) // 8, 1)
    turns = max(_turns(experiment), 1 / (3 * longest))
    return int(np.clip(round(1 / (3 * turns)), min(8, longest), longest))


def _short_window(experiment: Experiment, order: int) -> int:
    """Return a little more than one period of an order in samples."""
    longest = max((len(experiment) - 1) // 8, 1)
    period = 1 / max(order * _turns(experiment), 1 / longest)
    return int(np.clip(round(_PERIODS * period), min(_SHORTEST, longest), longest))


def _turns(experiment: Experiment) -> float:
    """Return the electrical turns of the rotor a sample."""
    speed = float(np.median(np.abs(experiment.channels["omega_el"])))
    return speed * experiment.time_step / (2 * math.pi)
