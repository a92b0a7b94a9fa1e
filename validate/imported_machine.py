"""A flux map of a file, driven on the bench.

``python -m validate.imported_machine FILE R PAIRS AMPS``: a machine is made of the map in FILE
(CSV, npz or mat; one that covers one sign of i_q is mirrored) with R in ohm, driven through a disc
of AMPS at 1500 rpm, recorded for two seconds with noise of 0.05 A, and identified with default
settings. Printed are how well the bench's machine follows the file, the errors of R and of the map
over the excited region (rms over the rms flux, mean absolute over the largest), and how much of it
the band covers.
"""

import sys

import numpy as np

from penode.bench.coenergy_table import true_flux_map
from penode.bench.drive import Drive
from penode.bench.flux_table import read_flux_table
from penode.bench.map_import import ImportedMachine, import_machine
from penode.bench.references import Lissajous
from penode.bench.run import simulate
from penode.pmsm.study import identify
from validate.map_errors import error_and_coverage, rectangle

#: Of the sensors in A.
NOISE = 0.05
#: Of the current controller in rad/s: saturated inductances are a fraction of those at rest.
BANDWIDTH = 300.0


def imported_from(path: str, resistance: float, pairs: int) -> ImportedMachine:
    """Return the machine of a map; one that covers one sign of i_q is mirrored."""
    table = read_flux_table(path, pole_pairs=pairs)
    mirror = bool(np.min(table.i_q) * np.max(table.i_q) >= 0)
    return import_machine(path, resistance=resistance, pole_pairs=pairs, mirror=mirror)


def main(path: str, resistance: float, pairs: int, amplitude: float, duration: float = 2.0) -> None:
    """Import, record, identify and print."""
    imported = imported_from(path, resistance, pairs)
    machine, findings = imported.machine, imported.findings
    print(
        f"{machine.name}: L_d {1e3 * machine.inductance_d:.3g} mH, "
        f"L_q {1e3 * machine.inductance_q:.3g} mH, psi_PM {machine.magnet_flux_linkage:.3g} Vs; "
        f"the machine follows the file within {1e3 * findings.fit_error:.3g} mVs rms"
    )
    run = simulate(
        machine,
        Lissajous(amplitude, 14.0, 15.0),
        speed_rpm=1500.0,
        duration=duration,
        drive=Drive(current_noise=NOISE, bandwidth=BANDWIDTH),
        seed=1,
    )
    fit = identify([run])
    grid = rectangle(fit)
    inside = grid[fit.supported(grid)]
    psi = np.asarray(true_flux_map(machine, *inside.T)).reshape(len(inside), 2)
    gap = fit.flux_map(*inside.T).T - psi
    rms = np.sqrt(np.mean(gap**2) / np.mean(psi**2))
    mean, covered = error_and_coverage(fit, machine)
    estimate = fit.parameters["R"]
    low, high = (100 * (end / resistance - 1) for end in estimate.interval_95)
    print(
        f"R {100 * (estimate.value / resistance - 1):+.3f} % "
        f"(interval {low:+.2f} to {high:+.2f} %), map {100 * rms:.3f} % rms of the rms flux, "
        f"{100 * mean:.3f} % mean of the largest, "
        f"band covers {100 * covered:.1f} %; {fit.horizon.verdict}"
    )


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4]))
