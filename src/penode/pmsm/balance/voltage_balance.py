"""The voltage balance in weak form: physical parameters and polynomial map by linear steps."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.pmsm.balance.equations import balance_equations
from penode.pmsm.balance.polynomial_map import PolynomialMap
from penode.pmsm.machine.space_vectors import CURRENTS
from penode.pmsm.machine.standstill import stands_still
from penode.pmsm.machine.term_registry import completed, physical_values, with_physical
from penode.pmsm.machine.terms import Term
from penode.training.weak_form import WeakRegression, join

#: Windows of the second step in periods of the highest order: short enough to see them.
_PERIODS = 1.2
_SHORTEST = 6
#: Windows in a recording at standstill, side by side.
_AT_REST = 40


@dataclass(frozen=True, eq=False)
class BalanceSolution:
    """A machine as the weak form gives it."""

    form: "BalanceForm"
    # Of the form, with the physical parameters of the solution.
    terms: tuple[Term, ...]
    # Coefficients of the map averaged over the angle, Vs.
    mean: FloatArray
    # Coefficients (2 order, coefficient) of cos and sin of each order, Vs.
    harmonics: FloatArray
    # HAC deviation of each physical parameter, SI units.
    deviation: Mapping[str, float]
    # Fraction of each one's low-passed regressor that the others do not explain.
    independence: Mapping[str, float]
    # Behind all but the harmonics; columns of the physical parameters first.
    equations: WeakRegression

    @property
    def values(self) -> dict[str, float]:
        """Value of each physical parameter, SI units."""
        return physical_values(self.terms)

    @property
    def resistance(self) -> float:
        """R in ohm."""
        return self.values["R"]

    @property
    def physical(self) -> dict[str, tuple[float, float]]:
        """Value and HAC deviation of each physical parameter, SI units."""
        return {name: (value, self.deviation[name]) for name, value in self.values.items()}

    def flux(self, currents: FloatArray, theta_el: FloatArray) -> tuple[FloatArray, ...]:
        """Return psi, d psi / d i and d psi / d theta at currents and angles (point,), rad.

        Shapes are (point, 2), Vs, (point, 2, 2), H, and (point, 2), Vs/rad, of currents
        (point, 2), A.
        """
        basis, slopes = self.form.polynomial.basis(currents), self.form.polynomial.slopes(currents)
        weights = np.tile(self.mean, (len(currents), 1))
        turning = np.zeros_like(weights)
        if self.form.angle_orders:
            weights = weights + waves(theta_el, self.form.angle_orders) @ self.harmonics
            turning = waves(theta_el, self.form.angle_orders, derivative=1) @ self.harmonics
        return (
            np.einsum("pic,pc->pi", basis, weights),
            np.einsum("pijc,pc->pij", slopes, weights),
            np.einsum("pic,pc->pi", basis, turning),
        )


@dataclass(frozen=True, eq=False)
class BalanceForm:
    """What the voltage balance is made of."""

    # Basis of the mean map and of each harmonic's amplitude.
    polynomial: PolynomialMap
    # Completed and prepared; their physical parameters are solved for, all others are held.
    terms: tuple[Term, ...]
    angle_orders: tuple[int, ...] = ()

    @classmethod
    def of(
        cls,
        experiments: Sequence[Experiment],
        reciprocal: bool,
        terms: Sequence[Term] = (),
        angle_orders: tuple[int, ...] = (),
        degree: int | None = None,
    ) -> "BalanceForm":
        """Return the form for recordings, terms completed and prepared for their currents.

        Resistance and rotation may be left unsaid.
        """
        scale = max(float(np.abs(e.stack(CURRENTS)).max()) for e in experiments)
        whole = tuple(term.prepared(scale) for term in completed(terms))
        return cls(PolynomialMap(reciprocal, scale, degree), whole, angle_orders)

    def solve(self, experiments: Sequence[Experiment]) -> BalanceSolution:
        """Solve for the coefficients, those of the harmonics after the others.

        Windows over whole periods of the sixth harmonic show the mean map and the physical
        parameters alone. What those leave in short windows is the harmonics'.
        """
        slow = join([self._mean_equations(e, harmonic_window(e)) for e in experiments])
        solution = slow.solve()
        names = tuple(physical_values(self.terms))
        harmonics = np.zeros((0, len(solution) - len(names)))
        if self.angle_orders:
            fast = join([self._harmonic_equations(e, solution) for e in experiments])
            harmonics = fast.solve().reshape(2 * len(self.angle_orders), -1)
        return BalanceSolution(
            form=self,
            terms=with_physical(self.terms, solution[: len(names)]),
            mean=solution[len(names) :],
            harmonics=harmonics,
            deviation={name: slow.deviation(k) for k, name in enumerate(names)},
            independence={name: slow.independence(k) for k, name in enumerate(names)},
            equations=slow,
        )

    def _mean_equations(self, experiment: Experiment, length: int) -> WeakRegression:
        basis = self.polynomial.basis(experiment.stack(CURRENTS))
        return balance_equations(experiment, self.terms, basis, length)

    def _harmonic_equations(self, experiment: Experiment, solution: FloatArray) -> WeakRegression:
        """Return the balance that a solution for the mean leaves, in short windows."""
        length = short_window(experiment, max(self.angle_orders))
        mean = self._mean_equations(experiment, length)
        basis = self.polynomial.basis(experiment.stack(CURRENTS))
        turning = waves(experiment.channels["theta_el"], self.angle_orders)
        full = (turning[:, None, :, None] * basis[:, :, None]).reshape(*basis.shape[:2], -1)
        harmonics = balance_equations(experiment, self.terms, full, length)
        physical = harmonics.matrix.shape[1] - full.shape[2]
        return WeakRegression(harmonics.matrix[:, physical:], mean.target - mean.matrix @ solution)


def waves(theta_el: FloatArray, orders: Sequence[int], derivative: int = 0) -> FloatArray:
    """Return cos and sin of each order, or their slope over the angle, shape (time, 2 order)."""
    columns = [
        n**derivative * np.cos(n * theta_el + (derivative * np.pi / 2 - lag))
        for n in orders
        for lag in (0.0, np.pi / 2)
    ]
    return np.stack(columns, axis=1)


def harmonic_window(experiment: Experiment) -> int:
    """Return two periods of the sixth electrical harmonic in samples (8 to an eighth of the run).

    A Hann window of this length nulls the orders 6, 12, 18, ... of slotting and dead time. At
    standstill there are none, and windows a fortieth of the run long make equations enough.
    """
    if stands_still([experiment]):
        return max((len(experiment) - 1) // _AT_REST, 1)
    longest = max((len(experiment) - 1) // 8, 1)
    turns = max(_turns(experiment), 1 / (3 * longest))
    return int(np.clip(round(1 / (3 * turns)), min(8, longest), longest))


def short_window(experiment: Experiment, order: int) -> int:
    """Return a little more than one period of an order in samples."""
    longest = max((len(experiment) - 1) // 8, 1)
    period = 1 / max(order * _turns(experiment), 1 / longest)
    return int(np.clip(round(_PERIODS * period), min(_SHORTEST, longest), longest))


def _turns(experiment: Experiment) -> float:
    """Return the electrical turns of the rotor a sample."""
    speed = float(np.median(np.abs(experiment.channels["omega_el"])))
    return speed * experiment.time_step / (2 * math.pi)
