"""Conventions of scale: kA for A, duty for volts, rms for peak.

The voltage balance holds in any unit, so scales show in magnitudes alone, and a factor of sqrt(2)
only against phase channels recorded beside, or against a name plate. Against the
time constant L/R, which no unit of voltage or current changes, currents below an ampere look odd
in a large machine.
"""

import numpy as np

from penode.data.experiment import Experiment
from penode.pmsm.balance.trial_balance import FINE_DEGREE, TrialBalance, try_balance
from penode.pmsm.conventions.broken_convention import BrokenConvention
from penode.pmsm.machine.terms import MAGNETS, TEMPERATURE
from penode.pmsm.recording.name_plate import NamePlate

#: Currents in A below which they may be kA, in a machine of this L/R in s or more.
_SMALL_CURRENT, _LARGE_MACHINE = 2.0, 6e-3
#: Currents and voltages, A and V, that no drive has.
_MOST_CURRENT, _MOST_VOLTAGE = 2e4, 2e4
#: Voltages below which they may be shares of the link (up to 2 / sqrt(3) of half of it), where the
#: largest current drops less than this in R, both in V.
_LARGEST_SHARE, _SMALL_DROP = 1.16, 0.1
#: Ratios this close to sqrt(2), or to 1, are taken as that; their geometric mean separates them.
_TOLERANCE, _TOLERANCE_OF_R = 0.13, 0.115
#: The same of a flux linkage that is sqrt(2) times that of the plate: heat only makes it less.
_TOLERANCE_ABOVE = 0.05
#: Ratio to the name plate, or its inverse, from which something is wrong with one of the two.
PLATE = 1.2
#: Deviation of R, as a share of it, up to which it is compared with the name plate.
_DETERMINED = 0.1

#: Temperatures in degC of windings and magnets of drives that run.
_COLDEST, _HOTTEST = -60.0, 350.0

_ROOT = 2.0**0.5
_NAMES = {"u": ("u_d", "u_q"), "i": ("i_d", "i_q")}
_WORDS = {"u": "voltages", "i": "currents"}


def judge_units(experiment: Experiment, trial: TrialBalance) -> tuple[BrokenConvention, ...]:
    """Find currents in kA and voltages that are shares of the dc link."""
    current = float(np.hypot(*experiment.stack(_NAMES["i"]).T).max())
    voltage = float(np.hypot(*experiment.stack(_NAMES["u"]).T).max())
    drop = abs(trial.resistance) * current
    constant = float(trial.inductance.mean()) / max(abs(trial.resistance), 1e-300)
    findings = []
    if voltage <= _LARGEST_SHARE and drop < _SMALL_DROP and voltage < current:
        findings.append(
            BrokenConvention(
                "duty for volts",
                experiment.name,
                _NAMES["u"],
                f"no voltage is above {voltage:.3g} V, and {current:.4g} A drop {drop:.2g} V in R, "
                "as if the voltages were shares of the dc link",
                'name its column as times = "..." of the voltages, or give u_base, what 1 is in V '
                '(unit = "kV" if they are kV, or "V" where the study file has "mV")',
            )
        )
    elif current < _SMALL_CURRENT and constant > _LARGE_MACHINE:
        findings.append(
            BrokenConvention(
                "kA for A",
                experiment.name,
                _NAMES["i"],
                f"no current is above {current:.3g} A in a machine whose L/R of "
                f"{1e3 * constant:.3g} ms and R of {abs(trial.resistance):.3g} ohm are those of "
                f"{1e3 * current:.4g} A",
                'give i_d and i_q (or the phases) the unit of their columns: "kA", or "A" where '
                'the study file has "mA"',
            )
        )
    for kind, largest, most in (("i", current, _MOST_CURRENT), ("u", voltage, _MOST_VOLTAGE)):
        if largest > most:
            findings.append(_beyond(experiment, kind, largest))
    return tuple(findings)


def judge_temperatures(experiment: Experiment) -> tuple[BrokenConvention, ...]:
    """Find temperatures that no machine has: those of another unit."""
    findings = []
    for channel in (TEMPERATURE, MAGNETS):
        values = experiment.channels.get(channel.name, np.zeros(1))
        low, high = float(values.min()), float(values.max())
        if not (low >= _COLDEST and high <= _HOTTEST):
            findings.append(
                BrokenConvention(
                    "unit of a temperature",
                    experiment.name,
                    (channel.name,),
                    f"{channel.name} is {low:.4g} to {high:.4g} degC",
                    f'give {channel.name} the unit of its column, "degC", "K" or "degF"',
                )
            )
    return tuple(findings)


def _beyond(experiment: Experiment, kind: str, largest: float) -> BrokenConvention:
    """Return values that are larger than those of any drive."""
    names, unit = _NAMES[kind], {"i": "A", "u": "V"}[kind]
    return BrokenConvention(
        f"{_WORDS[kind]} beyond any drive",
        experiment.name,
        names,
        f"{_WORDS[kind]} reach {largest:.4g} {unit}",
        f"give {' and '.join(names)} (or the phases) the unit of their columns, such as "
        f'"{unit}" where the study file has "k{unit}"',
    )


def judge_rms_by_phases(experiment: Experiment) -> tuple[BrokenConvention, ...]:
    """Find dq channels in rms where phase channels were recorded beside them."""
    findings = []
    for kind in "ui":
        phases = [f"{kind}_{phase}" for phase in "abc"]
        if not all(name in experiment.channels for name in (*phases, *_NAMES[kind])):
            continue
        three = experiment.stack(phases)
        three = three - three.mean(axis=1, keepdims=True)
        dq = experiment.stack(_NAMES[kind])
        ratio = float(np.sqrt(np.sum(dq**2) / max(2.0 / 3.0 * np.sum(three**2), 1e-300)))
        if abs(ratio * _ROOT - 1.0) < _TOLERANCE:
            evidence = f"the dq {_WORDS[kind]} are {ratio:.3f} times as long as those of the phases"
            findings.append(_rms(experiment, kind, evidence))
    return tuple(findings)


def judge_rms_by_plate(experiment: Experiment, plate: NamePlate) -> tuple[BrokenConvention, ...]:
    """Find voltages or currents in rms, or peak values taken for rms, against a name plate.

    Voltages in rms make the magnet's flux linkage and R 0.71 times as large, currents in rms
    make R 1.41 times as large, as does copper that is 104 K warmer.
    """
    if plate.magnet_flux_linkage is None:
        return ()
    findings = []
    trial, fine = try_balance(experiment), try_balance(experiment, degree=FINE_DEGREE)
    flux = float(np.hypot(*trial.magnet)) / plate.magnet_flux_linkage
    wrong = ((1 / _ROOT, _TOLERANCE), (_ROOT, _TOLERANCE_ABOVE))
    volts = next((f for f, tolerance in wrong if abs(flux / f - 1.0) < tolerance), 1.0)
    if volts != 1.0:
        evidence = f"the magnet's flux linkage is {flux:.2f} times that of the name plate"
        findings.append(_rms(experiment, "u", evidence, missing=volts < 1.0))
    if plate.resistance is not None and fine.deviation < _DETERMINED * fine.resistance:
        ratio = fine.resistance / plate.resistance
        for amperes in (_ROOT, 1 / _ROOT):
            if abs(ratio / (volts * amperes) - 1.0) < _TOLERANCE_OF_R:
                evidence = f"R is {ratio:.2f} times that of the name plate"
                if volts != 1.0:
                    evidence += f", and {volts:.2f} times where the voltages alone are wrong"
                findings.append(_rms(experiment, "i", evidence, missing=amperes > 1.0))
    return tuple(findings)


def beside_plate(experiment: Experiment, plate: NamePlate) -> str:
    """Return what of a recording is far from a name plate, as a sentence; nothing where none is."""
    if plate.magnet_flux_linkage is None and plate.resistance is None:
        return ""
    trial, ratios = try_balance(experiment, degree=FINE_DEGREE), dict[str, float]()
    if plate.resistance is not None and trial.deviation < _DETERMINED * trial.resistance:
        ratios["R"] = trial.resistance / plate.resistance
    if plate.magnet_flux_linkage is not None:
        flux = float(np.hypot(*trial.magnet))
        ratios["the magnet's flux linkage"] = flux / plate.magnet_flux_linkage
    far = [
        f"{name} is {ratio:.2f} times"
        for name, ratio in ratios.items()
        if not 1.0 / PLATE < ratio < PLATE
    ]
    if not far:
        return ""
    return (
        f"{experiment.place.recording}: {' and '.join(far)} that of the name plate; check the "
        "plate and the scales of the channels."
    )


def _rms(
    experiment: Experiment, kind: str, evidence: str, missing: bool = True
) -> BrokenConvention:
    """Return rms values taken for peak values; where `missing` is false the other way round."""
    names = _NAMES[kind]
    fix, taken = f"give {' and '.join(names)} rms = true", "rms for peak"
    if not missing:
        fix = (
            f"remove rms = true from {' and '.join(names)} where the study file has it; else "
            "correct the name plate, whose flux linkage is a peak value and R that of one phase"
        )
        taken = "peak for rms"
    return BrokenConvention(f"{taken} ({_WORDS[kind]})", experiment.name, names, evidence, fix)
