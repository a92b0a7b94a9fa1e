"""How sure R can become, before any training: the weak form's, and the accuracy of the sensors."""

from collections.abc import Sequence

import numpy as np

from penode.data.experiment import Experiment
from penode.fit.outcome import Estimate
from penode.horizon.consensus import STATISTICS
from penode.horizon.uncertainty_budget import budget
from penode.pmsm.balance.calibration import Calibration
from penode.pmsm.balance.voltage_balance import BalanceForm
from penode.pmsm.machine.flux_maps import FLUX_MAPS
from penode.pmsm.machine.terms import Term
from penode.pmsm.recording.imperfections import Accuracy

#: Standard deviations of an imperfection by which its slope is taken.
_SMALL = 1e-3


def expected_resistance(
    recordings: Sequence[Experiment],
    calibration: Calibration,
    accuracy: Accuracy,
    kind: str,
    terms: Sequence[Term],
) -> Estimate:
    """Return R as the weak form of recordings has it, with the budget of its uncertainty.

    Recordings are corrected; voltages as they are held. Training makes the part of the data
    smaller; what the trained model leaves out adds to it.
    """
    form = BalanceForm.of(recordings, FLUX_MAPS[kind].reciprocal, terms)
    solved = form.solve([calibration.acting(e) for e in recordings])
    equations, solution = solved.equations, solved.equations.solve()
    place = list(solved.values).index("R")
    left, gain = equations.target - equations.matrix @ solution, equations.gain(place)
    imperfections, shifts = calibration.rows(accuracy, recordings), list[float]()
    for one in imperfections:
        moved = form.equations([calibration.acting(one.applied(e, _SMALL)) for e in recordings])
        change = moved.target - moved.matrix @ solution - left
        shifts.append(float(gain @ change) / _SMALL)
    rows = budget({STATISTICS: solved.deviation["R"]}, imperfections, np.array(shifts))
    std = float(np.sqrt(sum(row.std**2 for row in rows)))
    return Estimate.of(solved.resistance, std, "ohm", solved.independence["R"], budget=rows)
