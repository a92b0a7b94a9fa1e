"""What a simulated drive did: its torque, its distance from a recording, where its map is known."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from penode.arrays import FloatArray
from penode.bench.machines import torque
from penode.bench.run import Recording
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.pmsm.machine.flux_grid import read_grid

#: Channels that are held against a recording.
COMPARED = ("i_d", "i_q", "u_d", "u_q")
# Time constants of the current controller that a simulation takes to arrive from no current.
_SETTLING = 10.0
# Speeds further apart than this share ask for other voltages whatever the machine is.
_SAME_SPEED = 0.01


@dataclass(frozen=True)
class Deviation:
    """How far, as RMS in A and V of `COMPARED`, a simulation is from a recording on its reference.

    ``settled`` is the time in s that was left out at the beginning.
    """

    name: str
    rms: Mapping[str, float]
    settled: float


def torque_of(recording: Recording) -> FloatArray:
    """Return the air-gap torque at the sampling instants in Nm, shape (time,).

    It is 3/2 p (psi_d i_q - psi_q i_d + dW/dtheta) at the terminal currents; iron losses are not
    taken off.
    """
    truth = recording.truth
    (i_d, i_q), warm = truth.trace.current.T, truth.drive.magnet_temperature
    change = 0.0 if warm is None else truth.machine.magnet_flux_change(warm)
    at_reference = torque(truth.machine, i_d, i_q, truth.trace.theta_el)
    return np.asarray(at_reference + 1.5 * truth.machine.pole_pairs * change * i_q)


def deviation(recording: Recording, recorded: Experiment) -> Deviation:
    """Hold a simulation against a recording of the same reference, row by row from the first.

    The recording has the channels of `COMPARED` and omega_el; if one is longer, its end is left
    out. Refuses two that differ in sampling or speed, and nothing left after settling.
    """
    simulated, drive = recording.experiment, recording.truth.drive
    if not np.isclose(simulated.time_step, recorded.time_step, rtol=1e-6):
        raise InputError(
            f"{recorded.name}: sampled every {recorded.time_step:.6g} s, the simulation every "
            f"{simulated.time_step:.6g} s; set time_step in [drive] to the former."
        )
    rows = min(len(simulated), len(recorded))
    begin = round(_SETTLING / drive.bandwidth / drive.time_step)
    if begin >= rows:
        raise InputError(
            f"{recorded.name}: {rows} rows can be compared, and {begin} of them are needed to "
            "settle; simulate for longer."
        )
    speeds = [float(np.mean(e.channels["omega_el"][:rows])) for e in (simulated, recorded)]
    if abs(speeds[0] - speeds[1]) > _SAME_SPEED * abs(speeds[1]):
        own, other = (speed / recording.truth.machine.pole_pairs * 30 / np.pi for speed in speeds)
        raise InputError(
            f"{recorded.name}: turns at {other:.6g} rpm, and the simulation at {own:.6g} rpm; "
            "simulate at the speed of the recording."
        )
    rms = {}
    for name in COMPARED:
        apart = simulated.channels[name][begin:rows] - recorded.channels[name][begin:rows]
        rms[name] = float(np.sqrt(np.mean(apart**2)))
    return Deviation(recorded.name, rms, begin * drive.time_step)


def share_beyond(recording: Recording, result: Path) -> float:
    """Return the share of a simulation's samples where the identified map is an extrapolation.

    From 0 to 1, by the nearest point of ``flux_map.csv`` in the result's folder.
    """
    grid = read_grid(result / "flux_map.csv")
    axes = np.array([grid.i_d, grid.i_q])
    first, step = axes[:, 0], (axes[:, -1] - axes[:, 0]) / (axes.shape[1] - 1)
    nearest = np.rint((recording.truth.trace.current - first) / step).astype(int)
    inside = np.all((nearest >= 0) & (nearest < axes.shape[1]), axis=1)
    supported = grid.supported[tuple(nearest[inside].T)]
    return 1.0 - float(np.count_nonzero(supported)) / len(nearest)
