"""The knee of an inverter's voltage over the phase current, from short windows of the weak form.

Windows that null the sixth harmonic show what dead time is worth along the current, and hardly its
shape: knees that differ by 3 % in R explain them alike. Windows of about one period of it see the
phases cross zero; in shorter ones the trapezoidal rule shows. Beside a knee, which ends at a
constant voltage, the law of a junction goes on rising with the logarithm of the current.
"""

import math
from collections.abc import Callable, Mapping, Sequence
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
from penode.pmsm.machine.dead_time import FOLDS, TAILS, DeadTime, PhaseDeadTime, PhaseSigns
from penode.pmsm.machine.space_vectors import CURRENTS
from penode.pmsm.machine.term_registry import completed, physical_values
from penode.pmsm.machine.terms import ANGLE, Term
from penode.training.weak_form import OVERLAP, HannWindow

#: Harmonics of the machine that short windows see too, and the degree of their coenergies.
_HARMONICS, _DEGREE = (6, 12), 4
#: Widths of a knee over the largest current.
_WIDTHS = np.geomspace(0.003, 0.3, 10)
#: Rounds in which the best is sought between neighbours, and widths in each: to 1 %.
_ROUNDS, _BETWEEN = 3, 9
#: Probability from which a soft knee, or a tail, is trained: its softness may come out
#: as none, but a sharp one cannot become soft.
_THIN = 0.1
#: What is in doubt, and what would settle it.
_Why: TypeAlias = tuple[str, str]
_KNEE = (
    "knee of the dead time",
    "Record at low speed of the shaft, with amplitudes from near zero to the largest.",
)
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
    sharp, *tails = search.best()
    softs, wholes = tails[::2], tails[1::2]
    free = {knee: search.by_phase(knee.term).misfit for knee in (sharp, *tails)}
    # A little softness is one parameter more; a tail for a tanh is none, and as likely.
    bent = [(search.share(free[sharp], free[soft]), soft) for soft in softs]
    bent += [(share(free[whole], free[sharp]), whole) for whole in wholes]
    likeliest = max(bent, key=lambda one: one[0])
    same, *_ = sorted(softs, key=lambda soft: free[soft])
    # Another tail of a knee without any softness is that knee again: it is in doubt as a whole.
    others = [
        soft if soft.term.dead_time_softness else whole
        for soft, whole in zip(softs, wholes, strict=True)
        if soft.tail != same.tail
    ]
    rivals = [(share(free[other], free[same]), other) for other in others]
    if likeliest[0] <= _THIN:
        same, rivals = sharp, [likeliest]
    beside = (search.with_junctions(FOLDS, tail) for tail in TAILS)
    junctions = sorted(filter(None, beside), key=lambda one: one.misfit)
    if not (junctions and search.clearly(junctions[0], same)):
        rivals += [(search.share(same.misfit, one.misfit), one) for one in junctions[:1]]
        return search.shaped(same, by_phase, rivals, _KNEE)
    same, *others = junctions
    rivals = [(share(other.misfit, same.misfit), other) for other in others]
    rivals += [(0.5, one) for one in [search.with_junctions(_OTHER_FOLDS, same.tail)] if one]
    return search.shaped(same, by_phase, rivals, _TAIL)


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

    @property
    def tail(self) -> str:
        return self.term.dead_time_tail


@dataclass(frozen=True, eq=False)
class _Search:
    """Short windows of recordings, with what map and other terms explain taken off."""

    experiments: Sequence[Experiment]
    windows: Sequence[int]
    reach: float
    basis: FloatArray
    left: FloatArray
    kinds: dict[float, list[FloatArray]] = field(default_factory=dict)

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
        """Return the best knees with one voltage, in the order of `fitted`."""
        count = len(self.fitted(self.reach * _WIDTHS[0]))
        return tuple(self.fitted(self._width(self.fitted, k))[k] for k in range(count))

    def fitted(self, width: float) -> tuple[_Fitted, ...]:
        """Return the knees of a width: sharp, and of any softness and wholly soft of each tail."""
        sharp, *softs = self._kinds(width)
        kinds: list[tuple[float | None, str, FloatArray]] = [(None, "arctan", sharp)]
        for tail, soft in zip(TAILS, softs, strict=True):
            (of_sharp, of_soft), _ = self._solved(np.stack([sharp, soft], axis=1))
            softness = float(np.clip(of_soft / (of_sharp + of_soft or 1.0), 0.0, 1.0))
            kinds += [(softness, tail, sharp + softness * (soft - sharp)), (1.0, tail, soft)]
        found = []
        for size, tail, column in kinds:
            (voltage,), misfit = self._solved(column[:, None])
            knee = _knee(width, size, tail)
            found.append(_Fitted(DeadTime(dead_time_voltage=voltage, **knee), misfit))
        return tuple(found)

    def with_junctions(self, folds: float, tail: str) -> _Fitted | None:
        """Return the best knee beside a junction's law, None where that would be negative."""
        law = {"junction_voltage": 1.0, "junction_folds": folds}
        rise = self._known({**_knee(self.reach, None), **law})

        def beside(width: float) -> tuple[_Fitted | None]:
            return (self._beside_junctions(width, tail, law, rise),)

        return beside(self._width(beside, 0))[0]

    def _width(self, fitted: Callable[[float], Sequence["_Fitted | None"]], k: int) -> float:
        """Return the width at which a knee fits best, on grids that get finer about it."""

        def misfit(width: float) -> float:
            found = fitted(width)[k]
            return np.inf if found is None else found.misfit

        at = self.reach * _WIDTHS
        for _ in range(_ROUNDS):
            n = int(np.argmin([misfit(width) for width in at]))
            best, low, high = at[n], at[max(n - 1, 0)], at[min(n + 1, len(at) - 1)]
            at = np.geomspace(low, high, _BETWEEN)
        return float(min([best, *at], key=misfit))

    def _beside_junctions(
        self, width: float, tail: str, law: Mapping[str, float], rise: FloatArray
    ) -> _Fitted | None:
        """Return the best knee of a width beside a law, None where a voltage would be negative."""
        sharp, *softs = self._kinds(width)
        soft = softs[list(TAILS).index(tail)]
        (of_sharp, of_soft, _), _ = self._solved(np.stack([sharp, soft, rise], axis=1))
        softness = float(np.clip(of_soft / (of_sharp + of_soft or 1.0), 0.0, 1.0))
        column = sharp + softness * (soft - sharp)
        (voltage, size), misfit = self._solved(np.stack([column, rise], axis=1))
        if size > _LARGEST_RISE:
            size = _LARGEST_RISE
            (voltage,), misfit = self._solved(column[:, None], size * rise)
        if min(voltage, size) <= 0.0:
            return None
        knee = {**_knee(width, softness or None, tail), **law, "junction_voltage": size}
        return _Fitted(DeadTime(dead_time_voltage=voltage, **knee), misfit)

    def shaped(
        self, same: _Fitted, by_phase: bool, rivals: Sequence[tuple[float, _Fitted]], why: _Why
    ) -> Shaped:
        """Return a dead time, of phases that differ where they do, and the doubts of rivals."""
        apart = by_phase or self.phases_differ(same, self.by_phase(same.term))

        def term_of(one: _Fitted) -> PhaseSigns:
            return self.by_phase(one.term).term if apart else one.term

        term = term_of(same)
        instead = term.prepared(self.reach)
        doubts = (
            Doubt(*why, term_of(rival).prepared(self.reach), instead, math.sqrt(probable))
            for probable, rival in rivals
            if probable >= NOTICED
        )
        return Shaped(term, tuple(doubts))

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

    def _kinds(self, width: float) -> list[FloatArray]:
        """Return what a volt in every phase adds: with a sharp knee of a width, and each tail."""
        if width not in self.kinds:
            knees = [_knee(width, None), *(_knee(width, 1.0, tail) for tail in TAILS)]
            self.kinds[width] = [self._columns(knee).sum(axis=1) for knee in knees]
        return self.kinds[width]

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
    junctions = ("junction_voltage", "junction_folds")
    names = ("dead_time_current", "dead_time_softness", "dead_time_tail", *junctions)
    return {name: getattr(term, name) for name in names}


def _knee(width: float, softness: float | None, tail: str = "arctan") -> dict[str, Any]:
    size = {"dead_time_current": width, "dead_time_softness": softness}
    return {**size, "dead_time_tail": tail}


def _map_columns(experiment: Experiment, reach: float) -> FloatArray:
    """Return the flux linkage of coefficients of a mean map and of its harmonics."""
    currents = experiment.stack(CURRENTS)
    mean, small = (PolynomialMap(True, reach, d).basis(currents) for d in (None, _DEGREE))
    turning = waves(experiment.channels[ANGLE.name], _HARMONICS)
    harmonics = (turning[:, None, :, None] * small[:, :, None]).reshape(*small.shape[:2], -1)
    return np.concatenate([mean, harmonics], axis=2)
