"""From a recording to a machine, and the files written."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import penode
from penode.bench.machines import TRACTION_300A
from penode.errors import InputError
from penode.fit.learned_uncertainty import physical_slopes
from penode.horizon.objections import CHECKS, objections, with_objections
from penode.pmsm import study as study_module
from penode.pmsm.result_files import GRID, flux_map_csv, write
from penode.pmsm.study import identify
from penode.pmsm.study_settings import Study
from penode.predictors.base import Predictor
from penode.validation.free_run import compare


@pytest.fixture(scope="module")
def fit(slow_run, unseen_run):
    study = Study(horizon=27, candidates=(), angle_orders=())
    return identify([slow_run], pole_pairs=5, study=study, validation=[unseen_run])


def test_resistance_is_right_and_inside_its_interval(fit):
    estimate = fit.parameters["R"]
    low, high = estimate.interval_95
    assert abs(estimate.value / TRACTION_300A.resistance - 1) < 0.05
    assert low <= TRACTION_300A.resistance <= high
    assert estimate.unit == "ohm"
    assert fit.horizon.selected == 27
    assert fit.horizon.verdict == "fixed"


def test_a_fit_knows_what_each_gain_moves_its_estimate_by(fit):
    """Voltages half a per cent too large make R about as much larger, currents smaller."""
    shifts, slopes = fit.learned_uncertainty.shifts, physical_slopes(fit.model)[0]
    share = {
        source: slopes @ shifts[source] / fit.parameters["R"].value
        for source in ("gain of the voltages", "gain of the currents", "gain of the speed")
    }
    assert list(share.values()) == pytest.approx([0.005, -0.005, 0.0], abs=1.5e-3)


def test_what_no_recording_shows_is_in_the_result(fit):
    told = " ".join(fit.provenance["structure"])
    assert "Values are taken as peak, which dq values of a controller are" in told
    assert "pole_pairs = 5 is taken as given" in told


def test_the_default_ladder_spans_a_factor_of_450_and_estimates_the_starts(slow_run):
    study = Study(angle_orders=(6,))
    long = replace(slow_run, channels={n: np.tile(v, 2) for n, v in slow_run.channels.items()})
    plan = study.plan([long])
    assert [stage.horizon for stage in plan.stages] == [1, 3, 12, 40, 135, 450]
    assert plan.loss.free_starts == {"i_d": 1.0, "i_q": 1.0}


def test_the_weak_forms_own_bias_counts_where_it_is_compared(slow_run):
    start = study_module._start([slow_run], Study(candidates=(), angle_orders=()), ())
    value, deviation = start.anchor["R"]
    assert deviation > 0.01 * value


def test_free_run_on_unseen_speed_stays_close(fit):
    unseen = next(c for c in fit.comparisons if c.role == "validation")
    ripple = 6.0  # the unmodelled harmonics alone leave about 3 A
    assert unseen.free_run_rmse < ripple


@pytest.mark.parametrize(
    ("factors", "fails"),
    [({}, False), ({"i_q": -1.0}, True), ({"i_d": -1.0, "i_q": -1.0}, True), ({"u_d": 1.5}, True)],
)
def test_an_unseen_recording_with_another_sign_or_scale_fails(
    fit, slow_run, unseen_run, factors, fails
):
    plan = Study(horizon=27).plan([slow_run])
    predictor = Predictor(slow_run.time_step, plan.solver, plan.hold)
    channels = {n: factors.get(n, 1.0) * v for n, v in unseen_run.channels.items()}
    unseen = compare(predictor, fit.model, replace(unseen_run, channels=channels))
    trained = [c for c in fit.comparisons if c.role == "train"]
    fit = replace(fit, comparisons=(*trained, unseen))
    judged = with_objections(fit, objections(fit, [slow_run], CHECKS))
    assert (judged.horizon.verdict == "implausible") == fails
    assert ("Validation fails: " in judged.horizon.reason) == fails


@pytest.mark.slow
def test_unconstrained_map_at_one_speed_is_called_unanswerable(slow_run):
    study = Study(flux_map="mlp", horizon=1, candidates=(), angle_orders=())
    fit = identify([slow_run], study=study)
    assert fit.horizon.verdict == "not identifiable"
    assert not fit.horizon.answered
    assert fit.parameters["R"].value < 0
    assert any(
        "cannot distinguish R" in warning and "coenergy" in warning for warning in fit.warnings
    )


def test_flux_map_csv_is_the_fits_own_map(fit):
    rows = list(csv.DictReader(flux_map_csv(fit).splitlines()))
    assert len(rows) == GRID**2
    table = np.array([[float(row[name]) for name in row] for row in rows])
    psi = fit.flux_map(table[:, 0], table[:, 1])
    np.testing.assert_allclose(table[:, 2:4].T, psi, rtol=1e-6, atol=1e-10)
    inductance = fit.differential_inductance(table[:, 0], table[:, 1]).reshape(4, -1)
    # Currents are printed with nine digits, so an element near zero has fewer.
    digits = 1e-8 * np.abs(inductance).max()
    np.testing.assert_allclose(table[:, 4:8].T, inductance, rtol=1e-6, atol=digits)
    reach = np.hypot(table[:, 0], table[:, 1])
    assert table[reach < 200, 8].mean() > 0.6  # one second of the trajectory leaves gaps
    assert table[reach > 300, 8].max() == 0


def test_everything_written_reads_back(fit, slow_run, tmp_path):
    write(fit, tmp_path)
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["parameters"]["R"]["value"] == fit.parameters["R"].value
    magnet, l_q = (result["no_current"][name] for name in ("psi_PM", "L_q"))
    low, high = magnet["interval_95"]
    assert low < magnet["value"] == float(fit.flux_map(0.0, 0.0)[0]) < high
    assert l_q["value"] == pytest.approx(float(fit.differential_inductance(0.0, 0.0)[1, 1]))
    low, high = l_q["interval_95"]
    deviation = fit.learned_deviation(np.zeros((1, 2)), np.array([0.0, 1.0]))[0, 1]
    assert high - low == pytest.approx(2 * 1.96 * deviation, rel=1e-3)
    assert 0 < deviation < 0.05 * l_q["value"]
    assert set(result["metrics"]["train"][slow_run.name]) == {
        "one_step_rmse_A",
        "free_run_rmse_A",
        "states",
    }
    assert "<html" in (tmp_path / "report.html").read_text()
    again = penode.Fit.load(tmp_path)
    np.testing.assert_array_equal(again.flux_map(50.0, -80.0), fit.flux_map(50.0, -80.0))
    assert again.result() == json.loads(json.dumps(fit.result())) or again.horizon == fit.horizon


@pytest.mark.parametrize("place", ["fit.npz", "fit.json", "result.json", "flux_map.csv"])
def test_an_interrupted_writing_leaves_the_result_of_before_whole(
    fit, tmp_path, monkeypatch, place
):
    monkeypatch.setattr(
        "penode.pmsm.report.machine_report.machine_report", lambda fit, against: "<html>"
    )
    write(fit, tmp_path)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*.*")}
    write_file = Path.write_bytes

    def interrupted(path, content):
        if path.name == place:
            raise KeyboardInterrupt
        return write_file(path, content)

    monkeypatch.setattr(Path, "write_bytes", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write(replace(fit, warnings=("other",)), tmp_path)
    assert {p: p.read_bytes() for p in tmp_path.rglob("*.*")} == before


@pytest.mark.slow
def test_a_stuck_current_is_warned_of(slow_run):
    held = slow_run.channels["i_d"].copy()
    held[3000:3400] = held[3000]
    run = replace(slow_run, channels={**slow_run.channels, "i_d": held})
    plain = Study(horizon=1, candidates=(), angle_orders=())
    warnings = identify([run], study=plain).warnings
    assert any("i_d" in warning for warning in warnings)


@pytest.mark.parametrize("choice", [{"flux_map": "magic"}, {"horizon": 0}])
def test_unknown_choices_are_refused(choice):
    with pytest.raises(InputError):
        Study(**choice)
