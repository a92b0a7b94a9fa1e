"""Fit the coenergies of the built-in machines to published flux maps and print them.

``python -m benchmarks.fit_machines`` re-derives `penode.bench.fitted_coenergies`. The maps are
read from PENODE_DATA or ../shared/data and are not part of the project.
"""

import os
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from scipy.io import loadmat
from scipy.optimize import minimize_scalar

# Powers (m, k) that may enter order n: the direction of the flux locks the harmonics to the slots,
# so order n needs about the n-th power of v.
HIGHEST_SQUARE = 3
RIDGE = 1e-9

# Inductance in H that is believed where the source has no points.
BELIEVED_INDUCTANCE = 150e-6


@dataclass(frozen=True)
class Source:
    """A published map: currents (point,) in A and the complex amplitude of each order of psi.

    ``psi = Re sum_n flux[n] exp(j n theta)``, flux[n] of shape (2, point) in Vs.
    """

    name: str
    i_d: np.ndarray
    i_q: np.ndarray
    flux: dict[int, np.ndarray]
    magnet_flux: float
    limit: float


@dataclass(frozen=True)
class Shape:
    """What is chosen by hand: I and i_f of `HarmonicCoenergy`, terms an order, weight of belief."""

    scale_current: float
    magnet_current: float
    counts: dict[int, int]
    belief: float = 0.02


def folder() -> Path:
    """Return where the maps are, or leave with a sentence."""
    found = Path(os.environ.get("PENODE_DATA", "../shared/data")) / "flux_maps"
    if not found.is_dir():
        sys.exit(f"{found}: no flux maps there; set PENODE_DATA to the folder that holds them.")
    return found


def comsol() -> Source:
    table = np.load(folder() / "comsol_ipm" / "dq_angle_map_100A.npz")
    i_d, i_q = np.meshgrid(3.0 * table["i_d"], 3.0 * table["i_q"], indexing="ij")
    psi = np.stack([table["psi_d"], table["psi_q"]]).astype(float)
    inside = np.isfinite(psi).all(axis=(0, 3))
    psi = psi[:, inside]
    flux = {
        n: (1 if n == 0 else 2) * np.mean(psi * np.exp(-1j * n * table["theta_el"]), axis=2)
        for n in (0, 6, 12, 18)
    }
    return Source("comsol_ipm", i_d[inside], i_q[inside], flux, 47.3e-3, 300.0)


def brusa(angle: float) -> Source:
    """Return the measured map, its frame turned by an angle in rad."""
    table = loadmat(folder() / "brusa_hsm1_6_17_12" / "lut.mat")
    i_d, i_q = np.meshgrid(table["i_d_vec"][0].astype(float), table["i_q_vec"][0].astype(float))
    turn = np.exp(1j * angle)
    current = turn * (i_d + 1j * i_q).ravel()
    flux = turn * (table["Psi_d"] + 1j * table["Psi_q"]).ravel()
    psi = np.stack([flux.real, flux.imag])
    return Source("brusa_hsm1", current.real, current.imag, {0: psi}, 70.8e-3, 250.0)


def ev400v() -> Source:
    table = pl.read_csv(folder() / "ev400v_femm" / "400V_60C_fea_map.csv")
    i_d, i_q, psi_d, psi_q = (
        table[name].to_numpy() for name in ("Id_Pk", "Iq_Pk", "psiD_Pk", "psiQ_Pk")
    )
    return Source("ev400v", i_d, i_q, {0: np.stack([psi_d, psi_q])}, 62.9e-3, 420.0)


def gradient(x: np.ndarray, y: np.ndarray, m: int, k: int) -> np.ndarray:
    """Return d/dx and d/dy of rho |v|^(2k) v^m with v = (x + jy)/rho, complex (2, point)."""
    z, square = x + 1j * y, x**2 + y**2
    half = (1 - m - 2 * k) / 2
    radial, radial_slope = (1 + square) ** half, 2 * half * (1 + square) ** (half - 1)
    power = square**k * z**m
    turn = np.array([[1.0], [1j]])
    along = np.stack([x, y])
    slope = (2 * k * square ** max(k - 1, 0) * z**m * along) + (
        m * square**k * z ** max(m - 1, 0) * turn
    )
    return radial_slope * along * power + radial * slope


def columns(i_d, i_q, shape: Shape, order: int, powers) -> np.ndarray:
    """Return psi of unit coefficients, real (2 point or 4 point, term)."""
    x, y = (i_d + shape.magnet_current) / shape.scale_current, i_q / shape.scale_current
    terms = np.stack([gradient(x, y, m, k).ravel() for m, k in powers], axis=1)
    return terms.real if order == 0 else np.concatenate([terms.real, terms.imag])


def greedy(matrix: np.ndarray, target: np.ndarray, count: int, forced: int) -> np.ndarray:
    """Return coefficients, all but `count` of them zero, by orthogonal matching pursuit."""
    chosen, energy = list(range(forced)), (matrix**2).sum(axis=0)
    damping = RIDGE * energy.max()
    while True:
        part = matrix[:, chosen]
        found = np.linalg.solve(part.T @ part + damping * np.eye(len(chosen)), part.T @ target)
        if len(chosen) == count + forced:
            break
        free = matrix - part @ np.linalg.lstsq(part, matrix, rcond=None)[0] if chosen else matrix
        left = (free**2).sum(axis=0)
        gain = (free.T @ (target - part @ found)) ** 2 / np.maximum(left, 1e-6 * energy)
        gain[chosen] = -1.0
        chosen.append(int(gain.argmax()))
    coefficients = np.zeros(matrix.shape[1])
    coefficients[chosen] = found
    return coefficients


def candidates(order: int) -> list[tuple[int, int]]:
    reach = order + 4 if order else 9
    return [(m, k) for m in range(reach) for k in range(HIGHEST_SQUARE) if m + 2 * k <= reach]


def leakage(i_d, i_q) -> np.ndarray:
    zero = np.zeros_like(i_d)
    return np.stack([np.concatenate([i_d, zero]), np.concatenate([zero, i_q])], axis=1)


def beliefs(source: Source, shape: Shape, powers) -> tuple[np.ndarray, np.ndarray]:
    """Return rows that pull L to the believed value outside the source's points."""
    nodes = np.linspace(-1.3 * source.limit, 1.3 * source.limit, 27)
    i_d, i_q = (axis.ravel() for axis in np.meshgrid(nodes, nodes))
    nearest = np.hypot(i_d[:, None] - source.i_d, i_q[:, None] - source.i_q).min(axis=1)
    outside = nearest > 0.05 * source.limit
    i_d, i_q = i_d[outside], i_q[outside]
    step, half = 1.0, len(i_d)

    def psi(d, q):
        return np.concatenate([leakage(d, q), columns(d, q, shape, 0, powers)], axis=1)

    by_d = (psi(i_d + step, i_q) - psi(i_d - step, i_q)) / (2 * step)
    by_q = (psi(i_d, i_q + step) - psi(i_d, i_q - step)) / (2 * step)
    rows = np.concatenate([by_d[:half], by_d[half:], by_q[half:]])
    wanted = BELIEVED_INDUCTANCE * np.concatenate([np.ones(half), np.zeros(half), np.ones(half)])
    weight = shape.belief * source.limit
    return weight * rows, weight * wanted


def fit_mean(source: Source, shape: Shape, skewed: bool):
    """Return leakages, terms, the skew part in H and the error of the mean map in Vs."""
    powers = candidates(0)
    target = source.flux[0].real.ravel()
    own = [leakage(source.i_d, source.i_q)]
    if skewed:
        own.append(np.concatenate([-source.i_q, source.i_d])[:, None])
    forced = sum(block.shape[1] for block in own)
    matrix = np.concatenate([*own, columns(source.i_d, source.i_q, shape, 0, powers)], axis=1)
    rows, wanted = beliefs(source, shape, powers)
    if skewed:
        rows = np.insert(rows, 2, 0.0, axis=1)
    unit = np.sqrt((matrix**2).mean(axis=0))
    found = (
        greedy(
            np.concatenate([matrix, rows]) / unit,
            np.concatenate([target, wanted]),
            shape.counts[0],
            forced,
        )
        / unit
    )
    error = matrix @ found - target
    terms = [(0, m, k, c) for (m, k), c in zip(powers, found[forced:], strict=True) if c]
    return found[:2], terms, found[2] if skewed else 0.0, error.reshape(2, -1)


def fit_order(source: Source, shape: Shape, order: int):
    """Return the terms of one harmonic and its error as complex amplitudes (2, point) in Vs."""
    powers = candidates(order)
    matrix = columns(source.i_d, source.i_q, shape, order, powers)
    flux = source.flux[order].ravel()
    unit = np.sqrt((matrix**2).mean(axis=0))
    target = np.concatenate([flux.real, flux.imag])
    found = greedy(matrix / unit, target, shape.counts[order], 0) / unit
    terms = [(order, m, k, c) for (m, k), c in zip(powers, found, strict=True) if c]
    real, imag = (matrix @ found - target).reshape(2, 2, -1)
    return terms, real + 1j * imag


def show(source: Source, shape: Shape, skewed: bool = False) -> float:
    """Fit one machine, print what goes into the library, return the rms error in Vs."""
    (leak_d, leak_q), terms, skew, error = fit_mean(source, shape, skewed)
    square = np.mean(error**2)
    parts = [f"mean {1e3 * np.sqrt(square):.4f}"]
    for order in source.flux:
        if order:
            more, wrong = fit_order(source, shape, order)
            part = np.mean(np.abs(wrong) ** 2) / 2
            of = np.mean(np.abs(source.flux[order]) ** 2) / 2
            parts.append(f"order {order} {1e3 * np.sqrt(part):.4f} of {1e3 * np.sqrt(of):.4f}")
            square, terms = square + part, terms + more
    rms = np.sqrt(square)
    share, vector = rms / source.magnet_flux, np.sqrt(2.0) * rms / source.magnet_flux
    print(f"{source.name}: rms {1e3 * rms:.3f} mVs = {share:.2%} of psi_PM a component,")
    print(f"  {vector:.2%} the vector; by order:")
    print(f"  {', '.join(parts)} mVs, largest of the mean {1e3 * np.abs(error).max():.3f} mVs")
    print(f"  skew part {1e6 * skew:.2f} uH, {len(terms) + 4} numbers")
    print(f"    scale_current={shape.scale_current}, magnet_current={shape.magnet_current},")
    print(f"    leakage_d={leak_d:.5g}, leakage_q={leak_q:.5g},")
    print('    terms=_terms("""')
    for order, m, k, c in terms:
        print(f"        {order} {m} {k} {c:.5g}")
    print('    """),')
    return float(rms)


def main() -> None:
    show(comsol(), Shape(200.0, 150.0, {0: 10, 6: 12, 12: 10, 18: 6}))
    shape = Shape(187.5, 100.0, {0: 20}, belief=0.005)

    def wrong(angle: float) -> float:
        return float(np.mean(fit_mean(brusa(angle), shape, True)[3] ** 2))

    angle = minimize_scalar(wrong, bounds=(0.0, 0.05), method="bounded").x
    print(f"brusa_hsm1: its frame is turned by {np.degrees(angle):.3f} degrees electrical")
    show(brusa(angle), shape, skewed=True)
    show(ev400v(), Shape(168.0, 210.0, {0: 20}))


if __name__ == "__main__":
    main()
