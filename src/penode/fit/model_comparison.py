"""Several models of the same recordings side by side, with a criterion for correlated residuals."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from penode.arrays import FloatArray
from penode.errors import InputError
from penode.models.layout import Layout
from penode.validation.autocovariance import effective_number
from penode.validation.comparison import Comparison

if TYPE_CHECKING:
    from penode.fit.fit import Fit

_ROLES, _KINDS = ("train", "validation"), ("free_run", "one_step")


def compare_models(fits: Mapping[str, "Fit"]) -> pl.DataFrame:
    """Return a row a model; see `Fit.compare_models`."""
    _require_alike(fits)
    errors = {name: _errors(fit) for name, fit in fits.items()}
    numbers = _effective_numbers(list(fits.values()))
    rows = []
    for name, fit in fits.items():
        count, choice = _count(fit), fit.horizon
        row: dict[str, Any] = {"model": name, "parameters": count}
        row |= {"verdict": choice.verdict, "horizon": choice.selected}
        row |= {key: float(e) if np.isfinite(e) else None for key, e in errors[name].items()}
        squares = np.array([errors[name][f"train_free_run_{q}"] for q in fit.comparisons[0].states])
        finite = np.isfinite(squares).all() and np.isfinite(numbers).all()
        bic = numbers @ np.log(np.maximum(squares, 1e-300) ** 2) + count * np.log(numbers.sum())
        rows.append({**row, "effective_number": numbers.sum(), "bic": bic if finite else None})
    least = min((row["bic"] for row in rows if row["bic"] is not None), default=None)
    for row in rows:
        row["bic_above_least"] = None if row["bic"] is None else row["bic"] - least
    numeric = [key for key in rows[0] if key.startswith((*_ROLES, "bic", "effective"))]
    return pl.DataFrame(rows, schema_overrides=dict.fromkeys(numeric, pl.Float64))


def _require_alike(fits: Mapping[str, "Fit"]) -> None:
    if not fits:
        raise InputError("models must be of one fit or more, got none.")
    known = {name: [_content(one) for one in fit.comparisons] for name, fit in fits.items()}
    first, *others = known
    for name, content in known.items():
        if not any(one[0] == "train" for one in content):
            raise InputError(f"{name}: a fit must have training recordings, got none.")
    for name in others:
        if known[name] != known[first]:
            raise InputError(
                f"models must be of the same recordings and quantities, got others of {name} than "
                f"of {first}; identify both on the same, with the same validation."
            )


def _content(one: Comparison) -> tuple[object, ...]:
    return one.role, one.name, one.time_step, one.states, one.units, one.measured.shape


def _count(fit: "Fit") -> int:
    """Return how many numbers were found from the training recordings."""
    recordings = sum(one.role == "train" for one in fit.comparisons)
    starts = sum(len(states) for states in fit.initial_states.values())
    return Layout(fit.model, recordings).size + starts


def _residuals(fit: "Fit", role: str, kind: str) -> list[FloatArray]:
    """Return the residuals of each recording, (quantity, time)."""
    chosen = [one for one in fit.comparisons if one.role == role]
    return [np.asarray((one.measured - getattr(one, kind))[1:].T) for one in chosen]


def _errors(fit: "Fit") -> dict[str, float]:
    """Return rms errors as ROLE_KIND_QUANTITY, in the quantity's unit; not finite: none."""
    errors: dict[str, float] = {}
    for role in _ROLES:
        for kind in _KINDS:
            residuals = _residuals(fit, role, kind)
            if residuals:
                with np.errstate(over="ignore", invalid="ignore"):
                    rms = np.sqrt(np.mean(np.concatenate(residuals, axis=1) ** 2, axis=1))
                names = fit.comparisons[0].states
                errors |= {f"{role}_{kind}_{q}": e for q, e in zip(names, rms, strict=True)}
    return errors


def _effective_numbers(fits: list["Fit"]) -> FloatArray:
    """Return how many independent residuals the recordings have, (quantity,).

    They are those of the model that errs least, and the same for all: what another leaves out makes
    its own residual correlated, and sums over different numbers cannot be compared.
    """
    errors = np.stack(
        [[_errors(f)[f"train_free_run_{q}"] for q in f.comparisons[0].states] for f in fits]
    )
    best = np.argmin(np.nan_to_num(errors, nan=np.inf, posinf=np.inf), axis=0)
    return np.array(
        [
            sum(effective_number(one[q]) for one in _residuals(fits[k], "train", "free_run"))
            for q, k in enumerate(best)
        ]
    )
