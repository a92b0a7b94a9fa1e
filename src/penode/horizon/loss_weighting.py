"""Loss weighting: how the loss at a horizon weighs frequencies, and the lines of the residual.

The k-step error is a filtered one-step error, eps_(t+k|t) = sum_j Phi(t+k, t+j+1) e_(t+j) (paper,
section 3). With Phi frozen to powers of one matrix A it is F_k e with
F_k = sum_(j<k) A^j q^-j = (1 - (A q^-1)^k) (1 - A q^-1)^-1, and the loss at horizon H weighs the
spectrum E of the one-step residual by W_H = (1/H) sum_(k<=H) F_k* F_k: it adds up E* W_H E.
Where a window estimates its start, it takes B* M^-1 B / H off, with B = sum_k A^k' q^k F_k / q and
M = sum_k A^k' A^k plus what a correction costs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import BoolArray, ComplexArray, FloatArray, JaxArray, float64
from penode.data.experiment import Experiment
from penode.models.base import Model
from penode.models.explicit_time import driving_channels
from penode.models.parameters import with_batch_axis
from penode.predictors.base import Predictor
from penode.validation.comparison import Comparison
from penode.validation.residual_lines import Line, find_lines, power_spectrum

#: Matrices kept of a recording; speed and saturation move slowly against a sample.
_KEPT = 64
#: Weights above this, and matrices whose condition is above it, are rounding alone; where a model
#: is stable a weight is about H squared at the most.
_BOUND = 1.0 / float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class LossWeighting:
    """The one-step residual's spectrum, and how the loss at each horizon weighs it.

    Attributes
    ----------
    signals : tuple of str
        What the columns are: two states of one unit as one complex signal, or each state.
    unit : str
        SI unit of the residual; empty where the states' units differ.
    frequency : ndarray, shape (frequency,)
        Hz, ascending; from minus to plus half the sampling rate for a complex signal.
    power : ndarray, shape (frequency, signal)
        Mean squared residual of each frequency, squares of the states' units; their sum is all.
        NaN, and without lines, where the residual is not finite.
    horizons : tuple of int
        Steps.
    weight : ndarray, shape (horizon, frequency, signal)
        W_H; 1 at H = 1 with starts as measured. For a complex signal that of a vector rotating
        with the frequency's sign; where A is no rotation, what f and -f have in common is left out.
        NaN at a horizon over which errors grow without bound.
    lines : tuple of Line
        Strongest first.
    """

    signals: tuple[str, ...]
    unit: str
    frequency: FloatArray
    power: FloatArray
    horizons: tuple[int, ...]
    weight: FloatArray
    lines: tuple[Line, ...]

    @property
    def weighted(self) -> FloatArray:
        """What the loss adds up at each horizon, shape (horizon, frequency, signal)."""
        with np.errstate(over="ignore"):
            return self.weight * self.power

    @property
    def available(self) -> BoolArray:
        """Whether the weight at each horizon is known, shape (horizon,)."""
        return np.asarray(np.isfinite(self.weighted).all(axis=(1, 2)))

    def at(self, chosen: BoolArray) -> "LossWeighting":
        """Return the same of some of the horizons."""
        if chosen.all():
            return self
        horizons = tuple(h for h, kept in zip(self.horizons, chosen, strict=True) if kept)
        return replace(self, horizons=horizons, weight=self.weight[chosen])

    def fractions(self, line: Line) -> FloatArray:
        """Return the fraction of a line in its signal's loss at each horizon, shape (horizon,).

        NaN where it is not available.
        """
        within = (self.frequency >= line.low) & (self.frequency <= line.high)
        loss = self.weighted[:, :, line.signal]
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(loss[:, within].sum(axis=1) / loss.sum(axis=1))


def linearised(
    predictor: Predictor, model: Model, experiment: Experiment, scale: FloatArray
) -> FloatArray:
    """Linearise the predictor along a recording.

    Parameters
    ----------
    predictor : Predictor
    model : Model
        Trained, without batch axis.
    experiment : Experiment
        Has the model's states and inputs as channels.
    scale : ndarray, shape (state,)
        What the loss divides residuals by.

    Returns
    -------
    ndarray, shape (sample, past * state, past * state)
        One-step matrices of scaled errors at up to 64 samples, evenly spread; companion matrices,
        newest sample first, where the predictor starts from several.
    """
    past, last = predictor.past, len(experiment) - 2
    at = np.unique(np.linspace(past - 1, max(last, past - 1), _KEPT).round().astype(int))
    sizes = np.tile(scale, past)
    # Only what a step from these samples reads: one program for recordings of any length.
    read = (at[:, None] + np.arange(1 - past, 2)).ravel()
    at = np.arange(len(at)) * (past + 1) + past - 1
    driving = driving_channels(model)
    with float64():
        states, inputs = experiment.stack(model.states), experiment.stack(driving)
        states, inputs = states[read].T, predictor.prepared(inputs)[read].T
        columns = np.asarray(_pushed(predictor, with_batch_axis(model), states, inputs, at))
    return np.asarray(columns.transpose(2, 1, 0) / sizes[:, None] * sizes)


# It runs once a fit, on 64 samples: optimising it takes longer than it ever saves.
@partial(jax.jit, static_argnums=0, compiler_options={"xla_backend_optimization_level": 0})
def _pushed(
    predictor: Predictor, model: Model, states: JaxArray, inputs: JaxArray, at: JaxArray
) -> JaxArray:
    """Return what each of past * state seeds becomes in a step, (seed, past * state, sample)."""
    corrected = model.corrected(states)
    history = jnp.stack([corrected[:, at - j] for j in range(predictor.past)])
    flat = history.reshape(-1, len(at))

    def step(flat: JaxArray) -> JaxArray:
        ahead = predictor.step(
            model, flat.reshape(history.shape), lambda k: inputs[:, at + jnp.maximum(k, 0)]
        )
        return ahead.reshape(flat.shape)

    seeds = jnp.broadcast_to(jnp.eye(len(flat))[:, :, None], (len(flat), *flat.shape))
    pushed: JaxArray = jax.vmap(lambda seed: jax.jvp(step, (flat,), (seed,))[1])(seeds)
    return pushed


@np.errstate(over="ignore", invalid="ignore")
def weight_matrix(
    transitions: FloatArray,
    states: int,
    horizon: int,
    samples: int,
    starts: FloatArray | None = None,
) -> ComplexArray:
    """Return W_H = (1/H) sum_(k<=H) F_k* F_k, the mean over frozen one-step matrices.

    Exact for a linear model: the squared k-step errors over all starts and k = 1..H, of a
    residual that is at rest in its last H samples, are H sum_f E* W_H E / samples.

    Parameters
    ----------
    transitions : ndarray, shape (sample, past * state, past * state)
        As `linearised` gives them.
    states : int
        Rows of a residual.
    horizon : int
        H in steps.
    samples : int
        Length of the residual; sets the frequencies.
    starts : ndarray, shape (state,), optional
        What corrections of starts cost (`Fit.starts`); without it starts are as measured.

    Returns
    -------
    ndarray of complex, shape (samples, state, state)
        Hermitian, at the frequencies of ``numpy.fft.fftfreq(samples)``; NaN where errors grow
        without bound.
    """
    power = np.broadcast_to(np.eye(transitions.shape[-1]), transitions.shape)
    impulse = np.empty((horizon, len(transitions), states, states))
    for j in range(horizon):
        impulse[j] = power[:, :states, :states]
        power = power @ transitions
    cost = np.full(states, np.inf) if starts is None or not len(starts) else starts
    free = np.isfinite(cost)
    later = np.arange(horizon, 0, -1.0)[:, None, None, None] * impulse
    products = _correlated(impulse, later)
    if free.any():
        response, normal = _of_starts(impulse, power, cost[free], free)
        if not _invertible(normal):
            return np.full((samples, states, states), np.nan, complex)
        products -= _correlated(np.linalg.inv(normal) @ response, response).swapaxes(1, 2)
    lags = np.zeros((samples, states, states))
    # W_H is a trigonometric polynomial of degree H - 1; few samples fold it.
    np.add.at(lags, np.arange(horizon) % samples, products)
    np.add.at(lags, -np.arange(1, horizon) % samples, products[1:].swapaxes(1, 2))
    weight = np.asarray(np.fft.fft(lags / (horizon * len(transitions)), axis=0))
    return weight if np.abs(weight).max() < _BOUND else np.full_like(weight, np.nan)


def _correlated(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return sum_i first_i' second_(i+m) over all samples, (step m, column, column)."""
    length = 2 * len(first)
    forward, ahead = (np.fft.rfft(part, length, axis=0) for part in (first, second))
    products = np.einsum("fsba,fsbc->fac", forward.conj(), ahead, optimize=True)
    return np.asarray(np.fft.irfft(products, length, axis=0)[: len(first)])


def _of_starts(
    impulse: FloatArray, last: FloatArray, cost: FloatArray, free: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return C_m of B = sum_m C_m q^m, (step, sample, free, state), and M, (sample, free, free).

    C_m = (A')^(m+1) sum_(n < H - m) A^n' A^n, rows of the states whose starts are free. `impulse`
    is A^0 to A^(H-1), (step, sample, state, state), and `last` A^H.
    """
    horizon = len(impulse)
    squares = np.cumsum(np.einsum("isba,isbc->isac", impulse, impulse), axis=0)
    ahead = np.concatenate([impulse[1:], last[None, :, : len(free), : len(free)]])
    response = np.einsum("isba,isbc->isac", ahead, squares[horizon - 1 - np.arange(horizon)])
    whole = np.einsum("isba,isbc->sac", ahead, ahead)
    return response[:, :, free], whole[:, free][:, :, free] + np.diag(cost)


def _invertible(matrices: FloatArray) -> bool:
    """Return whether rounding leaves the inverses of positive definite matrices anything."""
    if not np.isfinite(matrices).all():
        return False
    ends = np.linalg.eigvalsh(matrices)[:, [0, -1]]
    return bool((ends[:, 0] * _BOUND > ends[:, 1]).all())


def loss_weighting(
    comparison: Comparison,
    transitions: FloatArray,
    horizons: Sequence[int],
    base: float | None = None,
    starts: FloatArray | None = None,
) -> LossWeighting:
    """Return a recording's residual spectrum, its lines, and its weight at each horizon.

    Parameters
    ----------
    comparison : Comparison
        Of a model whose every state is measured.
    transitions : ndarray, shape (sample, past * state, past * state)
        Of the same model on the same recording, as `linearised` gives them.
    horizons : sequence of int
        Steps.
    base : float, optional
        Frequency in Hz whose multiples are the lines' orders; its sign is kept.
    starts : ndarray, shape (state,), optional
        As of `weight_matrix`.
    """
    residual = comparison.one_step_residual
    samples, states = residual.shape
    paired = states == 2 and len(set(comparison.units)) == 1
    signal = residual @ np.array([[1.0], [1.0j]]) if paired else residual
    with np.errstate(over="ignore", invalid="ignore"):
        power = power_spectrum(signal)
    known = bool(np.isfinite(power).all())
    frequency = np.fft.fftfreq(samples, comparison.time_step).astype(np.float64)
    weight = np.stack(
        [_seen(weight_matrix(transitions, states, h, samples, starts), paired) for h in horizons]
    )
    order = np.argsort(frequency) if paired else np.arange(samples // 2 + 1)
    if not paired:  # both signs say the same
        power[1 : (samples + 1) // 2] *= 2.0
        frequency = np.abs(frequency)
    power, frequency = power[order], frequency[order]
    names = comparison.states
    return LossWeighting(
        signals=(f"{names[0]} + j {names[1]}",) if paired else names,
        unit=comparison.units[0] if len(set(comparison.units)) == 1 else "",
        frequency=frequency,
        power=power if known else np.full_like(power, np.nan),
        horizons=tuple(horizons),
        weight=weight[:, order],
        lines=find_lines(frequency, power, base) if known else (),
    )


def _seen(weight: ComplexArray, paired: bool) -> FloatArray:
    """Return the weight (frequency, signal) of a vector rotating with f, or of each state."""
    each = np.diagonal(weight, axis1=1, axis2=2).real
    if paired:
        each = each.mean(axis=1, keepdims=True) + weight[:, :1, 1].imag
    return np.asarray(each)
