"""Flux maps written in every format and read back as machines, and what is refused or said."""

import re
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.io import savemat

from penode.arrays import float64
from penode.bench.coenergy_table import SplineCoenergy, tabulate
from penode.bench.flux_table import read_flux_table
from penode.bench.machines import TRACTION_300A, torque
from penode.bench.map_import import import_machine
from penode.errors import InputError

ANGLES = np.linspace(0.0, np.pi / 3, 12, endpoint=False)
LIMIT = 300.0


@jax.jit
def _look_up(table, currents, angles):
    both = jax.vmap(jax.vmap(table, (None, 0)), (0, None))
    return both(currents, angles)


def flux(machine, currents, angles):
    with float64():
        found = _look_up(tabulate(machine), jnp.asarray(currents), jnp.asarray(angles))
        return jax.tree.map(np.asarray, found)


@dataclass
class Map:
    """psi of the built-in machine, (d, q, angle), on axes that differ in length."""

    i_d: np.ndarray
    i_q: np.ndarray
    theta: np.ndarray
    psi_d: np.ndarray
    psi_q: np.ndarray

    @property
    def mean(self):
        return self.psi_d.mean(axis=2), self.psi_q.mean(axis=2)

    @property
    def grids(self):
        return np.meshgrid(self.i_d, self.i_q, indexing="ij")


def sampled(i_d, i_q):
    grids = np.meshgrid(i_d, i_q, indexing="ij")
    currents = np.stack(grids, axis=-1).reshape(-1, 2)
    psi = flux(TRACTION_300A, currents, ANGLES).linkage.reshape(*grids[0].shape, 12, 2)
    return Map(i_d, i_q, ANGLES, psi[..., 0], psi[..., 1])


@pytest.fixture(scope="module")
def known():
    return sampled(np.linspace(-300, 300, 21), np.linspace(-300, 300, 25))


# --- writers, one a layout ---------------------------------------------------------------------


def csv_with_angle(path, known):
    columns = np.broadcast_arrays(
        known.i_d[:, None, None], known.i_q[:, None], known.theta, known.psi_d, known.psi_q
    )
    rows = np.stack([column.ravel() for column in columns], axis=1)
    rows = np.random.default_rng(1).permutation(rows)
    header = "i_d,i_q,theta_el,psi_d,psi_q"
    np.savetxt(path / "map.csv", rows, delimiter=",", header=header, comments="", fmt="%.12g")
    return path / "map.csv"


def csv_mean(path, known):
    rows = np.stack([values.ravel() for values in (*known.grids, *known.mean)], axis=1)
    header = "i_d, i_q, psi_d, psi_q"
    np.savetxt(path / "map.csv", rows, delimiter=",", header=header, comments="", fmt="%.12g")
    return path / "map.csv"


def npz_with_angle(path, known):
    np.savez(
        path / "map.npz",
        i_d=known.i_d,
        i_q=known.i_q,
        theta_el=known.theta,
        psi_d=known.psi_d,
        psi_q=known.psi_q,
    )
    return path / "map.npz"


def syre(path, known):
    i_d, i_q = np.meshgrid(known.i_d, known.i_q)
    psi_d, psi_q = known.mean
    savemat(path / "map.mat", {"Id": i_d, "Iq": i_q, "Fd": psi_d.T, "Fq": psi_q.T, "T": psi_d})
    return path / "map.mat"


def syre_model(path, known):
    (i_d, i_q), (psi_d, psi_q) = known.grids, known.mean
    grid = {"Id": i_d, "Iq": i_q, "Fd": psi_d, "Fq": psi_q}
    other = {"id": known.i_d, "iq": known.i_q}  # another map of SyR-e's that must not be taken
    model = {"data": {"axisType": "PM"}, "FluxMap_dq": grid, "MTPA": other}
    savemat(path / "map.mat", {"motorModel": model, "geo": {"p": 5}})
    return path / "map.mat"


def syre_model_of_reluctance_axes(path, known):
    (i_d, i_q), (psi_d, psi_q) = known.grids, known.mean
    grid = {"Id": i_q, "Iq": -i_d, "Fd": psi_q, "Fq": -psi_d}
    savemat(path / "map.mat", {"motorModel": {"data": {"axisType": "SR"}, "FluxMap_dq": grid}})
    return path / "map.mat"


def simulink_with_angle(path, known):
    names = {"idVec": known.i_d, "iqVec": known.i_q, "fluxD": known.psi_d, "fluxQ": known.psi_q}
    savemat(path / "map.mat", names | {"angleVec": np.degrees(known.theta) / 5})
    return path / "map.mat"


def vectors_transposed_in_a_struct(path, known):
    psi_d, psi_q = known.mean
    fields = {"i_d_vec": known.i_d, "i_q_vec": known.i_q, "Psi_d": psi_d.T, "Psi_q": psi_q.T}
    savemat(path / "map.mat", {"motor": fields})
    return path / "map.mat"


def motor_cad(path, known):
    (i_d, i_q), (psi_d, psi_q) = known.grids, known.mean
    names = {"Id_Peak": i_d, "Iq_Peak": i_q, "Flux_Linkage_D": psi_d, "Flux_Linkage_Q": psi_q}
    savemat(path / "map.mat", names)
    return path / "map.mat"


def motor_cad_polar_with_angle(path, known):
    length, advance = np.meshgrid(
        np.linspace(0, 300, 16), np.linspace(-180, 180, 37), indexing="ij"
    )
    gamma = np.radians(advance)
    currents = np.stack([-length * np.sin(gamma), length * np.cos(gamma)], axis=-1)
    psi = flux(TRACTION_300A, currents.reshape(-1, 2), ANGLES).linkage.reshape(16, 37, 12, 2)
    names = {"Stator_Current_Phase_Peak": length, "Phase_Advance": advance}
    position = np.broadcast_to(np.degrees(ANGLES), (16, 37, 12))
    names |= {"Angular_Rotor_Position": position, "Angular_Flux_Linkage_D": psi[..., 0]}
    savemat(path / "map.mat", names | {"Angular_Flux_Linkage_Q": psi[..., 1]})
    return path / "map.mat"


def motulator(path, known):
    (i_d, i_q), (psi_d, psi_q) = known.grids, known.mean
    np.savez(path / "map.npz", i_s_dq=i_d + 1j * i_q, psi_s_dq=psi_d + 1j * psi_q)
    return path / "map.npz"


WITH_ANGLE = [csv_with_angle, npz_with_angle, simulink_with_angle, motor_cad_polar_with_angle]
SYRE = [syre, syre_model, syre_model_of_reluctance_axes]
MEAN = [csv_mean, *SYRE, vectors_transposed_in_a_struct, motor_cad, motulator]


# --- round trips -------------------------------------------------------------------------------


@pytest.mark.parametrize("write", WITH_ANGLE + MEAN)
def test_every_layout_gives_back_the_same_flux(tmp_path, known, write):
    imported = import_machine(write(tmp_path, known), resistance=0.01, pole_pairs=5)
    machine, findings = imported.machine, imported.findings
    radius = 0.95 * LIMIT * np.sqrt(np.linspace(0.01, 1.0, 60))
    turn = 2.4 * np.arange(60)
    currents = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=1)
    angles = np.array([0.2, 0.5, 0.9, 2.0])
    found = flux(machine, currents, angles).linkage
    expected = flux(TRACTION_300A, currents, angles).linkage
    if write in MEAN:
        expected = flux(TRACTION_300A, currents, ANGLES).linkage.mean(axis=1, keepdims=True)
    np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), atol=3e-5)
    assert machine.current_limit == pytest.approx(LIMIT)
    assert machine.magnet_flux_linkage == pytest.approx(57.7e-3, rel=1e-3)
    assert machine.name == "map"
    assert set(machine.angle_orders) >= ({6, 12} if write in WITH_ANGLE else set())
    assert findings.fit_error < 1e-5
    assert findings.smallest_inductance > 100e-6
    assert findings.checks.reciprocity_residual < 2e-6
    assert findings.checks.asymmetry is None or findings.checks.asymmetry < 1e-6
    assert findings.warnings == ()


def test_an_imported_machine_keeps_the_law_of_torque(tmp_path, known):
    path = npz_with_angle(tmp_path, known)
    machine = import_machine(path, resistance=0.01, pole_pairs=5).machine
    assert isinstance(machine.coenergy, SplineCoenergy)
    assert tabulate(machine) is machine.coenergy.table
    current, theta = np.array([[-80.0, 120.0]]), np.linspace(0.0, 1.0, 7)
    i_d, i_q = np.repeat(current, 7, axis=0).T
    expected = torque(TRACTION_300A, i_d, i_q, theta)
    np.testing.assert_allclose(torque(machine, i_d, i_q, theta), expected, rtol=1e-3)


def test_a_disc_with_nothing_outside_is_a_map(tmp_path, known):
    outside = np.hypot(*known.grids) > 1.001 * LIMIT
    psi_d, psi_q = (np.where(outside, np.nan, psi) for psi in known.mean)
    path = tmp_path / "disc.npz"
    np.savez(path, i_d=known.i_d, i_q=known.i_q, psi_d=psi_d, psi_q=psi_q)
    findings = import_machine(path, resistance=0.01, pole_pairs=5).findings
    assert findings.checks.covered_share == pytest.approx(1 - outside.mean())
    assert findings.smallest_inductance > 100e-6
    assert findings.warnings == ()


def test_half_a_map_is_said_and_mirrored_on_request(tmp_path):
    half = sampled(np.linspace(-300, 300, 21), np.linspace(0, 300, 13))
    path = npz_with_angle(tmp_path, half)
    said = import_machine(path, resistance=0.01, pole_pairs=5).findings.warnings
    assert said == ("the map covers one sign of i_q; the other is extrapolated, not mirrored",)
    whole = import_machine(path, resistance=0.01, pole_pairs=5, mirror=True)
    currents, angles = np.array([[-100.0, -200.0], [50.0, -250.0]]), np.array([0.3, 0.8])
    found = flux(whole.machine, currents, angles).linkage
    expected = flux(TRACTION_300A, currents, angles).linkage
    np.testing.assert_allclose(found, expected, atol=3e-5)
    assert whole.findings.warnings == ()


def test_a_skew_part_is_reported_and_does_not_reach_the_machine(tmp_path, known):
    (i_d, i_q), (psi_d, psi_q) = known.grids, known.mean
    path = tmp_path / "skew.npz"
    np.savez(path, i_d=i_d, i_q=i_q, psi_d=psi_d - 20e-6 * i_q, psi_q=psi_q + 20e-6 * i_d)
    imported = import_machine(path, resistance=0.01, pole_pairs=5)
    checks = imported.findings.checks
    assert checks.reciprocity_residual == pytest.approx(40e-6, rel=0.01)
    assert checks.asymmetry == pytest.approx(2 * 20e-6 * 300 / np.sqrt(3), rel=0.2)
    assert imported.findings.skew == pytest.approx(20e-6, rel=0.01)
    assert "the map is not reciprocal by 40 uH rms" in imported.findings.warnings[0]
    assert "differs from its mirror image" in imported.findings.warnings[1]
    mean = flux(TRACTION_300A, [[-100.0, 0.0], [0.0, 200.0]], ANGLES).linkage.mean(axis=1)
    found = flux(imported.machine, [[-100.0, 0.0], [0.0, 200.0]], np.zeros(1)).linkage[:, 0]
    np.testing.assert_allclose(found, mean, atol=1e-4)


# --- refusals ----------------------------------------------------------------------------------


def refused(path, sentence, **options):
    options = {"resistance": 0.01, "pole_pairs": 5} | options
    with pytest.raises(InputError, match=re.escape(sentence)) as caught:
        import_machine(path, **options)
    assert str(caught.value).startswith(str(path))
    assert str(caught.value).count(". ") == 0


def written(path, known, **changed):
    psi_d, psi_q = known.mean
    arrays = {"i_d": known.i_d, "i_q": known.i_q, "psi_d": psi_d, "psi_q": psi_q} | changed
    np.savez(path / "map.npz", **{name: v for name, v in arrays.items() if v is not None})
    return path / "map.npz"


def test_holes_are_refused(tmp_path, known):
    psi_d = known.mean[0].copy()
    psi_d[5, 12] = np.nan
    path = written(tmp_path, known, psi_d=psi_d)
    refused(path, "1 points inside the covered region have no values, the first at i_d = -150 A")


def test_cells_that_cannot_be_inverted_are_refused(tmp_path, known):
    psi_d = known.mean[0].copy()
    psi_d[10, 12] += 20e-3
    path = written(tmp_path, known, psi_d=psi_d)
    refused(path, "psi cannot be inverted in 2 of 480 cells")


def test_a_transposed_square_matrix_is_refused(tmp_path):
    square = sampled(np.linspace(-300, 300, 13), np.linspace(-300, 300, 13))
    psi_d, psi_q = square.mean
    path = written(tmp_path, square, psi_d=psi_d.T, psi_q=psi_q.T)
    refused(path, "look for a transposed matrix")


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"psi_d": None}, "but none of psid, fluxd"),
        ({"i_q": None}, "but none of iq, iqvec"),
        ({"psi_d": np.zeros((3, 3))}, "psi_d has shape (3, 3) and psi_q (21, 25)"),
        ({"i_d": np.zeros(4)}, "do not belong together"),
        ({"i_d": np.full(21, np.nan)}, "a current or angle is not finite"),
    ],
)
def test_arrays_that_make_no_map_are_refused(tmp_path, known, changed, sentence):
    refused(written(tmp_path, known, **changed), sentence)


def test_numbers_and_orders_that_cannot_be_are_refused(tmp_path, known):
    path = npz_with_angle(tmp_path, known)
    refused(path, "12 angles cannot resolve the orders 6, 36", orders=(6, 36))
    refused(path, "give a resistance not below zero", resistance=-1.0)
    refused(path, "1 points of the map lie within 1.25e-09 A", current_limit=1e-9)


def test_files_of_other_kinds_are_refused(tmp_path):
    for suffix, sentence in (
        (".xlsx", "must be one of .csv, .npz, .mat"),
        (".npz", "not a NumPy archive of numbers"),
        (".mat", "not a MATLAB file"),
        (".csv", "no column holds numbers only"),
    ):
        path = tmp_path / f"map{suffix}"
        path.write_text("these are words\nand more words\n")
        refused(path, sentence)


def test_csv_that_is_no_grid_is_refused(tmp_path):
    path = tmp_path / "map.csv"
    numbers = np.random.default_rng(3).normal(size=(40, 4))
    np.savetxt(path, numbers, delimiter=",", header="i_d,i_q,psi_d,psi_q", comments="")
    refused(path, "sample the map on a grid of i_d and i_q")
    grid = np.repeat([[1.0, 2.0, 3.0, 4.0]], 2, axis=0)
    np.savetxt(path, grid, delimiter=",", header="i_d,i_q,psi_d,psi_q", comments="")
    refused(path, "is listed twice; list it once")


def test_a_file_that_is_not_there_is_the_systems_error(tmp_path):
    for suffix in (".csv", ".npz", ".mat"):
        with pytest.raises(FileNotFoundError):
            read_flux_table(tmp_path / f"none{suffix}", pole_pairs=5)
