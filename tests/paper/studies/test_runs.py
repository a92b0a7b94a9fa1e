"""Runs are kept as they end, and taken over where they were made the same way."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import record
from penode.errors import InputError
from penode.paper.conventional.linear_maps import polynomial
from penode.paper.conventional.linear_methods import FluxPredictor
from penode.paper.studies import runs as module
from penode.paper.studies.recordings import CASES, Case, fingerprint
from penode.paper.studies.runs import Measures, Place, Runs, measure
from penode.paper.studies.variants import AXES, FULL, PAPER, QUICK, SECOND_ORDER
from penode.training.first_order import FirstOrder


@pytest.fixture(scope="module")
def case():
    def short(rpm, rate, duration):
        return record(
            TRACTION_300A, Lissajous(150.0, rate, 1.1 * rate), speed_rpm=rpm, duration=duration
        )

    return Case("simulation", "short", short(300.0, 90.0, 0.15), (short(500.0, 60.0, 0.05),))


@pytest.fixture
def runs(tmp_path, monkeypatch, case):
    monkeypatch.setattr(module, "record_case", lambda name, extent: replace(case, name=name))
    said = []
    made = Runs(tmp_path, QUICK, said.append)
    made.said = said
    return made


def test_a_method_is_trained_once_and_measured_against_the_truth(runs, case):
    calls = []

    class Counted(FluxPredictor):
        def identify(self, *arguments):
            calls.append(1)
            return super().identify(*arguments)

    method = Counted(polynomial(3, reciprocal=True)).identify
    first = runs.by_method("simulation", "flux", method)
    again = Runs(runs.folder, QUICK, runs.said.append).by_method("simulation", "flux", method)
    assert calls == [1]
    assert again == first
    found = first.result
    assert found.true_resistance == TRACTION_300A.resistance
    fit = runs.fit(Place("simulation", "flux"))
    assert found.resistance == fit.parameters["R"].value
    points = np.array([[-60.0, 40.0], [20.0, -80.0]])
    gap = np.abs(fit.flux_map(*points.T).T - case.recording.truth.flux_map(*points.T))
    assert gap.mean() < 10 * found.flux_mae < 0.01
    assert list(found.one_step) == ["1: traction_300A at 500 rpm"]
    assert "R " in runs.said[1]
    assert runs.spent == first.wall_time


def test_a_run_made_with_other_sizes_is_made_anew(runs):
    method = FluxPredictor(polynomial(2)).identify
    runs.by_method("simulation", "flux", method)
    longer = Runs(runs.folder, replace(QUICK, share=0.2), runs.said.append)
    longer.by_method("simulation", "flux", method)
    assert sum("flux, seed 0" in line for line in runs.said) == 2
    record_file = runs.folder / "simulation" / "flux" / "seed0" / "H0" / "run.json"
    assert json.loads(record_file.read_text())["given"]["recordings"][0] == 0.2
    record_file.write_text("{broken")
    longer.by_method("simulation", "flux", method)
    assert sum("flux, seed 0" in line for line in runs.said) == 3


def test_every_case_has_a_fingerprint_of_its_own(monkeypatch):
    known = {name: fingerprint(name) for name in CASES}
    assert len(set(known.values())) == len(CASES)
    assert fingerprint("simulation") == known["simulation"]
    label, make = CASES["simulation"]
    warmer = (label, lambda: replace(make(), seed=7))
    monkeypatch.setitem(CASES, "simulation", warmer)
    assert fingerprint("simulation") != known["simulation"]


def test_a_refusal_is_kept_as_a_sentence(runs):
    def refusing(experiments, validation, observer):
        raise InputError("it never dwells.")

    run = runs.by_method("simulation", "picky", refusing)
    assert run.measures is None
    assert run.refusal == "it never dwells."
    assert Runs(runs.folder, QUICK, print).by_method("simulation", "picky", None) == run
    with pytest.raises(InputError, match="picky on simulation: it never dwells"):
        _ = run.result


def test_an_interrupted_run_leaves_those_before(runs):
    def stopped(experiments, validation, observer):
        raise KeyboardInterrupt

    runs.by_method("simulation", "flux", FluxPredictor(polynomial(2)).identify)
    with pytest.raises(KeyboardInterrupt):
        runs.by_method("simulation", "stopped", stopped)
    assert not list(runs.folder.glob("simulation/stopped/**/run.json"))
    assert list(runs.folder.glob("simulation/flux/**/run.json"))


def test_measures_that_are_infinite_survive_the_file(case):
    found = Measures(
        0.01, np.inf, 0.01, 1, "fixed", 1e-3, 0.05, 3.0, 1.0, {"a": 2.0}, {"a": np.inf}, {}
    )
    record_ = json.loads(json.dumps(asdict(found), default=str).replace("Infinity", "null"))
    assert Measures.restored(record_) == found
    fit = FluxPredictor(polynomial(2)).identify([case.experiment], case.validation)
    assert measure(fit, case.recording).unseen_one_step > 0


def test_the_papers_plan_grows_and_keeps_its_batches(case):
    run = case.experiment
    plans = PAPER.plans((1, 5, 30), run, 2, FULL)
    assert [stage.horizon for stage in plans[30].stages] == [1, 2, 5, 10, 20, 30]
    assert [stage.horizon for stage in plans[1].stages] == [1]
    optimisers = {stage.optimiser for stage in plans[30].stages}
    assert all(isinstance(o, FirstOrder) and o.seed == 2 for o in optimisers)
    batches = plans[30].stages[0].optimiser.batches
    assert plans[30].stages[-1].optimiser.epochs == FULL.steps // batches
    alone = SECOND_ORDER.plans((1, 5), run, 0, FULL)
    assert [len(plan.stages) for plan in alone.values()] == [1, 1]
    climbing = AXES[3].plans((1, 5), run, 0, FULL)
    assert [[s.horizon for s in plan.stages] for plan in climbing.values()] == [[1], [1, 5]]


@pytest.mark.parametrize("name", CASES)
def test_every_recording_is_as_it_says(name):
    label, make = CASES[name]
    simulation = make()
    rpm = getattr(simulation.speed_rpm, "rpm", simulation.speed_rpm)
    assert ("operating" in label or "motor" in label) or f"{rpm:g} rpm" in label
    assert (simulation.drive.resolver is not None) == ("bench" in label)
