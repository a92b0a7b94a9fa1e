"""Canonical channels of a drive recording, and what can be checked of them before any fit."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from penode.data.excitation import check_some_excitation
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.pmsm.machine.frames import dq_from_abc
from penode.pmsm.machine.term_registry import TERMS
from penode.pmsm.machine.terms import ANGLE, Channel, Term
from penode.pmsm.recording.stationary_frame import (
    LINK,
    form_of,
    turns_with_rotor,
    with_phases,
)

#: Channel -> unit. Currents and voltages are peak values in the amplitude-invariant dq frame.
CANONICAL = {
    **{"u_d": "V", "u_q": "V", "i_d": "A", "i_q": "A", "omega_el": "rad/s", "theta_el": "rad"},
    **{c.name: c.unit for kind in TERMS.values() for c in kind.channels},
}

#: Electrical angle turned in one sample beyond which the recording cannot be what it says.
_LARGEST_TURN = np.pi / 2
#: What voltages and currents begin with.
_ELECTRICAL = ("u", "i")


def drive_recording(experiment: Experiment) -> Experiment:
    """Return a recording with the channels i_d, i_q, u_d, u_q and omega_el, checked.

    Parameters
    ----------
    experiment : Experiment
        Has the dq channels and omega_el; voltages, currents or both may be in the stationary
        frame instead, with theta_el: in phases, in alpha and beta, line to line, as duty cycles
        (`penode.pmsm.recording.stationary_frame.FORMS`).

    Returns
    -------
    Experiment
        The same recording; what is not in dq is transformed, and the speed is the
        derivative of the angle where it is not recorded.

    Raises
    ------
    InputError
        If a channel is missing, neither current or neither voltage ever moves, or the machine turns
        more than a quarter electrical turn a sample (a time column in ms, or a speed in rpm).
    """
    experiment = in_dq(experiment)
    for kind in "iu":
        check_some_excitation(experiment, (f"{kind}_d", f"{kind}_q"))
    speed = np.abs(experiment.channels["omega_el"])
    turn = float(np.median(speed)) * experiment.time_step
    if turn > _LARGEST_TURN:
        raise InputError(
            f"{experiment.name}: omega_el {np.median(speed):.4g} rad/s at a time step of "
            f"{experiment.time_step:.4g} s turns {turn:.3g} rad a sample, must be < "
            f"{_LARGEST_TURN:.2g}; check the units: t in s, omega_el in electrical rad/s."
        )
    return experiment


def in_dq(experiment: Experiment) -> Experiment:
    """Return a recording with the channels of `drive_recording`, not judged by its values."""
    kinds = stationary_kinds(experiment.channels)
    if kinds:
        experiment = _from_phases(with_phases(experiment), kinds)
    experiment.require(("i_d", "i_q", "u_d", "u_q", "omega_el"))
    return experiment


def electrical(experiments: Sequence[Experiment]) -> tuple[str, ...]:
    """Return the voltages and currents of recordings; that of the DC link may stand still."""
    names = dict.fromkeys(name for e in experiments for name in e.channels)
    return tuple(n for n in names if n.split("_")[0] in _ELECTRICAL and n != LINK)


def missing_channels(present: Collection[str]) -> list[str]:
    """Return the canonical names of what `drive_recording` lacks with these channels."""
    wanted = [name for kind in "ui" for name in form_of(kind, present)]
    wanted.append("theta_el" if stationary_kinds(present) else "omega_el")
    return [name for name in wanted if name not in present]


def stationary_kinds(present: Collection[str]) -> str:
    """Return which of u and i are there in the stationary frame alone."""
    return "".join(k for k in "ui" if not turns_with_rotor(form_of(k, present)))


def require_channels(
    experiments: Sequence[Experiment], terms: Sequence[Term], angle_orders: Sequence[int] = ()
) -> None:
    """Refuse recordings without a channel that the model needs, or with incredible values of it.

    The terms are those of the voltage equation; ``angle_orders`` are the harmonics of the
    electrical angle in the map. The message says what needs the channel.
    """
    needs = [(term.title, channel) for term in terms for channel in term.channels]
    if angle_orders:
        needs.append(("A map with angle orders", ANGLE))
    for title, channel in needs:
        for experiment in experiments:
            _require(experiment, channel, f"{title[0].lower()}{title[1:]}")


def _require(experiment: Experiment, channel: Channel, purpose: str) -> None:
    name = channel.name
    if name not in experiment.channels:
        raise InputError(
            f"{experiment.name}: channel {name} is missing; {purpose} needs {channel.meaning} in "
            f"{channel.unit}: record it, or identify without."
        )
    values = experiment.channels[name]
    bad = np.flatnonzero(~((values >= channel.lowest) & (values <= channel.highest)))
    if len(bad):
        raise InputError(
            f"{experiment.name}: data row {experiment.place.row + bad[0] + 1}, channel {name} is "
            f"{values[bad[0]]:.6g} where {channel.meaning} lies between {channel.lowest:g} and "
            f"{channel.highest:g} {channel.unit}; check its column and unit in the study file."
        )


def _from_phases(experiment: Experiment, kinds: str) -> Experiment:
    names = [[f"{kind}_{phase}" for phase in "abc"] for kind in kinds]
    experiment.stack([*(name for three in names for name in three), "theta_el"])
    theta = experiment.channels["theta_el"]
    channels = dict(experiment.channels)
    for kind, three in zip(kinds, names, strict=True):
        channels[f"{kind}_d"], channels[f"{kind}_q"] = dq_from_abc(experiment.stack(three), theta).T
    if "omega_el" not in channels:
        channels["omega_el"] = np.gradient(np.unwrap(theta), experiment.time_step)
    return replace(experiment, channels=channels)
