"""The knee of an inverter's voltage over the phase current, from short windows of the weak form.

Windows that null the sixth harmonic show what dead time is worth along the current, and hardly its
shape: knees that differ by 3 % in R explain them alike. Windows of about one period of it see the
phases cross zero; in shorter ones the trapezoidal rule shows. Beside a knee, which ends at a
constant voltage, the law of a junction goes on rising with the logarithm of the current.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.pmsm.balance.doubt import CLEAR, NOTICED, Doubt, probability, share
from penode.pmsm.balance.voltage_balance import (
    BalanceForm,
    PolynomialMap,
    joint_equations,
    short_window,
    term_columns,
    waves,
)
from penode.pmsm.machine.dead_time import FOLDS, DeadTime, PhaseDeadTime, PhaseSigns
from penode.pmsm.machine.space_vectors import CURRENTS
from penode.pmsm.machine.term_registry import completed, physical_values
from penode.pmsm.machine.terms import ANGLE, Term
from penode.training.weak_form import OVERLAP, HannWindow

#: Harmonics of the machine that short windows see too, and the degree of their coenergies.
_HARMONICS, _DEGREE = (6, 12), 4
#: Widths of a knee over the largest current.
_WIDTHS = np.geomspace(0.003, 0.3, 10)
#: Probability from which a soft knee, or a tail of an arctan, is trained: its softness may come out
#: as none, but a sharp one cannot become soft.
_THIN = 0.1
#: What is in doubt, and what would settle it.
_Why: TypeAlias = tuple[str, str]
_KNEE = "knee of the dead time", "Record slowly, with amplitudes from near zero to the largest."
_TAIL = "tail of the knee", "Give the inverter's data, or measure its voltage over the current."
#: Largest rise of a device's drop with each e-fold of the current, V, and e-folds between its
#: saturation current and the largest current that are as likely as the usual ones.
_LARGEST_RISE, _OTHER_FOLDS = 0.1, 20.0
#: Share of their mean by which phases have to differ.
_DIFFERENT = 0.02


@dataclass(frozen=True)
class Shaped:
    """The dead time of recordings."""

    # With width, voltages and, where the recordings show it, softness and a junction's law.
    term: PhaseSigns
    # That the knee is another, or its tail.
    doubts: tuple[Doubt, ...]


def with_knee(
    experiments: Sequence[Experiment], terms: Sequence[Term], by_phase: bool = False
) -> Shaped:
    """Return the dead time with the knee and the voltages that short windows show.

    `terms` are those beside the dead time; with `by_phase` each phase has its voltage, even
    where they do not differ clearly.
    """
    search = _Search.of(experiments, terms)
    sharp, soft, whole = search.best()
    free = {knee: search.by_phase(knee.term) for knee in (sharp, soft, whole)}
    # A little softness is one parameter more; an arctan for a tanh is none, and as likely.
    softer = search.share(free[sharp].misfit, free[soft].misfit)
    other = share(free[whole].misfit, free[sharp].misfit)
    same = soft if max(softer, other) > _THIN else sharp
    bent = search.with_junctions(FOLDS)
    if bent and search.clearly(bent, same):
        return search.shaped(bent, by_phase, search.with_junctions(_OTHER_FOLDS), 0.5, _TAIL)
    rivals = [(search.share(same.misfit, bent.misfit), bent)] if bent else []
    rivals += [(softer, soft), (other, whole)] if same is sharp else []
    probable, rival = max(rivals, key=lambda one: one[0], default=(0.0, None))
    return search.shaped(same, by_phase, rival, probable, _KNEE)


def spread_over_knees(
    experiments: Sequence[Experiment], reciprocal: bool, terms: Sequence[Term]
) -> dict[str, float]:
    """Return by how much each parameter of the voltage balance depends on the knee's softness.

    Windows that null the sixth harmonic take the knee as it is given. Without a dead time there is
    no entry.
    """
    dead = next((term for term in terms if isinstance(term, PhaseSigns)), None)
    if dead is None:
        return {}
    ends = [
        BalanceForm.of(
            experiments,
            reciprocal,
            [replace(t, dead_time_softness=s) if t is dead else t for t in terms],
        ).solve(experiments)
        for s in (np.zeros(()), np.ones(()))
    ]
    sharp, soft = (end.values for end in ends)
    return {name: abs(soft[name] - sharp[name]) for name in sharp}


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A dead time with the voltages and the softness that fit best, and -2 log likelihood."""

    term: PhaseSigns
    misfit: float


@dataclass(frozen=True, eq=False)
class _Search:
    """Short windows of recordings, with what map and other terms explain taken off."""

    experiments: Sequence[Experiment]
    windows: Sequence[int]
    reach: float
    basis: FloatArray
    left: FloatArray
    pairs: dict[float, tuple[FloatArray, FloatArray]] = field(default_factory=dict)

    @classmethod
    def of(cls, experiments: Sequence[Experiment], terms: Sequence[Term]) -> "_Search":
        reach = max(float(np.abs(e.stack(CURRENTS)).max()) for e in experiments)
        every = tuple(term.prepared(reach) for term in completed(terms))
        window = partial(short_window, order=min(_HARMONICS))
        whole = joint_equations(experiments, every, partial(_map_columns, reach=reach), window)
        size = np.maximum(np.linalg.norm(whole.matrix, axis=0), 1e-300)
        basis = np.linalg.qr(whole.matrix / size)[0]
        left = whole.target - basis @ (basis.T @ whole.target)
        return cls(experiments, [window(e) for e in experiments], reach, basis, left)

    def best(self) -> tuple[_Fitted, ...]:
        """Return the best knees, sharp, of any softness and wholly soft, with one voltage."""
        widths = self.reach * _WIDTHS
        tried = [self.fitted(width) for width in widths]
        return tuple(
            self.fitted(_least(widths, [one[k].misfit for one in tried]))[k] for k in range(3)
        )

    def fitted(self, width: float) -> tuple[_Fitted, ...]:
        """Return the knees of a width: sharp, of any softness, and wholly soft."""
        sharp, soft = self._pair(width)
        (of_sharp, of_soft), _ = self._solved(np.stack([sharp, soft], axis=1))
        softness = float(np.clip(of_soft / (of_sharp + of_soft or 1.0), 0.0, 1.0))
        found = []
        of_any = (softness, sharp + softness * (soft - sharp))
        for s, column in ((None, sharp), of_any, (1.0, soft)):
            (voltage,), misfit = self._solved(column[:, None])
            found.append(_Fitted(DeadTime(dead_time_voltage=voltage, **_knee(width, s)), misfit))
        return tuple(found)

    def with_junctions(self, folds: float) -> _Fitted | None:
        """Return the best knee beside a junction's law, None where that would be negative."""
        widths = self.reach * _WIDTHS
        law = {"junction_voltage": 1.0, "junction_folds": folds}
        rise = self._known({**_knee(self.reach, None), **law})
        tried = [self._beside_junctions(width, law, rise) for width in widths]
        misfits = [np.inf if one is None else one.misfit for one in tried]
        if not np.isfinite(min(misfits)):
            return None
        return self._beside_junctions(_least(widths, misfits), law, rise)

    def _beside_junctions(
        self, width: float, law: Mapping[str, float], rise: FloatArray
    ) -> _Fitted | None:
        """Return the best knee of a width beside a law, None where a voltage would be negative."""
        sharp, soft = self._pair(width)
        (of_sharp, of_soft, _), _ = self._solved(np.stack([sharp, soft, rise], axis=1))
        softness = float(np.clip(of_soft / (of_sharp + of_soft or 1.0), 0.0, 1.0))
        column = sharp + softness * (soft - sharp)
        (voltage, size), misfit = self._solved(np.stack([column, rise], axis=1))
        if size > _LARGEST_RISE:
            size = _LARGEST_RISE
            (voltage,), misfit = self._solved(column[:, None], size * rise)
        if min(voltage, size) <= 0.0:
            return None
        knee = {**_knee(width, softness or None), **law, "junction_voltage": size}
        return _Fitted(DeadTime(dead_time_voltage=voltage, **knee), misfit)

    def shaped(
        self, same: _Fitted, by_phase: bool, rival: _Fitted | None, share: float, why: _Why
    ) -> Shaped:
        """Return a dead time, of phases that differ where they do, and the doubt of a rival."""
        free = self.by_phase(same.term)
        apart = by_phase or self.phases_differ(same, free)
        term = free.term if apart else same.term
        if rival is None or share < NOTICED:
            return Shaped(term, ())
        other = self.by_phase(rival.term).term if apart else rival.term
        return Shaped(term, (Doubt(*why, other, term, math.sqrt(share)),))

    def share(self, plain: float, richer: float) -> float:
        """Return how probable a further parameter is, by -2 log likelihoods."""
        if richer > plain:  # another best width may fit worse
            return probability(0.0, len(self.left) / OVERLAP) * math.exp(0.5 * (plain - richer))
        return probability(math.sqrt(plain - richer), len(self.left) / OVERLAP)

    def clearly(self, richer: _Fitted, plain: _Fitted) -> bool:
        """Return whether a further parameter is needed beyond chance."""
        return richer.misfit < plain.misfit - np.log(len(self.left) / OVERLAP) - CLEAR

    def by_phase(self, term: PhaseSigns) -> _Fitted:
        """Return a dead time of the same knee with a voltage a phase."""
        knee = knee_of(term)
        known = self._known(knee) if term.junction_voltage is not None else 0.0
        (a, b, c), misfit = self._solved(self._columns(knee), known)
        voltages = {"dead_time_voltage_a": a, "dead_time_voltage_b": b, "dead_time_voltage_c": c}
        return _Fitted(PhaseDeadTime(**voltages, **knee), misfit)

    def phases_differ(self, same: _Fitted, free: _Fitted) -> bool:
        """Return whether a voltage a phase is clear, and differs enough to matter."""
        voltages = np.array([*physical_values((free.term,)).values()])
        apart = np.abs(voltages - voltages.mean()).max() > _DIFFERENT * abs(voltages.mean())
        price = 2 * np.log(len(self.left) / OVERLAP) + CLEAR
        return bool(apart and free.misfit < same.misfit - price)

    def _pair(self, width: float) -> tuple[FloatArray, FloatArray]:
        """Return what a volt in every phase adds, with a sharp knee of a width and a soft one."""
        if width not in self.pairs:
            sharp, soft = (self._columns(_knee(width, s)).sum(axis=1) for s in (None, 1.0))
            self.pairs[width] = sharp, soft
        return self.pairs[width]

    def _columns(self, knee: Mapping[str, Any]) -> FloatArray:
        """Return what each phase's voltage adds to the equations, and the rest does not explain."""
        return self._equations(knee, 1)

    def _known(self, knee: Mapping[str, Any]) -> FloatArray:
        """Return what a knee's junctions add to the equations, and the rest does not explain."""
        return self._equations(knee, 0)[:, 0]

    def _equations(self, knee: Mapping[str, Any], part: int) -> FloatArray:
        """Return columns of a knee, of `term_columns` the known drop or that by parameter."""
        term = PhaseDeadTime(**knee)
        if term.junction_voltage is not None:
            term = term.prepared(self.reach)
        parts = []
        for e, length in zip(self.experiments, self.windows, strict=True):
            drops = term_columns(e, (term,))[part]
            drops = drops.reshape(*drops.shape[:2], -1)
            columns = -HannWindow(e.time_step, length).of_supply(drops)
            parts.append(columns.reshape(-1, columns.shape[2]))
        columns = np.concatenate(parts)
        return np.asarray(columns - self.basis @ (self.basis.T @ columns))

    def _solved(
        self, columns: FloatArray, known: FloatArray | float = 0.0
    ) -> tuple[FloatArray, float]:
        """Return the voltages that fit best, and -2 log likelihood."""
        wanted = self.left - known
        voltages = np.asarray(np.linalg.lstsq(columns, wanted, rcond=None)[0], dtype=float)
        left = wanted - columns @ voltages
        squares = max(float(left @ left), 1e-300)
        return voltages, len(left) / OVERLAP * float(np.log(squares))


def knee_of(term: PhaseSigns) -> dict[str, Any]:
    """Return what shapes a dead time, by the names of its fields."""
    names = ("dead_time_current", "dead_time_softness", "junction_voltage", "junction_folds")
    return {name: getattr(term, name) for name in names}


def _knee(width: float, softness: float | None) -> dict[str, Any]:
    return {"dead_time_current": width, "dead_time_softness": softness}


def _least(at: FloatArray, values: Sequence[float]) -> float:
    """Return where values on a geometric grid are least, by a parabola through the three least."""
    k = int(np.argmin(values))
    if not 0 < k < len(values) - 1 or not np.isfinite(values[k - 1 : k + 2]).all():
        return float(at[k])
    before, here, after = values[k - 1 : k + 2]
    step = 0.5 * (before - after) / (before - 2 * here + after)
    return float(at[k] * (at[1] / at[0]) ** step)


def _map_columns(experiment: Experiment, reach: float) -> FloatArray:
    """Return the flux linkage of coefficients of a mean map and of its harmonics."""
    currents = experiment.stack(CURRENTS)
    mean, small = (PolynomialMap(True, reach, d).basis(currents) for d in (None, _DEGREE))
    turning = waves(experiment.channels[ANGLE.name], _HARMONICS)
    harmonics = (turning[:, None, :, None] * small[:, :, None]).reshape(*small.shape[:2], -1)
    return np.concatenate([mean, harmonics], axis=2)
