"""Conventions of angle and speed, which need no machine to be judged.

The angle starts again after one turn, and its slope is the speed.
"""

from dataclasses import replace

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.pmsm.conventions.broken_convention import BrokenConvention, Judged, with_channels

#: What a turn of an angle may be in, beside rad: unit -> size of a turn.
_TURNS = {"deg": 360.0, "turn": 1.0}
_TURN_TOLERANCE = 0.05
_RATIO_TOLERANCE = 0.02
MOST_POLE_PAIRS = 24
#: Most values a turn of an angle that jumps.
_STEPS = 24


def find_stepped_angle(experiment: Experiment) -> BrokenConvention | None:
    """Find an angle (in any unit) that stands still and jumps, as that of Hall sensors does.

    It takes few values, one after the other round the turn, and keeps each for a while.
    """
    levels, place = np.unique(experiment.channels["theta_el"], return_inverse=True)
    count = len(levels)
    if not 3 <= count <= _STEPS:
        return None
    steps = (np.diff(place) + count // 2) % count - count // 2
    if np.mean(steps == 0) < 0.5 or abs(int(steps.sum())) < 2 * count:
        return None
    return BrokenConvention(
        "stepped angle",
        experiment.name,
        ("theta_el",),
        f"the angle takes {count} values only, and jumps from one to the next, "
        f"{360 / count:.3g} electrical degrees further",
        "record the angle of an encoder or of an observer; leave theta_el out where speed and dq "
        "channels do not come of it",
    )


def judge_angle_unit(experiment: Experiment) -> Judged:
    """Find an angle that is not in rad, by the size of its turn, or by its slope over the speed."""
    angle = experiment.channels["theta_el"]
    turn, shown = _turn_of(experiment)
    for unit, size in _TURNS.items():
        if turn is not None and abs(turn / size - 1.0) < _TURN_TOLERANCE:
            finding = BrokenConvention(
                "degrees for radians" if unit == "deg" else "turns for radians",
                experiment.name,
                ("theta_el",),
                shown,
                f'give theta_el unit = "{unit}"',
            )
            return finding, with_channels(experiment, {"theta_el": angle * (2 * np.pi / size)})
    return None, experiment


def _turn_of(experiment: Experiment) -> tuple[float | None, str]:
    """Return the size of a turn of the recorded angle, and what shows it."""
    angle = experiment.channels["theta_el"]
    span, steps = float(np.ptp(angle)), np.diff(angle)
    jumps = np.abs(steps) > 0.5 * span
    if jumps.any() and not jumps.all():
        usual = float(np.median(np.abs(steps[~jumps])))
        turn = float(np.median(np.abs(steps[jumps]))) + usual
        return turn, f"the angle starts again after {turn:.4g} where a turn is {2 * np.pi:.4g} rad"
    if "omega_el" not in experiment.channels:
        return None, ""
    ratio = _slope_over_speed(steps, experiment)
    return 2 * np.pi * abs(ratio), f"the angle turns {ratio:.4g} times as fast as the speed says"


def judge_speed_and_angle(experiment: Experiment, pole_pairs: int | None = None) -> Judged:
    """Find a speed or an angle (rad) of the shaft, by the slope of the angle over the speed.

    A ratio of -1 is left to the voltage balance, which shows which of the two is reversed.
    """
    ratio = angle_over_speed(experiment)
    size = abs(ratio)
    fitting = _other_pairs(size, pole_pairs)
    instead = f"pole_pairs = {fitting} in place of {pole_pairs}" if fitting else ""
    evidence = f"the angle turns {ratio:.4g} times as fast as the speed says"
    for pairs in range(2, MOST_POLE_PAIRS + 1):
        other = instead and pairs != pole_pairs
        or_else = f"; or, where omega_el is mechanical already, {instead}" if other else ""
        if abs(size / pairs - 1.0) < _RATIO_TOLERANCE:
            finding = BrokenConvention(
                "mechanical speed for electrical",
                experiment.name,
                ("omega_el",),
                f"{evidence}, as with {pairs} pole pairs",
                f"give omega_el mechanical = true, and pole_pairs = {pairs}{or_else}",
            )
            speed = experiment.channels["omega_el"] * pairs
            return finding, with_channels(experiment, {"omega_el": speed})
        if abs(size * pairs - 1.0) < _RATIO_TOLERANCE:
            shaft, changed = of_shaft(experiment, pairs, evidence)
            return shaft and replace(shaft, fix=f"{shaft.fix}{or_else}"), changed
    if abs(size - 1.0) < _RATIO_TOLERANCE:
        return None, experiment
    finding = BrokenConvention(
        "angle against speed",
        experiment.name,
        ("omega_el", "theta_el"),
        evidence,
        f"give {instead}"
        if instead
        else "give both their units, and mechanical = true where one is of the shaft",
    )
    if not instead:
        return finding, experiment
    return finding, with_channels(experiment, {"omega_el": size * experiment.channels["omega_el"]})


def _other_pairs(size: float, pole_pairs: int | None) -> int | None:
    """Return the pole pairs with which a speed of the shaft would fit the angle; None for none."""
    pairs = size * (pole_pairs or 0)
    whole = round(pairs)
    if whole == pole_pairs or not 1 <= whole <= MOST_POLE_PAIRS:
        return None
    return whole if abs(pairs / whole - 1.0) < _RATIO_TOLERANCE else None


def angle_over_speed(experiment: Experiment) -> float:
    """Return the slope of theta_el (rad) over omega_el (rad/s): 1 where they agree."""
    return _slope_over_speed(np.diff(np.unwrap(experiment.channels["theta_el"])), experiment)


def _slope_over_speed(steps: FloatArray, experiment: Experiment) -> float:
    speed = experiment.channels["omega_el"]
    expected = 0.5 * (speed[1:] + speed[:-1]) * experiment.time_step
    square = float(expected @ expected)
    return float(steps @ expected) / square if square > 0.0 else 1.0


def of_shaft(experiment: Experiment, pairs: int, evidence: str) -> Judged:
    """Return the finding of a mechanical angle, rad, and the recording with the electrical one."""
    finding = BrokenConvention(
        "mechanical angle for electrical",
        experiment.name,
        ("theta_el",),
        f"{evidence}, as with {pairs} pole pairs",
        f"give theta_el mechanical = true, and pole_pairs = {pairs}",
    )
    angle = np.unwrap(experiment.channels["theta_el"]) * pairs
    return finding, with_channels(experiment, {"theta_el": angle})
