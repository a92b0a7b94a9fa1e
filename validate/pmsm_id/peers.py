"""Methods of others, from the log's columns and the name plate alone: no penode in them.

CasADi and jax-sysid need an environment of their own; see ``docs/validation/pmsm-id.md``. Both get
the 0.4 s around the end of the operating points, which their memory and time allow.
"""

from pathlib import Path
from typing import Any

import casadi as ca
import jax
import jax.numpy as jnp
import numpy as np
from jax_sysid.models import Model

from validate.pmsm_id.tasks import STILL

jax.config.update("jax_enable_x64", True)

Answer = dict[str, Any]
PERIOD = 1e-4
#: Monomials of the coenergy, even in i_q, and units of the layer of the network.
_MONOMIALS = [(a, b) for a in range(7) for b in range(0, 7, 2) if 0 < a + b <= 6]
_UNITS = 8


def rows_of(file: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return currents (time, 2) in A, voltages (time, 2) in V, speed (time,) in rad/s."""
    read = np.genfromtxt(file, delimiter=",", names=True)
    some = (read["t"] > STILL - 0.15) & (read["t"] < STILL + 0.25)
    columns = {name: read[name][some] for name in ("i_d", "i_q", "u_d", "u_q", "omega_el")}
    i, u = (np.stack([columns[f"{x}_{axis}"] for axis in "dq"], axis=-1) for x in "iu")
    return i, u, columns["omega_el"]


def scales_of(i: np.ndarray, told: dict[str, Any]) -> tuple[float, float]:
    """Return the largest current in A, and a flux linkage of the machine in Vs."""
    plate, largest = told["name_plate"], float(np.abs(i).max())
    return largest, max(abs(plate["psi_PM"]), plate["L_d"] * largest, plate["L_q"] * largest)


def collocation(file: Path, told: dict[str, Any], _folder: Path) -> Answer:
    """Answer by CasADi and IPOPT, a trapezoid of the voltage equation between samples.

    Unknown are the currents at all samples, R and a polynomial coenergy, even in i_q.
    """
    i, u, omega = rows_of(file)
    (largest, flux), plate = scales_of(i, told), told["name_plate"]
    x, c, r = ca.MX.sym("x", 2, len(i)), ca.MX.sym("c", len(_MONOMIALS)), ca.MX.sym("r")
    at, w = ca.MX.sym("at", 2), ca.MX.sym("w", len(_MONOMIALS))
    coenergy = sum(w[k] * at[0] ** a * at[1] ** b for k, (a, b) in enumerate(_MONOMIALS))
    psi = ca.Function("psi", [at, w], [ca.gradient(coenergy, at)])
    along = psi.map(len(i))(x, ca.repmat(c, 1, len(i)))
    turn, unit = PERIOD * omega[:-1], PERIOD * largest / flux
    half = (along[:, 1:] + along[:, :-1]) / 2
    turned = ca.vertcat(-half[1, :] * turn[None], half[0, :] * turn[None])
    drop = unit * plate["R"] * r * (x[:, 1:] + x[:, :-1]) / 2
    gaps = along[:, 1:] - along[:, :-1] - PERIOD / flux * u[:-1].T + drop + turned
    nlp = {
        "x": ca.veccat(c, r, x),
        "f": ca.sumsqr(x - (i / largest).T) / 2e-6,
        "g": ca.vec(gaps),
    }
    options = {
        "print_time": False,
        "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 100, "max_wall_time": 60.0},
    }
    solver = ca.nlpsol("solver", "ipopt", nlp, options)
    first = np.zeros(len(_MONOMIALS))
    for (a, b), value in (
        ((1, 0), plate["psi_PM"]),
        ((2, 0), plate["L_d"] * largest / 2),
        ((0, 2), plate["L_q"] * largest / 2),
    ):
        first[_MONOMIALS.index((a, b))] = value / flux
    begin = np.concatenate([first, [1.0], (i / largest).ravel()])
    found = np.asarray(solver(x0=begin, lbg=0, ubg=0)["x"]).ravel()
    if not solver.stats()["success"]:
        return {"refused": solver.stats()["return_status"]}
    currents = np.stack([told["currents"]["i_d"], told["currents"]["i_q"]]) / largest
    weights = found[: len(_MONOMIALS)]
    asked = np.asarray(
        psi.map(currents.shape[1])(currents, np.tile(weights[:, None], currents.shape[1]))
    )
    named = dict(zip(("psi_d", "psi_q"), (flux * asked).tolist(), strict=True))
    return {"R": float(plate["R"] * found[len(_MONOMIALS)])} | named


def by_jax_sysid(file: Path, told: dict[str, Any], _folder: Path) -> Answer:
    """Answer by jax-sysid: simulation error, a linear map beside a network, L-BFGS."""
    i, u, omega = rows_of(file)
    (largest, flux), plate = scales_of(i, told), told["name_plate"]
    inductance = np.array([plate["L_d"], plate["L_q"]]) * largest / flux
    magnet = np.array([plate["psi_PM"] / flux, 0.0])

    def psi(x, p):
        network = p[3] @ jnp.tanh(p[1] @ x + p[2])
        return magnet + inductance * (p[4] * x) + p[5] + 0.1 * network

    def rate(x, drive, p):
        value = psi(x, p)
        voltage = drive[:2] / flux - plate["R"] * largest / flux * p[0] * x
        turning = drive[2] * jnp.stack([-value[1], value[0]])
        return jnp.linalg.solve(jax.jacfwd(psi)(x, p), voltage - turning)

    def step(x, drive, p):
        k1 = rate(x, drive, p)
        k2 = rate(x + PERIOD / 2 * k1, drive, p)
        k3 = rate(x + PERIOD / 2 * k2, drive, p)
        k4 = rate(x + PERIOD * k3, drive, p)
        return x + PERIOD / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    random = np.random.default_rng(0)
    layers = random.normal(size=(_UNITS, 2)), random.normal(size=_UNITS)
    start = [np.array(1.0), *layers, np.zeros((2, _UNITS)), np.ones(2), np.zeros(2)]
    model = Model(2, 2, 3, state_fcn=step, y_in_x=True)
    model.init(params=start, x0=i[0] / largest)
    model.loss(rho_x0=0.0, rho_th=1e-8, train_x0=True)
    model.optimization(adam_epochs=0, lbfgs_epochs=300, iprint=-1)
    model.fit(i / largest, np.column_stack([u, omega]))
    currents = np.stack([told["currents"]["i_d"], told["currents"]["i_q"]], axis=-1) / largest
    asked = np.asarray(jax.vmap(psi, (0, None))(currents, model.params)).T
    if not np.isfinite(asked).all():
        return {"refused": "the search diverged."}
    named = dict(zip(("psi_d", "psi_q"), (flux * asked).tolist(), strict=True))
    return {"R": float(plate["R"] * model.params[0])} | named


METHODS = {"collocation": collocation, "jax-sysid": by_jax_sysid}
