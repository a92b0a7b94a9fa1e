"""Conventions that the voltage balance shows once signs are right: timing, and the magnet."""

from collections.abc import Sequence

import numpy as np

from penode.data.experiment import Experiment
from penode.fit.outcome import NORMAL_95
from penode.pmsm.balance.calibration import Calibration
from penode.pmsm.balance.trial_balance import mean_lag, try_balance
from penode.pmsm.conventions.broken_convention import BrokenConvention, with_channels
from penode.pmsm.machine.holds import STATIONARY_TURN, turned_voltage
from penode.pmsm.machine.standstill import axes_at_rest, stands_still

#: Lag in samples that is one, and its deviation up to which it is reported.
_LATE, _DETERMINED = 0.6, 0.2
#: Samples, or deviations, up to which a lag is a whole number of samples.
_WHOLE, _CLOSE = 0.25, 3.0
#: Samples of which the shortest window that times a voltage can be cut.
_SHORTEST = 16
#: Angle in deg and deviations from which the magnet lies beside the d axis.
_ASIDE, _SIGNIFICANT = 5.0, 5.0
#: Least current, as a share of the largest, up to which the map at no current is determined.
_NEAR_ZERO = 0.2
#: Magnet's flux linkage over that of the largest current below which there is no magnet.
_LEAST_MAGNET = 0.05


def judge_delay(
    stretches: Sequence[Experiment], in_phases: bool
) -> tuple[BrokenConvention | None, list[Experiment], str]:
    """Find voltages that stand a sample too early or too late, and put them in place.

    Of voltages recorded in phases the turn of the rotor is undone. The text says why nothing
    can be determined, empty where it can.
    """
    name, longest = stretches[0].place.recording, max(map(len, stretches))
    if longest < _SHORTEST:
        few = (
            f"{name}: a delay of the voltage cannot be determined from {longest} samples; record "
            "for longer."
        )
        return None, list(stretches), few
    lag, deviation = mean_lag([e for e in stretches if len(e) >= _SHORTEST], in_phases)
    if not deviation < _DETERMINED or _between(lag, deviation):
        half, side = f"± {NORMAL_95 * deviation:.2g} samples", "early" if lag < 0 else "late"
        open_to = f"to {half} (95 %) only"
        if deviation < _DETERMINED:
            open_to = f"as {abs(lag):.2g} {half} {side}, which is no whole number"
        why = (
            f"{name}: the voltage balance shows the instant of the voltages {open_to}, so they are "
            "taken as recorded; training refuses them if they stand a whole sample off. Faster "
            "currents or a higher speed would show it before."
        )
        return None, list(stretches), why
    if abs(lag) < max(_LATE, _SIGNIFICANT * deviation):
        return None, list(stretches), ""
    samples = round(lag) or (1 if lag > 0 else -1)
    names = ("u_a", "u_b", "u_c") if in_phases else ("u_d", "u_q")
    word = "lag behind" if lag > 0 else "lead"
    finding = BrokenConvention(
        "one-sample delay" if abs(samples) == 1 else f"delay of {abs(samples)} samples",
        name,
        names,
        f"the voltages {word} the currents by {abs(lag):.2f} ± {deviation:.2g} samples",
        f"give {', '.join(names)} delay = {samples}",
    )
    return finding, [_in_place(e, samples, in_phases) for e in stretches], ""


def judge_hold(
    stretches: Sequence[Experiment], hold: str, found: Calibration
) -> BrokenConvention | None:
    """Find a hold of the study file that the turn of the voltages contradicts; None without one."""
    if found.turned is None:
        return None
    turn, deviation = found.turned
    expected = {"dq": 0.0, "stationary": STATIONARY_TURN}
    off = {frame: abs((turn - at + 0.5) % 1.0 - 0.5) for frame, at in expected.items()}
    other = min(off, key=lambda frame: off[frame])
    if other == hold or off[other] > _WHOLE or off[hold] < _SIGNIFICANT * deviation:
        return None
    return BrokenConvention(
        "frame of the hold",
        stretches[0].place.recording,
        ("u_d", "u_q"),
        f"the voltages seem turned by {turn:.3f} ± {deviation:.2g} samples of rotation, as held in "
        f"the {other} frame, and the study file has hold = {hold!r}",
        "remove hold from the study file, and it is decided from the data",
    )


def _between(lag: float, deviation: float) -> bool:
    """Return whether a lag is no whole number of samples: something else may imitate it."""
    return abs(lag) >= _LATE and abs(lag - round(lag)) > max(_WHOLE, _CLOSE * deviation)


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

    The text says why nothing can be determined, empty where it can.
    """
    if stands_still([experiment]):
        alone = axes_at_rest([experiment])
        return None, alone and (
            f"{experiment.name}: at standstill with the {alone} axis at rest nothing shows an "
            "offset of the angle."
        )
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
    fix = f"subtract {offset:.3g} deg ({np.radians(offset):.4g} rad) from theta_el"
    if not in_phases:
        turn = np.median(np.abs(experiment.channels["omega_el"])) * experiment.time_step
        samples = np.radians(abs(aside)) / max(float(turn), 1e-9)
        fix += (
            ", or turn the recorded dq channels by as much; a voltage that the inverter holds or "
            f"delays without correction of the turn looks alike ({samples:.2g} samples)"
        )
    finding = BrokenConvention(
        "offset angle",
        experiment.name,
        ("theta_el",),
        f"the flux linkage at no current lies {aside:.3g} ± {deviation:.2g} deg beside the d axis",
        fix,
    )
    return finding, ""
