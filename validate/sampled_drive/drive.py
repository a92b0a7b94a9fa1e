"""A drive: the plant of `plant.c` under a sampled current control, and what it writes down."""

import ctypes
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from validate.sampled_drive.library import Double, InverterRecord, plant
from validate.sampled_drive.log import Log
from validate.sampled_drive.machines import Machine

#: Longest step of the solver in s.
LONGEST_STEP = 10e-6
_AXES = np.exp(2j * np.pi / 3 * np.arange(3))
_A, _B, _C = (complex(axis) for axis in _AXES)


@dataclass(frozen=True)
class Drive:
    """Inverter, control and sensors.

    Attributes
    ----------
    rate : float
        Of the control, in Hz.
    bandwidth : float
        Of the current control, as a fraction of rate.
    dead_time : float
        s.
    swing : float
        Current, as a fraction of the machine's, that just recharges a leg's node within the dead
        time; larger ones lose the whole of it.
    on_state : float
        Drop of a device at the machine's current, as a fraction of the machine's voltage.
    switched : bool
        Whether legs switch, by a triangle as long as a period, or supply their mean.
    ripple : float
        Of the link at 300 Hz, as a fraction of its voltage.
    noise, offset, gain : float
        Of the current sensors: deviation and offset of phase b as fractions of the machine's
        current, gain of phase b.
    bits : int
        Of the current sensors over 1.5 times the machine's current; 0 for no steps.
    angle_per_load : float
        Error of the angle that the drive uses at the machine's current in q, in rad.
    magnet_loss : float
        Fraction of the magnet's flux linkage that is gone by the end.
    iron_loss : float
        Fraction of the machine's current that the iron takes at base speed.
    """

    rate: float = 10e3
    bandwidth: float = 0.03
    dead_time: float = 0.0
    swing: float = 0.0
    on_state: float = 0.0
    switched: bool = False
    ripple: float = 0.0
    noise: float = 1e-3
    offset: float = 0.0
    gain: float = 1.0
    bits: int = 0
    angle_per_load: float = 0.0
    magnet_loss: float = 0.0
    iron_loss: float = 0.0

    def inverter(self, machine: Machine) -> InverterRecord:
        """Return the inverter as the plant reads it."""
        drop = self.on_state * machine.rated_voltage
        thermal = drop / 16  # of 0.8 V; a junction's law rises by it with each e-fold of current
        link = 2 * machine.rated_voltage
        at_rest = machine.rated_current * np.exp(-16)
        return InverterRecord(
            period=1 / self.rate,
            dead_time=self.dead_time,
            node_capacitance=self.swing * machine.rated_current * self.dead_time / link,
            thermal=thermal,
            saturation=at_rest,
            switched=self.switched,
        )


class Plant:
    """Machine and inverter, advanced period by period.

    Parameters
    ----------
    machine : Machine
    drive : Drive
    """

    def __init__(self, machine: Machine, drive: Drive):
        self.library = plant()
        self.machine, self.inverter = machine.record(), drive.inverter(machine)
        lost = drive.iron_loss * machine.rated_current / machine.rated_voltage
        self.machine.iron_conductance = lost
        self.state, self.seen, self.duty = (Double * 2)(), (Double * 2)(), (Double * 3)()

    def current(self, angle: float, speed: float) -> complex:
        """Return i_d + j i_q at the terminals, in A."""
        self.library.terminal_current(self.machine, self.state, angle, speed, self.seen)
        return complex(self.seen[0], self.seen[1])

    def advance(self, duty: list[float], link: float, angle: float, speed: float) -> None:
        """Apply duty cycles for a period that begins at an angle."""
        self.duty[:] = duty
        self.library.advance(
            *(ctypes.byref(self.machine), ctypes.byref(self.inverter), self.state),
            *(angle, speed, self.duty, link, LONGEST_STEP),
        )


class CurrentControl:
    """A PI controller in the rotor's frame with the rotation fed forward, limited to the link.

    Parameters
    ----------
    machine : Machine
    drive : Drive
    """

    def __init__(self, machine: Machine, drive: Drive):
        jet = machine.jet(0.0, 0.0)
        middle = machine.jet(0.5 * machine.rated_current, 0.5 * machine.rated_current)
        self.l_d, self.l_q = (float(np.sqrt(jet[name] * middle[name])) for name in ("l_dd", "l_qq"))
        self.gain = 2 * np.pi * drive.bandwidth * drive.rate
        self.per_sample = self.gain / 6 / drive.rate
        self.linkage, self.limit = machine.flux(0j).real, 1.1 * machine.rated_voltage
        self.integral = 0j

    def voltage(self, wanted: complex, current: complex, speed: float) -> complex:
        """Return u_d + j u_q in V."""
        gap = wanted - current
        error = self.gain * complex(self.l_d * gap.real, self.l_q * gap.imag)
        turning = self.linkage + complex(self.l_d * current.real, self.l_q * current.imag)
        voltage = error + self.integral + 1j * speed * turning
        limited = voltage * min(1.0, self.limit / max(abs(voltage), 1e-9))
        self.integral += self.per_sample * (error + limited - voltage)
        return limited


def duties(voltage: complex, link: float) -> list[float]:
    """Return duty cycles of a voltage alpha + j beta, centred between the rails."""
    a = voltage.real / link
    half, quadrature = -a / 2, np.sqrt(3) / 2 * voltage.imag / link
    b, c = half + quadrature, half - quadrature
    middle = 0.5 - (max(a, b, c) + min(a, b, c)) / 2
    return [min(max(x + middle, 0.03), 0.97) for x in (a, b, c)]


def simulate(
    machine: Machine,
    drive: Drive,
    speed: np.ndarray,
    wanted: Callable[[np.ndarray], np.ndarray],
    random: np.random.Generator,
) -> Log:
    """Run a drive at given speeds.

    Parameters
    ----------
    machine : Machine
    drive : Drive
    speed : ndarray, shape (time,)
        Electrical, in rad/s, one a period; constant within it.
    wanted : callable
        Returns the reference i_d + j i_q in A at times in s.
    random : numpy.random.Generator
        Of the sensors' noise.

    Returns
    -------
    Log
        At each sample the measured current, the voltage that acts from it to the next, computed
        one sample before, and the angle that the drive uses.
    """
    period, count = 1 / drive.rate, len(speed)
    angle = np.concatenate([[random.uniform(0, 6)], speed[:-1] * period]).cumsum()
    times = period * np.arange(count)
    references, link = wanted(times), 2 * machine.rated_voltage
    links = link * (1 + drive.ripple * np.cos(2 * np.pi * 300 * times + 1))
    magnets = machine.iron["magnet"] * np.ones(count)
    magnets -= drive.magnet_loss * machine.flux(0j).real * np.linspace(0, 1, count)
    sensed = _sensors(machine, drive, random, count)
    model, control = Plant(machine, drive), CurrentControl(machine, drive)
    rows = np.empty((count, 3), complex)
    acting, turn = 0j, 1 + 0j
    for k in range(count):
        model.machine.magnet = magnets[k]
        current = sensed(model.current(angle[k], speed[k]), angle[k], k)
        used = angle[k] + drive.angle_per_load * current.imag / machine.rated_current
        current *= np.exp(1j * (angle[k] - used))
        rows[k] = current, acting, used
        model.advance(duties(acting * turn, link), links[k], angle[k], speed[k])
        acting = control.voltage(complex(references[k]), complex(current), speed[k])
        turn = complex(np.exp(1j * (used + 1.5 * speed[k] * period)))
    return Log(times, rows[:, 1], rows[:, 0], speed, rows[:, 2].real, np.full(count, link))


def _sensors(
    machine: Machine, drive: Drive, random: np.random.Generator, count: int
) -> Callable[[complex, float, int], complex]:
    """Return what three sensors make of the current of sample k."""
    rated = machine.rated_current
    added = drive.noise * rated * random.normal(size=(count, 3))
    added[:, 1] += drive.offset * rated
    step = 3 * rated / 2**drive.bits if drive.bits else 0.0
    gains = np.array([1, drive.gain, 1])

    def sensed(current: complex, angle: float, k: int) -> complex:
        turn = np.exp(1j * angle)
        phases = gains * np.real(current * turn * _AXES.conj()) + added[k]
        if step:
            phases = step * np.round(phases / step)
        return complex(2 / 3 * (phases @ _AXES) / turn)

    return sensed
