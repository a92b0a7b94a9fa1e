"""The voltage balance of recordings in weak form, derived from the terms' own drops.

d psi/dt = u - sum of drops is linear in the terms' physical parameters and in the coefficients of a
map, here a polynomial one. The voltage equation is not written down: columns are the slopes of
`Term.drop`.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, float64, in_blocks
from penode.data.experiment import Experiment
from penode.models.inputs import Inputs
from penode.models.parameters import with_batch_axis
from penode.pmsm.machine.flux_maps import Flux
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES
from penode.pmsm.machine.standstill import stands_still
from penode.pmsm.machine.term_registry import (
    channels_of,
    completed,
    physical_places,
    physical_values,
    with_physical,
)
from penode.pmsm.machine.terms import Term
from penode.pmsm.recording.imperfection import Column
from penode.training.weak_form import HannWindow, WeakRegression, join

#: Windows of the second step in periods of the highest order: short enough to see them.
_PERIODS = 1.2
_SHORTEST = 6
#: Windows in a recording at standstill, side by side.
_AT_REST = 40
#: Degree of the polynomial coenergy, and of the polynomials of a map without coenergy.
_DEGREE = {True: 8, False: 6}

#: Returns the samples of a window for a recording.
Window: TypeAlias = Callable[[Experiment], int]


@dataclass(frozen=True, eq=False)
class PolynomialMap:
    """Flux map that is linear in its coefficients, on currents scaled to the unit disc."""

    # Gradient of a polynomial coenergy, or two free polynomials.
    reciprocal: bool
    # A (peak).
    current_scale: float
    # Of the coenergy, or of the free polynomials; 8 and 6 if not given.
    degree: int | None = None

    def basis(self, currents: FloatArray) -> FloatArray:
        """Return the map of each coefficient, shape (time, 2, coefficient), at (time, 2) in A."""
        x, y = (currents / self.current_scale).T
        degree = self.degree or _DEGREE[self.reciprocal]
        of_x, of_y = (np.vander(one, degree + 1, increasing=True) for one in (x, y))
        m, n = np.array([(m, n) for m in range(degree + 1) for n in range(degree + 1 - m)]).T
        if not self.reciprocal:
            each = of_x[:, m] * of_y[:, n]
            return np.concatenate([np.stack([each, 0 * each], 1), np.stack([0 * each, each], 1)], 2)
        m, n = m[1:], n[1:]
        along_d = m * of_x[:, np.maximum(m - 1, 0)] * of_y[:, n]
        along_q = n * of_x[:, m] * of_y[:, np.maximum(n - 1, 0)]
        return np.stack([along_d, along_q], axis=1)

    def slopes(self, currents: FloatArray) -> FloatArray:
        """Return d psi / d i (time, 2, 2, coefficient), 1/A, of currents (time, 2), A.

        Flux linkage first, then the current; by central differences.
        """
        step = 1e-4 * self.current_scale
        shifts = step * np.eye(2)
        differences = [self.basis(currents + d) - self.basis(currents - d) for d in shifts]
        return np.stack(differences, axis=2) / (2 * step)


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
        slow = self.equations(experiments)
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

    def equations(
        self,
        experiments: Sequence[Experiment],
        window: Window | int | None = None,
        further: Sequence[Sequence[Column]] | None = None,
    ) -> WeakRegression:
        """Return the balance of recordings, without harmonics; windows null the sixth by default.

        Columns: further ones of each recording, the terms' physical parameters, the mean map.
        """
        return joint_equations(
            experiments, self.terms, self.basis, window or harmonic_window, further
        )

    def basis(self, experiment: Experiment) -> FloatArray:
        """Return the mean map of each coefficient at a recording's currents, (time, 2, .), Vs."""
        return self.polynomial.basis(experiment.stack(CURRENTS))

    def _harmonic_equations(self, experiment: Experiment, solution: FloatArray) -> WeakRegression:
        """Return the balance that a solution for the mean leaves, in short windows."""
        length = short_window(experiment, max(self.angle_orders))
        mean = self.equations([experiment], length)
        basis = self.basis(experiment)
        turning = waves(experiment.channels["theta_el"], self.angle_orders)
        full = (turning[:, None, :, None] * basis[:, :, None]).reshape(*basis.shape[:2], -1)
        harmonics = balance_equations(experiment, self.terms, full, length)
        physical = harmonics.matrix.shape[1] - full.shape[2]
        return WeakRegression(harmonics.matrix[:, physical:], mean.target - mean.matrix @ solution)


def balance_equations(
    experiment: Experiment,
    terms: Sequence[Term],
    basis: FloatArray,
    length: int,
    further: Sequence[Column] = (),
) -> WeakRegression:
    """Return the weak form of d psi/dt = u - sum of drops, linear in what is unknown.

    Columns: `further` coefficients, by stored and supplied quantity (time, 2) each, the
    prepared terms' physical parameters in their order, the map, by the flux linkages `basis`
    (time, 2, coefficient). Windows hold `length` samples.
    """
    return equations_of(experiment, term_columns(experiment, terms), basis, length, further)


def equations_of(
    experiment: Experiment,
    columns: tuple[FloatArray, FloatArray, FloatArray],
    basis: FloatArray,
    length: int,
    further: Sequence[Column] = (),
) -> WeakRegression:
    """Return `balance_equations` of terms whose `term_columns` are known."""
    known_drop, by_parameter, by_psi = columns
    window = HannWindow(experiment.time_step, length)
    of_map = window.of_transformed(np.ascontiguousarray(basis), -by_psi)
    parts = [window.of_store(s) + window.of_supply(r) for s, r in further]
    matrix = np.concatenate(
        [*(part[..., None] for part in parts), -window.of_supply(by_parameter), of_map], axis=2
    )
    target = window.of_supply(known_drop) - window.of_held(experiment.stack(VOLTAGES))
    return WeakRegression(matrix.reshape(-1, matrix.shape[2]), target.ravel())


def joint_equations(
    experiments: Sequence[Experiment],
    terms: Sequence[Term],
    basis: Callable[[Experiment], FloatArray],
    window: Window | int,
    further: Sequence[Sequence[Column]] | None = None,
) -> WeakRegression:
    """Return `balance_equations` of several recordings as one regression.

    `basis` is that of the map at a recording's samples; `further` are columns of each recording.
    """
    parts = []
    for e, own in zip(experiments, further or [()] * len(experiments), strict=True):
        length = window if isinstance(window, int) else window(e)
        parts.append(balance_equations(e, terms, basis(e), length, own))
    return join(parts)


def term_columns(
    experiment: Experiment, terms: Sequence[Term]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the drops of terms at every sample, linearised in what is unknown.

    The known drop (time, 2), V, with all parameters and psi at zero, and its derivatives by
    each physical parameter (time, 2, parameter) and by psi (time, 2, 2), V/Vs; for the half
    samples before and after, linearised where the parameters stand, without flux linkage.
    """
    each = [_columns(experiment, term) for term in terms]
    known_drop = sum((known for known, _, _ in each), np.zeros((len(experiment), 2)))
    by_psi = sum((slope for _, _, slope in each), np.zeros((len(experiment), 2, 2)))
    by_parameter = [slope for _, slope, _ in each]
    return known_drop, np.concatenate(by_parameter, axis=2), by_psi


def _columns(experiment: Experiment, term: Term) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the `term_columns` of one term, whose program serves it beside any others."""
    names = (*VOLTAGES, *channels_of((term,)))
    rows = [experiment.stack(channels).T for channels in (CURRENTS, names)]
    with float64():
        blocks = [
            [np.asarray(part) for part in _linearised(term, x, u, names, experiment.time_step)]
            for x, u in zip(*map(in_blocks, rows), strict=True)
        ]
    known_drop, by_parameter, by_psi = (
        np.concatenate([np.ascontiguousarray(np.moveaxis(part, -1, 0)) for part in parts])
        for parts in zip(*blocks, strict=True)
    )
    count = len(experiment)
    return known_drop[:count], by_parameter[:count], by_psi[:count]


@partial(jax.jit, static_argnums=(3, 4))
def _linearised(
    term: Term, x: JaxArray, u: JaxArray, names: tuple[str, ...], step: float
) -> tuple[JaxArray, JaxArray, JaxArray]:
    """Return the drop without flux linkage, and its slopes by parameters and by psi, time last."""
    (term,), no_flux = with_batch_axis((term,)), jnp.zeros_like(x)
    inputs = Inputs(u, names, (-0.5 * step, 0.5 * step))
    fields = [name for _, name in physical_places((term,))]

    def physical(term: Term) -> list[JaxArray]:
        return [getattr(term, name) for name in fields]

    def drop(values: JaxArray, psi: JaxArray) -> JaxArray:
        moved = eqx.tree_at(physical, term, list(values[:, None])) if fields else term
        return no_flux + moved.drop(x, inputs, Flux(psi, jnp.zeros((2, 2, 1)), no_flux))

    values = jnp.concatenate([jnp.zeros(0), *physical(term)])
    at_rest, pushed = jax.linearize(drop, values, no_flux)
    by_parameter = jax.vmap(pushed, (0, None), 1)(jnp.eye(len(values)), no_flux)
    units = jnp.eye(2)[:, :, None] + no_flux
    by_psi = jax.vmap(pushed, (None, 0), 1)(jnp.zeros_like(values), units)
    known_drop = at_rest - jnp.sum(by_parameter * values[:, None], axis=1)
    return known_drop, by_parameter, by_psi


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
