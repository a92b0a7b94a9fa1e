"""Holds of a drive: in which frame the voltage of a row stands still until the next."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.models.inputs import Inputs
from penode.native.harmonics import harmonics
from penode.pmsm.machine.space_vectors import VOLTAGES, with_vector
from penode.predictors.holds import Hold, ZeroOrderHold

#: Samples of rotation by which a voltage held in the stationary frame seems turned in dq.
STATIONARY_TURN = -0.5


@dataclass(frozen=True)
class StationaryFrame:
    """Voltage held by an inverter, constant in alpha and beta: it falls behind the rotor.

    Seen from the rotor it turns by -omega T from each sample to the next; u_d and u_q of a row are
    those at the sample itself.
    """

    def __call__(
        self, drive: Callable[[int], Inputs], sample: int, fraction: float, time_step: float
    ) -> Inputs:
        """Return the input with its voltage turned back; see `penode.predictors.holds.Hold`."""
        u = drive(sample)
        if fraction == 0.0:
            return u
        turn = u["omega_el"] * (fraction * time_step)
        cosine, sine = harmonics((1,), turn)
        u_d, u_q = u["u_d"], u["u_q"]
        return u.replaced(u_d=u_d * cosine + u_q * sine, u_q=u_q * cosine - u_d * sine)


def turned_voltage(experiment: Experiment, samples: float) -> Experiment:
    """Return a recording with its voltage turned ahead by what the rotor turns in some samples."""
    turn = samples * experiment.time_step * experiment.channels["omega_el"]
    return with_vector(experiment, VOLTAGES, lambda voltage: voltage * np.exp(1j * turn))


def mean_over_samples(experiment: Experiment) -> Experiment:
    """Return a recording with the mean, seen from the rotor, of voltages held in the other frame.

    u_d and u_q are those at the samples themselves.
    """
    behind = turned_voltage(experiment, STATIONARY_TURN)
    half = 0.5 * experiment.time_step * experiment.channels["omega_el"]
    return with_vector(behind, VOLTAGES, lambda voltage: voltage * np.sinc(half / np.pi))


#: Frame in which the voltage stands still -> hold.
HOLDS: dict[str, Hold] = {"dq": ZeroOrderHold(), "stationary": StationaryFrame()}
DEFAULT_HOLD = "dq"


def check_hold(name: str) -> None:
    """Refuse a frame that is not a key of `HOLDS`."""
    if name not in HOLDS:
        raise InputError(f"hold must be one of {', '.join(HOLDS)}, got {name!r}.")
