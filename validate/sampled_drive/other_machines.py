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
    wanted = 0.35 * machine.rated_current + 1j * wanted.imag
    for k, shaft in enumerate(speed):
        current = (own * stator - main * linked) / (own**2 - main**2)
        seen = current + noise[k]
        slip = rotor / own * wanted[k].imag / wanted[k].real
        field = shaft + slip
        log.append((acting, seen, angle))
        # Fluxes in the frame of the field, in which the voltage is held and the rotor slips.
        for _ in range(_STEPS):
            stator, linked = _step(
                (stator, linked), acting, (field, slip), (machine.resistance, rotor, own, main),
                period / _STEPS,
            )  # fmt: skip
        angle += field * period
        error = gain * (wanted[k] - seen)
        integral += 0.02 * error
        acting = error + integral + 1j * field * (short * seen + main / own * linked)
    rows = np.array(log)
    link = np.full(len(speed), 2 * machine.rated_voltage)
    times = period * np.arange(len(speed))
    return Log(times, rows[:, 0], rows[:, 1], speed, rows[:, 2].real, link)


def _step(
    state: tuple[complex, complex],
    voltage: complex,
    turning: tuple[float, float],
    values: tuple[float, float, float, float],
    step: float,
) -> tuple[complex, complex]:
    """Return stator and rotor flux after a Runge-Kutta step."""
    resistance, rotor, own, main = values

    def rate(both: np.ndarray) -> np.ndarray:
        stator, linked = both
        det = own**2 - main**2
        i_stator, i_rotor = (
            (own * stator - main * linked) / det,
            (own * linked - main * stator) / det,
        )
        return np.array(
            [
                voltage - resistance * i_stator - 1j * turning[0] * stator,
                -rotor * i_rotor - 1j * turning[1] * linked,
            ]
        )

    x = np.array(state)
    k1 = rate(x)
    k2 = rate(x + step / 2 * k1)
    k3 = rate(x + step / 2 * k2)
    k4 = rate(x + step * k3)
    after = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return complex(after[0]), complex(after[1])


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
