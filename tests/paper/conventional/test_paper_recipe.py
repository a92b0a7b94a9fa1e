"""The paper's training: its schedule, its start, and that it trains."""

import numpy as np
import pytest

from penode.bench.machines import TRACTION_300A
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.data.windows import Contiguous
from penode.paper.conventional.trained_methods import PaperRecipe
from penode.pmsm.balance.start import nominal_start

pytestmark = pytest.mark.usefixtures("quickly_compiled")


@pytest.fixture(scope="module")
def run():
    return simulate(TRACTION_300A, Lissajous(200.0, 60.0, 65.0), speed_rpm=1500.0, duration=0.2)


def test_one_step_training_has_nothing_to_grow():
    assert [stage.horizon for stage in PaperRecipe(1).plan.stages] == [1]


def test_the_horizon_grows_and_stays():
    plan = PaperRecipe(10, seed=3, epochs=40).plan
    assert isinstance(plan.placement, Contiguous)
    told = [(stage.horizon, stage.optimiser.epochs) for stage in plan.stages]
    assert told == [(1, 75), (2, 75), (5, 75), (10, 40)]
    assert {stage.optimiser.seed for stage in plan.stages} == {3}
    assert plan.stages[0].optimiser.physical_scale == pytest.approx(0.1)


def test_the_start_knows_the_map_roughly_and_nothing_of_the_resistance(run):
    starts = [nominal_start([run], seed) for seed in range(8)]
    resistances = np.array([start.terms[0].R for start in starts])
    assert ((resistances >= 0) & (resistances < 0.02)).all()
    assert np.ptp(resistances) > 0.005
    for start in starts:
        psi = start.maps()["flux_map"](np.array([0.0]), np.array([0.0]))[:, 0]
        assert np.abs(psi - [TRACTION_300A.magnet_flux_linkage, 0.0]).max() < 0.02
        inductance = start.maps()["differential_inductance"](0.0, 0.0)
        assert np.linalg.det(inductance) > 0
    again = nominal_start([run], 5)
    assert np.array_equal(again.terms[0].R, starts[5].terms[0].R)
    first = [start.flux.network.network.weights[0] for start in (again, starts[5], starts[4])]
    assert np.array_equal(first[0], first[1])
    assert not np.array_equal(first[0], first[2])


@pytest.mark.slow
def test_the_recipe_trains(run):
    losses = []

    def note(event):
        if event["event"] == "evaluation":
            losses.append(event["loss"])

    fit = PaperRecipe(5, epochs=10, batches=4, growth=(1,), growth_epochs=5).identify(
        [run], observer=note
    )
    assert fit.horizon.selected == 5
    assert len(losses) == 15
    assert losses[4] < 0.9 * losses[0]
    assert [rung.iterations for rung in fit.horizon.ladder] == [5, 10]
    assert fit.parameters["R"].value != nominal_start([run], 0).terms[0].R
