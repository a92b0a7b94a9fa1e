"""Conventions of angle and speed, which need no machine to be judged.

The angle starts again after one turn, and its slope is the speed.
"""

from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.pmsm.conventions.broken_convention import BrokenConvention, Judged, with_channels

#: What a turn of an angle may be in, beside rad: unit -> size of a turn.
_TURNS = {"deg": 360.0, "turn": 1.0}
_TURN_TOLERANCE = 0.05
_RATIO_TOLERANCE = 0.02
MOST_POLE_PAIRS = 24
#: Unit that a speed may be in where another was said -> what corrects it: rpm read as rad/s, and
#: rad/s read as rpm.
SPEED_UNITS = {"rpm": 2 * np.pi / 60, "rad/s": 60 / (2 * np.pi)}
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


@dataclass(frozen=True)
class OfShaft:
    """What is said of the shaft: the pole pairs, and the channels that were recorded of it."""

    pole_pairs: int | None = None
    channels: tuple[str, ...] = ()

    def factor(self, channel: str) -> int:
        """Return what turns the column of a channel into an electrical one."""
        return (self.pole_pairs or 1) if channel in self.channels else 1


def judge_speed_and_angle(experiment: Experiment, said: OfShaft) -> Judged:
    """Find what is wrong of the shaft or in a unit, by the slope of the angle (rad) over the speed.

    A ratio of -1 is left to the voltage balance, which shows which of the two is reversed.
    """
    ratio = angle_over_speed(experiment)
    if abs(abs(ratio) - 1.0) < _RATIO_TOLERANCE:
        return None, experiment
    evidence = f"the angle turns {ratio:.4g} times as fast as the speed says"
    right, unit = _explained(abs(ratio) * said.factor("omega_el") / said.factor("theta_el"))
    step = experiment.time_step
    or_time = f"the time: {abs(ratio) * step:.4g} s a sample in place of {step:.4g} s"
    if right is None:
        finding = BrokenConvention(
            "angle against speed",
            experiment.name,
            ("omega_el", "theta_el"),
            evidence,
            f"give both their units, and mechanical = true where one is of the shaft; or correct "
            f"{or_time}",
        )
        speed = abs(ratio) * experiment.channels["omega_el"]
        return finding, with_channels(experiment, {"omega_el": speed})
    if right.pole_pairs and not set(right.channels) <= set(said.channels):
        evidence += f", as with {right.pole_pairs} pole pairs"
    fix = _advice(said, right, unit)
    if right.pole_pairs and said.pole_pairs not in (None, right.pole_pairs):
        fix += f"; or, if pole_pairs = {said.pole_pairs} is right, correct {or_time}"
    name, channels = _name(said, right, unit)
    finding = BrokenConvention(name, experiment.name, channels, evidence, fix)
    return finding, _corrected(experiment, said, right, unit)


def _explained(ratio: float) -> tuple[OfShaft | None, str]:
    """Return whose columns they are by the angle's slope over the speed, and the speed's unit."""
    for pairs in range(1, MOST_POLE_PAIRS + 1):
        if abs(ratio / pairs - 1.0) < _RATIO_TOLERANCE:
            return OfShaft(pairs, ("omega_el",)) if pairs > 1 else OfShaft(), ""
        if abs(ratio * pairs - 1.0) < _RATIO_TOLERANCE:
            return OfShaft(pairs, ("theta_el",)), ""
    for unit, factor in SPEED_UNITS.items():
        for pairs in range(1, MOST_POLE_PAIRS + 1):
            if abs(ratio / (pairs * factor) - 1.0) < _RATIO_TOLERANCE:
                return OfShaft(pairs, ("omega_el",)) if pairs > 1 else OfShaft(), unit
    return None, ""


def _advice(said: OfShaft, right: OfShaft, unit: str) -> str:
    """Return the entries of the study file that are to be given or taken away."""
    give = [f'omega_el unit = "{unit}"'] if unit else []
    give += [f"{name} mechanical = true" for name in right.channels if name not in said.channels]
    if right.channels and right.pole_pairs != said.pole_pairs:
        instead = f" in place of {said.pole_pairs}" if said.pole_pairs else ""
        give.append(f"pole_pairs = {right.pole_pairs}{instead}")
    away = [name for name in said.channels if name not in right.channels]
    parts = [f"give {', and '.join(give)}"] if give else []
    parts += [f"take mechanical = true away from {' and '.join(away)}"] if away else []
    return ", and ".join(parts)


def _name(said: OfShaft, right: OfShaft, unit: str) -> tuple[str, tuple[str, ...]]:
    """Return what a convention that is broken is called, and its channels."""
    words = {"omega_el": "speed", "theta_el": "angle"}
    for name in right.channels:
        if name not in said.channels:
            return f"mechanical {words[name]} for electrical", (name,)
    for name in said.channels:
        if name not in right.channels:
            return f"electrical {words[name]} for mechanical", (name,)
    return "unit of the speed" if unit else "wrong pole pairs", ("omega_el",)


def _corrected(experiment: Experiment, said: OfShaft, right: OfShaft, unit: str) -> Experiment:
    """Return a recording with the electrical speed and angle."""
    changed = {}
    for name in ("omega_el", "theta_el"):
        factor = right.factor(name) / said.factor(name)
        factor *= SPEED_UNITS.get(unit, 1.0) if name == "omega_el" else 1.0
        if factor != 1.0:
            values = experiment.channels[name]
            changed[name] = factor * (np.unwrap(values) if name == "theta_el" else values)
    return with_channels(experiment, changed)


def angle_over_speed(experiment: Experiment) -> float:
    """Return the slope of theta_el (rad) over omega_el (rad/s): 1 where they agree."""
    return _slope_over_speed(np.diff(np.unwrap(experiment.channels["theta_el"])), experiment)


def _slope_over_speed(steps: FloatArray, experiment: Experiment) -> float:
    speed = experiment.channels["omega_el"]
    expected = 0.5 * (speed[1:] + speed[:-1]) * experiment.time_step
    square = float(expected @ expected)
    return float(steps @ expected) / square if square > 0.0 else 1.0
