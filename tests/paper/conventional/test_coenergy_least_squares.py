"""Least squares of a polynomial coenergy against a linear machine in closed form, and the bench."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from penode.bench.coenergy_table import true_flux_map
from penode.bench.machines import TRACTION_300A
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.paper.conventional.linear_maps import coenergy_polynomial, polynomial
from penode.paper.conventional.linear_methods import CoenergyLeastSquares, coenergy_equations
from penode.pmsm.machine.dead_time import DeadTime

pytestmark = pytest.mark.usefixtures("quickly_compiled")

T, R, PSI, L_D, L_Q = 1e-4, 0.012, 0.05, 2e-4, 4e-4
OMEGA = 300.0


def linear_machine(samples=3000):
    """Exact solution of a linear machine whose dq voltages are held over each sample."""
    system = np.array(
        [
            [-R / L_D, OMEGA * L_Q / L_D, 0.0],
            [-OMEGA * L_D / L_Q, -R / L_Q, -OMEGA * PSI / L_Q],
            [0.0, 0.0, 0.0],
        ]
    )
    whole = np.zeros((5, 5))
    whole[:3, :3], whole[:2, 3:] = system, np.diag([1 / L_D, 1 / L_Q])
    step = expm(whole * T)
    time = T * np.arange(samples)
    voltage = np.stack([8 * np.sin(60 * time), OMEGA * PSI + 9 * np.cos(47 * time)], axis=1)
    state, currents = np.array([0.0, 0.0, 1.0]), []
    for held in voltage:
        currents.append(state[:2])
        state = step[:3] @ np.concatenate([state, held])
    i_d, i_q = np.transpose(currents)
    channels = {"i_d": i_d, "i_q": i_q, "u_d": voltage[:, 0], "u_q": voltage[:, 1]}
    channels |= {"omega_el": np.full(samples, OMEGA), "theta_el": OMEGA * time}
    return Experiment("linear", T, channels)


@pytest.mark.parametrize("basis", [coenergy_polynomial(4), coenergy_polynomial(3, mirrored=False)])
def test_a_linear_machine_is_recovered(basis):
    run = linear_machine()
    scale = float(np.abs(run.stack(("i_d", "i_q"))).max())
    solution = coenergy_equations(run, basis, scale).solve()
    # What is left is the error of sums for integrals, (omega T)^2 / 12.
    assert solution[0] == pytest.approx(R, rel=1e-3)
    at = np.array([[0.0, 0.0], [50.0, 0.0], [0.0, 40.0], [-60.0, -30.0]])
    psi = basis.columns(at / scale) @ solution[1:]
    exact = np.array([PSI, 0.0]) + at * np.array([L_D, L_Q])
    np.testing.assert_allclose(psi, exact, atol=2e-4 * PSI)


@pytest.mark.parametrize("degree", [2, 5, 8])
def test_a_mirrored_coenergy_is_the_even_part_of_any(rng, degree):
    x = rng.uniform(-1, 1, (40, 2))
    mirrored, whole = coenergy_polynomial(degree), coenergy_polynomial(degree, mirrored=False)
    columns, every = mirrored.columns(x), whole.columns(x)
    opposite = mirrored.columns(x * [1.0, -1.0]) * np.array([1.0, -1.0])[:, None]
    np.testing.assert_allclose(columns, opposite, atol=1e-14)
    # Its psi_d and psi_q lie within those of the whole, and so does each even part of that.
    even = every + whole.columns(x * [1.0, -1.0]) * np.array([1.0, -1.0])[:, None]
    flat = columns.reshape(-1, mirrored.coefficients)
    assert np.linalg.matrix_rank(flat) == mirrored.coefficients
    assert np.linalg.matrix_rank(even.reshape(len(flat), -1)) == mirrored.coefficients
    both = np.hstack([flat, even.reshape(len(flat), -1)])
    assert np.linalg.matrix_rank(both, tol=1e-10) == mirrored.coefficients


def test_the_reciprocal_polynomial_is_the_coenergy_of_one_degree_more(rng):
    x = rng.uniform(-1, 1, (9, 2))
    same = coenergy_polynomial(5, mirrored=False).columns(x)
    np.testing.assert_array_equal(polynomial(4, reciprocal=True).columns(x), same)


def test_the_hard_case_of_the_bench(slow_run):
    """One speed, a slow trajectory, harmonics that no map of the currents describes."""
    scale, basis = 240.0, coenergy_polynomial()
    solution = coenergy_equations(slow_run, basis, scale).solve()
    assert solution[0] == pytest.approx(0.01, rel=0.01)
    angle = np.linspace(0, 2 * np.pi, 24)
    at = np.concatenate([r * np.stack([np.cos(angle), np.sin(angle)], 1) for r in (60.0, 170.0)])
    psi = basis.columns(at / scale) @ solution[1:]
    exact = true_flux_map(TRACTION_300A, *at.T)
    assert exact.shape == psi.shape
    assert np.abs(psi - exact).mean() < 1e-3 * np.hypot(*exact.T).max()


def test_dead_time_is_a_column_of_its_own(dead_time_run):
    """0.6 us of 400 V at 10 kHz, which without a column counts as resistance."""
    scale, basis = 240.0, coenergy_polynomial()
    without = coenergy_equations(dead_time_run, basis, scale).solve()
    term = DeadTime().prepared(scale)
    resistance, voltage = coenergy_equations(dead_time_run, basis, scale, (term,)).solve()[:2]
    assert without[0] > 0.0115
    assert resistance == pytest.approx(0.01, rel=0.03)
    assert voltage == pytest.approx(2.4, rel=0.1)


def test_everything_of_a_fit_is_there():
    run = linear_machine(1200)
    found = CoenergyLeastSquares(2, inverter=True).solved([run])
    assert abs(found.beside["dead_time_voltage"].value) < 0.02
    assert found.terms[0].dead_time_voltage == found.beside["dead_time_voltage"].value
    fit = CoenergyLeastSquares(2).identify([run], [linear_machine(300)])
    assert fit.parameters["R"].value == pytest.approx(R, rel=1e-2)
    assert fit.provenance["method"] == "least squares of a polynomial coenergy"
    assert [c.role for c in fit.comparisons] == ["train", "validation"]
    assert max(c.one_step_rmse for c in fit.comparisons) < 0.05


def test_bad_input_is_refused():
    run = linear_machine(12)
    with pytest.raises(InputError, match=r"equations as the 25 unknowns .*degree than 8"):
        CoenergyLeastSquares().identify([run])
    with pytest.raises(InputError, match="at least one recording is needed"):
        CoenergyLeastSquares().identify([])
    with pytest.raises(InputError, match="degree must be >= 2, got 1"):
        CoenergyLeastSquares(1).identify([run])
    blind = {name: values for name, values in run.channels.items() if name != "theta_el"}
    with pytest.raises(InputError, match="channel theta_el is missing"):
        CoenergyLeastSquares(2, inverter=True).identify([replace(run, channels=blind)])
