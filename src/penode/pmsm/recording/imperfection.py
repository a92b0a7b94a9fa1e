"""What an imperfection of a drive's recordings is: stated once, as what its correction changes.

An imperfection says what its correction adds to the channels of a recording, given the map and R.
From that follow its column in the weak form of the voltage balance, the correction, what is left of
it in the uncertainty budget, and its entry in the study file.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, TypeAlias

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.horizon.uncertainty_budget import Imperfection
from penode.pmsm.machine.holds import mean_over_samples, turned_voltage
from penode.pmsm.machine.linkage import Linkage
from penode.pmsm.machine.space_vectors import CURRENTS, VOLTAGES, Vector, vector_of, with_vector
from penode.pmsm.machine.terms import ANGLE, SPEED


@dataclass(frozen=True)
class KnownDrive:
    """What the weak form knows of a drive, where an imperfection needs it."""

    # R in ohm, and the map.
    resistance: float = field(default=0.0, compare=False)
    linkage: Linkage | None = field(default=None, compare=False)
    # Frame in which a voltage stands still for a sample, a key of `HOLDS`.
    hold: str = "dq"
    # Samples of rotation by which a balance of whole samples sees it turned beside that, as
    # currents curve within a sample.
    ripple: float = 0.0

    def acting(self, experiment: Experiment) -> Experiment:
        """Return a recording with each sample's mean voltage in the turning frame."""
        if self.hold != "stationary":
            return experiment
        mean = mean_over_samples(experiment)
        return turned_voltage(mean, self.ripple) if self.ripple else mean

    def induced(self, experiment: Experiment) -> Vector:
        """Return the voltage behind R: at a sample the mean of those before and after it."""
        after = vector_of(self.acting(experiment), VOLTAGES)
        before = np.concatenate([after[:1], after[:-1]])
        return np.asarray(
            0.5 * (before + after) - self.resistance * vector_of(experiment, CURRENTS)
        )

    def rotation(self, experiment: Experiment) -> Vector:
        """Return the voltage omega J psi that rotation induces."""
        if self.linkage is None:  # all of what is induced, where no map is known
            return self.induced(experiment)
        return self.linkage.rotation(experiment)


UNKNOWN_DRIVE = KnownDrive()
#: Stored and supplied quantity of the balance, (time, 2) each, that a coefficient adds.
Column: TypeAlias = tuple[FloatArray, FloatArray]


@dataclass(frozen=True)
class Change:
    """What is added to the channels of a recording: vectors d + j q and numbers, (time,) or 0."""

    current: Vector | float = 0.0
    voltage: Vector | float = 0.0
    speed: FloatArray | float = 0.0
    # Of the rotor, rad; currents and voltages are not turned with it.
    angle: FloatArray | float = 0.0
    # By which the map of these channels is another, Vs.
    linkage: Vector | float = 0.0

    def applied(self, experiment: Experiment) -> Experiment:
        """Return a recording with all but another map added."""
        if np.any(self.current):
            experiment = with_vector(experiment, CURRENTS, lambda i: i + self.current)
        if np.any(self.voltage):
            experiment = with_vector(experiment, VOLTAGES, lambda u: u + self.voltage)
        beside = {SPEED.name: self.speed, ANGLE.name: self.angle}
        channels = {
            name: experiment.channels[name] + more
            for name, more in beside.items()
            if np.any(more) and name in experiment.channels
        }
        return replace(experiment, channels={**experiment.channels, **channels})

    def column(self, experiment: Experiment, drive: KnownDrive) -> Column:
        """Return what the change adds to stored and supplied quantity of the balance, (time, 2).

        Of psi(i), and of u - R i - omega J psi(i); the map and R are those of the drive.
        """
        speed, none = experiment.channels[SPEED.name], np.zeros(len(experiment), np.complex128)
        stored, turned = none + self.linkage, none
        if np.any(self.current) or np.any(self.speed):
            (psi_d, psi_q), slope = map_at(experiment, drive)
            stored = stored + along(slope, none + self.current)
            turned = -1j * self.speed * (psi_d + 1j * psi_q)
        supplied = self.voltage - drive.resistance * self.current + turned - 1j * (speed * stored)
        return pair(stored), pair(supplied)


class DriveImperfection:
    """One way in which a drive's recordings differ from what happened.

    Sizes are in SI units, of two axes d + j q; positive is what `change` takes off.
    """

    # Of the size in a calibration, and in the study file.
    name: ClassVar[str]
    # In the uncertainty budget: what it is, what would make it smaller, and the unit in which it is
    # said, with its number of them in one of the size.
    source: ClassVar[str]
    remedy: ClassVar[str]
    unit: ClassVar[tuple[float, str]]
    # Standard deviation believed of it where nothing is declared, in the unit of the study file and
    # that in SI; without one it is no entry there.
    declared: ClassVar[float] = math.inf
    declared_unit: ClassVar[float] = 1.0
    # Axes that it has, and channels that it needs beside currents, voltages and speed.
    axes: ClassVar[tuple[complex, ...]] = (1.0,)
    channels: ClassVar[tuple[str, ...]] = ()
    # Sizes of which multiples are exact, 0 for none, and how near to one a size is taken for it.
    exact: ClassVar[float] = 0.0
    near: ClassVar[float] = 0.0
    # Sizes, relative to `scale`, from which it matters and up to which it is believed, and the one
    # that is usual.
    credible: ClassVar[tuple[float, float]] = (0.0, math.inf)
    usual: ClassVar[float] = math.inf
    # Whether physics allows no negative size.
    positive: ClassVar[bool] = False
    # Whether it is estimated beside all others, and taken off where it is credible: no map, timing
    # or angle imitates it.
    beside: ClassVar[bool] = False
    # Whether every recording has a size of its own.
    drifts: ClassVar[bool] = False

    def change(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Change:
        """Return what is added to a recording to take a small size off, linear in it."""
        raise NotImplementedError

    def corrected(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Experiment:
        """Return the recording with a size of it taken off, not only to first order."""
        return self.change(experiment, size, drive).applied(experiment)

    def columns(self, experiment: Experiment, drive: KnownDrive) -> list[Column]:
        """Return for each axis stored and supplied quantity (time, 2) that a size of 1 adds."""
        changes = (self.change(experiment, axis, drive) for axis in self.axes)
        return [change.column(experiment, drive) for change in changes]

    def scale(self, experiments: Sequence[Experiment], drive: KnownDrive) -> float:
        """Return what sizes are divided by to judge them."""
        return 1.0

    def relative(
        self, size: complex, experiments: Sequence[Experiment], drive: KnownDrive
    ) -> float:
        """Return a size over the scale, negative where physics allows none."""
        return float((size.real if self.positive else abs(size)) / self.scale(experiments, drive))

    def shows(self, experiments: Sequence[Experiment]) -> bool:
        """Return whether nothing else in these recordings looks the same."""
        return True

    def placed(
        self, size: float, experiments: Sequence[Experiment], drive: KnownDrive
    ) -> tuple[float, KnownDrive]:
        """Return the size next to an estimate that a drive can have, and the drive with it."""
        return self.nearest(size, self.near), drive

    def nearest(self, size: float, near: float) -> float:
        """Return a size, the exact one where it is near."""
        if not self.exact:
            return size
        exact = self.exact * round(size / self.exact)
        return exact if abs(size - exact) < near else size

    def sentence(self, size: complex, deviation: float, drive: KnownDrive) -> str:
        """Return what was found and is corrected."""
        value, own = (self.unit[0] * abs(part) for part in (size, deviation))
        return f"{self.source}: {value:.3g} ± {own:.2g} {self.unit[1]}, taken off."

    def said(self, deviation: float) -> str:
        """Return a deviation in words."""
        return f"{self.unit[0] * abs(deviation):.3g} {self.unit[1]}"

    def recorded(self, experiments: Sequence[Experiment]) -> bool:
        """Return whether all recordings have the channels that it needs."""
        return all(name in e.channels for e in experiments for name in self.channels)

    def rows(self, deviation: float, drive: KnownDrive) -> list[Imperfection]:
        """Return the rows of the uncertainty budget of a deviation that is left, one an axis."""

        def row(axis: complex) -> Imperfection:
            def applied(experiment: Experiment, count: float) -> Experiment:
                change = self.change(experiment, count * deviation * axis, drive)
                return change.applied(experiment)

            return Imperfection(self.source, self.said(deviation), self.remedy, applied)

        return [row(axis) for axis in self.axes]


def turn_a_sample(experiments: Sequence[Experiment]) -> float:
    """Return by how much the rotor turns in a sample, rad."""
    return max(float(np.median(np.abs(e.channels[SPEED.name]))) * e.time_step for e in experiments)


def map_at(experiment: Experiment, drive: KnownDrive) -> tuple[FloatArray, FloatArray]:
    """Return psi (2, time) in Vs and L (time, 2, 2) in H of the drive at a recording's currents."""
    if drive.linkage is None:
        raise ValueError("this column needs the map of a round before")
    psi, slope = drive.linkage.at(experiment)
    return psi.T, slope


def pair(vector: Any) -> FloatArray:
    """Return a space vector as d and q, (time, 2)."""
    return np.stack([vector.real, vector.imag], axis=1)


def along(slope: FloatArray, vector: Any) -> Vector:
    """Return an inductance (time, 2, 2) times a space vector."""
    d, q = np.einsum("tij,tj->ti", slope, pair(vector)).T
    return np.asarray(d + 1j * q)
