"""The C header compiles without a warning and looks up what Python interpolates."""

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from penode.pmsm.control.controlled_machine import ControlledMachine
from penode.pmsm.exports.c_header import encode, identifier
from penode.pmsm.exports.control_tables import inverse_map, torque_per_ampere
from penode.pmsm.machine.flux_grid import tabulate

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "export-to-a-controller.md"
GCC = shutil.which("gcc")
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wconversion", "-Wshadow"]
#: Reads pairs of floats, writes psi, L and support of each.
PROGRAM = """
#include <stdio.h>
#include "machine.h"

int main(void)
{
    float at[2];
    while (fread(at, sizeof(float), 2U, stdin) == 2U)
    {
        const machine_flux_t psi = machine_flux(at[0], at[1]);
        const machine_inductance_t l = machine_inductance(at[0], at[1]);
        const machine_current_t i = machine_current(at[0], at[1]);
        const machine_current_t least = machine_mtpa(at[0]);
        const float row[13] = {psi.psi_d, psi.psi_q, l.l_dd, l.l_dq, l.l_qd, l.l_qq,
                               (float)machine_is_supported(at[0], at[1]),
                               machine_torque(at[0], at[1]), i.i_d, i.i_q,
                               (float)machine_current_is_supported(at[0], at[1]),
                               least.i_d, least.i_q};
        (void)fwrite(row, sizeof(float), 13U, stdout);
    }
    return 0;
}
"""


@pytest.fixture(scope="module")
def grid(machine_fit):
    return tabulate(machine_fit, 33)


#: The same of pairs of 16-bit counts, without the inductances.
FIXED = """
#include <stdio.h>
#include "machine.h"

int main(void)
{
    int16_t at[2];
    while (fread(at, sizeof(int16_t), 2U, stdin) == 2U)
    {
        const machine_flux_t psi = machine_flux(at[0], at[1]);
        const machine_current_t i = machine_current(at[0], at[1]);
        const machine_current_t least = machine_mtpa(at[0]);
        const int16_t row[9] = {psi.psi_d, psi.psi_q, (int16_t)machine_is_supported(at[0], at[1]),
                                machine_torque(at[0], at[1]), i.i_d, i.i_q,
                                (int16_t)machine_current_is_supported(at[0], at[1]),
                                least.i_d, least.i_q};
        (void)fwrite(row, sizeof(int16_t), 9U, stdout);
    }
    return 0;
}
"""


@pytest.fixture(scope="module")
def control(machine_fit, grid):
    return inverse_map(machine_fit, grid), torque_per_ampere(machine_fit, grid)


def compiled(folder, header, program, kind):
    """Return a function from pairs of numbers to the compiled header's rows."""
    if GCC is None:
        pytest.skip("gcc is not installed")
    (folder / "machine.h").write_text(header)
    (folder / "main.c").write_text(program)
    command = [GCC, *STRICT, "-O2", "main.c", "-o", "look_up"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr

    def run(pairs):
        content = np.asarray(pairs).astype(kind).tobytes()
        done = subprocess.run([folder / "look_up"], input=content, capture_output=True, check=True)
        return np.frombuffer(done.stdout, kind).reshape(len(pairs), -1)

    return run


@pytest.fixture(scope="module")
def look_up(grid, control, tmp_path_factory):
    """Return a function from currents (point, 2) to the answers (point, 13) in float."""
    header = encode(grid, "machine", *control)
    return compiled(tmp_path_factory.mktemp("c"), header, PROGRAM, np.float32)


def interpolated(grid, currents):
    """psi_d, psi_q, l_dd .. l_qq (point, 6) between the table's float32 numbers, in float64."""
    tables = np.concatenate([grid.psi, grid.inductance.reshape(4, *grid.supported.shape)])
    tables = tables.astype(np.float32).astype(np.float64)
    between = RegularGridInterpolator((grid.i_d, grid.i_q), np.moveaxis(tables, 0, -1))
    low, high = ([axis[end] for axis in (grid.i_d, grid.i_q)] for end in (0, -1))
    return between(np.clip(currents.astype(np.float32).astype(np.float64), low, high))


def test_look_up_is_the_tables_interpolation(grid, look_up, rng):
    currents = np.concatenate([rng.uniform(-320, 320, (20_000, 2)), grid.mesh.reshape(2, -1).T])
    found, expected = look_up(currents)[:, :6], interpolated(grid, currents)
    error = np.abs(found - expected).max(axis=0)
    assert (error < 1e-6 * np.abs(expected).max(axis=0)[[0, 1, 2, 5, 5, 5]]).all(), error


def test_points_of_the_grid_are_exact_at_zero_and_clamped_beyond(grid, look_up):
    middle, far, edge = look_up(np.array([[0.0, 0.0], [1e9, -1e30], [grid.i_d[-1], grid.i_q[0]]]))
    at_zero = grid.psi[:, grid.i_d == 0][:, :, grid.i_q == 0].ravel()
    np.testing.assert_array_equal(middle[:2], at_zero.astype(np.float32))
    np.testing.assert_allclose(far[:6], edge[:6], rtol=1e-5)
    assert middle[6] == 1
    assert far[6] == 0


def test_what_is_not_a_number_takes_the_lowest_current_and_is_not_supported(grid, look_up):
    nan, infinite, low = look_up(
        np.array([[np.nan, np.nan], [-np.inf, -np.inf], [grid.i_d[0], grid.i_q[0]]])
    )
    np.testing.assert_array_equal(nan[:6], infinite[:6])
    np.testing.assert_allclose(infinite[:6], low[:6], rtol=1e-5)
    assert nan[6] == infinite[6] == 0


def test_cells_with_an_unsupported_corner_are_marked(grid, look_up, rng):
    currents = rng.uniform(-320, 320, (5000, 2))
    low, high = ([axis[end] for axis in (grid.i_d, grid.i_q)] for end in (0, -1))
    within = ((currents >= low) & (currents <= high)).all(axis=1)
    mask = RegularGridInterpolator((grid.i_d, grid.i_q), grid.supported.astype(float))
    expected = np.zeros(len(currents), dtype=bool)
    expected[within] = mask(currents[within]) > 1 - 1e-9
    np.testing.assert_array_equal(look_up(currents)[:, 6] == 1, expected)


def test_two_machines_share_one_program(grid, control, tmp_path):
    if GCC is None:
        pytest.skip("gcc is not installed")
    for name in ("front", "rear"):
        (tmp_path / f"{name}.h").write_text(encode(grid, name, *control))
    (tmp_path / "main.c").write_text(
        '#include "front.h"\n#include "rear.h"\n#include "front.h"\n'
        "int main(void) { return (int)(front_is_supported(0.0F, 0.0F)"
        " + rear_is_supported(0.0F, 0.0F)) - 2; }\n"
    )
    subprocess.run([GCC, *STRICT, "main.c", "-o", "both"], cwd=tmp_path, check=True)
    subprocess.run([tmp_path / "both"], check=True)


def test_the_header_allocates_nothing_and_says_what_is_known(grid, control):
    text = encode(grid, "machine", *control)
    for word in ("malloc", "goto", "while", "for (", "double", "*)"):
        assert word not in text
    assert "#define MACHINE_RESISTANCE (0.00999999978F)" in text
    assert "#define MACHINE_POLE_PAIRS (5U)" in text
    assert "DEAD_TIME" not in text
    beside = encode(replace(grid, dead_time_voltage=4.0), "machine", *control)
    assert "#define MACHINE_DEAD_TIME_VOLTAGE (4.0F)" in beside
    assert "Beside R the inverter takes MACHINE_DEAD_TIME_VOLTAGE, in V, off each phase" in beside
    assert len(re.findall(r"static inline", text)) == 12


def test_the_code_on_the_page_compiles(grid, control, tmp_path):
    if GCC is None:
        pytest.skip("gcc is not installed")
    (code,) = re.findall(r"```c\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)
    (tmp_path / "machine.h").write_text(encode(grid, "machine", *control))
    main = "float torque(float wanted);\n" + code + "int main(void) { return "
    (tmp_path / "main.c").write_text(
        main + "(torque(50.0F) > 49.0F) && (torque(1e6F) > 49.0F) ? 0 : 1; }\n"
    )
    subprocess.run([GCC, *STRICT, "main.c", "-o", "main"], cwd=tmp_path, check=True)
    subprocess.run([tmp_path / "main"], check=True)


@pytest.mark.parametrize(
    ("name", "legal"),
    [("machine", "machine"), ("my-map 2", "my_map_2"), ("2024", "map_2024"), ("ψ", "map__")],
)
def test_file_names_become_identifiers(name, legal):
    assert identifier(name) == legal


def between(axes, table):
    return RegularGridInterpolator(axes, np.moveaxis(table, 0, -1))


def test_torque_inverse_map_and_mtpa_are_those_of_the_tables(grid, control, look_up, rng):
    inverse, mtpa = control
    currents = rng.uniform(-240, 240, (2000, 2))
    psi = interpolated(grid, currents)[:, :2]
    torque = 7.5 * (psi[:, 0] * currents[:, 1] - psi[:, 1] * currents[:, 0])
    np.testing.assert_allclose(look_up(currents)[:, 7], torque, atol=2e-5 * np.abs(torque).max())

    axes = (inverse.psi_d, inverse.psi_q)
    flux = rng.uniform([a[0] for a in axes], [a[-1] for a in axes], (2000, 2))
    answers = look_up(flux)
    expected = between(axes, inverse.current)(flux)
    np.testing.assert_allclose(answers[:, 8:10], expected, atol=2e-4)
    supported = RegularGridInterpolator(axes, inverse.supported.astype(float))(flux)
    np.testing.assert_array_equal(answers[:, 10] == 1, supported > 1 - 1e-9)

    asked = np.linspace(-1.2, 1.2, 481) * mtpa.torque[-1]
    found = look_up(np.stack([asked, asked], axis=1))[:, 11:]
    clipped = np.clip(asked, mtpa.torque[0], mtpa.torque[-1])
    expected = np.stack([np.interp(clipped, mtpa.torque, one) for one in mtpa.current], axis=1)
    np.testing.assert_allclose(found, expected, atol=2e-4)
    least = look_up(np.full((1, 2), np.nan))[0, 11:]
    np.testing.assert_allclose(least, mtpa.current[:, 0], rtol=1e-6)


def test_the_head_says_how_far_both_look_ups_lead_beside(grid, control, look_up, rng):
    said = re.search(
        r"off by up to (\S+) A where both look-ups\n \* are supported, (\S+) A rms",
        encode(grid, "machine", *control),
    )
    low, high = grid.mesh.reshape(2, -1).min(axis=1), grid.mesh.reshape(2, -1).max(axis=1)
    at = rng.uniform(low, high, (200_000, 2))
    there = look_up(at)
    back = look_up(there[:, :2])
    both = (there[:, 6] == 1) & (back[:, 10] == 1)
    off = np.hypot(*(back[both, 8:10] - at[both]).T)
    assert both.sum() > 200
    assert 0.9 * off.max() < float(said[1]) < 1.2 * off.max()
    assert float(said[2]) == pytest.approx(np.sqrt(np.mean(off**2)), rel=0.05)


def test_torques_of_mtpa_that_recordings_support_are_said(machine_fit, grid, control, tmp_path):
    inverse, _ = control
    holed = replace(grid, supported=grid.supported & (np.hypot(*grid.mesh) > 60.0))
    mtpa = torque_per_ampere(machine_fit, holed)
    header = encode(holed, "machine", inverse, mtpa)
    look_up = compiled(tmp_path, header, PROGRAM, np.float32)
    asked = np.linspace(mtpa.torque[0], mtpa.torque[-1], 2001)
    least = look_up(np.stack([asked, asked], axis=1))[:, 11:]
    inside = look_up(least)[:, 6] == 1
    edges = np.flatnonzero(np.diff(inside.astype(int), prepend=0, append=0)).reshape(-1, 2)
    said = re.findall(r"(-?[\d.]+) to (-?[\d.]+)", mtpa.supported)
    assert len(said) == len(edges) == 2
    shown = asked[np.stack([edges[:, 0], edges[:, 1] - 1], axis=1)]
    np.testing.assert_allclose(np.array(said, float), shown, atol=0.005 * mtpa.torque[-1])
    assert f" * {mtpa.supported} Nm; in holes between" in header


def test_mtpa_of_each_sign_goes_as_far_as_recordings_support_it(machine_fit, grid):
    def one_sided(points):
        return machine_fit.supported(points) & ((points[:, 1] > 0) | (np.hypot(*points.T) < 150.0))

    fit = SimpleNamespace(
        **{
            name: getattr(machine_fit, name)
            for name in (
                "model",
                "flux_map",
                "differential_inductance",
                "excited",
                "horizon",
                "parameters",
            )
        },
        supported=one_sided,
        provenance=machine_fit.provenance,
    )
    whole, part = torque_per_ampere(machine_fit, grid), torque_per_ampere(fit, grid)
    for table, limits in ((whole, (200.0, 200.0)), (part, (130.0, 200.0))):
        assert 0.0 in table.torque
        lengths = np.hypot(*table.current[:, [0, -1]])
        assert (lengths > limits).all()
    assert np.hypot(*part.current[:, 0]) < 150.0
    step = part.torque[1] - part.torque[0]
    np.testing.assert_allclose(np.diff(part.torque), step, rtol=1e-9)


def test_mtpa_of_the_table_is_torque_at_the_least_current(machine_fit, control):
    """Nearby currents of the same length have less torque, of either sign."""
    _, mtpa = control
    machine = ControlledMachine.of(machine_fit)
    np.testing.assert_allclose(machine.torque(mtpa.current), mtpa.torque, atol=1e-6)
    assert (machine_fit.supported(mtpa.current.T)).all()
    for turn in (-0.02, 0.02):
        c, s = np.cos(turn), np.sin(turn)
        beside = machine.torque(np.array([[c, -s], [s, c]]) @ mtpa.current)
        moves = mtpa.torque != 0
        assert (np.abs(beside) < np.abs(mtpa.torque))[moves].all()


def test_sixteen_bits_differ_from_the_tables_by_no_more_than_the_head_says(
    grid, control, tmp_path, rng
):
    inverse, mtpa = control
    header = encode(grid, "machine", *control, fixed=True)
    look_up = compiled(tmp_path, header, FIXED, np.int16)
    units = dict(re.findall(r"MACHINE_(\w+)_PER_COUNT \(([-.e\d]+)F\)", header))
    ampere, flux, torque = (
        float(units[name]) for name in ("AMPERE", "VOLT_SECOND", "NEWTON_METRE")
    )
    stated = re.search(
        r"less than (\S+) Vs, a current of a flux linkage by less than (\S+) A,", header
    )
    of_flux, of_current = map(float, stated.groups())
    counts = rng.integers(-32768, 32768, (20_000, 2))
    counts[:4] = [[-32768, -32768], [32767, 32767], [0, 0], [32767, -32768]]
    answers = look_up(counts).astype(float)

    currents = counts * ampere
    low, high = ([axis[end] for axis in (grid.i_d, grid.i_q)] for end in (0, -1))
    psi = between((grid.i_d, grid.i_q), grid.psi)(np.clip(currents, low, high))
    error = np.abs(answers[:, :2] * flux - psi)
    supported = answers[:, 2] == 1
    assert 0.5 < supported.mean() < 0.9
    assert of_flux / 10 < error[supported].max() < of_flux
    expected = 7.5 * (psi[:, 0] * currents[:, 1] - psi[:, 1] * currents[:, 0])
    inside = np.abs(currents).max(axis=1) < 240
    largest = 7.5 * 240 * 2 * of_flux + 2 * torque
    assert np.abs(answers[:, 3] * torque - expected)[inside & supported].max() < largest

    axes = (inverse.psi_d, inverse.psi_q)
    fluxes = counts * flux
    clipped = np.clip(fluxes, [a[0] for a in axes], [a[-1] for a in axes])
    supported = answers[:, 6] == 1
    assert supported.mean() > 0.2
    error = np.abs(answers[:, 4:6] * ampere - between(axes, inverse.current)(clipped))
    assert of_current / 10 < error[supported].max() < of_current

    clipped = np.clip(counts[:, 0] * torque, mtpa.torque[0], mtpa.torque[-1])
    expected = np.stack([np.interp(clipped, mtpa.torque, one) for one in mtpa.current], axis=1)
    np.testing.assert_allclose(answers[:, 7:] * ampere, expected, atol=20 * ampere)
    assert "double" not in header
