"""Whether recordings are of one drive in one state: R, magnets, dead time, recording by recording.

One voltage balance of all recordings, with a map in common and, for each recording but the first,
what its R, its magnets' flux linkage and its dead time differ by. What the map's form cannot follow
is common to them and drops out of the differences.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from penode.data.experiment import Experiment
from penode.data.stretches import by_recording
from penode.pmsm.balance.trial_balance import FINE_DEGREE, trial_form, trial_window
from penode.pmsm.balance.voltage_balance import term_columns
from penode.pmsm.conventions.broken_convention import BrokenConvention
from penode.pmsm.machine.space_vectors import CURRENTS
from penode.pmsm.machine.standstill import stands_still
from penode.pmsm.machine.terms import SPEED, Term

#: Differences of R, the magnets' flux linkage and the dead time over their scale from which
#: recordings disagree: copper some 13 K, magnets some 10 K warmer. That of the dead time is the
#: larger one, or so much of the largest drop in R.
_MATTERS, _OF_A_DROP = (0.05, 0.01, 0.5), 0.1
#: Deviations that a difference is at least. Of 44 pairs of recordings of one machine at other
#: speeds, behind dead time, no R differed by more than 5, and no magnets by more than 0.13 %.
_SURE = 6.0
#: What a change by this much per K is: R of copper, the flux linkage of NdFeB (magnets).
_PER_KELVIN = (0.0039, -0.001)
#: K beyond which no machine warms or cools.
_HOTTEST = 200.0
#: Ratio of two speeds from which R may differ by losses that grow with the speed.
_OTHER_SPEED = 1.1
#: Recordings that are compared at most: of many, those next to the first.
_MOST = 12
#: Dead-time voltage of a phase over the mean that shows by the current's direction.
_OF_A_PHASE = np.pi / 4
#: The place of the dead time among what is compared.
_DEAD_TIME = 2
_LOGGED = (
    "log all voltages at one point, before the compensation of the dead time or behind it, or "
    "identify them one by one"
)
_REPAIR = (
    "identify them one by one, or, if their temperatures were recorded, give the channel and the "
    "term (docs/how-to/terms-and-temperature.md)"
)


@dataclass(frozen=True)
class _Difference:
    """What one quantity of a recording differs by from that of the first, and its size there."""

    value: float
    deviation: float
    size: float
    # What is large beside it.
    scale: float

    def matters(self, kind: int) -> bool:
        """Return whether it is larger than a balance can be wrong."""
        return abs(self.value) > max(_MATTERS[kind] * self.scale, _SURE * self.deviation)

    def kelvin(self, kind: int) -> float:
        """Return how much warmer the second would be."""
        return self.value / self.size / _PER_KELVIN[kind]


def disagreement_of(
    recordings: Sequence[Experiment], terms: Sequence[Term] = ()
) -> tuple[BrokenConvention, ...]:
    """Return for each recording that disagrees with the first what it does in, and why that may be.

    They are corrected; of a recording in stretches the longest is looked at. Nothing is
    compared where a term follows a temperature.
    """
    warm = any(channel.unit == "degC" for term in terms for channel in term.channels)
    longest = [max(stretches, key=len) for stretches in by_recording(recordings)][:_MOST]
    if warm or len(longest) < 2 or any(stands_still([one]) for one in longest):
        return ()
    first, *others = longest
    found = []
    for other, differences in zip(others, _differences(longest), strict=True):
        of_r, of_magnet, of_dead_time = (d.matters(kind) for kind, d in enumerate(differences))
        if of_magnet or (of_r and _same_speed(first, other)):
            found.append(_disagreement(first, other, differences))
        elif of_dead_time:
            found.append(_another_inverter(first, other, differences[_DEAD_TIME]))
    return tuple(found)


def _differences(recordings: Sequence[Experiment]) -> list[tuple[_Difference, ...]]:
    """Return what each recording differs by from the first, quantity by quantity."""
    form, count = trial_form(recordings, FINE_DEGREE), len(recordings) - 1
    columns = []
    for place, e in enumerate(recordings):
        _, by_parameter, by_psi = term_columns(e, form.terms)
        drops = np.stack([by_parameter[..., 0], by_psi[..., 0], by_parameter[..., 1]])
        columns.append([(0 * d, -d * (k == place)) for d in drops for k in range(1, count + 1)])
    equations = form.equations(recordings, trial_window, columns)
    solution = equations.solve()
    # First the differences, then R and the dead time, then the map.
    (resistance, dead_time), weights = solution[3 * count :][:2], solution[3 * count + 2 :]
    magnet = float((form.polynomial.basis(np.zeros((1, 2))) @ weights)[0, 0])
    sizes = float(resistance), magnet, float(dead_time)
    drop = _OF_A_DROP * abs(float(resistance)) * form.polynomial.current_scale
    found = []
    for place in range(count):
        values = [float(solution[kind * count + place]) for kind in range(3)]
        scales = (
            abs(sizes[0]),
            abs(magnet),
            max(drop, *map(abs, (dead_time, dead_time + values[2]))),
        )
        deviations = (equations.deviation(kind * count + place) for kind in range(3))
        rows = zip(values, deviations, sizes, scales, strict=True)
        found.append(tuple(_Difference(*map(float, row)) for row in rows))
    return found


def _same_speed(one: Experiment, other: Experiment) -> bool:
    speeds = [float(np.sqrt(np.mean(e.channels[SPEED.name] ** 2))) for e in (one, other)]
    return max(speeds) < _OTHER_SPEED * min(speeds)


def _another_inverter(
    first: Experiment, other: Experiment, dead_time: _Difference
) -> BrokenConvention:
    names = [one.place.recording for one in (first, other)]
    here, there = (_OF_A_PHASE * v for v in (dead_time.size + dead_time.value, dead_time.size))
    evidence = (
        f"its voltages have {here:.3g} ± {_OF_A_PHASE * dead_time.deviation:.2g} V of dead time "
        f"and those of {names[0]} {there:.3g} V, as if only one of them were compensated"
    )
    return BrokenConvention("recordings that disagree", names[1], ("u_d", "u_q"), evidence, _LOGGED)


def _disagreement(
    first: Experiment, other: Experiment, differences: tuple[_Difference, ...]
) -> BrokenConvention:
    names = [one.place.recording for one in (first, other)]
    of_r, of_magnet, _ = differences
    evidence = (
        f"R is {1e3 * (of_r.size + of_r.value):.4g} ± {1e3 * of_r.deviation:.2g} mΩ here and "
        f"{1e3 * of_r.size:.4g} mΩ in {names[0]}, the magnets' flux linkage "
        f"{1e3 * (of_magnet.size + of_magnet.value):.4g} ± {1e3 * of_magnet.deviation:.2g} mVs "
        f"and {1e3 * of_magnet.size:.4g} mVs, {_cause(differences)}"
    )
    return BrokenConvention(
        "recordings that disagree", names[1], (*CURRENTS, "u_d", "u_q"), evidence, _REPAIR
    )


def _cause(differences: tuple[_Difference, ...]) -> str:
    """Return what differences of R and of the magnets look like."""
    kelvin = {
        what: one.kelvin(kind)
        for kind, (what, one) in enumerate(zip(("copper", "magnets"), differences, strict=False))
        if one.matters(kind)
    }
    signs = {value > 0 for value in kelvin.values()}
    if len(signs) > 1 or max(map(abs, kelvin.values())) > _HOTTEST:
        return "which no temperature explains: another machine, or another unit or scale"
    warmer = "warmer" if True in signs else "colder"
    return "as of " + " and of ".join(
        f"{what} {abs(value):.0f} K {warmer}" for what, value in kelvin.items()
    )
