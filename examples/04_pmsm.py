"""A machine from a drive recording: resistance and flux-linkage map, and what unseen runs say.

    python examples/04_pmsm.py [FOLDER [SECONDS]]

The recording comes from the simulated bench: the paper's hard case, slow currents at high speed
with slotting harmonics that the identified map does not know.
"""

import sys

import numpy as np

import penode
from penode.bench import TRACTION_300A, Lissajous, simulate


def record(speed_rpm, duration):
    """Return a recording of the simulated drive."""
    reference = Lissajous(240.0, rate_d=14.0, rate_q=15.0)
    return simulate(TRACTION_300A, reference, speed_rpm=speed_rpm, duration=duration)


def identify(duration=2.0):
    """Return the fit of one recording, compared with a run at another speed."""
    poles = TRACTION_300A.pole_pairs
    train, unseen = record(1500.0, duration), record(900.0, duration / 2)
    return penode.pmsm.identify([train], pole_pairs=poles, validation=[unseen])


def main(out="out/pmsm", duration=2.0):
    """Print the answer and save the fit with its report."""
    fit = identify(float(duration))
    resistance = fit.parameters["R"]
    low, high = (1e3 * end for end in resistance.interval_95)
    print(f"R = {1e3 * resistance.value:.2f} mohm, 95 % interval {low:.2f} .. {high:.2f}")
    print(f"true R = {1e3 * TRACTION_300A.resistance:.2f} mohm")
    print(f"horizon {fit.horizon.selected} ({fit.horizon.verdict}): {fit.horizon.reason}")
    psi_d, psi_q = fit.flux_map(i_d=-100.0, i_q=np.array([0.0, 50.0, 100.0]))
    print("psi_d, psi_q at i_d = -100 A, i_q = 0, 50, 100 A:", psi_d, psi_q, "Vs")
    for comparison in fit.comparisons:
        print(f"{comparison.name} ({comparison.role}): free run {comparison.free_run_rmse:.2f} A")
    fit.save(out)


if __name__ == "__main__":
    main(*sys.argv[1:])
