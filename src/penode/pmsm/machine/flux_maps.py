"""Flux maps: flux linkage and differential inductance as functions of the dq currents."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, float64
from penode.errors import InputError
from penode.models.base import LearnedMap
from penode.models.compositions import Gradient, QuadraticSkip
from penode.models.networks import ConvexGradient, FeatureNetwork, TanhLayers
from penode.models.polynomials import Polynomial
from penode.models.splines import Spline
from penode.native.harmonics import harmonics, rates
from penode.pmsm.machine.coenergy_map import CoenergySplines


class Flux(NamedTuple):
    """A flux map at one angle: psi (2, batch), Vs, L = d psi / d i, H, d psi / d theta, Vs/rad."""

    linkage: JaxArray
    inductance: JaxArray
    angle_slope: JaxArray


class FluxMap(eqx.Module):
    """A learned map between scaled currents and scaled flux linkages.

    With angle orders its features are cos(n theta) and sin(n theta) of each order n; if the learned
    map is the gradient of a scalar at each of their values, there is one coenergy at every angle.

    Attributes
    ----------
    network : LearnedMap
        Dimensionless map from 2 inputs to 2 outputs with its Jacobian.
    current_scale : float
        A (peak) for one unit of the learned map's input.
    flux_scale : float
        Vs for one unit of the learned map's output.
    angle_orders : tuple of int
        Harmonics of the electrical angle in the map; none by default. They need a learned map with
        two features an order.
    """

    network: LearnedMap
    current_scale: float = eqx.field(static=True)
    flux_scale: float = eqx.field(static=True)
    angle_orders: tuple[int, ...] = eqx.field(static=True, default=())

    def flux_and_inductance(self, currents: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return psi (2, batch) in Vs and L = d psi / d i (2, 2, batch) in H, angle averaged.

        Parameters
        ----------
        currents : array, shape (2, batch)
            i_d and i_q in A (peak).
        """
        x = currents / self.current_scale
        if not self.angle_orders or getattr(self.network, "linear_in_features", False):
            value, jacobian = self.network.value_and_jacobian(x)
        else:
            over_a_period = self._features(self._one_period())[0].T[..., None]
            every = jax.vmap(partial(self._network_at, x))(over_a_period)
            value, jacobian = (jnp.mean(part, axis=0) for part in every)
        return self.flux_scale * value, self.flux_scale / self.current_scale * jacobian

    def mean(self, currents: JaxArray) -> Flux:
        """Return the map averaged over the angle at currents (2, batch) in A (peak)."""
        linkage, inductance = self.flux_and_inductance(currents)
        return Flux(linkage, inductance, jnp.zeros_like(linkage))

    def at_angle(self, currents: JaxArray, theta_el: JaxArray) -> Flux:
        """Return the map at an angle.

        Parameters
        ----------
        currents : array, shape (2, batch)
            i_d and i_q in A (peak).
        theta_el : array, shape (batch,)
            Electrical angle of the d axis in rad.
        """
        x = currents / self.current_scale
        if not self.angle_orders:
            return self.mean(currents)
        features, rates = self._features(theta_el)
        if isinstance(self.network, CoenergySplines):
            value, jacobian = self.network.value_and_jacobian(x, features)
            slope = self.network.slope(x, rates)
        else:
            at_angle = partial(self._network_at, x)
            (value, jacobian), (slope, _) = jax.jvp(at_angle, (features,), (rates,))
        scale = self.flux_scale
        return Flux(scale * value, scale / self.current_scale * jacobian, scale * slope)

    def averaged(self) -> "FluxMap":
        """Return the angle average of a plain map as one without orders.

        Splines keep their mean, networks each unit once an angle. It equals `flux_and_inductance`,
        for those who want to write the map down.
        """
        network = self.network
        if isinstance(network, CoenergySplines):
            return FluxMap(CoenergySplines(network.mean), self.current_scale, self.flux_scale)
        if not self.angle_orders or not isinstance(network, TanhLayers | ConvexGradient):
            return self
        with float64():
            features = np.asarray(self._features(self._one_period())[0])
        if isinstance(network, TanhLayers):
            return FluxMap(_mean_layers(network, features), self.current_scale, self.flux_scale)
        return FluxMap(_mean_gradient(network, features), self.current_scale, self.flux_scale)

    def _network_at(self, x: JaxArray, features: JaxArray) -> tuple[JaxArray, JaxArray]:
        if isinstance(self.network, FeatureNetwork):
            return self.network.value_and_jacobian(x, features)
        return self.network.value_and_jacobian(x)

    def _features(self, theta_el: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return cos and sin of the orders and their slopes over the angle, (feature, batch)."""
        waves = harmonics(self.angle_orders, theta_el)
        return waves, rates(self.angle_orders, waves)

    def _one_period(self) -> JaxArray:
        """Return angles (angle,) in rad, evenly over the period of the harmonics."""
        common = math.gcd(*self.angle_orders)
        count = _ANGLES * max(self.angle_orders) // common
        return jnp.asarray(2 * np.pi / common * np.arange(count) / count)


#: Angles a period of the highest order in the average over the angle.
_ANGLES = 6


def _mean_gradient(network: ConvexGradient, features: FloatArray) -> ConvexGradient:
    """Return the mean of a network over features (feature, angle) as one without."""
    count = features.shape[1]
    shifted = np.asarray(network.bias)[:, None] + np.asarray(network.modulation) @ features
    return replace(
        network,
        directions=np.repeat(network.directions, count, axis=0),
        bias=shifted.ravel(),
        gain=np.repeat(network.gain, count) / count,
        modulation=None,
    )


def _mean_layers(network: TanhLayers, features: FloatArray) -> TanhLayers:
    """Return the mean of a network over features (feature, angle) as one without."""
    count = features.shape[1]
    (first, *hidden, last), (shift, *inner, bias) = network.weights, network.biases
    inputs = np.shape(first)[1] - len(features)
    shifts = np.asarray(shift) + (np.asarray(first)[:, inputs:] @ features).T
    weights = [
        np.tile(np.asarray(first)[:, :inputs], (count, 1)),
        *(np.kron(np.eye(count), part) for part in hidden),
        np.tile(np.asarray(last) / count, (1, count)),
    ]
    biases = [shifts.ravel(), *(np.tile(part, count) for part in inner), np.asarray(bias)]
    return TanhLayers(tuple(weights), tuple(biases))


@dataclass(frozen=True)
class FluxMapKind:
    """A family of flux maps a user can name."""

    # ``draw(seed)`` gives an untrained learned map.
    draw: Callable[[int], LearnedMap]
    # By construction; without it a map absorbs a wrong R at constant speed (the gauge).
    reciprocal: bool
    # ``draw_with_features(seed, features)`` gives one that can follow the rotor's angle.
    draw_with_features: Callable[[int, int], FeatureNetwork] | None = None
    # Whether training starts from a draw; if not, from the weak form's own coefficients.
    drawn: bool = True


#: To add a family, add one entry; its learned map needs `value_and_jacobian`.
FLUX_MAPS: dict[str, FluxMapKind] = {
    "coenergy": FluxMapKind(
        lambda seed: CoenergySplines.linear(),
        reciprocal=True,
        draw_with_features=lambda seed, features: CoenergySplines.linear(features // 2),
        drawn=False,
    ),
    "convex": FluxMapKind(
        lambda seed: ConvexGradient.random(2, 12, seed),
        reciprocal=True,
        draw_with_features=lambda seed, features: ConvexGradient.random(2, 16, seed, features),
    ),
    "mlp": FluxMapKind(
        lambda seed: TanhLayers.random((2, 6, 4, 2), seed),
        reciprocal=False,
        draw_with_features=lambda seed, features: TanhLayers.random((2 + features, 12, 6, 2), seed),
    ),
    "polynomial": FluxMapKind(lambda seed: _reciprocal(Polynomial.zero(2, 1, 8)), reciprocal=True),
    "spline": FluxMapKind(
        lambda seed: _reciprocal(Spline.zero((-1.0, -1.0), (1.0, 1.0), (5, 5), 1)), reciprocal=True
    ),
}


def _reciprocal(coenergy: LearnedMap) -> Gradient:
    """Return the gradient of a coenergy beside a quadratic one, which is linear in the currents."""
    return Gradient(QuadraticSkip(coenergy, linear=np.zeros(2), matrix=0.3 * np.eye(2)))


def draw_flux_map(
    kind: str, seed: int, scales: tuple[float, float], angle_orders: tuple[int, ...] = ()
) -> FluxMap:
    """Draw an untrained flux map of a kind; one without features has no harmonics of the angle.

    `scales` are the largest current, A, and the largest flux linkage, Vs.
    """
    family = FLUX_MAPS[kind]
    if angle_orders and family.draw_with_features is not None:
        network = family.draw_with_features(seed, 2 * len(angle_orders))
        return FluxMap(network, *scales, angle_orders)
    return FluxMap(family.draw(seed), *scales)


#: Beyond the harmonics of any winding and slots.
_HIGHEST_ORDER = 1000


def check_angle_orders(kind: str, angle_orders: tuple[int, ...]) -> None:
    """Refuse orders other than distinct whole numbers from 1 to 1000, or of a map without angle."""
    if not angle_orders:
        return
    if len({*angle_orders} & {*range(1, _HIGHEST_ORDER + 1)}) < len(angle_orders):
        raise InputError(
            f"angle orders must be distinct whole numbers from 1 to {_HIGHEST_ORDER}, such as "
            f"6,12, got {', '.join(map(str, angle_orders))[:200]}."
        )
    able = [name for name, family in FLUX_MAPS.items() if family.draw_with_features is not None]
    if kind not in able:
        raise InputError(
            f"the flux map {kind!r} cannot follow angle orders; use "
            f"--flux-map {' or '.join(able)}, or leave the orders out."
        )
