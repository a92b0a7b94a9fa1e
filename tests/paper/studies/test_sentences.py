"""What the studies say follows from the numbers, and turns with them."""

import pytest

from penode.paper.studies.over_horizons import (
    flux_error_vs_horizon,
    generalisation_vs_horizon,
    resistance_vs_horizon,
    subdomain,
    well_designed,
)
from penode.paper.studies.side_by_side import METHODS, method_table


def told(study, runs):
    return [claim.holds for claim in study(runs).claims]


def test_the_papers_pattern_is_recognised(made_up, as_in_the_paper):
    made_up.changes["paper"] = as_in_the_paper
    assert told(resistance_vs_horizon, made_up) == [True, True, True, True, True]
    assert told(flux_error_vs_horizon, made_up) == [True, True]
    assert told(generalisation_vs_horizon, made_up) == [True, True, True]


@pytest.mark.parametrize(
    ("which", "change"),
    [
        (0, lambda h, s: {"resistance": 1e-4} if (h, s) == (10, 2) else {}),
        (1, lambda h, s: {"resistance": 0.03} if (h, s) == (100, 1) else {}),
        (2, lambda h, s: {"resistance": -0.19} if (h, s) == (1, 0) else {}),
    ],
)
def test_one_seed_that_differs_breaks_the_statement(made_up, as_in_the_paper, which, change):
    made_up.changes["paper"] = lambda h, s: {**as_in_the_paper(h, s), **change(h, s)}
    held = told(resistance_vs_horizon, made_up)
    assert not held[which]


def test_other_statements_break_too(made_up, as_in_the_paper):
    made_up.changes["paper"] = lambda h, s: {**as_in_the_paper(h, s), "flux_mae": 0.01}
    assert told(flux_error_vs_horizon, made_up) == [False, True]
    errors = {"one_step": {"900 rpm": 9.0, "2500 rpm": 12.0}, "one_step_train": 1.0}
    made_up.changes["paper"] = lambda h, s: {**as_in_the_paper(h, s), **errors}
    assert told(generalisation_vs_horizon, made_up) == [False, True, True]
    made_up.changes["ours"] = lambda h, s: {"resistance": 0.0103}
    assert told(resistance_vs_horizon, made_up)[4] is False
    made_up.changes["second_order"] = lambda h, s: {"trained": 3.0 if h == 100 else 4.0}
    assert told(resistance_vs_horizon, made_up)[3] is False


def test_a_marker_a_seed_and_a_row_a_run(made_up, as_in_the_paper):
    made_up.changes["paper"] = as_in_the_paper
    result = resistance_vs_horizon(made_up)
    paper = result.panels[0].series[0]
    assert len(paper.x) == 12
    assert sorted(set(paper.x)) == [1.0, 10.0, 20.0, 100.0]
    assert result.panels[0].truth == pytest.approx(10.0)
    rows = [row for row in result.rows if row["method"] == "paper"]
    assert len(rows) == 12
    assert rows[0]["R_mohm"] == pytest.approx(-70.0)
    assert rows[0]["flux_mae_percent_of_psi_PM"] == pytest.approx(20.0)


def test_a_refused_run_leaves_a_gap_and_no_number(made_up, as_in_the_paper):
    made_up.changes["paper"] = as_in_the_paper
    made_up.changes["jittered"] = lambda h, s: "diverged." if (h, s) == (20, 1) else {}
    result = resistance_vs_horizon(made_up)
    jittered = next(s for s in result.panels[0].series if s.colour == "jittered")
    assert len(jittered.x) == 11
    gone = [row for row in result.rows if row["refusal"]]
    assert [row["horizon"] for row in gone] == [20]
    assert "R_mohm" not in gone[0]


def test_a_flat_resistance_holds_and_one_wrong_horizon_does_not(made_up):
    assert all(told(well_designed, made_up))
    made_up.changes["inverter"] = lambda h, s: {"resistance": 0.01021} if h == 100 else {}
    assert told(well_designed, made_up) == [True, False, True] * 2
    assert [panel.truth for panel in well_designed(made_up).panels] == [0.0, 0.0]


def test_motor_operation_compares_both_ends(made_up, as_in_the_paper):
    made_up.changes["paper"] = as_in_the_paper
    assert told(subdomain, made_up) == [True, True]
    made_up.changes["paper"] = lambda h, s: {"resistance": 0.01 + 1e-4 * h}
    assert told(subdomain, made_up) == [False, True]


def test_the_table_has_every_method_on_every_recording_and_dashes(made_up):
    made_up.changes["stationary_averaging"] = lambda h, s: "it never dwells."
    made_up.changes["neural_ode_1"] = lambda h, s: {"resistance": -0.05}
    result = method_table(made_up)
    assert len(result.rows) == len(METHODS) * len(made_up.extent.recordings)
    errors = result.panels[0]
    assert errors.rows == tuple(label for label, _ in METHODS.values())
    by_method = dict(zip(errors.rows, errors.values, strict=True))
    assert by_method["neural ODE, H = 1"] == pytest.approx([600.0] * 6)
    assert all(value != value for value in by_method["stationary averaging"])
    assert result.claims[0].holds
    made_up.changes["ours"] = lambda h, s: {"resistance": 0.0103}
    assert not method_table(made_up).claims[0].holds
