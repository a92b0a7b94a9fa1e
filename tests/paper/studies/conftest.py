"""Runs without training: what a study is given is made up, so that its sentences can be tested."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import pytest

from penode.paper.studies.recordings import CASES
from penode.paper.studies.runs import Measures, Run
from penode.paper.studies.variants import FULL, Extent

GOOD = Measures(
    resistance=0.01,
    deviation=1e-5,
    true_resistance=0.01,
    horizon=8,
    verdict="plateau",
    flux_mae=5e-5,
    magnet_flux=0.05,
    trained=4.0,
    one_step_train=1.0,
    one_step={"900 rpm": 0.05, "2500 rpm": 0.06},
    free_run={"900 rpm": 2.0, "2500 rpm": 3.0},
    others={},
)


@dataclass
class MadeUp:
    """Stands for `Runs`: measures, or a refusal, by method as a function of horizon and seed."""

    extent: Extent
    changes: dict = field(default_factory=dict)

    def at_horizons(self, case, variant, horizons, seeds):
        return [self.run(case, variant.name, s, h) for s in seeds for h in horizons]

    def by_method(self, case, name, method):
        return self.run(case, name, 0, 0)

    def case(self, name):
        return SimpleNamespace(label=CASES[name][0])

    def ours(self, case):
        return self.run(case, "ours", 0, 0)

    def run(self, case, name, seed, horizon):
        change = self.changes.get(name, lambda h, s: {})(horizon, seed)
        if isinstance(change, str):
            return Run(case, name, seed, horizon, None, change, 1.0, 1.0)
        found = replace(GOOD, **{"horizon": horizon or GOOD.horizon, **change})
        return Run(case, name, seed, horizon, found, "", 1.0, 1.0)


@pytest.fixture
def made_up():
    extent = replace(FULL, horizons=(1, 10, 20, 100), few_horizons=(1, 100), seeds=(0, 1, 2))
    return MadeUp(extent)


@pytest.fixture
def as_in_the_paper():
    """R far below zero at short horizons and near the truth at long ones, seeds agreeing."""
    resistance = {1: -0.07, 10: -0.09, 20: -0.05, 100: 0.012}

    def paper(horizon, seed):
        return {
            "resistance": resistance[horizon] + 1e-4 * seed,
            "flux_mae": 0.01 / horizon**0.5,
            "one_step_train": 1.0 + 1e-3 * horizon,
            "one_step": {"900 rpm": 9.0 / horizon, "2500 rpm": 12.0 / horizon},
        }

    return paper
