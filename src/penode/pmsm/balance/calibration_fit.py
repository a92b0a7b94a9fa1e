"""Calibration of a drive from its own recording, estimated with the map by the weak form.

A mirror symmetric map of splines cannot stand in for any of the errors, as a free one would.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from penode.data.experiment import Experiment
from penode.pmsm.balance.calibration import AS_RECORDED, SLOPE, Calibration, with_speed_from_angle
from penode.pmsm.balance.calibration_equations import ERRORS, SENSORS, Balance, Estimate
from penode.pmsm.balance.trial_balance import lag_of_voltage
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES, in_frame_ahead
from penode.pmsm.machine.terms import ANGLE, SPEED, Term

#: -2 log likelihood by which another timing has to be better, and samples that it has to differ by.
_CLEAR, _DIFFERENT = 25.0, 0.2
#: Samples from a whole number, and from half a turn back, that are taken for these.
_NEAR = 0.1
#: Samples beyond which, and deviation above which, an estimate is not believed.
_MOST, _SURE = 3.0, 0.1
#: Radians a sample below which the rotor stands still.
_STANDSTILL = 1e-4
#: Deviations from which an error, or a delay, is taken into account.
_SIGNIFICANT = 5.0
#: Fractions of the current between which an error of the sensors is taken into account.
_MATTERS, _ABSURD = 1e-4, 0.1
#: Share of the current that iron usually takes.
_USUAL = 0.01
#: Angle in rad, and share of the current, below which none is, and above which none is believed.
_ANGLES, _SHARES = (np.deg2rad(0.05), np.deg2rad(12.0)), (1e-3, 0.2)
#: Angle in rad above which the rest is estimated again, in the frame that it is turned to.
_FIRST_ORDER = np.deg2rad(1.0)
#: Share of the speed from which the slope of the angle is tried, and up to which it is one speed.
_LAGS, _SAME = 1e-3, 0.2

_TIMING = ("delay", "turn")


def calibration_of(experiments: Sequence[Experiment], terms: Sequence[Term] = ()) -> Calibration:
    """Estimate what the channels of recordings have to be corrected by.

    Parameters
    ----------
    experiments : sequence of Experiment
        Recordings with i_d, i_q (A), u_d, u_q (V), omega_el (rad/s) and the channels of the terms.
    terms : sequence of Term
        Of the voltage equation; a dead time is allowed for where the angle was recorded.
    """
    result = _calibrated(experiments, terms)
    ahead = 0.0
    if abs(result.angle) > _FIRST_ORDER:
        ahead = result.angle
        result = _calibrated([in_frame_ahead(e, ahead) for e in experiments], terms)
    angle, own = (
        float(np.rad2deg(a)) for a in (ahead + result.angle, result.deviation.get("angle", 0.0))
    )
    if not angle:
        return result
    sentence = (
        f"The d axis lies {angle:.3f} ± {own:.3f}° before that of the recording: currents, "
        "voltages and angle are turned by it."
    )
    return replace(result, angle=ahead + result.angle, reasons=(*result.reasons, sentence))


def _calibrated(experiments: Sequence[Experiment], terms: Sequence[Term]) -> Calibration:
    """Return the calibration to first order in the angle, which is named by no reason."""
    balance = Balance.of(experiments, terms)
    turning = max(float(np.abs(e.channels[SPEED.name]).max()) * e.time_step for e in experiments)
    if turning <= _STANDSTILL:
        return _timing_at_rest(experiments)
    lagging = _lagging_speed(balance)
    if lagging is not None:
        balance = replace(balance, experiments=lagging)
    first = balance.solved(_TIMING)
    whole, timed = (balance.rounds((*_TIMING, *names), first) for names in (ERRORS, ()))
    errors = tuple(name for name in ERRORS if _credible(whole, name, balance.experiments))
    result = None
    if errors and whole.evidence < timed.evidence - _CLEAR:
        result = _with_errors(balance, errors, first)
    result = result or _timing(timed, _TIMING, balance.rounds((), first).evidence)
    result = _with_sensors(result, whole, balance)
    left = {
        name: float(np.hypot(whole.values[name] - getattr(result, name), whole.deviation[name]))
        for name in ("angle", "delay")
    }
    left["iron"] = _iron_left(whole, timed, balance.experiments)
    result = replace(result, resistance=whole.resistance, deviation={**left, **result.deviation})
    if lagging is None:
        return result
    sentence = "The recorded speed lags behind the angle: its slope is taken for the speed."
    return replace(result, speed_from_angle=True, reasons=(sentence, *result.reasons))


def _with_sensors(result: Calibration, whole: Estimate, balance: Balance) -> Calibration:
    """Return a calibration by the current sensors' errors too, where they are clear."""
    if not balance.sensors:
        return result
    deviation, reasons = dict(result.deviation), list(result.reasons)
    taken: dict[str, complex] = {}
    for kind in SENSORS:
        error, own = whole.axes(kind)
        credible = max(_MATTERS, _SIGNIFICANT * own) < abs(error) < _ABSURD
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


def _with_errors(balance: Balance, errors: tuple[str, ...], first: Estimate) -> Calibration | None:
    """Return the calibration by some errors, and by a timing where that is clear beside them.

    None where the errors are not credible by themselves.
    """
    free, plain = balance.rounds((*_TIMING, *errors), first), balance.rounds(errors, first)
    timed = _timing(free, _TIMING, plain.evidence)
    chosen = plain if timed is AS_RECORDED else free
    credible = tuple(name for name in errors if _credible(chosen, name, balance.experiments))
    if credible != errors:  # what is left is estimated without it
        return _with_errors(balance, credible, first) if credible else None
    reasons = list(timed.reasons)
    if "iron" in errors:
        iron, own = (1e3 * part["iron"] for part in (chosen.values, chosen.deviation))
        reasons.append(
            f"The iron takes {iron:.3g} ± {own:.2g} mS times the induced voltage "
            f"({1e3 / iron:.3g} ohm in parallel): the current that is left magnetises."
        )
    return replace(
        timed,
        angle=chosen.values.get("angle", 0.0),
        iron=chosen.values.get("iron", 0.0),
        deviation={**timed.deviation, **{name: chosen.deviation[name] for name in errors}},
        reasons=tuple(reasons),
    )


def _credible(estimate: Estimate, name: str, experiments: Sequence[Experiment]) -> bool:
    """Return whether an error is significant, large enough to matter, and not absurd."""
    size = estimate.values[name]
    if not abs(size) > _SIGNIFICANT * estimate.deviation[name]:
        return False
    if name == "angle":
        return bool(_ANGLES[0] < abs(size) < _ANGLES[1])
    return bool(_SHARES[0] < size * _share(experiments) < _SHARES[1])


def _iron_left(whole: Estimate, timed: Estimate, experiments: Sequence[Experiment]) -> float:
    """Return what iron loss may be left, in S: its root mean square over acting and not acting.

    Without saliency a timing stands in for any of it: no more than an ordinary share is believed,
    and no surer than the likelihood beside the timing alone.
    """
    better = 0.5 * float(np.clip(timed.evidence - whole.evidence, -1e3, 1e3))
    probable = min(whole.probability("iron"), 1 / (1 + np.exp(-better)))
    size = np.hypot(whole.values["iron"], whole.deviation["iron"])
    return float(np.sqrt(probable) * min(size, _USUAL / _share(experiments)))


def _share(experiments: Sequence[Experiment]) -> float:
    """Return the share of the current that iron of 1 S takes."""
    taken, whole = (
        np.sqrt(sum(float(np.sum(e.stack(names) ** 2)) for e in experiments))
        for names in (VOLTAGES, CURRENTS)
    )
    return float(taken / max(whole, 1e-300))


def _timing(free: Estimate, estimated: Sequence[str], plain: float) -> Calibration:
    """Return the timing of the voltages where it is clear, else none."""
    values = {name: free.values[name] for name in estimated}
    if max(map(abs, values.values())) > _MOST or free.evidence > plain - _CLEAR:
        return AS_RECORDED
    sure = {name: value for name, value in values.items() if free.deviation[name] < _SURE}
    delay, turn = sure.get("delay", 0.0), sure.get("turn", 0.0)
    delay = 0.0 if abs(delay) < _SIGNIFICANT * free.deviation["delay"] else _near_whole(delay)
    behind = turn + 0.5  # what a voltage held in the stationary frame is turned by at the sample
    hold = "stationary" if abs(behind) < _DIFFERENT or _is_near_whole(behind) else "dq"
    left = behind if hold == "stationary" else turn
    left = 0.0 if abs(left) < _DIFFERENT else _near_whole(left)
    if not delay and not left and hold == "dq":
        return AS_RECORDED
    shown = [f"{values[name]:.3f} ± {free.deviation[name]:.3f}" for name in estimated]
    reason = f"The voltage acts {shown[0]} samples after it is recorded"
    if len(shown) > 1:
        reason += f", turned by the rotation of {shown[1]} samples"
    taken = [f"a delay of {delay:.3g}"] if delay else []
    taken += [f"a turn of {left:.3g}"] if left else []
    taken += ["a hold in the stationary frame"] if hold == "stationary" else []
    fractions = {"delay": delay % 1.0, "turn": left % 1.0}
    return Calibration(
        delay,
        hold,
        left,
        deviation={name: free.deviation[name] for name in estimated if fractions[name]},
        reasons=(f"{reason}: taken into account as {', '.join(taken)}.",),
    )


def _timing_at_rest(experiments: Sequence[Experiment]) -> Calibration:
    """Return the delay at standstill, from windows short enough for what moves there to show it."""
    lags, deviations = np.array([lag_of_voltage(e, in_phases=False) for e in experiments]).T
    weights = 1.0 / np.maximum(deviations, 1e-9) ** 2
    lag, own = float(np.average(lags, weights=weights)), float(np.sum(weights) ** -0.5)
    if not (_DIFFERENT < abs(lag) < _MOST and own < _SURE):
        return AS_RECORDED
    delay = _near_whole(-lag)
    return Calibration(
        delay,
        deviation={"delay": own} if delay % 1.0 else {},
        reasons=(
            f"The voltage acts {-lag:.3f} ± {own:.3f} samples after it is recorded: taken into "
            f"account as a delay of {delay:.3g}.",
        ),
    )


def _is_near_whole(value: float) -> bool:
    return abs(value - round(value)) < _NEAR


def _near_whole(value: float) -> float:
    return float(round(value)) if _is_near_whole(value) else value


def _lagging_speed(balance: Balance) -> list[Experiment] | None:
    """Return the recordings with the slope of their angle as speed, where that explains more."""
    if not all(ANGLE.name in e.channels and len(e) > SLOPE for e in balance.experiments):
        return None
    others = [with_speed_from_angle(e) for e in balance.experiments]
    apart = [_apart(e, other) for e, other in zip(balance.experiments, others, strict=True)]
    if not _LAGS < max(apart) < _SAME:
        return None
    recorded, sloped = balance.solved(_TIMING), replace(balance, experiments=others).solved(_TIMING)
    return others if sloped.evidence < recorded.evidence - _CLEAR else None


def _apart(experiment: Experiment, other: Experiment) -> float:
    """Return the root mean square by which two speeds differ, over the largest."""
    speed = experiment.channels[SPEED.name]
    apart = np.sqrt(np.mean((speed - other.channels[SPEED.name]) ** 2))
    return float(apart / max(np.abs(speed).max(), 1e-9))
