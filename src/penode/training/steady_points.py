"""Points at which nothing changes: f(x, u, theta) = 0 there, measured beside recordings."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, float64
from penode.errors import InputError
from penode.models.base import Model
from penode.models.explicit_time import driving_channels, evaluated
from penode.models.inputs import Inputs
from penode.models.layout import Layout
from penode.models.measured import measured_units, predicted_outputs

#: Implicit steps towards rest, and by how much each is longer than the one before.
_STEPS, _LONGER = 60, 2.0
#: First step by the fastest rate of the equation.
_FIRST = 0.1
#: Change of a state, SI units and relative, from which it is not at rest.
_STILL = 1e-6


@dataclass(frozen=True, eq=False)
class SteadyPoints:
    """A table of points at which a plant was at rest.

    The model is at rest where its derivative is zero; what its sensors read there is compared with
    what they measured. Each value counts as one more independent measurement.

    Attributes
    ----------
    channels : mapping of str to array_like, shape (point,)
        Inputs of the model and what was measured, SI units. A state that is no measured quantity is
        a first guess.
    std : mapping of str to float or array_like
        Standard deviation of each quantity that is compared: states that sensors measure, or
        outputs of a model that declares them.
    name : str
        Of the table.

    Raises
    ------
    InputError
        If columns differ in length or are not finite, or nothing is compared.
    """

    channels: Mapping[str, Any]
    std: Mapping[str, Any]
    name: str = "points"

    def __post_init__(self) -> None:
        try:
            columns = {n: np.atleast_1d(np.asarray(c, float)) for n, c in self.channels.items()}
            (shape,) = {column.shape for column in columns.values()}
            (count,) = shape
            spread = {n: np.broadcast_to(np.asarray(s, float), count) for n, s in self.std.items()}
        except (TypeError, ValueError):
            raise InputError(
                f"{self.name}: channels must be columns of numbers of one length, and std numbers "
                "or such columns; correct them."
            ) from None
        if not spread:
            raise InputError(f"{self.name}: std must name a measured channel at least, got none.")
        for name, column in columns.items():
            if not np.isfinite(column).all():
                row = int(np.argmin(np.isfinite(column))) + 1
                raise InputError(f"{self.name}: {name} is not finite in row {row}; leave it out.")
        for name, one in spread.items():
            if name not in columns or not (np.isfinite(one) & (one > 0)).all():
                what = "has no column" if name not in columns else "must have std > 0"
                raise InputError(f"{self.name}: {name} {what}; correct std or channels.")
        object.__setattr__(self, "channels", columns)
        object.__setattr__(self, "std", spread)

    def require(self, model: Model) -> None:
        """Refuse a model whose inputs are no columns, or that is never at rest."""
        known = measured_units(model)
        strange = [name for name in self.std if name not in known]
        absent = [name for name in model.inputs if name not in self.channels]
        if strange or absent:
            what = (
                f"std names {strange[0]}, which no sensor of the model measures: {', '.join(known)}"
                if strange
                else f"the input {absent[0]} has no column"
            )
            raise InputError(f"{self.name}: {what}; correct the table.")
        if model.covariances or driving_channels(model) != model.inputs:
            what = "noise on its states" if model.covariances else "time in its equation"
            raise InputError(f"{self.name}: a model with {what} is never at rest; leave it out.")

    def penalty(self, model: Model) -> "Rest":
        """Return the points as a penalty, each standardised gap as one residual.

        Refuses a model without a state of rest at a point.
        """
        self.require(model)
        known = list(measured_units(model))
        count = len(next(iter(self.channels.values())))
        columns = [self.channels.get(name, np.zeros(count)) for name in model.states]
        places = [known.index(name) for name in self.std]
        made = Rest(
            np.array(columns),
            np.array([self.channels[n] for n in model.inputs]).reshape(-1, count),
            np.array([self.channels[name] for name in self.std]),
            np.array(list(self.std.values())),
            np.array(places),
        )
        with float64():
            layout = Layout(model)
            values = layout.values(jnp.asarray(layout.raw(model)))
            rest = np.asarray(made.state(layout, values))
            again = np.asarray(replace(made, guess=rest).state(layout, values))
        still = np.isclose(again, rest, rtol=_STILL, atol=_STILL).all(axis=0)
        if not still.all():
            raise InputError(
                f"{self.name}: the model finds no state of rest at the point of row "
                f"{int(np.argmin(still)) + 1} from its start values; give a first guess of its "
                "states as channels, or leave out points at which it moves."
            )
        return made


@partial(
    jax.tree_util.register_dataclass,
    data_fields=("guess", "inputs", "measured", "std", "places", "scale"),
    meta_fields=(),
)
@dataclass(frozen=True, eq=False)
class Rest:
    """What sensors read at rest, as a penalty; rows are states, inputs or quantities."""

    guess: FloatArray = field(repr=False)
    inputs: FloatArray = field(repr=False)
    measured: FloatArray = field(repr=False)
    std: FloatArray = field(repr=False)
    # Which of the model's measured quantities the rows are.
    places: Any
    # Variance of a standardised gap in units of the loss.
    scale: float = 1.0

    def residuals(self, layout: Layout[Model], values: JaxArray) -> JaxArray:
        """Return the standardised gaps, scaled, quantity by quantity."""
        return jnp.sqrt(self.scale) * self.gaps(layout, values).ravel()

    def gaps(self, layout: Layout[Model], values: JaxArray) -> JaxArray:
        """Return measured less computed values over their deviations, (quantity, point)."""
        return (jnp.asarray(self.measured) - self.read(layout, values)) / self.std

    def read(self, layout: Layout[Model], values: JaxArray) -> JaxArray:
        """Return what sensors read at rest, (quantity, point), SI units."""
        model = layout.model(values[:, None])
        read = predicted_outputs(model, self.state(layout, values), self._given(model))
        return read[jnp.asarray(self.places)]

    def state(self, layout: Layout[Model], values: JaxArray) -> JaxArray:
        """Return the states at rest, (state, point), SI units."""
        model = layout.model(values[:, None])
        return state_of_rest(model, jnp.asarray(self.guess), self._given(model))

    def _given(self, model: Model) -> Inputs:
        """Return the inputs, and behind them their changes, of a model that lacks something."""
        own = jnp.asarray(self.inputs)
        changes = jnp.zeros((len(model.inputs) - len(own), own.shape[1]))
        return Inputs(jnp.concatenate([own, changes]), model.inputs)


def state_of_rest(model: Model, guess: JaxArray, u: Inputs) -> JaxArray:
    """Return the states (state, point) at rest that the equation runs into, not finite without one.

    Implicit Euler steps that grow until they are Newton's. The last is differentiated: by the
    implicit function theorem its slopes are those of the solution.
    """

    def rate(x: JaxArray) -> JaxArray:
        return evaluated(model, "derivative", x, u)

    def slopes(x: JaxArray) -> JaxArray:
        columns = [
            jax.jvp(rate, (x,), (jnp.zeros_like(x).at[k].set(1.0),))[1] for k in range(len(x))
        ]
        return jnp.stack(columns, axis=1)

    def solved(matrix: JaxArray, right: JaxArray) -> JaxArray:
        at_points = jnp.linalg.solve(jnp.moveaxis(matrix, 2, 0), right.T[..., None])
        return at_points[..., 0].T

    def step(k: JaxArray, x: JaxArray) -> JaxArray:
        slope = slopes(x)
        fastest = jnp.maximum(jnp.abs(slope).sum(axis=1).max(axis=0), 1e-300)
        inverse = fastest / (_FIRST * _LONGER**k)
        return x + solved(inverse * jnp.eye(len(x))[:, :, None] - slope, rate(x))

    rest = jax.lax.stop_gradient(jax.lax.fori_loop(0, _STEPS, step, guess))
    return rest - solved(jax.lax.stop_gradient(slopes(rest)), rate(rest))
