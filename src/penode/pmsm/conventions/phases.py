"""Conventions of phase quantities: whose angle they belong to, and their order.

Seen from the electrical angle phase quantities change slowly; seen from any other, or with two
phases exchanged, they spin.
"""

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.pmsm.balance.trial_balance import try_balance
from penode.pmsm.conventions.broken_convention import BrokenConvention, Judged, with_channels
from penode.pmsm.conventions.motion import MOST_POLE_PAIRS
from penode.pmsm.machine.frames import dq_from_abc
from penode.pmsm.machine.standstill import TURN, stands_still

#: How much slower phase quantities change with another angle or order before that one is believed.
_SLOWER = 1.2
#: Share of an electrical turn between the samples that are compared.
_STRIDE = 0.02
#: Largest value of one phase over that of another from which their units differ.
_UNEVEN = 50.0


def find_uneven_phases(experiment: Experiment) -> BrokenConvention | None:
    """Find a phase whose values are far smaller than those of another while the rotor turns."""
    if not _turns(experiment):
        return None
    for kind, unit in (("i", "A"), ("u", "V")):
        names = [n for n in (f"{kind}_{p}" for p in "abc") if n in experiment.channels]
        sizes = {name: float(np.abs(experiment.channels[name]).max()) for name in names}
        small, large = (pick(sizes, key=lambda n: sizes[n], default="") for pick in (min, max))
        if small and sizes[large] > _UNEVEN * sizes[small]:
            return BrokenConvention(
                "different units of phases",
                experiment.name,
                tuple(names),
                f"{small} reaches {sizes[small]:.4g} {unit} where {large} reaches "
                f"{sizes[large]:.4g} {unit}",
                f"give {small} and {large} the units of their columns, and check their sensors",
            )
    return None


def _turns(experiment: Experiment) -> bool:
    """Whether the rotor turns, by its speed or its angle."""
    if "omega_el" in experiment.channels:
        return not stands_still([experiment])
    angle = experiment.channels.get("theta_el", np.zeros(1))
    return bool(np.ptp(angle) > TURN)


def judge_turns(experiment: Experiment, kinds: str) -> Judged:
    """Find an angle of the shaft where phase quantities are steady only in multiples of it.

    `kinds` says which of u and i are in phases; the recording comes with the electrical angle.
    """
    theta = np.unwrap(experiment.channels["theta_el"])
    counts = [sign * k for k in range(1, MOST_POLE_PAIRS + 1) for sign in (1, -1)]
    spins = {k: sum(_spin(experiment, kind, k * theta) for kind in kinds) for k in counts}
    best = min(spins, key=lambda k: spins[k])
    if abs(best) == 1 or spins[best] * _SLOWER > min(spins[1], spins[-1]):
        return None, experiment
    pairs = abs(best)
    finding = BrokenConvention(
        "mechanical angle for electrical",
        experiment.name,
        ("theta_el",),
        f"phase quantities are steady when seen from {pairs} times the angle, as with {pairs} pole "
        "pairs",
        f"give theta_el mechanical = true, and pole_pairs = {pairs}",
    )
    return finding, with_channels(experiment, {"theta_el": pairs * theta})


def judge_phases(experiment: Experiment, kinds: str) -> Judged:
    """Find two phases exchanged, in currents, in voltages, or in both, and put them in order.

    `kinds` says which of u and i are in phases. Which two were exchanged the voltage balance
    shows.
    """
    slower = {kind: _spins_backwards(experiment, kind) for kind in kinds}
    swapped = "".join(kind for kind, ratio in slower.items() if ratio is not None)
    if not swapped:
        return None, experiment
    named = {"u": "voltages", "i": "currents"}
    what = " and ".join(named[kind] for kind in swapped)
    evidence = " and ".join(
        f"the {named[kind]} turn against the angle ({slower[kind]:.3g} times slower in dq with two "
        "exchanged)"
        for kind in swapped
    )
    orders = {pair: _exchanged(experiment, swapped, pair) for pair in ("bc", "ab", "ac")}
    pair = min(orders, key=lambda p: _misfit_in_dq(orders[p], kinds))
    fix = f"exchange the columns of phases {pair[0]} and {pair[1]} of the {what}"
    betas = [f"{kind}_beta" for kind in swapped if f"{kind}_beta" in experiment.channels]
    if len(betas) == len(swapped):
        fix = f"give {' and '.join(betas)} sign = -1"
    if len(swapped) == 2:
        fix += ", or give theta_el and omega_el sign = -1 if it is they that count backwards"
    channels = tuple(f"{kind}_{phase}" for kind in swapped for phase in pair)
    finding = BrokenConvention("swapped phases", experiment.name, channels, evidence, fix)
    return finding, orders[pair]


def _exchanged(experiment: Experiment, kinds: str, pair: str) -> Experiment:
    one, other = pair[0], pair[1]
    names = {f"{kind}_{one}": f"{kind}_{other}" for kind in kinds}
    names |= {new: old for old, new in names.items()}
    return with_channels(experiment, {n: experiment.channels[old] for n, old in names.items()})


def _misfit_in_dq(experiment: Experiment, kinds: str) -> tuple[float, float]:
    """Return the misfit of a recording in phases, and the angle of its magnet beside the d axis."""
    theta = experiment.channels["theta_el"]
    axes = {}
    for kind in kinds:
        three = experiment.stack([f"{kind}_{phase}" for phase in "abc"])
        axes[f"{kind}_d"], axes[f"{kind}_q"] = dq_from_abc(three, theta).T
    if "omega_el" not in experiment.channels:
        axes["omega_el"] = np.gradient(np.unwrap(theta), experiment.time_step)
    trial = try_balance(with_channels(experiment, axes))
    aside = abs(float(np.arctan2(trial.magnet[1], trial.magnet[0])))
    return float(f"{trial.misfit:.3g}"), aside


def _spins_backwards(experiment: Experiment, kind: str) -> float | None:
    """Return how many times slower it changes seen from the angle turned round, if it does."""
    theta = np.unwrap(experiment.channels["theta_el"])
    ratio = _spin(experiment, kind, theta) / max(_spin(experiment, kind, -theta), 1e-300)
    return ratio if ratio > _SLOWER else None


def _spin(experiment: Experiment, kind: str, theta: FloatArray) -> float:
    """Return the mean square change of a phase quantity, seen from an angle, over its square."""
    dq = dq_from_abc(experiment.stack([f"{kind}_{phase}" for phase in "abc"]), theta)
    turn = float(np.median(np.abs(np.diff(np.unwrap(experiment.channels["theta_el"])))))
    stride = int(np.clip(2 * np.pi * _STRIDE / max(turn, 1e-9), 1, max(len(dq) // 8, 1)))
    change = dq[stride:] - dq[:-stride]
    return float(np.sum(change**2) / max(np.sum(dq**2), 1e-300))
