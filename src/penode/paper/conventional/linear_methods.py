"""Methods that are one linear least-squares problem, and their result as a `Fit`.

With psi = psi_d + j psi_q the voltage equation is d psi/dt = u - R i - j omega psi. With a flux map
that is linear in its coefficients it is linear in R and these; nothing is trained.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from penode.arrays import ComplexArray, FloatArray
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.fit.fit import Estimate, Fit, HorizonChoice, HorizonSummary
from penode.fit.provenance import provenance_of
from penode.horizon.ladder import Observer, ignore_events
from penode.horizon.loss_weighting import linearised
from penode.models.base import LearnedMap
from penode.paper.conventional.linear_maps import LinearMap, coenergy_polynomial, polynomial
from penode.pmsm.balance.voltage_balance import balance_equations, harmonic_window
from penode.pmsm.machine.dead_time import DeadTime
from penode.pmsm.machine.flux_maps import FluxMap
from penode.pmsm.machine.holds import HOLDS
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.space_vectors import CURRENTS
from penode.pmsm.machine.term_registry import completed, with_physical
from penode.pmsm.machine.terms import Resistance, Term
from penode.pmsm.recording.channels import drive_recording, require_channels
from penode.predictors.base import Predictor
from penode.training.weak_form import WeakRegression, join
from penode.validation.coverage import thin
from penode.validation.free_run import compare
from penode.validation.residual_tests import residual_correlations, residual_spectrum


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Resistance and map as linear least squares gives them."""

    # Its name in the provenance.
    method: str
    # Currents over `current_scale`, A, to flux linkages, Vs.
    network: LearnedMap
    current_scale: float
    # R and its standard deviation, ohm.
    resistance: float
    deviation: float
    # Share of the resistance's regressor that no regressor of the map explains.
    identifiability: float
    # Why there is no horizon to choose, as a sentence.
    reason: str
    facts: Mapping[str, Any] = field(default_factory=dict)
    # Of the voltage equation beside resistance and rotation, and their physical parameters.
    terms: tuple[Term, ...] = ()
    beside: Mapping[str, Estimate] = field(default_factory=dict)

    def to_fit(self, experiments: Sequence[Experiment], validation: Sequence[Experiment]) -> Fit:
        """Return the fit, every recording predicted by the classic Runge-Kutta method."""
        flux_map = FluxMap(self.network, self.current_scale, 1.0)
        model = Machine(flux_map, (Resistance(self.resistance), *self.terms))
        estimate = Estimate.of(
            self.resistance, self.deviation, "ohm", self.identifiability, "stator resistance"
        )
        parameters = {"R": estimate, **self.beside}
        predictor = Predictor(experiments[0].time_step, hold=HOLDS["dq"])
        seen = [compare(predictor, model, e, "train") for e in experiments]
        unseen = [compare(predictor, model, e) for e in validation]
        free = float(np.sqrt(np.mean([c.free_run_rmse**2 for c in seen])))
        rung = HorizonSummary(
            horizon=1,
            parameters={name: one.value for name, one in parameters.items()},
            std={name: one.std for name, one in parameters.items()},
            rmse=float(np.sqrt(np.mean([c.one_step_rmse**2 for c in seen]))),
            free_run_rmse=free if np.isfinite(free) else None,
            iterations=1,
            outcome="Linear least squares: solved in one step.",
        )
        speed = float(np.median(np.abs(experiments[0].channels["omega_el"])))
        return Fit(
            model=model,
            parameters=parameters,
            horizon=HorizonChoice(1, "fixed", self.reason, (rung,), (1,)),
            excited=thin(np.concatenate([e.stack(Machine.states) for e in experiments])),
            comparisons=(*seen, *unseen),
            spectrum=residual_spectrum(seen[0]),
            correlations=residual_correlations(seen[0], experiments[0], model.inputs),
            transitions=linearised(predictor, model, experiments[0], np.ones(2)),
            warnings=tuple(
                f"{c.name}: the free run diverges; the map is unusable for simulation there."
                for c in (*seen, *unseen)
                if c.diverged
            ),
            provenance={
                "method": self.method,
                **provenance_of((*experiments, *validation)),
                "hold": "dq",
                "electrical_frequency_hz": speed / (2 * np.pi),
                **self.facts,
            },
        )


class LinearMethod(ABC):
    """A method that solves for R and map at once; voltages are held in the rotor frame."""

    def identify(
        self,
        experiments: Sequence[Experiment],
        validation: Sequence[Experiment] = (),
        observer: Observer = ignore_events,
    ) -> Fit:
        """Return the fit of recordings of a drive; those for validation are predicted only."""
        if not experiments:
            raise InputError("at least one recording is needed, got none.")
        runs, unseen = ([drive_recording(e) for e in part] for part in (experiments, validation))
        return self.solved(runs).to_fit(runs, unseen)

    @abstractmethod
    def solved(self, runs: Sequence[Experiment]) -> LinearFit:
        """Return resistance and map before anything is predicted."""


@dataclass(frozen=True)
class FluxPredictor(LinearMethod):
    """Least squares of the flux linkage one step ahead: the one-step flux predictor.

    Over one sample the voltage equation gives, exactly, with z = -j omega T,

        psi(i_(k+1)) = exp(z) psi(i_k) + int_0^T exp(z (1 - s/T)) (u - R i) ds.

    For currents that are straight between samples this is one linear equation a sample: the flux
    predictor of Ortombina et al. 2020 and Montecchio 2025 (paper, section 4.2), NARX training,
    H = 1, in the flux linkages instead of the currents.
    """

    basis: LinearMap = field(default_factory=polynomial)

    def solved(self, runs: Sequence[Experiment]) -> LinearFit:
        """Return resistance and map; see `LinearMethod`."""
        scale = largest_current(runs)
        equations = join([flux_equations(e, self.basis, scale) for e in runs])
        solution = _solution(equations, runs, f"a smaller basis than this {self.basis.name}")
        return LinearFit(
            method=f"flux predictor, {self.basis.name}",
            network=self.basis.weighted(solution[1:]),
            current_scale=scale,
            resistance=float(solution[0]),
            deviation=equations.deviation(0),
            identifiability=equations.independence(0),
            reason="Linear least squares of the flux one step ahead has no horizon but 1.",
        )


def flux_equations(experiment: Experiment, basis: LinearMap, scale: float) -> WeakRegression:
    """Return the balance of each sample, linear in R and the map's coefficients.

    One unit of the map's inputs is `scale`, A. Two rows a sample, d and q in Vs; columns R in
    ohm, then the coefficients in Vs.
    """
    currents = experiment.stack(CURRENTS)
    drive = experiment.stack(("u_d", "u_q", "omega_el"))[:-1]
    turn = np.asarray(-1j * experiment.time_step * drive[:, 2], dtype=np.complex128)
    voltage, current = drive[:, 0] + 1j * drive[:, 1], currents[:, 0] + 1j * currents[:, 1]
    within = held(turn)
    columns = basis.columns(currents / scale)
    psi = columns[:, 0] + 1j * columns[:, 1]
    rise = psi[1:] - np.exp(turn)[:, None] * psi[:-1]
    drop = experiment.time_step * (within * current[:-1] + rising(turn) * np.diff(current))
    supply = np.asarray(experiment.time_step * voltage * within, dtype=np.complex128)
    matrix: ComplexArray = np.concatenate([drop[:, None], rise], axis=1).astype(np.complex128)
    rows = np.stack([matrix.real, matrix.imag], axis=1).reshape(-1, matrix.shape[1])
    return WeakRegression(rows, np.stack([supply.real, supply.imag], axis=1).ravel())


def held(z: ComplexArray) -> ComplexArray:
    """Return int_0^1 exp(z (1 - s)) ds = (exp(z) - 1) / z, 1 at zero.

    z is -j omega T for a frame that turns by omega T while a value is held.
    """
    safe = np.where(z == 0, 1.0, z)
    return np.asarray(np.where(z == 0, 1.0, np.expm1(safe) / safe))


def rising(z: ComplexArray) -> ComplexArray:
    """Return int_0^1 exp(z (1 - s)) s ds = (exp(z) - 1 - z) / z^2, 1/2 at zero.

    Below 1e-3 the series stands in, where the difference would cancel.
    """
    small = np.abs(z) < 1e-3
    safe = np.where(small, 1.0, z)
    series: ComplexArray = 1 / 2 + z / 6 + z**2 / 24
    return np.asarray(np.where(small, series, (np.expm1(safe) - safe) / safe**2))


@dataclass(frozen=True)
class CoenergyLeastSquares(LinearMethod):
    """Least squares of the voltage equation over short windows, with a polynomial coenergy.

    Multiplied by a Hann window and integrated by parts over two periods of the sixth harmonic
    (`penode.training.weak_form`) the equation needs no derivative of a measurement, and what
    slotting and dead time add to all orders that the window nulls leaves R and the map alone. The
    coenergy makes the map reciprocal, which is what separates R from it at one speed; it is even in
    i_q, the machine being symmetric about its d axis. This is what a trained map has to be better
    than.
    """

    degree: int = 8
    # Whether the dead-time voltage is identified too; the recordings then need theta_el.
    inverter: bool = False

    def solved(self, runs: Sequence[Experiment]) -> LinearFit:
        """Return resistance and map; see `LinearMethod`."""
        scale, basis = largest_current(runs), coenergy_polynomial(self.degree)
        terms = (DeadTime().prepared(scale),) if self.inverter else ()
        require_channels(runs, terms)
        equations = join([coenergy_equations(e, basis, scale, terms) for e in runs])
        smaller = f"a coenergy of a smaller degree than {self.degree}"
        solution = _solution(equations, runs, smaller)
        first, beside = 1 + len(terms), {}
        if terms:
            deviation, share = equations.deviation(1), equations.independence(1)
            beside["dead_time_voltage"] = Estimate.of(
                float(solution[1]), deviation, "V", share, "dead-time voltage of a phase"
            )
        return LinearFit(
            method="least squares of a polynomial coenergy",
            network=basis.weighted(solution[first:]),
            current_scale=scale,
            resistance=float(solution[0]),
            deviation=equations.deviation(0),
            identifiability=equations.independence(0),
            reason="Linear least squares over short windows predicts nothing, so there is no "
            "horizon.",
            terms=with_physical(terms, solution[1:first]),
            beside=beside,
        )


def coenergy_equations(
    experiment: Experiment, basis: LinearMap, scale: float, terms: Sequence[Term] = ()
) -> WeakRegression:
    """Return the voltage equation over short windows, linear in R and the map's coefficients.

    u_d and u_q are the mean voltages of each sample in the rotor frame; one unit of the map's
    inputs is `scale`, A; `terms` are prepared. Two rows a window, d and q in Vs; columns R in
    ohm, the terms' parameters in SI units, then the coefficients in Vs.
    """
    columns = basis.columns(experiment.stack(CURRENTS) / scale)
    return balance_equations(experiment, completed(terms), columns, harmonic_window(experiment))


def _solution(equations: WeakRegression, runs: Sequence[Experiment], smaller: str) -> FloatArray:
    """Return the least-squares solution; fewer equations than unknowns are refused.

    `smaller` is what would have fewer unknowns.
    """
    rows, unknowns = equations.matrix.shape
    if rows < unknowns:
        raise InputError(
            f"{runs[0].name}: at least as many equations as the {unknowns} unknowns are needed, "
            f"got {rows}; record for longer, or use {smaller}."
        )
    return equations.solve()


def largest_current(experiments: Sequence[Experiment]) -> float:
    """Return the largest |i_d| or |i_q| in A."""
    return max(float(np.abs(e.stack(Machine.states)).max()) for e in experiments)
