"""Identify the recordings and print what became of them, a line each, by halves."""

import json
import shutil
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from penode.arrays import BoolArray, FloatArray
from penode.data.experiment import Experiment
from penode.data.load import load
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.fit.outcome import AGREED
from penode.paper.conventional.linear_methods import CoenergyLeastSquares
from validate.command import identify
from validate.identified import Identified, outcome
from validate.ledger import Ledger, Record
from validate.other_simulators.plan import HALVES

Samples: TypeAlias = dict[str, list[float]]
Supported: TypeAlias = Callable[[FloatArray], BoolArray]

FOLDER = Path("out") / "validate" / "other_simulators"
#: An error of R in per cent from which a positive verdict is far off.
FAR = 5.0
HEAD = (
    f"{'':2s} {'kind':27s} {'machine':20s} {'rpm':>5s} {'R in ohm':>9s} {'95 % interval':>19s} "
    f"{'truth':>7s} {'error':>9s} {'map':>8s} {'plain':>8s} {'':7s} {'s':>4s}  verdict"
)


def truths() -> dict[str, Any]:
    """Return what `record` wrote: versions, and the truth of each recording by its number.

    Raises
    ------
    InputError
        If nothing is recorded.
    """
    file = FOLDER / "truth.json"
    if not file.exists():
        raise InputError(
            f"{file} is missing; make the recordings first: python -m validate.other_simulators "
            "record --python PYTHON --thor FILE."
        )
    return json.loads(file.read_text())


def result_of(truth: Record) -> Record:
    """Identify a recording, or both of two, by the command with nothing but the files given."""
    files, out = [FOLDER / file for file in truth["files"]], FOLDER / f"result{truth['number']}"
    done = outcome(identify(files, out))
    if not done.noted:
        shutil.rmtree(out, ignore_errors=True)
    return record_of(done, files, truth)


def record_of(done: Identified, files: Sequence[Path], truth: Record) -> Record:
    """Return how an identification ended, as JSON can hold it."""
    record: Record = {
        "verdict": done.verdict,
        "why": done.why,
        "noted": done.noted,
        "seconds": done.seconds,
    }
    fit = done.fit
    if fit is None:
        return record
    estimate = fit.parameters["R"]
    return record | {
        "objections": [objection.name for objection in fit.horizon.objections],
        "R": estimate.value,
        "interval": list(estimate.interval_95),
        "map": map_error(fit, truth["flux_map"], fit.supported),
        "plain": plain_error([load(file) for file in files], truth["flux_map"], fit.supported),
        "horizon": fit.horizon.selected,
        "structure": fit.provenance["structure"],
        "hold": fit.provenance["hold"],
        "warnings": list(fit.warnings),
    }


def plain_error(
    recordings: Sequence[Experiment], samples: Samples, supported: Supported
) -> float | None:
    """Return `map_error` of linear least squares of the recordings as they are, None if refused."""
    try:
        fit = CoenergyLeastSquares().identify(recordings)
    except InputError:
        return None
    return map_error(fit, samples, supported)


def map_error(fit: Fit, samples: Samples, supported: Supported) -> float | None:
    """Return the root mean square error of the map over the excited region.

    Parameters
    ----------
    fit : Fit
    samples : dict of str to list
        Of the true map, i_d, i_q, psi_d, psi_q in the units of the recording.
    supported : callable
        Returns which currents (current, 2) lie in the excited region.

    Returns
    -------
    float or None
        In per cent of the largest flux linkage there; None where no sample lies in the region.
    """
    current = np.stack([samples["i_d"], samples["i_q"]], axis=-1)
    psi = np.stack([samples["psi_d"], samples["psi_q"]], axis=-1)
    inside = supported(current)
    if not inside.any():
        return None
    gap = np.stack(fit.flux_map(*current[inside].T), axis=-1) - psi[inside]
    square = np.mean(np.sum(gap**2, axis=-1))
    return float(100 * np.sqrt(square) / np.hypot(*psi[inside].T).max())


def mark_of(truth: Record, result: Record) -> str:
    """Return ``"broken"``, ``"refused"``, ``"right"``, ``"wrong"`` or ``"far"``."""
    if result["verdict"].startswith("status"):
        return "broken"
    if result["verdict"] not in AGREED:
        return "refused"
    if abs(error_of(truth, result)) > FAR:
        return "far"
    return "right" if covers(truth, result) else "wrong"


def covers(truth: Record, result: Record) -> bool:
    """Return whether the interval of R contains the truth; noise has none."""
    low, high = result["interval"]
    return truth["R"] is not None and low <= truth["R"] <= high


def error_of(truth: Record, result: Record) -> float:
    """Return the error of R in per cent; without a truth there is no end to it."""
    return np.inf if truth["R"] is None else 100 * (result["R"] / truth["R"] - 1)


def line_of(truth: Record, result: Record) -> str:
    """Return one line of the table."""
    kind, machine, rpm = truth["kind"], truth["machine"], truth["speeds_rpm"][0]
    known = f"{truth['R']:7.4g}" if truth["R"] is not None else "      -"
    objections = result["verdict"] == "implausible" and result["objections"]
    said = ", ".join(dict.fromkeys(objections or ())) or result["verdict"]
    found = f"{'-':>9s} {'-':>19s} {known} {'-':>9s} {'-':>8s} {'-':>8s}"
    if "R" in result:
        low, high = result["interval"]
        error = percent(error_of(truth, result), "+.2f")
        trained, plain = (percent(result[name], ".2f") for name in ("map", "plain"))
        found = (
            f"{result['R']:9.4g} {low:9.4g} {high:9.4g} {known} {error:>9s} {trained:>8s} "
            f"{plain:>8s}"
        )
    return (
        f"{truth['number']:2d} {kind:27s} {machine:20s} {rpm + 0.0:5.0f} {found} "
        f"{mark_of(truth, result):7s} {result['seconds']:4.0f}  {said}"
        f"{result['noted'] and '  !! ' + result['noted']}"
    )


def percent(number: float | None, form: str) -> str:
    """Return a number of per cent, a dash for none or no end."""
    if number is None or not np.isfinite(number):
        return "-"
    return f"{number:{form}} %" if abs(number) < 1000 else "> 999 %"


def summary(pairs: list[tuple[Record, Record]]) -> str:
    """Return the goal figures of some recordings, as a line."""
    positive = [pair for pair in pairs if pair[1]["verdict"] in AGREED]
    noted = sum(bool(result["noted"]) for _, result in pairs)
    odd = f" {noted} ended otherwise than promised or with a warning." if noted else ""
    if not positive:
        return f"0 of {len(pairs)} verdicts are positive.{odd}"
    covered = [covers(*pair) for pair in positive]
    largest = max(abs(error_of(*pair)) for pair in positive)
    return (
        f"{len(positive)} of {len(pairs)} verdicts are positive "
        f"({100 * len(positive) / len(pairs):.0f} %); intervals cover in {sum(covered)} of them "
        f"({100 * np.mean(covered):.0f} %); largest error with a positive verdict {largest:.2f} %. "
        f"{_maps(positive)}{odd}"
    )


def _maps(pairs: list[tuple[Record, Record]]) -> str:
    ratios = [r["plain"] / r["map"] for _, r in pairs if r["plain"] and r["map"]]
    if not ratios:
        return "Their maps have none of least squares beside them."
    return (
        f"Their maps are as good as least squares' in {sum(ratio >= 1 for ratio in ratios)} of "
        f"{len(ratios)}, its error {np.median(ratios):.1f} times theirs in the median."
    )


def print_table(halves: tuple[str, ...] = HALVES) -> None:
    """Identify the recordings of some halves and print their tables; Ctrl-C ends early."""
    recorded = truths()
    print(", ".join(f"{name} {number}" for name, number in recorded["versions"].items()))
    ledger = Ledger("other_simulators")
    for half in halves:
        chosen = {t["number"]: t for t in recorded["recordings"].values() if t["half"] == half}
        print(f"\n{half}\n{HEAD}")
        pairs: list[tuple[Record, Record]] = []
        with suppress(KeyboardInterrupt):
            for number in sorted(chosen):
                result = ledger.of(number, partial(_identified, chosen))
                pairs.append((chosen[number], result))
                print(line_of(*pairs[-1]), flush=True)
        print(summary(pairs))


def _identified(truths: dict[int, Record], number: int) -> Record:
    return result_of(truths[number])
