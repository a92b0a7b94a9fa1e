"""Points beside recordings: the update against stacked least squares, gains that both share."""

from dataclasses import replace

import numpy as np
import pytest
from tests.pmsm.points.test_operating_points import STUDY, R, measured

from penode import InputError
from penode.arrays import float64
from penode.fit.fit import Estimate, HorizonChoice
from penode.fit.learned_uncertainty import LearnedUncertainty, map_slopes, physical_slopes
from penode.fit.outcome import Contribution
from penode.models.layout import Layout
from penode.pmsm import identify_with_points
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.terms import Resistance
from penode.pmsm.points.beside import _Update, with_points
from penode.pmsm.points.identify import balances_of, identify_points
from penode.pmsm.points.recorded_torque import SHARED
from penode.pmsm.recording.imperfections import IMPERFECTIONS

STD = 0.004 * R


@pytest.fixture(scope="module")
def fit():
    """Return what recordings of the same machine might have shown: R to 0.4 %, the map to 1 mVs."""
    points = measured(count=60, seed=5)
    alone = identify_points(points, STUDY)
    model = Machine(alone.model.flux, (Resistance(R),))
    layout = Layout(model)
    slopes = map_slopes(model, points.stack(("i_d", "i_q"))).reshape(-1, layout.size)
    precision = slopes.T @ slopes / 1e-3**2 + 10.0 * np.eye(layout.size)
    at = layout.physical_members
    precision[at, at] = STD**-2
    fit = replace(
        alone,
        model=model,
        parameters={"R": Estimate.of(R, STD, "ohm", 0.9)},
        horizon=HorizonChoice(50, "plateau", "Horizons agree.", ()),
        stationary=None,
    )
    return believed(fit, np.linalg.inv(precision))


def moved(fit, accuracy):
    """Return what a deviation of each gain moves R and the map of recordings by, raw, by source.

    Currents read too large make R smaller and psi that of larger ones; voltages both larger; a
    speed psi smaller.
    """
    layout = Layout(fit.model)
    raw, learned = layout.raw(fit.model), layout.members(("learned",))
    of_map, of_resistance = np.where(learned, raw, 0.0), np.zeros(len(raw))
    place, slope = int(layout.physical_members.argmax()), physical_slopes(fit.model)[0]
    of_resistance[place] = fit.parameters["R"].value / slope[place]
    inductance = fit.differential_inductance(*fit.excited.T)
    target = np.einsum("djm,mj->md", inductance, fit.excited).ravel()
    columns = map_slopes(fit.model, fit.excited).reshape(target.size, -1)[:, learned]
    of_current = np.zeros(len(raw))
    of_current[learned] = np.linalg.lstsq(columns, target, rcond=1e-6)[0]
    by_gain = {
        "current_gain": -of_resistance - of_current,
        "voltage_gain": of_resistance + of_map,
        "speed_gain": -of_map,
    }
    return {
        IMPERFECTIONS[name].source: accuracy.declared[name] * shift
        for name, shift in by_gain.items()
        if accuracy.declared[name]
    }


def believed(fit, statistics, study=STUDY):
    """Return a fit whose covariance is that of statistics and of the gains."""
    layout, shifts = Layout(fit.model), moved(fit, study.accuracy)
    every = np.stack([*shifts.values(), np.zeros(layout.size)])
    covariance, at = statistics + every.T @ every, layout.physical_members
    place = int(np.flatnonzero(at)[0])
    rows = [Contribution("statistics", float(np.sqrt(statistics[place, place])))]
    rows += [Contribution(source, abs(shift[place])) for source, shift in shifts.items()]
    std, value = float(np.sqrt(covariance[place, place])), fit.parameters["R"].value
    raw = layout.raw(fit.model)[None]
    return replace(
        fit,
        parameters={"R": Estimate.of(value, std, "ohm", 0.9, "", tuple(rows))},
        covariance=covariance[np.ix_(at, at)],
        learned_uncertainty=LearnedUncertainty(covariance, raw, np.ones(1), shifts),
    )


def update(fit, points, study=STUDY):
    return _Update(fit, fit.model, balances_of(points, study)[1])


def test_it_is_least_squares_of_recordings_gains_and_points_together(fit):
    one = update(fit, measured(count=25, seed=3))
    of_model, of_gains, own = one.matrix
    size, gains, rest = one.layout.size, of_gains.shape[1], own.shape[1]
    values, vectors = np.linalg.eigh(one.belief)
    root = vectors.T / np.sqrt(np.maximum(values, 1e-14 * values[-1]))[:, None]
    none = np.zeros
    stacked = np.block(
        [
            [root, root @ one.moved, none((size, rest))],
            [none((gains, size)), np.eye(gains), none((gains, rest))],
            [none((rest, size + gains)), np.eye(rest)],
            [np.hstack([of_model, of_gains, own]) / one.noise[:, None]],
        ]
    )
    target = np.concatenate([none(size + gains + rest), one.left / one.noise])
    found = np.linalg.lstsq(stacked, target, rcond=None)[0]
    covariance = np.linalg.inv(stacked.T @ stacked)[:size, :size]
    at = one.layout.physical_members
    assert one.raw[at] - one.before[at] == pytest.approx(found[:size][at], rel=1e-5)
    assert one.covariance[at, at] == pytest.approx(covariance[at, at], rel=1e-5)
    slopes = map_slopes(fit.model, np.array([[-50.0, 80.0]]))[0]
    np.testing.assert_allclose(
        slopes @ (one.raw - one.before), slopes @ found[:size], rtol=1e-4, atol=1e-8
    )


@pytest.mark.slow
def test_points_narrow_resistance_and_map_and_the_budget_adds_up(fit):
    points = measured(count=40, seed=7)
    both = with_points(fit, balances_of(points, STUDY))
    alone = identify_points(points, STUDY)
    found = both.parameters["R"]
    assert found.std < fit.parameters["R"].std
    assert found.std < 1.05 * alone.parameters["R"].std  # which believes more of the map
    assert abs(found.value - R) < 1.96 * found.std
    assert "operating points" in [row.source for row in found.budget]
    assert found.std**2 == pytest.approx(both.covariance[0, 0], rel=1e-6)
    at = np.array([[-50.0, 80.0]])
    assert (both.learned_deviation(at) < fit.learned_deviation(at)).all()
    assert min(both.stationary.covered.values()) > 0.85
    assert both.horizon == fit.horizon
    assert both.excited is fit.excited
    np.testing.assert_array_equal(both.stationary.states, points.stack(("i_d", "i_q")))


@pytest.mark.parametrize("gain", SHARED)
def test_a_gain_that_both_have_is_not_narrowed_by_points(fit, gain):
    """Each is 2 % too large in both: nothing contradicts, and without torque nothing shows it."""
    points, scale = measured(count=40, seed=9, torque=False), 1.02
    channels = {"current_gain": ("i_d", "i_q"), "voltage_gain": ("u_d", "u_q")}
    changed = channels.get(gain, ("omega_el",))
    wrong = {n: scale * v if n in changed else v for n, v in points.channels.items()}
    declared = replace(STUDY, accuracy=type(STUDY.accuracy)(**{gain: 0.02}))
    wrong = replace(points, channels=wrong)
    one = update(believed(fit, update(fit, points).belief, declared), wrong, declared)
    with float64():
        model = one.layout.plain_model(one.before - one.shared[gain])
    value = float(model.terms[0].R)
    recorded = replace(fit, model=model, parameters={"R": Estimate.of(value, STD, "ohm", 0.9)})
    both = update(believed(recorded, one.belief, declared), wrong, declared)
    assert both.distance < 1.5
    place = int(np.flatnonzero(both.layout.physical_members)[0])
    assert both.covariance[place, place] > 0.9 * one.shared[gain][place] ** 2


def test_on_an_exact_bench_no_gain_is_shared(fit):
    exact = replace(STUDY, accuracy=type(STUDY.accuracy).exact())
    points = measured(count=40, seed=7)
    sharp = believed(fit, update(fit, points).belief, exact)
    both = with_points(sharp, balances_of(points, exact))
    assert (
        both.parameters["R"].std < with_points(fit, balances_of(points, STUDY)).parameters["R"].std
    )
    assert abs(both.parameters["R"].value - R) < 4 * both.parameters["R"].std


def test_the_map_moves_hardly_more_beyond_the_recorded_currents_than_within(fit):
    points = measured(count=40, seed=7)
    both = with_points(fit, balances_of(points, STUDY))
    reach = 1.3 * fit.model.flux.current_scale * np.array([-1.0, 1.0])
    corners = np.stack(np.meshgrid(reach, reach)).reshape(2, -1)
    moved = [
        np.abs(both.flux_map(*at) - fit.flux_map(*at)).max()
        for at in (points.stack(("i_d", "i_q")).T, corners)
    ]
    assert moved[0] > 0
    assert moved[1] < 4 * moved[0]


def test_points_of_another_machine_contradict(fit):
    found = with_points(fit, balances_of(measured(count=40, seed=7, resistance=3 * R), STUDY))
    assert found.horizon.verdict == "implausible"
    assert "Points contradict: points.csv" in found.horizon.reason


def test_a_fit_without_an_answer_stays_and_a_warning_says_so(fit):
    refused = replace(fit, horizon=replace(fit.horizon, verdict="no plateau"))
    found = with_points(refused, balances_of(measured(count=12), STUDY))
    assert found.model is refused.model
    assert "the recordings alone have no answer" in found.warnings[-1]


def test_points_beyond_the_recordings_are_left_out_by_their_number(fit):
    points = measured(count=20)
    few, all_of_them = np.where(np.arange(20) < 3, 20.0, 1.0), np.full(20, 20.0)
    found = []
    for far in (few, all_of_them):
        channels = {n: far * v if n in ("i_d", "i_q") else v for n, v in points.channels.items()}
        found.append(with_points(fit, balances_of(replace(points, channels=channels), STUDY)))
    some, none = found
    assert len(some.stationary.measured) == 17
    assert "17 of 20 operating points lie within the currents" in some.warnings[-1]
    assert none.model is fit.model
    assert none.stationary is None
    assert "0 of 20 operating points lie within" in none.warnings[-1]


def test_another_map_is_refused_before_anything_is_trained():
    with pytest.raises(InputError, match=r"flux_map must be coenergy .* got mlp"):
        identify_with_points([], measured(count=12), study=replace(STUDY, flux_map="mlp"))
