"""Time of a look-up in the exported C header: ``taskset -c 0 python -m benchmarks.c_lookup``.

The header is that of a smooth saturating map on 41 by 41 points, compiled by gcc with -O2. Currents
are random over the grid and known before the clock starts; their reading and the sum that keeps the
compiler from leaving the work out are in the time. A controller's processor is slower than this one
by its clock and its memory, which the figures cannot know.
"""

import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.problem import verdict
from penode.pmsm.exports.c_header import encode
from penode.pmsm.exports.control_tables import InverseMap
from penode.pmsm.machine.flux_grid import FluxGrid, even_axis

#: Goal for each look-up in ns.
GOAL = 100

PROGRAM = """
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "machine.h"

#define POINTS (4096U)
#define REPEATS (2000U)

static double now(void)
{
    struct timespec at;
    (void)clock_gettime(CLOCK_MONOTONIC, &at);
    return 1e9 * (double)at.tv_sec + (double)at.tv_nsec;
}

int main(void)
{
    static float d[POINTS];
    static float q[POINTS];
    float sum = 0.0F;
    for (unsigned k = 0U; k < POINTS; ++k)
    {
        d[k] = 600.0F * ((float)rand() / (float)RAND_MAX) - 300.0F;
        q[k] = 600.0F * ((float)rand() / (float)RAND_MAX) - 300.0F;
    }
    const double began = now();
    for (unsigned n = 0U; n < REPEATS; ++n)
    {
        for (unsigned k = 0U; k < POINTS; ++k)
        {
            const machine_flux_t psi = machine_flux(d[k], q[k]);
            sum += psi.psi_d + psi.psi_q;
        }
    }
    const double between = now();
    for (unsigned n = 0U; n < REPEATS; ++n)
    {
        for (unsigned k = 0U; k < POINTS; ++k)
        {
            const machine_inductance_t l = machine_inductance(d[k], q[k]);
            sum += l.l_dd + l.l_dq + l.l_qd + l.l_qq;
        }
    }
    const double done = now();
    const double count = (double)POINTS * (double)REPEATS;
    (void)printf("%.9g %.9g %.9g\\n", (between - began) / count, (done - between) / count,
                 (double)sum);
    return 0;
}
"""


def saturating_grid() -> FluxGrid:
    """Return a table of 41 by 41 points within 300 A."""
    axis = even_axis(-300.0, 300.0, 41)
    i_d, i_q = np.meshgrid(axis, axis, indexing="ij")
    psi = np.stack([0.05 + 0.02 * np.tanh((i_d + 150) / 180), 0.05 * np.tanh(i_q / 150)])
    zero = np.zeros_like(i_d)
    l_dd, l_qq = (
        0.02 / 180 / np.cosh((i_d + 150) / 180) ** 2,
        0.05 / 150 / np.cosh(i_q / 150) ** 2,
    )
    inductance = np.array([[l_dd, zero], [zero, l_qq]])
    return FluxGrid(axis, axis, psi, inductance, np.ones(i_d.shape, dtype=bool), 0.01, 5)


def nanoseconds() -> tuple[float, float]:
    """Return the time in ns of one look-up of psi and of one of L."""
    grid = saturating_grid()
    unused = InverseMap(*np.linspace(-0.1, 0.1, 82).reshape(2, -1), grid.mesh, grid.supported)
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "machine.h").write_text(encode(grid, "machine", unused, None))
        (folder / "main.c").write_text(PROGRAM)
        command = ["gcc", "-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "main.c", "-o", "main"]
        subprocess.run(command, cwd=folder, check=True)
        done = subprocess.run([folder / "main"], capture_output=True, text=True, check=True)
    flux, inductance, _ = map(float, done.stdout.split())
    return flux, inductance


def main() -> None:
    if shutil.which("gcc") is None:
        print("gcc is not installed")
        return
    for name, time in zip(("psi(i)", "L(i)"), nanoseconds(), strict=True):
        print(f"{name:8s} {time:6.1f} ns a look-up, goal {GOAL} ns {verdict(time <= GOAL)}")


if __name__ == "__main__":
    main()
