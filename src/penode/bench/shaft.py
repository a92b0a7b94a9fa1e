"""The shaft: held by a load machine to a given speed, or moved by the torques on it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray, Leaf

#: Takes times in s, shape (time,), and returns the mechanical speed in rpm, shape (time,).
SpeedProfile: TypeAlias = Callable[[FloatArray], FloatArray]

#: Revolutions per minute to rad/s.
RPM = 2.0 * np.pi / 60.0


@dataclass(frozen=True)
class SpeedPoints:
    """A speed through given points, straight between them and constant beyond.

    Two points of opposite sign make a reversal.
    """

    # s, increasing.
    times: tuple[float, ...]
    # Mechanical speed at them.
    rpm: tuple[float, ...]

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the mechanical speed, rpm, at times in s."""
        return np.interp(time, self.times, self.rpm)


@dataclass(frozen=True)
class SpeedRipple:
    """A speed that truly wavers once or more a revolution, as a misaligned coupling makes it.

    ``n(t) = n_0 (1 + sum_m a_m cos(m theta_mech + phi_m))``, theta_mech the angle at the speed n_0.
    """

    # n_0, mechanical.
    rpm: float
    # (m, a_m, phi_m): mechanical order, amplitude over the mean speed, phase in rad.
    orders: tuple[tuple[float, float, float], ...]

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the mechanical speed, rpm, at times in s."""
        angle = RPM * self.rpm * time
        share = sum((a * np.cos(m * angle + phi) for m, a, phi in self.orders), np.zeros_like(time))
        return np.asarray(self.rpm * (1.0 + share), dtype=np.float64)


class FreeShaft(eqx.Module):
    """A shaft that the torques move: ``J d(Omega)/dt = T - T_load - b Omega``, Omega mechanical."""

    # J of rotor and load, kg m^2.
    inertia: float
    # Nm, positive against forward rotation: it drives a rotor that turns backwards.
    load_torque: float = 0.0
    # Viscous friction b, Nm s/rad.
    friction: float = 0.0
    # Mechanical.
    start_rpm: float = 0.0

    def acceleration(self, torque: JaxArray, speed: JaxArray) -> JaxArray:
        """Return d(Omega)/dt, rad/s^2, at an air-gap torque, Nm, and a mechanical speed, rad/s."""
        return (torque - self.load_torque - self.friction * speed) / self.inertia


class Motion(NamedTuple):
    """The shaft at the sampling instants (time,): electrical rad, rad/s and rad/s^2."""

    # Starts anew after a whole mechanical turn.
    theta_el: Leaf
    omega_el: Leaf
    # Of the speed, until the next instant.
    slope: Leaf


class Shaft(eqx.Module):
    """What moves the rotor, in electrical quantities.

    A load machine strong enough to keep the given speed, which is straight between samples, or the
    torques on a free shaft.
    """

    free: FreeShaft | None = None
    pole_pairs: float = 1.0

    def at_sample(
        self, moved: tuple[JaxArray, JaxArray], given: Motion
    ) -> tuple[JaxArray, JaxArray]:
        """Return angle (rad) and speed (rad/s) at a sample: the integrated, or the given ones."""
        if self.free is None:
            return jnp.asarray(given.theta_el), jnp.asarray(given.omega_el)
        return jnp.mod(moved[0], 2.0 * np.pi * self.pole_pairs), moved[1]

    def slope(
        self, torque: Callable[[], JaxArray], omega_el: JaxArray, given: JaxArray
    ) -> JaxArray:
        """Return d(omega_el)/dt, rad/s^2: the ``given`` one, or that of the torque a pole pair."""
        if self.free is None:
            return given
        mechanical = omega_el / self.pole_pairs
        total = self.pole_pairs * torque()
        return self.pole_pairs * self.free.acceleration(total, mechanical)


#: A constant mechanical speed in rpm, one that is given over time, or a shaft free to turn.
Speed: TypeAlias = float | SpeedProfile | FreeShaft


def shaft_of(
    speed: Speed, instants: FloatArray, time_step: float, pole_pairs: int
) -> tuple[Shaft, Motion]:
    """Return what moves the rotor at a speed (mechanical rpm), and its motion as far as given.

    `instants` (time + 1,), s, include the end of the last interval. The motion has one row a
    sample and starts at angle 0; of a free shaft only the first row counts.
    """
    if isinstance(speed, FreeShaft):
        start = _steady_motion(speed.start_rpm, instants, pole_pairs)
        return Shaft(speed, float(pole_pairs)), start
    if not callable(speed):
        return Shaft(), _steady_motion(speed, instants, pole_pairs)
    omega = RPM * pole_pairs * np.asarray(speed(instants), dtype=np.float64)
    # The angle is the exact integral of the speed between the samples.
    steps = time_step * (omega[1:] + omega[:-1]) / 2.0
    theta = np.mod(np.concatenate([[0.0], np.cumsum(steps)[:-1]]), 2.0 * np.pi * pole_pairs)
    return Shaft(), Motion(theta, omega[:-1], np.diff(omega) / time_step)


def _steady_motion(rpm: float, instants: FloatArray, pole_pairs: int) -> Motion:
    """Return the motion at one mechanical speed, the angle speed times time."""
    omega_el, time = RPM * rpm * pole_pairs, instants[:-1]
    theta = np.mod(omega_el * time, 2.0 * np.pi * pole_pairs)
    return Motion(theta, np.full_like(time, omega_el), np.zeros_like(time))
