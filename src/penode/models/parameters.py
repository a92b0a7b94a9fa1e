"""Parameters: a tree of values, a twin tree of settings, and one raw vector for the optimiser.

The values in a model are physical. The optimiser moves an unconstrained raw vector; `Layout` is
the only place where one becomes the other.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import BoolArray, FloatArray, JaxArray
from penode.errors import InputError


class Transform(Protocol):
    """A smooth bijection between a raw vector and a parameter's admissible values."""

    def size(self, shape: tuple[int, ...]) -> int:
        """Return the length of the raw vector of a value of this shape."""

    def forward(self, raw: JaxArray, shape: tuple[int, ...]) -> JaxArray:
        """Map raw (size,) to a value (*shape)."""

    def inverse(self, value: FloatArray) -> FloatArray:
        """Map a value (*shape) to raw (size,)."""


@dataclass(frozen=True)
class Identity:
    """Any real value."""

    def size(self, shape: tuple[int, ...]) -> int:
        """Return the number of entries."""
        return math.prod(shape)

    def forward(self, raw: JaxArray, shape: tuple[int, ...]) -> JaxArray:
        """Reshape raw (size,) to (*shape)."""
        return raw.reshape(shape)

    def inverse(self, value: FloatArray) -> FloatArray:
        """Flatten the value."""
        return np.ravel(value)


@dataclass(frozen=True)
class Positive:
    """Values above zero, as exponentials."""

    def size(self, shape: tuple[int, ...]) -> int:
        """Return the number of entries."""
        return math.prod(shape)

    def forward(self, raw: JaxArray, shape: tuple[int, ...]) -> JaxArray:
        """Exponentiate raw (size,)."""
        return jnp.exp(raw).reshape(shape)

    def inverse(self, value: FloatArray) -> FloatArray:
        """Take the logarithm of the value."""
        return np.log(np.ravel(value))


@dataclass(frozen=True)
class PositiveDefinite:
    """Symmetric positive definite matrices, as Cholesky factors with a logarithmic diagonal."""

    def size(self, shape: tuple[int, ...]) -> int:
        """Return the number of entries of one triangle."""
        return shape[0] * (shape[0] + 1) // 2

    def forward(self, raw: JaxArray, shape: tuple[int, ...]) -> JaxArray:
        """Build F F' (n, n) from raw (size,), the rows of the lower triangle F."""
        n = shape[0]
        factor = jnp.zeros(shape, raw.dtype).at[np.tril_indices(n)].set(raw)
        diagonal = jnp.diag_indices(n)
        factor = factor.at[diagonal].set(jnp.exp(factor[diagonal]))
        return factor @ factor.T

    def inverse(self, value: FloatArray) -> FloatArray:
        """Return the lower triangle of the Cholesky factor, its diagonal as logarithms."""
        factor = np.linalg.cholesky(value)
        np.fill_diagonal(factor, np.log(np.diag(factor)))
        return np.asarray(factor[np.tril_indices(len(factor))])


@dataclass(frozen=True)
class Setting:
    """What is known of one parameter beside its value.

    Attributes
    ----------
    unit : str
        SI unit; empty for network weights.
    group : str
        Name by which a plan moves or freezes it.
    physical : bool
        Whether it is reported with an interval.
    transform : Transform
        From the optimiser's raw vector to admissible values.
    """

    unit: str = ""
    group: str = "learned"
    physical: bool = False
    transform: Transform = Identity()


_DEFAULT = Setting()
AnyModule = TypeVar("AnyModule", bound=eqx.Module)


def _float64(value: Any) -> FloatArray:
    return np.array(value, dtype=np.float64)


def parameter(
    *,
    unit: str = "",
    group: str = "learned",
    physical: bool = False,
    transform: Transform = _DEFAULT.transform,
) -> Any:
    """Declare a field of a `Model` (or of a network inside it) as a trained parameter.

    Parameters
    ----------
    unit : str
        SI unit.
    group : str
        Name by which a plan moves or freezes the parameter.
    physical : bool
        Whether it is reported with an interval; it must then be a scalar.
    transform : Transform
        Constraint, such as `Positive` or `PositiveDefinite`.

    Returns
    -------
    dataclass field
        Converts its value to a float64 array at construction.
    """
    setting = Setting(unit, group, physical, transform)
    return eqx.field(converter=_float64, metadata={"setting": setting})


def physical(unit: str, transform: Transform = _DEFAULT.transform) -> Any:
    """Declare a scalar physical parameter, reported with an interval; see `parameter`."""
    return parameter(unit=unit, group="physical", physical=True, transform=transform)


def _setting(model: eqx.Module, path: Sequence[Any]) -> Setting:
    node: Any = model
    found = _DEFAULT
    for key in path:
        if isinstance(key, jax.tree_util.GetAttrKey):
            found = type(node).__dataclass_fields__[key.name].metadata.get("setting", _DEFAULT)
            node = getattr(node, key.name)
        else:
            node = node[key.idx if hasattr(key, "idx") else key.key]
    return found


def settings(model: eqx.Module) -> Any:
    """Return the twin tree: the model's structure with a `Setting` in place of every value."""
    return jax.tree_util.tree_map_with_path(lambda path, _: _setting(model, path), model)


def with_batch_axis(model: AnyModule) -> AnyModule:
    """Return the model with one trailing axis of length 1 on every parameter."""
    batched: AnyModule = jax.tree.map(lambda leaf: leaf[..., None], model)
    return batched


class Layout(Generic[AnyModule]):
    """Where each parameter of a model lies in two vectors, one raw and one of values.

    The optimiser moves the raw vector (unconstrained). Predictors are differentiated with respect
    to the vector of values, and the transforms enter once, as the Jacobian between the two.

    Parameters
    ----------
    model : Model
        Structure, shapes and settings are taken from it; its values are not kept.

    Attributes
    ----------
    names : tuple of str
        Dotted path of each parameter.
    settings : tuple of Setting
        One for each name.
    size : int
        Length of the raw vector.
    """

    def __init__(self, model: AnyModule):
        pairs, self._structure = jax.tree_util.tree_flatten_with_path(model)
        self.names = tuple(jax.tree_util.keystr(path).lstrip(".") for path, _ in pairs)
        self.settings: tuple[Setting, ...] = tuple(_setting(model, path) for path, _ in pairs)
        for name, (_, leaf) in zip(self.names, pairs, strict=True):
            if not isinstance(leaf, (np.ndarray, jax.Array)):
                raise InputError(
                    f"{name} = {leaf!r} is a plain number; declare the field with "
                    "penode.parameter() to train it, or static with equinox.field(static=True)."
                )
        self._shapes = tuple(np.shape(leaf) for _, leaf in pairs)
        sizes = [s.transform.size(d) for s, d in zip(self.settings, self._shapes, strict=True)]
        self._raw = _consecutive(sizes)
        self._values = _consecutive([math.prod(shape) for shape in self._shapes])
        self.size = sum(sizes)

    @property
    def physical(self) -> tuple[str, ...]:
        """Names of the physical parameters, in the order of the tree."""
        return tuple(n for n, s in zip(self.names, self.settings, strict=True) if s.physical)

    @property
    def units(self) -> dict[str, str]:
        """SI unit of each physical parameter."""
        pairs = zip(self.names, self.settings, strict=True)
        return {name: setting.unit for name, setting in pairs if setting.physical}

    def raw(self, model: AnyModule) -> FloatArray:
        """Return the raw vector, shape (size,), of a model without batch axis."""
        leaves = jax.tree.leaves(model)
        entries = zip(self.names, self.settings, leaves, strict=True)
        parts = [_inverse(name, setting.transform, leaf) for name, setting, leaf in entries]
        return np.concatenate([np.zeros(0), *parts])

    def values(self, raw: JaxArray) -> JaxArray:
        """Return the vector of values, shape (value,), of a raw vector (size,)."""
        parts = zip(self.settings, self._raw, self._shapes, strict=True)
        return jnp.concatenate([s.transform.forward(raw[at], d).ravel() for s, at, d in parts])

    def model(self, values: JaxArray) -> AnyModule:
        """Return the model of values (value, batch), batch axis last on every parameter."""
        batch = values.shape[-1]
        parts = zip(self._values, self._shapes, strict=True)
        leaves = [values[at].reshape(*shape, batch) for at, shape in parts]
        model: AnyModule = jax.tree.unflatten(self._structure, leaves)
        return model

    def plain_model(self, raw: FloatArray) -> AnyModule:
        """Return the model of one raw vector (size,) with NumPy values and no batch axis."""
        batched = self.model(self.values(jnp.asarray(raw))[:, None])
        model: AnyModule = jax.tree.map(lambda leaf: np.asarray(leaf[..., 0]), batched)
        return model

    def physical_values(self, values: JaxArray) -> JaxArray:
        """Pick the physical parameters, shape (physical,), out of a vector of values."""
        parts = zip(self.settings, self._values, strict=True)
        picked = [values[at] for setting, at in parts if setting.physical]
        return jnp.concatenate([values[:0], *picked])

    def members(self, groups: Sequence[str] | None) -> BoolArray:
        """Return which raw entries, shape (size,), belong to the groups (all for None).

        Raises
        ------
        InputError
            If the model has no parameter of a group.
        """
        known = {setting.group for setting in self.settings}
        missing = sorted(set(groups or ()) - known)
        if missing:
            raise InputError(
                f"group {', '.join(missing)} came; the model's groups are "
                f"{', '.join(sorted(known))}."
            )
        chosen = np.zeros(self.size, dtype=np.bool_)
        for setting, at in zip(self.settings, self._raw, strict=True):
            chosen[at] = groups is None or setting.group in groups
        return chosen


def _inverse(name: str, transform: Transform, value: FloatArray) -> FloatArray:
    try:
        with np.errstate(divide="ignore", invalid="ignore"):
            raw = transform.inverse(value)
    except np.linalg.LinAlgError:
        raw = np.full(1, np.nan)
    if not np.isfinite(raw).all():
        raise InputError(f"{name} = {value} came; want {type(transform).__name__} values.")
    return raw


def _consecutive(sizes: Sequence[int]) -> tuple[slice, ...]:
    ends = np.cumsum([0, *sizes])
    return tuple(slice(int(a), int(b)) for a, b in itertools.pairwise(ends))
