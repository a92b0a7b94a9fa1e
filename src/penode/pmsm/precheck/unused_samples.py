"""What a fit by stretches of long recordings makes of all the rest of them, piece by piece."""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, float64, on_device
from penode.data.experiment import Experiment
from penode.fit.fit import Fit
from penode.fit.outcome import Objection
from penode.horizon.objections import Check
from penode.models.parameters import with_batch_axis
from penode.pmsm.balance.calibration import Calibration
from penode.pmsm.recording.channels import in_dq
from penode.predictors.base import Predictor
from penode.validation.look_ahead import look_ahead

#: Samples that are predicted at once, few enough for the caches; what is left at the end and
#: shorter than a correction by a delay may cut is not.
PIECE, _SHORTEST = 4095, 64
#: One-step error of all samples, over that of those that were used, from which it is an objection.
_LARGER = 3.0


def unused_samples(
    experiments: Sequence[Experiment], calibration: Calibration, predictor: Predictor
) -> Check:
    """Return a check that predicts every sample of recordings, whole, that were used in part."""

    def samples_left_unused(fit: Fit, used: Sequence[Experiment]) -> Iterator[Objection]:
        seen = [c.one_step_residual for c in fit.comparisons if c.role == "train"]
        usual = np.mean(np.concatenate(seen) ** 2)
        for experiment in experiments:
            errors = squared_errors(fit.model, predictor, experiment, calibration)
            ratio = float(np.sqrt(errors.mean() / max(usual, 1e-300)))
            first = PIECE * int(np.argmax(errors))
            last, before = min(first + PIECE, len(experiment)), experiment.place.row
            if not ratio < _LARGER:
                yield Objection(
                    "unlike the rest",
                    f"{experiment.name}: one-step errors over all samples are {ratio:.2g} times as "
                    f"large as in the stretches that were used, most of all in data rows "
                    f"{before + first + 1} to {before + last}.",
                    "Cut out what does not belong to the recording, or give that part by itself.",
                )

    return samples_left_unused


def squared_errors(
    model: Any, predictor: Predictor, experiment: Experiment, calibration: Calibration
) -> FloatArray:
    """Return the mean squared one-step error of each `PIECE` of a recording, (piece,), A^2."""

    def error(first: int) -> float:
        piece = experiment.part(first, min(first + PIECE + predictor.past, len(experiment)))
        return _error(model, predictor, calibration.applied(in_dq(piece)))

    starts = range(0, len(experiment) - _SHORTEST, PIECE)
    with ThreadPoolExecutor(os.cpu_count()) as workers:
        return np.array(list(workers.map(error, starts)))


def _error(model: Any, predictor: Predictor, piece: Experiment) -> float:
    """Return the mean squared one-step error of a piece in A^2, huge where a step diverges."""
    with float64():
        states, inputs = (on_device(piece.stack(n).T) for n in (model.states, model.inputs))
        ahead = look_ahead(predictor, with_batch_axis(model), states, inputs, 1)
        error = float(jnp.mean((ahead - states[:, predictor.past :]) ** 2))
    return error if np.isfinite(error) else 1e150
