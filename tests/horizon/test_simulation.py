"""Which rung simulates best, and what that says of a plateau."""

from dataclasses import replace

import numpy as np
import pytest
from tests.horizon.test_default_plan import Lag
from tests.horizon.test_selection import rung

from penode import Experiment, identify
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.horizon import as_recorded, assemble, learned_part
from penode.horizon.ladder import LadderProblem
from penode.horizon.selection import Choice
from penode.horizon.simulation import best_in_free_run, better_by_chance, confirmed, parting
from penode.validation.comparison import Comparison


class Made(Lag):
    """A model of one physical parameter, for rungs made by hand."""


def rungs(errors, values):
    """Return rungs of a parameter known to 0.01 with errors of their free runs."""
    made = [rung(2**k, [value], [0.01]) for k, value in enumerate(values)]
    return [
        replace(r, model=Made(1.0), free_run=np.array([error]))
        for r, error in zip(made, errors, strict=True)
    ]


PLATEAU = Choice(1, "plateau", "They agree.", (0, 1, 2))


def test_the_least_error_of_free_runs_is_best_and_the_shorter_of_two():
    assert best_in_free_run(rungs([3.0, 1.005, 1.0, 1.0], [1.0] * 4)) == 2


def test_a_plateau_that_simulates_as_well_as_any_stands():
    made = rungs([1.0, 1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 2.0])
    assert confirmed(PLATEAU, made) is PLATEAU
    assert parting(PLATEAU, made) == ()


@pytest.mark.parametrize(("error", "verdict"), [(0.8, "plateau"), (0.5, "no plateau")])
def test_another_horizon_that_simulates_better_with_other_parameters(error, verdict):
    """A little better is a misfit that is said; twice as good, and the plateau is none."""
    made = rungs([1.0, 1.0, 1.0, error], [1.0, 1.0, 1.0, 2.0])
    found = confirmed(PLATEAU, made)
    assert found.verdict == verdict
    if verdict == "plateau":
        (sentence,) = parting(found, made)
        assert "H = 8" in sentence
        assert "a = 2 outside the interval" in sentence
    else:
        assert found.index == 3
        assert "short horizons are biased" in found.reason
        assert parting(found, made) == ()


def test_a_free_run_as_good_within_the_plateau_is_no_contradiction():
    """In chaotic motion errors differ by luck: those of horizons that agree as much as any."""
    made = rungs([1.0, 1.0, 0.3, 0.25], [1.0, 1.0, 1.0, 2.0])
    assert confirmed(PLATEAU, made) is PLATEAU
    made = rungs([1.0, 1.0, 1.0, 0.25], [1.0, 1.0, 1.0, 2.0])
    assert confirmed(PLATEAU, made).verdict == "no plateau"


def test_better_with_the_same_parameters_is_no_contradiction():
    made = rungs([1.0, 1.0, 1.0, 0.1], [1.0, 1.0, 1.0, 1.001])
    assert confirmed(PLATEAU, made) is PLATEAU
    assert parting(PLATEAU, made) == ()


@pytest.mark.parametrize(
    "choice", [replace(PLATEAU, verdict=verdict) for verdict in ("fixed", "no plateau")]
)
def test_only_a_plateau_is_judged(choice):
    assert confirmed(choice, rungs([1.0, 1.0, 1.0, 0.1], [1.0, 1.0, 1.0, 2.0])) is choice


def lag(samples=800, seed=0):
    random = np.random.default_rng(seed)
    u = np.repeat(random.normal(size=samples // 8), 8)
    x = np.zeros(samples)
    for k in range(samples - 1):
        x[k + 1] = u[k] + (x[k] - u[k]) * np.exp(-0.3)
    return Experiment("lag", 0.1, {"x": x + 0.01 * random.normal(size=samples), "u": u})


def test_one_climb_serves_both_purposes_and_is_kept(tmp_path):
    run = lag()
    fit = identify(Lag(1.0), [run])
    simulated = identify(Lag(1.0), [run], purpose="simulation")
    assert simulated.horizon.verdict == "predicts best"
    assert fit.horizon.verdict == "plateau"
    assert float(fit.simulation.a) == float(fit.model.a)
    assert float(simulated.simulation.a) == float(simulated.model.a)
    fit.save(tmp_path)
    assert float(Fit.load(tmp_path).simulation.a) == float(fit.simulation.a)


def test_a_free_run_better_beyond_chance_is_simulated_with(monkeypatch):
    """Where it is within chance, the plateau's model is; both of one climb."""
    fits = {}
    for chance in (True, False):
        monkeypatch.setattr(assemble, "better_by_chance", lambda *given, said=chance: said)
        fits[chance] = identify(Lag(1.0), [lag(seed=1)])
    ladder = fits[False].horizon.ladder
    best = min(ladder, key=lambda h: h.free_run_rmse)
    assert best.horizon != fits[False].horizon.selected
    assert float(fits[False].simulation.a) == pytest.approx(best.parameters["a"])
    assert float(fits[True].simulation.a) == float(fits[True].model.a)


@pytest.mark.parametrize(("bias", "chance"), [(0.0, True), (0.02, True), (1.0, False)])
def test_chance_is_judged_over_stretches_of_a_recording(bias, chance):
    noise = np.random.default_rng(0).normal(size=(2, 800, 1))
    measured = np.zeros((800, 1))
    one, other = (
        Comparison("run", "train", 0.1, ("x",), ("1",), measured, measured, free_run)
        for free_run in (noise[0], noise[1] + bias)
    )
    assert better_by_chance([one], [other], past=1) == chance


def test_a_purpose_that_there_is_not_is_refused():
    with pytest.raises(InputError, match="purpose must be one of parameters, simulation, one_step"):
        identify(Lag(1.0), [lag()], purpose="control")


def test_the_better_of_two_minima_is_returned(monkeypatch):
    """The ladder is led astray; training from the start alone finds less loss, and is followed."""
    climb, calls = LadderProblem.climb, []

    def astray(problem, plan, raw):
        calls.append(raw)
        found = climb(problem, plan, raw)
        if len(calls) > 1:
            return found
        return replace(found, fits=tuple(map(_worse, found.fits)))

    monkeypatch.setattr(LadderProblem, "climb", astray)
    monkeypatch.setattr(learned_part, "with_hold", lambda plan, *given: plan)
    monkeypatch.setattr(as_recorded, "too_coarse", lambda *given: None)
    fit = identify(Lag(1.0), [lag()])
    assert len(calls) == 2
    assert fit.parameters["a"].value == pytest.approx(3.0, rel=0.05)


def _worse(one):
    """Return a rung with other values, and as much more loss."""
    terms = replace(one.solution.terms, loss=9 * one.solution.terms.loss)
    return replace(one, solution=replace(one.solution, terms=terms), values=one.values * 1.5)
