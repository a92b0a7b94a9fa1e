"""What operating points determine, and what more points or a torque would bring."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.fit.fit import Fit
from penode.fit.outcome import NORMAL_95
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES
from penode.pmsm.machine.terms import MAGNETS, SPEED, TEMPERATURE
from penode.pmsm.points.balance import PointsBalance
from penode.pmsm.points.identify import balances_of, identify_points
from penode.pmsm.recording.drive_mapping import TORQUE
from penode.pmsm.study_settings import DEFAULT_STUDY, Study
from penode.report.quantities import number

#: Speed of further points over the slowest one's, and noise of a torque sensor over the largest
#: torque, of which is said what they would bring.
_SLOWER, _TORQUE_NOISE = 0.1, 0.005
#: Speeds that differ by less than this part are one; an axis or side is covered from this part on.
_ONE_SPEED, _COVERED = 0.2, 0.1


@dataclass(frozen=True, eq=False)
class PointsCheck:
    """What a table of operating points determines.

    Attributes
    ----------
    points : Experiment
    fit : Fit
        The points identified: it takes a second.
    coverage : tuple of str
        What currents, speeds and temperatures cover, what they cannot show, and advice, a sentence
        each.
    half_width : float
        Of R's 95 % interval, as a fraction of R.
    would_bring : mapping of str to float
        What could be measured beside -> that half width with it, of simulated measurements, where
        it is smaller.
    """

    points: Experiment
    fit: Fit
    coverage: tuple[str, ...]
    half_width: float
    would_bring: Mapping[str, float]

    @property
    def good(self) -> bool:
        """Whether the points answer."""
        return self.fit.horizon.answered

    def as_json(self) -> dict[str, Any]:
        """Return the check as JSON writes it."""
        return {
            "points": len(self.points),
            "coverage": list(self.coverage),
            "R_half_width": self.half_width,
            "would_bring": dict(self.would_bring),
            "verdict": self.fit.horizon.verdict,
            "reason": self.fit.horizon.reason,
            "good": self.good,
        }


def check_points(points: Experiment, study: Study = DEFAULT_STUDY, seed: int = 0) -> PointsCheck:
    """Check what operating points determine.

    Parameters
    ----------
    points : Experiment
        As `penode.pmsm.identify_points` takes them.
    study : Study
    seed : int
        Of the noise of the measurements that are simulated.

    Returns
    -------
    PointsCheck

    Raises
    ------
    InputError
        As `penode.pmsm.identify_points` does.
    """
    fit = identify_points(points, study)
    half, told = _half_width(fit), {}
    if fit.parameters["R"].value > 0:
        told = _would_bring(points, study, fit, seed)
    surer = {what: own for what, own in told.items() if own < half}
    return PointsCheck(points, fit, (*_coverage(points), *fit.warnings), half, surer)


def _half_width(fit: Fit) -> float:
    estimate = fit.parameters["R"]
    return float(NORMAL_95 * estimate.std / max(abs(estimate.value), 1e-300))


def _coverage(points: Experiment) -> tuple[str, ...]:
    """Return what is covered, and what would be worth covering."""
    currents, speed = points.stack(CURRENTS), points.channels[SPEED.name]
    largest = float(np.hypot(*currents.T).max())
    slow, fast = np.array([speed.min(), speed.max()]) * 30 / np.pi
    (low_d, low_q), (high_d, high_q) = currents.min(axis=0), currents.max(axis=0)
    told = [
        f"Currents up to {number(largest)} A over {100 * _share(currents, largest):.0f} % of that "
        f"disc: i_d {number(low_d)} to {number(high_d)} A, i_q {number(low_q)} to {number(high_q)} "
        f"A; electrical speed {slow:.5g} to {fast:.5g} rpm."
    ]
    if np.ptp(np.abs(speed)) < _ONE_SPEED * np.abs(speed).max():
        told.append("There is one speed only.")
    if min(high_q, -low_q) < _COVERED * largest:
        told.append("There is one sign of i_q only; the other shows what the map shares with R.")
    if high_d - low_d < _COVERED * largest:
        told.append("i_d hardly varies; the flux linkage along d is not determined.")
    for channel, what in ((TEMPERATURE, "R by 0.39 %"), (MAGNETS, "psi by 0.1 %")):
        kelvin = np.ptp(points.channels.get(channel.name, np.zeros(1)))
        if kelvin >= 1:
            told.append(
                f"{channel.name} varies by {number(float(kelvin))} K, {what} a kelvin or so; the "
                f"terms of temperature in the study file follow it."
            )
    return tuple(told)


def _share(currents: FloatArray, largest: float) -> float:
    """Return the share of the disc that the hull of the currents has."""
    try:
        return float(ConvexHull(currents).volume / (np.pi * largest**2))
    except QhullError:
        return 0.0


def _would_bring(points: Experiment, study: Study, fit: Fit, seed: int) -> dict[str, float]:
    """Return R's half width with more points, and with a torque, of the machine found."""
    random, noise = np.random.default_rng(seed), _balance(points, study).noise
    slow = _SLOWER * np.abs(points.channels[SPEED.name]).min()
    turning = slow * np.sign(points.channels[SPEED.name])
    measured = dict(points.channels)
    cases: dict[str, tuple[Experiment, Study]] = {}
    if slow > 0:
        more = replace(points, channels=measured | {SPEED.name: turning})
        more = _simulated(more, study, fit, noise, random)
        both = {n: np.concatenate([c, more.channels[n]]) for n, c in measured.items()}
        cases["the same points at a tenth of the speed"] = replace(points, channels=both), study
    if TORQUE not in measured:
        known = replace(study, pole_pairs=study.pole_pairs or 1)
        silent = replace(points, channels=measured | {TORQUE: np.ones(len(points))})
        torque = _simulated(silent, known, fit, np.array([*noise[:2], 0.0]), random)
        cases["the torque, to half a per cent"] = (
            replace(points, channels=measured | {TORQUE: torque.channels[TORQUE]}),
            known,
        )
    return {name: _half_width(identify_points(*case)) for name, case in cases.items()}


def _balance(points: Experiment, study: Study) -> PointsBalance:
    """Return the balance with a middle width of the inverter's knee."""
    balances = balances_of(points, study)
    return balances[len(balances) // 2]


def _simulated(
    points: Experiment, study: Study, fit: Fit, noise: FloatArray, random: np.random.Generator
) -> Experiment:
    """Return points with voltages, and a torque if they have one, of the machine found."""
    channels = dict(points.channels)
    values = {name: estimate.value for name, estimate in fit.parameters.items()}
    left = _balance(points, study).left(lambda at: fit.flux_map(*at.T).T, values)
    voltages = points.stack(VOLTAGES) - left[: 2 * len(points)].reshape(-1, 2)
    torque = channels.get(TORQUE, np.zeros(0)) - left[2 * len(points) :]
    for axis, name in enumerate(VOLTAGES):
        channels[name] = voltages[:, axis] + noise[axis] * random.normal(size=len(points))
    if TORQUE in channels:
        largest = np.abs(torque).max()
        off = max(float(noise[2]), _TORQUE_NOISE * float(largest))
        channels[TORQUE] = torque + off * random.normal(size=len(points))
    return replace(points, channels=channels)
