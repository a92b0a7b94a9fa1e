"""What recordings say of a machine whose rotor stands still, or with current in one axis alone.

No voltage then shows the constant of the flux linkage: psi is counted from that at zero current.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from penode.arrays import BoolArray, FloatArray
from penode.data.experiment import Experiment
from penode.data.stretches import by_recording
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.pmsm.machine.coenergy_map import CoenergySplines, columns
from penode.pmsm.machine.terms import SPEED

#: Electrical radians that the rotor has to turn in one recording.
TURN = 1.0
#: Range of one current over that of the other below which its axis is not excited.
_AT_REST = 0.01
#: Entry of the provenance, and what it means.
STANDSTILL = "standstill"
SCOPE = (
    "R and incremental inductance: the recording has no information on the permanent magnet's "
    "flux, as the rotor stands still. Flux linkage is counted from that at zero current."
)


def stands_still(experiments: Sequence[Experiment]) -> bool:
    """Return whether the rotor turns by less than one electrical radian in every recording."""
    turned = (
        sum(float(np.sum(e.channels[SPEED.name])) * e.time_step for e in stretches)
        for stretches in by_recording(experiments)
    )
    return max(map(abs, turned)) < TURN


def axes_at_rest(stretches: Sequence[Experiment]) -> str:
    """Return which one of d and q has neither voltage nor current in a recording; none of both."""
    found = "".join(
        axis
        for axis in "dq"
        if all(
            name in e.channels and not e.channels[name].any()
            for e in stretches
            for name in (f"u_{axis}", f"i_{axis}")
        )
    )
    return found if len(found) == 1 else ""


def excited_axes(fit: Fit) -> BoolArray:
    """Return which of d and q a fit's recordings excited, shape (2,)."""
    ranges = np.ptp(fit.excited, axis=0)
    return np.asarray(ranges > _AT_REST * ranges.max())


def require_magnet(fit: Fit) -> None:
    """Refuse a fit without the constant of the flux linkage: the rotor stood still throughout."""
    if fit.provenance.get(STANDSTILL):
        raise InputError(
            "the rotor stood still in the recordings of this fit, which therefore has no flux "
            "linkage at zero current, and a whole flux map was wanted; add a recording with the "
            "rotor turning, or take the inductances of flux_map.csv."
        )


def counted_from_zero(fit: Fit) -> Fit:
    """Return a fit, that of a standstill with no flux linkage at zero current.

    A coenergy linear in the currents is taken off, which no prediction at standstill depends on.
    Other maps than the default stay as they are.
    """
    model: Any = fit.model  # a machine
    flux = model.flux
    if not (fit.provenance.get(STANDSTILL) and isinstance(flux.network, CoenergySplines)):
        return fit
    part, *others = flux.network.mean
    constant = fit.flux_map(0.0, 0.0)[0] / flux.flux_scale
    points = _spread_over_the_disc(4 * part.coefficients.size)
    gradient = np.concatenate(columns(part, points).transpose(1, 0, 2))
    wanted = np.concatenate([np.full(len(points), constant), np.zeros(len(points))])
    linear = np.linalg.lstsq(gradient, wanted, rcond=None)[0].reshape(part.coefficients.shape)
    grounded = replace(part, coefficients=part.coefficients - linear)
    splines = replace(flux.network, mean=(grounded, *others))
    return replace(fit, model=replace(model, flux=replace(flux, network=splines)))


def _spread_over_the_disc(count: int) -> FloatArray:
    return np.random.default_rng(0).uniform(-1.0, 1.0, (count, 2))
