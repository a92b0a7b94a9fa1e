"""Two flux maps and two resistances held against each other."""

from dataclasses import dataclass

import numpy as np

from penode.arrays import BoolArray, FloatArray
from penode.errors import InputError
from penode.fit.fit import Estimate, Fit
from penode.fit.outcome import NORMAL_95
from penode.pmsm.machine.flux_grid import FluxGrid
from penode.pmsm.machine.temperatures import Temperatures, temperatures_of
from penode.pmsm.machine.terms import REFERENCE
from penode.report.quantities import number, with_unit
from penode.report.statements import estimate_text

_POINTS = 81
#: Relative change of the resistance of copper per K at 20 degC.
_COPPER = 3.93e-3
#: Temperatures that differ by less are the same, K.
_SAME_K = 1.0


@dataclass(frozen=True, eq=False)
class MapComparison:
    """The second map less the first where both are supported.

    Attributes
    ----------
    i_d, i_q : ndarray, shape (row,) and (column,)
        Currents in A.
    difference : ndarray, shape (2, row, column)
        Of psi_d and psi_q in Vs; NaN where one of the two is not supported.
    no_current_flux : float
        Length of the first map's psi at no current in Vs.
    """

    i_d: FloatArray
    i_q: FloatArray
    difference: FloatArray
    no_current_flux: float

    @property
    def largest(self) -> float:
        """Largest length of the difference in Vs."""
        return float(np.nanmax(np.hypot(*self.difference)))

    @property
    def rms(self) -> float:
        """Root mean square of the difference's length in Vs."""
        return float(np.sqrt(np.nanmean(np.hypot(*self.difference) ** 2)))

    @property
    def sentence(self) -> str:
        """The same in words."""
        rms, largest = (
            f"{number(1e3 * one)} mVs ({number(100 * one / self.no_current_flux, 2)} %)"
            for one in (self.rms, self.largest)
        )
        return (
            f"psi differs by {rms} rms and {largest} at most; in % of psi at no current, "
            f"{number(1e3 * self.no_current_flux)} mVs"
        )


def compare_maps(first: Fit, second: Fit | FluxGrid) -> MapComparison:
    """Compare two flux maps on their common supported region.

    Parameters
    ----------
    first : Fit
        Of a machine.
    second : Fit or FluxGrid
        Another fit, compared on an even grid; or a table, compared at its own points.

    Returns
    -------
    MapComparison

    Raises
    ------
    InputError
        If there is no current at which both are supported.
    """
    i_d, i_q = (
        (second.i_d, second.i_q) if isinstance(second, FluxGrid) else _common_axes(first, second)
    )
    mesh = np.stack(np.meshgrid(i_d, i_q, indexing="ij"))
    common = _supported(first, mesh)
    if isinstance(second, FluxGrid):
        psi, common = second.psi, common & second.supported
    else:
        psi, common = second.flux_map(*mesh), common & _supported(second, mesh)
    if not common.any():
        raise InputError(
            "no current is supported by the recordings of both maps; compare fits of recordings "
            "over the same part of the dq plane."
        )
    difference = np.where(common, psi - first.flux_map(*mesh), np.nan)
    return MapComparison(i_d, i_q, difference, float(np.hypot(*first.flux_map(0.0, 0.0))))


def compare_resistances(first: Fit, second: Fit | FluxGrid) -> str:
    """Return in words whether two fits agree on R: whether chance may explain the difference.

    The intervals' half widths are added as squares, as those of independent recordings, with and
    without the accuracy of sensors, which errs alike where both were measured by the same ones. A
    table states R exactly; empty where it states none.
    """
    if isinstance(second, FluxGrid):
        return "" if second.resistance is None else _beside_stated(first, second.resistance)
    for name, fit in (("first", first), ("second", second)):
        if not fit.horizon.answered:
            return f"R cannot be compared: the verdict of the {name} is {fit.horizon.verdict!r}"
    one, other = first.parameters["R"], second.parameters["R"]
    factor, at = _brought_to(temperatures_of(first), temperatures_of(second))
    apart = abs(factor * other.value / one.value - 1)
    chance, same = (
        float(np.hypot(of(one), factor * of(other))) / one.value
        for of in (_half_width, _half_width_of_same_sensors)
    )
    values = f"R is {_text(one)} and {_text(other)}, {number(100 * apart, 2)} % apart{at}"
    limits = [f"{number(100 * limit, 2)} % may be chance" for limit in (chance, same)]
    kelvin = f"; in copper that is {number(apart / _COPPER, 2)} K"
    if apart > chance:
        return f"{values} where {limits[0]}: they DISAGREE{kelvin}"
    if same >= chance:
        return f"{values} where {limits[0]}: they agree"
    of_same = f"if both used the same sensors, {limits[1]}, and they "
    of_same += f"DISAGREE{kelvin}" if apart > same else "agree too"
    return f"{values} where {limits[0]}: they agree; {of_same}"


def _brought_to(first: Temperatures, second: Temperatures) -> tuple[float, str]:
    """Return what the second R is multiplied by to be that at the first one's temperature."""
    warm, cold = first.resistance, second.resistance
    if warm is None or cold is None or abs(warm - cold) < _SAME_K:
        return 1.0, ""
    at, was = (1 + _COPPER * (one - REFERENCE) for one in (warm, cold))
    return at / was, f" with the second brought from {cold:.3g} to {warm:.3g} °C as copper"


def _beside_stated(fit: Fit, stated: float) -> str:
    """Return in words where the interval of R lies to a stated resistance in ohm."""
    if not fit.horizon.answered:
        return f"R cannot be compared: the verdict is {fit.horizon.verdict!r}"
    one = fit.parameters["R"]
    low, high = one.interval_95
    place = "inside the interval" if low <= stated <= high else "OUTSIDE the interval"
    return f"R is {_text(one)} here and {with_unit(stated, one.unit, 4)} there: {place}"


def _text(estimate: Estimate) -> str:
    value, interval = estimate_text(estimate)
    return f"{value} (95 % interval {interval})"


def _half_width(estimate: Estimate) -> float:
    low, high = estimate.interval_95
    return (high - low) / 2


def _half_width_of_same_sensors(estimate: Estimate) -> float:
    """Return the half width less what the accuracy of the sensors, not estimated, adds."""
    return float(NORMAL_95 * np.sqrt(max(estimate.std**2 - estimate.sensor_std**2, 0.0)))


def _common_axes(first: Fit, second: Fit) -> tuple[FloatArray, FloatArray]:
    low = np.maximum(first.excited.min(axis=0), second.excited.min(axis=0))
    high = np.minimum(first.excited.max(axis=0), second.excited.max(axis=0))
    i_d, i_q = (np.linspace(a, b, _POINTS) for a, b in zip(low, high, strict=True))
    return i_d, i_q


def _supported(fit: Fit, mesh: FloatArray) -> BoolArray:
    return fit.supported(mesh.reshape(2, -1).T).reshape(mesh.shape[1:])
