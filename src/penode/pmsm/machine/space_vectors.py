"""Space vectors d + j q of a recording, and what turns or changes them."""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.pmsm.machine.terms import ANGLE

#: Channels of a space vector, d and q.
Pair: TypeAlias = tuple[str, str]
#: Values d + j q, shape (time,), in the unit of the channels.
Vector: TypeAlias = NDArray[np.complex128]

CURRENTS: Pair = ("i_d", "i_q")
VOLTAGES: Pair = ("u_d", "u_q")


def vector_of(experiment: Experiment, pair: Pair) -> Vector:
    """Return a space vector d + j q, shape (time,)."""
    d, q = (experiment.channels[name] for name in pair)
    return np.asarray(d + 1j * q)


def with_vector(
    experiment: Experiment, pair: Pair, change: Callable[[Vector], Vector]
) -> Experiment:
    """Return a recording with one of its space vectors, d + j q (time,), changed."""
    changed = change(vector_of(experiment, pair))
    d, q = pair
    return replace(experiment, channels={**experiment.channels, d: changed.real, q: changed.imag})


def less_voltage(experiment: Experiment, lost: FloatArray) -> Experiment:
    """Return a recording with d and q of a voltage (time, 2) in V taken off."""
    return with_vector(
        experiment, VOLTAGES, lambda voltage: voltage - (lost[:, 0] + 1j * lost[:, 1])
    )


def in_frame_ahead(experiment: Experiment, angle: float) -> Experiment:
    """Return a recording in a frame whose d axis lies an electrical angle, rad, further ahead."""
    back = np.exp(-1j * angle)
    for pair in (CURRENTS, VOLTAGES):
        experiment = with_vector(experiment, pair, lambda vector: vector * back)
    if ANGLE.name not in experiment.channels:
        return experiment
    ahead = experiment.channels[ANGLE.name] + angle
    return replace(experiment, channels={**experiment.channels, ANGLE.name: ahead})


def with_mismatch(experiment: Experiment, mismatch: complex) -> Experiment:
    """Return a recording whose phases measure currents with unequal gains; needs theta_el.

    Measured is i + m conj(i) of the stationary current i; of a phase a whose gain is g too
    large m = g / 3, beside a common gain.
    """
    rotor = rotor_of(experiment)
    return with_vector(
        experiment, CURRENTS, lambda current: current + mismatch * np.conj(current * rotor**2)
    )


def rotor_of(experiment: Experiment) -> Vector:
    """Return the d axis seen from the stationary frame, of length 1."""
    return np.asarray(np.exp(1j * experiment.channels[ANGLE.name]))
