"""One simulated recording: reference -> controller -> inverter -> machine -> sensors -> file.

Row k holds the currents, angle and speed measured at t_k and the dq voltage that the controller
asks for from them, before anything the inverter does to it. It acts from t_k to t_(k+1); with a
computation delay of n samples, from t_(k+n) to t_(k+n+1).
"""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, float64, on_device
from penode.bench.admission import (
    check_drive,
    check_speed,
    reference_rows,
    refuse_unstable,
    sampling_instants,
)
from penode.bench.drive import DEFAULT_DRIVE, Drive
from penode.bench.machines import Machine
from penode.bench.references import Reference
from penode.bench.rig import LoopState, Rig, Row, Sampled, rig_of
from penode.bench.sensors import Draws
from penode.bench.shaft import FreeShaft, Motion, Speed, shaft_of
from penode.bench.truth import Trace, Truth
from penode.data.experiment import Experiment, Source
from penode.errors import InputError

# Rows that one call of the compiled loop works on: what bounds its memory, whatever the length.
_CHUNK = 1000

# Share of a run that may lie at the voltage limit before the reference counts as unreachable.
_SATURATED_SHARE = 0.05


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording and the truth behind it."""

    # What the drive recorded.
    experiment: Experiment
    # How it was made, and the true values of the sensors' signals.
    truth: Truth


def simulate(
    machine: Machine,
    reference: Reference,
    *,
    speed_rpm: Speed,
    duration: float,
    drive: Drive = DEFAULT_DRIVE,
    seed: int = 0,
) -> Experiment:
    """Record a drive that follows a current reference.

    Parameters
    ----------
    machine : Machine
        The machine; it starts without current at theta_el = 0.
    reference : callable
        Times in s, shape (time,), to i_d and i_q in A, shape (time, 2).
    speed_rpm : float, callable or FreeShaft
        Mechanical speed in revolutions per minute, negative turning backwards: one number, or a
        function of times in s, shape (time,); or a shaft that the torques move.
    duration : float
        Length of the recording in s.
    drive : Drive
        Sampling, controller, inverter, sensors, winding.
    seed : int
        Seed of the measurement noise.

    Returns
    -------
    Experiment
        Channels u_d, u_q in V (as asked for by the controller), i_d, i_q in A, omega_el in rad/s,
        theta_el in rad (0 to 2 pi), all three as measured. The voltage of row k acts from t_k to
        t_(k+1), with a computation delay that many samples later, held as the inverter holds it.

    Raises
    ------
    InputError
        If the drive has a value that cannot be, the speed is not finite, the duration holds no
        sample, the reference is not two finite currents a row or above the machine's limit, the
        current loop is unstable, or the reference cannot be followed: the voltage stays at its
        limit, or the currents leave the machine's table.
    """
    return record(
        machine, reference, speed_rpm=speed_rpm, duration=duration, drive=drive, seed=seed
    ).experiment


def record(
    machine: Machine,
    reference: Reference,
    *,
    speed_rpm: Speed,
    duration: float,
    drive: Drive = DEFAULT_DRIVE,
    seed: int = 0,
) -> Recording:
    """Record a drive as `simulate` does, and keep the truth beside the recording; see `simulate`.

    The truth has ``flux_map(i_d, i_q)``, ``resistance``, ``phase_resistances``, ``mean_speed_rpm``
    and, as ``trace``, true currents, angle, speed and temperature.
    """
    name = _name(machine, speed_rpm)
    check_drive(name, drive)
    time = sampling_instants(name, duration, drive.time_step)
    wanted = reference_rows(name, reference, time[:-1], machine.current_limit)
    check_speed(name, speed_rpm, time)
    shaft, motion = shaft_of(speed_rpm, time, drive.time_step, machine.pole_pairs)
    fastest = _fastest(machine, drive, speed_rpm, motion)
    rig = rig_of(machine, drive, shaft, fastest)
    refuse_unstable(name, rig, wanted, fastest)
    sampled = _run(rig, _rows(wanted, motion, seed))
    _refuse_saturated(name, sampled, drive.dc_voltage)
    _refuse_diverged(name, sampled, rig.plant.table.reach, drive.time_step)
    truth = sampled.truth
    traced = (truth.current, truth.theta_el, truth.omega_el, sampled.temperature)
    trace = Trace(*map(np.asarray, traced))
    made = Truth(machine, drive, speed_rpm, reference, duration, seed, trace)
    return Recording(_experiment(name, drive, sampled), made)


def _name(machine: Machine, speed: Speed) -> str:
    if isinstance(speed, FreeShaft):
        return f"{machine.name} with a free shaft"
    if callable(speed):
        return f"{machine.name} at varying speed"
    return f"{machine.name} at {speed:g} rpm"


def _fastest(machine: Machine, drive: Drive, speed: Speed, motion: Motion) -> float:
    """Return the largest electrical speed of the run in rad/s; a free shaft's is bounded.

    Beyond twice the speed at which the magnets induce all of the dc link's voltage no torque
    drives the rotor.
    """
    given = float(np.abs(motion.omega_el).max())
    if not isinstance(speed, FreeShaft):
        return given
    return max(given, 2.0 * drive.dc_voltage / float(np.sqrt(3.0)) / machine.magnet_flux_linkage)


def _rows(wanted: FloatArray, motion: Motion, seed: int) -> Iterator[tuple[Row, int]]:
    """Yield the rows of the loop in chunks of one length, and how many of a chunk count.

    The last chunk repeats its last row; what comes of the repetition is dropped.
    """
    dq, phase, speed = (np.random.default_rng(entropy) for entropy in (seed, [seed, 1], [seed, 2]))
    for start in range(0, len(wanted), _CHUNK):
        count = min(_CHUNK, len(wanted) - start)
        index = start + np.minimum(np.arange(_CHUNK), count - 1)
        draws = Draws(
            on_device(dq.standard_normal((_CHUNK, 2))),
            on_device(phase.standard_normal((_CHUNK, 3))),
            on_device(speed.standard_normal(_CHUNK)),
        )
        yield Row(jnp.asarray(wanted[index]), Motion(*(x[index] for x in motion)), draws), count


def _run(rig: Rig, chunks: Iterator[tuple[Row, int]]) -> Sampled:
    """Run the loop through all chunks and return what the samples yield, as NumPy arrays."""
    state, parts = None, []
    with float64():
        # A whole number and a fraction in the same place would be two programs.
        rig = jax.tree.map(lambda x: jnp.asarray(x, dtype=float), rig)
        for rows, count in chunks:
            if state is None:
                state = rig.start(jax.tree.map(lambda x: x[0], rows.motion))
            state, sampled = _chunk(rig, state, rows)
            parts.append(jax.tree.map(lambda x, n=count: np.asarray(x)[:n], sampled))
    whole: Sampled = jax.tree.map(lambda *pieces: np.concatenate(pieces), *parts)
    return whole


@jax.jit
def _chunk(rig: Rig, state: LoopState, rows: Row) -> tuple[LoopState, Sampled]:
    """Return the loop after the rows, and what each yields."""
    return jax.lax.scan(lambda state, row: rig.sample(state, row), state, rows)


def _experiment(name: str, drive: Drive, sampled: Sampled) -> Experiment:
    """Return the recording as the file will hold it."""
    reading, voltage = sampled.reading, np.asarray(sampled.voltage)
    angle = np.mod(reading.theta_el, 2 * np.pi)
    channels = {
        "u_d": voltage[:, 0],
        "u_q": voltage[:, 1],
        "i_d": np.asarray(reading.current)[:, 0],
        "i_q": np.asarray(reading.current)[:, 1],
        "omega_el": np.asarray(reading.omega_el),
        # A tiny negative angle rounds to 2 pi itself.
        "theta_el": np.where(angle < 2 * np.pi, angle, 0.0),
    }
    digest = hashlib.sha256()
    for values in channels.values():
        digest.update(np.ascontiguousarray(values).tobytes())
    return Experiment(name, drive.time_step, channels, Source("simulated", digest.hexdigest()))


def _refuse_saturated(name: str, sampled: Sampled, dc_voltage: float) -> None:
    """Raise if the voltage stays at its limit for more than the permitted share."""
    share = float(np.mean(sampled.limit_used >= 1 - 1e-9))
    if share > _SATURATED_SHARE:
        raise InputError(
            f"{name}: the voltage stays at its limit of {dc_voltage / np.sqrt(3):.4g} V in "
            f"{share:.0%} of the run, so the reference is not reached; lower the speed, the "
            f"current or the controller's bandwidth, or raise the dc voltage."
        )


def _refuse_diverged(name: str, sampled: Sampled, reach: float, time_step: float) -> None:
    """Raise if a current is not finite or outside the machine's table."""
    inside = np.all(np.abs(sampled.truth.current) <= reach, axis=1)
    if not inside.all():
        raise InputError(
            f"{name}: the currents leave the simulated machine's range of {reach:.4g} A at "
            f"t = {time_step * np.argmin(inside):.4g} s; ask for less current, or lower the "
            f"controller's bandwidth."
        )
