"""An extended Kalman filter around a model: what is measured corrects the state on the way."""

from collections.abc import Callable, Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, IntArray, JaxArray, Leaf
from penode.errors import InputError
from penode.models.base import Model
from penode.models.inputs import Inputs
from penode.models.measured import measured_units, predicted_outputs
from penode.models.parameters import parameter
from penode.models.transforms import Positive
from penode.models.wrapped import Wrapped

#: Group of all deviations and time constants of noise.
GROUP = "noise"


class ExtendedKalman(Wrapped):
    """A model with a noise model: an extended Kalman filter predicts from one sample to the next.

    Noise acts on the states between samples (process noise), and the sensors add white noise to
    what they read, and such as is correlated in time if a time constant is given. How much each is,
    training estimates with all other parameters: what a sample shows beyond its prediction moves
    the state by the gain that follows (A. H. Jazwinski, Stochastic Processes and Filtering Theory,
    1970, chapter 8; L. Ljung, System Identification, 2nd ed., 1999, section 7.4). Without process
    noise predictions over a horizon are the model's own simulation (NOE); with much of it each one
    starts anew at the sample before it (NARX). The state's covariance goes on as states of the
    model's ordinary differential equation, P' = A P + P A' + Q, from zero at a window's start,
    which is estimated. A gain of its own would be free to make the filter unstable: over a window
    whose start is estimated that costs nothing, and often explains more.

    Parameters
    ----------
    model : Model
    process : sequence of float, shape (state,)
        Deviation of the noise on each state, SI units per root second, where training begins; an
        order of magnitude is enough. 0 says that none acts there, and is not trained.
    sensor : sequence of float, shape (quantity,)
        Deviation of the white noise of each output, or measured state, SI units. Predictions depend
        on ratios of deviations alone: the first one stays as given.
    correlated : sequence of float, shape (quantity,), optional
        Deviation of the correlated noise of each output, SI units; of models with outputs.
    time_constant : float, optional
        After which that noise is correlated by 1 / e no more, s, where training begins.

    Raises
    ------
    InputError
        If a number is missing, below its bound, there is correlated noise of states, or the model
        has an encoder.
    """

    noisy: tuple[int, ...] = eqx.field(static=True)
    first: float = eqx.field(static=True)
    process: Leaf = parameter(group=GROUP, transform=Positive())
    ratio: Leaf = parameter(group=GROUP, transform=Positive())
    correlated: Leaf | None = parameter(group=GROUP, transform=Positive(), default=None)
    time_constant: Leaf | None = parameter(group=GROUP, transform=Positive(), default=None)

    def __init__(
        self,
        model: Model,
        process: Sequence[float],
        sensor: Sequence[float],
        correlated: Sequence[float] | None = None,
        time_constant: float | None = None,
    ):
        if model.encoded_samples:
            raise InputError(
                "ExtendedKalman must be around a model whose windows estimate their starts, got "
                f"{type(model).__name__}; use one of them."
            )
        names = tuple(measured_units(model))
        acting = _given("process", process, model.states, zero=True)
        white = _given("sensor", sensor, names)
        if (correlated is None) != (time_constant is None):
            raise InputError("correlated and time_constant must be given together, got one.")
        if correlated is not None and not model.outputs:
            raise InputError(
                f"correlated must be left out for {type(model).__name__}, whose states are "
                "measured as they are; write its outputs, outputs = {...}."
            )
        self.model, self.first = model, float(white[0])
        self.noisy = tuple(np.flatnonzero(acting).tolist())
        self.process, self.ratio = acting[acting > 0], white[1:] / white[0]
        self.correlated = self.time_constant = None
        if correlated is not None:
            self.correlated = _given("correlated", correlated, names)
            self.time_constant = _given("time_constant", (time_constant or 0.0,), ("all outputs",))

    @property
    def states(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the model's states, of the outputs' correlated noise, and of covariances."""
        return (*self._dynamic, *self.covariances)

    @property
    def state_units(self) -> tuple[str, ...]:  # type: ignore[override]
        """SI units of the states."""
        own = (*self.model.state_units, *self._slow.values())
        pairs = zip(*self._pairs, strict=True)
        return (*own, *(f"{own[i]} {own[j]}" for i, j in pairs))

    @property
    def unmeasured(self) -> tuple[str, ...]:  # type: ignore[override]
        """States that no sensor measures."""
        return (
            self.model.unmeasured if self.outputs else (*self.model.unmeasured, *self.covariances)
        )

    @property
    def covariances(self) -> tuple[str, ...]:
        """Names of the state's covariances."""
        own = self._dynamic
        return tuple(
            f"covariance of {own[i]} and {own[j]}" for i, j in zip(*self._pairs, strict=True)
        )

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return the derivative of the model, of correlated noise, and P' = A P + P A' + Q."""
        own, covariance = self._split(x)

        def rate(own: JaxArray) -> JaxArray:
            return self._rate(own, u)

        slopes = _slopes(rate, own)
        half = jnp.sum(slopes[:, :, None] * covariance[None], axis=1)
        whole = half + half.swapaxes(0, 1) + self._spectral_density(x)
        return jnp.concatenate([rate(own), whole[self._pairs]])

    def output(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return what sensors read, correlated noise included."""
        return self._read(self._split(x)[0], u)

    def filtered(self, x: JaxArray, measured: JaxArray, u: Inputs) -> JaxArray:
        """Return the states behind what was measured, one quantity after the other."""
        start, covariance = self._split(x)
        gaps = measured - self._read(start, u)
        slopes = _slopes(lambda own: self._read(own, u), start)
        ratio = [1.0, *jnp.asarray(self.ratio)]
        own = start
        for slope, gap, one in zip(slopes, gaps, ratio, strict=True):
            along = jnp.sum(covariance * slope[None], axis=1)
            gain = along / (jnp.sum(slope * along, axis=0) + (self.first * one) ** 2)
            own = own + gain * (gap - jnp.sum(slope * (own - start), axis=0))
            covariance = covariance - gain[:, None] * along[None]
        return jnp.concatenate([own, covariance[self._pairs]])

    def learned(self, x: JaxArray) -> JaxArray:
        """Return the model's learned part."""
        return super().learned(x[: len(self.model.states)])

    def corrected(self, measured: JaxArray) -> JaxArray:
        """Return the states behind what the sensors read."""
        own = len(self.model.states)
        return jnp.concatenate([super().corrected(measured[:own]), measured[own:]])

    def stored(self, x: JaxArray) -> JaxArray:
        """Return what the model's equation balances, and all other states."""
        own = len(self.model.states)
        return jnp.concatenate([super().stored(x[:own]), x[own:]])

    @property
    def _slow(self) -> Mapping[str, str]:
        """Outputs whose noise is correlated, and their units."""
        return self.model.outputs if self.correlated is not None else {}

    @property
    def _dynamic(self) -> tuple[str, ...]:
        return (*self.model.states, *(f"noise of {name}" for name in self._slow))

    @property
    def _pairs(self) -> tuple[IntArray, IntArray]:
        """Rows and columns of the covariances that are kept."""
        rows, columns = np.triu_indices(len(self._dynamic))
        return rows, columns

    def _split(self, x: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return the states without covariances, and their covariance (state, state, batch)."""
        count = len(self._dynamic)
        places = np.zeros((count, count), dtype=int)
        places[self._pairs] = np.arange(len(self._pairs[0]))
        places = np.maximum(places, places.T)
        return x[:count], x[count:][places]

    def _rate(self, own: JaxArray, u: Inputs) -> JaxArray:
        count = len(self.model.states)
        rate = super().derivative(own[:count], u)
        if self.time_constant is None:
            return rate
        return jnp.concatenate([rate, -own[count:] / jnp.asarray(self.time_constant)])

    def _read(self, own: JaxArray, u: Inputs) -> JaxArray:
        count = len(self.model.states)
        read = predicted_outputs(self.model, own[:count], u)
        return read + own[count:] if self._slow else read

    def _spectral_density(self, x: JaxArray) -> JaxArray:
        """Return Q (state, state, batch), SI units squared per second."""
        own = jnp.zeros((len(self.model.states), x.shape[-1]), x.dtype)
        own = own.at[np.array(self.noisy, dtype=int)].set(
            jnp.asarray(self.process) ** 2 + 0 * x[:1]
        )
        if self.correlated is not None:
            slow = 2 * jnp.asarray(self.correlated) ** 2 / jnp.asarray(self.time_constant)
            slow = slow + 0 * x[:1]
            own = jnp.concatenate([own, slow])
        return own[:, None] * np.eye(len(own))[..., None]


def _slopes(function: Callable[[JaxArray], JaxArray], x: JaxArray) -> JaxArray:
    """Return the slopes (row, state, batch) of a function of states (state, batch)."""
    units = jnp.eye(len(x), dtype=x.dtype)[..., None] + 0 * x

    def along(unit: JaxArray) -> JaxArray:
        slope: JaxArray = jax.jvp(function, (x,), (unit,))[1]
        return slope

    return jax.vmap(along, out_axes=1)(units)


def _given(
    name: str, numbers: Sequence[float], of: Sequence[str], zero: bool = False
) -> FloatArray:
    """Return numbers, one for each name, above 0 or, where it may be, none below it."""
    found = np.atleast_1d(np.asarray(numbers, dtype=float))
    if found.shape != (len(of),):
        raise InputError(
            f"{name} must have one number for each of {', '.join(of)}, got {found.size}."
        )
    if not np.all(np.isfinite(found) & ((found >= 0) if zero else (found > 0))):
        raise InputError(f"{name} must be {'>= 0' if zero else '> 0'}, got {found.tolist()}.")
    return found
