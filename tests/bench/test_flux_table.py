"""Which arrays of a file are taken for currents, angles and fluxes."""

import numpy as np
import pytest

from penode.bench.flux_table import flux_table
from penode.errors import InputError

I_D, I_Q = np.linspace(-100.0, 0.0, 6), np.linspace(-50.0, 50.0, 5)
GRID = np.meshgrid(I_D, I_Q, indexing="ij")
PSI = (0.05 + 2e-4 * GRID[0], 4e-4 * GRID[1])


@pytest.mark.parametrize(
    ("d", "q", "flux_d", "flux_q"),
    [
        ("i_d", "i_q", "psi_d", "psi_q"),
        ("Id", "Iq", "Fd", "Fq"),
        ("idVec", "iqVec", "fluxD", "fluxQ"),
        ("idVec_A", "iqVec_A", "fluxD_Wb", "fluxQ_Wb"),
        ("iD", "iQ", "FluxD", "FluxQ"),
        ("Id_Peak", "Iq_Peak", "Flux_Linkage_D", "Flux_Linkage_Q"),
        ("i_d_vec", "i_q_vec", "Psi_d", "Psi_q"),
    ],
)
@pytest.mark.parametrize("transposed", [False, True])
def test_known_names_of_vectors_and_matrices(d, q, flux_d, flux_q, transposed):
    psi_d, psi_q = (psi.T if transposed else psi for psi in PSI)
    table = flux_table("map", {d: I_D, q: I_Q, flux_d: psi_d, flux_q: psi_q}, pole_pairs=4)
    assert table.theta_el.tolist() == [0.0]
    np.testing.assert_allclose(table.psi_d[..., 0], 0.05 + 2e-4 * table.i_d)
    np.testing.assert_allclose(table.psi_q[..., 0], 4e-4 * table.i_q)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("theta_el", np.linspace(0.0, 1.2, 7)),
        ("angleVec", np.degrees(np.linspace(0.0, 1.2, 7)) / 4),
        ("Angular_Rotor_Position", np.degrees(np.linspace(0.0, 1.2, 7))),
    ],
)
def test_angles_are_electrical_radians(name, values):
    psi_d, psi_q = (np.repeat(psi[..., None], 7, axis=2) for psi in PSI)
    arrays = {"i_d": I_D, "i_q": I_Q, name: values, "psi_d": psi_d, "psi_q": psi_q}
    table = flux_table("map", arrays, pole_pairs=4)
    np.testing.assert_allclose(table.theta_el, np.linspace(0.0, 1.2, 7))


def test_polar_currents_are_counted_from_the_q_axis():
    length, advance = np.meshgrid(np.linspace(0, 100, 6), np.linspace(0, 90, 7), indexing="ij")
    arrays = {"Stator_Current_Phase_Peak": length, "Phase_Advance": advance}
    arrays |= {"Flux_Linkage_D": length, "Flux_Linkage_Q": length}
    table = flux_table("map", arrays, pole_pairs=4)
    np.testing.assert_allclose(table.i_q[:, 0], length[:, 0])
    np.testing.assert_allclose(table.i_d[:, -1], -length[:, -1])


def test_too_few_currents_are_refused():
    arrays = {"i_d": I_D[:3], "i_q": I_Q, "psi_d": PSI[0][:3], "psi_q": PSI[1][:3]}
    sentence = "map: the map has 3 x 5 points; at least 5 currents along either axis are wanted."
    with pytest.raises(InputError, match=f"^{sentence}$"):
        flux_table("map", arrays, pole_pairs=4)
