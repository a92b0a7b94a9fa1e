"""Laws that every built-in machine obeys, taken from its coenergy by finite differences."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from penode.arrays import float64
from penode.bench.coenergy_table import tabulate
from penode.bench.machines import MACHINES, machine, torque
from penode.errors import InputError

SIXTY_DEGREES = np.linspace(0.0, np.pi / 3, 24, endpoint=False)


#: One machine in every `make test`, all of them in `make validate`.
PARAMS = [
    pytest.param(name, marks=() if name == "traction_300A" else pytest.mark.slow)
    for name in MACHINES
]


@pytest.fixture(params=PARAMS, scope="module")
def built(request):
    return MACHINES[request.param]


@jax.jit
def _look_up(table, currents, angles):
    both = jax.vmap(jax.vmap(table, (None, 0)), (0, None))
    return both(currents, angles)


@jax.jit
def _slope(table, currents, angles):
    both = jax.vmap(jax.vmap(table.coenergy_angle_slope, (None, 0)), (0, None))
    return both(currents, angles)


def at(built, currents, angles=SIXTY_DEGREES, function=_look_up):
    with float64():
        found = function(tabulate(built), jnp.asarray(currents), jnp.asarray(angles))
        return jax.tree.map(np.asarray, found)


def disc(radius, rings=13, spokes=36):
    r = np.linspace(0.0, radius, rings)[:, None]
    a = np.linspace(0.0, 2 * np.pi, spokes, endpoint=False)
    return np.stack([r * np.cos(a), r * np.sin(a)], axis=-1).reshape(-1, 2)


def coenergy(built, currents, angles):
    """W of the closed form in NumPy arrays, (current, angle)."""
    with float64():
        i_d, i_q = jnp.asarray(currents)[:, :, None].swapaxes(0, 1)
        return np.asarray(built.coenergy(i_d, i_q, jnp.asarray(angles)))


def centred(function, step):
    """Return the sixth-order difference quotient at 0 of a function of one number."""
    pairs = [(function(k * step) - function(-k * step)) for k in (1, 2, 3)]
    return (45 * pairs[0] - 9 * pairs[1] + pairs[2]) / (60 * step)


def test_flux_is_the_slope_of_the_closed_form(built):
    currents = disc(built.current_limit, rings=5, spokes=12)
    flux = at(built, currents).linkage
    step = built.current_limit / 100
    for axis in (0, 1):
        unit = np.eye(2)[axis]
        slope = centred(lambda h, u=unit: coenergy(built, currents + h * u, SIXTY_DEGREES), step)
        np.testing.assert_allclose(flux[..., axis], slope, atol=1e-8)


def test_reciprocity_residual_is_below_a_nanohenry(built):
    currents = disc(1.2 * built.current_limit, rings=5, spokes=12)
    step = built.current_limit / 1000
    by_q = centred(lambda h: at(built, currents + np.array([0.0, h])).linkage[..., 0], step)
    by_d = centred(lambda h: at(built, currents + np.array([h, 0.0])).linkage[..., 1], step)
    assert np.abs(by_q - by_d).max() < 1e-9


def test_reciprocity_in_the_angle(built):
    # d psi/d theta = d (dW/dtheta)/di, the angle term of the torque.
    currents = disc(built.current_limit, rings=5, spokes=12)
    by_angle = centred(lambda h: at(built, currents, SIXTY_DEGREES + h).linkage, 1e-3)
    step = built.current_limit / 1000
    for axis in (0, 1):
        unit = np.eye(2)[axis]
        slope = centred(lambda h, u=unit: at(built, currents + h * u, function=_slope), step)
        np.testing.assert_allclose(by_angle[..., axis], slope, atol=1e-9)


def test_inductance_is_positive_definite_on_and_beyond_the_disc(built):
    currents = disc(1.2 * built.current_limit, rings=25)
    assert np.linalg.eigvalsh(at(built, currents).inductance).min() > 30e-6


def test_torque_is_the_cross_product_plus_the_angle_term(built):
    rng = np.random.default_rng(8)
    currents = rng.uniform(-0.6, 0.6, (30, 2)) * built.current_limit
    theta = rng.uniform(0.0, 2 * np.pi, 30)
    psi = at(built, currents, theta).linkage[np.arange(30), np.arange(30)]
    by_angle = np.diag(centred(lambda h: coenergy(built, currents, theta + h), 2e-3))
    cross = psi[:, 0] * currents[:, 1] - psi[:, 1] * currents[:, 0]
    found = torque(built, *currents.T, theta)
    np.testing.assert_allclose(found, 1.5 * built.pole_pairs * (cross + by_angle), atol=1e-4)


def test_harmonics_are_the_stated_orders_and_grow_with_current(built):
    angles = np.linspace(0.0, 2 * np.pi, 72, endpoint=False)
    full = disc(built.current_limit, rings=2)[36:]
    spectra = [
        np.abs(np.fft.rfft(at(built, currents, angles).linkage, axis=1)) / 36
        for currents in (np.zeros((1, 2)), full)
    ]
    rest, loaded = (np.sqrt((spectrum**2).sum(axis=2).mean(axis=0)) for spectrum in spectra)
    orders = np.array(built.angle_orders)
    assert set(built.angle_orders) <= {6, 12, 18}
    assert np.flatnonzero(loaded > 1e-9).tolist() == [0, *built.angle_orders]
    assert (loaded[orders] > 1.3 * rest[orders]).all()
    assert 0.003 < loaded[6] / built.magnet_flux_linkage < 0.03


def test_data_sheet_agrees_with_the_iron(built):
    flux = at(built, disc(built.current_limit))
    assert flux.linkage[0, :, 0].mean() == pytest.approx(built.magnet_flux_linkage, rel=0.01)
    mean = flux.inductance.mean(axis=(0, 1))
    assert mean[0, 0] == pytest.approx(built.inductance_d, rel=0.1)
    assert mean[1, 1] == pytest.approx(built.inductance_q, rel=0.2)


def test_mirror_symmetry_and_no_cogging(built):
    currents = disc(built.current_limit, rings=5)
    mirrored = coenergy(built, currents * [1.0, -1.0], -SIXTY_DEGREES)
    np.testing.assert_allclose(mirrored, coenergy(built, currents, SIXTY_DEGREES), atol=1e-12)
    still = coenergy(built, np.zeros((1, 2)), SIXTY_DEGREES)
    assert np.ptp(still) < 1e-15


def test_the_built_in_machines_span_the_class():
    machines = MACHINES.values()
    assert len(machines) >= 4
    assert {built.pole_pairs for built in machines} == {3, 4, 5}
    assert min(built.resistance for built in machines) == 3.5e-3
    assert max(built.resistance for built in machines) == 17.9e-3
    assert all(250 <= built.current_limit <= 420 for built in machines)
    assert all(47e-3 <= built.magnet_flux_linkage <= 72e-3 for built in machines)


def test_temperature_changes_resistance_and_magnet():
    warm = machine("traction_300A")
    assert warm.resistance_at(20.0) == warm.resistance
    assert warm.resistance_at(120.0) == pytest.approx(1.393 * warm.resistance)
    assert warm.magnet_flux_change(120.0) == pytest.approx(-0.11 * warm.magnet_flux_linkage)


def test_a_machine_by_name_and_the_refusal_of_another():
    assert machine("comsol_300A") is MACHINES["comsol_300A"]
    sentence = (
        "there is no built-in machine 'tesla'; choose one of traction_300A, comsol_300A, "
        "brusa_250A, ev400v_420A."
    )
    with pytest.raises(InputError, match=f"^{re.escape(sentence)}$"):
        machine("tesla")
