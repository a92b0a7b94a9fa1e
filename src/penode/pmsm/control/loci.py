"""Currents that a controller wants: MTPA, MTPV, voltage limit, most torque over speed.

Every locus is the most torque on closed curves of currents: on circles (MTPA), or where the voltage
has one magnitude (MTPV, with R = 0 and omega = 1). Morimoto et al., IEEE Trans. Ind. Appl. 26
(1990) 866, doi:10.1109/28.60058.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from penode.arrays import BoolArray, FloatArray
from penode.errors import InputError
from penode.pmsm.control.controlled_machine import ControlledMachine
from penode.pmsm.control.torque_curves import ANGLES, Circles, VoltageCurves, most_torque
from penode.pmsm.machine.frames import quarter_turned

#: Current over the largest recorded one beyond which a map says nothing.
BEYOND = 1.5
#: Angles of a voltage curve that is drawn, rad.
_DRAWN = np.linspace(-np.pi, np.pi, 481)
#: Largest speed shown over the base speed.
_REACH = 4.0
#: Currents at which the support of MTPA is asked.
_TRIED = 96


@dataclass(frozen=True, eq=False)
class Locus:
    """Operating points along a line.

    Attributes
    ----------
    current : ndarray, shape (2, point)
        i_d, i_q in A; NaN where there is no such point.
    flux_linkage : ndarray, shape (2, point)
        psi_d, psi_q in Vs.
    torque : ndarray, shape (point,)
        In Nm, averaged over the angle.
    supported : ndarray of bool, shape (point,)
        Whether recordings have been there; elsewhere the locus is an extrapolation.
    speed : ndarray, shape (point,), or None
        Mechanical speed in rad/s, where the locus belongs to speeds.
    """

    current: FloatArray
    flux_linkage: FloatArray
    torque: FloatArray
    supported: BoolArray
    speed: FloatArray | None = None

    def chosen(self, which: BoolArray) -> "Locus":
        """Return some of the points."""
        speed = None if self.speed is None else self.speed[which]
        parts = (self.current[:, which], self.flux_linkage[:, which])
        return Locus(*parts, self.torque[which], self.supported[which], speed)


@dataclass(frozen=True, eq=False)
class ControlLoci:
    """All loci of a machine for one current and voltage limit.

    Attributes
    ----------
    mtpa : Locus
        Most torque for each current up to the limit.
    mtpv : Locus
        Most torque for each flux linkage, within the current limit; it may have no point.
    characteristic : Locus
        One point: the steady short-circuit current at high speed, where psi = 0.
    over_speed : Locus or None
        Most torque over the speed within both limits, None without a voltage limit. It ends where
        no current satisfies both.
    current_limit : float
        Peak value of a phase in A.
    voltage_limit : float or None
        Peak value of a phase in V.
    base_speed : float or None
        Mechanical speed in rad/s up to which the full MTPA torque is there.
    """

    mtpa: Locus
    mtpv: Locus
    characteristic: Locus
    over_speed: Locus | None
    current_limit: float
    voltage_limit: float | None
    base_speed: float | None


def control_loci(
    machine: ControlledMachine,
    current_limit: float,
    voltage_limit: float | None = None,
    points: int = 60,
) -> ControlLoci:
    """Compute all loci of a machine.

    Parameters
    ----------
    machine : ControlledMachine
    current_limit : float
        Peak value of a phase in A.
    voltage_limit : float, optional
        Peak value of a phase in V, such as u_dc / sqrt(3).
    points : int
        Half as many as the other loci have; MTPA, which costs little, has four times as many.

    Returns
    -------
    ControlLoci

    Raises
    ------
    InputError
        If a limit is not above zero, or the voltage does not even drive the current through R.
    """
    for name, limit, unit in (("current", current_limit, "A"), ("voltage", voltage_limit, "V")):
        if limit is not None and not 0 < limit < np.inf:
            raise InputError(f"{name} limit must be > 0 {unit}, got {limit} {unit}.")
    base, over_speed = None, None
    if voltage_limit is not None:
        base = base_speed(machine, current_limit, voltage_limit)
        speeds = np.linspace(0, _REACH, int(_REACH) * points // 2 + 1) * base
        over_speed = most_torque_over_speed(machine, speeds, current_limit, voltage_limit)
        over_speed = over_speed.chosen(np.isfinite(over_speed.torque))
    circle = Circles(np.array([current_limit]))(ANGLES[None])[0]
    fluxes = np.hypot(*machine.flux_map(*circle)).max() * np.linspace(0, 1, 2 * points + 1)[1:]
    return ControlLoci(
        mtpa=mtpa(machine, np.linspace(0, current_limit, 4 * points + 1)),
        mtpv=mtpv(machine, fluxes, current_limit),
        characteristic=characteristic_current(machine, current_limit),
        over_speed=over_speed,
        current_limit=current_limit,
        voltage_limit=voltage_limit,
        base_speed=base,
    )


def mtpa(machine: ControlledMachine, currents: FloatArray) -> Locus:
    """Return the most torque per ampere.

    Parameters
    ----------
    machine : ControlledMachine
    currents : ndarray, shape (point,)
        Magnitudes in A.
    """
    return _locus(machine, most_torque(machine, Circles(currents)))


def supported_torques(torque: FloatArray, supported: BoolArray) -> str:
    """Return the ranges of rising torques, Nm, that are supported, in words."""
    edges = np.flatnonzero(np.diff(supported.astype(int), prepend=0, append=0))
    ranges = [  # + 0.0 takes the sign of a zero away
        f"{torque[first] + 0.0:.3g} to {torque[end - 1] + 0.0:.3g}"
        for first, end in edges.reshape(-1, 2)
    ]
    return " and ".join(ranges) or "none"


def backed_current(machine: ControlledMachine, largest: float) -> float:
    """Return the largest current, A, at which recordings support MTPA; the one given if none."""
    tried = np.linspace(0, largest, _TRIED + 1)[1:]
    backed = tried[mtpa(machine, tried).supported]
    return float(backed[-1] if len(backed) else largest)


def mtpv(machine: ControlledMachine, fluxes: FloatArray, current_limit: float) -> Locus:
    """Return the most torque per flux linkage, which is most torque per volt at high speed.

    Parameters
    ----------
    machine : ControlledMachine
    fluxes : ndarray, shape (point,)
        Magnitudes in Vs, above zero.
    current_limit : float
        Peak value of a phase in A; points beyond it are left out.
    """
    lossless = replace(machine, resistance=0.0, inverter=None)
    curves = VoltageCurves(lossless, np.ones(len(fluxes)), fluxes, current_limit)
    locus = _locus(machine, most_torque(lossless, curves))
    return locus.chosen(np.hypot(*locus.current) <= current_limit)


def characteristic_current(machine: ControlledMachine, current_limit: float) -> Locus:
    """Return the current that cancels the magnet's flux: the steady short circuit at high speed.

    It may lie beyond the current limit, which only says where the search begins.
    """
    lossless = replace(machine, resistance=0.0, inverter=None)
    curves = VoltageCurves(lossless, np.ones(1), np.zeros(1), current_limit)
    return _locus(machine, curves(np.zeros((1, 1)))[0][..., 0])


def voltage_limit_curve(
    machine: ControlledMachine, speed: float, voltage_limit: float, current_limit: float
) -> Locus:
    """Return the currents at which the voltage is at its limit, in order along the curve.

    Parameters
    ----------
    machine : ControlledMachine
    speed : float
        Mechanical speed in rad/s, above zero.
    voltage_limit, current_limit : float
        Peak values of a phase in V and A.

    Returns
    -------
    Locus
        NaN where the current is beyond its limit.
    """
    electrical = np.array([speed * machine.pole_pairs])
    curve = VoltageCurves(machine, electrical, np.array([voltage_limit]), current_limit)
    current = curve(_DRAWN[None])[0][:, 0]
    current[:, ~(np.hypot(*current) <= current_limit)] = np.nan
    return _locus(machine, current)


def base_speed(machine: ControlledMachine, current_limit: float, voltage_limit: float) -> float:
    """Return the mechanical speed in rad/s at which full MTPA current meets the voltage limit.

    Raises
    ------
    InputError
        If the voltage does not even drive the current at standstill.
    """
    current = most_torque(machine, Circles(np.array([current_limit])))[:, 0]
    still = machine.drop(current)
    drop = float(np.hypot(*still))
    if drop >= voltage_limit:
        raise InputError(
            f"the voltage limit must be above the drop at standstill, {drop:.3g} V at "
            f"{current_limit:g} A, got {voltage_limit:g} V; raise it or lower the current limit."
        )
    psi = machine.flux_map(*current)
    along = still @ quarter_turned(psi)
    rest = (voltage_limit**2 - drop**2) * (psi @ psi)
    return float((np.sqrt(along**2 + rest) - along) / (psi @ psi)) / machine.pole_pairs


def most_torque_over_speed(
    machine: ControlledMachine, speeds: FloatArray, current_limit: float, voltage_limit: float
) -> Locus:
    """Return the most torque at each speed within both limits.

    Parameters
    ----------
    machine : ControlledMachine
    speeds : ndarray, shape (point,)
        Mechanical speeds in rad/s, from zero.
    current_limit, voltage_limit : float
        Peak values of a phase in A and V.

    Returns
    -------
    Locus
        NaN at speeds where no current satisfies both limits.
    """
    electrical = speeds * machine.pole_pairs
    full = most_torque(machine, Circles(np.array([current_limit])))
    current = np.repeat(full, len(speeds), axis=1)
    short = np.hypot(*machine.voltage(current, electrical)) > voltage_limit
    limits = np.full(np.count_nonzero(short), voltage_limit)
    curves = VoltageCurves(machine, electrical[short], limits, current_limit)
    current[:, short] = most_torque(machine, curves)
    # Where the best current at the voltage limit is too large, both limits are active.
    for k in np.flatnonzero(short & ~(np.hypot(*current) <= current_limit)):
        current[:, k] = _at_both_limits(machine, electrical[k], voltage_limit, full[:, 0])
    return replace(_locus(machine, current), speed=speeds)


def _at_both_limits(
    machine: ControlledMachine, speed: float, voltage_limit: float, full: FloatArray
) -> FloatArray:
    """Return where the circle through the full MTPA current (2,) meets the voltage limit.

    The search goes from there along the circle towards the least voltage; NaN if that is too much.
    Within rounding of the limit the full current is kept; where the map is NaN nothing is searched.
    """
    circle = Circles(np.array([np.hypot(*full)]))

    def excess(angle: FloatArray) -> FloatArray:
        current = circle(np.atleast_2d(angle))[0][:, 0]
        return np.asarray(np.hypot(*machine.voltage(current, speed)) - voltage_limit)

    motoring = ANGLES[ANGLES >= 0]
    beyond = excess(motoring)
    least = int(np.argmin(np.nan_to_num(beyond, nan=np.inf)))
    if not beyond[least] <= 0:
        return np.full(2, np.nan)
    start = float(np.arctan2(full[1], full[0]))
    if not excess(np.array(start))[0] > 0:
        return full
    angle = brentq(lambda a: excess(a)[0], start, motoring[least], xtol=1e-12)
    return circle(np.array([[angle]]))[0][:, 0, 0]


def _locus(machine: ControlledMachine, current: FloatArray) -> Locus:
    """Return the locus of currents (2, point)."""
    finite: BoolArray = np.all(np.isfinite(current), axis=0)
    supported: BoolArray = np.zeros(len(finite), dtype=np.bool_)
    if finite.any():
        supported[finite] = machine.supported(current[:, finite].T)
    return Locus(current, machine.flux_map(*current), machine.torque(current), supported)


def loci_csv(loci: ControlLoci) -> str:
    """Return all loci as CSV in SI units, the speed in rpm; empty where a locus has none."""
    named = {"mtpa": loci.mtpa, "mtpv": loci.mtpv, "characteristic": loci.characteristic}
    if loci.over_speed is not None:
        named["over_speed"] = loci.over_speed
    lines = ["locus,i_d,i_q,psi_d,psi_q,torque,speed_rpm,power,supported"]
    for name, locus in named.items():
        rows = np.column_stack([locus.current.T, locus.flux_linkage.T, locus.torque])
        for k, row in enumerate(rows):
            at = ["", ""]
            if locus.speed is not None:
                speed = locus.speed[k]
                at = [f"{speed * 30 / np.pi:.9g}", f"{speed * locus.torque[k]:.9g}"]
            cells = [name, *(f"{v + 0.0:.9g}" for v in row), *at, str(int(locus.supported[k]))]
            lines.append(",".join(cells))
    return "\n".join(lines) + "\n"
