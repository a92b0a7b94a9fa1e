"""Models around a model: what it says of itself is the same, and its equation is another."""

from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import numpy as np

from penode.arrays import FloatArray, JaxArray
from penode.models.base import Model
from penode.models.explicit_time import driving_channels, evaluated, rates_of
from penode.models.inputs import Inputs
from penode.models.last_layer import Constant
from penode.models.parameters import setting_at


class Wrapped(Model):
    """A model around another one, whose channels, maps and outputs it has."""

    model: Model

    @property
    def states(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the model's states."""
        return self.model.states

    @property
    def state_units(self) -> tuple[str, ...]:  # type: ignore[override]
        """SI units of the model's states."""
        return self.model.state_units

    @property
    def unmeasured(self) -> tuple[str, ...]:  # type: ignore[override]
        """States of the model that no sensor measures."""
        return self.model.unmeasured

    @property
    def outputs(self) -> Mapping[str, str]:  # type: ignore[override]
        """What sensors measure of the model, and its units."""
        return self.model.outputs

    @property
    def input_rates(self) -> Mapping[str, str | float]:  # type: ignore[override]
        """Inputs of the model that go on between samples, time among them where it acts."""
        return rates_of(self.model)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of what drives the model: its inputs, and time where it acts."""
        return driving_channels(self.model)

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return the model's derivative."""
        return evaluated(self.model, "derivative", x, u)

    def output(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return what sensors read of the model."""
        return evaluated(self.model, "output", x, u)

    @property
    def covariances(self) -> tuple[str, ...]:
        """States of the model that are covariances."""
        return self.model.covariances

    def filtered(self, x: JaxArray, measured: JaxArray, u: Inputs) -> JaxArray:
        """Return the model's states behind what was measured at a sample."""
        return self.model.filtered(x, measured, u)

    @property
    def encoded_samples(self) -> int:
        """Samples that the model's encoder sees."""
        return self.model.encoded_samples

    def encoded(self, measured: JaxArray, inputs: JaxArray) -> JaxArray:
        """Return where the model's encoder starts a window."""
        return self.model.encoded(measured, inputs)

    def learned(self, x: JaxArray) -> JaxArray:
        """Return the model's learned part."""
        return self.model.learned(x)

    def corrected(self, measured: JaxArray) -> JaxArray:
        """Return the states behind what the sensors read."""
        return self.model.corrected(measured)

    def stored(self, x: JaxArray) -> JaxArray:
        """Return what the model's equation balances."""
        return self.model.stored(x)

    def maps(self) -> Mapping[str, Callable[..., Any]]:
        """Return the model's learned maps."""
        return self.model.maps()


@jax.tree_util.register_static
class _Held(Constant):
    """What else is a parameter."""


class WithoutPart(Wrapped):
    """A model whose learned part stays as it is: no parameter, and so no cost."""

    @classmethod
    def of(cls, model: Model) -> "WithoutPart | None":
        """Return a model without its learned part as parameters; None where one of both lacks."""

        def held(path: Any, leaf: FloatArray) -> Any:
            if setting_at(model, path).group != "learned":
                return leaf
            return _Held(np.array(leaf, dtype=float))

        fixed = jax.tree_util.tree_map_with_path(held, model)
        count = len(jax.tree.leaves(fixed))
        return cls(fixed) if 0 < count < len(jax.tree.leaves(model)) else None

    @property
    def whole(self) -> Model:
        """The model with its learned part as parameters, neither with a batch axis."""
        return self._with(lambda constant: constant.array)

    @property
    def _batched(self) -> Model:
        return self._with(lambda constant: constant.batched)

    def _with(self, number: Callable[[_Held], FloatArray]) -> Model:
        whole: Model = jax.tree.map(
            lambda leaf: number(leaf) if isinstance(leaf, _Held) else leaf,
            self.model,
            is_leaf=lambda leaf: isinstance(leaf, _Held),
        )
        return whole

    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return the model's derivative."""
        return evaluated(self._batched, "derivative", x, u)

    def output(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return what sensors read of the model."""
        return evaluated(self._batched, "output", x, u)

    def learned(self, x: JaxArray) -> JaxArray:
        """Return nothing: nothing is learned."""
        return x[:0]

    def corrected(self, measured: JaxArray) -> JaxArray:
        """Return the states behind what the sensors read."""
        return self._batched.corrected(measured)

    def stored(self, x: JaxArray) -> JaxArray:
        """Return what the model's equation balances."""
        return self._batched.stored(x)

    def maps(self) -> Mapping[str, Callable[..., Any]]:
        """Return the model's learned maps."""
        return self.whole.maps()


def whole_of(model: Model) -> Model:
    """Return a model whose learned part, where it was held, is a parameter again."""
    if isinstance(model, WithoutPart):
        return model.whole
    inner = whole_of(model.model) if isinstance(model, Wrapped) else model
    same = not isinstance(model, Wrapped) or inner is model.model
    return model if same else eqx.tree_at(lambda m: m.model, model, inner)
