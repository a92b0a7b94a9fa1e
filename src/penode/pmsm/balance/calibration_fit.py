"""Calibration of a drive from its own recording, estimated with the map by the weak form.

Which imperfections enter is one search: of all sets of candidates the one whose evidence is best,
each candidate at a price. What no drive has, and explains as much as what one has, is a candidate
too, so that it is not taken for that. A mirror symmetric map of splines cannot stand in for any of
them, as a free one would.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import TypeAlias

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.pmsm.balance.calibration import AS_RECORDED, Calibration
from penode.pmsm.balance.doubt import CLEAR, NOTICED, share
from penode.pmsm.balance.drift import drift_columns
from penode.pmsm.balance.smoothing import Roughness, deviations, smoothed
from penode.pmsm.balance.trial_balance import imitated_lag, mean_lag
from penode.pmsm.balance.voltage_balance import Window, harmonic_window, joint_equations
from penode.pmsm.machine.coenergy_map import MEAN, CoenergyPart, columns, roughness
from penode.pmsm.machine.dead_time import MeanDeadTime, PhaseDeadTime
from penode.pmsm.machine.holds import STATIONARY_TURN
from penode.pmsm.machine.linkage import Linkage
from penode.pmsm.machine.space_vectors import CURRENTS, in_frame_ahead
from penode.pmsm.machine.term_registry import completed, physical_values
from penode.pmsm.machine.terms import ANGLE, SPEED, Term
from penode.pmsm.recording.imperfection import UNKNOWN_DRIVE, Column, KnownDrive
from penode.pmsm.recording.imperfections import IMPERFECTIONS, SLOPE
from penode.training.weak_form import HannWindow, WeakRegression, join

#: Deviations that amount to what is clear.
_SIGNIFICANT = CLEAR**0.5
#: Radians a sample below which the rotor stands still.
_STANDSTILL = 1e-4
#: Windows at standstill in samples, each twice the one before: the shortest, most windows of it in
#: all and fewest of the longest in a recording; rounds in which a delay is found.
_SHORTEST, _WINDOWS, _FEWEST, _ROUNDS = 6, 4000, 16, 3


@dataclass(frozen=True)
class _Candidate:
    """Imperfections that enter together."""

    names: tuple[str, ...]
    # Names that it stands for, and is not beside.
    instead: tuple[str, ...] = ()
    # False for what no drive has.
    enters: bool = True
    # -2 log of how likely it is before, beside none.
    price: float = CLEAR

    def beside(self, other: "_Candidate") -> bool:
        """Return whether both can be in one set."""
        return not {*self.names, *self.instead} & {*other.names}


#: When the voltages act, and what bends the map beside it: the angle, and what iron takes current
#: by. Turn and angle that cancel in the voltages may be one thing, the instant at which currents
#: are sampled: at the price of both, as a hold and an offset of the angle may cancel as well.
_TIMING = _Candidate(("delay", "turn"))
_KINDS = ("iron", "iron_of_rotation")
_IRON = tuple(_Candidate((name,), _KINDS) for name in _KINDS)
_SAMPLING = _Candidate(("sampling", "delay"), ("turn", "angle"), enters=False, price=2 * CLEAR)
_ANGLE = _Candidate(("angle",))
_PLACES = (_TIMING, _ANGLE, *_IRON, _SAMPLING)
#: Once voltages are in place, nothing turns them by hundredths of a sample: a turn is iron's rival.
_TURN = _Candidate(("turn",), _KINDS, enters=False)
_LOSSES = (*_IRON, _TURN)

_Set: TypeAlias = tuple[_Candidate, ...]


@dataclass(frozen=True, eq=False)
class _Estimate:
    """Sizes of imperfections as the weak form gives them, with map and R beside."""

    sizes: Mapping[str, complex]
    # The larger of both axes, where there are two.
    deviation: Mapping[str, float]
    evidence: float
    drive: KnownDrive
    # Of each recording, by imperfection and this map and R, as they are needed.
    columns: dict[str, list[FloatArray]] = field(default_factory=dict)

    def __getitem__(self, name: str) -> float:
        """Return the size of an imperfection of one axis."""
        return self.sizes[name].real


@dataclass(frozen=True, eq=False)
class _Balance:
    """The weak form of recordings with a mirror symmetric map."""

    experiments: Sequence[Experiment]
    terms: tuple[Term, ...]
    part: CoenergyPart
    reach: float
    window: Window = harmonic_window

    @classmethod
    def of(cls, experiments: Sequence[Experiment], terms: Sequence[Term]) -> "_Balance":
        """Return the balance of recordings with some terms, an inverter's voltage beside them."""
        angle = all(ANGLE.name in e.channels for e in experiments)
        roles = {term.role for term in terms}
        inverter = PhaseDeadTime() if angle else MeanDeadTime()
        extra = () if inverter.role in roles else (inverter,)
        reach = max(float(np.abs(e.stack(CURRENTS)).max()) for e in experiments)
        every = tuple(term.prepared(reach) for term in completed((*terms, *extra)))
        return cls(experiments, every, CoenergyPart.zero(MEAN, True), reach)

    @property
    def beside(self) -> tuple[str, ...]:
        """Imperfections that are estimated beside all others, such as those of current sensors."""
        every = IMPERFECTIONS.items()
        return tuple(n for n, one in every if one.beside and one.recorded(self.experiments))

    def solved(self, names: Sequence[str], before: _Estimate | None = None) -> _Estimate:
        """Estimate imperfections by name; those beside and of the map need the round before."""
        names = (*(self.beside if before else ()), *names)
        own_columns = [self._columns(name, before) for name in names]
        rows = [
            WeakRegression(np.concatenate([*some, own.matrix], axis=1), own.target)
            for *some, own in zip(*own_columns, self._without, strict=True)
        ]
        whole, physical = join(rows), list(physical_values(self.terms))
        axes = [(name, axis) for name in names for axis in IMPERFECTIONS[name].axes]
        own_first = len(axes) + len(self._drifts[0])
        first = own_first + len(physical)
        penalty = [Roughness.of(first, roughness(self.part))]
        free = smoothed(whole, penalty)
        own = deviations(whole, penalty, free)
        sizes, deviation = dict.fromkeys(names, 0.0 + 0.0j), dict.fromkeys(names, 0.0)
        for (name, axis), size, std in zip(axes, free.solution, own, strict=False):
            sizes[name] += axis * float(size)
            deviation[name] = max(deviation[name], float(std))
        table = free.solution[first:].reshape(self.part.coefficients.shape)
        drive = KnownDrive(
            float(free.solution[own_first + physical.index("R")]) if "R" in physical else 0.0,
            Linkage(replace(self.part, coefficients=table), self.reach),
        )
        return _Estimate(sizes, deviation, free.evidence, drive)

    def credible(self, estimate: _Estimate, name: str) -> bool:
        """Return whether a size is significant, large enough to matter, and not absurd."""
        one, size, own = IMPERFECTIONS[name], estimate.sizes[name], estimate.deviation[name]
        relative, (matters, most) = self._relative(estimate, name), one.credible
        shows = abs(size) > _SIGNIFICANT * own and one.shows(self.experiments)
        return bool(shows and matters < relative < most)

    def possible(self, estimate: _Estimate, names: Sequence[str]) -> bool:
        """Return whether one of some sizes is credible, and none absurd."""
        largest = [
            self._relative(estimate, name) / IMPERFECTIONS[name].credible[1] for name in names
        ]
        return max(largest) < 1.0 and any(self.credible(estimate, name) for name in names)

    def _relative(self, estimate: _Estimate, name: str) -> float:
        size, drive = estimate.sizes[name], estimate.drive
        return IMPERFECTIONS[name].relative(size, self.experiments, drive)

    def _columns(self, name: str, known: _Estimate | None) -> list[FloatArray]:
        """Return an imperfection's columns (equation, axis) of each recording."""
        made, drive = (known.columns, known.drive) if known else ({}, UNKNOWN_DRIVE)
        if name not in made:
            made[name] = []
            for e in self.experiments:
                window = HannWindow(e.time_step, self.window(e))
                each = IMPERFECTIONS[name].columns(e, drive)
                parts = [(window.of_supply(r) + window.of_store(s)).ravel() for s, r in each]
                made[name].append(np.stack(parts, axis=1))
        return made[name]

    @cached_property
    def _without(self) -> tuple[WeakRegression, ...]:
        """The equations of each recording with the columns of drift, terms and map alone."""

        def basis(experiment: Experiment) -> FloatArray:
            return columns(self.part, experiment.stack(CURRENTS) / self.reach)

        return tuple(
            joint_equations([e], self.terms, basis, self.window, [drifts])
            for e, drifts in zip(self.experiments, self._drifts, strict=True)
        )

    @cached_property
    def _drifts(self) -> list[list[Column]]:
        return drift_columns(self.experiments, self.terms)


@dataclass(frozen=True, eq=False)
class _Search:
    """Which imperfections enter, beside those that are estimated always."""

    balance: _Balance
    always: tuple[str, ...] = ()
    first: tuple[str, ...] = _TIMING.names
    tried: dict[_Set, _Estimate] = field(default_factory=dict)

    def of(self, chosen: _Set) -> _Estimate:
        """Return the estimate with a set of candidates; the map follows those that bend it."""
        if chosen not in self.tried:
            further = [name for one in chosen for name in one.names if name not in self.always]
            names = (*self.always, *further)
            self.tried[chosen] = self.balance.solved(names, self.balance.solved(names, self._first))
        return self.tried[chosen]

    def best(self, candidates: _Set) -> _Set:
        """Return those that enter: of all credible sets the one of the best evidence, less price.

        Where one is among them that no drive has, what it stands for does not enter.
        """
        sets = [s for n in range(len(candidates) + 1) for s in combinations(candidates, n)]
        found = min(filter(self._possible, sets), key=self.price)
        for one in found:
            if not one.enters:
                left = (c for c in candidates if c != one and not {*c.names} <= {*one.instead})
                return self.best(tuple(left))
        return found

    @cached_property
    def _first(self) -> _Estimate:
        return self.balance.solved(self.first)

    def _possible(self, chosen: _Set) -> bool:
        apart = all(one.beside(other) for one in chosen for other in chosen if one != other)
        return apart and all(self.balance.possible(self.of(chosen), one.names) for one in chosen)

    def price(self, chosen: _Set) -> float:
        """Return -2 log of how probable a set is, beside the others."""
        return self.of(chosen).evidence + sum(one.price for one in chosen)


def calibration_of(experiments: Sequence[Experiment], terms: Sequence[Term] = ()) -> Calibration:
    """Estimate what the channels of recordings have to be corrected by.

    A dead time among the terms is allowed for where the angle was recorded.
    """
    turning = max(float(np.abs(e.channels[SPEED.name]).max()) * e.time_step for e in experiments)
    if turning <= _STANDSTILL:
        return _at_rest(experiments, terms)
    recorded = _Balance.of(experiments, terms)
    balance = _of_slope(recorded)
    found, free, turned = _placed(balance)
    if found["angle"]:  # known to first order: what is left is seen from the frame that is right
        ahead = found["angle"]
        ahead_of = [in_frame_ahead(e, ahead) for e in balance.experiments]
        found, free, turned = _placed(replace(balance, experiments=ahead_of))
        found = _with(found, angle=ahead + found["angle"])
    result = _refined(replace(found, turned=turned), free, balance)
    if balance is recorded:
        return result
    reason = IMPERFECTIONS["speed_lag"].sentence(1.0, 0.0, UNKNOWN_DRIVE)
    return replace(_with(result, speed_lag=1.0), reasons=(reason, *result.reasons))


def _with(calibration: Calibration, **sizes: complex) -> Calibration:
    """Return a calibration with other sizes, none of 0 among them."""
    every = {**calibration.sizes, **sizes}
    return replace(calibration, sizes={name: size for name, size in every.items() if size})


def _of_slope(balance: _Balance) -> _Balance:
    """Return a balance with the slope of the angle as speed, where that explains more."""
    lag, experiments = IMPERFECTIONS["speed_lag"], balance.experiments
    if not lag.recorded(experiments) or min(map(len, experiments)) <= SLOPE:
        return balance
    matters, most = lag.credible
    if not matters < lag.relative(1.0, experiments, UNKNOWN_DRIVE) < most:
        return balance
    sloped = replace(
        balance, experiments=[lag.corrected(e, 1.0, UNKNOWN_DRIVE) for e in experiments]
    )
    plain, other = (one.solved(_TIMING.names).evidence for one in (balance, sloped))
    return sloped if other < plain - CLEAR else balance


def _placed(balance: _Balance) -> tuple[Calibration, _Estimate, tuple[float, float] | None]:
    """Return when and in which frame the voltages act, and the angle, to first order.

    The estimate is that of delay and turn. Behind it is the turn with its deviation, chosen or not,
    where it tells the frames of the hold apart. Iron loss acts beside them where it is credible.
    """
    search = _Search(balance)
    chosen = search.best(_PLACES)
    found = _timing_of(search.of(chosen), balance.experiments)
    if _TIMING in chosen and found == AS_RECORDED:
        chosen = search.best(tuple(one for one in chosen if one != _TIMING))
    estimate = search.of(chosen)
    alone = search.of((_TIMING,))
    turn, deviation = alone["turn"], alone.deviation["turn"]
    shown = (turn, deviation) if deviation < IMPERFECTIONS["turn"].near else None
    return _with(found, angle=estimate.sizes.get("angle", 0.0).real), estimate, shown


def _timing_of(free: _Estimate, experiments: Sequence[Experiment]) -> Calibration:
    """Return delay, turn and hold that a drive can have, next to those that were estimated.

    A delay that the controller's answer to noise imitates is none.
    """
    sizes, drive = dict[str, complex](), UNKNOWN_DRIVE
    for name in _TIMING.names:
        own, one = free.deviation.get(name, np.inf), IMPERFECTIONS[name]
        if own < one.near:
            sizes[name], drive = one.placed(free[name], experiments, drive)
    delay, own = sizes.get("delay", 0.0).real, free.deviation.get("delay", np.inf)
    if abs(delay) <= _SIGNIFICANT * own or not _acts_late(delay, experiments):
        sizes["delay"] = 0.0
    return _with(Calibration(drive=drive), **sizes)


def _refined(found: Calibration, free: _Estimate, balance: _Balance) -> Calibration:
    """Return a calibration with what shows once voltages and angle are in place."""
    if found != AS_RECORDED:
        placed = [found.acting(found.applied(e)) for e in balance.experiments]
        balance = replace(balance, experiments=placed)
    search = _Search(balance, ("delay", "angle"))
    chosen = search.best(_LOSSES)
    rest = search.of(chosen)
    sizes, deviation = dict[str, complex](), _iron_left(search, chosen)
    for name, more in rest.sizes.items():
        one, own = IMPERFECTIONS[name], rest.deviation[name]
        whole = found[name] + (more if len(one.axes) > 1 else more.real)
        taken = found[name] or (name != "delay" and balance.credible(rest, name))
        sizes[name] = (one.nearest(whole, _SIGNIFICANT * own) if one.exact else whole) * bool(taken)
        deviation.setdefault(name, float(np.hypot(abs(whole - sizes[name]), own)))
    if found["turn"] % 1.0:
        deviation["turn"] = free.deviation["turn"]
    result = _with(found, **sizes)
    delay = (found["delay"] + rest["delay"], rest.deviation["delay"])
    sentences = [
        IMPERFECTIONS[name].sentence(size, deviation[name], rest.drive)
        for name, size in sizes.items()
        if size and name != "delay"
    ]
    drive = replace(found.drive, resistance=rest.drive.resistance, linkage=rest.drive.linkage)
    reasons = (*_timing_sentences(result, delay, free), *sentences)
    return replace(result, drive=drive, deviation=deviation, reasons=reasons)


def _iron_left(search: _Search, chosen: _Set) -> dict[str, float]:
    """Return what iron loss may be off by: averaged over either kind, none, and a turn for it.

    Without saliency a turn stands in for any of it: no more than an ordinary share is believed.
    """
    first, other = sorted(_IRON, key=lambda one: (one not in chosen, search.price((one,))))
    none = min(map(search.price, ((), (_TURN,))))
    (name,), whole = first.names, search.of((first,))
    size, own = whole[name], whole.deviation[name]
    acts, same = (share(search.price((first,)), price) for price in (none, search.price((other,))))
    if not chosen:
        one = IMPERFECTIONS[name]
        usual = one.usual * one.scale(search.balance.experiments, whole.drive)
        return {"iron": float(np.sqrt(acts) * min(np.hypot(size, own), usual))}
    left = {name: float(np.hypot(own, np.sqrt(1 - acts) * size))}
    if 1 - same > NOTICED:
        change = float(np.sqrt(1 - same)) * size
        left["iron_of_change"] = change if name == "iron_of_rotation" else -change
    return left


def _timing_sentences(
    timing: Calibration, delay: tuple[float, float], free: _Estimate
) -> Iterator[str]:
    """Yield what was found of the timing where it is corrected; delay and deviation in samples."""
    middle = timing.drive.ripple != 0.0
    late = timing["delay"]
    taken = [f"a delay of {late:.3g}, beside any in the study file"] if late else []
    taken += [f"a turn of {timing['turn']:.3g}"] if timing["turn"] and not middle else []
    if timing.drive.hold == "stationary":
        about = " about the middle of the sample" if middle else ""
        taken.append(f"a hold in the stationary frame{about}")
    turned = (
        f", turned by the rotation of {free['turn']:.3f} ± {free.deviation['turn']:.3f} samples"
        if len(taken) > bool(late)
        else ""
    )
    if taken:
        yield (
            f"The voltage acts {delay[0]:.3f} ± {delay[1]:.3f} samples after it is recorded"
            f"{turned}: taken into account as {', '.join(taken)}."
        )
    elif delay[1] < IMPERFECTIONS["delay"].near:
        tested = "In which frame it is held does not show."
        if timing.turned is not None:
            turn, own = timing.turned
            tested = (
                f"Tested: it seems turned by {turn:.4f} ± {own:.4f} (std) samples of rotation; "
                f"held in the stationary frame that would be {STATIONARY_TURN}."
            )
        yield (
            "Each voltage acts held in dq during the sample in which it is recorded, beside any "
            f"delay in the study file. {tested}"
        )


def _at_rest(experiments: Sequence[Experiment], terms: Sequence[Term]) -> Calibration:
    """Return delay, angle and iron loss at standstill, all recordings in one regression."""
    one, delay, balance = IMPERFECTIONS["delay"], 0.0, _Balance.of(experiments, terms)
    matters, most = one.credible
    for _ in range(_ROUNDS):  # a delay is known to first order only
        imitated, window = _window_at_rest(balance)
        search = _Search(replace(balance, window=window), ("delay",), ("delay",))
        chosen = search.best((_ANGLE, _IRON[0]))
        whole = search.of(chosen)
        delay += whole["delay"]
        if abs(delay) >= most:
            return AS_RECORDED
        placed = [one.corrected(e, delay, UNKNOWN_DRIVE) for e in experiments]
        balance = replace(balance, experiments=placed)
    names = [name for one in chosen for name in one.names]
    sizes = {name: whole.sizes[name] for name in names}
    deviation = {name: whole.deviation[name] for name in names}
    reasons = [IMPERFECTIONS[n].sentence(sizes[n], deviation[n], whole.drive) for n in names]
    own = math.hypot(whole.deviation["delay"], imitated)
    if abs(delay) > max(matters, _SIGNIFICANT * own):
        size = one.nearest(delay, one.near) if own < one.near else delay
        sizes["delay"] = size
        deviation |= {"delay": own} if size % one.exact else {}
        timing = (
            f"The voltage acts {delay:.3f} ± {own:.3f} samples after it is recorded: taken into "
            f"account as a delay of {size:.3g}."
        )
        reasons.insert(0, timing)
    drive = whole.drive if names else UNKNOWN_DRIVE
    return Calibration(sizes, drive, deviation=deviation, reasons=tuple(reasons))


def _window_at_rest(balance: _Balance) -> tuple[float, Window]:
    """Return the window that shows a delay best, behind the delay that noise may imitate in it.

    That is in samples what a controller's answer to noise looks like, beside the deviation.
    """
    lengths = [len(e) for e in balance.experiments]
    length, tried = max(_SHORTEST, sum(lengths) // _WINDOWS), list[tuple[float, float, int]]()
    while not tried or length <= min(lengths) // _FEWEST:
        window = _of_length(length)
        own = replace(balance, window=window).solved(("delay",)).deviation["delay"]
        imitated = imitated_lag(balance.experiments, window)
        tried.append((math.hypot(own, imitated), imitated, length))
        length *= 2
    _, imitated, length = min(tried)
    return imitated, _of_length(length)


def _of_length(samples: int) -> Window:
    return lambda experiment: min(samples, max(len(experiment) - 1, 1))


def _acts_late(delay: float, experiments: Sequence[Experiment]) -> bool:
    """Return whether a delay is none that the controller's answer to noise imitates.

    It is either larger than noise can imitate in these windows, or that of longer ones too, which
    have less of the noise.
    """
    if abs(delay) > _SIGNIFICANT * imitated_lag(experiments, harmonic_window):
        return True
    lag, own = mean_lag(experiments, in_phases=True)
    near = IMPERFECTIONS["delay"].near
    return own < near and abs(delay + lag) < max(near, _SIGNIFICANT * own)
