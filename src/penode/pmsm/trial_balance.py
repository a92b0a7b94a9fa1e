"""The voltage balance on trial: how well a recording obeys it as it stands, in well under a second.

A low polynomial coenergy, R and the mean of a dead time by the current's direction are found in
weak form. The rotor's angle is not used, so that a wrong one cannot spoil the judgement.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.pmsm.weak_balance import PolynomialMap, harmonic_window
from penode.training.covariance import bartlett
from penode.training.weak_form import WeakRegression, weak_regression

#: Degree of the coenergy: enough for factors and the magnet, and for timing and R.
_DEGREE, FINE_DEGREE = 4, 8
#: Share of the largest current below which the mean dead-time voltage fades.
_FADE = 0.02
#: Points at which the differential inductance is looked at.
_POINTS = 200
#: Windows for the timing, in windows that null the sixth harmonic; the larger null orders 1 and 2.
_TIMING_WINDOWS = (1, 3, 6, 12)
#: Fewest windows in a recording: what fewer leave over is little in any case.
_FEWEST = 16
#: Turn of the voltage in rad that need not be a delay: dead time, resolver, hold.
_OTHER_TURN = 0.01
#: Equations that share samples with one: two axes, windows overlapping by three quarters.
_OVERLAPPING = 16


@dataclass(frozen=True, eq=False)
class TrialBalance:
    """What the balance makes of a recording.

    Attributes
    ----------
    resistance, deviation : float
        R and its HAC deviation in ohm.
    leftover : float
        What is left of the voltages, over the voltages (root mean square).
    definite : float
        Share of the visited currents at which d psi / d i is positive definite, as it must be.
    magnet : ndarray, shape (2,)
        Flux linkage at no current in Vs.
    magnet_deviation : float
        HAC deviation of its q part in Vs.
    inductance : ndarray, shape (2,)
        L_dd and L_qq at no current in H.
    """

    resistance: float
    deviation: float
    leftover: float
    definite: float
    magnet: FloatArray
    magnet_deviation: float
    inductance: FloatArray

    @property
    def doubt(self) -> float:
        """The leftover, doubled where no d psi / d i is positive definite: smaller is better."""
        return self.leftover * (2.0 - self.definite)


def try_balance(
    experiment: Experiment, window: int | None = None, degree: int = _DEGREE
) -> TrialBalance:
    """Solve the balance of one recording.

    Parameters
    ----------
    experiment : Experiment
        With i_d, i_q (A), u_d, u_q (V) and omega_el (rad/s).
    window : int, optional
        Samples in a window; those that null the sixth harmonic without.
    degree : int
        Of the coenergy.

    Returns
    -------
    TrialBalance
    """
    polynomial, known, basis = _parts(experiment, degree)
    equations = _equations(experiment, known, basis, window or trial_window(experiment))
    found = equations.solve()
    weights = found[2:]
    currents = experiment.stack(("i_d", "i_q"))
    points = currents[:: max(len(currents) // _POINTS, 1)]
    slopes = polynomial.slopes(points) @ weights
    origin = np.zeros((1, 2))
    return TrialBalance(
        resistance=float(found[0]),
        deviation=equations.deviation(0),
        leftover=float(
            np.linalg.norm(equations.target - equations.matrix @ found)
            / np.linalg.norm(equations.target)
        ),
        definite=float(np.mean(np.linalg.eigvalsh(slopes)[:, 0] > 0.0)),
        magnet=(polynomial.basis(origin) @ weights)[0],
        # The coefficient of i_q in the coenergy, which comes first, is psi_q at no current.
        magnet_deviation=equations.deviation(2),
        inductance=np.diag((polynomial.slopes(origin) @ weights)[0]),
    )


def trial_window(experiment: Experiment) -> int:
    """Return the window in samples that nulls the sixth harmonic, or what a short recording has."""
    return min(harmonic_window(experiment), max(len(experiment) // _FEWEST, 1))


def lag_of_voltage(experiment: Experiment, in_phases: bool) -> tuple[float, float]:
    """Return by how many samples the voltage lags behind its place, and the deviation of that.

    What a voltage late by tau was is u + tau du/dt, with du/dt + omega J u for one of phases, which
    the rotor turned away from: linear in tau. As a little turn has other reasons too, such as dead
    time, that of phases is told from tau du/dt alone where the rotor turns slowly. Of windows of
    several lengths the one with the least deviation is taken.

    Parameters
    ----------
    experiment : Experiment
        As in `try_balance`.
    in_phases : bool
        Whether the voltages were recorded in phases.
    """
    _, known, basis = _parts(experiment, FINE_DEGREE)
    voltage = experiment.stack(("u_d", "u_q"))
    turned = np.stack([-voltage[:, 1], voltage[:, 0]], axis=1)
    turn = experiment.channels["omega_el"] * experiment.time_step
    earlier, nothing = -experiment.time_step * voltage, np.zeros_like(voltage)
    tried = [([(earlier, nothing)], 0.0)]
    if in_phases:
        doubt = _OTHER_TURN / max(float(np.median(np.abs(turn))), 1e-9)
        tried = [
            ([(earlier, turn[:, None] * turned)], doubt),
            ([(earlier, nothing), (nothing, turned)], 0.0),
        ]
    window = trial_window(experiment)
    longest = len(experiment) // _FEWEST
    found = []
    for length in (n * window for n in _TIMING_WINDOWS if n * window <= longest):
        for columns, doubt in tried:
            equations = _equations(experiment, known, basis, length, columns)
            deviation, lag = _first_coefficient(equations)
            found.append((float(np.hypot(deviation, doubt)), lag))
    deviation, lag = min(found)
    return lag, deviation


def _first_coefficient(equations: WeakRegression) -> tuple[float, float]:
    """Return the HAC deviation of the first coefficient, and its least-squares value.

    What `WeakRegression` tells by a singular value decomposition, here by one QR, ten times faster.
    """
    others = equations.matrix[:, 1:]
    basis = np.linalg.qr(others / np.maximum(np.linalg.norm(others, axis=0), 1e-300))[0]
    own, target = (
        part - basis @ (basis.T @ part) for part in (equations.matrix[:, 0], equations.target)
    )
    gain = own / max(float(own @ own), 1e-300)
    value = float(gain @ target)
    lags = max(2 * int((len(own) / 2) ** 0.6), _OVERLAPPING)
    share = gain * (target - value * own)
    return float(np.sqrt(bartlett(share[None], lags)[0, 0])), value


def _parts(experiment: Experiment, degree: int) -> tuple[PolynomialMap, FloatArray, FloatArray]:
    """Return the polynomial, i with the direction of i (time, 2, 2), and the map's columns."""
    currents = experiment.stack(("i_d", "i_q"))
    length = np.hypot(*currents.T)
    scale = float(length.max())
    direction = currents / np.hypot(length, _FADE * scale)[:, None]
    polynomial = PolynomialMap(True, scale, degree)
    return polynomial, np.stack([currents, direction], axis=2), polynomial.basis(currents)


def _equations(
    experiment: Experiment,
    dropped: FloatArray,
    basis: FloatArray,
    length: int,
    late: Sequence[tuple[FloatArray, FloatArray]] = (),
) -> WeakRegression:
    """Return d psi/dt = u - R i - dU h - omega J psi in windows of a length in samples.

    Columns are those of late, each stored and supplied, then R, dU and the map.
    """
    speed = experiment.channels["omega_el"][:, None, None]
    rotation = speed * np.stack([-basis[:, 1], basis[:, 0]], axis=1)
    stored = np.concatenate([np.zeros_like(dropped), basis], axis=2)
    supplied = np.concatenate([-dropped, -rotation], axis=2)
    if late:
        first = [np.stack(part, axis=2) for part in zip(*late, strict=True)]
        stored = np.concatenate([first[0], stored], axis=2)
        supplied = np.concatenate([first[1], supplied], axis=2)
    held = experiment.stack(("u_d", "u_q"))
    return weak_regression(stored, supplied, held, experiment.time_step, length)
