"""Exports: what other programs read is the fit's map, and unsupported points are marked."""

import builtins
import zipfile
from dataclasses import replace

import numpy as np
import onnxruntime
import pytest
from scipy.interpolate import RegularGridInterpolator
from scipy.io import loadmat

from penode.bench.flux_table import read_flux_table
from penode.errors import InputError
from penode.pmsm.exports.formats import FORMATS, export
from penode.pmsm.machine.flux_grid import read_grid
from penode.pmsm.machine.flux_maps import draw_flux_map
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.terms import Resistance
from penode.pmsm.result_files import flux_map_csv


def written(fit, to, folder, **options):
    path = folder / f"map{FORMATS[to].suffix}"
    return path, export(fit, to, path, **options)


@pytest.mark.parametrize("to", ["csv", "npz", "mat", "syre"])
def test_files_read_back_by_the_importer_hold_the_fits_map(machine_fit, tmp_path, to):
    path, _ = written(machine_fit, to, tmp_path)
    table = read_flux_table(path, pole_pairs=5)
    psi = machine_fit.flux_map(table.i_d, table.i_q)
    found = np.stack([table.psi_d[..., 0], table.psi_q[..., 0]])
    np.testing.assert_allclose(found, psi, rtol=1e-7, atol=1e-10)
    assert table.i_d.size == {"syre": 256}.get(to, 41) ** 2


def test_csv_is_flux_map_csv(machine_fit, tmp_path):
    path, _ = written(machine_fit, "csv", tmp_path)
    assert path.read_text() == flux_map_csv(machine_fit)


def test_npz_has_motulators_arrays(machine_fit, tmp_path):
    path, grid = written(machine_fit, "npz", tmp_path, pole_pairs=4)
    with np.load(path) as arrays:
        names = {"i_s_dq", "psi_s_dq", "supported", "tau_M", "n_p", "R_s", "temperatures"}
        assert set(arrays) == names
        current, psi = arrays["i_s_dq"], arrays["psi_s_dq"]
        np.testing.assert_allclose(arrays["tau_M"], 6 * np.imag(current * np.conj(psi)), atol=1e-12)
        np.testing.assert_array_equal(arrays["supported"], grid.supported)
    assert (np.diff(current.real, axis=0) > 0).all()
    assert (np.diff(current.imag, axis=1) > 0).all()


def test_syre_has_meshgrid_matrices_by_themselves_and_in_a_struct(machine_fit, tmp_path):
    path, grid = written(machine_fit, "syre", tmp_path, points=21)
    variables = loadmat(path, squeeze_me=True)
    struct = variables["fdfq_idiq"]
    for name in ("Id", "Iq", "Fd", "Fq", "T", "supported"):
        np.testing.assert_array_equal(struct[name].item(), variables[name])
    i_d, i_q = np.meshgrid(grid.i_d, grid.i_q)
    np.testing.assert_array_equal(variables["Id"], i_d)
    np.testing.assert_array_equal(variables["Iq"], i_q)
    torque = 7.5 * (variables["Fd"] * i_q - variables["Fq"] * i_d)
    np.testing.assert_allclose(variables["T"], torque, atol=1e-12)
    np.testing.assert_array_equal(variables["supported"], grid.supported.T)


def test_torque_and_resistance_are_left_out_where_they_are_not_known(machine_fit, tmp_path):
    unknown = replace(
        machine_fit, provenance={}, horizon=replace(machine_fit.horizon, verdict="no plateau")
    )
    path, _ = written(unknown, "npz", tmp_path)
    with np.load(path) as arrays:
        assert set(arrays) == {"i_s_dq", "psi_s_dq", "supported", "temperatures"}
    path, _ = written(unknown, "mat", tmp_path)
    assert not {"torque", "polePairs", "Rs"} & set(loadmat(path))


@pytest.mark.parametrize("name", ["npz", "mat", "m", "xlsx", "syre", "c", "c_fixed", "onnx"])
def test_a_file_of_a_fit_without_an_answer_says_so(machine_fit, tmp_path, name):
    lost = replace(machine_fit, horizon=replace(machine_fit.horizon, verdict="no plateau"))
    for fit, said in ((lost, True), (machine_fit, False)):
        path, _ = written(fit, name, tmp_path)
        assert ("no plateau" in text_of(path)) == said


def text_of(path):
    """Return the text in a file, packed or not."""
    if path.suffix == ".mat":
        return str(loadmat(path))
    if path.suffix in (".npz", ".xlsx"):
        with zipfile.ZipFile(path) as parts:
            content = b"".join(parts.read(one) for one in parts.namelist())
    else:
        content = path.read_bytes()
    return content.replace(b"\0", b"").decode("latin1")


def test_mat_has_rising_vectors_with_zero_and_the_tables_over_them(machine_fit, tmp_path):
    path, grid = written(machine_fit, "mat", tmp_path)
    tables = loadmat(path, squeeze_me=True)
    for name in ("idVec", "iqVec", "fluxDVec", "fluxQVec"):
        assert (np.diff(tables[name]) > 0).all()
    assert 0.0 in tables["idVec"]
    assert 0.0 in tables["iqVec"]
    names = ("lDD", "lDQ", "lQD", "lQQ")
    np.testing.assert_array_equal([tables[n] for n in names], grid.inductance.reshape(4, 41, 41))
    np.testing.assert_array_equal(tables["supported"], grid.supported)
    assert tables["Rs"] == 0.01
    assert tables["polePairs"] == 5


def test_inverse_map_in_mat_undoes_the_map(machine_fit, tmp_path, rng):
    path, _ = written(machine_fit, "mat", tmp_path)
    tables = loadmat(path, squeeze_me=True)
    axes = (tables["fluxDVec"], tables["fluxQVec"])
    current = np.stack([tables["idOfFlux"], tables["iqOfFlux"]], axis=-1)
    supported = tables["supportedOfFlux"] > 0
    assert np.isfinite(current).all()
    assert supported.mean() > 0.4
    flux = np.stack(np.meshgrid(*axes, indexing="ij"))
    at_points = machine_fit.flux_map(*np.moveaxis(current, -1, 0)) - flux
    assert np.abs(at_points[:, supported]).max() < 1e-12
    between = rng.uniform([a[0] for a in axes], [a[-1] for a in axes], (2000, 2))
    inside = RegularGridInterpolator(axes, supported.astype(float))(between) == 1
    between = between[inside]
    found = RegularGridInterpolator(axes, current)(between)
    largest = np.abs(flux).max()
    assert np.abs(machine_fit.flux_map(*found.T) - between.T).max() < 2e-3 * largest


@pytest.mark.parametrize(
    ("kind", "orders"),
    [
        ("coenergy", ()),
        ("coenergy", (6, 12)),
        ("convex", ()),
        ("convex", (6, 12)),
        ("mlp", ()),
        ("mlp", (6, 12)),
    ],
)
def test_onnx_is_the_network_itself(machine_fit, tmp_path, kind, orders, rng):
    if kind != "coenergy" or orders:
        drawn = draw_flux_map(kind, 3, (300.0, 0.08), orders)
        machine_fit = replace(machine_fit, model=Machine(drawn, (Resistance(0.01),)))
    path, grid = written(machine_fit, "onnx", tmp_path)
    session = onnxruntime.InferenceSession(path)
    currents = np.concatenate([rng.uniform(-400, 400, (300, 2)), grid.mesh.reshape(2, -1).T])
    psi, supported = session.run(None, {"currents": currents.astype(np.float32)})
    expected = machine_fit.flux_map(*currents.astype(np.float32).T)
    assert np.abs(psi.T - expected).max() < 2e-6 * np.abs(expected).max()
    np.testing.assert_array_equal(supported[300:], grid.supported.ravel())
    beyond = (currents < [grid.i_d[0] - 20, grid.i_q[0] - 20]).any(axis=1)
    assert not supported[beyond].any()


def test_onnx_refuses_maps_with_other_operations(machine_fit, tmp_path):
    other = draw_flux_map("polynomial", 0, (300.0, 0.08))
    fit = replace(machine_fit, model=Machine(other, (Resistance(0.01),)))
    with pytest.raises(InputError, match="export npz, mat or c instead"):
        written(fit, "onnx", tmp_path)


def test_onnx_without_its_package_names_the_install(machine_fit, tmp_path, monkeypatch):
    importing = builtins.__import__

    def without(name, *rest):
        if name == "onnx":
            raise ImportError(name)
        return importing(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"pip install 'penode\[onnx\]'"):
        written(machine_fit, "onnx", tmp_path)
    assert not any(tmp_path.iterdir())


def test_unknown_formats_and_wrong_suffixes_are_refused(machine_fit, tmp_path):
    with pytest.raises(InputError, match=r"csv \(any program\), .*Excel"):
        export(machine_fit, "fmu", tmp_path / "map.fmu")
    for to, known in FORMATS.items():
        with pytest.raises(InputError, match=rf"must be '\{known.suffix}' .*\.txt"):
            export(machine_fit, to, tmp_path / "map.txt")
    assert not any(tmp_path.iterdir())


def test_csv_reads_back_as_a_grid(machine_fit, tmp_path):
    path, _ = written(machine_fit, "csv", tmp_path)
    grid = read_grid(path)
    np.testing.assert_allclose(grid.psi, machine_fit.flux_map(*grid.mesh), rtol=1e-7, atol=1e-9)


def test_points_of_a_csv_file_are_refused(machine_fit, tmp_path):
    with pytest.raises(InputError, match=r"has the grid of flux_map.csv; leave the points out"):
        export(machine_fit, "csv", tmp_path / "map.csv", points=11)


def test_more_points_than_a_table_should_have_are_refused(machine_fit, tmp_path):
    with pytest.raises(InputError, match=r"^points a side must be <= 2000, got 1000000\.$"):
        export(machine_fit, "npz", tmp_path / "map.npz", points=1_000_000)
    assert list(tmp_path.iterdir()) == []
