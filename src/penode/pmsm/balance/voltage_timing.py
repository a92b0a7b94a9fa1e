"""When a recorded voltage acts, and how far it is turned."""

from collections.abc import Iterator, Sequence

import numpy as np

from penode.data.experiment import Experiment
from penode.pmsm.balance.calibration import AS_RECORDED, Calibration
from penode.pmsm.balance.calibration_equations import Estimate
from penode.pmsm.balance.trial_balance import imitated_lag, mean_lag
from penode.pmsm.balance.voltage_balance import harmonic_window
from penode.pmsm.machine.terms import SPEED

#: What is estimated, in samples.
TIMING = ("delay", "turn")
#: -2 log likelihood by which another model of the voltages has to be better.
CLEAR = 25.0
#: Deviations from which an error, or a delay, is taken into account.
SIGNIFICANT = 5.0
#: Samples that a timing has to differ by.
_DIFFERENT = 0.2
#: Samples from a whole number, and from half a turn back, that are taken for these.
_NEAR = 0.1
#: Angle in rad that a turn has to amount to where the rotor turns by more than another in a sample.
_ANGLE, _COARSE = np.deg2rad(0.05), 0.35
#: Samples beyond which, and deviation above which, an estimate is not believed.
_MOST, _SURE = 3.0, 0.1


def timing_of(free: Estimate, plain: float, experiments: Sequence[Experiment]) -> Calibration:
    """Return the timing of the voltages where it is clear against the `plain` evidence, else none.

    No inverter turns a voltage by hundredths of a sample. Where the rotor turns far in one, a
    voltage of its middle that is held in the stationary frame seems to be turned back by about
    R T / (12 L) of it: the current curves in between, which windows over samples do not see. A
    delay that the controller's answer to noise imitates is none.
    """
    values = {name: free.values[name] for name in TIMING}
    if max(map(abs, values.values())) > _MOST or free.evidence > plain - CLEAR:
        return AS_RECORDED
    sure = {name: value for name, value in values.items() if free.deviation[name] < _SURE}
    delay, turn = sure.get("delay", 0.0), sure.get("turn", 0.0)
    clear = abs(delay) > SIGNIFICANT * free.deviation["delay"]
    delay = near_whole(delay) if clear and _acts_late(delay, experiments) else 0.0
    far = turns_far(experiments)
    different = _ANGLE / far if far else _DIFFERENT
    behind = turn + 0.5  # what a voltage held in the stationary frame is turned by at the sample
    hold = "stationary" if abs(behind) < _DIFFERENT or not near_whole(behind) % 1.0 else "dq"
    left = behind if hold == "stationary" else turn
    left = 0.0 if abs(left) < different else near_whole(left, min(_NEAR, different))
    if far and hold == "dq" and -_NEAR < left < 0.0:
        return Calibration(delay, "stationary", 0.5, ripple=left)
    return Calibration(delay, hold, left)


def turns_far(experiments: Sequence[Experiment]) -> float:
    """Return the rotor's turn in a sample, rad, where what happens inside counts.

    Voltages that are held in another frame than was thought leave a small turn there, which an
    angle of the rotor imitates. Zero where the turn is small.
    """
    turns = [float(np.median(np.abs(e.channels[SPEED.name]))) * e.time_step for e in experiments]
    return max(turns) if max(turns) > _COARSE else 0.0


def _acts_late(delay: float, experiments: Sequence[Experiment]) -> bool:
    """Return whether a delay is none that the controller's answer to noise imitates.

    It is either larger than noise can imitate in these windows, or that of longer ones too, which
    have less of the noise.
    """
    if abs(delay) > SIGNIFICANT * imitated_lag(experiments, harmonic_window):
        return True
    lag, own = mean_lag(experiments, in_phases=True)
    return own < _SURE and abs(delay + lag) < max(_NEAR, SIGNIFICANT * own)


def timing_sentences(
    timing: Calibration, delay: tuple[float, float], free: Estimate
) -> Iterator[str]:
    """Yield what was found of the timing, and what is made of it; nothing of none.

    `delay` is the estimated one and its deviation, in samples.
    """
    taken = [f"a delay of {timing.delay:.3g}"] if timing.delay else []
    taken += [f"a turn of {timing.turn:.3g}"] if timing.turn and not timing.ripple else []
    middle = " about the middle of the sample" if timing.ripple else ""
    taken += [f"a hold in the stationary frame{middle}"] if timing.hold == "stationary" else []
    if taken:
        yield (
            f"The voltage acts {delay[0]:.3f} ± {delay[1]:.3f} samples after it is recorded, "
            f"turned by the rotation of {free.values['turn']:.3f} ± {free.deviation['turn']:.3f} "
            f"samples: taken into account as {', '.join(taken)}."
        )


def timing_at_rest(experiments: Sequence[Experiment]) -> Calibration:
    """Return the delay at standstill, from windows short enough for what moves there to show it."""
    lag, own = mean_lag(experiments, in_phases=False)
    if not (_DIFFERENT < abs(lag) < _MOST and own < _SURE):
        return AS_RECORDED
    delay = near_whole(-lag)
    return Calibration(
        delay,
        deviation={"delay": own} if delay % 1.0 else {},
        reasons=(
            f"The voltage acts {-lag:.3f} ± {own:.3f} samples after it is recorded: taken into "
            f"account as a delay of {delay:.3g}.",
        ),
    )


def near_whole(value: float, near: float = _NEAR) -> float:
    """Return a number of samples, the next whole one where it is near."""
    return float(round(value)) if abs(value - round(value)) < near else value
