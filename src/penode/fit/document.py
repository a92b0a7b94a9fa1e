"""What a saved fit consists of: one document beside arrays, and back."""

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from penode.arrays import FloatArray
from penode.fit.learned_uncertainty import LearnedUncertainty
from penode.fit.model_tree import describe_module, restore_module
from penode.fit.outcome import estimate_of, horizon_of
from penode.models.base import Model
from penode.validation.comparison import Comparison
from penode.validation.residual_tests import Correlations, Spectrum

if TYPE_CHECKING:
    from penode.fit.fit import Fit

_NUISANCE = "nuisance."


def document_of(fit: "Fit") -> tuple[dict[str, Any], dict[str, FloatArray]]:
    """Return a fit as JSON values, and its arrays by name."""
    arrays = {"excited": fit.excited, "transitions": fit.transitions, "starts": fit.starts}
    arrays |= {f"{_NUISANCE}{name}": values for name, values in fit.nuisances.items()}
    document = {
        **fit.result(),
        "model": describe_module(fit.model, "model", arrays),
        "simulation": fit.simulation and describe_module(fit.simulation, "simulation", arrays),
        "comparisons": [
            _describe(c, f"comparison.{k}", arrays) for k, c in enumerate(fit.comparisons)
        ],
        "spectrum": _describe(fit.spectrum, "spectrum", arrays),
        "learned_uncertainty": _describe(fit.learned_uncertainty, "uncertainty", arrays),
        "correlations": _describe(fit.correlations, "correlations", arrays),
    }
    return document, arrays


def parts_of(
    document: Mapping[str, Any], arrays: Mapping[str, FloatArray], trust: bool
) -> dict[str, Any]:
    """Return what a fit is made of, by the names of its attributes, from `document_of`'s document.

    Parts that earlier versions did not write may lack. ``trust`` imports classes of modules other
    than penode's. Raises InputError on an untrusted class, and KeyError, TypeError, AttributeError
    or ValueError where a part lacks or is not as it was written.
    """
    _require_numbers(arrays)
    model = restore_module(document["model"], arrays, trust)
    if not isinstance(model, Model):
        raise TypeError("its model is no model")
    return {
        "model": model,
        "parameters": {n: estimate_of(p) for n, p in document["parameters"].items()},
        "horizon": horizon_of(document["horizon"]),
        "excited": arrays["excited"],
        "comparisons": tuple(_restore(Comparison, c, arrays) for c in document["comparisons"]),
        "spectrum": _restore(Spectrum, document["spectrum"], arrays),
        "transitions": arrays.get("transitions", np.empty((0, 0, 0))),
        "starts": arrays.get("starts", np.empty(0)),
        "learned_uncertainty": _restore(
            LearnedUncertainty, document.get("learned_uncertainty", {}), arrays
        ),
        "correlations": _restore(Correlations, document.get("correlations", {}), arrays),
        "nuisances": {
            name.removeprefix(_NUISANCE): values
            for name, values in arrays.items()
            if name.startswith(_NUISANCE)
        },
        "simulation": document.get("simulation")
        and restore_module(document["simulation"], arrays, trust),
        "warnings": tuple(document["warnings"]),
        "provenance": document["provenance"],
    }


def _require_numbers(arrays: Mapping[str, FloatArray]) -> None:
    """Refuse a model or visited states that no training leaves."""
    for name, values in arrays.items():
        if name.startswith(("model.", "comparison.")) and not values.size:
            raise ValueError(f"{name} is empty")
        if name != "excited" and not name.startswith("model."):
            continue
        if values.dtype.kind not in "fiub" or not np.isfinite(values).all():
            raise ValueError(f"{name} is not finite")
    if arrays["excited"].ndim != 2 or not arrays["excited"].size:
        raise ValueError(f"excited has the shape {arrays['excited'].shape}")


def _describe(record: Any, name: str, arrays: dict[str, FloatArray]) -> dict[str, Any]:
    values = {f.name: getattr(record, f.name) for f in fields(record)}
    return {k: describe_module(v, f"{name}.{k}", arrays) for k, v in values.items()}


def _restore(kind: Any, document: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> Any:
    return kind(**{k: restore_module(v, arrays) for k, v in document.items()})
