"""Start of the map of splines: its coefficients by the weak form, its smoothness by likelihood."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TypeAlias

import numpy as np
from scipy.linalg import block_diag

from penode.arrays import FloatArray, float64
from penode.data.experiment import Experiment
from penode.models.parameters import with_batch_axis
from penode.pmsm.balance.definite import (
    Held,
    held_definite,
    held_in_training,
    hessians,
    is_definite,
    least_inductance,
)
from penode.pmsm.balance.smoothing import Roughness, Smoothed, smoothed, stiffened
from penode.pmsm.balance.voltage_balance import (
    balance_equations,
    harmonic_window,
    joint_equations,
    short_window,
    waves,
)
from penode.pmsm.machine.coenergy_map import (
    AMPLITUDE,
    MEAN,
    ODD,
    CoenergyPart,
    CoenergySplines,
    columns,
    roughness,
)
from penode.pmsm.machine.flux_maps import FluxMap
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.space_vectors import CURRENTS
from penode.pmsm.machine.standstill import stands_still
from penode.pmsm.machine.term_registry import physical_values, with_physical
from penode.pmsm.machine.terms import Term
from penode.predictors.base import Predictor
from penode.training.penalties import GaussianPrior, Penalty
from penode.training.weak_form import WeakRegression, join
from penode.validation.look_ahead import look_ahead

#: Derivatives that are held down. All of those of the odd part are: it vanishes where nothing shows
#: it, so that the likelihoods of a map with and without it compare.
_ORDERS = {True: (3,), False: (1, 2, 3)}
#: Gain of -2 log likelihood from which a map, or its harmonics, is not taken for mirror symmetric.
_ASYMMETRIC = 20.0
#: Share of skew in what harmonics explain from which it is there; rules of integration make 4 %.
_SKEW = 0.1
#: By which more than the recorded currents' range the inductance is held positive at standstill,
#: where the voltage is injected and free runs overshoot what a controller kept.
_BEYOND = 0.1
#: Points at which the differential inductance is taken for the weight of the prior in training.
_POINTS = 200
#: Samples over which predictions of the start are judged, and about how many predictions.
_AHEAD, _JUDGED = 20, 1000


@dataclass(frozen=True, eq=False)
class SplineStart:
    """A machine with a map of splines, as the weak form gives it, and penalties for training.

    The mean map has one part, even in i_q, or a second, odd one if the recordings show that
    W(i_d, -i_q) differs from W(i_d, i_q). The penalties are a Gaussian prior of the map's
    coefficients and a positive inductance.
    """

    machine: Machine
    penalties: tuple[Penalty, ...]


_Parts: TypeAlias = tuple[CoenergyPart, ...]


def spline_start(
    experiments: Sequence[Experiment],
    terms: Sequence[Term],
    scales: tuple[float, float],
    angle_orders: tuple[int, ...] = (),
) -> SplineStart:
    """Find the physical parameters and the map of splines by penalised linear least squares.

    Windows over whole periods of the sixth harmonic show the mean map and the physical
    parameters alone; what those leave in short windows is the harmonics'. Terms are completed
    and prepared; `scales` are the largest current, A, which the splines reach to, and flux
    linkage, Vs.
    """
    setting = _Setting(tuple(experiments), tuple(terms), scales)
    every = CoenergyPart.zero(MEAN, True), CoenergyPart.zero(ODD, False)
    whole = setting.equations(every)
    even, both = (setting.mean(whole, every[:n]) for n in (1, 2))
    symmetric = both.smoothed.evidence > even.smoothed.evidence - _ASYMMETRIC
    parts, mean_map = (every[:1], even) if symmetric else (every, both)
    mean_map, held = setting.definite(mean_map, parts)
    constrained = replace(mean_map.smoothed, solution=held.solution)
    count = len(physical_values(terms))
    mean, first = [], count
    for part in parts:
        size = part.coefficients.size
        mean.append(_filled(part, constrained.solution[first : first + size]))
        first += size
    network = CoenergySplines(tuple(mean))
    blocks = _blocks(mean_map.penalties, constrained)
    observed = (held.rows[:, count:], held.target, constrained.noise)
    if angle_orders:
        network, amplitudes = _with_harmonics(setting, network, constrained, angle_orders)
        blocks += amplitudes
    machine = Machine(
        FluxMap(network, *scales, angle_orders), with_physical(terms, constrained.solution[:count])
    )
    misfit = float(np.mean([_misfit(machine, e) for e in experiments]))
    prior = _prior(setting, machine, blocks, observed, misfit)
    return SplineStart(machine, (prior, *held_in_training(held, misfit)))


@dataclass(frozen=True, eq=False)
class _Setting:
    """Recordings, terms and scales that all regressions share."""

    experiments: tuple[Experiment, ...]
    terms: tuple[Term, ...]
    scales: tuple[float, float]

    @property
    def samples(self) -> tuple[FloatArray, FloatArray]:
        """Return some samples' dimensionless currents (sample, 2) and angle (sample,)."""
        theta = np.concatenate([e.channels["theta_el"] for e in self.experiments])
        chosen = slice(None, None, max(len(theta) // _JUDGED, 1))
        return self.currents[chosen] / self.scales[0], theta[chosen]

    @cached_property
    def currents(self) -> FloatArray:
        """Recorded currents, shape (time, 2), A."""
        return np.concatenate([e.stack(CURRENTS) for e in self.experiments])

    def basis(self, experiment: Experiment, parts: Sequence[CoenergyPart]) -> FloatArray:
        """Return the flux linkage of each coefficient in Vs, shape (time, 2, coefficient)."""
        x = experiment.stack(CURRENTS) / self.scales[0]
        return self.scales[1] * np.concatenate([columns(p, x) for p in parts], axis=2)

    def equations(self, parts: Sequence[CoenergyPart]) -> WeakRegression:
        """Return the balance with mean maps of the parts."""
        basis = partial(self.basis, parts=parts)
        return joint_equations(self.experiments, self.terms, basis, harmonic_window)

    def mean(self, whole: WeakRegression, parts: Sequence[CoenergyPart]) -> "_Mean":
        """Return physical parameters and mean map of the parts that come first in equations."""
        first, penalties = len(physical_values(self.terms)), []
        for part in parts:
            penalties.append(Roughness.of(first, roughness(part, _ORDERS[part.even])))
            first += part.coefficients.size
        equations = WeakRegression(whole.matrix[:, :first], whole.target)
        return _Mean(equations, tuple(penalties), smoothed(equations, penalties))

    def definite(self, mean: "_Mean", parts: Sequence[CoenergyPart]) -> tuple["_Mean", Held]:
        """Return the mean map with a positive definite inductance around the recordings.

        It is held by observations, or, where the balance is then explained better, by smoothness:
        a map recorded along a curve alone is as rough beside it as its strength allows.
        """
        currents = self.currents / self.scales[0]
        beyond = _BEYOND * stands_still(self.experiments)
        system = mean.equations, mean.penalties
        held = held_definite(*system, mean.smoothed, parts, currents, beyond)
        if not len(held.rows):
            return mean, held
        first = len(physical_values(self.terms))
        stiff = stiffened(
            *system,
            mean.smoothed,
            lambda found: is_definite(parts, currents, beyond, found[first:]),
        )
        if stiff is None or mean.misfit(held.solution) <= mean.misfit(stiff.solution):
            return mean, held
        return replace(mean, smoothed=stiff), held_definite(*system, stiff, parts, currents, beyond)


@dataclass(frozen=True, eq=False)
class _Mean:
    """Physical parameters and mean map, with what they solve."""

    equations: WeakRegression
    penalties: tuple[Roughness, ...]
    smoothed: Smoothed

    def misfit(self, solution: FloatArray) -> float:
        """Return the sum of squares that a solution leaves in the balance."""
        return float(np.sum((self.equations.target - self.equations.matrix @ solution) ** 2))


def _filled(part: CoenergyPart, coefficients: FloatArray) -> CoenergyPart:
    return replace(part, coefficients=coefficients.reshape(part.coefficients.shape))


@dataclass(frozen=True, eq=False)
class _Block:
    """Prior of some consecutive coefficients: roughness, its strength and its variance."""

    matrix: FloatArray
    strength: float
    variance: float


def _blocks(penalties: Sequence[Roughness], smoothed: Smoothed) -> list[_Block]:
    entries = zip(penalties, smoothed.strength, smoothed.prior_variance, strict=True)
    return [_Block(p.matrix, float(strength), float(v)) for p, strength, v in entries]


def _with_harmonics(
    setting: _Setting, network: CoenergySplines, mean_solution: Smoothed, orders: tuple[int, ...]
) -> tuple[CoenergySplines, list[_Block]]:
    """Return the map with amplitudes fitted to the residual of the mean in short windows.

    Those of a machine without skew, or of one with it where that clearly explains a part.
    """
    count, physical = len(orders), len(physical_values(setting.terms))
    even, odd = (CoenergyPart.zero(AMPLITUDE, one, count) for one in (True, False))
    sides: list[_Parts] = [
        (even, odd),
        (odd, even),
    ]  # cosines and sines; the second of each are those of skew

    def modulated(theta: FloatArray, of: Callable[[_Parts], FloatArray]) -> FloatArray:
        turning = waves(theta, orders)  # cos and sin of each order by turns
        return np.concatenate(
            [
                turning[:, first + 2 * k, None, None] * table
                for first, side in enumerate(sides)
                for table in (of((part,)) for part in side)
                for k in range(count)
            ],
            axis=2,
        )

    regressions = []
    for e in setting.experiments:
        length = short_window(e, max(orders))
        mean = balance_equations(e, setting.terms, setting.basis(e, network.mean), length)
        left = mean.target - mean.matrix @ mean_solution.solution
        basis = modulated(e.channels["theta_el"], partial(setting.basis, e))
        every = balance_equations(e, setting.terms, basis, length)
        regressions.append(WeakRegression(every.matrix[:, physical:], left))
    whole = join(regressions)
    tables = np.split(whole.matrix, _ends(sides), axis=1)
    x, theta = setting.samples
    of_mean = hessians(network.mean, x)
    constant = np.concatenate([part.coefficients.ravel() for part in network.mean])
    bends = np.split(modulated(theta, partial(hessians, points=x)), _ends(sides), axis=2)

    def fitted(skew: bool) -> tuple[Smoothed, FloatArray, list[Roughness], list[_Parts]]:
        parts = sides if skew else [side[:1] for side in sides]
        matrix = block_diag(*[roughness(p) for side in parts for p in side for _ in orders])
        penalties = [Roughness.of(0, matrix)]
        chosen, bent = (
            np.concatenate(some if skew else some[::2], axis=-1) for some in (tables, bends)
        )
        equations = WeakRegression(chosen, whole.target)
        solved = smoothed(equations, penalties)
        inductances = np.concatenate([of_mean, bent], axis=2)

        def possible(amplitudes: FloatArray) -> bool:
            return least_inductance(inductances, np.concatenate([constant, amplitudes])) > 0

        if not possible(solved.solution):
            solved = stiffened(equations, penalties, solved, possible) or solved
        return solved, chosen @ solved.solution, penalties, parts

    plain, skewed = fitted(False), fitted(True)
    clear = skewed[0].evidence < plain[0].evidence - _ASYMMETRIC
    share = np.linalg.norm(skewed[1] - plain[1]) / np.linalg.norm(skewed[1])
    solved, _, penalties, parts = skewed if clear and share > _SKEW else plain
    amplitudes = iter(np.split(solved.solution, _ends(parts)))
    cosine, sine = (tuple(_filled(part, next(amplitudes)) for part in side) for side in parts)
    return replace(network, cosine=cosine, sine=sine), _blocks(penalties, solved)


def _ends(sides: list[_Parts]) -> list[int]:
    """Return where the coefficients of each part but the last end."""
    sizes = [part.coefficients.size for side in sides for part in side]
    return np.cumsum(sizes)[:-1].tolist()


def _prior(
    setting: _Setting,
    machine: Machine,
    blocks: Sequence[_Block],
    observed: tuple[FloatArray, FloatArray, float],
    misfit: float,
) -> GaussianPrior:
    """Return the prior in units of the training loss.

    A constant voltage error v of a sample moves a one-step residual by T v / L, and an equation of
    the weak form by half a window's length times v: their squares over all samples and equations
    say how much a penalty of the one weighs in the other. Where predictions err by more than
    that, by noise or by what is not modelled, the prior is weighed against their error.
    """
    currents = setting.currents
    points = currents[np.linspace(0, len(currents) - 1, _POINTS).round().astype(int)]
    inductance = machine.maps()["differential_inductance"](*points.T)
    inverse = np.linalg.inv(np.moveaxis(inductance, -1, 0))
    gain = float(np.median(np.sum(inverse**2, axis=(1, 2)))) / 2
    samples, equations = 0.0, 0.0
    for e in setting.experiments:
        length = harmonic_window(e)
        samples += len(e) * e.time_step**2 * gain
        equations += len(e) / max(length // 4, 1) * (length * e.time_step / 2) ** 2
    weight = samples / equations / (2 * len(currents))
    *_, noise = observed
    weight = max(weight, misfit / (2 * len(currents)) / noise)
    rows, variances = [], []
    for block in blocks:
        eigenvalues, vectors = np.linalg.eigh(block.matrix)
        kept = eigenvalues > 1e-12 * eigenvalues[-1]
        scaled = np.sqrt(weight * block.strength * eigenvalues[kept])
        rows.append((vectors[:, kept] * scaled).T)
        variances.append(np.full(kept.sum(), weight * block.strength * block.variance))
    factor = np.asarray(block_diag(*rows))
    observed_rows, values, _ = observed
    scale = np.sqrt(weight * noise)
    further = np.pad(scale * observed_rows, ((0, 0), (0, factor.shape[1] - observed_rows.shape[1])))
    variances.append(np.full(len(values), scale**2))
    mean = np.concatenate([np.zeros(len(factor)), scale * values])
    return GaussianPrior(np.concatenate([factor, further]), np.concatenate(variances), mean)


def _misfit(machine: Machine, experiment: Experiment) -> float:
    """Return half the median squared error in A^2 of predictions some samples ahead."""
    predictor = Predictor(experiment.time_step)
    with float64():
        states, inputs = (experiment.stack(names).T for names in (machine.states, machine.inputs))
        stride = max(len(experiment) // _JUDGED, 1)
        ahead = look_ahead(predictor, with_batch_axis(machine), states, inputs, _AHEAD, stride)
        gap = ahead - states[:, predictor.past :: stride]
    return float(np.median(np.sum(gap**2, axis=0)) / 2)


def reach(experiments: Sequence[Experiment]) -> float:
    """Return the largest current along an axis, rounded up so that recordings share programs."""
    largest = max(float(np.abs(e.stack(CURRENTS)).max()) for e in experiments)
    return float(f"{10 ** (math.ceil(20 * math.log10(largest) - 1e-9) / 20):.3g}")
