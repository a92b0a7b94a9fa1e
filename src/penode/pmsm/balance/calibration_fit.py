"""Calibration of a drive from its own recording, estimated with the map by the weak form.

A mirror symmetric map of splines cannot stand in for any of the imperfections, as a free one would.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.pmsm.balance.calibration import AS_RECORDED, Calibration
from penode.pmsm.balance.doubt import probability
from penode.pmsm.balance.drift import drift_columns
from penode.pmsm.balance.smoothing import Roughness, deviations, smoothed
from penode.pmsm.balance.trial_balance import imitated_lag, mean_lag
from penode.pmsm.balance.voltage_balance import harmonic_window, joint_equations
from penode.pmsm.machine.coenergy_map import MEAN, CoenergyPart, columns, roughness
from penode.pmsm.machine.dead_time import PhaseDeadTime
from penode.pmsm.machine.linkage import Linkage
from penode.pmsm.machine.space_vectors import CURRENTS, in_frame_ahead
from penode.pmsm.machine.term_registry import completed, physical_values
from penode.pmsm.machine.terms import ANGLE, SPEED, Term
from penode.pmsm.recording.imperfection import UNKNOWN_DRIVE, Column, KnownDrive
from penode.pmsm.recording.imperfections import IMPERFECTIONS, SLOPE
from penode.training.weak_form import OVERLAP, HannWindow, WeakRegression, join

#: What each step estimates: when the voltages act, what bends the map beside it, and what iron may
#: take current by.
_TIMING, _ERRORS, _IRON = ("delay", "turn"), ("angle", "iron"), ("iron", "iron_of_rotation")
#: Rounds in which map and imperfections that bend it follow each other.
_ROUNDS = 2
#: -2 log likelihood by which another model of the voltages has to be better.
_CLEAR = 25.0
#: Deviations from which an imperfection is taken into account.
_SIGNIFICANT = 5.0
#: Samples that a timing has to differ by.
_DIFFERENT = 0.2
#: Samples from a whole number, and from half a turn back, that are taken for these.
_NEAR = 0.1
#: Angle in rad that a turn has to amount to where the rotor turns by more than another in a sample.
_ANGLE, _COARSE = np.deg2rad(0.05), 0.35
#: Samples beyond which, and deviation above which, a timing is not believed.
_MOST, _SURE = 3.0, 0.1
#: Radians a sample below which the rotor stands still.
_STANDSTILL = 1e-4
#: Probability from which iron loss is taken into account, and the share of the current that it
#: usually takes.
_LIKELY, _USUAL = 0.9, 0.01
#: Root of a probability from which the other kind of iron loss is a row of the budget.
_NOTICED = 0.1
#: Part of an angle by which a turn may differ from it where the two cancel.
_CANCELS = 0.2
#: Angle in rad above which the rest is estimated again, in the frame that it is turned to.
_FIRST_ORDER = np.deg2rad(1.0)
#: Share of the speed from which the slope of the angle is tried, and up to which it is one speed.
_LAGS, _SAME = 1e-3, 0.2


@dataclass(frozen=True, eq=False)
class _Estimate:
    """Sizes of imperfections as the weak form gives them, with map and R beside."""

    sizes: Mapping[str, complex]
    # The larger of both axes, where there are two.
    deviation: Mapping[str, float]
    evidence: float
    equations: int
    drive: KnownDrive

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

    @classmethod
    def of(cls, experiments: Sequence[Experiment], terms: Sequence[Term]) -> "_Balance":
        """Return the balance of recordings with some terms, dead time beside them if it can be."""
        angle = all(ANGLE.name in e.channels for e in experiments)
        roles = {term.role for term in terms}
        extra = (PhaseDeadTime(),) if angle and PhaseDeadTime.role not in roles else ()
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
        drive = before.drive if before else UNKNOWN_DRIVE
        rows = [
            WeakRegression(
                np.concatenate([*_columns(e, names, drive), own.matrix], axis=1), own.target
            )
            for e, own in zip(self.experiments, self._without, strict=True)
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
        return _Estimate(sizes, deviation, free.evidence, len(whole.target), drive)

    def rounds(self, names: Sequence[str], before: _Estimate) -> _Estimate:
        """Estimate imperfections that bend the map, which the map follows."""
        for _ in range(_ROUNDS if set(names) & {*_ERRORS, *_IRON} else 1):
            before = self.solved(names, before)
        return before

    def credible(self, estimate: _Estimate, name: str) -> bool:
        """Return whether a size is significant, large enough to matter, and not absurd."""
        one, size, own = IMPERFECTIONS[name], estimate.sizes[name], estimate.deviation[name]
        relative = size.real if one.positive else abs(size)
        relative /= one.scale(self.experiments, estimate.drive)
        matters, most = one.credible
        return bool(abs(size) > _SIGNIFICANT * own and matters < relative < most)

    @cached_property
    def _without(self) -> tuple[WeakRegression, ...]:
        """The equations of each recording with the columns of drift, terms and map alone."""

        def basis(experiment: Experiment) -> FloatArray:
            return columns(self.part, experiment.stack(CURRENTS) / self.reach)

        return tuple(
            joint_equations([e], self.terms, basis, harmonic_window, [drifts])
            for e, drifts in zip(self.experiments, self._drifts, strict=True)
        )

    @cached_property
    def _drifts(self) -> list[list[Column]]:
        return drift_columns(self.experiments, self.terms)


def _columns(
    experiment: Experiment, names: Sequence[str], drive: KnownDrive
) -> Iterator[FloatArray]:
    """Yield the columns of imperfections, (equation, 1) each."""
    window = HannWindow(experiment.time_step, harmonic_window(experiment))
    for name in names:
        for stored, supplied in IMPERFECTIONS[name].columns(experiment, drive):
            yield (window.of_supply(supplied) + window.of_store(stored)).reshape(-1, 1)


def calibration_of(experiments: Sequence[Experiment], terms: Sequence[Term] = ()) -> Calibration:
    """Estimate what the channels of recordings have to be corrected by.

    A dead time among the terms is allowed for where the angle was recorded.
    """
    turning = max(float(np.abs(e.channels[SPEED.name]).max()) * e.time_step for e in experiments)
    if turning <= _STANDSTILL:
        return _timing_at_rest(experiments)
    balance = _Balance.of(experiments, terms)
    lagging = _lagging_speed(balance)
    if lagging is not None:
        balance = replace(balance, experiments=lagging)
    found, free = _placed(balance)
    if abs(found["angle"]) > _FIRST_ORDER:
        ahead = found["angle"]
        turned = [in_frame_ahead(e, ahead) for e in balance.experiments]
        found, free = _placed(replace(balance, experiments=turned))
        found = _with(found, angle=ahead + found["angle"])
    result = _refined(found, free, balance)
    if lagging is None:
        return result
    reason = IMPERFECTIONS["speed_lag"].sentence(1.0, 0.0, UNKNOWN_DRIVE)
    return replace(_with(result, speed_lag=1.0), reasons=(reason, *result.reasons))


def _with(calibration: Calibration, **sizes: complex) -> Calibration:
    """Return a calibration with other sizes, none of 0 among them."""
    every = {**calibration.sizes, **sizes}
    return replace(calibration, sizes={name: size for name, size in every.items() if size})


def _placed(balance: _Balance) -> tuple[Calibration, _Estimate]:
    """Return when and in which frame the voltages act, and the angle, to first order.

    The estimate is that of delay and turn. Iron loss acts beside them where it is credible.
    """
    first = balance.solved(_TIMING)
    whole, timed = (balance.rounds((*_TIMING, *names), first) for names in (_ERRORS, ()))
    errors = tuple(name for name in _ERRORS if balance.credible(whole, name))
    if _cancel(whole, balance.experiments) or _turns_far(balance.experiments):
        errors = tuple(name for name in errors if name != "angle")
    while errors and whole.evidence < timed.evidence - _CLEAR:
        free, plain = balance.rounds((*_TIMING, *errors), first), balance.rounds(errors, first)
        found = _timing_of(free, plain.evidence, balance.experiments)
        chosen = plain if found == AS_RECORDED else free
        if chosen.evidence > timed.evidence - _CLEAR:
            break  # timing alone explains as much
        credible = tuple(name for name in errors if balance.credible(chosen, name))
        if credible == errors:
            return _with(found, angle=chosen["angle"] if "angle" in errors else 0.0), free
        errors = credible  # what is left is estimated without it
    return _timing_of(timed, balance.rounds((), first).evidence, balance.experiments), timed


def _refined(found: Calibration, free: _Estimate, balance: _Balance) -> Calibration:
    """Return a calibration with what shows once voltages and angle are in place."""
    if found != AS_RECORDED:
        placed = [found.acting(found.applied(e)) for e in balance.experiments]
        balance = replace(balance, experiments=placed)
    iron, left, rest = _iron_of(balance)
    deviation, angle = {**rest.deviation, **left}, found["angle"]
    delay = (found["delay"] + rest["delay"], rest.deviation["delay"])
    whole = _near_whole(delay[0], _SIGNIFICANT * delay[1]) if found["delay"] else 0.0
    if angle or (balance.credible(rest, "angle") and not _turns_far(balance.experiments)):
        angle += rest["angle"]
    if not whole % 1.0:
        deviation["delay"] = float(np.hypot(delay[0] - whole, delay[1]))
    if not angle:
        deviation["angle"] = float(np.hypot(rest["angle"], rest.deviation["angle"]))
    if found["turn"] % 1.0:
        deviation["turn"] = free.deviation["turn"]
    sizes = {"angle": angle, **iron}
    for name in balance.beside:
        size, own = rest.sizes[name], rest.deviation[name]
        sizes[name] = size if balance.credible(rest, name) else 0.0
        deviation[name] = own if sizes[name] else float(np.hypot(abs(size), own))
    sentences = [
        IMPERFECTIONS[name].sentence(size, deviation[name], rest.drive)
        for name, size in sizes.items()
        if size
    ]
    timed = _with(found, delay=whole)
    drive = replace(found.drive, resistance=rest.drive.resistance, linkage=rest.drive.linkage)
    reasons = (*_timing_sentences(timed, delay, free), *sentences)
    return replace(_with(timed, **sizes), drive=drive, deviation=deviation, reasons=reasons)


def _iron_of(balance: _Balance) -> tuple[dict[str, float], dict[str, float], _Estimate]:
    """Return the iron loss of recordings whose voltages are in place, and the estimate beside it.

    Its size, and what it may be off by. Beside a free turn, which stands in for most of it, it
    would not show.
    """
    first = balance.solved(("delay",))
    *kinds, without, turned = (
        balance.rounds(("delay", "angle", *other), first)
        for other in (*((name,) for name in _IRON), (), ("turn",))
    )
    one, other = sorted(kinds, key=lambda kind: kind.evidence)
    name = _IRON[kinds.index(one)]
    likely = _likelihood(one, min(without.evidence, turned.evidence))
    if not (likely > _LIKELY and balance.credible(one, name)):
        return {}, {"iron": _iron_left(one, name, likely, balance.experiments)}, without
    iron = one[name]
    left = {name: float(np.hypot(one.deviation[name], np.sqrt(1 - likely) * iron))}
    otherwise = float(np.sqrt(1 - _likelihood(one, other.evidence)))
    if otherwise > _NOTICED:
        left["iron_of_change"] = (otherwise if name == "iron_of_rotation" else -otherwise) * iron
    return {name: iron}, left, one


def _timing_of(free: _Estimate, plain: float, experiments: Sequence[Experiment]) -> Calibration:
    """Return the timing of the voltages where it is clear against the `plain` evidence, else none.

    No inverter turns a voltage by hundredths of a sample. Where the rotor turns far in one, a
    voltage of its middle that is held in the stationary frame seems to be turned back by about
    R T / (12 L) of it: the current curves in between, which windows over samples do not see. A
    delay that the controller's answer to noise imitates is none.
    """
    values = {name: free[name] for name in _TIMING}
    if max(map(abs, values.values())) > _MOST or free.evidence > plain - _CLEAR:
        return AS_RECORDED
    sure = {name: value for name, value in values.items() if free.deviation[name] < _SURE}
    delay, turn = sure.get("delay", 0.0), sure.get("turn", 0.0)
    clear = abs(delay) > _SIGNIFICANT * free.deviation["delay"]
    delay = _near_whole(delay) if clear and _acts_late(delay, experiments) else 0.0
    far = _turns_far(experiments)
    different = _ANGLE / far if far else _DIFFERENT
    behind = turn + 0.5  # what a voltage held in the stationary frame is turned by at the sample
    hold = "stationary" if abs(behind) < _DIFFERENT or not _near_whole(behind) % 1.0 else "dq"
    left = behind if hold == "stationary" else turn
    left = 0.0 if abs(left) < different else _near_whole(left, min(_NEAR, different))
    if far and hold == "dq" and -_NEAR < left < 0.0:
        held = Calibration(drive=KnownDrive(hold="stationary", ripple=left))
        return _with(held, delay=delay, turn=0.5)
    return _with(Calibration(drive=KnownDrive(hold=hold)), delay=delay, turn=left)


def _timing_sentences(
    timing: Calibration, delay: tuple[float, float], free: _Estimate
) -> Iterator[str]:
    """Yield what was found of the timing where it is corrected; delay and deviation in samples."""
    middle = timing.drive.ripple != 0.0
    taken = [f"a delay of {timing['delay']:.3g}"] if timing["delay"] else []
    taken += [f"a turn of {timing['turn']:.3g}"] if timing["turn"] and not middle else []
    if timing.drive.hold == "stationary":
        about = " about the middle of the sample" if middle else ""
        taken.append(f"a hold in the stationary frame{about}")
    if taken:
        yield (
            f"The voltage acts {delay[0]:.3f} ± {delay[1]:.3f} samples after it is recorded, "
            f"turned by the rotation of {free['turn']:.3f} ± {free.deviation['turn']:.3f} "
            f"samples: taken into account as {', '.join(taken)}."
        )


def _timing_at_rest(experiments: Sequence[Experiment]) -> Calibration:
    """Return the delay at standstill, from windows short enough for what moves there to show it."""
    lag, own = mean_lag(experiments, in_phases=False)
    if not (_DIFFERENT < abs(lag) < _MOST and own < _SURE):
        return AS_RECORDED
    delay = _near_whole(-lag)
    reason = (
        f"The voltage acts {-lag:.3f} ± {own:.3f} samples after it is recorded: taken into "
        f"account as a delay of {delay:.3g}."
    )
    return Calibration(
        {"delay": delay}, deviation={"delay": own} if delay % 1.0 else {}, reasons=(reason,)
    )


def _acts_late(delay: float, experiments: Sequence[Experiment]) -> bool:
    """Return whether a delay is none that the controller's answer to noise imitates.

    It is either larger than noise can imitate in these windows, or that of longer ones too, which
    have less of the noise.
    """
    if abs(delay) > _SIGNIFICANT * imitated_lag(experiments, harmonic_window):
        return True
    lag, own = mean_lag(experiments, in_phases=True)
    return own < _SURE and abs(delay + lag) < max(_NEAR, _SIGNIFICANT * own)


def _turns_far(experiments: Sequence[Experiment]) -> float:
    """Return the rotor's turn in a sample, rad, where what happens inside counts.

    Voltages that are held in another frame than was thought leave a small turn there, which an
    angle of the rotor imitates. Zero where the turn is small.
    """
    turns = [float(np.median(np.abs(e.channels[SPEED.name]))) * e.time_step for e in experiments]
    return max(turns) if max(turns) > _COARSE else 0.0


def _near_whole(value: float, near: float = _NEAR) -> float:
    """Return a number of samples, the next whole one where it is near."""
    return float(round(value)) if abs(value - round(value)) < near else value


def _cancel(estimate: _Estimate, experiments: Sequence[Experiment]) -> bool:
    """Return whether turn and angle leave the voltages where they are, and turn the currents alone.

    That is no angle of the rotor; a delay, or voltages that are not all logged, looks like it.
    """
    turns = np.concatenate([e.channels[SPEED.name] * e.time_step for e in experiments])
    turn, angle = estimate["turn"], estimate["angle"]
    apart = abs(turn) * float(np.sqrt(np.mean(turns**2))) - abs(angle)
    same_way = np.sign(turn * float(np.mean(turns))) == np.sign(angle)
    return bool(same_way and abs(apart) < _CANCELS * abs(angle))


def _likelihood(one: _Estimate, other: float) -> float:
    """Return how probable an estimate is beside one of another evidence."""
    return float(1 / (1 + np.exp(-0.5 * np.clip(other - one.evidence, -1e3, 1e3))))


def _iron_left(
    whole: _Estimate, kind: str, likely: float, experiments: Sequence[Experiment]
) -> float:
    """Return what iron loss may be left, in S: its root mean square over acting and not acting.

    Without saliency a turn stands in for any of it: no more than an ordinary share is believed, and
    no surer than the likelihood beside the turn.
    """
    size, own = whole[kind], whole.deviation[kind]
    probable = min(probability(size / max(own, 1e-300), whole.equations / OVERLAP), likely)
    usual = _USUAL * IMPERFECTIONS[kind].scale(experiments, whole.drive)
    return float(np.sqrt(probable) * min(np.hypot(size, own), usual))


def _lagging_speed(balance: _Balance) -> list[Experiment] | None:
    """Return the recordings with the slope of their angle as speed, where that explains more."""
    lag = IMPERFECTIONS["speed_lag"]
    if not lag.recorded(balance.experiments) or min(map(len, balance.experiments)) <= SLOPE:
        return None
    others = [lag.corrected(e, 1.0, UNKNOWN_DRIVE) for e in balance.experiments]
    apart = [_apart(e, other) for e, other in zip(balance.experiments, others, strict=True)]
    if not _LAGS < max(apart) < _SAME:
        return None
    sloped = replace(balance, experiments=others).solved(_TIMING)
    return others if sloped.evidence < balance.solved(_TIMING).evidence - _CLEAR else None


def _apart(experiment: Experiment, other: Experiment) -> float:
    """Return the root mean square by which two speeds differ, over the largest."""
    speed = experiment.channels[SPEED.name]
    apart = np.sqrt(np.mean((speed - other.channels[SPEED.name]) ** 2))
    return float(apart / max(np.abs(speed).max(), 1e-9))
