"""Calibration of a drive's recording: what its channels have to be corrected by.

When and in which frame the voltage acts, the angle of the d axis, and the current that the iron
takes are properties of the drive, not of the flux map; `penode.pmsm.balance.calibration_fit`
estimates them with the map.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.polynomial import Polynomial

from penode.arrays import ComplexArray, FloatArray
from penode.data.experiment import Experiment
from penode.horizon.uncertainty_budget import Imperfection
from penode.pmsm.balance.linkage import Linkage
from penode.pmsm.machine.holds import mean_over_samples, turned_voltage
from penode.pmsm.machine.space_vectors import (
    CURRENTS,
    VOLTAGES,
    in_frame_ahead,
    vector_of,
    with_mismatch,
    with_offset,
    with_vector,
)
from penode.pmsm.machine.terms import ANGLE, SPEED
from penode.pmsm.recording.accuracy import Accuracy

#: Samples, and degree of the polynomial, over which an angle is differentiated.
SLOPE, _DEGREE = 51, 3
#: Root of a probability from which the other kind of iron loss is a row of the budget.
_NOTICED = 0.1


@dataclass(frozen=True)
class Calibration:
    """What the channels of a drive's recordings have to be corrected by.

    The deviation of an offset is a fraction of the largest current, that of `rotation_alone`
    the root of the probability that it is the other way round.
    """

    # Samples by which the voltage acts later than it is recorded.
    delay: float = 0.0
    # Frame in which it then stands still for a sample, a key of `HOLDS`.
    hold: str = "dq"
    # Samples of rotation by which it is turned beside that.
    turn: float = 0.0
    # The same as a balance of whole samples sees it, as currents curve within a sample.
    ripple: float = 0.0
    # By which the d axis of the machine lies before that of the recording, rad.
    angle: float = 0.0
    # Conductance parallel to the induced voltage, S; the rest of the current magnetises.
    iron: float = 0.0
    # Iron current by omega J psi alone, without d psi/dt (doi:10.1109/41.315269).
    rotation_alone: bool = False
    # By which the induced voltage is known, ohm; for the iron alone.
    resistance: float = field(default=0.0, compare=False)
    # By which that of the rotation is known; for the iron alone.
    linkage: Linkage | None = field(default=None, compare=False)
    # Of the phases' current sensors, see `with_mismatch` and `with_offset`; offset in A.
    mismatch: complex = 0.0
    offset: complex = 0.0
    # Whether the speed is the slope of the angle, as the recorded one lags.
    speed_from_angle: bool = False
    # Of what was estimated, by name; of what was left alone, what it may be off by.
    deviation: Mapping[str, float] = field(default_factory=dict, compare=False)
    # What was estimated, a sentence each.
    reasons: tuple[str, ...] = ()

    def applied(self, experiment: Experiment) -> Experiment:
        """Return the recording corrected, cut at its ends where no voltage was recorded."""
        if self.offset:
            experiment = with_offset(experiment, -self.offset)
        if self.mismatch:
            experiment = _matched(experiment, self.mismatch)
        if self.speed_from_angle:
            experiment = with_speed_from_angle(experiment)
        if self.angle:
            experiment = in_frame_ahead(experiment, self.angle)
        if self.turn:
            experiment = turned_voltage(experiment, self.turn)
        if self.delay:
            experiment = _delayed(experiment, self.delay)
        if self.iron:
            experiment = self._without_iron(experiment, self.iron)
        return experiment

    def acting(self, experiment: Experiment) -> Experiment:
        """Return an applied recording with each sample's mean voltage in the turning frame."""
        if self.hold != "stationary":
            return experiment
        mean = mean_over_samples(experiment)
        return turned_voltage(mean, self.ripple) if self.ripple else mean

    def accuracy(self, declared: Accuracy) -> Accuracy:
        """Return a declared accuracy, narrowed by what the recording shows of it."""

        def narrowed(name: str, declared: float, estimated: bool, unit: float = 1.0) -> float:
            shown = float(self.deviation.get(name, np.inf)) * unit
            return shown if estimated else min(declared, shown)

        return replace(
            declared,
            angle=narrowed("angle", declared.angle, bool(self.angle), float(np.rad2deg(1.0))),
            delay=narrowed("delay", declared.delay, bool(self.delay % 1.0)),
            current_mismatch=narrowed("mismatch", declared.current_mismatch, bool(self.mismatch)),
            current_offset=narrowed("offset", declared.current_offset, bool(self.offset)),
        )

    @property
    def imperfections(self) -> tuple[Imperfection, ...]:
        """What is left of the corrections that no declared accuracy speaks of."""
        remedy = "Record another speed, or larger currents."
        turn, iron = (self.deviation.get(name, 0.0) for name in ("turn", "iron"))
        left: list[Imperfection] = []
        if turn:
            text = f"{turn:.2g} samples"
            left.append(
                Imperfection(
                    "turn of the voltage", text, remedy, lambda e, n: turned_voltage(e, n * turn)
                )
            )
        if iron:
            text = f"{1e3 * iron:.2g} mS"
            left.append(
                Imperfection(
                    "iron loss", text, remedy, lambda e, n: self._without_iron(e, n * iron)
                )
            )
        other = self.deviation.get("rotation_alone", 0.0)
        if self.iron and other > _NOTICED:
            left.append(
                Imperfection(
                    "kind of iron loss",
                    f"{100 * other**2:.2g} % probable",
                    "Record another speed, or larger currents.",
                    lambda e, n: self._with_other_iron(e, n * other),
                )
            )
        return tuple(left)

    def _without_iron(self, experiment: Experiment, conductance: float) -> Experiment:
        """Return a recording with the current that magnetises, the voltage behind R kept."""
        induced = self._induced(experiment)
        rate = self._rate(experiment, induced) if self.rotation_alone else 0.0
        return self._less(experiment, conductance * (induced - rate))

    def _with_other_iron(self, experiment: Experiment, share: float) -> Experiment:
        """Return an applied recording with a share of d psi/dt taken by the iron, or given back."""
        rate = self._rate(experiment, self._induced(experiment))
        sign = 1.0 if self.rotation_alone else -1.0
        return self._less(experiment, sign * share * self.iron * rate)

    def _rate(self, experiment: Experiment, induced: ComplexArray) -> ComplexArray:
        """Return d psi/dt, in V."""
        if self.linkage is None:
            return np.zeros_like(induced)
        return np.asarray(induced - self.linkage.rotation(experiment))

    def _induced(self, experiment: Experiment) -> ComplexArray:
        """Return the voltage behind R: at a sample the mean of those before and after it."""
        after = vector_of(self.acting(experiment), VOLTAGES)
        before = np.concatenate([after[:1], after[:-1]])
        drop = self.resistance * vector_of(experiment, CURRENTS)
        return np.asarray(0.5 * (before + after) - drop)

    def _less(self, experiment: Experiment, taken: ComplexArray) -> Experiment:
        experiment = with_vector(experiment, CURRENTS, lambda current: current - taken)
        return with_vector(experiment, VOLTAGES, lambda voltage: voltage - self.resistance * taken)


AS_RECORDED = Calibration()


def _matched(experiment: Experiment, mismatch: complex) -> Experiment:
    """Return a recording of phases with unequal gains as with equal ones."""
    whole = with_mismatch(experiment, -mismatch)
    return with_vector(whole, CURRENTS, lambda current: current / (1 - abs(mismatch) ** 2))


def with_speed_from_angle(experiment: Experiment) -> Experiment:
    """Return a recording whose speed is the slope of its angle."""
    angle = np.unwrap(experiment.channels[ANGLE.name])
    speed = _slopes(angle) / experiment.time_step
    return replace(experiment, channels={**experiment.channels, SPEED.name: speed})


def _slopes(values: FloatArray) -> FloatArray:
    """Return slopes a sample of the polynomials that fit the samples around (Savitzky, Golay).

    The same as by SciPy's filter, whose import takes longer than most of an identification's steps.
    """
    half = SLOPE // 2
    at = np.arange(-half, half + 1) / half
    fitted = np.linalg.pinv(np.vander(at, _DEGREE + 1, increasing=True))
    middle = np.convolve(values, fitted[1][::-1], "valid")
    first, last = (Polynomial(fitted @ part).deriv() for part in (values[:SLOPE], values[-SLOPE:]))
    return np.concatenate([first(at[:half]), middle, last(at[half + 1 :])]) / half


def _delayed(experiment: Experiment, delay: float) -> Experiment:
    count = len(experiment)
    first, last = math.ceil(max(delay, 0.0)), count + math.floor(min(delay, 0.0))
    channels = {name: values[first:last] for name, values in experiment.channels.items()}
    at = np.arange(first, last) - delay
    for name in VOLTAGES:  # of two voltages held one after the other the mean acts
        channels[name] = np.interp(at, np.arange(count), experiment.channels[name])
    return replace(experiment, channels=channels)
