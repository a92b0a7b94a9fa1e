"""Signs, order and speed: every single cure of a recording is tried by one voltage balance.

A cure is advised where the balance with it is clearly better than as recorded, and than with every
other cure; cures that are as good are named beside it. The best is applied before the next is
looked for.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TypeAlias

import numpy as np

from penode.data.experiment import Experiment
from penode.pmsm.balance.trial_balance import Trial, trial_window
from penode.pmsm.conventions.broken_convention import BrokenConvention, Judged, with_channels
from penode.pmsm.conventions.motion import MOST_POLE_PAIRS, angle_over_speed
from penode.pmsm.conventions.speed_balance import SpeedBalance
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES
from penode.pmsm.machine.standstill import stands_still
from penode.pmsm.recording.stationary_frame import LINK

#: Misfit with a cure over that of the recording as it is.
_CLEARER = 0.7
#: Misfit with another cure over that with the best, up to which it is as good.
_AS_GOOD = 1.1
#: Misfit at the next pole pairs over that as recorded from which the pole pairs are determined.
_DETERMINED = 1.05
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
#: Misfit with other pole pairs over that as recorded, where an angle agrees with the speed.
_MUCH_CLEARER = 0.35
#: Fewest windows in a recording.
_FEWEST = 16
#: Factors of the speed beside the whole ones: pole pairs taken for others, up to so many.
_RATIO_OF = 8
_SPEED = "omega_el"
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


def judge_cures(experiment: Experiment, pole_pairs: int | None) -> tuple[Judged, str]:
    """Find channels that count the other way or are exchanged, and a speed that is not electrical.

    The recording comes with the finding set right. The text says why pole pairs cannot be
    determined, empty where they can or an angle shows them.
    """
    cures = (*_SIGNS, *_factors(pole_pairs))
    trials = _trials(experiment, (AS_RECORDED, *cures))
    standing = trials[0]
    if standing.residual > _SPINS and "theta_el" in experiment.channels:
        cures, trials = (*cures, *_PHASES), [*trials, *_trials(experiment, _PHASES)]
    others = trials[1:]
    # Of cures that differ by the direction of the d axis the magnet shows which is right.
    best = min(
        range(len(cures)),
        key=lambda k: (float(f"{others[k].misfit:.3g}"), -float(f"{others[k].magnet[0]:.3g}")),
    )
    angle, cure = _angle_sign(experiment), cures[best]
    clear = _MUCH_CLEARER if angle and abs(cure.factor) != 1.0 else _CLEARER
    if others[best].misfit > clear * standing.misfit:
        return _as_recorded(experiment, standing, angle), _undetermined(experiment, cures, trials)
    if _is_no_machine(experiment, others[best]):
        return _as_recorded(experiment, others[best], angle), ""
    like = [
        other
        for other, trial in zip(cures, others, strict=True)
        if trial.misfit < _AS_GOOD * others[best].misfit
        and trial.magnet[0] > others[best].magnet[0] / _AS_GOOD
    ]
    return _found(experiment, cure, like, standing, others[best]), ""


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


def _found(
    experiment: Experiment, cure: Cure, like: Sequence[Cure], standing: Trial, best: Trial
) -> Judged:
    """Return the finding of a cure, and the recording with it."""
    angle = _angle_sign(experiment)
    fix = cure.fix
    if cure.factor == -1.0 and angle > 0:
        fix = "give omega_el and theta_el sign = -1, or i_q and u_q if it is the q axis"
    elif cure.factor == -1.0 and angle == 0:
        fix += ", or i_q and u_q if it is the q axis that points backwards"
    names = list(dict.fromkeys(other.name for other in like if other.name != cure.name))
    if names:
        fix += f" (as good: {', '.join(names)})"
    against = "the angle turns against the speed, and " if angle < 0 else ""
    evidence = (
        f"{against}the voltage balance leaves {100 * standing.residual:.2g} % of the voltages "
        f"unexplained and an inductance that is positive at {100 * standing.definite:.0f} % of the "
        f"currents; with this set right {100 * best.residual:.2g} % and {100 * best.definite:.0f} %"
    )
    return BrokenConvention(cure.name, experiment.name, cure.channels, evidence, fix), cure.applied(
        experiment
    )


def _undetermined(experiment: Experiment, cures: Sequence[Cure], trials: Sequence[Trial]) -> str:
    """Return why pole pairs cannot be determined: others leave as little, and there is no angle."""
    if "theta_el" in experiment.channels or stands_still([experiment]):
        return ""
    near = [
        trial.misfit
        for cure, trial in zip(cures, trials[1:], strict=True)
        if cure.factor in (0.8, 1.25)
    ]
    if min(near) > _DETERMINED * trials[0].misfit:
        return ""
    return (
        f"{experiment.place.recording}: without theta_el neither the pole pairs that omega_el "
        "counts with nor a delay of the voltage can be determined; record theta_el beside, or "
        "faster currents."
    )


def _factors(pole_pairs: int | None) -> list[Cure]:
    """Return cures of a speed of the shaft, or with other pole pairs."""
    whole = {Fraction(n) for n in range(2, MOST_POLE_PAIRS + 1)}
    ratios = {Fraction(p, q) for p in range(1, _RATIO_OF + 1) for q in range(1, _RATIO_OF + 1)}
    given = {Fraction(n, pole_pairs) for n in range(1, 2 * pole_pairs)} if pole_pairs else set()
    factors = whole | {f for f in ratios if f > Fraction(1, 3)} | given - {Fraction(1)}
    if pole_pairs:
        factors |= {Fraction(pole_pairs), Fraction(1, pole_pairs)}
    return [_of_factor(f, pole_pairs) for f in sorted(factors) if f != 1]


def _of_factor(factor: Fraction, pole_pairs: int | None) -> Cure:
    name, fix = (
        "wrong pole pairs",
        (f"count omega_el with {factor.numerator} pole pairs for {factor.denominator}"),
    )
    if factor == pole_pairs or (pole_pairs is None and factor.denominator == 1):
        name = "mechanical speed for electrical"
        fix = "give omega_el mechanical = true"
        fix += "" if pole_pairs else f", and pole_pairs (about {factor.numerator})"
    elif pole_pairs and factor == Fraction(1, pole_pairs):
        name, fix = "pole pairs counted twice", "leave out mechanical = true of omega_el"
    elif pole_pairs and (factor * pole_pairs).denominator == 1:
        fix = f"give pole_pairs = {factor * pole_pairs} in place of {pole_pairs}"
    return Cure(name, (_SPEED,), fix, factor=float(factor))


def _trials(experiment: Experiment, cures: Sequence[Cure]) -> list[Trial]:
    """Return the balance with each cure, all in the same windows.

    Windows null the sixth harmonic of the speed as recorded. Those of one that is larger are
    shorter, and longer ones of it leave less of anything.
    """
    length = min(trial_window(experiment), max(len(experiment) // _FEWEST, 1))
    balances: dict[Cure, SpeedBalance] = {}
    trials = []
    for cure in cures:
        key = replace(cure, name="", channels=(), fix="", factor=1.0)
        if key not in balances:
            balances[key] = SpeedBalance(key.applied(experiment), length)
        trials.append(balances[key].at(cure.factor))
    return trials


def _angle_sign(experiment: Experiment) -> int:
    if "theta_el" not in experiment.channels:
        return 0
    return -1 if angle_over_speed(experiment) < 0 else 1
