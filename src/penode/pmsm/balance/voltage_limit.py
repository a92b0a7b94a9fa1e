"""The voltage limit: samples whose recorded command the inverter did not make.

Of a command logged before the limiter what acts is shorter than what is logged. Where the voltage
balance explains a recording better with its voltages shortened to a share of the DC link's, those
samples leave the recording; what lies between them stays, as stretches.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.optimize import minimize_scalar

from penode.arrays import BoolArray, FloatArray
from penode.data.experiment import Experiment
from penode.data.gathered import PIECE
from penode.data.stretches import SHORTEST, excerpt, spans_of
from penode.pmsm.balance.trial_balance import residual_of
from penode.pmsm.machine.space_vectors import VOLTAGES, vector_of, with_vector
from penode.pmsm.recording.channels import electrical, in_dq
from penode.pmsm.recording.stationary_frame import LINK

#: Shares of the DC link's voltage that a limiter may shorten to: no inverter's mean over a sample
#: is longer than 2/3 of it, or than 1 / sqrt(3) at every angle.
_SMALLEST, _LARGEST, _AT_EVERY_ANGLE = 0.4, 2.0 / 3.0, 3.0**-0.5
#: To which the share is found, and below which voltages act as logged for sure, in shares of it.
_PRECISION, _SURE = 2e-3, 0.99
#: Residual as logged, over that with the voltages shortened, from which a limiter acted.
_BETTER = 1.1
#: Samples that are enough to find the share by, and the largest part of them that it shortens.
_SAMPLES, _MOST = 40_000, 0.5


def below_limit(stretches: Sequence[Experiment]) -> Sequence[Experiment]:
    """Return a recording in stretches without the samples at the voltage limit.

    As they came where u_dc was not recorded, the voltages act as they were logged, or nothing
    long enough is left. Else a sentence says how many samples that were not made are left out.
    """
    if any(LINK not in e.channels for e in stretches):
        return stretches
    share = _limiting_share(stretches)
    if share is None:
        return stretches
    usable = [_is_below(e, _SURE * min(share, _AT_EVERY_ANGLE)) for e in stretches]
    spans = spans_of(stretches, usable)
    if not spans:
        return stretches
    samples, beyond = sum(map(len, usable)), sum(int(np.sum(~own)) for own in usable)
    left = samples - beyond - sum(last - first for _, first, last in spans)
    sentence = (
        f"{stretches[0].place.recording}: {beyond} of {samples} samples "
        f"({100 * beyond / samples:.2g} %) are at the voltage limit, {share:.2f} of u_dc, and were "
        f"logged before it acts. They are left out, with {left} samples between them that are "
        f"fewer than {SHORTEST} in a row: {len(spans)} stretches are used."
    )
    return [e.between(first, last, sentence) for e, first, last in spans]


def _limiting_share(stretches: Sequence[Experiment]) -> float | None:
    """Return the share of the DC link's voltage to which a limiter shortens, None without one."""
    used = excerpt(stretches, electrical(stretches), _SAMPLES).experiments
    drives = [in_dq(e) for e in used]
    shares = np.concatenate([_shares(e) for e in drives])
    lowest = max(_SMALLEST, float(np.quantile(shares, 1.0 - _MOST)))
    highest = min(_LARGEST, float(shares.max()))
    if highest < lowest + _PRECISION:
        return None
    found = minimize_scalar(
        lambda share: residual_of([_shortened(e, share) for e in drives]),
        bounds=(lowest, highest),
        method="bounded",
        options={"xatol": _PRECISION},
    )
    return float(found.x) if residual_of(drives) > _BETTER * found.fun else None


def _is_below(experiment: Experiment, share: float) -> BoolArray:
    """Return at which samples a voltage is below a share of the DC link's, (time,)."""
    parts = (
        in_dq(experiment.part(first, min(first + PIECE, len(experiment))))
        for first in range(0, len(experiment), PIECE)
    )
    return np.concatenate([_shares(part) <= share for part in parts])


def _shares(drive: Experiment) -> FloatArray:
    """Return the length of the voltages over that of the DC link, (time,)."""
    link = np.maximum(drive.channels[LINK], 1e-9)
    return np.asarray(np.abs(vector_of(drive, VOLTAGES)) / link)


def _shortened(drive: Experiment, share: float) -> Experiment:
    factor = np.minimum(1.0, share / np.maximum(_shares(drive), 1e-9))
    return with_vector(drive, VOLTAGES, partial(np.multiply, factor))
