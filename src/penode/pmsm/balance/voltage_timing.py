"""When a recorded voltage acts, and how far it is turned."""

from collections.abc import Iterator, Sequence

import numpy as np

from penode.data.experiment import Experiment
from penode.pmsm.balance.calibration import AS_RECORDED, Calibration
from penode.pmsm.balance.calibration_equations import Estimate
from penode.pmsm.balance.trial_balance import imitated_lag, lag_of_voltage
from penode.pmsm.balance.voltage_balance import harmonic_window

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
#: Samples beyond which, and deviation above which, an estimate is not believed.
_MOST, _SURE = 3.0, 0.1


def timing_of(free: Estimate, plain: float, experiments: Sequence[Experiment]) -> Calibration:
    """Return the timing of the voltages where it is clear, else none.

    Parameters
    ----------
    free : Estimate
        With delay and turn.
    plain : float
        Evidence without them.
    experiments : sequence of Experiment
        That they are of; a delay that the controller's answer to noise imitates is none.
    """
    values = {name: free.values[name] for name in TIMING}
    if max(map(abs, values.values())) > _MOST or free.evidence > plain - CLEAR:
        return AS_RECORDED
    sure = {name: value for name, value in values.items() if free.deviation[name] < _SURE}
    delay, turn = sure.get("delay", 0.0), sure.get("turn", 0.0)
    own = np.hypot(free.deviation["delay"], imitated_lag(experiments, harmonic_window))
    delay = 0.0 if abs(delay) < SIGNIFICANT * own else near_whole(delay)
    behind = turn + 0.5  # what a voltage held in the stationary frame is turned by at the sample
    hold = "stationary" if abs(behind) < _DIFFERENT or not near_whole(behind) % 1.0 else "dq"
    left = behind if hold == "stationary" else turn
    left = 0.0 if abs(left) < _DIFFERENT else near_whole(left)
    return Calibration(delay, hold, left)


def timing_sentences(
    timing: Calibration, delay: tuple[float, float], free: Estimate
) -> Iterator[str]:
    """Yield what was found of the timing, and what is made of it; nothing of none.

    Parameters
    ----------
    timing : Calibration
        As it is taken into account.
    delay : tuple of float
        As it was estimated, and its deviation, in samples.
    free : Estimate
        With the turn.
    """
    taken = [f"a delay of {timing.delay:.3g}"] if timing.delay else []
    taken += [f"a turn of {timing.turn:.3g}"] if timing.turn else []
    taken += ["a hold in the stationary frame"] if timing.hold == "stationary" else []
    if taken:
        yield (
            f"The voltage acts {delay[0]:.3f} ± {delay[1]:.3f} samples after it is recorded, "
            f"turned by the rotation of {free.values['turn']:.3f} ± {free.deviation['turn']:.3f} "
            f"samples: taken into account as {', '.join(taken)}."
        )


def timing_at_rest(experiments: Sequence[Experiment]) -> Calibration:
    """Return the delay at standstill, from windows short enough for what moves there to show it.

    Parameters
    ----------
    experiments : sequence of Experiment
        With i_d, i_q, u_d and u_q.
    """
    lags, deviations = np.array([lag_of_voltage(e, in_phases=False) for e in experiments]).T
    weights = 1.0 / np.maximum(deviations, 1e-9) ** 2
    lag, own = float(np.average(lags, weights=weights)), float(np.sum(weights) ** -0.5)
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
