"""The torque of the shaft in recordings: means over windows narrow the flux linkage.

Over a window the torque of the shaft is 1.5 p psi x i, less friction and what accelerates the
rotor. Its mean is linear in the map and, whatever an inverter does, has no voltage in it; that of
some milliseconds leaves out what the shaft of a sensor lets swing.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES
from penode.pmsm.machine.terms import SPEED, Term
from penode.pmsm.recording.drive_mapping import TORQUE
from penode.pmsm.recording.imperfection import DriveImperfection, KnownDrive
from penode.pmsm.recording.imperfections import IMPERFECTIONS, Accuracy

#: Gains that recordings share with what is measured beside them.
SHARED = ("current_gain", "voltage_gain", "speed_gain")
#: Length of a window in s, and most samples of each that are looked at.
WINDOW, _SAMPLES = 0.02, 32
#: What a torque is made of beside the map's; and times the largest torque that each may be.
_SEVERAL = 5.0
_OWN = ("friction_torque", "viscous_friction", "inertia", "torque_gain")


@dataclass(frozen=True, eq=False)
class TorqueBalance:
    """Means of the torque over windows, as equations beside a fit of recordings.

    Attributes
    ----------
    name : str
        Of the recordings.
    recordings : sequence of Experiment
        With a torque in Nm.
    pole_pairs : int
    accuracy : Accuracy
        Of the bench.
    machine : Machine
        That the recordings show.
    """

    name: str
    recordings: Sequence[Experiment]
    pole_pairs: int
    accuracy: Accuracy
    machine: Machine

    terms: ClassVar[tuple[Term, ...]] = ()
    #: Deviations of the noise that are tried, over that which friction and a gain leave.
    noises: ClassVar[tuple[float, ...]] = (0.5, 0.7, 1.0, 1.4)
    source: ClassVar[str] = "torque of the shaft"
    subject: ClassVar[str] = "the torque is"
    remedy: ClassVar[str] = "Measure the torque over more of the currents."
    outputs: ClassVar[tuple[slice, ...]] = (slice(None),)
    quantities: ClassVar[Mapping[str, str]] = {TORQUE: "Nm"}
    #: Of the target, by which equations are shown as what was measured.
    known: ClassVar[float] = 0.0

    @property
    def title(self) -> str:
        """Of the equations."""
        return f"the torque in {self.name}"

    @property
    def about(self) -> str:
        """What narrows the map."""
        means = f"{len(self.target)} means over {1e3 * WINDOW:.0f} ms"
        return f"{self.name}: the torque of the shaft narrows the map, {means}"

    @property
    def contradiction(self) -> str:
        """What to do where it is not the torque of the map."""
        told = np.column_stack([self._torque(self._currents, self._flux), self._own[:, :3]])
        factor = np.linalg.lstsq(told, self.target, rcond=1e-9)[0][0]
        fits = max(1, round(abs(self.pole_pairs * factor)))
        return f"Check the pole pairs ({fits} would fit), and sign and unit of the torque."

    @cached_property
    def at(self) -> FloatArray:
        """Mean currents of each window (window, 2), A."""
        return self._mean(self._currents)

    @cached_property
    def imperfections(self) -> dict[str, tuple[DriveImperfection, float]]:
        """Each gain that moved the recordings' map, and its deviation."""
        left = self.accuracy.deviations(list(self.recordings))
        return {n: (IMPERFECTIONS[n], left[n]) for n in SHARED if left.get(n)}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all coefficients but the map's."""
        return (*_OWN, *self.imperfections)

    @cached_property
    def target(self) -> FloatArray:
        """Mean torque of each window, Nm."""
        return self._cut(TORQUE).mean(axis=1)

    @cached_property
    def noise(self) -> FloatArray:
        """Deviation of what neither friction nor a gain explains, Nm."""
        own = self._own / np.maximum(np.abs(self._own).max(axis=0), 1e-300)
        left = self.left(self._flux, {})
        rest = left - own @ np.linalg.lstsq(own, left, rcond=1e-9)[0]
        deviation = np.sqrt(rest @ rest / max(len(left) - len(_OWN), 1))
        return np.array([max(deviation, 1e-6 * np.abs(self.target).max())])

    def prior_deviations(self, flat: float) -> FloatArray:
        """Return those of all coefficients but the map's.

        Friction and inertia may make up several times the largest torque each.
        """
        largest = np.abs(self._own).max(axis=0)
        own = _SEVERAL * np.abs(self.target).max() / np.maximum(largest, 1e-300)
        own[_OWN.index("torque_gain")] = 1.0
        return np.concatenate([own, np.ones(len(self.imperfections))])

    def rows(self, slopes: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """Return what each coefficient adds to each mean, of a map with slopes (sample, 2, k)."""
        (i_d, i_q), psi = self._currents.T[:, :, None], slopes(self._currents)
        of_map = self._mean(1.5 * self.pole_pairs * (psi[:, 0] * i_q - psi[:, 1] * i_d))
        gains = [self._of_gain(one, size) for one, size in self.imperfections.values()]
        return np.column_stack([self._own, *gains, of_map])

    def left(
        self, flux: Callable[[FloatArray], FloatArray], values: Mapping[str, float]
    ) -> FloatArray:
        """Return what a flux linkage (sample, 2) in Vs leaves of each mean."""
        return self.target - self._torque(self._currents, flux)

    @cached_property
    def _own(self) -> FloatArray:
        """What friction, inertia and the gain of the torque add to each mean, (window, 4)."""
        speed = self._cut(SPEED.name) / self.pole_pairs
        rate = np.polynomial.polynomial.polyfit(np.arange(speed.shape[1]), speed.T, 1)[1]
        gain = self.accuracy.declared["torque_gain"]
        parts = [np.sign(speed).mean(axis=1), speed.mean(axis=1), rate / self._step]
        return -np.column_stack([*parts, gain * self.target])

    def _of_gain(self, one: DriveImperfection, size: float) -> FloatArray:
        """Return what a gain adds to each mean: the torque is that of other currents then."""
        i_d, i_q = self._currents.T
        channels = {"i_d": i_d, "i_q": i_q, SPEED.name: np.ones(len(i_d))}
        channels |= dict.fromkeys(VOLTAGES, np.ones(len(i_d)))
        samples = Experiment(self.name, self._step, channels)
        other = one.change(samples, size, KnownDrive()).applied(samples).stack(CURRENTS)
        return self._torque(other, self._flux) - self._torque(self._currents, self._flux)

    def _flux(self, currents: FloatArray) -> FloatArray:
        return np.asarray(self.machine.maps()["flux_map"](*currents.T)).T

    def _torque(self, currents: FloatArray, flux: Callable[[FloatArray], FloatArray]) -> FloatArray:
        (psi_d, psi_q), (i_d, i_q) = flux(currents).T, currents.T
        return self._mean(1.5 * self.pole_pairs * (psi_d * i_q - psi_q * i_d))

    @property
    def _step(self) -> float:
        return self.recordings[0].time_step

    def _cut(self, channel: str) -> FloatArray:
        """Return a channel in windows, (window, sample)."""
        length = max(1, round(WINDOW / self._step))
        values = [np.asarray(e.channels[channel]) for e in self.recordings]
        return np.concatenate([v[: len(v) // length * length].reshape(-1, length) for v in values])

    @cached_property
    def _currents(self) -> FloatArray:
        """Currents of the samples that are looked at, window after window, (sample, 2)."""
        cut = np.stack([self._cut(name) for name in CURRENTS], axis=-1)
        looked_at = np.unique(np.linspace(0, cut.shape[1] - 1, _SAMPLES).round().astype(int))
        return cut[:, looked_at].reshape(-1, 2)

    def _mean(self, values: FloatArray) -> FloatArray:
        """Return the mean over each window's samples that are looked at, (window, ...)."""
        return values.reshape(len(self.target), -1, *values.shape[1:]).mean(axis=1)
