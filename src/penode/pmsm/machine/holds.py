"""Holds of a drive: in which frame the voltage of a row stands still until the next."""

from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp

from penode.errors import InputError
from penode.models.inputs import Inputs
from penode.predictors.holds import Hold, ZeroOrderHold


@dataclass(frozen=True)
class StationaryFrame:
    """Voltage held by an inverter, constant in alpha and beta: it falls behind the rotor.

    Seen from the rotor it turns by -omega T from each sample to the next; u_d and u_q of a row are
    those at the sample itself.
    """

    def __call__(
        self, drive: Callable[[int], Inputs], sample: int, fraction: float, time_step: float
    ) -> Inputs:
        """Return the input with its voltage turned back; see `penode.predictors.holds.Hold`."""
        u = drive(sample)
        if fraction == 0.0:
            return u
        turn = u["omega_el"] * (fraction * time_step)
        cosine, sine = jnp.cos(turn), jnp.sin(turn)
        u_d, u_q = u["u_d"], u["u_q"]
        return u.replaced(u_d=u_d * cosine + u_q * sine, u_q=u_q * cosine - u_d * sine)


#: Frame in which the voltage stands still -> hold.
HOLDS: dict[str, Hold] = {"dq": ZeroOrderHold(), "stationary": StationaryFrame()}


def check_hold(name: str) -> None:
    """Refuse a frame that is not known.

    Raises
    ------
    InputError
        If it is not a key of `HOLDS`.
    """
    if name not in HOLDS:
        raise InputError(f"hold {name!r} came; choose one of {', '.join(HOLDS)}.")
