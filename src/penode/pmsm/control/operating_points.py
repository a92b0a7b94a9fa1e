"""The currents that a controller asks for at each torque and speed: the inverse of the loci.

The least current that gives the torque: on MTPA where the voltage suffices, else where the line of
the torque meets the voltage limit (field weakening). Morimoto et al., IEEE Trans. Ind. Appl. 26
(1990) 866, doi:10.1109/28.60058.
"""

from dataclasses import dataclass

import numpy as np

from penode.arrays import BoolArray, FloatArray
from penode.errors import InputError
from penode.pmsm.control.controlled_machine import ControlledMachine
from penode.pmsm.control.inversion import inverse
from penode.pmsm.control.torque_curves import ANGLES, Circles, VoltageCurves, most_torque

#: Radii of MTPA between which the torque is interpolated, and Newton steps from there.
_RADII, _STEPS = 61, 8
#: A torque is reached within this share of the largest, and limits hold within it.
_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class OperatingPoints:
    """Currents of least length over torque and speed.

    Attributes
    ----------
    torque : ndarray, shape (row,)
        In Nm.
    speed : ndarray, shape (column,)
        Mechanical, in rad/s.
    current : ndarray, shape (2, row, column)
        i_d, i_q in A; NaN where the limits do not let the torque be reached.
    flux_linkage : ndarray, shape (2, row, column)
        psi_d, psi_q in Vs.
    voltage : ndarray, shape (row, column)
        Peak value of a phase in V.
    supported : ndarray of bool, shape (row, column)
        Whether recordings have been at the current.
    """

    torque: FloatArray
    speed: FloatArray
    current: FloatArray
    flux_linkage: FloatArray
    voltage: FloatArray
    supported: BoolArray

    @property
    def reached(self) -> BoolArray:
        """Where the limits let the torque be reached, (row, column)."""
        return np.asarray(np.isfinite(self.current).all(axis=0))

    def csv(self) -> str:
        """Return a row a point, in SI units but the speed in rpm; cells are empty out of reach."""
        lines = ["torque,speed_rpm,i_d,i_q,psi_d,psi_q,voltage,supported"]
        values = np.stack([*self.current, *self.flux_linkage, self.voltage])
        for row, torque in enumerate(self.torque):
            for column, speed in enumerate(self.speed):
                at = [f"{torque + 0.0:.9g}", f"{speed * 30 / np.pi + 0.0:.9g}"]
                found = values[:, row, column]
                reached = np.isfinite(found).all()
                cells = [f"{one + 0.0:.9g}" if reached else "" for one in found]
                lines.append(",".join([*at, *cells, str(int(self.supported[row, column]))]))
        return "\n".join(lines) + "\n"


def operating_points(
    machine: ControlledMachine,
    torque: FloatArray,
    speed: FloatArray,
    current_limit: float,
    voltage_limit: float = np.inf,
) -> OperatingPoints:
    """Find the least current for each torque at each speed, within both limits.

    Parameters
    ----------
    machine : ControlledMachine
    torque : ndarray, shape (row,)
        In Nm; below zero the machine brakes where it turns forward.
    speed : ndarray, shape (column,)
        Mechanical, in rad/s, of either sign.
    current_limit, voltage_limit : float
        Peak values of a phase in A and V; without the latter all is MTPA.

    Returns
    -------
    OperatingPoints

    Raises
    ------
    InputError
        If a limit is not above zero, or a torque or speed is not finite.
    """
    torque, speed = (np.atleast_1d(np.asarray(one, dtype=np.float64)) for one in (torque, speed))
    for name, limit in (("current", current_limit), ("voltage", voltage_limit)):
        if not limit > 0:
            raise InputError(f"{name} limit must be > 0, got {limit}.")
    for name, values in (("torque", torque), ("speed", speed)):
        if not np.isfinite(values).all():
            raise InputError(f"{name} must be finite, got {values[~np.isfinite(values)][0]}.")
    electrical = speed * machine.pole_pairs
    current = np.full((2, len(torque), len(speed)), np.nan)
    limits = (current_limit, voltage_limit)
    brakes = torque < 0
    current[:, ~brakes] = _motoring(machine, torque[~brakes], electrical, *limits)
    mirrored = _motoring(machine.mirrored(), -torque[brakes], -electrical, *limits)
    current[:, brakes] = mirrored * np.array([1.0, -1.0])[:, None, None]
    flat = current.reshape(2, -1)
    found = np.isfinite(flat).all(axis=0)
    supported = np.zeros(len(found), dtype=np.bool_)
    if found.any():
        supported[found] = machine.supported(flat[:, found].T)
    at = np.broadcast_to(electrical, current.shape[1:]).ravel()
    return OperatingPoints(
        torque,
        speed,
        current,
        machine.flux_map(*flat).reshape(current.shape),
        np.hypot(*machine.voltage(flat, at)).reshape(current.shape[1:]),
        supported.reshape(current.shape[1:]),
    )


def _motoring(
    machine: ControlledMachine,
    torque: FloatArray,
    speed: FloatArray,
    current_limit: float,
    voltage_limit: float,
) -> FloatArray:
    """Return currents (2, row, column), A, at torques of zero or more, electrical speeds, rad/s."""
    on_mtpa = mtpa_of_torque(machine, torque, current_limit)
    current = np.repeat(on_mtpa[:, :, None], len(speed), axis=2)
    largest = current_limit * (1 + _TOLERANCE)
    for k, at in enumerate(speed):
        volts = np.hypot(*machine.voltage(on_mtpa, at))
        short = volts > voltage_limit * (1 + _TOLERANCE)
        if short.any():
            curves = VoltageCurves(machine, np.array([at]), np.array([voltage_limit]), largest)
            weakened = _at_voltage_limit(machine, torque[short], curves)
            weakened[:, ~(np.hypot(*weakened) <= largest)] = np.nan
            current[:, short, k] = weakened
    return current


def mtpa_of_torque(
    machine: ControlledMachine, torque: FloatArray, current_limit: float
) -> FloatArray:
    """Return the least current, (2, torque), A, for torques of zero or more in Nm.

    NaN where the current limit does not let it be reached.
    """
    radii = np.linspace(0, current_limit, _RADII)
    reached = np.maximum.accumulate(machine.torque(most_torque(machine, Circles(radii))))
    current = np.zeros((2, len(torque)))
    moves = torque > 0
    radius = np.interp(torque[moves], reached, radii)
    for _ in range(_STEPS):
        current[:, moves] = most_torque(machine, Circles(radius))
        # On MTPA the torque changes with the length of the current alone.
        along = (machine.torque_slope(current[:, moves]) * current[:, moves]).sum(axis=0) / radius
        radius = radius + (torque[moves] - machine.torque(current[:, moves])) / along
        radius = np.clip(radius, _TOLERANCE * current_limit, current_limit)
    missed = np.abs(machine.torque(current) - torque) > _TOLERANCE * reached[-1]
    current[:, missed] = np.nan
    return current


def _at_voltage_limit(
    machine: ControlledMachine, torque: FloatArray, curves: VoltageCurves
) -> FloatArray:
    """Return the least current, (2, torque), A, on one voltage curve; NaN where it has none."""
    best = machine.voltage(most_torque(machine, curves), curves.speed[0])[:, 0]
    tried = np.append(ANGLES, np.arctan2(best[1], best[0]))
    angles = np.unique(tried[np.isfinite(tried)])
    current = curves(angles[None])[0][:, 0]
    excess = machine.torque(current) - torque[:, None]
    crosses = (excess[:, :-1] >= 0) != (excess[:, 1:] >= 0)
    with np.errstate(all="ignore"):
        share = excess[:, :-1] / (excess[:, :-1] - excess[:, 1:])
        crossing = current[:, None, :-1] + share * np.diff(current, axis=1)[:, None]
    length = np.where(crosses, np.hypot(*crossing), np.inf)
    length[np.isnan(length)] = np.inf
    rows, cell = np.arange(len(torque)), length.argmin(axis=1)
    start = np.where(np.isfinite(length[rows, cell]), crossing[:, rows, cell], np.nan)
    speed, limit, scale = curves.speed[0], curves.magnitude[0], np.abs(torque).max() or 1.0

    def ratios(i: FloatArray) -> FloatArray:
        return np.stack([machine.torque(i) / scale, np.hypot(*machine.voltage(i, speed)) / limit])

    def slopes(i: FloatArray) -> FloatArray:
        volts, slope = machine.voltage(i, speed), machine.voltage_slope(i, speed)
        rise = np.einsum("a...,ab...->b...", volts, slope) / (np.hypot(*volts) * limit)
        return np.stack([machine.torque_slope(i) / scale, rise])

    return inverse(ratios, slopes, np.stack([torque / scale, np.ones(len(torque))]), start)
