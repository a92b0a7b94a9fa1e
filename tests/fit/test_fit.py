"""A fit is saved and read back whole, and its result is strict JSON."""

import json
from dataclasses import asdict, replace

import jax
import numpy as np
import pytest

from penode import Fit, InputError
from penode.fit.archive import archive, read_archive
from penode.fit.fit import Estimate, HorizonChoice
from penode.report.fit_report import fit_report
from penode.validation.coverage import supported


@pytest.fixture(scope="module")
def fit(oscillator):
    return oscillator.fit


@pytest.fixture(scope="module")
def loaded(fit, tmp_path_factory):
    folder = tmp_path_factory.mktemp("saved")
    fit.save(folder)
    return Fit.load(str(folder))


def refuse_constant(name):
    raise AssertionError(f"{name} is not JSON")


def strict(text):
    return json.loads(text, parse_constant=refuse_constant)


def test_numbers_and_words_round_trip(fit, loaded):
    assert loaded.parameters == dict(fit.parameters)
    assert loaded.horizon == fit.horizon
    assert loaded.warnings == fit.warnings
    assert loaded.provenance == dict(fit.provenance)
    np.testing.assert_array_equal(loaded.excited, fit.excited)


def test_model_and_predictions_round_trip(fit, loaded):
    assert type(loaded.model) is type(fit.model)
    for found, leaf in zip(jax.tree.leaves(loaded.model), jax.tree.leaves(fit.model), strict=True):
        np.testing.assert_array_equal(found, leaf)
    x = np.linspace(-1.5, 1.5, 31)
    np.testing.assert_array_equal(loaded.spring(x), fit.spring(x))


def test_comparisons_and_spectrum_round_trip(fit, loaded):
    for found, kept in zip(loaded.comparisons, fit.comparisons, strict=True):
        for name, value in vars(kept).items():
            np.testing.assert_array_equal(getattr(found, name), value)
        assert isinstance(found.states, tuple)
    np.testing.assert_array_equal(loaded.spectrum.amplitude, fit.spectrum.amplitude)
    np.testing.assert_array_equal(loaded.transitions, fit.transitions)
    assert fit.transitions.shape == (64, 2, 2)
    np.testing.assert_array_equal(loaded.spectrum.frequency, fit.spectrum.frequency)
    assert loaded.spectrum.recording == "train.csv"


def rewrite(folder, document, arrays):
    """Replace the saved fit by another, as a version without digests of files would."""
    (folder / "result.json").unlink()
    for name, content in archive(document, arrays).items():
        (folder / "fit" / name).write_bytes(content)


def test_result_is_the_saved_document(fit, tmp_path):
    fit.save(tmp_path)
    saved = strict((tmp_path / "result.json").read_text())
    assert set(saved.pop("files")) == {"fit/fit.json", "fit/fit.npz"}
    assert saved == strict(json.dumps(fit.result()))
    assert saved["schema"] == "penode/1"
    named = {"schema", "horizon", "parameters", "metrics", "warnings", "provenance"}
    assert set(saved) == named | ({"covariance"} if len(fit.parameters) > 1 else set())
    assert set(saved["parameters"]["mass"]) == {
        "value",
        "unit",
        "std",
        "interval_95",
        "identifiability",
        "meaning",
        "budget",
    }
    assert [rung["horizon"] for rung in saved["horizon"]["ladder"]] == [1, 2, 4, 8, 16]
    # States of two units: each has errors of its own, and there is none of both.
    assert set(saved["metrics"]["train"]["train.csv"]) == {"states"}
    states = saved["metrics"]["train"]["train.csv"]["states"]
    assert {name: entry["unit"] for name, entry in states.items()} == {"x": "m", "v": "m/s"}
    assert states["v"]["one_step_rmse"] == fit.comparisons[0].one_step_errors["v"]
    assert set(saved["metrics"]["validation"]) == {"unseen.csv"}


def test_the_metric_names_the_unit_all_states_share(fit, systems):
    in_amperes = replace(fit.comparisons[0], units=("A", "A"))
    one_unit = replace(fit, comparisons=(in_amperes,))
    assert set(one_unit.result()["metrics"]["train"]["train.csv"]) == {
        "one_step_rmse_A",
        "free_run_rmse_A",
        "states",
    }


def test_what_is_not_finite_becomes_null(fit, tmp_path):
    diverged = replace(
        fit.comparisons[0], free_run=np.full_like(fit.comparisons[0].free_run, np.nan)
    )
    broken = replace(fit, comparisons=(diverged,), provenance={"speed": np.float64("nan")})
    broken.save(tmp_path)
    saved = strict((tmp_path / "result.json").read_text())
    strict((tmp_path / "fit" / "fit.json").read_text())
    assert saved["metrics"]["train"]["train.csv"]["states"]["x"]["free_run_rmse"] is None
    assert saved["provenance"]["speed"] is None
    again = Fit.load(tmp_path)
    assert np.isnan(again.comparisons[0].free_run).all()
    assert again.comparisons[0].free_run_errors == {"x": np.inf, "v": np.inf}


def test_estimates_that_are_not_finite_stay_numbers(fit, tmp_path):
    lost = Estimate(1.0, np.nan, (-np.inf, np.inf), "ohm")
    unknown = np.full((1, 1), np.nan)
    replace(fit, parameters={"R": lost}, covariance=unknown).save(tmp_path)
    back = Fit.load(tmp_path).parameters["R"]
    assert not np.isfinite([back.std, *back.interval_95]).any()


def test_recordings_of_one_name_are_both_told(fit):
    """run.csv of one folder and run.csv of another."""
    training = fit.comparisons[0]
    twice = replace(fit, comparisons=(training, training))
    assert len(twice.result()["metrics"]["train"]) == 2


def test_saving_again_replaces(fit, tmp_path):
    fit.save(tmp_path)
    replace(fit, warnings=("Once more.",)).save(tmp_path)
    assert Fit.load(tmp_path).warnings == ("Once more.",)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["fit", "result.json"]


# --- refusals ---------------------------------------------------------------------------------


def test_another_schema_is_refused(fit, tmp_path):
    fit.save(tmp_path)
    document, arrays = read_archive(tmp_path / "fit")
    rewrite(tmp_path, {**document, "schema": "penode/0"}, arrays)
    with pytest.raises(InputError, match=r"the schema must be 'penode/1', got 'penode/0'"):
        Fit.load(tmp_path)


@pytest.mark.parametrize("missing", ["fit", "fit/fit.json", "fit/fit.npz"])
def test_a_missing_file_is_named(fit, tmp_path, missing):
    fit.save(tmp_path)
    path = tmp_path / missing
    path.rename(tmp_path / "elsewhere")
    with pytest.raises(InputError, match=rf"{tmp_path}/fit/fit\..*: no such file"):
        Fit.load(tmp_path)


@pytest.mark.parametrize(
    "document",
    [
        '{"schema": "penode/1"}',
        "[]",
        '{"schema": "penode/1", "model": {"array": "gone"}}',
    ],
)
def test_json_without_the_fit_is_refused_in_a_sentence(fit, tmp_path, document):
    fit.save(tmp_path)
    (tmp_path / "fit" / "fit.json").write_text(document)
    with pytest.raises(InputError):
        Fit.load(tmp_path)


# --- what a fit offers ------------------------------------------------------------------------


def test_maps_of_the_model_are_methods_of_the_fit(fit):
    x = np.linspace(-1, 1, 5)
    np.testing.assert_array_equal(fit.spring(x), fit.model.maps()["spring"](x))
    with pytest.raises(AttributeError, match=r"no 'flux_map'; this model's maps are \['spring'\]"):
        fit.flux_map(0.0, 0.0)
    assert not hasattr(fit, "_private")


def test_supported_is_judged_on_the_visited_states(fit):
    points = np.array([[0.0, 0.0], [50.0, 0.0]])
    np.testing.assert_array_equal(fit.supported(points), supported(fit.excited, points))
    np.testing.assert_array_equal(fit.supported(points), [True, False])


@pytest.mark.parametrize(
    ("verdict", "answered"),
    [
        ("plateau", True),
        ("H = 1 suffices", True),
        ("fixed", True),
        ("no plateau", False),
        ("not identifiable", False),
    ],
)
def test_two_verdicts_are_no_answer(verdict, answered):
    assert HorizonChoice(1, verdict, "", ()).answered is answered


def test_estimate_is_plain_data():
    assert asdict(Estimate(1.0, 0.5, (0.02, 1.98), "ohm")) == {
        "value": 1.0,
        "std": 0.5,
        "interval_95": (0.02, 1.98),
        "unit": "ohm",
        "identifiability": None,
        "meaning": "",
        "budget": (),
    }


def test_an_unknown_deviation_of_a_horizon_is_still_unknown_when_loaded(fit, tmp_path):
    first, *others = fit.horizon.ladder
    (name, _), *_ = first.std.items()
    unsure = replace(first, std={**first.std, name: np.inf})
    replace(fit, horizon=replace(fit.horizon, ladder=(unsure, *others))).save(tmp_path)
    loaded = Fit.load(tmp_path)
    assert loaded.horizon.ladder[0].std[name] == np.inf
    assert loaded.horizon.ladder[0].parameters == first.parameters
    assert fit_report(loaded)


# --- what is no fit ---------------------------------------------------------------------------


def nan(values):
    return np.full(values.shape, np.nan)


DAMAGES = {
    "visited states that are nan": lambda d, a: a.update(excited=nan(a["excited"])),
    "no visited states": lambda d, a: a.update(excited=np.empty((0, 2))),
    "visited states in one row": lambda d, a: a.update(excited=np.ones(3)),
    "words for visited states": lambda d, a: a.update(excited=np.array([["a", "b"]])),
    "a model of nan": lambda d, a: a.update(
        {n: nan(v) for n, v in a.items() if n.startswith("model.")}
    ),
    "no model": lambda d, a: d.update(model=None),
    "a list for a model": lambda d, a: d.update(model=[]),
    "a layer for a model": lambda d, a: d.update(
        model={"class": "equinox.nn:Identity", "fields": {}}
    ),
    "no parameters": lambda d, a: d.pop("parameters"),
    "a list of horizons": lambda d, a: d.update(horizon=[]),
}


@pytest.mark.parametrize("what", DAMAGES)
def test_a_saved_fit_that_is_none_is_refused_in_a_sentence(fit, tmp_path, what):
    fit.save(tmp_path)
    document, arrays = read_archive(tmp_path / "fit")
    DAMAGES[what](document, arrays)
    rewrite(tmp_path, document, arrays)
    with pytest.raises(InputError, match=r"lacks a part .*run the identification again\.$") as said:
        Fit.load(tmp_path)
    assert "\n" not in str(said.value)


def test_a_fit_beside_the_result_of_another_is_refused(fit, tmp_path):
    for name in ("one", "other"):
        replace(fit, warnings=(name,)).save(tmp_path / name)
    (tmp_path / "other" / "result.json").replace(tmp_path / "one" / "result.json")
    with pytest.raises(InputError, match=r"fit\.(json|npz): not the file that result\.json beside"):
        Fit.load(tmp_path / "one")
