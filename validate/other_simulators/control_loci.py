"""MTPA and MTPV of a saturated machine beside those that motulator computes.

``python -m validate.other_simulators.control_loci`` runs where penode and motulator are installed
together, on Python 3.12 or later. The machine is a closed form with saturation and
cross-saturation, given to both as the flux linkage over the current; motulator finds the angle at
which the condition of an extremum holds, penode the most torque on closed curves. Printed are the
largest differences of the currents and of the torque.
"""

from importlib.metadata import version

import numpy as np
from motulator.drive.utils._parameters import SaturatedSynchronousMachinePars
from motulator.drive.utils._sm_control_loci import ControlLoci

from penode.arrays import FloatArray
from penode.pmsm.control.controlled_machine import ControlledMachine
from penode.pmsm.control.loci import mtpa, mtpv
from penode.pmsm.control.operating_points import operating_points

PAIRS, AMPS = 4, 450.0
FLUXES = np.linspace(0.012, 0.04, 15)


def flux_map(i_d: FloatArray, i_q: FloatArray) -> FloatArray:
    """Return psi (2, ...) in Vs at currents in A."""
    psi_d = 0.05 + 150e-6 * i_d + 0.012 * np.tanh((i_d + 150) / 180) - 4e-8 * i_q**2
    psi_q = 140e-6 * i_q + 0.036 * np.tanh(i_q / 130) - 8e-8 * i_d * i_q
    return np.stack([psi_d, psi_q])


def inductance(i_d: FloatArray, i_q: FloatArray) -> FloatArray:
    """Return the slope of `flux_map`, (2, 2, ...), in H."""
    l_dd = 150e-6 + 0.012 / 180 / np.cosh((i_d + 150) / 180) ** 2 + 0 * i_q
    l_qq = 140e-6 + 0.036 / 130 / np.cosh(i_q / 130) ** 2 - 8e-8 * i_d
    l_dq = -8e-8 * i_q + 0 * i_d
    return np.stack([np.stack([l_dd, l_dq]), np.stack([l_dq, l_qq])])


def complex_flux(current: complex) -> complex:
    """Return the flux linkage as motulator asks for it."""
    psi_d, psi_q = flux_map(np.real(current), np.imag(current))
    return psi_d + 1j * psi_q


def main() -> None:
    """Compute the loci by both and print the differences."""
    machine = ControlledMachine(flux_map, inductance, PAIRS)
    others = ControlLoci(SaturatedSynchronousMachinePars(PAIRS, 0.0, psi_s_dq_fcn=complex_flux))
    locus = others.compute_mtpa_locus(AMPS, 31)
    current = np.stack([locus.i_s_dq.real, locus.i_s_dq.imag])[:, 1:]
    ours = mtpa(machine, np.hypot(*current))
    told("MTPA", ours.current, current, ours.torque, locus.tau_M[1:])
    turned = operating_points(machine, locus.tau_M[1:], np.zeros(1), 1.01 * AMPS).current[..., 0]
    told("MTPA of a torque", turned, current, machine.torque(turned), locus.tau_M[1:])
    found = np.array([others.compute_mtpv_flux_angle(float(flux))[1] for flux in FLUXES])
    at = np.stack([found.real, found.imag])
    slow = mtpv(machine, FLUXES, 2 * AMPS)
    told("MTPV", slow.current, at, slow.torque, machine.torque(at))
    print(f"motulator {version('motulator')}, numpy {np.__version__}")


def told(
    name: str, ours: FloatArray, theirs: FloatArray, torque: FloatArray, other: FloatArray
) -> None:
    """Print the largest differences of currents (2, point) and of torques (point,)."""
    apart = np.hypot(*(ours - theirs)).max()
    share = np.abs(torque / other - 1).max()
    reach = np.hypot(*theirs)
    print(
        f"{name}: {theirs.shape[1]} points from {reach.min():.1f} to {reach.max():.1f} A; currents "
        f"differ by at most {apart:.1e} A, {apart / reach.max():.1e} of the largest; torque by at "
        f"most {share:.1e} of itself"
    )


if __name__ == "__main__":
    main()
