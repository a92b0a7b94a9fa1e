"""The C header compiles without a warning and looks up what Python interpolates."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from penode.pmsm.exports.c_header import encode, identifier
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
        const float row[7] = {psi.psi_d, psi.psi_q, l.l_dd, l.l_dq, l.l_qd, l.l_qq,
                              (float)machine_is_supported(at[0], at[1])};
        (void)fwrite(row, sizeof(float), 7U, stdout);
    }
    return 0;
}
"""


@pytest.fixture(scope="module")
def grid(machine_fit):
    return tabulate(machine_fit, 33)


@pytest.fixture(scope="module")
def look_up(grid, tmp_path_factory):
    """Return a function from currents (point, 2) to the compiled header's answers (point, 7)."""
    if GCC is None:
        pytest.skip("gcc is not installed")
    folder = tmp_path_factory.mktemp("c")
    (folder / "machine.h").write_text(encode(grid, "machine"))
    (folder / "main.c").write_text(PROGRAM)
    command = [GCC, *STRICT, "-O2", "main.c", "-o", "look_up"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr

    def run(currents):
        content = currents.astype(np.float32).tobytes()
        done = subprocess.run([folder / "look_up"], input=content, capture_output=True, check=True)
        return np.frombuffer(done.stdout, np.float32).reshape(-1, 7)

    return run


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


def test_two_machines_share_one_program(grid, tmp_path):
    if GCC is None:
        pytest.skip("gcc is not installed")
    for name in ("front", "rear"):
        (tmp_path / f"{name}.h").write_text(encode(grid, name))
    (tmp_path / "main.c").write_text(
        '#include "front.h"\n#include "rear.h"\n#include "front.h"\n'
        "int main(void) { return (int)(front_is_supported(0.0F, 0.0F)"
        " + rear_is_supported(0.0F, 0.0F)) - 2; }\n"
    )
    subprocess.run([GCC, *STRICT, "main.c", "-o", "both"], cwd=tmp_path, check=True)
    subprocess.run([tmp_path / "both"], check=True)


def test_the_header_allocates_nothing_and_says_what_is_known(grid):
    text = encode(grid, "machine")
    for word in ("malloc", "goto", "while", "for (", "double", "*)"):
        assert word not in text
    assert "#define MACHINE_RESISTANCE (0.00999999978F)" in text
    assert "#define MACHINE_POLE_PAIRS (5U)" in text
    assert len(re.findall(r"static inline", text)) == 8


def test_the_code_on_the_page_compiles(grid, tmp_path):
    if GCC is None:
        pytest.skip("gcc is not installed")
    (code,) = re.findall(r"```c\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)
    (tmp_path / "machine.h").write_text(encode(grid, "machine"))
    main = "float torque(float i_d, float i_q);\n" + code + "int main(void) { return "
    (tmp_path / "main.c").write_text(main + "(torque(-50.0F, 100.0F) > 0.0F) ? 0 : 1; }\n")
    subprocess.run([GCC, *STRICT, "main.c", "-o", "main"], cwd=tmp_path, check=True)
    subprocess.run([tmp_path / "main"], check=True)


@pytest.mark.parametrize(
    ("name", "legal"),
    [("machine", "machine"), ("my-map 2", "my_map_2"), ("2024", "map_2024"), ("ψ", "map__")],
)
def test_file_names_become_identifiers(name, legal):
    assert identifier(name) == legal
