"""Whatever a study, a calibration, a start, a rung or a fit holds comes back from its file.

Equal in value and in type, to the last bit and the sign of zero: not numbers, infinities, complex
numbers, numbers of NumPy, None, tuples and lists.
"""

import tempfile
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import jax
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of

from penode import Fit
from penode.fit.outcome import (
    Contribution,
    Estimate,
    HorizonChoice,
    HorizonSummary,
    Objection,
)
from penode.horizon.checkpoint_file import Record, Rung, packed, read, text
from penode.horizon.held_out import PURPOSES
from penode.horizon.identifiability import Start
from penode.pmsm.balance.calibration import Calibration
from penode.pmsm.balance.doubt import Doubt
from penode.pmsm.balance.drift import Drift
from penode.pmsm.machine.coenergy_map import CoenergyPart
from penode.pmsm.machine.flux_maps import FLUX_MAPS
from penode.pmsm.machine.holds import HOLDS
from penode.pmsm.machine.linkage import Linkage
from penode.pmsm.machine.term_registry import TERMS
from penode.pmsm.machine.terms import Resistance
from penode.pmsm.recording.imperfection import KnownDrive
from penode.pmsm.recording.imperfections import IMPERFECTIONS, Accuracy
from penode.pmsm.study_settings import Study
from penode.training.penalties import GaussianPrior, WeightDecay

QUICK = settings(max_examples=60, deadline=None)

# --- values -----------------------------------------------------------------------------------

FLOATS = st.floats() | st.sampled_from([0.0, -0.0, np.inf, -np.inf, np.nan, 5e-324, 1 / 3])
COMPLEX = st.builds(complex, FLOATS, FLOATS)
TEXT = st.text(max_size=8)
DTYPES = (
    arrays_of.boolean_dtypes()
    | arrays_of.integer_dtypes(endianness="=")
    | arrays_of.floating_dtypes(endianness="=")
    | arrays_of.complex_number_dtypes(endianness="=")
)
ARRAYS = arrays_of.arrays(DTYPES, arrays_of.array_shapes(min_dims=0, max_dims=3, max_side=3))
SCALARS = DTYPES.flatmap(lambda kind: arrays_of.arrays(kind, ())).map(lambda array: array[()])
#: As results of NumPy are, where a float is declared.
NUMBERS = FLOATS | FLOATS.map(np.float64)
PLAIN = st.none() | st.booleans() | st.integers() | FLOATS | COMPLEX | TEXT | SCALARS
KEYS = TEXT | st.integers() | st.booleans() | st.none() | st.tuples(st.integers(), TEXT)
VALUES = st.recursive(
    PLAIN | ARRAYS,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.lists(inner, max_size=3).map(tuple)
        | st.dictionaries(TEXT, inner, max_size=3)
        | st.dictionaries(KEYS, inner, max_size=3)
    ),
    max_leaves=8,
)


def same(found, given):
    """Return whether two values are of one type and equal to the last bit."""
    if isinstance(given, jax.Array):
        given = np.asarray(given)
    if type(found) is not type(given):
        return False
    if is_dataclass(given):
        return all(same(getattr(found, f.name), getattr(given, f.name)) for f in fields(given))
    if isinstance(given, (tuple, list)):
        return len(found) == len(given) and all(map(same, found, given))
    if isinstance(given, dict):
        return same(list(found), list(given)) and all(map(same, found.values(), given.values()))
    if isinstance(given, np.ndarray):
        # NaN has many bits, of which none is told apart.
        return (found.dtype, found.shape) == (given.dtype, given.shape) and all(
            map(same, found.ravel().tolist(), given.ravel().tolist())
        )
    return repr(found) == repr(given)


# --- what a climb begins with, through a checkpoint ----------------------------------------------

REASONS = st.lists(TEXT, max_size=2).map(tuple)
LINKAGES = st.builds(
    Linkage,
    st.builds(
        CoenergyPart, st.booleans(), arrays_of.arrays(np.float64, (3, 4), elements=st.floats())
    ),
    NUMBERS,
)
SIZES = st.sampled_from(sorted(IMPERFECTIONS))
CALIBRATIONS = st.builds(
    Calibration,
    st.dictionaries(SIZES, NUMBERS | COMPLEX | COMPLEX.map(np.complex128), max_size=4),
    st.builds(KnownDrive, NUMBERS, st.none() | LINKAGES, st.sampled_from(sorted(HOLDS)), NUMBERS),
    deviation=st.dictionaries(TEXT, NUMBERS, max_size=3),
    reasons=REASONS,
)
KNOWN = st.sampled_from([kind() for kind in TERMS.values()]) | NUMBERS.map(Resistance)
STUDIES = st.builds(
    Study,
    flux_map=st.sampled_from(sorted(FLUX_MAPS)),
    horizon=st.none() | st.integers(1, 999),
    pole_pairs=st.none() | st.integers(1, 60),
    seed=st.integers(0, 2**63 - 1),
    terms=st.lists(KNOWN, max_size=1).map(tuple),
    candidates=st.lists(KNOWN, max_size=3).map(tuple),
    hold=st.none() | st.sampled_from(sorted(HOLDS)),
    samples=st.integers(1, 10**6),
    purpose=st.sampled_from(PURPOSES),
    accuracy=st.builds(Accuracy, angle=st.floats(0, 9), current_gain=st.floats(0, 0.1)),
)
PRIORS = st.builds(
    GaussianPrior,
    factor=ARRAYS.filter(lambda array: array.dtype.kind == "f"),
    variance=arrays_of.arrays(np.float64, 3, elements=FLOATS),
    mean=NUMBERS,
    group=TEXT,
)
STARTS = st.builds(
    Start,
    KNOWN,
    identifiability=st.dictionaries(TEXT, NUMBERS, max_size=3),
    anchor=st.dictionaries(TEXT, st.tuples(NUMBERS, NUMBERS), max_size=3),
    repair=TEXT,
    facts=st.dictionaries(TEXT, VALUES, max_size=3),
    warnings=REASONS,
    penalties=st.lists(PRIORS | st.builds(WeightDecay, NUMBERS), max_size=2).map(tuple),
)
DRIFTS = st.builds(
    Drift,
    st.dictionaries(SIZES, st.lists(NUMBERS, max_size=3).map(tuple), max_size=2),
    st.dictionaries(SIZES, NUMBERS, max_size=2),
    REASONS,
)
DOUBTS = st.builds(Doubt, TEXT, TEXT, KNOWN, st.none() | KNOWN, NUMBERS)


def reread(record):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "checkpoint.json")
        path.write_text(text(record))
        return read(path), path


@pytest.mark.parametrize(
    "drawn",
    [VALUES, CALIBRATIONS, STUDIES, STARTS, DRIFTS, DOUBTS],
    ids=["any value", "calibration", "study", "start", "drift", "doubt"],
)
def test_what_a_climb_begins_with_comes_back_from_its_checkpoint(drawn):
    @QUICK
    @given(drawn)
    def law(value):
        record, path = reread(Record({}, {}, np.zeros(0), packed({"it": value})))
        assert same(record.restored(path)["it"], value)

    law()


def test_keys_that_look_like_the_names_of_other_arrays_do_not_mix_them_up():
    one, other = np.array([1.0]), np.array([2.0])
    tree = {"a": {"b": one}, "a.b": other, "0": one, 0: other, "file": (one, [other])}
    record, path = reread(Record({}, {}, np.zeros(0), packed(tree)))
    assert same(record.restored(path), tree)


@QUICK
@given(
    st.lists(NUMBERS, max_size=4),
    st.integers(1, 999) | st.integers(1, 99).map(np.int64),
    st.integers(0, 99) | st.integers(0, 99).map(np.int32),
    TEXT,
)
@example([np.nan, -np.inf, -0.0], 3, 4, "Converged.")
def test_a_rung_comes_back_from_its_checkpoint(raw, horizon, evaluations, outcome):
    rung = Rung(horizon, np.array(raw, dtype=np.float64), evaluations, outcome)
    record, _ = reread(Record({"seed": "0"}, {"hold": "dq"}, rung.raw, packed(None), (rung,)))
    (found,) = record.rungs
    assert same(found, replace(rung, horizon=int(horizon), evaluations=int(evaluations)))
    assert same(record.start, rung.raw)


# --- fits -------------------------------------------------------------------------------------

ROWS = st.builds(Contribution, TEXT, FLOATS, TEXT, TEXT)
ESTIMATES = st.builds(
    Estimate,
    value=FLOATS,
    std=FLOATS,
    interval_95=st.tuples(FLOATS, FLOATS),
    unit=TEXT,
    identifiability=st.none() | FLOATS,
    meaning=TEXT,
    budget=st.lists(ROWS, max_size=2).map(tuple),
)
PARAMETERS = st.from_regex(r"[A-Za-z_]\w{0,8}([.]\w{1,4}|\[[0-9]\])?", fullmatch=True)
NAMED = st.dictionaries(TEXT, FLOATS, max_size=2)
RUNGS = st.builds(
    HorizonSummary,
    horizon=st.integers(1, 999),
    parameters=NAMED,
    std=NAMED,
    rmse=FLOATS,
    free_run_rmse=st.none() | FLOATS,
    iterations=st.integers(0, 99),
    outcome=TEXT,
    free_run_errors=st.dictionaries(TEXT, st.none() | FLOATS, max_size=2),
)
CHOICES = st.builds(
    HorizonChoice,
    selected=st.integers(1, 999),
    verdict=TEXT,
    reason=TEXT,
    ladder=st.lists(RUNGS, max_size=2).map(tuple),
    plateau=st.lists(st.integers(1, 999), max_size=2).map(tuple),
    objections=st.lists(st.builds(Objection, TEXT, TEXT, TEXT), max_size=2).map(tuple),
)


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_a_fit_comes_back_from_its_folder(oscillator, data):
    parameters = data.draw(st.dictionaries(TEXT, ESTIMATES, max_size=2))
    size = len(parameters), len(parameters)
    fit = replace(
        oscillator.fit,
        parameters=parameters,
        covariance=data.draw(arrays_of.arrays(np.float64, size, elements=FLOATS)),
        horizon=data.draw(CHOICES),
        transitions=data.draw(arrays_of.arrays(np.float64, (2, 2, 2), elements=FLOATS)),
        starts=data.draw(arrays_of.arrays(np.float64, 2, elements=FLOATS)),
        nuisances=data.draw(st.dictionaries(PARAMETERS, ARRAYS, max_size=2)),
        warnings=data.draw(REASONS),
        provenance=data.draw(st.dictionaries(TEXT, VALUES, max_size=3)),
    )
    with tempfile.TemporaryDirectory() as folder:
        fit.save(folder)
        found = Fit.load(folder)
    given = (
        "parameters",
        "covariance",
        "horizon",
        "transitions",
        "starts",
        "nuisances",
        "warnings",
        "provenance",
    )
    for part in (*given, "warnings", "provenance"):
        assert same(getattr(found, part), getattr(fit, part)), part
    for part in ("comparisons", "spectrum", "learned_uncertainty", "correlations", "excited"):
        assert same(getattr(found, part), getattr(fit, part)), part
