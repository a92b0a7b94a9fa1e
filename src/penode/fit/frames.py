"""Results as data frames of polars, in SI units."""

from collections.abc import Mapping, Sequence

import polars as pl

from penode.arrays import FloatArray
from penode.fit.outcome import Estimate, HorizonChoice


def parameters_frame(parameters: Mapping[str, Estimate]) -> pl.DataFrame:
    """Return a row a physical parameter.

    Columns parameter, value, std, low_95, high_95, unit, identifiability, meaning.
    """
    numbers = ("value", "std", "low_95", "high_95")
    kinds = dict.fromkeys((*numbers, "identifiability"), pl.Float64)
    rows = [
        (name, one.value, one.std, *one.interval_95, one.unit, one.identifiability, one.meaning)
        for name, one in parameters.items()
    ]
    columns = ("parameter", *numbers, "unit", "identifiability", "meaning")
    schema = {name: kinds.get(name, pl.String) for name in columns}
    return pl.DataFrame(rows, schema=schema, orient="row")


def matrix_frame(names: Sequence[str], matrix: FloatArray) -> pl.DataFrame:
    """Return a row a name of a matrix (name, name): columns parameter, then every name."""
    columns = dict(zip(names, matrix.T, strict=True))
    return pl.DataFrame({"parameter": list(names), **columns})


def ladder_frame(horizon: HorizonChoice) -> pl.DataFrame:
    """Return a row a horizon of the ladder.

    Columns horizon; NAME and NAME_std of each physical parameter; rmse; free_run_rmse and
    free_run_rmse_STATE (null where the run diverged); iterations, outcome, selected, plateau.
    """
    rows = []
    for rung in horizon.ladder:
        row: dict[str, object] = {"horizon": rung.horizon}
        for name, value in rung.parameters.items():
            row |= {name: value, f"{name}_std": rung.std[name]}
        row |= {"rmse": rung.rmse, "free_run_rmse": rung.free_run_rmse}
        row |= {f"free_run_rmse_{name}": e for name, e in rung.free_run_errors.items()}
        row |= {"iterations": rung.iterations, "outcome": rung.outcome}
        row |= {"selected": rung.horizon == horizon.selected}
        rows.append({**row, "plateau": rung.horizon in horizon.plateau})
    errors = [name for name in rows[0] if name.startswith("free_run_rmse")] if rows else []
    return pl.DataFrame(rows, schema_overrides=dict.fromkeys(errors, pl.Float64))
