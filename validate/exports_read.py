"""Exports read back by code that is not penode's: ``python -m validate.exports_read RESULT``.

RESULT is a folder that ``penode identify`` or ``penode demo`` wrote. Octave loads the MATLAB files
and looks psi(i), i(psi) and T up by its own ``interp2``, the header is compiled by gcc,
motulator's ``MagneticModel`` interpolates its archive, openpyxl reads the workbook for SciPy to
interpolate, onnxruntime runs the graph. Printed is the
largest difference to the fit where the file says supported: at points of the table, where it
belongs to the file, and over the cells, where it is that of linear interpolation. Programs that
are not installed are left out by name.
"""

import importlib
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from penode.arrays import FloatArray
from penode.fit.fit import Fit
from penode.pmsm import export

_OCTAVE = """
{load};
at = dlmread('at.txt');
psi = [interp2(iqVec, idVec, fluxD, at(:,2), at(:,1)), ...
       interp2(iqVec, idVec, fluxQ, at(:,2), at(:,1))];
dlmwrite('psi.txt', psi, 'precision', 17, 'delimiter', ' ');
of = dlmread('of.txt');
i = [interp2(fluxQVec, fluxDVec, idOfFlux, of(:,2), of(:,1)), ...
     interp2(fluxQVec, fluxDVec, iqOfFlux, of(:,2), of(:,1))];
dlmwrite('i.txt', i, 'precision', 17, 'delimiter', ' ');
"""
_SYRE = """
load map.mat;
at = dlmread('at.txt');
psi = [interp2(Id, Iq, Fd, at(:,1), at(:,2)), interp2(Id, Iq, Fq, at(:,1), at(:,2))];
dlmwrite('psi.txt', psi, 'precision', 17, 'delimiter', ' ');
"""
_MOTORCAD = """
load map.mat;
at = dlmread('at.txt');
id = Id_Peak(:,1);
iq = Iq_Peak(1,:);
psi = [interp2(iq, id, Flux_Linkage_D, at(:,2), at(:,1)), ...
       interp2(iq, id, Flux_Linkage_Q, at(:,2), at(:,1))];
dlmwrite('psi.txt', psi, 'precision', 17, 'delimiter', ' ');
"""
_C = """
#include <stdio.h>
#include "map.h"
int main(void)
{
    float at[2];
    while (fread(at, sizeof(float), 2U, stdin) == 2U)
    {
        const map_flux_t psi = map_flux(at[0], at[1]);
        (void)fwrite(&psi, sizeof(float), 2U, stdout);
    }
    return 0;
}
"""


def _octave(fit: Fit, folder: Path, to: str) -> Callable[[FloatArray], FloatArray]:
    suffix = ".m" if to == "m" else ".mat"
    export(fit, to, folder / f"map{suffix}", points=41)
    load = "map" if to == "m" else "load map.mat"
    text = {"syre": _SYRE, "motorcad": _MOTORCAD}.get(to, _OCTAVE.format(load=load))

    def run(at: FloatArray) -> FloatArray:
        np.savetxt(folder / "at.txt", at, fmt="%.17g")
        np.savetxt(folder / "of.txt", fit.flux_map(*at.T).T, fmt="%.17g")
        (folder / "asked.m").write_text(text)
        subprocess.run(
            ["octave-cli", "-q", "--norc", "asked.m"], cwd=folder, check=True, capture_output=True
        )
        return np.loadtxt(folder / "psi.txt")

    return run


def _compiled(fit: Fit, folder: Path, to: str) -> Callable[[FloatArray], FloatArray]:
    export(fit, to, folder / "map.h", points=41)
    (folder / "main.c").write_text(_C)
    subprocess.run(["gcc", "-std=c99", "-O2", "main.c", "-o", "main"], cwd=folder, check=True)

    def run(at: FloatArray) -> FloatArray:
        content = at.astype(np.float32).tobytes()
        done = subprocess.run([folder / "main"], input=content, capture_output=True, check=True)
        return np.frombuffer(done.stdout, np.float32).reshape(-1, 2).astype(float)

    return run


def _motulator(fit: Fit, folder: Path, to: str) -> Callable[[FloatArray], FloatArray]:
    model = importlib.import_module("motulator.drive.utils._sm_flux_maps").MagneticModel
    export(fit, to, folder / "map.npz", points=41)
    with np.load(folder / "map.npz") as file:
        made = model(i_s_dq=file["i_s_dq"], psi_s_dq=file["psi_s_dq"])

    def run(at: FloatArray) -> FloatArray:
        psi = made(at[:, 0] + 1j * at[:, 1])
        return np.stack([psi.real, psi.imag], axis=1)

    return run


def _openpyxl(fit: Fit, folder: Path, to: str) -> Callable[[FloatArray], FloatArray]:
    load = importlib.import_module("openpyxl").load_workbook
    export(fit, to, folder / "map.xlsx", points=41)
    book = load(folder / "map.xlsx", read_only=True)
    tables = [
        np.array([row[:] for row in book[name].iter_rows(values_only=True)][1:], float)
        for name in ("psi_d in Vs", "psi_q in Vs")
    ]
    i_q = next(book["psi_d in Vs"].iter_rows(values_only=True))[1:]
    axes = tables[0][:, 0], np.array(i_q, float)
    # The cells have 16 digits: a point of the edge may lie beyond it by rounding.
    kept = {"bounds_error": False, "fill_value": None}
    made = [RegularGridInterpolator(axes, table[:, 1:], **kept) for table in tables]

    def run(at: FloatArray) -> FloatArray:
        return np.stack([one(at) for one in made], axis=1)

    return run


def _onnx(fit: Fit, folder: Path, to: str) -> Callable[[FloatArray], FloatArray]:
    session = importlib.import_module("onnxruntime").InferenceSession
    export(fit, to, folder / "map.onnx")
    made = session(folder / "map.onnx")

    def run(at: FloatArray) -> FloatArray:
        return np.asarray(made.run(["flux_linkage"], {"currents": at.astype(np.float32)})[0])

    return run


_READERS = (
    ("mat", "octave-cli", _octave),
    ("m", "octave-cli", _octave),
    ("syre", "octave-cli", _octave),
    ("motorcad", "octave-cli", _octave),
    ("c", "gcc", _compiled),
    ("npz", "motulator", _motulator),
    ("xlsx", "openpyxl", _openpyxl),
    ("onnx", "onnxruntime", _onnx),
)


def rows(fit: Fit) -> Iterator[str]:
    """Yield a line a format and reader."""
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as made:
        grid = export(fit, "npz", Path(made) / "grid.npz", points=41)
    points = grid.mesh[:, grid.supported].T
    between = rng.uniform(points.min(0), points.max(0), (4000, 2))
    between = between[fit.supported(between)]
    for to, reader, make in _READERS:
        with tempfile.TemporaryDirectory() as made:
            if shutil.which(reader) is None and reader in ("gcc", "octave-cli"):
                yield f"{to:8s} {reader}: not installed"
                continue
            try:
                run = make(fit, Path(made), to)
            except ImportError as error:
                yield f"{to:8s} {reader}: not installed ({error})"
                continue
            ends = [np.abs(run(at) - fit.flux_map(*at.T).T).max() for at in (between, points)]
            largest = np.abs(fit.flux_map(*points.T)).max()
            line = (
                f"{to:8s} {reader:11s} psi at points {ends[1] / largest:.1e}, over cells "
                f"{ends[0] / largest:.1e} of the largest"
            )
            if (Path(made) / "i.txt").exists():
                off = np.abs(np.loadtxt(Path(made) / "i.txt") - points).max()
                line += f"; i(psi) within {off:.2g} A over cells"
            yield line


def main() -> None:
    """Print the table."""
    if len(sys.argv) != 2:
        raise SystemExit("usage: python -m validate.exports_read RESULT")
    for line in rows(Fit.load(sys.argv[1])):
        print(line)


if __name__ == "__main__":
    main()
