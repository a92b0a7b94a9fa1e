"""Draw two real machines: python docs/figures/make_real_machines.py POINTS FOLDER.

POINTS is ``psm_2500rpm_30C.csv``, 29 operating points of a traction machine (rkeller98/Research);
FOLDER holds the three recordings of a reluctance machine that `validate.standstill` names.
"""

import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from penode import Fit
from penode.pmsm import identify_points, load_study

INK, BLUE, RED = "#222831", "#1768ac", "#c8553d"
HERE = Path(__file__).parent
#: The bench's own value of the traction machine's R in mohm, a constant and no calibration.
BENCH = 9.69


def draw_resistances(axes, fits) -> None:
    """Draw R with its interval for each of what was in the model."""
    axes.axvline(0, color="0.8", lw=0.8)
    axes.axvline(BENCH, color=INK, lw=1, ls="--", label="the bench's own value")
    for row, fit in enumerate(fits.values()):
        estimate = fit.parameters["R"]
        low, high = (1e3 * end for end in estimate.interval_95)
        colour = BLUE if fit.horizon.answered else RED
        axes.plot([low, high], [row, row], color=colour, lw=2)
        axes.plot(1e3 * estimate.value, row, "o", color=colour)
    axes.set_yticks(range(len(fits)), list(fits))
    axes.invert_yaxis()
    axes.set_xlabel("R (mΩ), 95 % interval")
    axes.set_title("Without the inverter R is below zero", loc="left", fontsize=10)
    axes.legend(frameon=False, fontsize=9, loc="lower left")


def draw_points(axes, fit) -> None:
    """Draw what all other points predict of each point, less what was measured."""
    points = fit.stationary
    for k, colour in enumerate((BLUE, RED, INK)):
        gap = (points.without - points.measured)[:, k] / (1.96 * points.deviation[:, k])
        label = f"{points.quantities[k]}, {np.mean(np.abs(gap) < 1):.0%}"
        axes.plot(np.arange(len(gap)) + 0.2 * (k - 1), gap, "o", ms=3.5, color=colour, label=label)
    axes.axhspan(-1, 1, color=BLUE, alpha=0.12, lw=0)
    axes.set(xlabel="operating point", ylabel="error over its 95 % band", ylim=(-2.6, 2.6))
    axes.set_title("Each point, predicted by all others", loc="left", fontsize=10)
    axes.legend(
        frameon=False, fontsize=8, ncols=3, columnspacing=1, handletextpad=0, loc="lower left"
    )


def draw_traction_machine(file: Path) -> None:
    """Draw the traction machine's points."""
    asked = load_study(None, {"pole_pairs": 3})
    points = asked.load_points(file)
    voltages = {name: one for name, one in points.channels.items() if name != "torque"}
    silent = replace(points, channels=voltages)
    bare = replace(asked.study, candidates=())
    fits = {
        "nothing beside R": identify_points(silent, bare),
        "the same with torque": identify_points(points, bare),
        "inverter": identify_points(silent, asked.study),
        "inverter and torque": identify_points(points, asked.study),
    }
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
    draw_resistances(left, fits)
    draw_points(right, fits["inverter and torque"])
    figure.savefig(HERE / "real_points.png", dpi=130)


def draw_reluctance_machine(folder: Path) -> None:
    """Draw the reluctance machine's flux linkages beside those that its authors integrated."""
    files = [folder / f"{name}.csv" for name in ("UD110Q200_1000", "UD130_500", "UQ100_500")]
    with tempfile.TemporaryDirectory() as temporary:
        study, out = Path(temporary) / "study.toml", Path(temporary) / "result"
        subprocess.run(["penode", "init", files[0], "--standstill", "--out", study], check=True)
        subprocess.run(["penode", "identify", *files, "--config", study, "--out", out], check=True)
        fit = Fit.load(out)
    figure, axes = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
    for axis, file, own, other in zip(axes, files[1:], "dq", "qd", strict=True):
        log = np.genfromtxt(file, delimiter=",", names=True)
        current, linkage = log[f"I{own}"], log[f"Psi_{own}"]
        grid = np.linspace(current.min(), current.max(), 200)
        at = {f"i_{own}": grid, f"i_{other}": np.full(200, float(np.median(log[f"I{other}"])))}
        psi = fit.flux_map(at["i_d"], at["i_q"])["dq".index(own)]
        band = (
            1.96 * fit.learned_deviation(np.stack([at["i_d"], at["i_q"]], -1))[:, "dq".index(own)]
        )
        shift = np.mean(np.interp(current, grid, psi) - linkage)
        axis.plot(current, linkage + shift, color="0.6", lw=0.8, label="integrated by its authors")
        axis.plot(grid, psi, color=BLUE, label="identified, from all three files")
        axis.fill_between(grid, psi - band, psi + band, color=BLUE, alpha=0.2, lw=0)
        axis.set(xlabel=f"i_{own} (A)", ylabel=f"psi_{own} (Vs)")
        axis.set_title(f"Voltage along {own} alone", loc="left", fontsize=10)
    axes[0].legend(frameon=False, fontsize=9)
    figure.savefig(HERE / "real_reluctance.png", dpi=130)
    print(fit.parameters["R"].interval_95)


if __name__ == "__main__":
    draw_traction_machine(Path(sys.argv[1]))
    draw_reluctance_machine(Path(sys.argv[2]))
