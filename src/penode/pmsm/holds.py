"""Holds of a drive: what stands still between two samples, and what the rotor turns on under it.

The input's rows are u_d, u_q (V), omega_el (rad/s) and, where the model asks for it, theta_el
(rad). Within a sample of length T the rotor turns by omega T share, so the angle moves on even
where the voltage is constant.
"""

from dataclasses import dataclass

import jax.numpy as jnp

from penode.arrays import JaxArray
from penode.errors import InputError
from penode.predictors.holds import Drive, Hold


@dataclass(frozen=True)
class RotorFrame:
    """Voltage held in the rotating frame: u_d and u_q are constant from each sample to the next."""

    def __call__(self, drive: Drive, sample: int, share: float, time_step: float) -> JaxArray:
        """Return the input (input, batch), its angle turned on; see `penode.predictors.holds`."""
        u = drive(sample)
        return u if share == 0.0 else jnp.concatenate([u[:3], _turned_on(u, share * time_step)])


@dataclass(frozen=True)
class StationaryFrame:
    """Voltage held by an inverter, constant in alpha and beta: it falls behind the rotor.

    Seen from the rotor it turns by -omega T from each sample to the next; u_d and u_q of a row are
    those at the sample itself.
    """

    def __call__(self, drive: Drive, sample: int, share: float, time_step: float) -> JaxArray:
        """Return the input (input, batch), voltage turned back and angle turned on."""
        u = drive(sample)
        if share == 0.0:
            return u
        turn = u[2] * (share * time_step)
        cosine, sine = jnp.cos(turn), jnp.sin(turn)
        voltage = jnp.stack([u[0] * cosine + u[1] * sine, u[1] * cosine - u[0] * sine])
        return jnp.concatenate([voltage, u[2:3], _turned_on(u, share * time_step)])


def _turned_on(u: JaxArray, time: float) -> JaxArray:
    """Return theta_el (1, batch) after a time in s, or no row where the input has none."""
    return u[3:] + u[2] * time


#: Frame in which the voltage stands still -> hold.
HOLDS: dict[str, Hold] = {"dq": RotorFrame(), "stationary": StationaryFrame()}


def check_hold(name: str) -> None:
    """Refuse a frame that is not known.

    Raises
    ------
    InputError
        If it is not a key of `HOLDS`.
    """
    if name not in HOLDS:
        raise InputError(f"hold {name!r} came; choose one of {', '.join(HOLDS)}.")
