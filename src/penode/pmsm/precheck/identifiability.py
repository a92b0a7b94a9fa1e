"""How well recordings determine the physical parameters, before any training, and what would help.

Independence rho is the fraction of a parameter's regressor in the voltage balance that the map and
the other parameters do not explain. It depends on currents and speed alone, so a change of the
recording is tried on the recordings at hand: the same currents at another speed, or run faster.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.horizon.identifiability import THRESHOLD
from penode.pmsm.balance.voltage_balance import BalanceForm, BalanceSolution
from penode.pmsm.conventions.broken_convention import with_channels
from penode.pmsm.machine.dead_time import DeadTime
from penode.pmsm.machine.flux_maps import FLUX_MAPS
from penode.pmsm.machine.terms import Term

#: The skew part of a free map, as a voltage drop over R, from which it is an alarm.
_ALARM = 0.1
#: How much faster the currents are, and the fraction of them that is left, in trials.
_FASTER, _LEAST_AMPLITUDE = 4, 0.3
_POINTS = 300


@dataclass(frozen=True)
class Profile:
    """Profile of R: what the voltage balance loses with R held, all else fitted anew."""

    # "reciprocal" or "unconstrained".
    flux_map: str
    # Where the balance fits best, ohm.
    resistance: float
    # 1/ohm^2: the squares of the balance rise by 1 + steepness (R - resistance)^2.
    steepness: float

    def rise(self, resistance: FloatArray) -> FloatArray:
        """Return by what fraction the balance's residual rises with R held, same shape."""
        away = resistance - self.resistance
        return np.asarray(np.sqrt(1 + self.steepness * away**2) - 1)


@dataclass(frozen=True)
class Identifiability:
    """How well the physical parameters are determined with a kind of flux map."""

    flux_map: str
    # rho of each physical parameter: 1 its own, 0 indistinguishable.
    independence: Mapping[str, float]
    # The gauge alarm as a sentence, empty where there is none.
    alarm: str
    # The cheapest change that helps, tried, as a sentence; empty where none is needed.
    repair: str
    # With a reciprocal map and with an unconstrained one.
    profiles: tuple[Profile, ...]

    @property
    def indistinguishable(self) -> tuple[str, ...]:
        """Parameters that these recordings cannot determine."""
        return tuple(name for name, rho in self.independence.items() if rho < THRESHOLD)


def identifiability_of(
    recordings: Sequence[Experiment], kind: str, terms: Sequence[Term]
) -> Identifiability:
    """Judge what recordings determine together; resistance and rotation may be left unsaid."""
    reciprocal = FLUX_MAPS[kind].reciprocal
    balances = {kind: _balance(recordings, kind, terms) for kind in (True, False)}
    solved = balances[reciprocal]
    names = {True: "reciprocal", False: "unconstrained"}
    poor = min(solved.independence.values()) < THRESHOLD
    return Identifiability(
        kind,
        solved.independence,
        "" if reciprocal else _alarm(recordings, solved),
        _repair(recordings, reciprocal, terms) if poor else "",
        tuple(
            Profile(names[k], b.resistance, b.equations.steepness(0)) for k, b in balances.items()
        ),
    )


def _balance(
    recordings: Sequence[Experiment], reciprocal: bool, terms: Sequence[Term]
) -> BalanceSolution:
    return BalanceForm.of(recordings, reciprocal, terms).solve(recordings)


def _alarm(recordings: Sequence[Experiment], solved: BalanceSolution) -> str:
    """Say by how much R and a skew part of the map have been exchanged.

    R + dR with psi + (dR / omega) J i is the same balance at constant omega; the skew part
    s = (d psi_d / d i_q - d psi_q / d i_d) / 2 of a machine is zero, so dR = -omega s.
    """
    currents = np.concatenate([e.stack(("i_d", "i_q")) for e in recordings])
    points = currents[:: max(len(currents) // _POINTS, 1)]
    slopes = solved.flux(points, np.zeros(len(points)))[1]
    skew = 0.5 * float(np.mean(slopes[:, 0, 1] - slopes[:, 1, 0]))
    speed = float(np.median(np.concatenate([e.channels["omega_el"] for e in recordings])))
    false = -speed * skew
    if abs(false) < _ALARM * abs(solved.resistance):
        return ""
    return (
        f"Gauge alarm: this map takes on a skew part of {1e6 * skew:.3g} uH, which no machine has, "
        f"and R of {1e3 * solved.resistance:.4g} mΩ is false by about {1e3 * false:.3g} mΩ."
    )


def _repair(recordings: Sequence[Experiment], reciprocal: bool, terms: Sequence[Term]) -> str:
    """Return the first change, the cheapest first, that makes every parameter distinguishable."""
    trials: list[tuple[str, Sequence[Experiment], bool, Sequence[Term]]] = []
    if not reciprocal:
        trials.append(("Use a reciprocal map (--flux-map coenergy)", recordings, True, terms))
    without = [term for term in terms if term.role != DeadTime.role]
    if len(without) < len(terms):
        text = "Leave the dead time out (--no-inverter), which R then contains"
        varied = [*recordings, *map(_varied, recordings)]
        trials.append(("Vary the amplitude of the currents", varied, reciprocal, terms))
        trials.append((text, recordings, reciprocal, without))
    changes = {
        "Add a recording at half the speed": [_at_speed(e, 0.5) for e in recordings],
        "Add a recording with the speed reversed": [_at_speed(e, -1.0) for e in recordings],
        f"Add a recording with the currents moving {_FASTER} times as fast": [
            _faster(e) for e in recordings
        ],
    }
    trials += [(t, [*recordings, *more], reciprocal, terms) for t, more in changes.items()]
    reached = {}
    for text, changed, is_reciprocal, kept in trials:
        reached[text] = min(_balance(changed, is_reciprocal, kept).independence.values())
        if reached[text] >= THRESHOLD:
            return f"{text}: the least independence becomes {reached[text]:.2g}."
    best = max(reached, key=lambda text: reached[text])
    return f"{best}, and vary the currents more: by itself it reaches {reached[best]:.2g} only."


def _at_speed(experiment: Experiment, factor: float) -> Experiment:
    """Return the same currents at another speed; the voltages, which rho ignores, stay."""
    turned = {"omega_el": factor * experiment.channels["omega_el"]}
    if "theta_el" in experiment.channels:
        turned["theta_el"] = factor * np.unwrap(experiment.channels["theta_el"])
    return with_channels(experiment, turned)


def _faster(experiment: Experiment) -> Experiment:
    """Return the same course of the currents in less time, at the same speed."""
    channels = {n: values[::_FASTER] for n, values in experiment.channels.items()}
    quick = replace(experiment, channels=channels)
    if "theta_el" not in channels:
        return quick
    turned = np.cumsum(channels["omega_el"]) * experiment.time_step
    return with_channels(quick, {"theta_el": turned})


def _varied(experiment: Experiment) -> Experiment:
    """Return the same currents with an amplitude that rises over the recording."""
    rise = np.linspace(_LEAST_AMPLITUDE, 1.0, len(experiment))
    return with_channels(experiment, {n: rise * experiment.channels[n] for n in ("i_d", "i_q")})
