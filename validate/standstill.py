"""A real reluctance machine at standstill: ``python -m validate.standstill FOLDER``.

FOLDER holds ``UD110Q200_1000.csv``, ``UD130_500.csv`` and ``UQ100_500.csv`` (KrisCCeng/SynRM-PINN,
data/processed/ExDataset1): hysteresis injection at 10 kHz along both axes, d and q, and the flux
linkage that its authors integrated from the same voltages and currents, no second measurement.

``penode init --standstill`` writes the study file, ``penode identify`` gets the files of each line
and nothing beside. Printed are exit status and verdict, R with its interval, delay and angle that
were found, the free run's root mean square error over all currents, and the mean absolute
difference of the map to the authors' flux linkage, less its mean, in d and q of each file. The last
line is plain least squares: the integrated balance of all files with a polynomial coenergy of
degree 10 that is even in both currents, at the delay that leaves least.
"""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from penode import Experiment
from penode.arrays import FloatArray
from penode.data.load import read
from penode.pmsm.balance.calibration_fit import calibration_of
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES
from penode.pmsm.machine.standstill import axes_at_rest
from penode.pmsm.study_file import load_study
from validate.command import identify, run

OUT = Path("out") / "validate" / "standstill"
FILES = ("UD110Q200_1000.csv", "UD130_500.csv", "UQ100_500.csv")
SETS = {"all three": FILES, "both axes": FILES[:1], "d alone": FILES[1:2], "q alone": FILES[2:]}
DEGREE, DELAYS = 10, np.arange(0.0, 4.01, 0.25)


def apart(found: FloatArray, authors: FloatArray) -> str:
    """Return the mean absolute difference of each axis (time, 2) that moves, Vs, in words."""
    gap = found - authors
    each = np.abs(gap - gap.mean(axis=0)).mean(axis=0)
    return " ".join(f"{e:.3f}" for e in each[np.ptp(authors, axis=0) > 0])


def linkage_of(path: Path) -> FloatArray:
    """Return the flux linkage that the authors integrated, (time, 2), Vs."""
    columns = read(path)[0].columns
    return np.stack([columns["Psi_d"], columns["Psi_q"]], axis=1)


def line_of(name: str, paths: Sequence[Path], study: Path) -> str:
    """Identify files by the command and return their line."""
    ended = identify(paths, OUT / name.replace(" ", "_"), "--config", study)
    if ended.result is None:
        return f"{name:13s} exit status {ended.status}: {ended.last_line}"
    fit, mapping = ended.fit(), load_study(study)
    recordings = [mapping.load(path) for path in paths]
    calibration = calibration_of(recordings)
    gaps = []
    for path, recording in zip(paths, recordings, strict=True):
        angle = 0.0 if axes_at_rest([recording]) else calibration["angle"].real
        ahead = np.exp(1j * angle)
        current = recording.stack(CURRENTS) @ [1.0, 1j] / ahead
        flux = np.array([1.0, 1j]) @ fit.flux_map(current.real, current.imag) * ahead
        gaps.append(apart(np.stack([flux.real, flux.imag], axis=1), linkage_of(path)))
    resistance = fit.parameters["R"]
    low, high = resistance.interval_95
    errors = np.concatenate([(c.measured - c.free_run).ravel() for c in fit.comparisons])
    return (
        f"{name:13s} {ended.status} {fit.horizon.verdict:12s} R {resistance.value:5.2f} "
        f"({low:.2f} to {high:.2f}) delay {calibration['delay'].real:.2f} "
        f"angle {np.rad2deg(calibration['angle'].real):5.2f} "
        f"free run {np.sqrt(np.mean(errors**2)):.3f} A, map {' | '.join(gaps)} Vs"
    )


def least_squares(
    recordings: Sequence[Experiment], delay: float
) -> tuple[float, float, list[FloatArray]]:
    """Return R, what is left (root mean square, Vs), and the map at the samples of each file."""
    reach = max(float(np.abs(e.stack(CURRENTS)).max()) for e in recordings)
    rows, targets, bases = [], [], []
    for place, e in enumerate(recordings):
        basis = np.concatenate(list(_even(e.stack(CURRENTS) / reach)), axis=2)
        start = np.zeros((len(e), 2, 2 * len(recordings)))
        start[:, [0, 1], [2 * place, 2 * place + 1]] = 1.0
        current = _integral(e.stack(CURRENTS), e.time_step)
        at = np.maximum(np.arange(len(e)) - delay, 0.0)
        held = np.vstack([np.zeros((1, 2)), np.cumsum(e.stack(VOLTAGES), axis=0) * e.time_step])
        voltage = [np.interp(at, np.arange(len(held)), one) for one in held.T]
        rows.append(np.concatenate([current[..., None], start, basis], axis=2))
        targets.append(np.stack(voltage, axis=1))
        bases.append(basis)
    matrix, target = (np.concatenate(p).reshape(-1, *p[0].shape[2:]) for p in (rows, targets))
    solution = np.linalg.lstsq(matrix, target, rcond=None)[0]
    count = bases[0].shape[2]
    left = float(np.sqrt(np.mean((target - matrix @ solution) ** 2)))
    return float(solution[0]), left, [basis @ solution[-count:] for basis in bases]


def _even(points: FloatArray) -> Iterator[FloatArray]:
    """Yield the gradient (time, 2, 1) of each even monomial of dimensionless currents (time, 2)."""
    x, y = points.T
    for m in range(0, DEGREE + 1, 2):
        for n in range(0, DEGREE + 1 - m, 2):
            if m + n:
                slopes = [m * x ** max(m - 1, 0) * y**n, n * x**m * y ** max(n - 1, 0)]
                yield np.stack(slopes, axis=1)[..., None]


def _integral(values: FloatArray, step: float) -> FloatArray:
    """Return the integral of values (time, 2) up to each sample."""
    mean = (values[1:] + values[:-1]) / 2
    return np.vstack([np.zeros((1, 2)), np.cumsum(mean, axis=0) * step])


def main(folder: Path) -> None:
    """Print a line for each set of files, and that of least squares."""
    study = OUT / "study.toml"
    study.parent.mkdir(parents=True, exist_ok=True)
    study.unlink(missing_ok=True)
    run("init", folder / FILES[0], "--standstill", "--out", study)
    for name, files in SETS.items():
        print(line_of(name, [folder / file for file in files], study), flush=True)
    mapping = load_study(study)
    recordings = [mapping.load(folder / file) for file in FILES]
    left, delay = min((least_squares(recordings, d)[1], d) for d in DELAYS)
    resistance, _, flux = least_squares(recordings, delay)
    pairs = zip(flux, FILES, strict=True)
    gaps = " | ".join(apart(f, linkage_of(folder / file)) for f, file in pairs)
    print(
        f"least squares                R {resistance:5.2f} delay {delay:.2f}, left {left:.4f} Vs, "
        f"map {gaps} Vs"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
