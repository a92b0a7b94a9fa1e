"""Model: state derivative, learned maps and their names, as one pytree of parameters."""

import inspect
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import Field
from functools import partial
from types import MappingProxyType
from typing import Any, ClassVar, Protocol

import equinox as eqx

from penode.arrays import JaxArray
from penode.errors import InputError
from penode.models.inputs import Inputs

#: A field of the model annotated so is a constant of it.
_FIXED = (float, int, bool, str)


class Model(eqx.Module):
    """An ordinary differential equation x' = f(x, u, theta) with learned and physical parameters.

    Write a subclass with its parameters as fields (see `penode.models.parameters.parameter`) and
    one method, `derivative`, which may take time as its third argument. Inside compiled code every
    parameter carries one trailing batch axis, of length 1 or batch, so that plain arithmetic with
    ``x[0]`` broadcasts: ``-self.R * x[0]`` is right as written. A field of the model annotated
    ``float``, ``int``, ``bool`` or ``str`` is a constant and is not trained.

    Class attributes
    ----------------
    states, inputs : tuple of str
        Channel names of the state x and the input u, in the order of their rows.
    state_units : tuple of str
        SI units of the states.
    input_rates : mapping of str to str
        Inputs that go on between samples, such as the angle of a rotor, and for each the input that
        is its rate of change (none by default). All others act as the hold says.
    unmeasured : tuple of str
        States that no sensor measures (none by default): nothing is compared with them, and each
        window estimates where they start. A channel of that name is taken as a first guess.
    outputs : mapping of str to str
        Channels that sensors measure and their SI units, where states are not measured as they are
        (none by default): y = h(x, u, theta), the method `output`. They are then all that is
        compared, and every start is estimated. A state that is measured as well is an output of its
        own name; of the others a channel, if there is one, is a first guess.
    map_units : mapping of str to str
        SI units of what `maps` return, for figures (none by default).
    """

    states: ClassVar[tuple[str, ...]]
    state_units: ClassVar[tuple[str, ...]]
    unmeasured: ClassVar[tuple[str, ...]] = ()
    outputs: ClassVar[Mapping[str, str]] = MappingProxyType({})
    input_rates: ClassVar[Mapping[str, str]] = MappingProxyType({})
    map_units: ClassVar[Mapping[str, str]] = MappingProxyType({})

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        for name, kind in inspect.get_annotations(cls).items():
            default = cls.__dict__.get(name, inspect.Parameter.empty)
            if kind in (*_FIXED, *(k.__name__ for k in _FIXED)) and not isinstance(default, Field):
                given = {} if default is inspect.Parameter.empty else {"default": default}
                number = {"converter": partial(_number, name)} if kind in (float, "float") else {}
                setattr(cls, name, eqx.field(static=True, **number, **given))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Channel names of the input u; a class attribute where they do not depend on fields."""
        raise InputError(
            f'{type(self).__name__} has no inputs; name their channels, as in inputs = ("force",),'
            " or write inputs = () where there are none."
        )

    @abstractmethod
    def derivative(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return dx/dt; write ``derivative(self, x, u, t)`` where time acts by itself.

        Time t, shape (batch,), is in s since the first sample of the recording, `Experiment.times`.

        Parameters
        ----------
        x : array, shape (state, batch)
            State, SI units.
        u : Inputs, rows of shape (batch,)
            Input, SI units: ``u["force"]``, or ``u[0]`` in the order of `inputs`.

        Returns
        -------
        array, shape (state, batch)
            State derivative, SI units per second.
        """

    def output(self, x: JaxArray, u: Inputs) -> JaxArray:
        """Return what the sensors read, y = h(x, u, theta), where `outputs` are declared.

        It may take t as `derivative` does.

        Parameters
        ----------
        x : array, shape (state, batch)
            State at the sample, SI units.
        u : Inputs, rows of shape (batch,)
            Input at the sample, SI units, as recorded there.

        Returns
        -------
        array, shape (output, batch)
            A row for each of `outputs`, in their order and units.
        """
        raise InputError(
            f"{type(self).__name__} has outputs, but no method `output`; write output(self, x, u), "
            "which returns a row for each of them: jnp.stack([...])."
        )

    @property
    def covariances(self) -> tuple[str, ...]:
        """States that are covariances of a filter: zero where a window starts (none by default)."""
        return ()

    def filtered(self, x: JaxArray, measured: JaxArray, u: Inputs) -> JaxArray:
        """Return the states (state, batch) behind what was measured at a sample (quantity, batch).

        All in SI units. By default they stay; see `penode.engine.ExtendedKalman`.
        """
        return x

    @property
    def encoded_samples(self) -> int:
        """Samples by which an encoder says where a window starts (0, none, by default)."""
        return 0

    def encoded(self, measured: JaxArray, inputs: JaxArray) -> JaxArray:
        """Return the states (state, batch) where a window starts, by its past samples.

        Measured values (sample, quantity, batch) and inputs (sample, input, batch), SI units, the
        newest sample first; see `penode.engine.Encoded`.
        """
        raise NotImplementedError

    def learned(self, x: JaxArray) -> JaxArray:
        """Return the output (output, batch) of the learned part at states (state, batch).

        Training stops when this map stands still over the excited region, and its deviation is
        weighed when the horizon is chosen. The default is an empty map; any unit will do.
        """
        return x[:0]

    def corrected(self, measured: JaxArray) -> JaxArray:
        """Return the states behind what the sensors read, (state, batch); by default the same.

        A model of sensor offsets, say, returns ``measured - self.offset`` with a field declared by
        `penode.nuisance`. Predictions start from these states and are compared with them.
        """
        return measured

    def stored(self, x: JaxArray) -> JaxArray:
        """Return what the equation balances: s in ds/dt = supply, by default the states.

        A machine stores flux linkage: a residual in this domain weighs voltages, one in the
        states' weighs currents. States are (state, batch), and so is what is stored, of any unit.
        """
        return x

    def maps(self) -> Mapping[str, Callable[..., Any]]:
        """Return the learned maps by name, as functions of NumPy arrays (none by default).

        Arguments named after states, as in ``lambda speed: ...``, say over which of them a map is
        drawn.
        """
        return {}


def _number(name: str, value: Any) -> Any:
    """Return a constant's value, such as an array's only one, as a number that compares."""
    try:
        return None if value is None else float(value)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be one number, got {value!r}.") from None


class LearnedMap(Protocol):
    """A map from n inputs to m outputs, an `equinox.Module` of trained and static fields."""

    def value_and_jacobian(self, x: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return the value (m, batch) and its Jacobian (m, n, batch) at x (n, batch)."""


def floats(values: Iterable[float]) -> tuple[float, ...]:
    """Return plain numbers as a tuple: static fields are compared and hashed."""
    return tuple(map(float, values))
