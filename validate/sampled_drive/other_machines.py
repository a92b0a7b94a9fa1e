"""Machines that are not synchronous, under controls of their own: an induction and a DC machine."""

import numpy as np

from validate.sampled_drive.log import Log
from validate.sampled_drive.machines import Machine

_STEPS = 5


def induction(
    machine: Machine, speed: np.ndarray, wanted: np.ndarray, noise: np.ndarray, period: float
) -> Log:
    """Return the log of an induction machine under indirect field orientation.

    Parameters
    ----------
    machine : Machine
        Whose ratings and resistance it has; its magnetising inductance is 3 times the reactance
        at base speed that voltage and current make, its leakage a tenth of that.
    speed : ndarray, shape (time,)
        Of the shaft times pole pairs, in rad/s.
    wanted : ndarray of complex, shape (time,)
        Reference in A; its q part is used, in the frame of the rotor's flux, beside 0.35 of the
        machine's current in d.
    noise : ndarray of complex, shape (time,)
        A.
    period : float
        s.
    """
    base = machine.rated_voltage / machine.rated_current / machine.base_speed
    main, leak, rotor = 2.0 * base, 0.08 * base, 0.8 * machine.resistance
    own, short = main + leak, leak * (2 * main + leak) / (main + leak)
    gain, integral, acting = 0.1 * 2 * np.pi / period * short, 0j, 0j
    stator, linked, angle, log = 0j, 0j, 0.0, []
    resistance, det = machine.resistance, own**2 - main**2
    wanted = 0.35 * machine.rated_current + 1j * wanted.imag
    for k, shaft in enumerate(speed):
        current = (own * stator - main * linked) / det
        seen = current + noise[k]
        slip = rotor / own * wanted[k].imag / wanted[k].real
        field = shaft + slip
        log.append((acting, seen, angle))
        of_stator = (-resistance * own / det - 1j * field, resistance * main / det)
        of_rotor = (rotor * main / det, -rotor * own / det - 1j * slip)
        stator, linked = _after((stator, linked), of_stator, of_rotor, acting, period)
        angle += field * period
        error = gain * (wanted[k] - seen)
        integral += 0.02 * error
        acting = error + integral + 1j * field * (short * seen + main / own * linked)
    rows = np.array(log)
    link = np.full(len(speed), 2 * machine.rated_voltage)
    times = period * np.arange(len(speed))
    return Log(times, rows[:, 0], rows[:, 1], speed, rows[:, 2].real, link)


def _after(
    state: tuple[complex, complex],
    of_stator: tuple[complex, complex],
    of_rotor: tuple[complex, complex],
    voltage: complex,
    period: float,
) -> tuple[complex, complex]:
    """Return stator and rotor flux after a period: the exponential's series, of order 4."""
    (a, b), (c, d), step = of_stator, of_rotor, period / _STEPS
    for _ in range(_STEPS):
        x, y = state
        slope = (a * x + b * y + voltage, c * x + d * y)
        for order in range(1, 5):
            by_x, by_y = slope[0] * step / order, slope[1] * step / order
            x, y = x + by_x, y + by_y
            slope = (a * by_x + b * by_y, c * by_x + d * by_y)
        state = x, y
    return state


def direct_current(
    machine: Machine, speed: np.ndarray, wanted: np.ndarray, noise: np.ndarray, period: float
) -> Log:
    """Return the log of a DC machine whose armature a logger called q; parameters as above."""
    inductance = 0.3 * machine.rated_voltage / machine.rated_current / machine.base_speed
    kept = np.exp(-machine.resistance / inductance * period)
    gain, integral, acting, current, log = 0.1 * 2 * np.pi / period * inductance, 0.0, 0.0, 0.0, []
    linkage = 0.6 * machine.rated_voltage / machine.base_speed
    for k, shaft in enumerate(speed):
        seen = current + noise[k].real
        log.append((1j * acting, 1j * seen))
        driving = acting - linkage * shaft
        current = kept * current + (1 - kept) / machine.resistance * driving
        error = gain * (wanted[k].imag - seen)
        integral += 0.02 * error
        acting = error + integral + linkage * shaft
    rows, times = np.array(log), period * np.arange(len(speed))
    angle = np.concatenate([[0.0], np.cumsum(speed[:-1]) * period])
    link = np.full(len(speed), 2 * machine.rated_voltage)
    return Log(times, rows[:, 0], rows[:, 1], speed, angle, link)
