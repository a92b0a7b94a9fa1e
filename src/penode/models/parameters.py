"""Parameters: a tree of physical values beside a twin tree of what is known of each of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import equinox as eqx
import jax
import numpy as np

from penode.arrays import FloatArray
from penode.errors import InputError
from penode.models.transforms import Bounded, Identity, Transform
from penode.models.users_code import declaring_line


@dataclass(frozen=True)
class Normal:
    """What is believed of a parameter before any data.

    Attributes
    ----------
    mean, deviation : float
        In the parameter's SI unit.
    """

    mean: float
    deviation: float


_UNCONSTRAINED: Transform = Identity()


@dataclass(frozen=True)
class Setting:
    """What is known of one parameter beside its value."""

    # SI; empty for network weights.
    unit: str = ""
    # Name by which a plan moves or freezes it.
    group: str = "learned"
    physical: bool = False
    # From the optimiser's raw vector to admissible values.
    transform: Transform = _UNCONSTRAINED
    # It acts as strongly as the recordings' noise makes it, or as `Priors` in the loss says.
    prior: Normal | None = None
    per_experiment: bool = False
    meaning: str = ""
    # A value that is not above it is impossible. Training may pass it, so that it shows.
    lowest: float = -np.inf
    # Whether a learned map is linear in it: mean coefficients then give the mean map.
    linear: bool = False
    # Inputs that act this many s late.
    delays: tuple[str, ...] = ()


_DEFAULT = Setting()
AnyModule = TypeVar("AnyModule", bound=eqx.Module)
Tree = TypeVar("Tree")


#: Marks a field that has to be given.
_REQUIRED: Any = object()


def _float64(value: Any) -> FloatArray | None:
    try:
        return None if value is None else np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(
            f"the value of a parameter must be a number or an array of numbers, got {value!r}."
        ) from None


def parameter(
    *,
    unit: str = "",
    group: str = "learned",
    physical: bool = False,
    transform: Transform = _UNCONSTRAINED,
    prior: Normal | None = None,
    default: Any = _REQUIRED,
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
        Constraint, such as `Positive`, `Bounded` or `PositiveDefinite`.
    prior : Normal, optional
        Belief about every entry.
    default : float, array or None, optional
        Value of a field that is not given; None for a parameter that a model may lack.

    Returns
    -------
    dataclass field
        Converts its value to a float64 array at construction.
    """
    return _declare(Setting(unit, group, physical, transform, prior), default)


def coefficients() -> Any:
    """Declare the field of a learned map that holds what the map is linear in, as float64."""
    return _declare(Setting(linear=True))


def physical(
    unit: str = _REQUIRED,
    transform: Transform = _UNCONSTRAINED,
    prior: Normal | None = None,
    *,
    default: Any = _REQUIRED,
    meaning: str = "",
    lowest: float = -np.inf,
) -> Any:
    """Declare a scalar physical parameter, reported with an interval; see `parameter`.

    Parameters
    ----------
    unit, transform, prior, default
        As of `parameter`.
    meaning : str
        What it is, in a few words for a report, such as ``"stator resistance"``.
    lowest : float
        A fit whose interval is not above it is implausible; no constraint on training.
    """
    setting = Setting(unit, "physical", True, transform, prior, meaning=meaning, lowest=lowest)
    return _declare(setting, default)


def delay(*inputs: str, longest: float, prior: Normal | None = None, meaning: str = "") -> Any:
    """Declare a physical parameter, in s, by which inputs act late: the dead time of a plant.

    `Model.derivative` and `Model.output` are given these inputs as they act. Between samples an
    input is interpolated in proportion; before the first sample it is taken to be as there.

    Parameters
    ----------
    *inputs : str
        Of `Model.inputs`, one or several.
    longest : float
        Delay in s that is not reached; a start value must lie between none and it.
    prior, meaning
        As of `physical`.

    Raises
    ------
    InputError
        If no input is named, or the longest is not above zero.
    """
    if not inputs or not 0 < longest < np.inf:
        raise InputError(
            f"{declaring_line() or 'a delay'}: name the inputs it delays, and the longest in s "
            f'above zero, as in penode.delay("power", longest=10.0), got {inputs} and {longest!r}.'
        )
    transform = Bounded(0.0, longest)
    setting = Setting("s", "physical", True, transform, prior, meaning=meaning, delays=inputs)
    return _declare(setting)


def nuisance(unit: str, transform: Transform = _UNCONSTRAINED, prior: Normal | None = None) -> Any:
    """Declare a parameter of which every recording has its own value, such as a sensor offset.

    It moves with the group ``"nuisance"``. The fit keeps the values of every recording in
    ``Fit.nuisances``; its model has their mean.

    Parameters
    ----------
    unit : str
        SI unit.
    transform : Transform
        Constraint, the same in every recording.
    prior : Normal, optional
        Belief about every recording's value.

    Returns
    -------
    dataclass field
    """
    return _declare(
        Setting(unit, "nuisance", transform=transform, prior=prior, per_experiment=True)
    )


def _declare(setting: Setting, default: Any = _REQUIRED) -> Any:
    if problem := _undeclarable(setting.unit, setting.transform, setting.prior):
        raise InputError(f"{declaring_line() or 'a parameter'}: {problem}")
    given = {} if default is _REQUIRED else {"default": default}
    return eqx.field(converter=_float64, metadata={"setting": setting}, **given)


def _undeclarable(unit: Any, transform: Any, prior: Any) -> str:
    """Return what is wrong with a declaration, and the fix; nothing if it is right."""
    if not isinstance(unit, str):
        got = "none" if unit is _REQUIRED else repr(unit)
        return f'the unit must be text, as in penode.physical("kg"), "1" for none, got {got}.'
    if isinstance(transform, type) or not hasattr(transform, "inverse"):
        return f"the transform must be an object, such as Positive(), got {transform!r}."
    if not isinstance(prior, Normal | None):
        return f"the prior must be penode.engine.Normal(mean, deviation), got {prior!r}."
    return ""


def setting_at(model: eqx.Module, path: Sequence[Any]) -> Setting:
    """Return what is known of the leaf at a path of tree keys."""
    node: Any = model
    setting = _DEFAULT
    for key in path:
        if isinstance(key, jax.tree_util.GetAttrKey):
            setting = type(node).__dataclass_fields__[key.name].metadata.get("setting", _DEFAULT)
            node = getattr(node, key.name)
        else:
            node = node[key.idx if hasattr(key, "idx") else key.key]
    return setting


def delays_of(model: eqx.Module) -> list[tuple[str, Any]]:
    """Return the inputs that act late, each with its delay in s as the model has it."""
    leaves = jax.tree_util.tree_leaves_with_path(model)
    return [(name, leaf) for path, leaf in leaves for name in setting_at(model, path).delays]


def settings(model: eqx.Module) -> Any:
    """Return the twin tree: the model's structure with a `Setting` in place of every value."""
    return jax.tree_util.tree_map_with_path(lambda path, _: setting_at(model, path), model)


def with_batch_axis(model: Tree) -> Tree:
    """Return a model, or a tree of such, with one trailing axis of length 1 on every parameter."""
    batched: Tree = jax.tree.map(lambda leaf: leaf[..., None], model)
    return batched
