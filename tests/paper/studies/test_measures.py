"""What is measured of a fit, and how it is summed up in rows, series, words and tables."""

import json
from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest

from penode.bench.machines import COMSOL_300A
from penode.fit.fit import Estimate, HorizonChoice, HorizonSummary
from penode.paper.studies.panels import Series, StudyResult
from penode.paper.studies.results_page import results_page
from penode.paper.studies.runs import Measures, Run, measure
from penode.paper.studies.summaries import Trained, in_numbers, limits, listed, milliohm, row
from penode.paper.studies.variants import PAPER
from penode.validation.comparison import Comparison

SHIFT = np.array([-2e-3, 4e-4])


@pytest.fixture
def fit(machine_fit):
    """Return a fit whose errors are 2 A one step ahead where it was trained, 3 A and 4 A else."""

    def beside(name, role, one_step, free_run):
        zeros = np.zeros((5, 2))
        errors = (zeros + one_step, zeros + free_run)
        return Comparison(name, role, 1e-4, ("i_d", "i_q"), ("A", "A"), zeros, *errors)

    ladder = tuple(HorizonSummary(h, {}, {}, 0.1 * h, 0.0, 2, "Done.") for h in (1, 8, 50))
    return replace(
        machine_fit,
        horizon=HorizonChoice(8, "plateau", "Horizons agree.", ladder),
        parameters={
            "dead_time_voltage": Estimate(2.4, 0.1, (2.2, 2.6), "V"),
            **machine_fit.parameters,
        },
        comparisons=(
            beside("a", "train", 2.0, 9.0),
            beside("b", "validation", 3.0, 5.0),
            beside("c", "validation", 4.0, np.inf),
        ),
    )


@pytest.fixture
def measures(fit):
    truth = SimpleNamespace(
        flux_map=lambda i_d, i_q: fit.flux_map(i_d, i_q).T - SHIFT,
        resistance=0.008,
        machine=COMSOL_300A,
    )
    return measure(fit, SimpleNamespace(truth=truth))


def test_a_fit_is_measured_at_the_horizon_it_chose_and_beside_the_truth(measures):
    assert measures.flux_mae == pytest.approx(1.2e-3, rel=1e-9)  # the mean of both axes
    assert measures.flux_share == pytest.approx(1.2e-3 / 47.4e-3)
    assert measures.error == pytest.approx(0.25)
    assert (measures.horizon, measures.trained) == (8, pytest.approx(0.8))
    assert measures.one_step_train == pytest.approx(4.0)
    assert measures.one_step == pytest.approx({"b": 9.0, "c": 16.0})
    assert measures.unseen_one_step == pytest.approx(12.5)
    assert measures.free_run == {"b": 5.0, "c": np.inf}
    assert measures.others == {"dead_time_voltage": 2.4}


def test_one_unseen_run_that_diverges_does_not_decide_the_median(measures):
    three = replace(measures, free_run={**measures.free_run, "d": 6.0})
    assert three.unseen_free_run == 6.0
    nothing = replace(measures, free_run={}, one_step={})
    assert np.isnan([nothing.unseen_free_run, nothing.unseen_one_step]).all()


def test_measures_survive_a_file_that_knows_no_infinity(measures):
    text = json.dumps(asdict(measures)).replace("Infinity", "null")
    assert Measures.restored(json.loads(text)) == measures


@pytest.fixture
def run(measures):
    return Run("slow", "paper", 3, 0, measures, "", 7.0, 9.0)


def test_a_row_is_in_the_units_of_its_columns(run):
    cells = row(run)
    expected = {
        "R_mohm": 10.0,
        "R_std_mohm": 0.1,
        "R_true_mohm": 8.0,
        "R_error_percent": 25.0,
        "flux_mae_mVs": 1.2,
        "flux_mae_percent_of_psi_PM": 100 * 1.2 / 47.4,
        "one_step_mse_unseen_A2": 12.5,
        "free_run_rmse_unseen_A": np.inf,
        "dead_time_voltage": 2.4,
        "wall_time_s": 7.0,
        "processor_time_s": 9.0,
        "horizon": 8,
        "seed": 3,
    }
    assert {name: cells[name] for name in expected} == pytest.approx(expected)
    assert row(replace(run, horizon=100))["horizon"] == 100
    refused = row(replace(run, measures=None, refusal="it never dwells."))
    assert refused["horizon"] is None
    assert "R_mohm" not in refused


def test_series_leave_refused_runs_out_and_means_are_those_of_a_horizon(run, measures):
    other = replace(measures, resistance=0.014)
    gone = replace(run, horizon=10, measures=None, refusal="diverged.")
    runs = [replace(run, horizon=10), replace(run, horizon=10, measures=other), gone]
    runs.append(replace(run, horizon=20, measures=other))
    seen = Trained("slow", {"paper": runs}, run)
    assert seen.at(PAPER, 10, milliohm) == pytest.approx([10.0, 14.0])
    assert seen.mean(PAPER, 10, milliohm) == pytest.approx(12.0)
    assert seen.spread(PAPER, 10, milliohm) == pytest.approx(4.0)
    assert np.isnan([seen.mean(PAPER, 30, milliohm), seen.spread(PAPER, 30, milliohm)]).all()
    (series,) = seen.series(milliohm)
    assert (series.x, series.colour) == ([10.0, 10.0, 20.0], "paper")
    assert series.y == pytest.approx([10.0, 14.0, 14.0])
    assert "chose H = 8" in seen.star(milliohm).label
    assert len(replace(seen, ours=gone).star(milliohm).x) == 0


def test_limits_show_the_recipe_and_the_truth_but_nothing_infinite():
    wild = Series("", (1, 2, 3), (-70.0, 40.0, np.inf), "paper")
    assert limits(wild, 10.0) == pytest.approx((-119.0, 52.0))
    near = Series("", (1, 2), (9.0, 11.0), "paper")
    assert limits(near, 10.0) == pytest.approx((-10.0, 50.0))
    assert limits(Series("", (1,), (np.nan,), "paper"), 10.0) == pytest.approx((-10.0, 50.0))


def test_words_have_the_numbers_in_their_units(measures):
    said = in_numbers(measures)
    assert said.startswith("R 10.000 ± 0.100 mΩ (+25.00 %), map 2.53 % of ψ_PM, H = 8")
    assert listed([0.12345, -20.0], digits=2) == "0.12, -20"


def test_the_page_writes_lost_numbers_as_words_and_links_to_its_sections():
    rows = [{"R_mohm": 1234.5, "free_run_rmse_unseen_A": np.inf, "seed": 2, "refusal": ""}]
    columns = ("R_mohm", "free_run_rmse_unseen_A", "horizon", "seed", "refusal")
    title = "R over H, twice"
    result = StudyResult("one", title, "Why?", rows, (), (), "So.", columns)
    facts = {
        "extent": {"name": "full", "growth": (1, 4), "growth_steps": 7, "steps": 99},
        "versions": {"penode": "1.2"},
        "machine": "a computer",
        "python": "3.11",
        "wall_time_s": 7200.0,
    }
    page = results_page([result], facts)
    assert "| R (mΩ) | free run, unseen (A) | horizon | seed |\n|---|---|---|---|\n" in page
    assert "| 1.23e+03 | diverges | – | 2 |" in page
    assert "[R over H, twice](#r-over-h-twice) | 0 | 0 |" in page
    assert "took 120 min" in page
    assert "through 1, 4 with 7 gradient steps" in page
    assert "prove nothing" not in page
    quick = results_page([result], {**facts, "extent": {**facts["extent"], "name": "quick"}})
    assert "prove nothing" in " ".join(quick.split())
    assert "penode reproduce all --out DIR --quick" in quick
