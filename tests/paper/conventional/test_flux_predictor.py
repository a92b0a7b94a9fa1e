"""The flux predictor against closed forms, quadrature and least squares by hand."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad_vec

from penode.arrays import float64
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.models.parameters import with_batch_axis
from penode.paper.conventional.flux_predictor import FluxPredictor, flux_equations
from penode.paper.conventional.linear_maps import polynomial, radial, spline
from penode.paper.conventional.rotation import held, rising
from penode.pmsm.result_files import write

T, R = 1e-4, 0.012
#: psi = PSI + L i + quadratic terms; not reciprocal, so that both kinds of map are told apart.
PSI, L = np.array([0.05, 0.002]), np.array([[2e-4, 1e-5], [3e-5, 4e-4]])
CURVED = 1e-7


def flux(currents):
    bent = np.stack([currents[:, 0] * currents[:, 1], currents[:, 1] ** 2], axis=1)
    return PSI + currents @ L.T + CURVED * bent


def rotated(vectors, angle):
    """Turn vectors (time, 2) by angles (time,)."""
    cosine, sine = np.cos(angle), np.sin(angle)
    d, q = vectors.T
    return np.stack([cosine * d - sine * q, sine * d + cosine * q], axis=1)


def recording(rng, hold="dq", samples=400, psi=flux):
    """Currents at will, and the voltage that moves the flux linkages exactly that way.

    The integrals over a sample are Gauss-Legendre sums, exact to rounding for such small turns.
    """
    time = T * np.arange(samples)
    currents = 100 * np.stack([np.sin(70 * time), np.cos(93 * time)], axis=1)
    currents += rng.normal(size=currents.shape)
    omega = 500 + 300 * np.sin(20 * time)
    turn, linkage = omega[:-1] * T, psi(currents)
    left = linkage[1:] - rotated(linkage[:-1], -turn)
    pushed = np.zeros((samples - 1, 2, 2))
    for node, weight in zip(*np.polynomial.legendre.leggauss(8), strict=True):
        share = (1 + node) / 2
        between = (1 - share) * currents[:-1] + share * currents[1:]
        left += R * T * weight / 2 * rotated(between, -turn * (1 - share))
        angle = turn if hold == "stationary" else turn * (1 - share)
        for column, unit in enumerate(np.eye(2)):
            moved = rotated(np.broadcast_to(unit, left.shape), -angle)
            pushed[:, :, column] += T * weight / 2 * moved
    voltage = np.zeros_like(currents)
    voltage[:-1] = np.linalg.solve(pushed, left[..., None])[..., 0]
    channels = {"i_d": currents[:, 0], "i_q": currents[:, 1], "omega_el": omega}
    channels |= {"u_d": voltage[:, 0], "u_q": voltage[:, 1]}
    return Experiment("run", T, channels)


def solved(basis, run, hold="dq"):
    """Resistance, and flux linkages at the recorded currents, without predicting anything."""
    equations = flux_equations(run, basis, 120.0, hold)
    found = equations.solve()
    columns = basis.columns(run.stack(("i_d", "i_q")) / 120.0)
    return found[0], columns @ found[1:]


@pytest.mark.parametrize("hold", ["dq", "stationary"])
@pytest.mark.parametrize("basis", [polynomial(3), spline(2)], ids=lambda b: b.name)
def test_a_map_within_the_basis_is_recovered_to_solver_precision(rng, basis, hold):
    run = recording(rng, hold)
    resistance, psi = solved(basis, run, hold)
    assert resistance == pytest.approx(R, abs=1e-9)
    np.testing.assert_allclose(psi, flux(run.stack(("i_d", "i_q"))), atol=1e-10)


def test_a_linear_machine_is_recovered_by_radial_functions(rng):
    run = recording(rng, psi=lambda currents: PSI + currents @ L.T)
    resistance, psi = solved(radial(4), run)
    assert resistance == pytest.approx(R, abs=1e-8)
    np.testing.assert_allclose(psi, PSI + run.stack(("i_d", "i_q")) @ L.T, atol=1e-9)


def test_a_reciprocal_basis_recovers_a_reciprocal_machine_and_no_other(rng):
    run = recording(rng, psi=lambda currents: PSI + currents @ (0.5 * (L + L.T)))
    basis = polynomial(3, reciprocal=True)
    assert solved(basis, run)[0] == pytest.approx(R, abs=1e-9)
    assert abs(solved(basis, recording(rng))[0] - R) > 1e-5


@pytest.mark.parametrize(
    "basis",
    [polynomial(3), polynomial(2, reciprocal=True), radial(3), spline(2)],
    ids=lambda b: b.name,
)
def test_a_weighted_map_is_the_sum_of_its_columns_and_knows_its_slopes(rng, basis):
    x, weights = rng.uniform(-0.9, 0.9, (7, 2)), rng.normal(size=basis.coefficients)
    network = with_batch_axis(basis.weighted(weights))
    with float64():
        value, slopes = (np.asarray(part) for part in network.value_and_jacobian(jnp.array(x.T)))
    np.testing.assert_allclose(value.T, basis.columns(x) @ weights, atol=1e-13)
    for axis, step in enumerate(1e-6 * np.eye(2)):
        change = (basis.columns(x + step) - basis.columns(x - step)) @ weights / 2e-6
        np.testing.assert_allclose(slopes[:, axis].T, change, atol=1e-8)
    if basis.constraint is not None:
        np.testing.assert_allclose(slopes[0, 1], slopes[1, 0], atol=1e-13)


def test_equations_are_those_of_least_squares_by_hand(rng):
    """Forward differences of a linear map by numpy alone, where the turn is negligible."""
    time = T * np.arange(300)
    i = 50 * np.stack([np.sin(300 * time), np.cos(410 * time)], axis=1)
    u = rng.normal(size=i.shape)
    run = Experiment(
        "run",
        T,
        {
            "i_d": i[:, 0],
            "i_q": i[:, 1],
            "u_d": u[:, 0],
            "u_q": u[:, 1],
            "omega_el": 0 * time,
        },
    )
    found_here = flux_equations(run, polynomial(1), 50.0).solve()
    middle, rise, nothing = T * (i[1:] + i[:-1]) / 2, np.diff(i, axis=0), np.zeros(len(i) - 1)
    by_d = np.stack([middle[:, 0], rise[:, 0], rise[:, 1], nothing, nothing], axis=1)
    by_q = np.stack([middle[:, 1], nothing, nothing, rise[:, 0], rise[:, 1]], axis=1)
    target = T * np.concatenate([u[:-1, 0], u[:-1, 1]])
    found = np.linalg.lstsq(np.concatenate([by_d, by_q]), target, rcond=None)[0]
    assert found_here[0] == pytest.approx(found[0], rel=1e-9)
    # Columns: R, then 1, i_d, i_q of psi_d and of psi_q, on currents over 50 A.
    np.testing.assert_allclose(found_here[[2, 3, 5, 6]] / 50.0, found[1:], rtol=1e-9)


def test_integrals_over_a_sample_agree_with_quadrature():
    for z in (0.0, -1e-4j, -0.3j, -2.5j):
        whole = quad_vec(lambda s, z=z: np.exp(z * (1 - s)), 0, 1)[0]
        ramp = quad_vec(lambda s, z=z: np.exp(z * (1 - s)) * s, 0, 1)[0]
        np.testing.assert_allclose(held(np.array([z])), whole, rtol=1e-13)
        np.testing.assert_allclose(rising(np.array([z])), ramp, rtol=1e-12)


def test_everything_of_a_fit_is_there_and_reads_back(rng, tmp_path):
    run = recording(rng)
    unseen = recording(np.random.default_rng(5), samples=200)
    fit = FluxPredictor(polynomial(3)).identify([run], [unseen])
    assert fit.parameters["R"].value == pytest.approx(R, abs=1e-9)
    assert fit.parameters["R"].std < 1e-8
    assert fit.horizon.selected == 1
    np.testing.assert_allclose(fit.flux_map(10.0, -20.0), flux(np.array([[10.0, -20.0]]))[0])
    assert [c.role for c in fit.comparisons] == ["train", "validation"]
    assert max(c.one_step_rmse for c in fit.comparisons) < 1e-3
    write(fit, tmp_path)  # result, map, reloadable fit and report, as of any other method
    assert "<html" in (tmp_path / "report.html").read_text()
    again = type(fit).load(tmp_path)
    np.testing.assert_array_equal(again.flux_map(3.0, 4.0), fit.flux_map(3.0, 4.0))
    assert again.parameters == fit.parameters


def test_bad_input_is_told(rng):
    run = recording(rng, samples=20)
    with pytest.raises(InputError, match="38 equations came for 57 unknowns"):
        FluxPredictor(polynomial(6)).identify([run])
    with pytest.raises(InputError, match="must be one of dq, stationary"):
        FluxPredictor(hold="fast")
    with pytest.raises(InputError, match="give at least one"):
        FluxPredictor().identify([])
    with pytest.raises(InputError, match="degree 0 came"):
        polynomial(0)
