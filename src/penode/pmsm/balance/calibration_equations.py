"""Equations of what a recording has to be corrected by, beside those of the map.

A voltage that acts tau samples later than it is recorded, and turned by kappa omega T, is to first
order u - tau T du/dt + kappa omega T J u, linear in both. With the d axis at delta before that of
the recording the map is psi + delta (J psi - L J i), and with iron that takes g v of the current,
v the induced voltage, it is psi - g L v: linear too, where psi and L are those of the round before.
Currents measured too large by d leave psi - L d and the voltage R d: with unequal phase gains
d turns backwards, and an offset stands still, in the stationary frame.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.pmsm.balance.doubt import probability
from penode.pmsm.balance.drift import drift_columns
from penode.pmsm.balance.equations import balance_equations
from penode.pmsm.balance.linkage import Linkage
from penode.pmsm.balance.smoothing import Roughness, deviations, smoothed
from penode.pmsm.balance.voltage_balance import harmonic_window
from penode.pmsm.machine.coenergy_map import (
    MEAN,
    CoenergyPart,
    columns,
    roughness,
)
from penode.pmsm.machine.dead_time import PhaseDeadTime
from penode.pmsm.machine.frames import quarter_turned
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES, with_mismatch, with_offset
from penode.pmsm.machine.term_registry import completed, physical_values
from penode.pmsm.machine.terms import ANGLE, SPEED, Term
from penode.training.weak_form import OVERLAP, WeakRegression, join, weak_regression

#: Rounds in which map and errors follow each other.
_ROUNDS = 2
#: Errors that bend the map.
ERRORS = ("angle", "iron")
#: What iron may take current by.
IRON = {"iron": "the induced voltage", "iron_of_rotation": "the voltage that rotation induces"}
#: Errors of the phases' current sensors, both axes each.
SENSORS = {"mismatch": ("mismatch_d", "mismatch_q"), "offset": ("offset_d", "offset_q")}


@dataclass(frozen=True, eq=False)
class Estimate:
    """Errors of recordings as the weak form gives them, and the map beside."""

    values: Mapping[str, float]
    deviation: Mapping[str, float]
    evidence: float
    equations: int
    resistance: float
    linkage: Linkage

    def probability(self, name: str) -> float:
        """Return how probable an error is."""
        deviations = self.values[name] / max(self.deviation[name], 1e-300)
        return probability(deviations, self.equations / OVERLAP)

    def axes(self, kind: str) -> tuple[complex, float]:
        """Return an error of the sensors, and the larger deviation of its axes."""
        d, q = SENSORS[kind]
        return self.values[d] + 1j * self.values[q], max(self.deviation[d], self.deviation[q])


@dataclass(frozen=True, eq=False)
class Balance:
    """The weak form of recordings with a mirror symmetric map."""

    experiments: Sequence[Experiment]
    terms: tuple[Term, ...]
    part: CoenergyPart
    reach: float

    @classmethod
    def of(cls, experiments: Sequence[Experiment], terms: Sequence[Term]) -> "Balance":
        """Return the balance of recordings with some terms, dead time beside them if it can be."""
        angle = all(ANGLE.name in e.channels for e in experiments)
        roles = {term.role for term in terms}
        extra = (PhaseDeadTime(),) if angle and PhaseDeadTime.role not in roles else ()
        reach = max(float(np.abs(e.stack(CURRENTS)).max()) for e in experiments)
        every = tuple(term.prepared(reach) for term in completed((*terms, *extra)))
        return cls(experiments, every, CoenergyPart.zero(MEAN, True), reach)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Errors of the current sensors that can be estimated: all, where the angle is known."""
        angle = all(ANGLE.name in e.channels for e in self.experiments)
        return tuple(name for axes in SENSORS.values() for name in axes) if angle else ()

    def solved(self, names: Sequence[str], before: Estimate | None = None) -> Estimate:
        """Estimate the named errors; the sensors' and the map's own need the round before."""
        sensors = self.sensors if before else ()
        names = (*sensors, *names)
        rows = [
            WeakRegression(
                np.concatenate([self._columns(e, names, before), own.matrix], axis=1), own.target
            )
            for e, own in zip(self.experiments, self._without_errors, strict=True)
        ]
        whole, physical = join(rows), physical_values(self.terms)
        own_first = len(names) + len(self._drifts[0])
        first = own_first + len(physical)
        penalty = [Roughness.of(first, roughness(self.part))]
        free = smoothed(whole, penalty)
        own = deviations(whole, penalty, free)
        return Estimate(
            dict(zip(names, free.solution.tolist(), strict=False)),
            dict(zip(names, own.tolist(), strict=False)),
            free.evidence,
            len(whole.target),
            dict(zip(physical, free.solution[own_first:].tolist(), strict=False)).get("R", 0.0),
            self._linkage(free.solution[first:]),
        )

    def rounds(self, names: Sequence[str], before: Estimate) -> Estimate:
        """Estimate errors that bend the map, which the map follows."""
        for _ in range(_ROUNDS if set(names) & {*ERRORS, *IRON} else 1):
            before = self.solved(names, before)
        return before

    def _linkage(self, coefficients: FloatArray) -> Linkage:
        table = coefficients.reshape(self.part.coefficients.shape)
        return Linkage(replace(self.part, coefficients=table), self.reach)

    @cached_property
    def _without_errors(self) -> tuple[WeakRegression, ...]:
        """The equations of each recording with the columns of drift, terms and map alone."""
        return tuple(
            balance_equations(
                e,
                self.terms,
                columns(self.part, e.stack(CURRENTS) / self.reach),
                harmonic_window(e),
                drifts,
            )
            for e, drifts in zip(self.experiments, self._drifts, strict=True)
        )

    @cached_property
    def _drifts(self) -> list[list[tuple[FloatArray, FloatArray]]]:
        return drift_columns(self.experiments, self.terms)

    def _columns(
        self,
        experiment: Experiment,
        names: Sequence[str],
        before: Estimate | None,
    ) -> FloatArray:
        """Return the columns of the named errors, shape (equation, error)."""
        current, voltage = experiment.stack(CURRENTS), experiment.stack(VOLTAGES)
        nothing, step = np.zeros_like(voltage), experiment.time_step
        speed = experiment.channels[SPEED.name][:, None]
        further = {
            "delay": (step * voltage, nothing),
            "turn": (nothing, step * speed * _j(voltage)),
        }
        if before is not None:
            (psi, slope), resistance = before.linkage.at(experiment), before.resistance
            bent = {
                "angle": _j(psi) - _along(slope, _j(current)),
                "iron": -_along(slope, voltage - resistance * current),
                "iron_of_rotation": -_along(slope, speed * _j(psi)),
            }
            further |= {name: (psi, -speed * _j(psi)) for name, psi in bent.items()}
            for name in self.sensors:
                added = self._added(experiment, name)
                left = -_along(slope, added)
                further[name] = (left, resistance * added - speed * _j(left))
        pairs = [(nothing, nothing), *(further[name] for name in names)]
        stored, supplied = (np.stack(parts, axis=2) for parts in zip(*pairs, strict=True))
        length = harmonic_window(experiment)
        whole = weak_regression(stored, supplied, nothing, experiment.time_step, length)
        return whole.matrix[:, 1:]

    def _added(self, experiment: Experiment, name: str) -> FloatArray:
        """Return the current (time, 2) that a sensors' error of 1 adds."""
        kind, axis = name.split("_")
        size = {"d": 1.0, "q": 1j}[axis]
        if kind == "mismatch":
            changed = with_mismatch(experiment, size)
        else:
            changed = with_offset(experiment, self.reach * size)
        return changed.stack(CURRENTS) - experiment.stack(CURRENTS)


def _j(vectors: FloatArray) -> FloatArray:
    return quarter_turned(vectors.T).T


def _along(slope: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("tij,tj->ti", slope, vectors))
