"""The start of the map of splines: mirror symmetry by evidence, prior, definite inductance."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from validate.sampled_drive.kinds import draw

from penode.arrays import float64
from penode.bench.coenergy_table import true_flux_map
from penode.bench.machines import TRACTION_300A
from penode.data.load import load
from penode.models.layout import Layout
from penode.models.parameters import with_batch_axis
from penode.pmsm.balance.definite import held_definite, held_in_training
from penode.pmsm.balance.smoothing import Roughness, smoothed
from penode.pmsm.balance.spline_start import reach
from penode.pmsm.balance.start import weak_start
from penode.pmsm.balance.term_selection import structure_of
from penode.pmsm.machine.coenergy_map import (
    HESSIAN,
    CoenergyPart,
    CoenergySplines,
    columns,
    roughness,
)
from penode.pmsm.machine.term_registry import physical_values
from penode.training.weak_form import WeakRegression


@pytest.fixture(scope="module")
def start(slow_run):
    return weak_start([slow_run], "coenergy")


def test_the_map_of_a_machine_with_saturation_is_found(start, rng):
    points = rng.uniform(-160, 160, (100, 2))
    psi = np.asarray(true_flux_map(TRACTION_300A, *points.T)).reshape(100, 2)
    found = start.machine.maps()["flux_map"](*points.T).T
    assert np.abs(found - psi).mean() < 1e-3 * np.abs(psi).max()


def test_a_symmetric_machine_has_one_even_part(start):
    (part,) = start.machine.flux.network.mean
    assert part.even


def test_what_lacks_mirror_symmetry_gets_an_odd_part(slow_run):
    """An offset of u_d over omega is a flux linkage of the q axis at no current."""
    channels = dict(slow_run.channels)
    channels["u_d"] = channels["u_d"] - 0.002 * channels["omega_el"]
    machine = weak_start([replace(slow_run, channels=channels)], "coenergy").machine
    assert [part.even for part in machine.flux.network.mean] == [True, False]
    psi_q = machine.maps()["flux_map"](0.0, 0.0)[1]
    assert psi_q == pytest.approx(0.002, rel=0.1)


def test_a_machine_without_skew_has_harmonics_of_one_symmetry(slow_run):
    network = weak_start([slow_run], "coenergy", angle_orders=(6, 12)).machine.flux.network
    assert [part.even for part in (*network.cosine, *network.sine)] == [True, False]
    assert not network.skewed


def test_a_skewed_machine_has_harmonics_of_both(tmp_path):
    """Of another plant, with orders to 18: what they leave of the voltage is noise."""
    run = load(*draw("skewed harmonics", 2).write(tmp_path, "log"))
    found = structure_of([run], "coenergy")
    assert found.angle_orders == (6, 12, 18)
    network = weak_start([run], "coenergy", angle_orders=found.angle_orders).machine.flux.network
    assert [part.even for part in network.cosine] == [True, False]
    assert [part.even for part in network.sine] == [False, True]
    assert network.skewed


@pytest.mark.slow
def test_a_map_recorded_along_a_curve_is_definite_and_leaves_resistance_alone(tmp_path):
    """Two seconds of a driving cycle: i_d follows abs(i_q), and beside that curve is nothing."""
    drawn = draw("driving cycle", 7)
    run = load(*drawn.write(tmp_path, "log"))
    part = {name: values[40_000:50_000] for name, values in run.channels.items()}
    machine = weak_start([replace(run, channels=part)], "coenergy", angle_orders=(6, 12)).machine
    shown = {name: values[::20] for name, values in part.items()}
    with float64():
        currents = jnp.stack([shown["i_d"], shown["i_q"]])
        flux = with_batch_axis(machine).flux.at_angle(currents, shown["theta_el"])
    inductance = np.moveaxis(np.asarray(flux.inductance), -1, 0)
    assert np.linalg.eigvalsh(inductance).min() > 0
    resistance = physical_values(machine.terms)["R"]
    assert resistance == pytest.approx(drawn.truth["R"], rel=0.02)


def test_the_seed_decides_nothing(slow_run, start):
    again = weak_start([slow_run], "coenergy", seed=5).machine.flux.network
    np.testing.assert_array_equal(
        again.mean[0].coefficients, start.machine.flux.network.mean[0].coefficients
    )


def test_the_prior_leaves_a_linear_machine_alone(start):
    prior, (part,) = start.penalties[0], start.machine.flux.network.mean
    linear = np.linalg.eigh(roughness(part))[1][:, :4]
    assert np.abs(prior.factor @ linear).max() < 1e-6 * np.abs(prior.factor).max()
    assert len(prior.factor) == len(prior.variance)
    assert np.all(prior.variance > 0)


def test_reach_holds_every_current_and_is_little_more(slow_run):
    largest = max(np.abs(slow_run.channels[name]).max() for name in ("i_d", "i_q"))
    assert largest <= reach([slow_run]) < 1.13 * largest


def bent_map(rng):
    """Return equations that see the disc alone, where the inductance falls towards its edge."""
    part = CoenergyPart.zero(9, True)
    angle, radius = rng.uniform(0, 2 * np.pi, 800), 0.8 * np.sqrt(rng.uniform(0, 1, 800))
    currents = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    gradient = columns(part, currents)
    # psi = i (1 - r^2 / 2): its slope is 0.04 at the disc's edge, and negative in the corners.
    wanted = currents * (1 - np.sum(currents**2, axis=1, keepdims=True) / 2)
    equations = WeakRegression(gradient.reshape(-1, part.coefficients.size), wanted.ravel())
    penalties = [Roughness.of(0, roughness(part))]
    return part, currents, equations, penalties


def smallest(part, weights, currents):
    low, high = currents.min(axis=0), currents.max(axis=0)
    axes = [np.linspace(a, b, 25) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    a, b, c = (columns(part, points, HESSIAN) @ weights).T
    return np.min((a + c) / 2 - np.hypot((a - c) / 2, b))


def test_a_definite_map_is_left_as_it_is(rng):
    part, currents, equations, penalties = bent_map(rng)
    straight = WeakRegression(equations.matrix, currents.ravel())
    found = smoothed(straight, penalties)
    held = held_definite(straight, penalties, found, [part], currents)
    np.testing.assert_array_equal(held.solution, found.solution)
    assert len(held.rows) == 0


def test_an_axis_without_current_has_the_inductance_of_the_other(rng):
    """Nothing shows it, and what rounding leaves of it may be anything."""
    part, currents, _, penalties = bent_map(rng)
    currents = currents * [1.0, 0.0]
    gradient = columns(part, currents)
    equations = WeakRegression(gradient.reshape(-1, part.coefficients.size), 0.7 * currents.ravel())
    found = smoothed(equations, penalties)
    held = held_definite(equations, penalties, found, [part], currents)
    along_d, across, along_q = (columns(part, currents, HESSIAN) @ held.solution).T
    np.testing.assert_allclose(along_d, 0.7, atol=0.1)
    np.testing.assert_allclose(across, 0.0, atol=1e-9)
    np.testing.assert_allclose(along_q, along_d.min(), rtol=0.1)  # rounding is left in it


def test_an_inductance_that_would_turn_negative_is_held(rng):
    part, currents, equations, penalties = bent_map(rng)
    found = smoothed(equations, penalties)
    assert smallest(part, found.solution, currents) < 0
    held = held_definite(equations, penalties, found, [part], currents)
    assert smallest(part, held.solution, currents) > 0
    assert len(held.rows) == len(held.target) > 0


def test_training_is_held_off_small_inductances(rng):
    """The penalty is nothing where the map is held definite, and grows where it is not."""
    part, currents, equations, penalties = bent_map(rng)
    found = smoothed(equations, penalties)
    held = held_definite(equations, penalties, found, [part], currents)
    (penalty,) = held_in_training(held, 4.0)
    assert 0 < penalty.least <= 1.2 * smallest(part, held.solution, currents)

    def lacking(weights):
        table = weights.reshape(part.coefficients.shape)
        layout = Layout(CoenergySplines((replace(part, coefficients=table),)))
        with float64():
            at = jnp.asarray(weights)
            slopes = jax.jacfwd(lambda weights: penalty.residuals(layout, weights))(at)
            return np.asarray(penalty.residuals(layout, at)), np.asarray(slopes)

    residuals, slopes = lacking(found.solution)
    direction = rng.normal(size=len(found.solution)) * 1e-7
    change = (lacking(found.solution + direction)[0] - lacking(found.solution - direction)[0]) / 2
    clear = np.abs(residuals) > 1e-3  # not at the limit itself
    assert clear.sum() > 3
    np.testing.assert_allclose(change[clear], slopes[clear] @ direction, rtol=1e-4)
    assert not slopes[residuals == 0].any()
    assert not lacking(held.solution)[0].any()
    assert lacking(found.solution)[0].max() > 2.0
    np.testing.assert_allclose(lacking(np.zeros_like(found.solution))[0], 2.0, rtol=1e-5)


@pytest.mark.filterwarnings("error")
def test_nothing_is_held_where_no_inductance_is_positive(rng):
    part, currents, equations, penalties = bent_map(rng)
    upside_down = WeakRegression(equations.matrix, -currents.ravel())
    found = smoothed(upside_down, penalties)
    held = held_definite(upside_down, penalties, found, [part], currents)
    np.testing.assert_array_equal(held.solution, found.solution)
    assert held_in_training(held, 4.0) == ()
