"""Current references and speeds over time, drawn for a log."""

from collections.abc import Callable

import numpy as np

Reference = Callable[[np.ndarray], np.ndarray]


def wander(amplitude: float, random: np.random.Generator, most: float = 15.0) -> Reference:
    """Return a wander of both axes by six sines each, of up to `most` Hz, within an amplitude."""
    rates = 2 * np.pi * random.uniform(0.15 * most, most, (2, 6))
    phases, weights = random.uniform(0, 2 * np.pi, (2, 6)), random.uniform(0.5, 1, (2, 6))

    def at(times: np.ndarray) -> np.ndarray:
        waves = np.sin(rates[..., None] * times + phases[..., None]) * weights[..., None]
        d, q = np.tanh(0.8 * waves.sum(1))
        return amplitude * (0.8 * d - 0.1 + 0.9j * q) / 1.2

    return at


def pulses(amplitude: float, random: np.random.Generator) -> Reference:
    """Return a fast wander in 25 ms of every 500 ms, no current else."""
    fast, begin = wander(amplitude, random, 60.0), random.uniform(0.05, 0.4)
    return lambda times: np.where(np.mod(times - begin, 0.5) < 0.025, fast(times), 0)


def torque(amplitude: float, random: np.random.Generator) -> Reference:
    """Return levels of i_q reached by ramps, with i_d = -0.4 |i_q| - 0.1 of the amplitude."""
    ends = np.cumsum(random.uniform(0.3, 1.5, 200))
    levels = amplitude * random.uniform(-0.9, 0.9, 200)
    points = np.stack([ends, ends + random.uniform(0.03, 0.2, 200)]).T.ravel()
    values = np.stack([np.roll(levels, 1), levels]).T.ravel()

    def at(times: np.ndarray) -> np.ndarray:
        q = np.interp(times, points, values)
        return -0.4 * np.abs(q) - 0.1 * amplitude + 1j * q

    return at


def constant(speed: float, times: np.ndarray, _random: np.random.Generator) -> np.ndarray:
    """Return the speed itself."""
    return np.full(len(times), speed)


def cycle(speed: float, times: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return speeds between 5 % and all of the largest one, reached within seconds."""
    points = np.cumsum(random.uniform(1.0, 3.0, 40))
    levels = speed * random.uniform(0.05, 1.0, 40)
    width = max(1, round(0.3 / (times[1] - times[0])))
    ramps = np.interp(times, points, levels)
    padded = np.pad(ramps, width, mode="edge")
    smooth = np.convolve(padded, np.full(2 * width + 1, 1 / (2 * width + 1)), mode="valid")
    return smooth[: len(times)]


REFERENCES: dict[str, Callable[[float, np.random.Generator], Reference]] = {
    "wander": wander,
    "pulses": pulses,
    "torque": torque,
}
PROFILES = {"constant": constant, "cycle": cycle}
