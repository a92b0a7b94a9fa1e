"""The built-in machine against its data sheet and against the laws a coenergy obeys."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from penode.bench.machines import TRACTION_300A, torque
from penode.pmsm.machine.frames import dq_from_abc

SIXTY_DEGREES = np.linspace(0.0, np.pi / 3, 24, endpoint=False)


def polar_grid(radius, rings=13, spokes=36):
    r = np.linspace(0.0, radius, rings)[:, None]
    a = np.linspace(0.0, 2 * np.pi, spokes, endpoint=False)
    return np.stack([r * np.cos(a), r * np.sin(a)], axis=-1).reshape(-1, 2)


def over_grid_and_angle(function, currents, angles):
    """Apply function(current, angle) to all pairs in float64, (current, angle, ...)."""
    both = jax.vmap(jax.vmap(function, (None, 0)), (0, None))
    with jax.enable_x64(True):
        return np.asarray(jax.jit(both)(jnp.asarray(currents), jnp.asarray(angles)))


def coenergy(current, theta):
    return TRACTION_300A.coenergy(current[0], current[1], theta)


def flux_linkage(currents, angles=SIXTY_DEGREES):
    return over_grid_and_angle(jax.grad(coenergy), np.atleast_2d(currents), angles)


def inductance(currents, angles=SIXTY_DEGREES):
    return over_grid_and_angle(jax.hessian(coenergy), np.atleast_2d(currents), angles)


def test_inductance_is_positive_definite_beyond_the_disc_at_every_angle():
    eigenvalues = np.linalg.eigvalsh(inductance(polar_grid(1.2 * TRACTION_300A.current_limit)))
    assert eigenvalues.min() > 120e-6
    assert eigenvalues.max() < 700e-6


def test_data_sheet_agrees_with_the_iron():
    psi_d, psi_q = flux_linkage([0.0, 0.0])[0].mean(axis=0)
    assert psi_d == pytest.approx(TRACTION_300A.magnet_flux_linkage, rel=0.01)
    assert psi_q == pytest.approx(0.0, abs=1e-12)
    mean = inductance(polar_grid(TRACTION_300A.current_limit)).mean(axis=(0, 1))
    assert mean[0, 0] == pytest.approx(TRACTION_300A.inductance_d, rel=0.1)
    assert mean[1, 1] == pytest.approx(TRACTION_300A.inductance_q, rel=0.2)


def test_it_saturates_and_cross_saturates():
    none, loaded = inductance([[0.0, 0.0], [0.0, 300.0]]).mean(axis=1)
    assert loaded[1, 1] < 0.5 * none[1, 1]
    assert loaded[0, 1] < -30e-6
    assert none[0, 1] == pytest.approx(0.0, abs=1e-12)


def harmonic_amplitudes(currents):
    """Return the amplitudes of orders 6, 12 and 18 of psi_d and psi_q, (current, order, axis)."""
    return np.abs(np.fft.rfft(flux_linkage(currents), axis=1))[:, 1:4] / 12.0


def test_harmonics_at_no_load_are_one_and_0_4_percent_of_the_magnet():
    psi_d = harmonic_amplitudes([0.0, 0.0])[0, :, 0] / TRACTION_300A.magnet_flux_linkage
    np.testing.assert_allclose(psi_d, [0.010, 0.004, 0.0], rtol=0.01, atol=1e-12)


def test_harmonics_grow_with_current_everywhere():
    rim = polar_grid(TRACTION_300A.current_limit, rings=2)[36:]
    no_load, full_load = (
        np.linalg.norm(harmonic_amplitudes(currents)[:, :2], axis=2)
        for currents in ([0.0, 0.0], rim)
    )
    growth = full_load / no_load
    assert growth.min() > 1.4
    assert growth.max() < 2.2


def test_mirror_symmetry():
    currents = polar_grid(360.0)
    mirrored = over_grid_and_angle(coenergy, currents * [1.0, -1.0], -SIXTY_DEGREES)
    np.testing.assert_allclose(
        mirrored, over_grid_and_angle(coenergy, currents, SIXTY_DEGREES), rtol=1e-14
    )


def test_torque_is_the_virtual_work_at_constant_phase_currents():
    rng = np.random.default_rng(2)
    abc = rng.uniform(-150.0, 150.0, (40, 3))
    theta = rng.uniform(0.0, 2 * np.pi, 40)

    def coenergy_of_the_phases(angle):
        dq = dq_from_abc(abc, angle)
        with jax.enable_x64(True):
            return 1.5 * np.asarray(TRACTION_300A.coenergy(*dq.T, angle))

    step = 1e-4
    slope = (
        8 * (coenergy_of_the_phases(theta + step) - coenergy_of_the_phases(theta - step))
        - (coenergy_of_the_phases(theta + 2 * step) - coenergy_of_the_phases(theta - 2 * step))
    ) / (12 * step)
    i_d, i_q = dq_from_abc(abc, theta).T
    np.testing.assert_allclose(
        torque(TRACTION_300A, i_d, i_q, theta), TRACTION_300A.pole_pairs * slope, atol=1e-6
    )


def test_mean_torque_is_the_cross_product_of_the_mean_flux():
    psi = flux_linkage([-100.0, 250.0])[0].mean(axis=0)
    full = np.full(24, 1.0)
    mean = torque(TRACTION_300A, -100.0 * full, 250.0 * full, SIXTY_DEGREES).mean()
    cross = 1.5 * TRACTION_300A.pole_pairs * (psi[0] * 250.0 + psi[1] * 100.0)
    assert mean == pytest.approx(cross, rel=1e-12)
    assert 100.0 < mean < 300.0


def test_no_cogging():
    none = np.zeros(24)
    np.testing.assert_allclose(torque(TRACTION_300A, none, none, SIXTY_DEGREES), 0.0, atol=1e-12)
