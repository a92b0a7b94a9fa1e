"""Voltages and currents as drives log them in the stationary frame, and the phases they stand for.

Phases without zero sequence are determined by two measurements: with x_a + x_b + x_c = 0 two phase
currents, alpha and beta, or two line-to-line voltages are three equations in x_a, x_b, x_c. Duty
cycles are phase voltages as shares of the DC link; their zero sequence drops out in dq.
"""

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment

#: What each measurement is of the phases a, b, c; alpha and beta are amplitude invariant.
_WEIGHTS = {
    "a": (1.0, 0.0, 0.0),
    "b": (0.0, 1.0, 0.0),
    "c": (0.0, 0.0, 1.0),
    "alpha": (2.0 / 3.0, -1.0 / 3.0, -1.0 / 3.0),
    "beta": (0.0, 3.0**-0.5, -(3.0**-0.5)),
    "ab": (1.0, -1.0, 0.0),
    "bc": (0.0, 1.0, -1.0),
    "ca": (-1.0, 0.0, 1.0),
}
_PHASES = "abc"
_DUTIES = tuple(f"duty_{phase}" for phase in _PHASES)
#: Channel of the DC link's voltage, which duty cycles are shares of.
LINK = "u_dc"

#: Channel -> unit, of all that may stand instead of voltages or currents in dq.
STATIONARY = {
    **{f"{kind}_{phase}": unit for kind, unit in (("u", "V"), ("i", "A")) for phase in _PHASES},
    **dict.fromkeys(_DUTIES, "1"),
    LINK: "V",
    **{f"u_{axis}": "V" for axis in ("alpha", "beta", "ab", "bc", "ca")},
    **{f"i_{axis}": "A" for axis in ("alpha", "beta")},
}


def _named(kind: str, *forms: str) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(f"{kind}_{axis}" for axis in form.split()) for form in forms)


#: Channels of which one set is enough for all voltages, or all currents: the first that is whole.
FORMS = {
    "u": (
        *_named("u", "d q", "a b c"),
        (*_DUTIES, LINK),
        *_named("u", "alpha beta", "ab bc", "bc ca", "ca ab"),
    ),
    "i": _named("i", "d q", "a b c", "a b", "b c", "c a", "alpha beta"),
}


def form_of(kind: str, present: Collection[str]) -> tuple[str, ...]:
    """Return the channels that give all voltages, ``"u"``, or all currents, ``"i"``.

    The first of `FORMS` that is whole, else the one of which most is present.
    """

    def lacking(form: tuple[str, ...]) -> tuple[bool, int, int]:
        missing = sum(name not in present for name in form)
        return missing > 0, -sum(name in present for name in form if name != LINK), missing

    return min(FORMS[kind], key=lacking)


def turns_with_rotor(form: Collection[str]) -> bool:
    """Return whether channels are in dq already, so that no angle is needed."""
    return any(name.endswith("_d") for name in form)


def phases_of(kind: str, channels: Mapping[str, FloatArray]) -> FloatArray | None:
    """Return the phases (time, 3) that channels in the stationary frame, in any unit, stand for.

    Those of duty cycles are in the unit of the DC link's voltage. None where the channels are in dq
    or one is lacking.
    """
    form = form_of(kind, channels)
    if turns_with_rotor(form) or any(name not in channels for name in form):
        return None
    columns = [channels[name] for name in form]
    if form[:3] == _DUTIES:
        return np.stack(columns[:3], axis=1) * columns[3][:, None]
    if len(columns) == 3:
        return np.stack(columns, axis=1)
    balanced = [_WEIGHTS[name.split("_")[1]] for name in form] + [(1.0, 1.0, 1.0)]
    return np.asarray(np.stack(columns, axis=1) @ np.linalg.inv(balanced)[:, :2].T)


def with_phases(experiment: Experiment) -> Experiment:
    """Return a recording with the phases that its stationary channels stand for.

    It has u_a, u_b, u_c (V) or i_a, i_b, i_c (A) beside what it had, where a kind was recorded
    neither in dq nor in three phases; no change where it lacks a channel.
    """
    channels = dict(experiment.channels)
    for kind in FORMS:
        three = phases_of(kind, experiment.channels)
        if three is not None:
            names = (f"{kind}_{phase}" for phase in _PHASES)
            channels = dict(zip(names, three.T, strict=True)) | channels
    return replace(experiment, channels=channels)
