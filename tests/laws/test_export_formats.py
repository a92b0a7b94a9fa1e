"""Every format of FORMATS: what other code reads from the file is the fit's map, R and temperature.

Each format has a reader here that shares nothing with its writer. A format without one fails.
"""

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import openpyxl
import pytest
from scipy.io import loadmat

from penode.pmsm.exports.formats import FORMATS, export
from penode.pmsm.machine.flux_maps import FluxMap
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.temperatures import RECORDED
from penode.pmsm.machine.terms import MagnetTemperature, Resistance, TemperatureResistance

POINTS = 9
#: Formats that cannot state a temperature, and why.
NO_TEMPERATURE = {
    "csv": "It is columns of numbers; result.json, of the same folder, has the terms."
}


@dataclass
class Read:
    """What a file holds: currents (point,), psi (2, point), and what else it states."""

    i_d: np.ndarray
    i_q: np.ndarray
    psi: np.ndarray
    supported: np.ndarray
    inductance: np.ndarray | None = None
    torque: np.ndarray | None = None
    facts: dict[str, float] = field(default_factory=dict)
    text: str = ""
    rounding: float = 3e-6  # of psi, over its largest
    reach: float = 200.0  # A, within which what is supported is compared


def from_csv(path):
    head, *lines = path.read_text().splitlines()
    columns = dict(zip(head.split(","), np.array([x.split(",") for x in lines], float).T, strict=1))
    inductance = np.stack([columns[n] for n in ("l_dd", "l_dq", "l_qd", "l_qq")])
    psi = np.stack([columns["psi_d"], columns["psi_q"]])
    return Read(columns["i_d"], columns["i_q"], psi, columns["supported"], inductance)


def from_npz(path):
    with np.load(path) as arrays:
        found = {name: arrays[name] for name in arrays}
    current, psi = found["i_s_dq"].ravel(), found["psi_s_dq"].ravel()
    names = {"R": "R_s", "T": "R_s_temperature", "alpha": "R_s_coefficient", "p": "n_p"}
    return Read(
        current.real,
        current.imag,
        np.stack([psi.real, psi.imag]),
        found["supported"].ravel(),
        torque=found["tau_M"].ravel(),
        facts={key: float(found[name]) for key, name in names.items() if name in found},
        text=str(found["temperatures"]),
    )


def from_mat(path):
    return from_tables(loadmat(path, squeeze_me=True))


def from_m(path):
    """The script's statements, each of one name, in brackets, quotes or by itself."""
    text = re.sub(r"^%.*$|\.\.\.\n", "", path.read_text(), flags=re.MULTILINE)
    found = {}
    for name, table, word, number in re.findall(
        r"^(\w+) = (?:\[([^]]*)\]|'((?:[^']|'')*)'|([^;]*));$", text, flags=re.MULTILINE
    ):
        rows = [row.split() for row in (table or number).split(";")]
        found[name] = word if word else np.array(rows, float).squeeze()
    return from_tables(found)


def from_tables(found):
    i_d, i_q = (one.ravel() for one in np.meshgrid(found["idVec"], found["iqVec"], indexing="ij"))
    names = {"R": "Rs", "T": "RsTemperature", "alpha": "RsCoefficient", "p": "polePairs"}
    return Read(
        i_d,
        i_q,
        np.stack([found["fluxD"].ravel(), found["fluxQ"].ravel()]),
        found["supported"].ravel(),
        np.stack([found[n].ravel() for n in ("lDD", "lDQ", "lQD", "lQQ")]),
        found["torque"].ravel(),
        {key: float(found[name]) for key, name in names.items() if name in found},
        str(found["temperatures"]),
    )


def from_syre(path):
    found = loadmat(path, squeeze_me=True)
    i_d, i_q, psi_d, psi_q = (found[name].ravel() for name in ("Id", "Iq", "Fd", "Fq"))
    assert (np.diff(found["Id"], axis=1) > 0).all()  # SyR-e interpolates along columns
    torque, text = found["T"].ravel(), str(found["temperatures"])
    return Read(
        i_d, i_q, np.stack([psi_d, psi_q]), found["supported"].ravel(), None, torque, {}, text
    )


def from_motorcad(path):
    """As Motor-CAD's files are read: i_d in the first column, i_q in the first row."""
    found = loadmat(path)
    i_d, i_q = found["Id_Peak"][:, 0], found["Iq_Peak"][0]
    assert (np.diff(i_d) > 0).all()
    assert (np.diff(i_q) > 0).all()
    lead, length = np.deg2rad(found["Phase_Advance"]), found["Stator_Current_Phase_Peak"]
    np.testing.assert_allclose(-length * np.sin(lead), found["Id_Peak"], atol=1e-9)
    np.testing.assert_allclose(length * np.cos(lead), found["Iq_Peak"], atol=1e-9)
    psi = np.stack([found["Flux_Linkage_D"].ravel(), found["Flux_Linkage_Q"].ravel()])
    return Read(
        found["Id_Peak"].ravel(),
        found["Iq_Peak"].ravel(),
        psi,
        found["supported"].ravel(),
        torque=found["Electromagnetic_Torque"].ravel(),
        text=str(found["temperatures"][0]),
    )


def from_xlsx(path):
    book = openpyxl.load_workbook(path, read_only=True, data_only=True)
    sheets = {sheet.title: list(sheet.iter_rows(values_only=True)) for sheet in book}
    i_q = np.array(sheets["psi_d in Vs"][0][1:], float)
    i_d = np.array([row[0] for row in sheets["psi_d in Vs"][1:]], float)
    table = {
        name: np.array([row[1:] for row in rows[1:]], float).ravel()
        for name, rows in sheets.items()
        if len(rows[0]) == len(i_q) + 1
    }
    facts = dict(row[:2] for row in sheets["facts"] if row[1] is not None)
    names = {"R": "R in ohm", "T": "temperature of R in degC", "alpha": "coefficient of R in 1/K"}
    names["p"] = "pole pairs"
    inductance = [table[f"L_{name} in H"] for name in ("dd", "dq", "dq", "qq")]
    return Read(
        *(one.ravel() for one in np.meshgrid(i_d, i_q, indexing="ij")),
        np.stack([table["psi_d in Vs"], table["psi_q in Vs"]]),
        table["supported"],
        np.stack(inductance),
        table["torque in Nm"],
        {key: float(facts[name]) for key, name in names.items() if name in facts},
        " ".join(str(row[0]) for row in sheets["facts"]),
    )


PROGRAM = """
#include <stdio.h>
#include "map.h"
int main(void)
{
#ifdef MAP_RESISTANCE
    printf("{\\"R\\": %.9g, ", (double)MAP_RESISTANCE);
#else
    printf("{");
#endif
#ifdef MAP_RESISTANCE_TEMPERATURE
    printf("\\"T\\": %.9g, ", (double)MAP_RESISTANCE_TEMPERATURE);
#endif
#ifdef MAP_RESISTANCE_COEFFICIENT
    printf("\\"alpha\\": %.9g, ", (double)MAP_RESISTANCE_COEFFICIENT);
#endif
    printf("\\"p\\": %u}\\n", MAP_POLE_PAIRS);
#ifdef MAP_AMPERE_PER_COUNT
    int at[2];
    while (scanf("%d %d", &at[0], &at[1]) == 2)
    {
        const map_flux_t psi = map_flux((int16_t)at[0], (int16_t)at[1]);
        printf("%d %d %u\\n", psi.psi_d, psi.psi_q,
               (unsigned)map_is_supported((int16_t)at[0], (int16_t)at[1]));
    }
#else
    float at[2];
    while (scanf("%f %f", &at[0], &at[1]) == 2)
    {
        const map_flux_t psi = map_flux(at[0], at[1]);
        const map_inductance_t l = map_inductance(at[0], at[1]);
        printf("%.9g %.9g %.9g %.9g %.9g %.9g %u\\n", psi.psi_d, psi.psi_q, l.l_dd, l.l_dq, l.l_qd,
               l.l_qq, (unsigned)map_is_supported(at[0], at[1]));
    }
#endif
    return 0;
}
"""


def from_c(path):
    i_d, i_q = c_points(path)
    rows, facts, comment = c_answers(
        path, [f"{d:.9g} {q:.9g}" for d, q in zip(i_d, i_q, strict=True)]
    )
    return Read(i_d, i_q, rows[:2], rows[6], rows[2:6], None, facts, comment)


def from_c_fixed(path):
    """Whole counts beside the points of the table: within cells, that all corners must support."""
    units = dict(re.findall(r"MAP_(\w+)_PER_COUNT \(([-.e\d]+)F\)", path.read_text()))
    ampere, flux = float(units["AMPERE"]), float(units["VOLT_SECOND"])
    counts = np.rint(np.stack(c_points(path)) / ampere).astype(int)
    rows, facts, comment = c_answers(path, [f"{d} {q}" for d, q in counts.T])
    i_d, i_q = counts * ampere
    stated = float(re.search(r"flux linkage by less than (\S+) Vs", comment)[1])
    rounding = stated / np.abs(rows[:2] * flux).max()
    return Read(i_d, i_q, rows[:2] * flux, rows[2], None, None, facts, comment, rounding, 110.0)


def c_points(path):
    """Points of the table as its own comment states their range."""
    (stated,) = [line for line in path.read_text().splitlines() if "Even grid" in line]
    low_d, high_d, low_q, high_q = (
        float(word) for word in stated.replace(",", " ").split() if word[-1].isdigit()
    )
    axes = np.linspace(low_d, high_d, POINTS), np.linspace(low_q, high_q, POINTS)
    return [one.ravel() for one in np.meshgrid(*axes, indexing="ij")]


def c_answers(path, lines):
    """What the compiled look-up answers, its macros, and the comment at the head."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    folder = path.parent
    (folder / "main.c").write_text(PROGRAM)
    subprocess.run(["gcc", "main.c", "-o", "main"], cwd=folder, check=True)
    done = subprocess.run([folder / "main"], input="\n".join(lines), capture_output=True, text=True)
    facts, *rows = done.stdout.splitlines()
    comment = " ".join(path.read_text().split("*/")[0].replace("\n *", " ").split())
    return np.array([row.split() for row in rows], float).T, json.loads(facts), comment


def from_onnx(path):
    session = onnxruntime.InferenceSession(path)
    i_d, i_q = (
        one.ravel()
        for one in np.meshgrid(np.linspace(-200, 100, 7), np.linspace(-250, 250, 5), indexing="ij")
    )
    currents = np.stack([i_d, i_q], axis=-1).astype(np.float32)
    psi, supported = session.run(["flux_linkage", "supported"], {"currents": currents})
    meta = session.get_modelmeta().custom_metadata_map
    return Read(i_d, i_q, psi.T, supported, text=meta["temperatures"])


READERS: dict[str, Callable[[Path], Read]] = {
    "csv": from_csv,
    "npz": from_npz,
    "mat": from_mat,
    "motorcad": from_motorcad,
    "xlsx": from_xlsx,
    "syre": from_syre,
    "m": from_m,
    "c": from_c,
    "c_fixed": from_c_fixed,
    "onnx": from_onnx,
}


def read(fit: Any, to: str, folder: Path) -> Read:
    assert to in READERS, f"the format {to} has no reader in this test; write one"
    path = folder / f"map{FORMATS[to].suffix}"
    export(fit, to, path, points=None if to == "csv" else POINTS, pole_pairs=4)
    return READERS[to](path)


def check_map(found: Read, fit: Any) -> None:
    """Compare with the fit: psi and L point by point, the region, the torque and R."""
    wanted, at = fit.flux_map(found.i_d, found.i_q), np.stack([found.i_d, found.i_q], axis=-1)
    assert np.ptp(found.i_d) > 250
    assert np.ptp(found.i_q) > 400
    assert np.abs(found.psi - wanted).max() < found.rounding * np.abs(wanted).max()
    inside = np.hypot(found.i_d, found.i_q) < found.reach
    assert inside.sum() > 0
    np.testing.assert_array_equal(found.supported[inside] > 0, fit.supported(at[inside]))
    if found.inductance is not None:
        step = 0.01
        by_d = (fit.flux_map(found.i_d + step, found.i_q) - wanted) / step
        by_q = (fit.flux_map(found.i_d, found.i_q + step) - wanted) / step
        slopes = np.stack([by_d[0], by_q[0], by_d[1], by_q[1]])
        assert np.abs(found.inductance - slopes).max() < 1e-3 * np.abs(slopes).max()
    if found.torque is not None:
        torque = 1.5 * 4 * (wanted[0] * found.i_q - wanted[1] * found.i_d)
        assert np.abs(found.torque - torque).max() < 1e-6 * np.abs(torque).max()
    if found.facts:
        assert found.facts["p"] == 4
        assert found.facts["R"] == pytest.approx(fit.parameters["R"].value, rel=1e-6)


@pytest.mark.parametrize("to", FORMATS)
def test_the_file_holds_the_fits_map(machine_fit, to, tmp_path):
    check_map(read(machine_fit, to, tmp_path), machine_fit)


@pytest.mark.parametrize("to", FORMATS)
def test_a_wrong_sign_is_seen(machine_fit, to, tmp_path):
    flux = machine_fit.model.flux
    turned = FluxMap(flux.network, flux.current_scale, -flux.flux_scale)
    wrong = replace(machine_fit, model=Machine(turned, (Resistance(0.01),)))
    found = read(wrong, to, tmp_path)
    with pytest.raises(AssertionError):
        check_map(found, machine_fit)


def temperature_fit(fit, term, recorded):
    model = Machine(fit.model.flux, (term,))
    return replace(fit, model=model, provenance={**fit.provenance, RECORDED: recorded})


@pytest.mark.parametrize("to", [to for to in FORMATS if to not in NO_TEMPERATURE])
def test_the_temperature_of_r_and_of_the_map_is_stated(machine_fit, to, tmp_path):
    recorded = {"winding_temperature": [63.0, 40.0, 98.0], "magnet_temperature": [45.0, 44.0, 47.0]}
    term = TemperatureResistance(0.01, alpha=4.03e-3)
    found = read(temperature_fit(machine_fit, term, recorded), to, tmp_path)
    assert "magnets at 45 degC (recorded: 44 to 47)" in found.text
    if found.facts:
        assert found.facts["T"] == 20.0
        assert found.facts["alpha"] == pytest.approx(4.03e-3, rel=1e-6)
        assert "R is that at 20 degC" in found.text
        assert "R (1 + 0.00403 (T - 20))" in found.text
    del recorded["magnet_temperature"]
    plain = read(temperature_fit(machine_fit, Resistance(0.01), recorded), to, tmp_path)
    assert "the winding had 63 degC (recorded: 40 to 98)" in plain.text
    if plain.facts:
        assert plain.facts["T"] == 63.0
        assert "alpha" not in plain.facts
        assert "R is that of the winding, with cable and switches" in plain.text
        assert "are commands, at 63 degC" in plain.text
    silent = read(machine_fit, to, tmp_path)
    assert "The map is that of the magnets as recorded, at a temperature not known." in silent.text


@pytest.mark.parametrize("to", [to for to in FORMATS if to not in NO_TEMPERATURE])
def test_what_magnets_lose_a_kelvin_is_stated(machine_fit, to, tmp_path):
    terms = (Resistance(0.01), MagnetTemperature(-6.4e-5))
    model = Machine(machine_fit.model.flux, terms)
    found = read(replace(machine_fit, model=model), to, tmp_path)
    assert "magnets at 20 degC; at T its flux linkage in d is -6.4e-05 Vs/K" in found.text


def test_formats_without_a_temperature_exist_and_have_a_reason():
    assert set(NO_TEMPERATURE) <= set(FORMATS)
    assert all(NO_TEMPERATURE.values())
