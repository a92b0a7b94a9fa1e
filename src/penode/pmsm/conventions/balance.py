"""Conventions that the voltage balance shows: signs, speed, timing, the direction of the magnet.

A wrong sign makes the best d psi / d i indefinite and leaves more of the voltages over; the right
one is the one that leaves least. What is found is mended before the next is judged.
"""

import numpy as np

from penode.data.experiment import Experiment
from penode.pmsm.balance.trial_balance import (
    TrialBalance,
    lag_of_voltage,
    trial_window,
    try_balance,
)
from penode.pmsm.conventions.broken_convention import BrokenConvention, Judged, with_channels
from penode.pmsm.conventions.motion import angle_over_speed
from penode.pmsm.machine.holds import turned_voltage
from penode.pmsm.machine.standstill import stands_still

#: Channels counted the other way -> what that is called. The first of equals is taken.
_REVERSALS = {
    ("omega_el",): "reversed speed",
    ("i_q",): "negative q current",
    ("u_q",): "negative q voltage",
    ("i_d",): "negative d current",
    ("u_d",): "negative d voltage",
    ("i_d", "i_q"): "currents counted out of the machine",
    ("u_d", "u_q"): "negative voltages",
}
#: Degree of the coenergy for signs: where a sign is right a better map leaves much less.
_SIGN_DEGREE = 6
#: Misfit of a reversal, or of a factor of the speed, over that of the recording as it stands.
_CLEARER = 0.7
_MOST_POLE_PAIRS = 12
#: Lag in samples that is one, and its deviation up to which it is reported.
_LATE, _DETERMINED = 0.6, 0.2
#: Samples of which the shortest window that times a voltage can be cut.
_SHORTEST = 16
#: Angle in deg and deviations from which the magnet lies beside the d axis.
_ASIDE, _SIGNIFICANT = 5.0, 5.0
#: Least current, as a share of the largest, up to which the map at no current is determined.
_NEAR_ZERO = 0.2
#: Magnet's flux linkage over that of the largest current below which there is no magnet.
_LEAST_MAGNET = 0.05


def judge_signs(experiment: Experiment) -> Judged:
    """Find channels that count the other way.

    Parameters
    ----------
    experiment : Experiment
        With i_d, i_q (A), u_d, u_q (V), omega_el (rad/s), and theta_el (rad) if it was recorded.

    Returns
    -------
    BrokenConvention or None
    Experiment
        With the signs mended.
    """
    standing = try_balance(experiment, degree=_SIGN_DEGREE)
    trials = {n: try_balance(_reversed(experiment, n), degree=_SIGN_DEGREE) for n in _REVERSALS}
    best = min(trials, key=lambda n: (float(f"{trials[n].misfit:.4g}"), -trials[n].magnet[0]))
    angle = _angle_sign(experiment)
    if trials[best].misfit > _CLEARER * standing.misfit:
        if angle >= 0:
            return None, experiment
        finding = BrokenConvention(
            "reversed angle",
            experiment.name,
            ("theta_el",),
            "the angle turns against the speed, which the voltage balance confirms",
            "give theta_el sign = -1",
        )
        return finding, with_channels(experiment, {"theta_el": -experiment.channels["theta_el"]})
    name, mend = _REVERSALS[best], f"give {' and '.join(best)} sign = -1"
    if best == ("omega_el",) and angle > 0:
        mend = "give omega_el and theta_el sign = -1, or i_q and u_q if it is the q axis"
    elif best == ("omega_el",) and angle == 0:
        mend += ", or i_q and u_q if it is the q axis that points backwards"
    finding = BrokenConvention(
        name, experiment.name, best, _why(standing, trials[best], angle), mend
    )
    return finding, _reversed(experiment, best)


def _reversed(experiment: Experiment, names: tuple[str, ...]) -> Experiment:
    return with_channels(experiment, {n: -experiment.channels[n] for n in names})


def _angle_sign(experiment: Experiment) -> int:
    if "theta_el" not in experiment.channels:
        return 0
    return -1 if angle_over_speed(experiment) < 0 else 1


def _why(standing: TrialBalance, mended: TrialBalance, angle: int) -> str:
    against = "the angle turns against the speed, and " if angle < 0 else ""
    return (
        f"{against}the voltage balance leaves {100 * standing.residual:.2g} % of the voltages and "
        f"an inductance that is positive at {100 * standing.definite:.0f} % of the currents, and "
        f"with the sign turned {100 * mended.residual:.2g} % and {100 * mended.definite:.0f} %"
    )


def judge_speed_factor(experiment: Experiment, pole_pairs: int | None) -> Judged:
    """Find a mechanical speed where no angle shows it, by the rotation's voltage against d psi/dt.

    Parameters
    ----------
    experiment : Experiment
        As in `judge_signs`.
    pole_pairs : int or None
        Of the machine; None tries up to 12.

    Returns
    -------
    BrokenConvention or None
    Experiment
        With the electrical speed.
    """
    pairs = range(2, _MOST_POLE_PAIRS + 1) if pole_pairs is None else (pole_pairs,)
    factors = [float(p) for p in pairs] + ([1.0 / pole_pairs] if pole_pairs else [])
    trials = {f: _at_factor(experiment, f) for f in factors if f != 1.0}
    best = min(trials, key=lambda f: trials[f][1].misfit / trials[f][0].misfit, default=1.0)
    if best == 1.0 or trials[best][1].misfit > _CLEARER * trials[best][0].misfit:
        return None, experiment
    speed = best * experiment.channels["omega_el"]
    scaled, window = with_channels(experiment, {"omega_el": speed}), trial_window(experiment)
    if try_balance(scaled, window).misfit > try_balance(experiment, window).misfit:
        return None, experiment
    standing, mended = (trial.residual for trial in trials[best])
    evidence = (
        f"the voltage balance leaves {100 * standing:.2g} % of the voltages, and "
        f"{100 * mended:.2g} % with {best:.3g} times the speed"
    )
    name, mend = "mechanical speed for electrical", "give omega_el mechanical = true"
    if best < 1.0:
        name, mend = "pole pairs counted twice", "leave out mechanical = true of omega_el"
    elif pole_pairs is None:
        mend += f", and pole_pairs (about {best:.0f})"
    finding = BrokenConvention(name, experiment.name, ("omega_el",), evidence, mend)
    return finding, scaled


def _at_factor(experiment: Experiment, factor: float) -> tuple[TrialBalance, TrialBalance]:
    """Return the balance as it stands and with so many times the speed, in windows for the latter.

    Both in the same windows, as longer ones leave less of anything.
    """
    scaled = with_channels(experiment, {"omega_el": factor * experiment.channels["omega_el"]})
    window = trial_window(scaled)
    return try_balance(experiment, window), try_balance(scaled, window)


def judge_delay(
    experiment: Experiment, in_phases: bool
) -> tuple[BrokenConvention | None, Experiment, str]:
    """Find voltages that stand a sample too early or too late.

    Parameters
    ----------
    experiment : Experiment
        As in `judge_signs`.
    in_phases : bool
        Whether the voltages were recorded in phases.

    Returns
    -------
    BrokenConvention or None
    Experiment
        With the voltages in place; of phases, the turn of the rotor is undone.
    str
        Why nothing can be determined, empty where it can.
    """
    if len(experiment) < _SHORTEST:
        few = (
            f"{experiment.name}: a delay of the voltage cannot be determined from "
            f"{len(experiment)} samples; record for longer."
        )
        return None, experiment, few
    lag, deviation = lag_of_voltage(experiment, in_phases)
    if not deviation < _DETERMINED:
        return (
            None,
            experiment,
            (
                f"{experiment.name}: a delay of the voltage cannot be determined here ({lag:.2g} ± "
                f"{deviation:.2g} samples); faster currents or a higher speed would show it."
            ),
        )
    if abs(lag) < max(_LATE, _SIGNIFICANT * deviation):
        return None, experiment, ""
    samples = round(lag) or (1 if lag > 0 else -1)
    names = ("u_a", "u_b", "u_c") if in_phases else ("u_d", "u_q")
    word = "lag behind" if lag > 0 else "lead"
    finding = BrokenConvention(
        "one-sample delay" if abs(samples) == 1 else f"delay of {abs(samples)} samples",
        experiment.name,
        names,
        f"the voltages {word} the currents by {abs(lag):.2f} ± {deviation:.2g} samples",
        f"give {', '.join(names)} delay = {samples}",
    )
    return finding, _in_place(experiment, samples, in_phases), ""


def _in_place(experiment: Experiment, samples: int, in_phases: bool) -> Experiment:
    """Return the recording with voltages so many samples earlier, its ends cut off."""
    u_d, u_q = np.roll(experiment.stack(("u_d", "u_q")), -samples, axis=0).T
    moved = with_channels(experiment, {"u_d": u_d, "u_q": u_q})
    if in_phases:
        moved = turned_voltage(moved, samples)
    kept = slice(abs(samples), -abs(samples))
    return with_channels(moved, {name: values[kept] for name, values in moved.channels.items()})


def judge_magnet(experiment: Experiment, in_phases: bool) -> tuple[BrokenConvention | None, str]:
    """Find an angle with an offset: the magnet then lies beside the d axis.

    Parameters
    ----------
    experiment : Experiment
        As in `judge_signs`.
    in_phases : bool
        Whether currents and voltages were recorded in phases.

    Returns
    -------
    BrokenConvention or None
    str
        Why nothing can be determined, empty where it can.
    """
    if stands_still([experiment]):
        return None, f"{experiment.name}: at standstill no voltage shows an offset of the angle."
    trial = try_balance(experiment)
    length = np.hypot(*experiment.stack(("i_d", "i_q")).T)
    magnet = float(np.hypot(*trial.magnet))
    reach = float(length.max() * trial.inductance.max())
    if length.min() > _NEAR_ZERO * length.max() or magnet < _LEAST_MAGNET * reach:
        return None, (
            f"{experiment.name}: an offset of the angle cannot be determined without currents near "
            "zero and a magnet."
        )
    aside = float(np.degrees(np.arctan2(trial.magnet[1], trial.magnet[0])))
    deviation = float(np.degrees(trial.magnet_deviation / magnet))
    if abs(aside) < _ASIDE or abs(aside) < _SIGNIFICANT * deviation:
        return None, ""
    offset = -aside
    mend = f"subtract {offset:.3g} deg ({np.radians(offset):.4g} rad) from theta_el"
    if not in_phases:
        turn = np.median(np.abs(experiment.channels["omega_el"])) * experiment.time_step
        samples = np.radians(abs(aside)) / max(float(turn), 1e-9)
        mend += (
            ", or turn the recorded dq channels by as much; a voltage that the inverter holds or "
            f"delays without correction of the turn looks alike ({samples:.2g} samples)"
        )
    finding = BrokenConvention(
        "offset angle",
        experiment.name,
        ("theta_el",),
        f"the flux linkage at no current lies {aside:.3g} ± {deviation:.2g} deg beside the d axis",
        mend,
    )
    return finding, ""
