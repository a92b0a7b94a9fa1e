"""What the voltage balance leaves over as a function of the currents: its part of the budget.

A drive has laws that no candidate describes: another tail of the inverter's knee, iron that takes
current by another power. What they add to the voltage is taken as an unknown function of (i_d, i_q)
beside the model, a Gaussian process (Kennedy and O'Hagan 2001, doi:10.1111/1467-9868.00294). At one
speed any vector field is the sum of a rotation omega J psi(i), which a flux map follows, and of a
gradient, which R i is too: the process is of gradients. How large it is, the steps of the trained
model say, weighed over whole periods: what they leave that no map, no term and no imperfection of
the recordings explains is noise, alike everywhere, or such a function. The part of it that R
follows is hidden; by its size the interval has to grow. A step leaves over the noise of the very
currents that functions are of: these are taken at currents predicted from before, instruments
(Söderström and Stoica 1983, ISBN 978-0-387-12814-4).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from weakref import WeakKeyDictionary

import numpy as np

from penode.arrays import FloatArray, float64
from penode.data.experiment import Experiment
from penode.horizon.consensus import LEFT_OUT
from penode.horizon.uncertainty_budget import Imperfection
from penode.models.parameters import with_batch_axis
from penode.pmsm.balance.doubt import CLEAR
from penode.pmsm.balance.voltage_balance import BalanceForm, harmonic_window, joint_equations
from penode.pmsm.machine.coenergy_map import CoenergySplines, columns
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.space_vectors import CURRENTS, less_voltage, with_vector
from penode.pmsm.machine.terms import ANGLE
from penode.predictors.base import Predictor
from penode.training.covariance import bartlett_variance
from penode.training.weak_form import OVERLAP, HannWindow
from penode.validation.look_ahead import look_ahead, look_far_ahead

#: Length over which the process varies, in largest currents; its functions, which have nine tenths
#: of its variance, and the recorded currents that they are made from.
_LENGTH, _FUNCTIONS, _POINTS = 0.5, 20, 400
#: Samples whose functions are made at a time, which bounds memory.
_BLOCK = 20_000
#: Standard deviations of an imperfection by which its column is taken.
_SMALL = 1e-3
#: Singular values below this fraction of the largest are none, of columns of length 1.
_RANK = 1e-10
#: Share of its energy from which a function shows beside what explains most of it; of less, what
#: is off elsewhere would seem large.
_VISIBLE = 0.01
#: Variances of the process over that of the noise, where the equations show it best.
_RATIOS = 10.0 ** np.arange(-4.0, 8.1, 0.25)

#: What drives want whose angle is not known.
_RECORD_ANGLE = (
    "Record theta_el: it shows dead time phase by phase, harmonics of the angle, and whether "
    "pole_pairs is right; check that and the scales of both axes in the study file."
)


@dataclass(frozen=True, eq=False)
class LeftOver:
    """A Gaussian process of a voltage over the currents, by functions that are independent."""

    # V, the standard deviation along an axis at any current.
    size: float
    # Takes currents (time, 2), A; returns (time, axis, function), of variance 1 together.
    functions: Callable[[FloatArray], FloatArray]
    # A: i_d and i_q where most of it shows.
    place: FloatArray
    # What would narrow it.
    remedy: str = "Train with a recording at another speed as well."
    # What they are at recordings: every row asks at the same.
    _known: WeakKeyDictionary[Experiment, FloatArray] = field(default_factory=WeakKeyDictionary)

    @property
    def rows(self) -> tuple[Imperfection, ...]:
        """The rows of the uncertainty budget, one a function."""
        return tuple(
            Imperfection(LEFT_OUT, self._size, self.remedy, self._applied(k))
            for k in range(_FUNCTIONS)
        )

    @property
    def _size(self) -> str:
        i_d, i_q = self.place
        return f"{float(f'{1e3 * self.size:.2g}'):g} mV, most at i_d {i_d:.3g} A, i_q {i_q:.3g} A"

    def _applied(self, k: int) -> Callable[[Experiment, float], Experiment]:
        def applied(experiment: Experiment, count: float) -> Experiment:
            if experiment not in self._known:
                self._known[experiment] = self.functions(experiment.stack(CURRENTS))
            return less_voltage(experiment, count * self.size * self._known[experiment][:, :, k])

        return applied


def left_over(
    experiments: Sequence[Experiment],
    predictor: Predictor,
    known: Sequence[Imperfection],
    machine: Machine,
) -> tuple[Imperfection, ...]:
    """Return what a machine leaves over of corrected recordings; nothing if that is noise.

    `known` are the rows of what else the recordings may be off by: what these explain is theirs.
    """
    expected = [_expected(e, machine, predictor) for e in experiments]
    inductance = machine.maps()["differential_inductance"]
    weights = [inductance(*e.stack(CURRENTS).T) for e in expected]
    left, still = (_left(some, weights, machine, predictor) for some in (experiments, expected))
    explained = [_columns(expected, machine)]
    for one in known:
        moved = _left([one.applied(e, _SMALL) for e in expected], weights, machine, predictor)
        explained.append((moved - still)[:, None] / _SMALL)
    columns = np.concatenate(explained, axis=1)
    if not (np.isfinite(columns).all() and np.isfinite(left).all()):  # of a model that ran away
        return ()
    basis = _orthonormal(columns)
    currents = np.concatenate([e.stack(CURRENTS) for e in expected])
    functions = _functions(currents)
    at = [functions(e.stack(CURRENTS)) for e in expected]
    shown = np.concatenate([_shown(*pair) for pair in zip(experiments, at, strict=True)])
    left, whole = (part - basis @ (basis.T @ part) for part in (left, shown))
    repeats = _repeats(left)
    free = len(left) / repeats - basis.shape[1]
    if free < whole.shape[1]:  # too few equations to say
        return ()
    energy = float(np.mean(np.sum(shown**2, axis=0)))
    likely = _most_likely(left / np.sqrt(repeats), whole / np.sqrt(repeats), free, energy / repeats)
    if likely is None:
        return ()
    size, coefficients = likely
    voltage = np.linalg.norm(np.concatenate(at) @ coefficients, axis=1)
    angle = all(ANGLE.name in e.channels for e in experiments)
    found = LeftOver(size, functions, currents[int(np.argmax(voltage))])
    return (found if angle else replace(found, remedy=_RECORD_ANGLE)).rows


def _expected(experiment: Experiment, machine: Machine, predictor: Predictor) -> Experiment:
    """Return a recording with currents predicted from a window or two before: an instrument.

    Functions of recorded currents have the noise of an equation in them, which is what it leaves.
    """
    states, inputs = (experiment.stack(n).T for n in (machine.states, machine.inputs))
    length = harmonic_window(experiment)
    with float64():
        ahead = look_far_ahead(predictor, with_batch_axis(machine), states, inputs, length)
    d, q = np.concatenate([states[:, : predictor.past], ahead], axis=1)
    return with_vector(experiment, CURRENTS, lambda _: d + 1j * q)


def _columns(experiments: Sequence[Experiment], machine: Machine) -> FloatArray:
    """Return the columns of the terms' physical parameters and of every map, (equation, .)."""
    network = machine.flux.network
    form = BalanceForm.of(experiments, True, machine.terms)
    if not isinstance(network, CoenergySplines):
        return form.equations(experiments).matrix
    reach, scale = machine.flux.current_scale, machine.flux.flux_scale

    def basis(experiment: Experiment) -> FloatArray:
        places = experiment.stack(CURRENTS) / reach
        return np.concatenate([scale * columns(part, places) for part in network.mean], axis=2)

    return joint_equations(experiments, form.terms, basis, harmonic_window).matrix


def _left(
    experiments: Sequence[Experiment],
    weights: Sequence[FloatArray],
    machine: Machine,
    predictor: Predictor,
) -> FloatArray:
    """Return what a machine's steps leave over, weighed over whole periods, (equation,), Vs.

    `weights` are inductances (2, 2, time) of expected currents: those of recorded ones have the
    noise of the step that they would weigh.
    """
    batched, parts = with_batch_axis(machine), []
    for experiment, inductance in zip(experiments, weights, strict=True):
        states, inputs = (experiment.stack(n).T for n in (machine.states, machine.inputs))
        with float64():
            ahead = look_ahead(predictor, batched, states, inputs, 1)
        gap = states[:, predictor.past :] - ahead
        lost = np.einsum("ijt,jt->ti", inductance[..., predictor.past :], gap)
        held = np.pad(lost / experiment.time_step, ((predictor.past - 1, 1), (0, 0)))
        window = HannWindow(experiment.time_step, harmonic_window(experiment))
        parts.append(window.of_held(held).ravel())
    return np.concatenate(parts)


def _functions(currents: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return the leading functions over recorded currents (time, 2), A, and axes.

    Gradients of those of a squared-exponential kernel, by the Nystrom approximation.
    """
    reach = float(np.abs(currents).max())
    chosen = np.linspace(0, len(currents) - 1, min(_POINTS, len(currents))).round().astype(int)
    at = currents[chosen] / reach
    values, vectors = np.linalg.eigh(_kernel(at, at))
    weights = vectors[:, -_FUNCTIONS:] / np.sqrt(np.maximum(values[-_FUNCTIONS:], 1e-12))

    def gradients(places: FloatArray) -> FloatArray:
        blocks = np.array_split(places / reach, len(places) // _BLOCK + 1)
        return np.concatenate([block(part) for part in blocks])

    def block(scaled: FloatArray) -> FloatArray:
        near = _kernel(scaled, at)
        along = (
            near @ (at[:, [axis]] * weights) - scaled[:, [axis]] * (near @ weights)
            for axis in (0, 1)
        )
        return np.stack([*along], axis=1) / _LENGTH

    return gradients


def _kernel(one: FloatArray, other: FloatArray) -> FloatArray:
    apart = np.sum(one**2, 1)[:, None] + np.sum(other**2, 1) - 2 * one @ other.T
    return np.asarray(np.exp(-np.maximum(apart, 0.0) / (2 * _LENGTH**2)))


def _shown(experiment: Experiment, at: FloatArray) -> FloatArray:
    """Return what functions (time, 2, function) are in a recording's equations."""
    window = HannWindow(experiment.time_step, harmonic_window(experiment))
    return window.of_supply(at).reshape(-1, _FUNCTIONS)


def _repeats(left: FloatArray) -> float:
    """Return how many overlapping equations (equation,) are worth one for a slow function.

    Noise of the currents is stored as well as dropped, and windows beside each other have it with
    opposite signs: their sums vary less than by overlap alone.
    """
    series = left.reshape(-1, 2).T
    return max(float(bartlett_variance(series, 2 * OVERLAP).sum() / np.sum(series**2)), 1.0)


def _orthonormal(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis of what columns span."""
    size = np.linalg.norm(columns, axis=0)
    vectors, values, _ = np.linalg.svd(columns / np.where(size > 0, size, 1.0), full_matrices=False)
    return np.asarray(vectors[:, values > _RANK * values[0]])


def _most_likely(
    left: FloatArray, whole: FloatArray, free: float, energy: float
) -> tuple[float, FloatArray] | None:
    """Return the size of a process and its coefficients; None unless it clearly beats noise.

    The likelihood of what is left (equation,) is that of noise with the process's columns
    (equation, function) beside, of `energy` each before what else explains them was taken off;
    `free` equations are independent.
    """
    vectors, values, turn = np.linalg.svd(whole, full_matrices=False)
    seen = values**2 > _VISIBLE * energy
    if not seen.any():
        return None
    along, gains = vectors[:, seen].T @ left, values[seen] ** 2
    whole_left = float(left @ left)
    rest = max(whole_left - float(along @ along), 1e-14 * whole_left)

    def evidence(ratio: float) -> tuple[float, float]:
        variance = (rest + float(np.sum(along**2 / (1 + ratio * gains)))) / free
        return free * np.log(variance) + float(np.sum(np.log1p(ratio * gains))), variance

    ratio = min(_RATIOS / gains[0], key=lambda one: evidence(one)[0])
    best, variance = evidence(ratio)
    if best > evidence(0.0)[0] - CLEAR:
        return None
    posterior = ratio * np.sqrt(gains) * along / (1 + ratio * gains)
    return float(np.sqrt(ratio * variance)), turn[seen].T @ posterior
