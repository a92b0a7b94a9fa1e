"""Calibration of a drive from its own recording, estimated with the map by the weak form.

A mirror symmetric map of splines cannot stand in for any of the errors, as a free one would.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.pmsm.balance.calibration import AS_RECORDED, SLOPE, Calibration, with_speed_from_angle
from penode.pmsm.balance.calibration_equations import (
    ERRORS,
    IRON,
    SENSORS,
    Balance,
    Estimate,
)
from penode.pmsm.balance.voltage_timing import (
    CLEAR,
    SIGNIFICANT,
    TIMING,
    near_whole,
    timing_at_rest,
    timing_of,
    timing_sentences,
    turns_far,
)
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES, in_frame_ahead
from penode.pmsm.machine.terms import ANGLE, SPEED, Term

#: Radians a sample below which the rotor stands still.
_STANDSTILL = 1e-4
#: Probability from which iron loss is taken into account.
_LIKELY = 0.9
#: Fractions of the current between which an error of the sensors is taken into account.
_MATTERS, _ABSURD = 1e-4, 0.1
#: Share of the current that iron usually takes.
_USUAL = 0.01
#: Angle in rad, and share of the current, below which none is, and above which none is believed.
_ANGLES, _SHARES = (np.deg2rad(0.05), np.deg2rad(12.0)), (1e-4, 0.2)
#: Part of an angle by which a turn may differ from it where the two cancel.
_CANCELS = 0.2
#: Angle in rad above which the rest is estimated again, in the frame that it is turned to.
_FIRST_ORDER = np.deg2rad(1.0)
#: Share of the speed from which the slope of the angle is tried, and up to which it is one speed.
_LAGS, _SAME = 1e-3, 0.2
#: What is left of is kept.
_LEFT = ("delay", "turn", "angle", "iron", "rotation_alone")


def calibration_of(experiments: Sequence[Experiment], terms: Sequence[Term] = ()) -> Calibration:
    """Estimate what the channels of recordings have to be corrected by.

    A dead time among the terms is allowed for where the angle was recorded.
    """
    turning = max(float(np.abs(e.channels[SPEED.name]).max()) * e.time_step for e in experiments)
    if turning <= _STANDSTILL:
        return timing_at_rest(experiments)
    balance = Balance.of(experiments, terms)
    lagging = _lagging_speed(balance)
    if lagging is not None:
        balance = replace(balance, experiments=lagging)
    found, free = _placed(balance)
    if abs(found.angle) > _FIRST_ORDER:
        ahead = found.angle
        turned = [in_frame_ahead(e, ahead) for e in balance.experiments]
        found, free = _placed(replace(balance, experiments=turned))
        found = replace(found, angle=ahead + found.angle)
    result = _refined(found, free, balance)
    if lagging is None:
        return result
    sentence = "The recorded speed lags behind the angle: its slope is taken for the speed."
    return replace(result, speed_from_angle=True, reasons=(sentence, *result.reasons))


def _placed(balance: Balance) -> tuple[Calibration, Estimate]:
    """Return when and in which frame the voltages act, and the angle, to first order.

    The estimate is that of delay and turn. Iron loss acts beside them where it is credible.
    """
    first = balance.solved(TIMING)
    whole, timed = (balance.rounds((*TIMING, *names), first) for names in (ERRORS, ()))
    errors = tuple(name for name in ERRORS if _credible(whole, name, balance.experiments))
    if _cancel(whole, balance.experiments) or turns_far(balance.experiments):
        errors = tuple(name for name in errors if name != "angle")
    while errors and whole.evidence < timed.evidence - CLEAR:
        free, plain = balance.rounds((*TIMING, *errors), first), balance.rounds(errors, first)
        found = timing_of(free, plain.evidence, balance.experiments)
        chosen = plain if found == AS_RECORDED else free
        if chosen.evidence > timed.evidence - CLEAR:
            break  # timing alone explains as much
        credible = tuple(name for name in errors if _credible(chosen, name, balance.experiments))
        if credible == errors:
            return replace(found, angle=chosen.values.get("angle", 0.0)), free
        errors = credible  # what is left is estimated without it
    return timing_of(timed, balance.rounds((), first).evidence, balance.experiments), timed


def _refined(found: Calibration, free: Estimate, balance: Balance) -> Calibration:
    """Return a calibration with what shows once voltages and angle are in place."""
    if found != AS_RECORDED:
        placed = [found.acting(found.applied(e)) for e in balance.experiments]
        balance = replace(balance, experiments=placed)
    loss, rest = _iron_of(balance)
    deviation, angle = {**rest.deviation, **loss.deviation}, found.angle
    shown = (found.delay + rest.values["delay"], rest.deviation["delay"])
    delay = near_whole(shown[0], SIGNIFICANT * shown[1]) if found.delay else 0.0
    far = turns_far(balance.experiments)
    if angle or (_credible(rest, "angle", balance.experiments) and not far):
        angle += rest.values["angle"]
    if not delay % 1.0:
        deviation["delay"] = float(np.hypot(shown[0] - delay, shown[1]))
    if not angle:
        deviation["angle"] = float(np.hypot(rest.values["angle"], rest.deviation["angle"]))
    if found.turn % 1.0:
        deviation["turn"] = free.deviation["turn"]
    reasons = [*timing_sentences(replace(found, delay=delay), shown, free)]
    if angle:
        reasons.append(
            f"The d axis lies {np.rad2deg(angle):.3f} ± {np.rad2deg(deviation['angle']):.3f}° "
            "before that of the recording: currents, voltages and angle are turned by it."
        )
    result = replace(
        found,
        delay=delay,
        angle=angle,
        iron=loss.iron,
        rotation_alone=loss.rotation_alone,
        resistance=rest.resistance,
        linkage=rest.linkage,
        deviation={name: deviation[name] for name in _LEFT if name in deviation},
        reasons=(*reasons, *loss.reasons),
    )
    return _with_sensors(result, rest, balance)


def _iron_of(balance: Balance) -> tuple[Calibration, Estimate]:
    """Return the iron loss of recordings whose voltages are in place, and the estimate beside it.

    Beside a free turn, which stands in for most of it, it would not show.
    """
    first, experiments = balance.solved(("delay",)), balance.experiments
    *kinds, without, turned = (
        balance.rounds(("delay", "angle", *other), first)
        for other in (*((name,) for name in IRON), (), ("turn",))
    )
    one, other = sorted(kinds, key=lambda kind: kind.evidence)
    name = tuple(IRON)[kinds.index(one)]
    likely = _likelihood(one, min(without.evidence, turned.evidence))
    if not (likely > _LIKELY and _credible(one, name, experiments)):
        left = _iron_left(one, name, likely, experiments)
        return Calibration(deviation={"iron": left}), without
    iron, by = one.values[name], IRON[name]
    own = float(np.hypot(one.deviation[name], np.sqrt(1 - likely) * iron))
    reason = (
        f"The iron takes {1e3 * iron:.3g} ± {1e3 * own:.2g} mS times {by} ({1 / iron:.3g} ohm in "
        "parallel): the current that is left magnetises."
    )
    other_way = float(np.sqrt(1 - _likelihood(one, other.evidence)))
    deviation = {"iron": own, "rotation_alone": other_way}
    alone = name == "iron_of_rotation"
    return Calibration(iron=iron, rotation_alone=alone, deviation=deviation, reasons=(reason,)), one


def _with_sensors(result: Calibration, whole: Estimate, balance: Balance) -> Calibration:
    """Return a calibration by the current sensors' errors too, where they are clear."""
    if not balance.sensors:
        return result
    deviation, reasons = dict(result.deviation), list(result.reasons)
    taken: dict[str, complex] = {}
    for kind in SENSORS:
        error, own = whole.axes(kind)
        credible = max(_MATTERS, SIGNIFICANT * own) < abs(error) < _ABSURD
        deviation[kind] = own if credible else float(np.hypot(abs(error), own))
        taken[kind] = error if credible else 0.0
    if taken["mismatch"]:
        largest, own = (100 * 2 * part for part in map(abs, whole.axes("mismatch")))
        reasons.append(
            f"The gains of the current sensors differ by up to {largest:.3f} ± {own:.3f} % from "
            "their mean: the currents are corrected."
        )
    offset, own = balance.reach * taken["offset"], balance.reach * whole.axes("offset")[1]
    if offset:
        reasons.append(
            f"The currents have an offset of {abs(offset):.3g} ± {own:.2g} A in the stationary "
            "frame: it is taken off."
        )
    return replace(
        result,
        mismatch=taken["mismatch"],
        offset=offset,
        deviation=deviation,
        reasons=tuple(reasons),
    )


def _credible(estimate: Estimate, name: str, experiments: Sequence[Experiment]) -> bool:
    """Return whether an error is significant, large enough to matter, and not absurd."""
    size = estimate.values[name]
    if not abs(size) > SIGNIFICANT * estimate.deviation[name]:
        return False
    if name == "angle":
        return bool(_ANGLES[0] < abs(size) < _ANGLES[1])
    return bool(_SHARES[0] < size * _share(experiments) < _SHARES[1])


def _cancel(estimate: Estimate, experiments: Sequence[Experiment]) -> bool:
    """Return whether turn and angle leave the voltages where they are, and turn the currents alone.

    That is no angle of the rotor; a delay, or voltages that are not all logged, looks like it.
    """
    samples = float(np.sqrt(np.mean(np.concatenate([_turns(e) for e in experiments]) ** 2)))
    turn, angle = abs(estimate.values["turn"]) * samples, estimate.values["angle"]
    same_way = np.sign(estimate.values["turn"] * _mean_turn(experiments)) == np.sign(angle)
    return bool(same_way and abs(turn - abs(angle)) < _CANCELS * abs(angle))


def _turns(experiment: Experiment) -> FloatArray:
    """Return the angle that the rotor turns by in each sample, in rad."""
    return np.asarray(experiment.channels[SPEED.name] * experiment.time_step)


def _mean_turn(experiments: Sequence[Experiment]) -> float:
    return float(np.mean(np.concatenate([_turns(e) for e in experiments])))


def _likelihood(one: Estimate, other: float) -> float:
    """Return how probable an estimate is beside one of another evidence."""
    return float(1 / (1 + np.exp(-0.5 * np.clip(other - one.evidence, -1e3, 1e3))))


def _iron_left(
    whole: Estimate, kind: str, likely: float, experiments: Sequence[Experiment]
) -> float:
    """Return what iron loss may be left, in S: its root mean square over acting and not acting.

    Without saliency a turn stands in for any of it: no more than an ordinary share is believed, and
    no surer than the likelihood beside the turn.
    """
    probable = min(whole.probability(kind), likely)
    size = np.hypot(whole.values[kind], whole.deviation[kind])
    return float(np.sqrt(probable) * min(size, _USUAL / _share(experiments)))


def _share(experiments: Sequence[Experiment]) -> float:
    """Return the share of the current that iron of 1 S takes."""
    taken, whole = (
        np.sqrt(sum(float(np.sum(e.stack(names) ** 2)) for e in experiments))
        for names in (VOLTAGES, CURRENTS)
    )
    return float(taken / max(whole, 1e-300))


def _lagging_speed(balance: Balance) -> list[Experiment] | None:
    """Return the recordings with the slope of their angle as speed, where that explains more."""
    if not all(ANGLE.name in e.channels and len(e) > SLOPE for e in balance.experiments):
        return None
    others = [with_speed_from_angle(e) for e in balance.experiments]
    apart = [_apart(e, other) for e, other in zip(balance.experiments, others, strict=True)]
    if not _LAGS < max(apart) < _SAME:
        return None
    recorded, sloped = balance.solved(TIMING), replace(balance, experiments=others).solved(TIMING)
    return others if sloped.evidence < recorded.evidence - CLEAR else None


def _apart(experiment: Experiment, other: Experiment) -> float:
    """Return the root mean square by which two speeds differ, over the largest."""
    speed = experiment.channels[SPEED.name]
    apart = np.sqrt(np.mean((speed - other.channels[SPEED.name]) ** 2))
    return float(apart / max(np.abs(speed).max(), 1e-9))
