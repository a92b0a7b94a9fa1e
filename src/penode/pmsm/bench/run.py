"""One simulated recording: reference -> controller -> inverter -> machine -> sensors -> file.

Row k holds the currents measured at t_k and the voltage computed from them, which acts from t_k to
t_(k+1), constant in the rotor frame. The inverter is ideal: the machine gets what is asked for.
"""

import hashlib
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray
from penode.data.experiment import Experiment, Source
from penode.errors import InputError
from penode.pmsm.bench.current_controller import CurrentController, tuned_controller
from penode.pmsm.bench.machines import Machine
from penode.pmsm.bench.plant import Plant, plant_of
from penode.pmsm.bench.references import Reference

_CHANNELS = ("u_d", "u_q", "i_d", "i_q", "omega_el", "theta_el")

# Share of a run that may lie at the voltage limit before the reference counts as unreachable.
_SATURATED_SHARE = 0.05


@dataclass(frozen=True)
class Drive:
    """Everything between the reference and the machine's terminals.

    Attributes
    ----------
    time_step : float
        Sampling and control interval in s.
    dc_voltage : float
        Voltage of the dc link in V.
    bandwidth : float
        Bandwidth the current controller is tuned for in rad/s.
    tuning : float
        Inductance the controller believes over the data sheet's.
    current_noise : float
        Standard deviation in A of the white noise on each measured dq current.
    """

    time_step: float = 1e-4
    dc_voltage: float = 400.0
    bandwidth: float = 1000.0
    tuning: float = 0.8
    current_noise: float = 0.0


DEFAULT_DRIVE = Drive()


def simulate(
    machine: Machine,
    reference: Reference,
    *,
    speed_rpm: float,
    duration: float,
    drive: Drive = DEFAULT_DRIVE,
    seed: int = 0,
) -> Experiment:
    """Record a drive that follows a current reference at constant speed.

    Parameters
    ----------
    machine : Machine
        The machine; it starts without current at theta_el = 0.
    reference : callable
        Times in s, shape (time,), to i_d and i_q in A, shape (time, 2).
    speed_rpm : float
        Mechanical speed in revolutions per minute; negative turns backwards.
    duration : float
        Length of the recording in s.
    drive : Drive
        Sampling, dc link, controller and sensors.
    seed : int
        Seed of the measurement noise.

    Returns
    -------
    Experiment
        Channels u_d, u_q in V, i_d, i_q in A (as measured), omega_el in rad/s, theta_el in rad
        (0 to 2 pi). The voltage of row k is held in the rotor frame from t_k to t_(k+1).

    Raises
    ------
    InputError
        If the speed is not finite, the duration holds no sample, the reference is not two finite
        currents a row, or it cannot be followed: the voltage stays at its limit, or the currents
        leave the machine's table.
    """
    name = f"{machine.name} at {speed_rpm:g} rpm"
    if not np.isfinite(speed_rpm):
        raise InputError(f"{name}: the speed is not finite; give it in revolutions per minute.")
    time = _sampling_instants(name, duration, drive.time_step)
    wanted = _reference_rows(name, reference, time)
    omega_el = 2 * np.pi / 60 * speed_rpm * machine.pole_pairs
    theta_el = np.mod(omega_el * time, 2 * np.pi)
    noise = drive.current_noise * np.random.default_rng(seed).standard_normal((len(time), 2))
    controller = tuned_controller(
        machine,
        bandwidth=drive.bandwidth,
        tuning=drive.tuning,
        dc_voltage=drive.dc_voltage,
        time_step=drive.time_step,
    )
    plant = plant_of(machine, time_step=drive.time_step, omega_el=omega_el)
    with jax.enable_x64(True):
        samples = (jnp.asarray(wanted), jnp.asarray(noise), jnp.asarray(theta_el))
        rows = _closed_loop(controller, plant, jnp.asarray(omega_el), samples)
        voltage, measured = np.asarray(rows[0]), np.asarray(rows[1])
    _refuse_saturated(name, voltage, controller.voltage_limit)
    _refuse_diverged(name, measured, plant.table.reach, drive.time_step)
    columns = (*voltage.T, *measured.T, np.full_like(time, omega_el), theta_el)
    digest = hashlib.sha256(np.stack(columns).tobytes()).hexdigest()
    channels = dict(zip(_CHANNELS, columns, strict=True))
    return Experiment(name, drive.time_step, channels, Source("simulated", digest))


@jax.jit
def _closed_loop(
    controller: CurrentController,
    plant: Plant,
    omega_el: JaxArray,
    samples: tuple[JaxArray, JaxArray, JaxArray],
) -> tuple[JaxArray, JaxArray]:
    """Return the voltages and the measured currents, each (time, 2), of a run from no current."""

    def sample(
        state: tuple[JaxArray, JaxArray], row: tuple[JaxArray, JaxArray, JaxArray]
    ) -> tuple[tuple[JaxArray, JaxArray], tuple[JaxArray, JaxArray]]:
        current, integral = state
        reference, noise, theta_el = row
        measured = current + noise
        voltage, integral = controller.step(integral, reference, measured, omega_el)
        current = plant.advance(current, voltage, theta_el, omega_el)
        return (current, integral), (voltage, measured)

    _, rows = jax.lax.scan(sample, (jnp.zeros(2), jnp.zeros(2)), samples)
    return rows


def _sampling_instants(name: str, duration: float, time_step: float) -> FloatArray:
    """Return the times of the rows, (time,)."""
    if not (np.isfinite(duration) and duration >= time_step > 0):
        raise InputError(
            f"{name}: {duration:g} s hold no sample at a time step of {time_step:g} s; "
            f"give a duration and a time step above zero, the duration being the longer."
        )
    return time_step * np.arange(round(duration / time_step), dtype=np.float64)


def _reference_rows(name: str, reference: Reference, time: FloatArray) -> FloatArray:
    """Return the reference at the rows, (time, 2)."""
    wanted = np.asarray(reference(time), dtype=np.float64)
    if wanted.shape != (len(time), 2) or not np.all(np.isfinite(wanted)):
        raise InputError(
            f"{name}: the reference came in shape {wanted.shape}, or not finite; return finite i_d "
            f"and i_q in A for each of the {len(time)} times, in shape {(len(time), 2)}."
        )
    return wanted


def _refuse_saturated(name: str, voltage: FloatArray, limit: float) -> None:
    """Raise if the voltage (time, 2) stays at its limit for more than the permitted share."""
    share = np.mean(np.hypot(voltage[:, 0], voltage[:, 1]) >= limit * (1 - 1e-9))
    if share > _SATURATED_SHARE:
        raise InputError(
            f"{name}: the voltage stays at its limit of {limit:.4g} V in {share:.0%} of the run, "
            f"so the reference is not reached; lower the speed, the current or the controller's "
            f"bandwidth, or raise the dc voltage."
        )


def _refuse_diverged(name: str, current: FloatArray, reach: float, time_step: float) -> None:
    """Raise if a current (time, 2) is not finite or outside the machine's table."""
    inside = np.all(np.abs(current) <= reach, axis=1)
    if not inside.all():
        raise InputError(
            f"{name}: the currents leave the simulated machine's range of {reach:.4g} A at "
            f"t = {time_step * np.argmin(inside):.4g} s; ask for less current, or lower the "
            f"controller's bandwidth."
        )
