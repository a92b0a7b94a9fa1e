"""The shaft: held by a load machine to a given speed, or moved by the torques on it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeAlias

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

    Attributes
    ----------
    times : tuple of float
        Times of the points in s, increasing.
    rpm : tuple of float
        Mechanical speed at them in revolutions per minute. Two points of opposite sign make a
        reversal.
    """

    times: tuple[float, ...]
    rpm: tuple[float, ...]

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the speed at the given times.

        Parameters
        ----------
        time : ndarray, shape (time,)
            Times in s.

        Returns
        -------
        ndarray, shape (time,)
            Mechanical speed in rpm.
        """
        return np.interp(time, self.times, self.rpm)


@dataclass(frozen=True)
class SpeedRipple:
    """A speed that truly wavers once or more a revolution, as a misaligned coupling makes it.

    ``n(t) = n_0 (1 + sum_m a_m cos(m theta_mech + phi_m))``, theta_mech the angle at the speed n_0.

    Attributes
    ----------
    rpm : float
        Mean mechanical speed n_0 in revolutions per minute.
    orders : tuple of (float, float, float)
        ``(m, a_m, phi_m)``: mechanical order, amplitude over the mean speed, phase in rad.
    """

    rpm: float
    orders: tuple[tuple[float, float, float], ...]

    def __call__(self, time: FloatArray) -> FloatArray:
        """Return the speed at the given times.

        Parameters
        ----------
        time : ndarray, shape (time,)
            Times in s.

        Returns
        -------
        ndarray, shape (time,)
            Mechanical speed in rpm.
        """
        angle = RPM * self.rpm * time
        share = sum((a * np.cos(m * angle + phi) for m, a, phi in self.orders), np.zeros_like(time))
        return np.asarray(self.rpm * (1.0 + share), dtype=np.float64)


class FreeShaft(eqx.Module):
    """A shaft that the torques move: ``J d(Omega)/dt = T - T_load - b Omega``, Omega mechanical.

    Attributes
    ----------
    inertia : float
        J of rotor and load in kg m^2.
    load_torque : float
        Constant load in Nm, positive against forward rotation (it drives a rotor that turns
        backwards).
    friction : float
        Viscous friction b in Nm s/rad.
    start_rpm : float
        Mechanical speed at the start in revolutions per minute.
    """

    inertia: float
    load_torque: float = 0.0
    friction: float = 0.0
    start_rpm: float = 0.0

    def acceleration(self, torque: JaxArray, speed: JaxArray) -> JaxArray:
        """Return d(Omega)/dt.

        Parameters
        ----------
        torque : array, shape ()
            Air-gap torque in Nm.
        speed : array, shape ()
            Mechanical speed Omega in rad/s.

        Returns
        -------
        array, shape ()
            Mechanical acceleration in rad/s^2.
        """
        return (torque - self.load_torque - self.friction * speed) / self.inertia


class Motion(NamedTuple):
    """The shaft at the sampling instants (time,): electrical rad, rad/s and rad/s^2."""

    # Starts anew after a whole mechanical turn.
    theta_el: Leaf
    omega_el: Leaf
    # Of the speed, until the next instant.
    slope: Leaf


class Shaft(Protocol):
    """What moves the rotor, in electrical quantities."""

    def at_sample(
        self, moved: tuple[JaxArray, JaxArray], given: Motion
    ) -> tuple[JaxArray, JaxArray]:
        """Return angle (rad) and speed (rad/s) at a sample, from the integrated or the given."""

    def slope(
        self, torque: Callable[[], JaxArray], omega_el: JaxArray, given: JaxArray
    ) -> JaxArray:
        """Return d(omega_el)/dt in rad/s^2: the ``given`` one, or the torque's.

        ``torque`` returns the torque a pole pair in Nm.
        """


class HeldShaft(eqx.Module):
    """A load machine strong enough to keep the given speed, which is straight between samples."""

    def at_sample(
        self, moved: tuple[JaxArray, JaxArray], given: Motion
    ) -> tuple[JaxArray, JaxArray]:
        """Return the given angle in rad and speed in rad/s; see `Shaft`."""
        return jnp.asarray(given.theta_el), jnp.asarray(given.omega_el)

    def slope(
        self, torque: Callable[[], JaxArray], omega_el: JaxArray, given: JaxArray
    ) -> JaxArray:
        """Return the given acceleration in rad/s^2; see `Shaft`."""
        return given


class MovedShaft(eqx.Module):
    """A free shaft, in electrical quantities."""

    free: FreeShaft
    pole_pairs: float

    def at_sample(
        self, moved: tuple[JaxArray, JaxArray], given: Motion
    ) -> tuple[JaxArray, JaxArray]:
        """Return the integrated angle in rad and speed in rad/s; see `Shaft`."""
        return jnp.mod(moved[0], 2.0 * np.pi * self.pole_pairs), moved[1]

    def slope(
        self, torque: Callable[[], JaxArray], omega_el: JaxArray, given: JaxArray
    ) -> JaxArray:
        """Return what the torques do to the speed, in rad/s^2; see `Shaft`."""
        mechanical = omega_el / self.pole_pairs
        total = self.pole_pairs * torque()
        return self.pole_pairs * self.free.acceleration(total, mechanical)


#: A constant mechanical speed in rpm, one that is given over time, or a shaft free to turn.
Speed: TypeAlias = float | SpeedProfile | FreeShaft


def given_motion(
    profile: SpeedProfile, instants: FloatArray, time_step: float, pole_pairs: int
) -> Motion:
    """Return the motion at a speed profile, s to mechanical rpm; the angle starts at 0.

    The angle is the exact integral of the speed between the samples; `instants` (time + 1,), s,
    include the end of the last interval.
    """
    omega = RPM * pole_pairs * np.asarray(profile(instants), dtype=np.float64)
    steps = time_step * (omega[1:] + omega[:-1]) / 2.0
    theta = np.concatenate([[0.0], np.cumsum(steps)[:-1]])
    return Motion(np.mod(theta, 2.0 * np.pi * pole_pairs), omega[:-1], np.diff(omega) / time_step)


def steady_motion(rpm: float, instants: FloatArray, pole_pairs: int) -> Motion:
    """Return the motion at one mechanical speed in rpm, the angle speed times time."""
    omega_el = RPM * rpm * pole_pairs
    theta = np.mod(omega_el * instants, 2.0 * np.pi * pole_pairs)
    return Motion(theta, np.full_like(instants, omega_el), np.zeros_like(instants))


def shaft_of(
    speed: Speed, instants: FloatArray, time_step: float, pole_pairs: int
) -> tuple[Shaft, Motion]:
    """Return what moves the rotor at a speed (mechanical rpm), and its motion as far as given.

    `instants` (time + 1,), s, include the end of the last interval. The motion has one row a
    sample; of a free shaft only the first counts.
    """
    if isinstance(speed, FreeShaft):
        start = steady_motion(speed.start_rpm, instants[:-1], pole_pairs)
        return MovedShaft(speed, float(pole_pairs)), start
    if callable(speed):
        return HeldShaft(), given_motion(speed, instants, time_step, pole_pairs)
    return HeldShaft(), steady_motion(speed, instants[:-1], pole_pairs)
