"""When and in which frame the recorded voltage acts: estimated with the map, by the weak form.

A voltage that acts tau samples later than it is recorded, and turned by kappa omega T, is to first
order u - tau T du/dt + kappa omega T J u, linear in both. A mirror symmetric map of splines cannot
stand in for either, as a free one would for the turn.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from penode.data.experiment import Experiment
from penode.pmsm.balance.equations import CURRENTS, VOLTAGES, balance_equations
from penode.pmsm.balance.smoothing import Roughness, deviations, smoothed
from penode.pmsm.balance.voltage_balance import harmonic_window
from penode.pmsm.machine.coenergy_map import MEAN, CoenergyPart, columns, roughness
from penode.pmsm.machine.frames import quarter_turned
from penode.pmsm.machine.holds import mean_over_samples, turned_voltage
from penode.pmsm.machine.term_registry import completed, physical_values
from penode.pmsm.machine.terms import ANGLE, DeadTime, Term
from penode.training.weak_form import WeakRegression, join

#: -2 log likelihood by which another timing has to be better, and samples that it has to differ by.
_CLEAR, _DIFFERENT = 25.0, 0.2
#: Samples from a whole number, and from half a turn back, that are taken for these.
_NEAR = 0.1
#: Samples beyond which, and deviation above which, an estimate is not believed.
_MOST, _SURE = 3.0, 0.05
#: Radians a sample below which the rotor stands still.
_STANDSTILL = 1e-4


@dataclass(frozen=True)
class VoltageTiming:
    """When and in which frame the recorded voltage acts.

    Attributes
    ----------
    delay : float
        Samples by which it acts later than it is recorded.
    hold : str
        Frame in which it then stands still for a sample, a key of
        `penode.pmsm.machine.holds.HOLDS`.
    turn : float
        Samples of rotation by which it is turned beside that.
    reason : str
        What was estimated, as a sentence.
    """

    delay: float = 0.0
    hold: str = "dq"
    turn: float = 0.0
    reason: str = ""

    @property
    def reasons(self) -> tuple[str, ...]:
        """The reason as a tuple, empty where there is none."""
        return (self.reason,) if self.reason else ()

    def applied(self, experiment: Experiment) -> Experiment:
        """Return the recording with the voltage that acts, cut at its ends where there is none."""
        if self.turn:
            experiment = turned_voltage(experiment, self.turn)
        if not self.delay:
            return experiment
        count = len(experiment)
        first, last = math.ceil(max(self.delay, 0.0)), count + math.floor(min(self.delay, 0.0))
        channels = {name: values[first:last] for name, values in experiment.channels.items()}
        at = np.arange(first, last) - self.delay
        for name in VOLTAGES:  # of two voltages held one after the other the mean acts
            channels[name] = np.interp(at, np.arange(count), experiment.channels[name])
        return replace(experiment, channels=channels)

    def acting(self, experiment: Experiment) -> Experiment:
        """Return an applied recording with each sample's mean voltage in the turning frame."""
        return mean_over_samples(experiment) if self.hold == "stationary" else experiment


AS_RECORDED = VoltageTiming()


def voltage_timing(experiments: Sequence[Experiment], terms: Sequence[Term] = ()) -> VoltageTiming:
    """Estimate when and in which frame the voltages of recordings act.

    Parameters
    ----------
    experiments : sequence of Experiment
        Recordings with i_d, i_q (A), u_d, u_q (V), omega_el (rad/s) and the channels of the terms.
    terms : sequence of Term
        Of the voltage equation; a dead time is allowed for where the angle was recorded.
    """
    roles = {term.role for term in terms}
    angle = all(ANGLE.name in e.channels for e in experiments)
    extra = (DeadTime(),) if angle and DeadTime.role not in roles else ()
    reach = max(float(np.abs(e.stack(CURRENTS)).max()) for e in experiments)
    every = tuple(term.prepared(reach) for term in completed((*terms, *extra)))
    turning = max(float(np.abs(e.channels["omega_el"]).max()) * e.time_step for e in experiments)
    estimated = ("delay", "turn") if turning > _STANDSTILL else ("delay",)
    part = CoenergyPart.zero(MEAN, True)
    whole = join([_equations(e, every, part, reach, estimated) for e in experiments])
    first = len(estimated) + len(physical_values(every))
    penalty = Roughness.of(first, roughness(part))
    free = smoothed(whole, [penalty])
    values = dict(zip(estimated, free.solution, strict=False))
    own = dict(zip(estimated, deviations(whole, [penalty], free), strict=False))
    without = WeakRegression(whole.matrix[:, len(estimated) :], whole.target)
    plain = smoothed(without, [replace(penalty, first=first - len(estimated))])
    if max(map(abs, values.values())) > _MOST or free.evidence > plain.evidence - _CLEAR:
        return AS_RECORDED
    sure = {name: value for name, value in values.items() if own[name] < _SURE}
    delay, turn = sure.get("delay", 0.0), sure.get("turn", 0.0)
    delay = 0.0 if abs(delay) < _DIFFERENT else _near_whole(delay)
    hold = "stationary" if abs(turn + 0.5) < _DIFFERENT else "dq"
    left = turn + 0.5 if hold == "stationary" else turn
    left = 0.0 if abs(left) < _DIFFERENT else left
    if not delay and not left and hold == "dq":
        return AS_RECORDED
    shown = [f"{values[name]:.3f} ± {own[name]:.3f}" for name in estimated]
    reason = f"The voltage acts {shown[0]} samples after it is recorded"
    if len(shown) > 1:
        reason += f", turned by the rotation of {shown[1]} samples"
    taken = [f"a delay of {delay:.3g}"] if delay else []
    taken += [f"a turn of {left:.3g}"] if left else []
    taken += ["a hold in the stationary frame"] if hold == "stationary" else []
    return VoltageTiming(delay, hold, left, f"{reason}: taken into account as {', '.join(taken)}.")


def _near_whole(value: float) -> float:
    whole = round(value)
    return float(whole) if abs(value - whole) < _NEAR else value


def _equations(
    experiment: Experiment,
    terms: Sequence[Term],
    part: CoenergyPart,
    reach: float,
    estimated: Sequence[str],
) -> WeakRegression:
    voltage = experiment.stack(VOLTAGES)
    nothing, step = np.zeros_like(voltage), experiment.time_step
    turn = step * experiment.channels["omega_el"][:, None] * quarter_turned(voltage.T).T
    further = {"delay": (step * voltage, nothing), "turn": (nothing, turn)}
    basis = columns(part, experiment.stack(CURRENTS) / reach)[0]
    length = harmonic_window(experiment)
    return balance_equations(experiment, terms, basis, length, [further[n] for n in estimated])
