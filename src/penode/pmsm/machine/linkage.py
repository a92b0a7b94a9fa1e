"""The flux map of the weak form, where corrections of a recording need one."""

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from penode.arrays import ComplexArray, FloatArray, float64, with_shared_length
from penode.data.experiment import Experiment
from penode.models.parameters import with_batch_axis
from penode.pmsm.machine.coenergy_map import CoenergyPart, CoenergySplines
from penode.pmsm.machine.space_vectors import CURRENTS
from penode.pmsm.machine.terms import SPEED


@dataclass(frozen=True, eq=False)
class Linkage:
    """Flux linkage over the currents: a part, of the currents over the reach, A."""

    part: CoenergyPart
    reach: float

    def at(self, experiment: Experiment) -> tuple[FloatArray, FloatArray]:
        """Return psi (time, 2) in Vs and L (time, 2, 2) in H at the currents of a recording."""
        known = _KNOWN.setdefault(self, WeakKeyDictionary())
        if experiment not in known:
            known[experiment] = self._evaluated(experiment)
        return known[experiment]

    def _evaluated(self, experiment: Experiment) -> tuple[FloatArray, FloatArray]:
        splines = with_batch_axis(CoenergySplines((self.part,)))
        with float64():
            at = with_shared_length(experiment.stack(CURRENTS).T / self.reach)
            psi, slope = (np.asarray(part) for part in splines.value_and_jacobian(at))
        count = len(experiment)
        return psi.T[:count], np.moveaxis(slope, -1, 0)[:count] / self.reach

    def rotation(self, experiment: Experiment) -> ComplexArray:
        """Return the voltage omega J psi that rotation induces, d + j q, (time,), in V."""
        d, q = self.at(experiment)[0].T
        return np.asarray(1j * experiment.channels[SPEED.name] * (d + 1j * q))


#: What maps are at recordings: every column of a balance asks for the same, and a checkpoint, which
#: keeps a map, must not.
_KNOWN: WeakKeyDictionary[Linkage, WeakKeyDictionary[Experiment, tuple[FloatArray, FloatArray]]] = (
    WeakKeyDictionary()
)
