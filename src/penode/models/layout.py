"""Layout: the one place where a model becomes the optimiser's vector, and the vector a model."""

import itertools
import math
from collections.abc import Sequence
from functools import partial
from typing import Generic, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import BoolArray, FloatArray, IntArray, JaxArray
from penode.errors import InputError
from penode.models.parameters import AnyModule, Setting, setting_at
from penode.models.transforms import Identity, Transform

#: Values of each parameter of a model, (part, batch).
Parts: TypeAlias = tuple[JaxArray, ...]


class Layout(Generic[AnyModule]):
    """Where each parameter of a model lies in two vectors, one raw and one of values.

    The optimiser moves the raw vector (unconstrained). Predictors are differentiated with respect
    to the vector of values, and the transforms enter once, as the Jacobian between the two.
    Layouts of models of one structure are equal: one compiled program serves them all.

    Structure, shapes and settings are the model's, its values are not kept; each of the recordings
    (`experiments`) has its own value of every nuisance. `names` and `settings` are one a parameter.
    One that is reported has the name of its field, ``R`` and not ``terms[0].R``, where no other
    such has it too; all others have their dotted path. `size` is the length of the raw vector.
    """

    def __init__(self, model: AnyModule, experiments: int = 1):
        pairs, self._structure = jax.tree_util.tree_flatten_with_path(model)
        self.settings: tuple[Setting, ...] = tuple(setting_at(model, path) for path, _ in pairs)
        paths = [jax.tree_util.keystr(path).lstrip(".") for path, _ in pairs]
        self.names = _public_names(paths, self.settings)
        for name, (_, leaf) in zip(self.names, pairs, strict=True):
            if not isinstance(leaf, (np.ndarray, jax.Array)):
                raise InputError(
                    f"{name} = {leaf!r} is no array; annotate the field float (of a model) or "
                    "declare it with equinox.field(static=True) to fix it, with "
                    "penode.physical(unit) or penode.parameter() to train it."
                )
        self.experiments = experiments
        self._copies = tuple(experiments if s.per_experiment else 1 for s in self.settings)
        self._shapes = tuple(np.shape(leaf) for _, leaf in pairs)
        entries = tuple(zip(self.settings, self._shapes, self._copies, strict=True))
        self._raw = _consecutive([n * s.transform.size(d) for s, d, n in entries])
        self._values = _consecutive([n * math.prod(d) for _, d, n in entries])
        self.size = self._raw[-1].stop if self._raw else 0
        self._form = (self._structure, self.settings, self._shapes, experiments)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Layout) and self._form == other._form

    def __hash__(self) -> int:
        return hash(self._form)

    @property
    def physical(self) -> tuple[str, ...]:
        """Names of the physical parameters, in the order of the tree."""
        return tuple(n for n, s in zip(self.names, self.settings, strict=True) if s.physical)

    @property
    def units(self) -> dict[str, str]:
        """SI unit of each physical parameter."""
        pairs = zip(self.names, self.settings, strict=True)
        return {name: setting.unit for name, setting in pairs if setting.physical}

    @property
    def first_copies(self) -> IntArray:
        """Places in the raw vector of one value of each parameter: a nuisance's first."""
        sizes = [(at.stop - at.start) // n for at, n in zip(self._raw, self._copies, strict=True)]
        starts = [at.start for at in self._raw]
        parts = [s + np.arange(n) for s, n in zip(starts, sizes, strict=True)]
        return np.concatenate([np.zeros(0, dtype=np.int64), *parts])

    def raw(self, model: AnyModule) -> FloatArray:
        """Return the raw vector, shape (size,), of a model without batch axis."""
        leaves = jax.tree.leaves(model)
        entries = zip(self.names, self.settings, leaves, self._copies, strict=True)
        parts = [np.tile(_inverse(name, s.transform, leaf), n) for name, s, leaf, n in entries]
        return np.concatenate([np.zeros(0), *parts])

    def values(self, raw: JaxArray) -> JaxArray:
        """Return the vector of values, shape (value,), of a raw vector (size,)."""
        parts = [
            setting.transform.forward(part, shape).ravel()
            for setting, at, shape, n in self._entries()
            for part in jnp.split(raw[at], n)
        ]
        return jnp.concatenate([raw[:0], *parts])

    def split(self, values: JaxArray) -> Parts:
        """Cut values (value, batch) into each parameter's own, (part, batch).

        Reverse mode through each part on its own is several times as fast as through the slices of
        one array, whose derivatives are arrays of zeros to be added up.
        """
        return tuple(values[at] for at in self._values)

    def model(self, values: JaxArray, shares: JaxArray | None = None) -> AnyModule:
        """Return the model of values (value, batch); see `model_of`."""
        return self.model_of(self.split(values), shares)

    def model_of(self, parts: Parts, shares: JaxArray | None = None) -> AnyModule:
        """Return the model of each parameter's values (part, batch), batch axis last on every one.

        Shares (experiment, batch) say how much of each recording's nuisances a column of the batch
        has: 1 for its own and 0 for the others. Without them every column has their mean.
        """
        if shares is None:
            shares = jnp.full((self.experiments, 1), 1.0 / self.experiments)
        leaves = []
        for (_, _, shape, copies), part in zip(self._entries(), parts, strict=True):
            leaf = part.reshape(copies, *shape, part.shape[-1])
            own = jnp.expand_dims(shares, tuple(range(1, leaf.ndim - 1))) if copies > 1 else None
            leaves.append(leaf[0] if own is None else jnp.sum(own * leaf, axis=0))
        model: AnyModule = jax.tree.unflatten(self._structure, leaves)
        return model

    def plain_model(self, raw: FloatArray, experiment: int | None = None) -> AnyModule:
        """Return the model of one raw vector (size,) with NumPy values and no batch axis.

        It has the nuisances of one recording, or their mean.
        """
        shares = np.full((self.experiments, 1), 1.0 / self.experiments)
        if experiment is not None:
            shares[:, 0] = np.arange(self.experiments) == experiment
        model: AnyModule = jax.tree.map(np.asarray, _plain(self, jnp.asarray(raw), shares))
        return model

    def nuisances(self, raw: FloatArray) -> dict[str, FloatArray]:
        """Return the nuisances, each of shape (experiment, *shape), of a raw vector (size,)."""
        if not any(setting.per_experiment for setting in self.settings):
            return {}
        values = np.asarray(self.values(jnp.asarray(raw)))
        return {
            name: values[at].reshape(self.experiments, *shape)
            for name, at, (setting, _, shape, _) in zip(
                self.names, self._values, self._entries(), strict=True
            )
            if setting.per_experiment
        }

    def beliefs(self, values: JaxArray) -> JaxArray:
        """Return the standardised distances (entry,) of values (value,) from their priors."""
        parts = zip(self.settings, self._values, strict=True)
        gaps = [(values[at] - s.prior.mean) / s.prior.deviation for s, at in parts if s.prior]
        return jnp.concatenate([values[:0], *gaps])

    @property
    def priors(self) -> tuple[FloatArray, FloatArray]:
        """Mean and deviation of each value's prior, both (value,); 0 and inf where it has none."""
        size = self._values[-1].stop if self._values else 0
        mean, deviation = np.zeros(size), np.full(size, np.inf)
        for setting, at in zip(self.settings, self._values, strict=True):
            if setting.prior:
                mean[at], deviation[at] = setting.prior.mean, setting.prior.deviation
        return mean, deviation

    def physical_values(self, values: JaxArray) -> JaxArray:
        """Pick the physical parameters, shape (physical,), out of a vector of values."""
        parts = zip(self.settings, self._values, strict=True)
        picked = [values[at] for setting, at in parts if setting.physical]
        return jnp.concatenate([values[:0], *picked])

    def with_physical(self, raw: FloatArray, values: FloatArray) -> FloatArray:
        """Return a raw vector (size,) with its physical parameters set to values (physical,)."""
        updated, first = raw.copy(), 0
        for name, (setting, at, shape, _) in zip(self.names, self._entries(), strict=True):
            if setting.physical:
                part = values[first : first + math.prod(shape)].reshape(shape)
                updated[at] = _inverse(name, setting.transform, part)
                first += part.size
        return updated

    @property
    def raw_names(self) -> tuple[str, ...]:
        """The parameter to which each raw entry belongs."""
        pairs = zip(self.names, self._raw, strict=True)
        return tuple(name for name, at in pairs for _ in range(at.stop - at.start))

    @property
    def physical_members(self) -> BoolArray:
        """Which raw entries, shape (size,), are physical parameters'."""
        return self._where([setting.physical for setting in self.settings])

    @property
    def linear_members(self) -> BoolArray:
        """Which raw entries, shape (size,), learned maps are linear in."""
        return self._where([setting.linear for setting in self.settings])

    def _where(self, holds: Sequence[bool]) -> BoolArray:
        chosen = np.zeros(self.size, dtype=np.bool_)
        for one, at in zip(holds, self._raw, strict=True):
            chosen[at] = one
        return chosen

    def members(self, groups: Sequence[str] | None) -> BoolArray:
        """Return which raw entries, shape (size,), belong to the groups (all for None)."""
        return self._members(groups, self._raw)

    def value_members(self, groups: Sequence[str] | None) -> BoolArray:
        """Return which values, shape (value,), belong to the groups; see `members`."""
        return self._members(groups, self._values)

    def _members(self, groups: Sequence[str] | None, places: Sequence[slice]) -> BoolArray:
        available = {setting.group for setting in self.settings}
        missing = sorted(set(groups or ()) - available)
        if missing:
            raise InputError(
                f"the groups must be of {', '.join(sorted(available))}, got {', '.join(missing)}."
            )
        chosen = np.zeros(places[-1].stop if places else 0, dtype=np.bool_)
        for setting, at in zip(self.settings, places, strict=True):
            chosen[at] = groups is None or setting.group in groups
        return chosen

    def _entries(self) -> tuple[tuple[Setting, slice, tuple[int, ...], int], ...]:
        return tuple(zip(self.settings, self._raw, self._shapes, self._copies, strict=True))


@partial(jax.jit, static_argnums=0)
def _plain(layout: Layout[AnyModule], raw: JaxArray, shares: JaxArray) -> AnyModule:
    batched = layout.model(layout.values(raw)[:, None], shares)
    model: AnyModule = jax.tree.map(lambda leaf: leaf[..., 0], batched)
    return model


def _public_names(paths: Sequence[str], settings: Sequence[Setting]) -> tuple[str, ...]:
    """Return the field's name for what is reported, the whole path where that is ambiguous."""
    fields = [
        path.rpartition(".")[2] if s.physical or s.per_experiment else ""
        for path, s in zip(paths, settings, strict=True)
    ]
    return tuple(
        name if name and fields.count(name) == 1 else path
        for name, path in zip(fields, paths, strict=True)
    )


def _inverse(name: str, transform: Transform, value: FloatArray) -> FloatArray:
    try:
        with np.errstate(divide="ignore", invalid="ignore"):
            raw = transform.inverse(value)
    except np.linalg.LinAlgError:
        raw = np.full(1, np.nan)
    if not np.isfinite(raw).all():
        kind = "finite" if isinstance(transform, Identity) else type(transform).__name__
        raise InputError(f"{name} must have {kind} values, got {value}.")
    return raw


def _consecutive(sizes: Sequence[int]) -> tuple[slice, ...]:
    ends = np.cumsum([0, *sizes])
    return tuple(slice(int(a), int(b)) for a, b in itertools.pairwise(ends))
