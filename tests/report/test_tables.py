"""Tables and sentences say what the record says."""

import dataclasses
import math

import numpy as np
import pytest

from penode.fit.fit import Estimate
from penode.report.quantities import number
from penode.report.sections import parameters
from penode.report.statements import (
    estimate_text,
    free_run_text,
    free_run_value,
    ladder_title,
    one_step_value,
    overlay_title,
    range_text,
    spectrum_title,
    verdict_notice,
)
from penode.report.tables import ladder_table, parameter_table, provenance_table, validation_table

GAP = "\N{NO-BREAK SPACE}"
STATES = (("x", "m"), ("v", "m/s"))


def texts(row):
    return [cell.text for cell in row.cells]


def test_parameters_are_shown_with_prefix_and_matching_digits(fit):
    interval = (9.849e-3, 10.187e-3)
    estimate = Estimate(10.0184e-3, 0.0861e-3, interval, "ohm", 0.7612, "stator resistance")
    fit.parameters = {"R": estimate}
    table = parameter_table(fit)
    expected = ["R, stator resistance", "10.018", "0.086", "9.849 to 10.187", "mΩ", "0.76"]
    assert texts(table.rows[0]) == expected
    assert table.rows[0].cells[1].value == 10.0184e-3


def test_unknown_identifiability_is_a_dash(fit):
    assert texts(parameter_table(fit).rows[1])[-1] == "–"


def test_ladder_marks_the_selected_horizon_and_its_plateau(choice):
    table = ladder_table(choice, {"mass": "kg"}, STATES[:1])
    assert [row.mark for row in table.rows] == ["", "", "", *["plateau"] * 2, "selected", "plateau"]
    assert table.columns[1] == f"mass in{GAP}kg"
    assert texts(table.rows[5])[:3] == ["50", "1.0180", "0.0040"]
    assert "a: Converged." in table.caption


def test_diverged_runs_are_named_and_not_given_a_number(choice, comparison):
    first = dataclasses.replace(choice.ladder[0], free_run_rmse=None)
    table = ladder_table(dataclasses.replace(choice, ladder=(first,)), {"mass": "kg"}, STATES[:1])
    assert "diverged" in texts(table.rows[0])
    broken = comparison.free_run.copy()
    broken[500:] = np.nan
    lost = dataclasses.replace(comparison, free_run=broken)
    assert texts(validation_table([lost]).rows[0])[-1] == "diverged"
    assert free_run_text(lost) == "diverged"
    assert (
        overlay_title(lost)
        == f"cart.csv (used for training): the free run diverges after 500{GAP}ms"
    )
    assert free_run_value([lost]).doubtful


def test_a_horizon_without_an_interval_is_said_to_have_no_weight(fit, choice):
    assert "has no weight" not in ladder_table(choice, {"mass": "kg"}, STATES[:1]).caption
    assert "no weight" not in parameters(fit).blocks[-1].caption
    first = dataclasses.replace(choice.ladder[0], std={"mass": math.inf})
    unknown = dataclasses.replace(choice, ladder=(first, *choice.ladder[1:]))
    assert "(∞)" in ladder_table(unknown, {"mass": "kg"}, STATES[:1]).caption
    fit.horizon = unknown
    captions = {block.title: block.caption for block in parameters(fit).blocks}
    said = [caption.endswith("no interval, and no weight.") for caption in captions.values()]
    assert sum(said) == 1


def test_columns_name_a_unit_only_where_all_states_share_it(comparison):
    assert validation_table([comparison]).columns[3:] == (
        f"one-step rmse of x in{GAP}m",
        f"one-step rmse of v in{GAP}m/s",
        f"free-run rmse of x in{GAP}m",
        f"free-run rmse of v in{GAP}m/s",
    )
    same = dataclasses.replace(comparison, units=("A", "A"))
    assert validation_table([same]).columns[-1] == f"free-run rmse in{GAP}A"


def test_recordings_not_used_for_training_count_first(comparison):
    worse = dataclasses.replace(comparison, free_run=comparison.free_run + 1.0)
    unseen = dataclasses.replace(comparison, role="validation", name="unseen.csv")
    shown = free_run_value([worse, unseen])
    assert "not used for training" in shown.detail
    x, v = unseen.free_run_errors.values()
    assert shown.text == f"x{GAP}{number(x)}{GAP}m, v{GAP}{number(v)}{GAP}m/s"
    same = dataclasses.replace(worse, units=("A", "A"))
    assert free_run_value([same]).value == same.free_run_rmse
    assert free_run_value([]) is None


def test_errors_are_one_number_a_state_where_units_differ(choice, comparison):
    values = [cell.value for cell in validation_table([comparison]).rows[0].cells[3:]]
    errors = (comparison.one_step_errors, comparison.free_run_errors)
    assert values == [error for each in errors for error in each.values()]
    x, v = comparison.one_step_errors.values()
    shown = one_step_value([comparison])
    assert shown.text == f"x{GAP}{number(x)}{GAP}m, v{GAP}{number(v)}{GAP}m/s"
    assert shown.value is None
    same = dataclasses.replace(comparison, units=("A", "A"))
    assert one_step_value([same]).value == same.one_step_rmse
    blind = dataclasses.replace(comparison, one_step=np.nan * comparison.one_step)
    assert one_step_value([blind]) is None


def test_ladder_has_a_free_run_error_a_state_where_units_differ(choice):
    rung = dataclasses.replace(
        choice.ladder[0], free_run_rmse=None, free_run_errors={"x": 0.25, "v": None}
    )
    table = ladder_table(dataclasses.replace(choice, ladder=(rung,)), {"mass": "kg"}, STATES)
    first = table.columns.index(f"free-run rmse of x in{GAP}m")
    assert texts(table.rows[0])[first : first + 2] == ["0.250", "diverged"]
    assert table.columns[first - 1] == "H-step rmse, scaled"


def test_provenance_is_flat_and_named_by_path():
    table = provenance_table({"versions": {"jax": "1"}, "data": [{"sha": "ab"}], "seeds": [1, 2]})
    assert texts(provenance_table({"why": ["One.", "Two."]}).rows[0]) == ["why", "One. Two."]
    assert [texts(row) for row in table.rows] == [
        ["versions.jax", "1"],
        ["data[0].sha", "ab"],
        ["seeds", "1, 2"],
    ]


def test_estimate_in_words():
    estimate = Estimate(10.0184e-3, 0.0861e-3, (9.849e-3, 10.187e-3), "ohm")
    assert estimate_text(estimate) == (f"10.018{GAP}mΩ", f"9.849 to 10.187{GAP}mΩ")


def test_range_in_words():
    assert range_text([4e-3, math.nan, 39.2e-3], "ohm") == f"4.0 to 39.2{GAP}mΩ"
    assert range_text([math.nan], "ohm") == "–"


@pytest.mark.parametrize(
    ("verdict", "tone"),
    [
        ("plateau", "good"),
        ("H = 1 suffices", "good"),
        ("fixed", "caution"),
        ("no plateau", "refusal"),
        ("not identifiable", "refusal"),
    ],
)
def test_verdict_has_a_tone_and_keeps_its_reason(choice, verdict, tone):
    notice = verdict_notice(dataclasses.replace(choice, verdict=verdict))
    assert notice.tone == tone
    assert choice.reason in notice.text


def test_ladder_title_claims_agreement_only_where_it_holds(fit):
    assert "same within its uncertainty from H = 10 to H = 100" in ladder_title(fit, "mass")
    fit.horizon = dataclasses.replace(fit.horizon, plateau=(1, 50))
    assert ladder_title(fit, "mass") == f"mass spans 1.018 to 1.900{GAP}kg over 7 horizons"
    fit.horizon = dataclasses.replace(fit.horizon, verdict="no plateau", plateau=())
    assert ladder_title(fit, "mass").startswith("No plateau: mass spans")


def test_spectrum_title_names_a_line_only_where_one_is(spectrum):
    same = (("x", "m"), ("y", "m"))
    strongest = f"The strongest line of the residual lies in x, at 50.0{GAP}Hz"
    assert spectrum_title(spectrum, same) == strongest
    assert spectrum_title(spectrum, same, [(50.02, "6×")]).endswith("Hz, 6×")
    assert spectrum_title(spectrum, same, [(60.0, "6×")]).endswith("Hz")
    silent = dataclasses.replace(spectrum, amplitude=np.zeros_like(spectrum.amplitude))
    assert spectrum_title(silent, same) == "Nothing is left in the residual"


def test_spectrum_title_compares_no_two_units(spectrum):
    amplitude = spectrum.amplitude.copy()
    amplitude[24 * 3, 1] = 40.0
    both = dataclasses.replace(spectrum, amplitude=amplitude)
    assert spectrum_title(both, STATES) == (
        f"The strongest lines of the residual: x at 50.0{GAP}Hz and v at 3.00{GAP}Hz"
    )


def test_without_an_answer_nothing_is_marked_as_agreeing(fit):
    fit.horizon = dataclasses.replace(fit.horizon, verdict="no plateau")
    assert parameter_table(fit).caption.startswith("For diagnosis only; the data cannot answer. ")
    marks = [row.mark for row in ladder_table(fit.horizon, {"mass": "kg"}, STATES).rows]
    assert marks == ["", "", "", "", "", "selected", ""]


def test_identifiability_has_no_column_where_it_was_not_computed(fit):
    fit.parameters = {"gain": Estimate.of(0.25, 0.01, "")}
    table = parameter_table(fit)
    assert table.columns[-1] == "unit"
    assert texts(table.rows[0]) == ["gain", "0.250", "0.010", "0.230 to 0.270", "1"]
    assert "Identifiability" not in table.caption


def test_outcomes_are_letters_explained_once_and_numbers_after_z(choice):
    ends = ["Converged.", "Stalled.", "Converged.", *(f"End {k}." for k in range(25))]
    ladder = tuple(dataclasses.replace(choice.ladder[0], outcome=end) for end in ends)
    table = ladder_table(dataclasses.replace(choice, ladder=ladder), {"mass": "kg"}, STATES)
    shown = [texts(row)[-1] for row in table.rows]
    assert shown[:4] == ["a", "b", "a", "c"]
    assert shown[-2:] == ["z", "27"]
    assert table.caption.count("Converged.") == 1
    assert "y: End 22. z: End 23. 27: End 24." in table.caption


def test_a_ladder_shows_one_scale_and_keeps_si_values_behind(choice):
    first, second = choice.ladder[:2]
    first = dataclasses.replace(
        first, parameters={"R": 0.01}, std={"R": 2e-4}, free_run_rmse=math.inf
    )
    made = dataclasses.replace(choice, ladder=(first, second))
    table = ladder_table(made, {"R": "ohm"}, (("i_d", "A"), ("i_q", "A")))
    assert table.columns[1:5] == (
        f"R in{GAP}mΩ",
        "± std",
        f"H-step rmse in{GAP}A",
        f"free-run rmse in{GAP}A",
    )
    assert texts(table.rows[0])[1:5] == ["10.00", "0.20", "0.0130", "diverged"]
    assert [cell.value for cell in table.rows[0].cells[1:3]] == [0.01, 2e-4]
    assert texts(table.rows[1])[1:3] == ["–", "–"], "a horizon may lack a parameter"


def test_recordings_say_how_long_they_are_and_what_they_were_used_for(comparison):
    blind = dataclasses.replace(comparison, one_step=np.nan * comparison.one_step)
    cells = texts(validation_table([blind]).rows[0])
    assert cells[:3] == ["cart.csv", "training", "10.0"]
    assert cells[3:5] == ["–", "–"]
    assert validation_table([]).rows == ()


def test_settings_are_shown_to_six_digits_and_nothing_is_lost():
    nested = {"plan": {"stages": [{"H": 1}, {"H": 2, "tie": 1.23456789}], "seeds": (1.0, "a")}}
    assert [texts(row) for row in provenance_table({**nested, "none": {}}).rows] == [
        ["plan.stages[0].H", "1"],
        ["plan.stages[1].H", "2"],
        ["plan.stages[1].tie", "1.23457"],
        ["plan.seeds", "1, a"],
        ["none", "{}"],
    ]


def test_an_interval_without_ends_is_called_so(fit):
    fit.parameters["mass"] = Estimate(1.0, np.inf, (-np.inf, np.inf), "kg")
    assert "unbounded" in texts(parameter_table(fit).rows[0])
