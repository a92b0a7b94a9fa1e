"""Whether a term of the model is there: its evidence in the voltage balance, what stays open."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from penode.data.experiment import Experiment
from penode.horizon.identifiability import THRESHOLD
from penode.pmsm.balance.doubt import NOTICED, Doubt, probability
from penode.pmsm.balance.knee import knee_of, with_knee
from penode.pmsm.balance.voltage_balance import BalanceForm, BalanceSolution
from penode.pmsm.machine.dead_time import DeadTime, MeanDeadTime, PhaseDeadTime, PhaseSigns
from penode.pmsm.machine.term_registry import (
    channels_of,
    physical_places,
    physical_values,
    with_physical,
)
from penode.pmsm.machine.terms import ANGLE, Term
from penode.training.weak_form import OVERLAP

#: Share of the largest voltage across R below which a voltage is left to doubt: as much is left
#: over where the balance's map is not quite that of the machine.
_MATTERS = 2e-3
#: What would decide whether a term acts.
_MORE = "Record longer, or more amplitudes of the current."


@dataclass(frozen=True, eq=False)
class Judged:
    """What became of a candidate, why in sentences, and what may be otherwise."""

    # As it joins the model; None where it is left out.
    term: Term | None
    reason: str
    # Of the model with the term.
    balance: BalanceSolution | None = None
    doubts: tuple[Doubt, ...] = ()


def judged(
    experiments: Sequence[Experiment], terms: Sequence[Term], candidate: Term, certain: bool = False
) -> Judged:
    """Return whether a candidate is in beside terms; if `certain`, whatever recordings show.

    A dead time whose i_0 is not set takes the knee that the recordings show. Without the rotor's
    angle it is what dead time takes on average, along the current.
    """
    missing = [n for e in experiments for n in channels_of((candidate,)) if n not in e.channels]
    title = candidate.title
    if ANGLE.name in missing and isinstance(candidate, PhaseSigns):
        along = judged(experiments, terms, MeanDeadTime(), certain)
        why = f"{along.reason} {title} itself takes {ANGLE.name}, which was not recorded."
        return replace(along, reason=why)
    if missing:
        return Judged(None, f"{title} was left out: {missing[0]} was not recorded.")
    if not isinstance(candidate, PhaseSigns) or candidate.dead_time_current is not None:
        return _presence(experiments, terms, candidate, certain)
    if not certain:
        usual = _presence(experiments, terms, DeadTime(), certain)
        if usual.term is None:  # a voltage too small for any knee to show
            return usual
    shaped = with_knee(experiments, terms, by_phase=isinstance(candidate, PhaseDeadTime))
    presence = _presence(experiments, terms, DeadTime(**knee_of(shaped.term)), certain)
    if presence.term is None:
        return presence
    reason = f"{presence.reason} {_shape(shaped.term)}"
    return Judged(shaped.term, reason, presence.balance, shaped.doubts)


def _presence(
    experiments: Sequence[Experiment], terms: Sequence[Term], candidate: Term, certain: bool
) -> Judged:
    balance = BalanceForm.of(experiments, True, (*terms, candidate)).solve(experiments)
    title, (_, name) = candidate.title, physical_places((candidate,))[0]
    value, deviation = balance.physical[name]
    shown = with_deviation(value, deviation)
    if certain:
        return Judged(
            candidate, f"{title}: before training the voltage balance shows {shown}.", balance
        )
    equations = len(balance.equations.target) / OVERLAP
    taken = max(value, 0.0)  # no inverter adds a voltage
    share = probability(taken / max(deviation, 1e-300), equations)
    largest = abs(balance.resistance) * balance.form.polynomial.current_scale
    if share < 0.5 or taken < _MATTERS * largest:
        (term,) = with_physical(
            (candidate.prepared(balance.form.polynomial.current_scale),),
            [math.hypot(taken, deviation)],
        )
        doubt = Doubt(title.lower(), _MORE, term, None, math.sqrt(share))
        none = ", and a negative one is none" if value < 0 else ""
        why = f"{title} was left out: the voltage balance shows {shown} of it{none}."
        if share >= 0.5:
            why = f"{why[:-1]}, too little beside the {largest:.2g} V of R to be told from the map."
        return Judged(None, why, None, (doubt,) if share > NOTICED else ())
    if min(balance.independence.values()) < THRESHOLD:
        why = (
            f"{title} was left out: of one current amplitude its voltage ({shown}) cannot be "
            "distinguished from R; record several amplitudes."
        )
        return Judged(None, why)
    why = f"{title} was included: before training the voltage balance shows some {value:.3g} V."
    return Judged(candidate, why, balance)


def _shape(term: PhaseSigns) -> str:
    width = float(np.asarray(term.dead_time_current))
    values = list(physical_values((term,)).values())
    phases = f", {', '.join(f'{v:.3g}' for v in values)} V by phase" if len(values) > 1 else ""
    soft = "soft" if term.dead_time_tail == "arctan" else "that of recharged nodes"
    kind = "sharp" if term.dead_time_softness is None else f"{soft} (training finds how much)"
    if term.junction_voltage is not None:
        rise = 1e3 * float(np.asarray(term.junction_voltage))
        kind = f"{kind}, beside it the drop of junctions rises by {rise:.2g} mV an e-fold"
    return (
        f"Its knee, where the current changes sign, is {kind}, {width:.2g} A wide{phases}; what "
        "the inverter drops in proportion to the current is in R."
    )


def with_deviation(value: float, deviation: float) -> str:
    """Return a voltage with its deviation, of two digits."""
    decimals = max(1 - math.floor(math.log10(max(deviation, 1e-6))), 0)
    return f"{round(value, decimals) + 0.0:.{decimals}f} ± {deviation:.{decimals}f} V (std)"
