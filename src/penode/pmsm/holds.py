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


@dataclass(frozen=True)
class Standing:
    """A hold that also tells for which part of the sample each stage of a Runge-Kutta step stands.

    A phase current crosses zero within a fraction of a sample. The four stages of the classic
    method would see its sign at three moments, by chance and not without a bias: at 1500 rpm and 10
    kHz it made R of a 16 mohm machine 0.4 % too small. Of weights 1/6, 1/3, 1/3 and 1/6, the first
    stage stands for the first sixth of the sample, the middle ones for the next two thirds and the
    last for the last sixth.

    Attributes
    ----------
    hold : Hold
        What the rows of the input are otherwise; see `HOLDS`.
    """

    hold: Hold

    def __call__(self, drive: Drive, sample: int, share: float, time_step: float) -> JaxArray:
        """Return the input (input + 2, batch).

        The rows added are the turn in rad from the moment to the middle of its part, and over half
        of the part.
        """
        u = self.hold(drive, sample, share, time_step)
        turn = u[2:3] * time_step
        middle, half = _PARTS.get(share, (0.0, 0.0))
        return jnp.concatenate([u, middle * turn, half * turn])


#: Share of the sample at which a stage is -> from there to the middle of its part, and half of it.
_PARTS = {0.0: (1 / 12, 1 / 12), 0.5: (0.0, 1 / 3), 1.0: (-1 / 12, 1 / 12)}


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
