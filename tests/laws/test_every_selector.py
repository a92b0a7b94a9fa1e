"""Every selector of a horizon: a valid choice from any ladder, without a warning.

Selectors are found, not listed: a class of `penode.horizon` or `penode.paper` with a method
``select``.
"""

import importlib
import inspect
import pkgutil
import warnings
from dataclasses import fields, replace

import jax
import numpy as np
import pytest

import penode.horizon
import penode.paper
from penode import ladder_plan
from penode.fit.outcome import AGREED
from penode.horizon.ladder import LadderProblem, ignore_events

HORIZONS = (1, 4, 16, 40)
VERDICTS = {*AGREED, "fixed", "predicts best", "no plateau"}


def selectors():
    found = {}
    modules = [
        *pkgutil.iter_modules(penode.horizon.__path__, "penode.horizon."),
        *pkgutil.iter_modules(penode.paper.__path__, "penode.paper."),
    ]
    for module in modules:
        content = importlib.import_module(module.name)
        for name, kind in inspect.getmembers(content, inspect.isclass):
            local = kind.__module__ == content.__name__
            if local and hasattr(kind, "select") and not getattr(kind, "_is_protocol", False):
                found[name] = kind
    return found


SELECTORS = selectors()


def test_the_selectors_are_found():
    assert {"Longest", "Plateau", "HeldOut", "Spectral", "Anchor"} <= set(SELECTORS)


@pytest.fixture(scope="module")
def climbed(systems):
    """Two recordings of a linear machine with noise, and the rungs trained on them."""
    system = systems["linear machine"]
    runs = system.recorded_again(noise=0.02)
    plan = ladder_plan(HORIZONS)
    problem = LadderProblem.of(system.model, list(runs), plan, ignore_events)
    return runs, problem.climb(plan, system.raw).fits


def made(kind, climbed):
    """Return a selector of a kind with what its fields ask for."""
    runs, rungs = climbed
    physical = len(rungs[0].influence)
    known = {
        "experiments": runs,
        "values": rungs[1].values[:physical],
        "deviation": rungs[1].working[:physical],
    }
    names = [one.name for one in fields(kind) if one.name in known]
    return kind(**{name: known[name] for name in names})


def lost(rung):
    """A rung in which nothing is a number."""
    parts = {
        name: np.full_like(getattr(rung, name), np.nan)
        for name in ("values", "deviation", "working", "influence")
    }
    return replace(rung, model=jax.tree.map(lambda leaf: leaf * np.nan, rung.model), **parts)


def unknown(rung):
    """A rung whose deviations are infinite."""
    infinite = np.full_like(rung.working, np.inf)
    return replace(rung, deviation=infinite, working=infinite)


LADDERS = {
    "as trained": lambda rungs: rungs,
    "one rung": lambda rungs: rungs[:1],
    "two rungs": lambda rungs: rungs[:2],
    "all lost": lambda rungs: [lost(one) for one in rungs],
    "first lost": lambda rungs: [lost(rungs[0]), *rungs[1:]],
    "last lost": lambda rungs: [*rungs[:-1], lost(rungs[-1])],
    "nothing known": lambda rungs: [unknown(one) for one in rungs],
    "exactly equal": lambda rungs: [replace(one, values=rungs[0].values) for one in rungs],
}


def select(selector, rungs):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return selector.select(rungs)


@pytest.mark.parametrize("ladder", LADDERS)
@pytest.mark.parametrize("name", SELECTORS)
def test_any_ladder_gives_a_valid_choice(name, ladder, climbed):
    rungs = LADDERS[ladder](list(climbed[1]))
    choice = select(made(SELECTORS[name], climbed), rungs)
    assert 0 <= choice.index < len(rungs)
    assert choice.index in choice.agreeing
    assert list(choice.agreeing) == sorted(set(choice.agreeing))
    assert set(choice.agreeing) <= set(range(len(rungs)))
    assert choice.verdict in VERDICTS
    assert "nan" not in choice.reason.split()
    assert choice.reason.endswith(".")


@pytest.mark.parametrize("name", [name for name in SELECTORS if name != "Longest"])
def test_a_lost_rung_is_not_chosen_beside_good_ones(name, climbed):
    for at in (0, len(HORIZONS) - 1):
        rungs = list(climbed[1])
        rungs[at] = lost(rungs[at])
        assert select(made(SELECTORS[name], climbed), rungs).index != at


@pytest.mark.parametrize("name", SELECTORS)
def test_the_order_of_parameters_or_recordings_does_not_matter(name, climbed):
    """Rungs of `Spectral` hold the recordings in their order, which is left as it is."""
    runs, rungs = climbed
    kind = SELECTORS[name]
    before, after = made(kind, climbed), made(kind, climbed)
    if name == "HeldOut":
        after = kind(runs[::-1])
    elif name != "Spectral":
        order = np.random.default_rng(1).permutation(len(rungs[0].influence))

        def turned(rung):
            parts = {n: getattr(rung, n).copy() for n in ("values", "deviation", "working")}
            for values in parts.values():
                values[: len(order)] = values[order]
            return replace(rung, influence=rung.influence[order], **parts)

        rungs = [turned(one) for one in rungs]
        if hasattr(after, "values"):
            after = kind(after.values[order], after.deviation[order])
    first, second = select(before, climbed[1]), select(after, rungs)
    assert (first.index, first.verdict, first.agreeing) == (
        second.index,
        second.verdict,
        second.agreeing,
    )
