"""Networks of which the last layer alone is trained: numbers that are no parameters of a model."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
import numpy as np

from penode.arrays import FloatArray, JaxArray, Leaf
from penode.models.networks import FeatureNetwork, TanhLayers
from penode.models.parameters import Tree, coefficients


@jax.tree_util.register_static
@dataclass(frozen=True, eq=False)
class Constant:
    """Numbers that are part of a model's structure, and no parameters of it."""

    array: FloatArray

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Constant) and self._form == other._form

    def __hash__(self) -> int:
        return hash(self._form)

    @cached_property
    def _form(self) -> tuple[tuple[int, ...], bytes]:
        return self.array.shape, self.array.tobytes()

    @property
    def batched(self) -> FloatArray:
        """The numbers with a batch axis, one column for all."""
        return self.array[..., None]


class LastLayer(FeatureNetwork):
    """A network whose hidden layers are constant: linear in the parameters that are left.

    Attributes
    ----------
    hidden : tuple of (Constant, Constant)
        Weights and biases of each hidden layer, first layer first.
    weights : array, shape (m, neuron)
    bias : array, shape (m,)
    """

    hidden: tuple[tuple[Constant, Constant], ...]
    weights: Leaf = coefficients()
    bias: Leaf = coefficients()

    @classmethod
    def of(cls, network: TanhLayers) -> "LastLayer":
        """Return a network with its hidden layers held."""
        *weights, last = network.weights
        *biases, bias = network.biases
        pairs = zip(weights, biases, strict=True)
        return cls(
            tuple((Constant(np.array(w)), Constant(np.array(b))) for w, b in pairs), last, bias
        )

    def value_and_jacobian(
        self, x: JaxArray, features: JaxArray | None = None
    ) -> tuple[JaxArray, JaxArray]:
        """Return the output (m, batch) and its Jacobian (m, n, batch)."""
        weights = [weights.batched for weights, _ in self.hidden]
        biases = [bias.batched for _, bias in self.hidden]
        network = TanhLayers((*weights, self.weights), (*biases, self.bias))
        return network.value_and_jacobian(x, features)


def last_layers(model: Tree) -> Tree:
    """Return a model, its values without batch axis, with the hidden layers of networks held."""

    def held(node: Any) -> Any:
        return LastLayer.of(node) if isinstance(node, TanhLayers) else node

    tree: Tree = jax.tree.map(held, model, is_leaf=lambda node: isinstance(node, TanhLayers))
    return tree
