"""What became of one draw: identified, judged against the plant, as what JSON can hold."""

import math
import time
import traceback
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import jax
import numpy as np

from penode import Fit, InputError, identify
from penode.fit.outcome import AGREED, HorizonSummary
from validate.ledger import Record
from validate.physics.kind import Draw, Kind, draw, rows
from validate.physics.simulate import simulate

#: A parameter is right within its interval, or within this part of its value.
CLOSE = 0.02
#: Samples of the fresh recording, and its error over that of the best rung up to which it is right.
_FRESH, _AS_GOOD = 1000, 1.2

_COMPILED = "/jax/core/compile/backend_compile_duration"


@contextmanager
def counted() -> Iterator[list[float]]:
    """Yield a list that gets the seconds of every program compiled within."""
    seconds: list[float] = []

    def listen(event: str, duration: float, **_: Any) -> None:
        if event == _COMPILED:
            seconds.append(duration)

    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        yield seconds
    finally:
        jax.monitoring.unregister_event_duration_listener(listen)


def result_of(kind: Kind, number: int) -> Record:
    """Draw, identify with nothing given beside, and return what became of it."""
    drawn = draw(kind, number)
    record: Record = {"draw": f"{kind.name} {number}", "physics": kind.name, "number": number}
    record |= {"misfits": kind.misfits, "truth": dict(drawn.truth)}
    began = time.perf_counter()
    with counted() as compiled, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            fit = identify(drawn.start, [drawn.train.experiment])
        except InputError as refused:
            record |= {"verdict": "refused", "reason": str(refused)}
        except Exception as failure:  # of penode itself: a result of this study
            where = traceback.extract_tb(failure.__traceback__)[-1]
            reason = f"{type(failure).__name__}: {failure} ({where.filename}:{where.lineno})"
            record |= {"verdict": "failed", "reason": reason}
        else:
            record |= {"seconds": time.perf_counter() - began, **found(drawn, fit)}
    record["warned"] = sorted(
        {f"{w.category.__name__}: {w.message} ({w.filename}:{w.lineno})" for w in caught}
    )
    record |= {"compiled": len(compiled), "compiling": sum(compiled)}
    return {"seconds": time.perf_counter() - began, "positive": False, "rungs": [], **record}


def found(drawn: Draw, fit: Fit) -> Record:
    """Return what a fit says, beside the errors of its rungs."""
    horizon = fit.horizon
    values = {name: one.value for name, one in fit.parameters.items()}
    return {
        "verdict": horizon.verdict,
        "positive": horizon.verdict in AGREED,
        "reason": horizon.reason,
        "objections": [one.name for one in horizon.objections],
        "selected": horizon.selected,
        "plateau": list(horizon.plateau),
        "values": values,
        "half": {name: _number(1.96 * one.std) for name, one in fit.parameters.items()},
        "error": error(values, drawn.truth),
        "fresh": fresh_error(drawn, values),
        "rungs": [_rung(drawn, rung) for rung in horizon.ladder],
    }


def _rung(drawn: Draw, rung: HorizonSummary) -> Record:
    return {
        "horizon": rung.horizon,
        "error": error(rung.parameters, drawn.truth),
        "fresh": fresh_error(drawn, rung.parameters),
        "values": dict(rung.parameters),
        "half": {name: _number(1.96 * std) for name, std in rung.std.items()},
        "rmse": _number(rung.rmse),
        "outcome": rung.outcome,
    }


def error(values: Mapping[str, float], truth: Mapping[str, float]) -> float | None:
    """Return the root mean square of the parameters' relative errors."""
    gaps = [values[name] / true - 1 for name, true in truth.items()]
    return _number(math.sqrt(np.mean(np.square(np.clip(gaps, -1e100, 1e100)))))


def fresh_error(drawn: Draw, values: Mapping[str, float]) -> float | None:
    """Return the free run's error on a recording of its own, in deviations of the noise.

    LSODA simulates the model with these values from the plant's first state, beside what was
    measured there: 1 is all that noise leaves to a right model.
    """
    kind, test = drawn.kind, drawn.test
    samples = min(kind.samples, _FRESH)
    with np.errstate(all="ignore"):
        run = simulate(kind.plant, values, test.first.tolist(), test.drive, kind.step, samples)
        gap = (run[:, rows(kind)] - test.states[:samples]) / drawn.noise
        return _number(float(np.sqrt(1 + np.mean(gap**2))))


def covered(one: Record) -> dict[str, bool]:
    """Return which parameters lie within a finite interval."""
    return {
        name: one["half"][name] is not None and abs(one["values"][name] - true) <= one["half"][name]
        for name, true in one["truth"].items()
    }


def is_right(one: Record) -> bool:
    """Whether a fit is right, whatever its verdict says.

    Every parameter lies within its interval or within 2 %, and the free run on a recording of its
    own errs by no more than 1.2 times that of the best rung.
    """
    if not one["rungs"] or one["fresh"] is None:
        return False
    inside = covered(one)
    near = [
        inside[name] or abs(one["values"][name] / true - 1) <= CLOSE
        for name, true in one["truth"].items()
    ]
    best = min(large(rung["fresh"]) for rung in one["rungs"])
    return all(near) and one["fresh"] <= _AS_GOOD * best


def large(number: float | None) -> float:
    """Return a number read from a file, infinite where there is none."""
    return math.inf if number is None else number


def best_of(rungs: Sequence[Record]) -> float:
    """Return the least error of a ladder's rungs."""
    return min(large(rung["error"]) for rung in rungs)


def _number(value: float) -> float | None:
    """Return what JSON can hold: None for what is no finite number."""
    return float(value) if math.isfinite(value) else None
