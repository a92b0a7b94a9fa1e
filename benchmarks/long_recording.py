"""A recording of any length, written in pieces: ``python -m benchmarks.long_recording 1e7 FILE``.

The currents are given, so that nothing has to be stepped through: the voltage held over a sample is
the mean of R i + d psi/dt + omega J psi over it. Speed and amplitude wander over minutes.
"""

import sys
import tempfile
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import polars as pl

from penode.arrays import FloatArray, JaxArray, float64
from penode.bench.machines import TRACTION_300A

TIME_STEP = 1e-4
#: Sample from which currents are noisy by so many A.
NOISE = 0.1
PIECE = 1 << 19
_AMPLITUDE, _SPEED = 200.0, 800.0
_FAST = (14.0, 15.0)  # rad/s, of the currents
_SLOW = (0.07, 0.05)  # rad/s, of amplitude and speed


def channels(first: int, count: int, seed: int = 0) -> dict[str, FloatArray]:
    """Return the columns of some samples of the recording, which none of the others change.

    Parameters
    ----------
    first, count : int
        Samples.
    seed : int
        Of the noise.
    """
    with float64():
        t = jnp.arange(first, first + count) * TIME_STEP
        held = np.asarray(_held_voltage(t))
        current, speed, angle = (np.asarray(part) for part in _at(t))
    noise = np.random.default_rng([seed, first]).normal(0.0, NOISE, current.shape)
    i_d, i_q = current + noise
    return {
        "t": np.asarray(t),
        "u_d": held[0],
        "u_q": held[1],
        "i_d": i_d,
        "i_q": i_q,
        "omega_el": speed,
        "theta_el": np.mod(angle, 2 * np.pi),
    }


def _at(t: JaxArray) -> tuple[JaxArray, JaxArray, JaxArray]:
    """Return currents (2, time) in A, speed in rad/s and angle in rad."""
    amplitude = _AMPLITUDE * (0.8 + 0.2 * jnp.sin(_SLOW[0] * t))
    quadrature = amplitude * jnp.sin(_FAST[1] * t)
    direct = amplitude * jnp.cos(_FAST[1] * t) * jnp.sin(_FAST[0] * t)
    speed = _SPEED * (1 + 0.5 * jnp.sin(_SLOW[1] * t))
    angle = _SPEED * (t + 0.5 * (1 - jnp.cos(_SLOW[1] * t)) / _SLOW[1])
    return jnp.stack([direct, quadrature]), speed, angle


@jax.jit
def _held_voltage(t: JaxArray) -> JaxArray:
    """Return the mean voltage (2, time) from each sample to the next, by Simpson's rule."""
    gradient = jax.vmap(jax.grad(TRACTION_300A.coenergy, argnums=(0, 1)))

    def parts(t: JaxArray) -> tuple[JaxArray, JaxArray]:
        current, speed, angle = _at(t)
        psi = jnp.stack(gradient(*current, angle))
        turned = speed * jnp.stack([-psi[1], psi[0]])
        return psi, TRACTION_300A.resistance * current + turned

    (before, first), (_, middle), (after, last) = (
        parts(t + part * TIME_STEP) for part in (0.0, 0.5, 1.0)
    )
    return (after - before) / TIME_STEP + (first + 4 * middle + last) / 6


def write(path: Path, samples: int, piece: int = PIECE) -> None:
    """Write so many samples to a Parquet file, a piece in memory at a time."""
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        for number, first in enumerate(range(0, samples, piece)):
            rows = pl.DataFrame(channels(first, min(piece, samples - first)))
            rows.write_parquet(Path(folder) / f"{number:06d}.parquet")
        whole = pl.scan_parquet(f"{folder}/*.parquet")
        whole.sink_parquet(path, row_group_size=piece)


if __name__ == "__main__":
    write(Path(sys.argv[2]), int(float(sys.argv[1])))
