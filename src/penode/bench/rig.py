"""The rig: the blocks of a drive on the bench, and one sample of their loop.

reference -> controller -> delay -> inverter -> machine and shaft -> sensors -> controller
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import JaxArray
from penode.bench.coenergy_table import tabulate
from penode.bench.current_controller import CurrentController
from penode.bench.drive import Drive
from penode.bench.inverter import Inverter, Switching
from penode.bench.machines import Machine
from penode.bench.phases import phases, rotated
from penode.bench.plant import Copper, Plant, State, VoltageAt
from penode.bench.sensors import Draws, Reading, Sensors, Terminals
from penode.bench.shaft import Motion, Shaft

# The most that the fastest harmonic may turn in one integration step, in rad.
_LARGEST_TURN = 0.2
# The most of its time constant that a sensors' filter may go in one integration step.
_LARGEST_DECAY = 0.5
# The most current scales of a dead time that a phase current may move in one integration step.
_LARGEST_SWEEP = 2.0


class Row(NamedTuple):
    """What is given for a sample: wanted currents (..., 2), A, the shaft and random numbers."""

    reference: JaxArray
    motion: Motion
    draws: Draws


class Sampled(NamedTuple):
    """What a sample yields: voltages asked for, V, readings, true values, degC of the winding."""

    voltage: JaxArray
    reading: Reading
    truth: Terminals
    temperature: JaxArray
    # Length of the voltage over the longest permitted.
    limit_used: JaxArray


class LoopState(NamedTuple):
    """What a sample leaves to the next."""

    plant: State
    # Integral part of the controller (2,), V.
    integral: JaxArray
    # Voltages (delay, 2), V, that do not act yet, the oldest first.
    waiting: JaxArray


class Rig(eqx.Module):
    """The blocks of the loop, from the controller to what the sensors see of the truth."""

    controller: CurrentController
    inverter: Inverter
    switching: Switching
    plant: Plant
    sensors: Sensors

    def start(self, motion: Motion) -> LoopState:
        """Return the loop before its first sample: no current, the induced voltage waiting."""
        theta_el, omega_el = jnp.asarray(motion.theta_el), jnp.asarray(motion.omega_el)
        none = jnp.zeros(2)
        angle = theta_el - self.inverter.hold.frame_angle(theta_el)
        idle = rotated(self.controller.induced(none, omega_el), angle)
        waiting = jnp.tile(idle, (self.inverter.delay, 1))
        return LoopState(self.plant.rest(theta_el, omega_el), none, waiting)

    def sample(self, state: LoopState, row: Row) -> tuple[LoopState, Sampled]:
        """Return the loop one sample later, and what the sample yields."""
        plant = self.plant.at_sample(state.plant, row.motion)
        truth = self.plant.terminals(plant)
        reading = self.sensors.read(truth, row.draws)
        turn = reading.omega_el * self.switching.period
        angle = self.inverter.hold.command_angle(reading.theta_el, turn)
        voltage, integral = self.controller.step(state.integral, row.reference, reading, angle)
        sent = rotated(voltage, angle - self.inverter.hold.frame_angle(truth.theta_el))
        line = jnp.concatenate([state.waiting, sent[None]])
        phase_currents = phases(rotated(truth.current, truth.theta_el))
        pulses = self.inverter.hold.pulses(
            line[0], phase_currents, self.inverter.dead_time, self.switching
        )
        after = self.plant.advance(plant, pulses, self.voltages, row.motion.slope)
        used = self.inverter.limit.used(voltage, angle, self.switching.dc_voltage)
        sampled = Sampled(voltage, reading, truth, plant.temperature, used)
        return LoopState(after, integral, line[1:]), sampled

    def voltages(self, vector: JaxArray) -> VoltageAt:
        """Return the function from current (2,), A, and angle, rad, to terminal voltage (2,), V.

        The pulse's `vector` (2,), V, is in the hold's frame.
        """

        def voltage_at(current: JaxArray, theta_el: JaxArray) -> JaxArray:
            return self.inverter.terminal_voltage(vector, current, theta_el, self.switching)

        return voltage_at


def rig_of(machine: Machine, drive: Drive, shaft: Shaft, fastest: float) -> Rig:
    """Return a drive's blocks, integrated finely enough for an electrical speed in rad/s."""
    sensors = Sensors(
        current=drive.current_sensors,
        resolver=drive.resolver,
        speed=drive.speed_sensor,
        dq_noise=drive.current_noise,
        pole_pairs=float(machine.pole_pairs),
    )
    switching = Switching(drive.dc_voltage, drive.time_step)
    controller = CurrentController.tuned(machine, drive)
    plant = _plant(machine, drive, shaft, substeps(machine, drive, fastest))
    return Rig(controller, drive.inverter, switching, plant, sensors)


def _plant(machine: Machine, drive: Drive, shaft: Shaft, steps: int) -> Plant:
    """Return a machine's plant, integrated in so many steps a pulse."""
    copper = Copper(machine.resistance, machine.copper_coefficient, machine.reference_temperature)
    warm = drive.magnet_temperature
    filtered = drive.current_sensors is not None and drive.current_sensors.cutoff_hz is not None
    return Plant(
        table=tabulate(machine),
        copper=copper,
        magnet_flux_change=0.0 if warm is None else machine.magnet_flux_change(warm),
        winding=drive.winding,
        iron_loss=drive.iron_loss,
        shaft=shaft,
        sensors=drive.current_sensors if filtered else None,
        substeps=steps,
    )


def substeps(machine: Machine, drive: Drive, fastest: float) -> int:
    """Return how many integration steps one pulse takes at an electrical speed in rad/s.

    The fastest harmonic turns by at most 0.2 rad a step, a filter decays by at most half a time
    constant, and with dead time a phase current moves by at most two of its current scales, so
    that its crossing of zero is met. For steps of 25 V on the built-in machines the error is below
    1e-8 of the current limit, 1e-6 with a filter.
    """
    turn = abs(fastest) * drive.time_step
    wanted = [2.0, max(machine.angle_orders, default=1) * turn / _LARGEST_TURN]
    sensors, dead_time = drive.current_sensors, drive.inverter.dead_time
    if sensors is not None and sensors.cutoff_hz is not None:
        wanted.append(2.0 * np.pi * sensors.cutoff_hz * drive.time_step / _LARGEST_DECAY)
    if dead_time is not None:
        sweep = turn * machine.current_limit / dead_time.current_scale
        wanted.append(sweep / _LARGEST_SWEEP)
    return int(np.ceil(max(wanted)))
