"""Loss: what is squared and summed over windows, put together from small objects."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import TypeAlias

import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray
from penode.errors import InputError
from penode.models.base import Model
from penode.training.noise import StudentT
from penode.training.penalties import Penalty

#: Quantity (quantity, batch) of a model at states x (state, batch) in which errors are measured.
Domain: TypeAlias = Callable[[Model, JaxArray], JaxArray]

#: Weight of the squared error at step k = 1..H of a horizon H.
StepWeight: TypeAlias = Callable[[JaxArray, JaxArray], JaxArray]


def states(model: Model, x: JaxArray) -> JaxArray:
    """Measure errors in the states (paper, training loss)."""
    return x


def equation(model: Model, x: JaxArray) -> JaxArray:
    """Measure errors in what the equation stores, such as flux linkage (time integrals of volts).

    One Euler step in this domain is the flux predictor: linear in resistance and flux linkage.
    """
    return model.stored(x)


def every_step(step: JaxArray, horizon: JaxArray) -> JaxArray:
    """Weigh every step alike (paper, training loss)."""
    return jnp.ones(())


def last_step(step: JaxArray, horizon: JaxArray) -> JaxArray:
    """Weigh the last step alone, H times: the H-step-ahead predictor."""
    return jnp.where(step == horizon, 1.0 * horizon, 0.0)


#: What each channel's error is divided by, (channel,), from its recorded values (time, channel).
Scale: TypeAlias = Callable[[FloatArray], FloatArray]


def channel_deviation(values: FloatArray) -> FloatArray:
    """Divide each channel's errors by its deviation: a fraction of what it does."""
    return np.asarray(values.std(axis=0))


def increment_deviation(values: FloatArray) -> FloatArray:
    """Divide each channel's errors by the deviation of its change over a sample.

    One step's error is then a fraction of the derivative's deviation.
    """
    return np.asarray(np.diff(values, axis=0).std(axis=0))


@dataclass(frozen=True)
class Discounted:
    """Weigh each step `factor` times the one before it.

    Attributes
    ----------
    factor : float
        Below 1 trusts early steps, above 1 late ones.
    """

    factor: float

    def __call__(self, step: JaxArray, horizon: JaxArray) -> JaxArray:
        """Return the weight of a step."""
        return self.factor ** (step - 1.0)


@dataclass(frozen=True)
class Prefilter:
    """A noise model as a filter of the residuals: (b_0 + b_1 q^-1 + ..) / (1 + a_1 q^-1 + ..).

    If the error of the one-step predictor is C(q) / D(q) times white noise, the filter D / C makes
    it white (Ljung 1999, section 7.4; paper, section 3.2, condition 2). It starts at rest in every
    window.

    Attributes
    ----------
    numerator : tuple of float
        b_0, b_1, ...
    denominator : tuple of float
        1, a_1, ...

    Raises
    ------
    InputError
        If the numerator is empty or the denominator does not begin with 1.
    """

    numerator: tuple[float, ...] = (1.0,)
    denominator: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        if not self.numerator or not self.denominator or self.denominator[0] != 1.0:
            raise InputError(
                "a prefilter must have a numerator and a denominator that begins with 1, got "
                f"{self.numerator} / {self.denominator}."
            )

    @property
    def order(self) -> int:
        """Number of values the filter remembers."""
        return max(len(self.numerator), len(self.denominator)) - 1

    def advance(self, memory: JaxArray, signal: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Filter one sample.

        Parameters
        ----------
        memory : array, shape (order, ...)
            Zeros at the beginning.
        signal : array, shape (...)
            Present sample.

        Returns
        -------
        array, shape (...)
            Filtered sample.
        array, shape (order, ...)
            Memory after it (transposed direct form II).
        """
        if not self.order:
            return self.numerator[0] * signal, memory
        out = self.numerator[0] * signal + memory[0]
        tail = zip_longest(self.numerator[1:], self.denominator[1:], fillvalue=0.0)
        shifted = jnp.concatenate([memory[1:], jnp.zeros_like(memory[:1])])
        moved = [b * signal - a * out + z for (b, a), z in zip(tail, shifted, strict=True)]
        return out, jnp.stack(moved)


NO_FILTER = Prefilter()


@dataclass(frozen=True)
class Loss:
    """Mean over windows, steps and channels of the squared k-step-ahead error, plus penalties.

    Attributes
    ----------
    domain : Domain
        In the states, or in what the equation stores (`equation`).
    weight : StepWeight
        Of each step's squared error; every step alike by default.
    prefilter : Prefilter
        Noise model; none by default.
    penalties : tuple of Penalty
        Their squared sums are added to the mean squared error.
    free_starts : mapping of str to float or None
        Measured states whose value at each window's start is corrected, with the deviation of
        the correction in SI units that weighs as much as one residual of one scale (infinite: not
        held at all; None: that scale, as the start is one more measured sample). With windows as
        long as the recordings this is simulation-error (NOE) training with estimated initial state.
        A model with outputs has all starts free; leave it empty.
    scale : Scale or None
        `channel_deviation`, `increment_deviation` or a function of your own; None divides by the
        channels' deviations where their units differ and by 1 where they share one.
    noise : StudentT or None
        Noise with outliers, and what is summed in place of squares; None: squares as they are.
    """

    domain: Domain = states
    weight: StepWeight = every_step
    prefilter: Prefilter = NO_FILTER
    penalties: tuple[Penalty, ...] = ()
    free_starts: Mapping[str, float | None] = field(default_factory=dict)
    scale: Scale | None = None
    noise: StudentT | None = None


DEFAULT_LOSS = Loss()
