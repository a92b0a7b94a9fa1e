"""Current references and speed profiles: functions of time drawn for a recording."""

from collections.abc import Callable

import numpy as np

#: Current reference i_d + j i_q in A, and speed of the shaft in rad/s, over time in s.
Reference = Callable[[float], complex]
Profile = Callable[[float], float]


def wander(amplitude: float, _sign: float, random: np.random.Generator) -> Reference:
    """Return a Lissajous figure over the whole square of an amplitude."""
    rate_d, rate_q = 2 * np.pi * random.uniform(5, 15, 2)
    shift = random.uniform(0, 2 * np.pi)
    return lambda t: amplitude * (np.sin(rate_d * t) + 1j * np.sin(rate_q * t + shift))


def only_q(amplitude: float, _sign: float, random: np.random.Generator) -> Reference:
    """Return a sweep of i_q alone."""
    rate = 2 * np.pi * random.uniform(5, 15)
    return lambda t: 1j * amplitude * np.sin(rate * t)


def generator(amplitude: float, sign: float, random: np.random.Generator) -> Reference:
    """Return a Lissajous figure in the quadrant of braking: i_d < 0, i_q against the speed."""
    figure = wander(0.5 * amplitude, sign, random)
    middle = amplitude * (-0.5 - 0.5j * sign)
    return lambda t: middle + figure(t)


def steps(amplitude: float, _sign: float, random: np.random.Generator) -> Reference:
    """Return steps of i_q every 60 ms, with i_d in proportion to |i_q|."""
    levels = amplitude * random.uniform(-1, 1, 40)
    ratio = random.uniform(0.3, 0.8)
    return lambda t: complex(-ratio * abs(levels[int(t / 0.06)]), levels[int(t / 0.06)])


def constant(speed: float, _duration: float) -> Profile:
    """Return the speed itself."""
    return lambda t: speed


def ramp(speed: float, duration: float) -> Profile:
    """Return a ramp from a fifth of the speed to all of it."""
    return lambda t: speed * min(0.2 + 0.8 * t / duration, 1.0)


def swing(speed: float, _duration: float) -> Profile:
    """Return the speed with an oscillation of 15 % at 4 Hz."""
    return lambda t: speed * (1 + 0.15 * np.sin(2 * np.pi * 4 * t))


REFERENCES: dict[str, Callable[[float, float, np.random.Generator], Reference]] = {
    "wander": wander,
    "only q": only_q,
    "generator": generator,
    "steps": steps,
}
PROFILES: dict[str, Callable[[float, float], Profile]] = {
    "constant": constant,
    "two": constant,
    "ramp": ramp,
    "swing": swing,
}
