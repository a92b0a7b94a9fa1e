"""The voltage balance on trial: how well a recording obeys it as it stands, in well under a second.

A low polynomial coenergy, R and the mean of a dead time by the current's direction are found in
weak form. The rotor's angle is not used, so that a wrong one cannot spoil the judgement.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, Leaf
from penode.data.experiment import Experiment
from penode.models.inputs import Inputs
from penode.models.parameters import parameter, physical
from penode.pmsm.balance.voltage_balance import BalanceForm, PolynomialMap, Window, harmonic_window
from penode.pmsm.machine.flux_maps import Flux
from penode.pmsm.machine.frames import quarter_turned
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES
from penode.pmsm.machine.term_registry import completed
from penode.pmsm.machine.terms import Term
from penode.training.covariance import bartlett_variance
from penode.training.weak_form import HannWindow, WeakRegression

#: Degree of the coenergy: enough for factors and the magnet, and for timing and R.
_DEGREE, FINE_DEGREE = 4, 8
#: Fraction of the largest current below which the mean dead-time voltage fades.
_FADE = 0.02
#: Points at which the differential inductance is looked at.
_POINTS = 200
#: Windows for the timing, in windows that null the sixth harmonic; the larger null orders 1 and 2.
_TIMING_WINDOWS = (1, 3, 6, 12)
#: Fewest windows in a recording: what fewer leave over is little in any case.
_FEWEST = 16
#: Turn of the voltage in rad that need not be a delay: dead time, resolver, hold.
_OTHER_TURN = 0.01
#: Order of the differences that show noise.
_ORDER = 6
#: Equations that share samples with one: two axes, windows overlapping by three quarters.
_OVERLAPPING = 16


@dataclass(frozen=True, eq=False)
class Trial:
    """What a balance makes of a recording."""

    # What it leaves of the voltages (root mean square), as a fraction of them.
    residual: float
    # Fraction of the visited currents at which d psi / d i is positive definite, as it must be.
    definite: float
    # Flux linkage at no current (2,), Vs.
    magnet: FloatArray

    @property
    def misfit(self) -> float:
        """The residual, doubled where no d psi / d i is positive definite: smaller is better."""
        return self.residual * (2.0 - self.definite)


@dataclass(frozen=True, eq=False)
class TrialBalance(Trial):
    """The same with R and inductance; deviations are HAC."""

    # R, ohm.
    resistance: float
    deviation: float
    # Of the q part of the flux linkage.
    magnet_deviation: float
    # L_dd and L_qq at no current (2,), H.
    inductance: FloatArray


def try_balance(
    experiment: Experiment, window: int | None = None, degree: int = _DEGREE
) -> TrialBalance:
    """Solve the balance of one recording; windows null the sixth harmonic unless given, samples."""
    form = trial_form([experiment], degree)
    equations = form.equations([experiment], window or trial_window)
    solution, polynomial = equations.solve(), form.polynomial
    weights, currents = solution[2:], experiment.stack(CURRENTS)
    slopes = polynomial.slopes(currents[:: max(len(currents) // _POINTS, 1)]) @ weights
    origin = np.zeros((1, 2))
    return TrialBalance(
        resistance=float(solution[0]),
        deviation=equations.deviation(0),
        residual=_share_left(equations, solution),
        definite=float(np.mean(np.linalg.eigvalsh(slopes)[:, 0] > 0.0)),
        magnet=(polynomial.basis(origin) @ weights)[0],
        # The coefficient of i_q in the coenergy, which comes first, is psi_q at no current.
        magnet_deviation=equations.deviation(2),
        inductance=np.diag((polynomial.slopes(origin) @ weights)[0]),
    )


def residual_of(experiments: Sequence[Experiment]) -> float:
    """Return what one balance of several recordings leaves over, as a share of the voltages."""
    equations = trial_form(experiments).equations(experiments, trial_window)
    return _share_left(equations, equations.solve())


def _share_left(equations: WeakRegression, solution: FloatArray) -> float:
    left = equations.target - equations.matrix @ solution
    return float(np.linalg.norm(left) / np.linalg.norm(equations.target))


def trial_form(experiments: Sequence[Experiment], degree: int = _DEGREE) -> BalanceForm:
    """Return a balance with R, rotation, and a dead time by the direction of the current."""
    reach = max(float(np.hypot(*e.stack(CURRENTS).T).max()) for e in experiments)
    terms = completed([DirectedDeadTime(fade=_FADE * reach)])
    return BalanceForm(PolynomialMap(True, reach, degree), terms)


def trial_window(experiment: Experiment) -> int:
    """Return the window in samples that nulls the sixth harmonic, or what a short recording has."""
    return min(harmonic_window(experiment), max(len(experiment) // _FEWEST, 1))


def lag_of_voltage(experiment: Experiment, in_phases: bool) -> tuple[float, float]:
    """Return by how many samples the voltage lags behind its place, and the deviation of that.

    What a voltage late by tau was is u + tau du/dt, with du/dt + omega J u for one of phases,
    which the rotor turned away from: linear in tau. As a little turn has other reasons too,
    such as dead time, that of phases is taken from tau du/dt alone where the rotor turns
    slowly. Of windows of several lengths the one with the least deviation is taken.
    """
    voltage, form = experiment.stack(VOLTAGES), trial_form([experiment], FINE_DEGREE)
    turned = quarter_turned(voltage.T).T
    turn = experiment.channels["omega_el"] * experiment.time_step
    earlier, nothing = -experiment.time_step * voltage, np.zeros_like(voltage)
    tried = [([(earlier, nothing)], 0.0)]
    if in_phases:
        ambiguity = _OTHER_TURN / max(float(np.median(np.abs(turn))), 1e-9)
        tried = [
            ([(earlier, turn[:, None] * turned)], ambiguity),
            ([(earlier, nothing), (nothing, turned)], 0.0),
        ]
    window = trial_window(experiment)
    longest = len(experiment) // _FEWEST
    estimates = []
    for length in (n * window for n in _TIMING_WINDOWS if n * window <= longest):
        for columns, ambiguity in tried:
            equations = form.equations([experiment], length, [columns])
            deviation, lag, size = _first_coefficient(equations)
            noise = _noise_products(experiment, length) / size**2
            estimates.append((float(np.linalg.norm([deviation, ambiguity, noise])), lag))
    deviation, lag = min(estimates)
    return lag, deviation


def mean_lag(experiments: Sequence[Experiment], in_phases: bool) -> tuple[float, float]:
    """Return the mean `lag_of_voltage` of recordings, and its deviation with that between them."""
    lags, deviations = np.array([lag_of_voltage(e, in_phases) for e in experiments]).T
    weights = 1.0 / np.maximum(deviations, 1e-9) ** 2
    mean, own = float(np.average(lags, weights=weights)), float(np.sum(weights) ** -0.5)
    apart = np.sum(weights * (lags - mean) ** 2) / max(len(lags) - 1, 1)
    return mean, own * float(np.sqrt(max(apart, 1.0)))


def imitated_lag(experiments: Sequence[Experiment], window: Window) -> float:
    """Return the lag in samples that a controller's answer to noise can imitate, at most.

    Noise n of a measured current is L dn/dt in the balance. The voltage that answers it stands
    in the regressor of the lag, du/dt, with the size that the voltage's own noise shows; if the
    two are in phase, their product over the square of the regressor is taken for a lag.
    """
    products, squares = 0.0, 0.0
    for experiment in experiments:
        voltage, form = experiment.stack(VOLTAGES), trial_form([experiment], FINE_DEGREE)
        columns = [(-experiment.time_step * voltage, np.zeros_like(voltage))]
        equations = form.equations([experiment], window, [columns])
        size = _first_coefficient(equations)[2]
        count = len(equations.target)
        products += count * _noise_products(experiment, window(experiment))
        squares += count * size**2
    return products / max(squares, 1e-300)


def _noise_products(experiment: Experiment, length: int) -> float:
    """Return the product of what noise leaves in an equation and in the lag's regressor, in V^2."""
    inductance = float(np.abs(try_balance(experiment).inductance).max())
    slope = np.linalg.norm(HannWindow(experiment.time_step, length).slope)
    current, voltage = (noise_of(experiment.stack(names)) for names in (CURRENTS, VOLTAGES))
    return float(inductance * current * slope * experiment.time_step * voltage * slope)


def noise_of(values: FloatArray) -> float:
    """Return the deviation of white noise from sixth differences, which harmonics hardly have."""
    differences = np.diff(values, _ORDER, axis=0)
    return float(np.median(np.abs(differences)) / 0.6745 / math.sqrt(math.comb(2 * _ORDER, _ORDER)))


def _first_coefficient(equations: WeakRegression) -> tuple[float, float, float]:
    """Return the HAC deviation of the first coefficient, its value, and its column's rms.

    Of the column what the others do not explain. What `WeakRegression` computes by a singular value
    decomposition, here by one QR, ten times faster.
    """
    others = equations.matrix[:, 1:]
    basis = np.linalg.qr(others / np.maximum(np.linalg.norm(others, axis=0), 1e-300))[0]
    own, target = (
        part - basis @ (basis.T @ part) for part in (equations.matrix[:, 0], equations.target)
    )
    square = max(float(own @ own), 1e-300)
    gain = own / square
    value = float(gain @ target)
    lags = max(2 * int((len(own) / 2) ** 0.6), _OVERLAPPING)
    influence = gain * (target - value * own)
    deviation = float(np.sqrt(bartlett_variance(influence[None], lags)[0]))
    return deviation, value, float(np.sqrt(square / len(own)))


class DirectedDeadTime(Term):
    """dU i / |i|: the mean of dead time over the rotor's angle, faded out below a current."""

    role: ClassVar[str] = "dead time"
    title: ClassVar[str] = "Mean dead time"

    directed_voltage: Leaf = physical("V", default=0.0)
    # Length of the current at which 71 % of it are lost.
    fade: Leaf = parameter(unit="A", group="held", default=1.0)

    def drop(self, x: JaxArray, u: Inputs, flux: Flux) -> JaxArray:
        """Return dU i / |i| in V; see `Term.drop`."""
        length = jnp.hypot(x[0], x[1])
        return self.directed_voltage * x / jnp.hypot(length, self.fade)
