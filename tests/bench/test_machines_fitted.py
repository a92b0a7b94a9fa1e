"""The fitted machines against the maps they were fitted to, which are not part of the project."""

import os
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.io import loadmat

from penode.arrays import float64
from penode.bench.coenergy_table import tabulate
from penode.bench.fitted_coenergies import BRUSA_ANGLE_OFFSET, BRUSA_SKEW
from penode.bench.machines import BRUSA_250A, COMSOL_300A

MAPS = Path(os.environ.get("PENODE_DATA", "../shared/data")) / "flux_maps"


def source(*names):
    path = MAPS.joinpath(*names)
    if not path.is_file():
        pytest.skip(f"{path} is absent; set PENODE_DATA to the folder with the flux maps.")
    return path


def linkage(built, i_d, i_q, angles):
    """psi of the machine, (current, angle, 2)."""
    table, currents = tabulate(built), np.stack([i_d, i_q], axis=1)
    look_up = jax.jit(jax.vmap(jax.vmap(lambda i, a: table(i, a).linkage, (None, 0)), (0, None)))
    with float64():
        return np.asarray(look_up(jnp.asarray(currents), jnp.asarray(angles)))


def length_rms(error):
    return np.sqrt(np.mean((error**2).sum(axis=-1)))


def test_comsol_is_within_one_percent_at_every_angle_of_the_disc():
    table = np.load(source("comsol_ipm", "dq_angle_map_100A.npz"))
    i_d, i_q = np.meshgrid(3.0 * table["i_d"], 3.0 * table["i_q"], indexing="ij")
    psi = np.stack([table["psi_d"], table["psi_q"]], axis=-1).astype(float)
    inside = np.isfinite(psi).all(axis=(2, 3))
    error = linkage(COMSOL_300A, i_d[inside], i_q[inside], table["theta_el"]) - psi[inside]
    print(f"comsol_300A: {1e3 * length_rms(error):.3f} mVs rms of the vector")
    assert length_rms(error) < 0.003 * COMSOL_300A.magnet_flux_linkage
    # The harmonics are those of the source, not only small.
    wave = np.exp(-6j * table["theta_el"]) / 36
    left = np.abs(np.einsum("pac,a->pc", error, wave))
    there = np.abs(np.einsum("pac,a->pc", psi[inside], wave))
    assert np.sqrt(np.mean(left**2)) < 0.2 * np.sqrt(np.mean(there**2))


def test_comsol_torque_agrees_with_the_sources_own():
    table = np.load(source("comsol_ipm", "dq_angle_map_100A.npz"))
    i_d, i_q = np.meshgrid(3.0 * table["i_d"], 3.0 * table["i_q"], indexing="ij")
    known = 3.0 * table["torque"].mean(axis=2)
    inside = np.isfinite(known)
    psi = linkage(COMSOL_300A, i_d[inside], i_q[inside], table["theta_el"]).mean(axis=1)
    cross = 1.5 * 5 * (psi[:, 0] * i_q[inside] - psi[:, 1] * i_d[inside])
    assert np.sqrt(np.mean((cross - known[inside]) ** 2)) < 0.03 * np.abs(known[inside]).max()


def test_brusa_is_within_one_percent_in_its_own_frame():
    table = loadmat(source("brusa_hsm1_6_17_12", "lut.mat"), squeeze_me=True)
    i_d, i_q = np.meshgrid(table["i_d_vec"].astype(float), table["i_q_vec"].astype(float))
    turn = np.exp(1j * BRUSA_ANGLE_OFFSET)
    current = turn * (i_d + 1j * i_q).ravel()
    psi = turn * (table["Psi_d"] + 1j * table["Psi_q"]).ravel() - 1j * BRUSA_SKEW * current
    angles = np.linspace(0.0, np.pi / 3, 24, endpoint=False)
    mean = linkage(BRUSA_250A, current.real, current.imag, angles).mean(axis=1)
    error = mean - np.stack([psi.real, psi.imag], axis=1)
    print(f"brusa_250A: {1e3 * length_rms(error):.3f} mVs rms of the vector")
    assert length_rms(error) < 0.01 * BRUSA_250A.magnet_flux_linkage
