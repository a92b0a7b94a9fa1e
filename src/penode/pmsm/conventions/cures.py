"""Signs, order and speed: every single cure of a recording is tried by one voltage balance.

A cure is advised where the balance with it is clearly better than as recorded, and than with every
other cure; cures that are as good are named beside it. The best is applied before the next is
looked for.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from typing import TypeAlias

import numpy as np

from penode.data.experiment import Experiment
from penode.pmsm.balance.trial_balance import Trial, trial_window
from penode.pmsm.conventions.broken_convention import BrokenConvention, Judged, with_channels
from penode.pmsm.conventions.motion import (
    MOST_POLE_PAIRS,
    SPEED_UNITS,
    OfShaft,
    angle_over_speed,
)
from penode.pmsm.conventions.speed_balance import SpeedBalance
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES
from penode.pmsm.machine.standstill import stands_still
from penode.pmsm.recording.stationary_frame import LINK

#: Misfit with a cure over that of the recording as it is.
_CLEARER = 0.7
#: The same with another scale of one axis: right units leave at most 0.42. Of 192 pieces of 0.15
#: and 0.25 s of recordings that are right none left less than 0.79 in rms; whole ones leave 1.01.
_MUCH_SMALLER = 0.5
#: Largest value of one axis over that of the other below which its unit may be another.
_OTHER_UNIT = 0.02
#: Misfit with another cure over that with the best, up to which it is as good.
_AS_GOOD = 1.1
#: Misfit at the next pole pairs, up to twice as many or half, over that as recorded, from which the
#: pole pairs are determined.
_NEXT, _DETERMINED = 1.25, 1.05
#: Fraction of the voltages that no cure explains in a recording that is of no such machine: of
#: right ones at most 0.05 is left, at 60 rpm behind a dead time.
_UNEXPLAINED = 0.12
#: The same at standstill, where windows are short and the knee of a reluctance machine is too sharp
#: for a polynomial: of right ones up to 0.54 is left.
_UNEXPLAINED_AT_REST = 0.7
#: Fraction of the voltages that is left at least where currents or voltages spin.
_SPINS = 0.05
#: Fraction of the currents below which no inductance is positive in a recording of no machine.
_NOWHERE = 0.1
#: Fraction of the currents at which the inductance is positive where nothing else is wrong.
_EVERYWHERE = 0.8
#: Misfit with other pole pairs over that as recorded, where an angle agrees with the speed.
_MUCH_CLEARER = 0.35
#: Fewest windows in a recording.
_FEWEST = 16
#: Longest windows over those that null the sixth harmonic of the speed as recorded.
_LONGEST = 3
#: Factors of the speed beside the whole ones: pole pairs taken for others, up to so many.
_RATIO_OF = 8
_SPEED, _UNIT = "omega_el", "unit of the speed"
#: What d and q components are multiplied by, row by row.
Matrix: TypeAlias = tuple[tuple[float, float], tuple[float, float]]
_SAME: Matrix = ((1.0, 0.0), (0.0, 1.0))
_SWAP: Matrix = ((0.0, 1.0), (1.0, 0.0))
_D: Matrix = ((-1.0, 0.0), (0.0, 1.0))
_Q: Matrix = ((1.0, 0.0), (0.0, -1.0))
_BOTH: Matrix = ((-1.0, 0.0), (0.0, -1.0))


@dataclass(frozen=True)
class Cure:
    """One thing that may be wrong with the channels, as what sets it right."""

    name: str
    channels: tuple[str, ...]
    # An entry of the study file, or what to do.
    fix: str
    # What the d and q components are multiplied by, of the voltages too.
    currents: Matrix = _SAME
    voltages: Matrix = _SAME
    # Of the speed.
    factor: float = 1.0
    # Kinds, of u and i, of which two phases change places; needs theta_el.
    exchanged: str = ""
    # Direction of the third phase, rad.
    axis: float = 0.0

    def applied(self, experiment: Experiment) -> Experiment:
        """Return the recording with this set right."""
        i_d, i_q = np.array(self.currents) @ experiment.stack(CURRENTS).T
        u_d, u_q = np.array(self.voltages) @ experiment.stack(VOLTAGES).T
        speed = self.factor * experiment.channels[_SPEED]
        changed = {"i_d": i_d, "i_q": i_q, "u_d": u_d, "u_q": u_q, _SPEED: speed}
        for kind in self.exchanged:
            d, q = f"{kind}_d", f"{kind}_q"
            turn = np.exp(2j * (self.axis - experiment.channels["theta_el"]))
            mirrored = turn * (changed[d] - 1j * changed[q])
            changed |= {d: mirrored.real, q: mirrored.imag}
        return with_channels(experiment, changed)


AS_RECORDED = Cure("", (), "")
#: A channel may have a sign in the study file already.
_GIVEN = ", or remove that where the study file has it"
#: The first of equals is named first.
_SIGNS = (
    Cure("reversed speed", (_SPEED,), f"give omega_el sign = -1{_GIVEN}", factor=-1.0),
    Cure("negative q current", ("i_q",), f"give i_q sign = -1{_GIVEN}", _Q),
    Cure("negative q voltage", ("u_q",), f"give u_q sign = -1{_GIVEN}", voltages=_Q),
    Cure("negative d current", ("i_d",), f"give i_d sign = -1{_GIVEN}", _D),
    Cure("negative d voltage", ("u_d",), f"give u_d sign = -1{_GIVEN}", voltages=_D),
    Cure(
        "currents counted out of the machine",
        CURRENTS,
        f"give i_d and i_q sign = -1{_GIVEN}",
        _BOTH,
    ),
    Cure("exchanged currents", CURRENTS, "exchange the columns of i_d and i_q", _SWAP),
    Cure("exchanged voltages", VOLTAGES, "exchange the columns of u_d and u_q", voltages=_SWAP),
    Cure(
        "exchanged axes",
        (*CURRENTS, *VOLTAGES),
        "exchange the columns of i_d and i_q, and of u_d and u_q",
        _SWAP,
        _SWAP,
    ),
)


def _scales(experiment: Experiment) -> list[Cure]:
    """Return cures of one axis in another unit than the other, or in rms; of both none shows."""
    found = []
    for kind, (d, q) in (("currents", CURRENTS), ("voltages", VOLTAGES)):
        for small, large in ((d, q), (q, d)):
            units = (
                f"give {small} and {large} the units of their columns: {small} is 1000 times too "
                f"small, or {large} too large"
            )
            rms = f"give {small} rms = true, or remove it from {large} where the study file has it"
            named = [("rms beside peak", 2.0**0.5, rms)]
            size, other = (np.abs(experiment.channels[name]).max() for name in (small, large))
            if size < _OTHER_UNIT * other:
                named.append(("different units", 1000.0, units))
            for name, factor, fix in named:
                of_d, of_q = (factor, 1.0) if small == d else (1.0, factor)
                scaled: Matrix = ((of_d, 0.0), (0.0, of_q))
                both = (scaled, _SAME) if kind == "currents" else (_SAME, scaled)
                found.append(Cure(f"{name} ({kind})", (d, q), fix, *both))
    return found


def _exchanges() -> tuple[Cure, ...]:
    """Return cures of two phases exchanged; of all quantities only the magnet shows which two."""
    kinds = (
        ("ui", "currents and voltages", (*CURRENTS, *VOLTAGES)),
        ("i", "currents", CURRENTS),
        ("u", "voltages", VOLTAGES),
    )
    return tuple(
        Cure(
            "swapped phases",
            names,
            f"exchange phases {pair} of the {word} before they are turned into dq",
            exchanged=kind,
            axis=axis * np.pi / 3,
        )
        for kind, word, names in kinds
        for pair, axis in (("b and c", 0), ("a and c", 2), ("a and b", 4))
    )


_PHASES = _exchanges()


def judge_cures(experiment: Experiment, said: OfShaft) -> tuple[Judged, str]:
    """Find channels that count the other way or are exchanged, and a speed that is not electrical.

    The recording comes with the finding set right. The text says why pole pairs cannot be
    determined, empty where they can or an angle shows them.
    """
    units = [] if "theta_el" in experiment.channels else _units()
    tried = _tried(experiment, (*_SIGNS, *_factors(said), *units))
    standing = tried[0].standing
    scales = _tried(experiment, _scales(experiment))
    tried += [one for one in scales if one.misfit < _MUCH_SMALLER]
    if standing.residual > _SPINS and "theta_el" in experiment.channels:
        tried += _tried(experiment, _PHASES)
    # Of cures that differ by the direction of the d axis the magnet shows which is right.
    best = min(tried, key=lambda one: (float(f"{one.misfit:.3g}"), -float(f"{one.emf:.3g}")))
    angle = _angle_sign(experiment)
    clear = _MUCH_CLEARER if angle and abs(best.cure.factor) != 1.0 else _CLEARER
    fastest = max(one.cure.factor for one in tried)
    unclear = best.misfit > clear or best.cure.factor == fastest > 1.0  # that is no minimum
    if _is_doubtful(experiment, standing if unclear else best.trial):
        both = _tried(experiment, [_with_unit(sign, unit) for unit in units for sign in _SIGNS])
        two = min(both, key=lambda one: one.misfit, default=best)
        if two.misfit < _CLEARER * min(best.misfit, 1.0) and two.trial.definite > _EVERYWHERE:
            return _found(experiment, two, []), ""
    if unclear:
        return _as_recorded(experiment, standing, angle), _undetermined(experiment, tried)
    if _is_no_machine(experiment, best.trial):
        return _as_recorded(experiment, best.trial, angle), ""
    like = [
        one.cure
        for one in tried
        if one.misfit < _AS_GOOD * best.misfit and one.emf > best.emf / _AS_GOOD
    ]
    return _found(experiment, best, like), ""


def _as_recorded(experiment: Experiment, standing: Trial, angle: int) -> Judged:
    """Return what is wrong with a recording that no cure of currents, voltages or speed helps."""
    if _is_no_machine(experiment, standing):
        finding = BrokenConvention(
            "no synchronous machine",
            experiment.name,
            (*CURRENTS, *VOLTAGES, _SPEED),
            "the voltage balance of a machine whose flux linkage follows its currents leaves "
            f"{100 * standing.residual:.2g} % of the voltages and an inductance that is positive "
            f"at {100 * standing.definite:.0f} % of the currents, whatever sign, order or factor "
            "of the speed is tried",
            "check that all channels are of one recording of one PMSM or reluctance machine, in "
            "its rotor's frame, and that u_d and u_q are not commands from before the voltage "
            f"limiter (with {LINK} its samples are left out)",
        )
        return finding, experiment
    if angle >= 0:
        return None, experiment
    finding = BrokenConvention(
        "reversed angle",
        experiment.name,
        ("theta_el",),
        "the angle turns against the speed, which the voltage balance confirms",
        f"give theta_el sign = -1{_GIVEN}",
    )
    return finding, with_channels(experiment, {"theta_el": -experiment.channels["theta_el"]})


def _is_no_machine(experiment: Experiment, trial: Trial) -> bool:
    most = _UNEXPLAINED_AT_REST if stands_still([experiment]) else _UNEXPLAINED
    return trial.residual > most or trial.definite < _NOWHERE


def _is_doubtful(experiment: Experiment, trial: Trial) -> bool:
    """Whether more than one thing may be wrong with a recording."""
    return _is_no_machine(experiment, trial) or trial.definite < _EVERYWHERE


def _found(experiment: Experiment, best: "_Tried", like: Sequence[Cure]) -> Judged:
    """Return the finding of a cure, beside others like it, and the recording with it."""
    angle, cure = _angle_sign(experiment), best.cure
    before, after, fix = best.standing, best.trial, cure.fix
    if cure.factor == -1.0 and angle > 0:
        fix = "give omega_el and theta_el sign = -1, or i_q and u_q if it is the q axis"
    elif cure.factor == -1.0 and angle == 0:
        fix += ", or i_q and u_q if it is the q axis that points backwards"
    others = {one.name: one.fix for one in like if one.name != cure.name}
    if unit := others.pop(_UNIT, ""):
        fix += f"; or {unit}, which is as good"
    if names := list(others):
        fix += f" (as good: {', '.join(names)})"
    against = "the angle turns against the speed, and " if angle < 0 else ""
    evidence = (
        f"{against}the voltage balance leaves {100 * before.residual:.2g} % of the voltages "
        f"unexplained and an inductance that is positive at {100 * before.definite:.0f} % of the "
        f"currents; with this set right {100 * after.residual:.2g} % and {100 * after.definite:.0f}"
        " %"
    )
    return BrokenConvention(cure.name, experiment.name, cure.channels, evidence, fix), cure.applied(
        experiment
    )


def _undetermined(experiment: Experiment, tried: Sequence["_Tried"]) -> str:
    """Return why pole pairs cannot be determined: others leave as little, and there is no angle."""
    if "theta_el" in experiment.channels or stands_still([experiment]):
        return ""
    speeds = [(one.cure.factor, one.misfit) for one in tried if one.cure.factor > 0]
    near = [misfit for f, misfit in speeds if _NEXT <= max(f, 1.0 / f) <= 2.0]
    if min(near) > _DETERMINED:
        return ""
    return (
        f"{experiment.place.recording}: without theta_el neither the pole pairs that omega_el "
        "counts with nor a delay of the voltage can be determined; record theta_el beside, or "
        "faster currents."
    )


def _factors(said: OfShaft) -> list[Cure]:
    """Return cures of a speed of the shaft, or with other pole pairs."""
    pairs = said.pole_pairs
    given = {Fraction(n, pairs) for n in range(1, MOST_POLE_PAIRS + 1)} if pairs else set()
    if _SPEED in said.channels and pairs:
        return [_of_pole_pairs(f, pairs) for f in sorted(given - {Fraction(1)})]
    whole = {Fraction(n) for n in range(2, MOST_POLE_PAIRS + 1)}
    ratios = {Fraction(p, q) for p in range(1, _RATIO_OF + 1) for q in range(1, _RATIO_OF + 1)}
    factors = whole | {f for f in ratios if f > Fraction(1, 3)}
    if pairs:
        factors |= {f for f in given if f < 2} | {Fraction(pairs)}
    return [_of_factor(f, pairs) for f in sorted(factors - {Fraction(1)})]


def _units() -> list[Cure]:
    """Return cures of a speed in another unit than was said, which an angle would have shown."""
    return [
        Cure(_UNIT, (_SPEED,), f'give omega_el unit = "{unit}"', factor=factor)
        for unit, factor in SPEED_UNITS.items()
    ]


def _with_unit(sign: Cure, unit: Cure) -> Cure:
    """Return the cure of a channel together with that of the speed's unit."""
    name, channels = f"{unit.name}, and {sign.name}", (*unit.channels, *sign.channels)
    factor, fix = sign.factor * unit.factor, f"{unit.fix}, and {sign.fix}"
    return replace(sign, name=name, channels=channels, fix=fix, factor=factor)


def _of_pole_pairs(factor: Fraction, pole_pairs: int) -> Cure:
    """Return the cure of a speed of the shaft that was multiplied by the wrong number."""
    name, right = "wrong pole pairs", factor * pole_pairs
    fix = f"give pole_pairs = {right} in place of {pole_pairs}"
    if right == 1:
        name, fix = "pole pairs counted twice", f"leave out mechanical = true of {_SPEED}"
    return Cure(name, (_SPEED,), fix, factor=float(factor))


def _of_factor(factor: Fraction, pole_pairs: int | None) -> Cure:
    """Return the cure of a speed that was said to be electrical."""
    name, fix = (
        "wrong pole pairs",
        (f"count omega_el with {factor.numerator} pole pairs for {factor.denominator}"),
    )
    if factor == pole_pairs or (pole_pairs is None and factor.denominator == 1):
        name = "mechanical speed for electrical"
        fix = "give omega_el mechanical = true"
        fix += "" if pole_pairs else f", and pole_pairs (about {factor.numerator})"
    return Cure(name, (_SPEED,), fix, factor=float(factor))


@dataclass(frozen=True, eq=False)
class _Tried:
    """A cure, its balance, and that of the recording as it is in the same windows."""

    cure: Cure
    trial: Trial
    standing: Trial

    @property
    def misfit(self) -> float:
        """Misfit over that of the recording as it is."""
        return self.trial.misfit / max(self.standing.misfit, 1e-300)

    @property
    def emf(self) -> float:
        """What the magnet of the balance induces, over the speed as it was recorded."""
        return float(self.trial.magnet[0]) * abs(self.cure.factor)


def _tried(experiment: Experiment, cures: Sequence[Cure]) -> list[_Tried]:
    """Return the balance with each cure.

    Windows null the sixth harmonic of the speed as recorded. Those of a speed that is lower are
    longer, up to three times: the shorter ones would leave its harmonics.
    """
    own, most = trial_window(experiment), max(len(experiment) // _FEWEST, 1)

    @cache
    def balance(channels: Cure, length: int) -> SpeedBalance:
        return SpeedBalance(channels.applied(experiment), length)

    @cache
    def standing(length: int) -> Trial:
        return balance(AS_RECORDED, length).at()

    tried = []
    for cure in cures:
        length = min(math.ceil(1.0 / abs(cure.factor)) * own, _LONGEST * own, most)
        channels = replace(cure, name="", channels=(), fix="", factor=1.0)
        trial = balance(channels, length).at(cure.factor)
        tried.append(_Tried(cure, trial, standing(length)))
    return tried


def _angle_sign(experiment: Experiment) -> int:
    if "theta_el" not in experiment.channels:
        return 0
    return -1 if angle_over_speed(experiment) < 0 else 1
