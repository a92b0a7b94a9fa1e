"""Units and sides of a recorded speed and angle, from what they must have to do with each other.

An angle's slope is the speed: their ratio in SI units is 1 where both belong to the same side, and
the number of pole pairs where one is of the shaft and the other electrical. Phase quantities turned
by the electrical angle have a mean, the back-EMF at least; turned by anything else they have none.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from penode.arrays import FloatArray
from penode.data.units import UNITS
from penode.pmsm.machine.frames import dq_from_abc

_MOST_POLE_PAIRS = 48
# Relative error of the ratio within which it is taken for 1 or for a number of pole pairs.
_RATIO_TOLERANCE = 4e-3
# Correlation of the turns below which speed and angle have nothing to do with each other.
_CORRELATION = 0.95
# The true number of turns gives this much more constant dq quantities than the second best, which
# counts for at least so much.
_DISTINCT, _LEAST_SHARE = 2.0, 0.1


@dataclass(frozen=True, eq=False)
class Turning:
    """A column that may be a speed or an angle, its values in the unit of the file, times in s.

    Both are (time,), and empty where nothing can be determined from them. ``units`` are keys of
    `UNITS`, the likeliest first; ``side`` is as the name says, empty where it does not.
    """

    values: FloatArray
    times: FloatArray
    units: tuple[str, ...]
    side: str


@dataclass(frozen=True)
class Motion:
    """What speed and angle are.

    Empty units for the one that is not recorded; no pole pairs where both are of the same side; a
    sign of -1 where the column counts backwards. ``agrees`` says that the slope of the angle is the
    speed.
    """

    speed_unit: str
    angle_unit: str
    speed_side: str
    angle_side: str
    pole_pairs: int | None = None
    speed_sign: int = 1
    angle_sign: int = 1
    agrees: bool = False


def motion_of(speed: Turning | None, angle: Turning | None, turns: int | None) -> Motion:
    """Find units, sides and signs of speed and angle, None for what is not recorded.

    The answer is the simplest in which the slope of the angle is the speed; without one, what is
    usual. ``turns`` is what `electrical_turns` gives.
    """
    direction = None if turns is None else int(np.sign(turns))
    shaft = abs(turns) if turns is not None and abs(turns) > 1 else None
    motion = None if speed is None or angle is None else _agreement(speed, angle, turns)
    if motion is None:
        speed_unit = "" if speed is None else speed.units[0]
        angle_unit = "" if angle is None else angle.units[0]
        speed_side = usual_side(speed_unit) if speed is None else speed.side
        angle_side = "mechanical" if shaft else "electrical" if angle is None else angle.side
        return Motion(
            speed_unit,
            angle_unit,
            speed_side or usual_side(speed_unit),
            angle_side or "electrical",
            shaft,
            angle_sign=direction or 1,
        )
    # Only the phases show which of the two counts backwards; without them, the angle is taken to.
    angle_sign = direction or motion.angle_sign
    return replace(
        motion,
        pole_pairs=motion.pole_pairs or shaft,
        speed_sign=motion.angle_sign * angle_sign,
        angle_sign=angle_sign,
    )


def usual_side(unit: str) -> str:
    """Return the side to which a speed of that unit usually belongs."""
    return "mechanical" if unit == "rpm" else "electrical"


def _agreement(speed: Turning, angle: Turning, turns: int | None) -> Motion | None:
    """Return the simplest motion in which the slope of the angle is the speed, if there is one."""
    motions: list[tuple[float, Motion]] = []
    for rank, units in enumerate(product(speed.units, angle.units)):
        ratio = _ratio(speed, angle, *units)
        for speed_side, angle_side, pole_pairs in _sides(abs(ratio)):
            sign = -1 if ratio < 0 else 1
            motion = Motion(*units, speed_side, angle_side, pole_pairs, 1, sign, agrees=True)
            if _allowed(motion, speed, angle, turns):
                unusual = speed_side != usual_side(units[0])
                motions.append((rank + 0.5 * unusual + (pole_pairs or 0) / 100, motion))
    return min(motions, key=lambda pair: pair[0])[1] if motions else None


def electrical_turns(kinds: Sequence[FloatArray], angle: FloatArray) -> int | None:
    """Find how many electrical turns one turn of an angle (time,), rad, is, from phases (time, 3).

    1 for an electrical angle, the pole pairs for that of the shaft, negative where the angle turns
    against the phases; None where the phases, currents or voltages in any unit, do not determine
    it.
    """
    counts = [k * sign for k in range(1, _MOST_POLE_PAIRS + 1) for sign in (1, -1)]
    constant = {k: sum(_constant_share(phases, k * angle) for phases in kinds) for k in counts}
    best, second, *_ = sorted(counts, key=lambda k: constant[k], reverse=True)
    return best if constant[best] > _DISTINCT * max(constant[second], _LEAST_SHARE) else None


def _constant_share(phases: FloatArray, theta: FloatArray) -> float:
    """Return the mean dq vector's square over the mean square."""
    dq = dq_from_abc(phases, theta)
    square = float(np.mean(dq**2))
    return float(np.mean(np.mean(dq, axis=0) ** 2)) / square if square > 0.0 else 0.0


def _ratio(speed: Turning, angle: Turning, speed_unit: str, angle_unit: str) -> float:
    """Return the slope of the angle over the speed, 0 where they are not proportional."""
    if not (len(speed.values) and len(angle.values)):
        return 0.0
    turned = np.diff(np.unwrap(UNITS[angle_unit].to_si(angle.values)))
    middle = angle.times[:-1] + np.diff(angle.times) / 2
    rate = np.interp(middle, speed.times, UNITS[speed_unit].to_si(speed.values))
    expected = rate * np.diff(angle.times)
    common, square = float(turned @ expected), float(expected @ expected)
    if abs(common) <= _CORRELATION * np.sqrt(square * float(turned @ turned)):
        return 0.0
    return common / square


def _sides(ratio: float) -> Iterator[tuple[str, str, int | None]]:
    """Give the sides of speed and angle, and the pole pairs, that make the ratio what it is."""
    if abs(ratio - 1.0) < _RATIO_TOLERANCE:
        yield "electrical", "electrical", None
        yield "mechanical", "mechanical", None
    for pole_pairs in range(2, _MOST_POLE_PAIRS + 1):
        if abs(ratio / pole_pairs - 1.0) < _RATIO_TOLERANCE:
            yield "mechanical", "electrical", pole_pairs
        if abs(ratio * pole_pairs - 1.0) < _RATIO_TOLERANCE:
            yield "electrical", "mechanical", pole_pairs


def _allowed(motion: Motion, speed: Turning, angle: Turning, turns: int | None) -> bool:
    """Return whether the sides are those of the names and of the phase currents."""
    if speed.side not in ("", motion.speed_side) or angle.side not in ("", motion.angle_side):
        return False
    if turns is None:
        return True
    if motion.angle_side == "electrical":
        return abs(turns) == 1
    return abs(turns) == (motion.pole_pairs or abs(turns)) != 1
