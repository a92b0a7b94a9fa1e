"""Every imperfection of a drive's recordings, and how large each is believed to be.

To add one, write a subclass of `DriveImperfection` and put a line into `IMPERFECTIONS`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.polynomial import Polynomial

from penode.arrays import FloatArray
from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.horizon.uncertainty_budget import Imperfection
from penode.pmsm.machine.holds import turned_voltage
from penode.pmsm.machine.space_vectors import (
    CURRENTS,
    VOLTAGES,
    Vector,
    in_frame_ahead,
    rotor_of,
    vector_of,
    with_mismatch,
    with_vector,
)
from penode.pmsm.machine.standstill import axes_at_rest
from penode.pmsm.machine.terms import ANGLE, SPEED
from penode.pmsm.recording.imperfection import (
    Change,
    Column,
    DriveImperfection,
    KnownDrive,
    along,
    map_at,
    turn_a_sample,
)

#: Samples, and degree of the polynomial, over which an angle is differentiated.
SLOPE, _DEGREE = 51, 3
#: Turn in a sample, rad, from which what happens inside it counts; and samples by which a voltage
#: that is held about its middle may seem to be turned back.
_COARSE, _RIPPLE = 0.35, 0.1
_MORE = "Record another speed, or larger currents."
_STEADY = "Record for longer, and at a steady temperature of winding and magnets."


class _Gain(DriveImperfection):
    """A channel that reads too little by a fraction."""

    unit = (100.0, "%")
    declared = 0.005


class _CurrentGain(_Gain):
    """Of all current sensors together."""

    name, source = "current_gain", "gain of the currents"
    remedy = "Calibrate the current sensors, and give their accuracy in the study file."

    def change(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Change:
        return Change(current=size * vector_of(experiment, CURRENTS))


class _VoltageGain(_Gain):
    """Of all voltages together."""

    name, source = "voltage_gain", "gain of the voltages"
    remedy = "Calibrate the voltage sensors, or that of u_dc; give the accuracy in the study file."

    def change(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Change:
        return Change(voltage=size * vector_of(experiment, VOLTAGES))


class _SpeedGain(_Gain):
    """Of the speed."""

    name, source = "speed_gain", "gain of the speed"
    remedy = "Compute the speed from the angle."
    declared = 0.0005

    def change(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Change:
        return Change(speed=size.real * experiment.channels[SPEED.name])


class _CurrentOffset(DriveImperfection):
    """Offset alpha + j beta of the currents in the stationary frame, A: it stands still there."""

    name, source = "current_offset", "offset of the currents"
    remedy = "Zero the current sensors before recording."
    unit, declared, axes, channels = (1.0, "A"), 0.001, (1.0, 1j), (ANGLE.name,)
    credible, beside = (1e-4, 0.1), True

    def change(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Change:
        return Change(current=-size / rotor_of(experiment))

    def scale(self, experiments: Sequence[Experiment], drive: KnownDrive) -> float:
        """Return the largest current along an axis in A."""
        return max(float(np.abs(e.stack(CURRENTS)).max()) for e in experiments)

    def sentence(self, size: complex, deviation: float, drive: KnownDrive) -> str:
        return (
            f"The currents have an offset of {abs(size):.3g} ± {deviation:.2g} A in the stationary "
            "frame, which is subtracted."
        )


class _CurrentMismatch(DriveImperfection):
    """Gains of the phases' current sensors that differ: it turns backwards, see `with_mismatch`."""

    name, source = "current_mismatch", "gains of the phases among each other"
    remedy = "Calibrate the current sensors against each other."
    unit, declared, axes, channels = (100.0, "%"), 0.002, (1.0, 1j), (ANGLE.name,)
    credible, beside = (1e-4, 0.1), True

    def change(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Change:
        mirrored = np.conj(vector_of(experiment, CURRENTS) * rotor_of(experiment) ** 2)
        return Change(current=-size * mirrored)

    def corrected(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Experiment:
        whole = with_mismatch(experiment, -size)
        return with_vector(whole, CURRENTS, lambda current: current / (1 - abs(size) ** 2))

    def sentence(self, size: complex, deviation: float, drive: KnownDrive) -> str:
        largest, own = (100 * 2 * abs(part) for part in (size, deviation))
        return (
            f"The gains of the current sensors differ by up to {largest:.3f} ± {own:.3f} % from "
            "their mean: the currents are corrected."
        )


class _SpeedLag(DriveImperfection):
    """A speed that lags behind the angle, by all (1) or nothing (0) of what its slope differs."""

    name, source, remedy = "speed_lag", "lag of the speed", "Compute the speed from the angle."
    unit, channels, credible = (100.0, "%"), (ANGLE.name,), (1e-3, 0.2)

    def scale(self, experiments: Sequence[Experiment], drive: KnownDrive) -> float:
        """Return the largest speed over the root mean square by which the slope differs."""
        lags = []
        for experiment in experiments:
            speed, lag = experiment.channels[SPEED.name], self.change(experiment, 1.0, drive).speed
            lags.append(np.sqrt(np.mean(np.square(lag))) / max(np.abs(speed).max(), 1e-9))
        return 1.0 / max(float(max(lags)), 1e-300)

    def change(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Change:
        slope = _slopes(np.unwrap(experiment.channels[ANGLE.name])) / experiment.time_step
        return Change(speed=size.real * (slope - experiment.channels[SPEED.name]))

    def sentence(self, size: complex, deviation: float, drive: KnownDrive) -> str:
        return "The recorded speed lags behind the angle: its slope is taken for the speed."


class _Angle(DriveImperfection):
    """By which the d axis of the machine lies before that of the recording, rad.

    Nothing says what happened along an axis whose channels are zero throughout: a recording of one
    axis is left as it is.
    """

    name, source = "angle", "angle of the d axis"
    remedy = "Align the encoder at standstill, or by the back-EMF."
    unit, declared, declared_unit = (float(np.rad2deg(1.0)), "°"), 0.5, float(np.deg2rad(1.0))
    credible = (float(np.deg2rad(0.05)), float(np.deg2rad(12.0)))

    def change(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Change:
        if axes_at_rest([experiment]):
            return Change()
        back = -1j * size
        current, voltage = (back * vector_of(experiment, pair) for pair in (CURRENTS, VOLTAGES))
        return Change(current, voltage, angle=size.real)

    def corrected(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Experiment:
        return experiment if axes_at_rest([experiment]) else in_frame_ahead(experiment, size.real)

    def shows(self, experiments: Sequence[Experiment]) -> bool:
        """Return whether the rotor turns little in a sample, and both axes are in a recording.

        Voltages that are held in another frame than was thought else leave a small turn, which an
        angle imitates.
        """
        both = not all(axes_at_rest([e]) for e in experiments)
        return both and turn_a_sample(experiments) <= _COARSE

    def columns(self, experiment: Experiment, drive: KnownDrive) -> list[Column]:
        """Return the same by the balance itself, without the voltages' noise.

        Seen from the recording's frame the map is psi + delta (J psi - L J i).
        """
        if axes_at_rest([experiment]):
            return [Change().column(experiment, drive)]
        (psi_d, psi_q), slope = map_at(experiment, drive)
        turned = along(slope, 1j * vector_of(experiment, CURRENTS))
        return [Change(linkage=1j * (psi_d + 1j * psi_q) - turned).column(experiment, drive)]

    def sentence(self, size: complex, deviation: float, drive: KnownDrive) -> str:
        side = "before" if size.real >= 0 else "behind"
        return (
            f"The d axis lies {abs(np.rad2deg(size.real)):.3f} ± {np.rad2deg(deviation):.3f}° "
            f"{side} that of the recording: currents, voltages and angle are turned by it."
        )


class _Turn(DriveImperfection):
    """Samples of rotation by which the voltage acts ahead of where it is recorded."""

    name, source, remedy = "turn", "turn of the voltage", _MORE
    unit, exact, near, credible = (1.0, "samples"), 1.0, 0.2, (0.0, 3.0)

    def placed(
        self, size: float, experiments: Sequence[Experiment], drive: KnownDrive
    ) -> tuple[float, KnownDrive]:
        """Return the turn beside that of the hold.

        No inverter turns a voltage by hundredths of a sample: it stands still in the frame of the
        rotor or, seen at the sample half a sample back, in the stationary one. Where the rotor
        turns far in a sample, a voltage of its middle that is held in the stationary frame seems to
        be turned back by about R T / (12 L) of it: the current curves in between, which windows
        over samples do not see.
        """
        far = turn_a_sample(experiments)
        near = min(self.near, _Angle.credible[0] / far) if far > _COARSE else self.near
        if not self.nearest(size + 0.5, self.near) % 1.0:
            return self.nearest(size + 0.5, near), replace(drive, hold="stationary")
        turn = self.nearest(size, near)
        if far > _COARSE and -_RIPPLE < turn < 0.0:
            return 0.5, replace(drive, hold="stationary", ripple=turn)
        return turn, drive

    def change(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Change:
        turn = experiment.time_step * experiment.channels[SPEED.name]
        return Change(voltage=size * (turn * (1j * vector_of(experiment, VOLTAGES))))

    def corrected(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Experiment:
        return turned_voltage(experiment, size.real)


class _Sampling(DriveImperfection):
    """Samples of rotation by which the currents are sampled later than they are recorded.

    No drive does it: a turn of the voltage and an angle that cancel there are this.
    """

    name, source, remedy = "sampling", "instant at which the currents are sampled", _MORE
    unit = (1.0, "samples")

    def change(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Change:
        turn = experiment.time_step * experiment.channels[SPEED.name]
        return Change(current=-size * (turn * (1j * vector_of(experiment, CURRENTS))))


class _Delay(DriveImperfection):
    """Samples by which the voltage acts later than it is recorded."""

    name, source = "delay", "delay of the voltage"
    remedy = "Measure when the recorded voltage acts, and give its accuracy in the study file."
    unit, declared, exact, near = (1.0, "samples"), 0.02, 1.0, 0.1
    credible = (0.1, 4.0)

    def change(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Change:
        voltage = vector_of(experiment, VOLTAGES)
        return Change(voltage=-size * np.diff(voltage, prepend=voltage[:1]))

    def corrected(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Experiment:
        """Cut at its ends where no voltage was recorded."""
        count, delay = len(experiment), size.real
        first, last = math.ceil(max(delay, 0.0)), count + math.floor(min(delay, 0.0))
        channels = {name: values[first:last] for name, values in experiment.channels.items()}
        at = np.arange(first, last) - delay
        for name in VOLTAGES:  # of two voltages held one after the other the mean acts
            channels[name] = np.interp(at, np.arange(count), experiment.channels[name])
        return replace(experiment, channels=channels)

    def columns(self, experiment: Experiment, drive: KnownDrive) -> list[Column]:
        """Return the same with the window, and not the voltage, differentiated."""
        voltage = experiment.stack(VOLTAGES)
        return [(experiment.time_step * voltage, np.zeros_like(voltage))]


class _Iron(DriveImperfection):
    """Conductance parallel to the induced voltage, S; the current that is left magnetises.

    The voltage behind R is kept.
    """

    name, source, remedy = "iron", "iron loss", _MORE
    unit, positive, credible, usual = (1e3, "mS"), True, (1e-4, 0.2), 0.01
    takes: ClassVar[str] = "the induced voltage"

    def voltage(self, experiment: Experiment, drive: KnownDrive) -> Vector:
        """Return the voltage by which it takes current."""
        return drive.induced(experiment)

    def change(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Change:
        taken = size * self.voltage(experiment, drive)
        return Change(-taken, -drive.resistance * taken)

    def scale(self, experiments: Sequence[Experiment], drive: KnownDrive) -> float:
        """Return the conductance of which all current would be the iron's."""
        taken, whole = (
            np.sqrt(sum(float(np.sum(e.stack(names) ** 2)) for e in experiments))
            for names in (VOLTAGES, CURRENTS)
        )
        return float(whole / max(taken, 1e-300))

    def sentence(self, size: complex, deviation: float, drive: KnownDrive) -> str:
        return (
            f"The iron takes {1e3 * size.real:.3g} ± {1e3 * deviation:.2g} mS times {self.takes} "
            f"({1 / size.real:.3g} ohm in parallel): the current that is left magnetises."
        )


class _IronOfRotation(_Iron):
    """Conductance to omega J psi alone, without d psi/dt (doi:10.1109/41.315269)."""

    name, takes = "iron_of_rotation", "the voltage that rotation induces"

    def voltage(self, experiment: Experiment, drive: KnownDrive) -> Vector:
        return drive.rotation(experiment)


class _IronOfChange(_IronOfRotation):
    """What the two kinds of iron loss differ by: conductance to d psi/dt alone."""

    name, source, takes = "iron_of_change", "kind of iron loss", "the change of the flux linkage"
    positive = False

    def voltage(self, experiment: Experiment, drive: KnownDrive) -> Vector:
        return np.asarray(drive.induced(experiment) - drive.rotation(experiment))


class _ResistanceDrift(DriveImperfection):
    """Rise of R from a recording's beginning to its end, ohm; R is that of the middle."""

    name, source, remedy = "resistance_drift", "drift of R", _STEADY
    unit, credible, drifts = (1e3, "mΩ"), (2e-3, 0.6), True

    def change(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Change:
        return Change(voltage=-size * (_clock(experiment) * vector_of(experiment, CURRENTS)))

    def scale(self, experiments: Sequence[Experiment], drive: KnownDrive) -> float:
        return abs(drive.resistance)

    def sentence(self, size: complex, deviation: float, drive: KnownDrive) -> str:
        share, own = (100 * part / abs(drive.resistance) for part in (size.real, deviation))
        change = f"R changes by {share:.2g} ± {own:.1g} % over the recording"
        return f"{change}; R is that of its middle."


class _MagnetDrift(DriveImperfection):
    """Rise of the magnets' flux linkage from a recording's beginning to its end, Vs."""

    name, source, remedy = "magnet_drift", "drift of the magnets", _STEADY
    unit, credible, drifts = (1e3, "mVs"), (2e-4, 0.1), True

    def change(self, experiment: Experiment, size: complex, drive: KnownDrive) -> Change:
        turned = 1j * (_clock(experiment) * experiment.channels[SPEED.name])
        rise = 1.0 / max(experiment.place.duration, 1e-300)
        return Change(voltage=np.asarray(-size * (turned + rise)))

    def columns(self, experiment: Experiment, drive: KnownDrive) -> list[Column]:
        """Return the same with the window differentiated."""
        return [Change(linkage=np.asarray(_clock(experiment) + 0j)).column(experiment, drive)]

    def scale(self, experiments: Sequence[Experiment], drive: KnownDrive) -> float:
        """Return about the largest flux linkage in Vs, from voltage over speed."""
        return max(
            float(np.median(np.hypot(*e.stack(VOLTAGES).T)))
            / max(float(np.median(np.abs(e.channels[SPEED.name]))), 1e-9)
            for e in experiments
        )

    def sentence(self, size: complex, deviation: float, drive: KnownDrive) -> str:
        return (
            f"the magnets' flux linkage changes by {1e3 * size.real:.3g} ± {1e3 * deviation:.2g} "
            "mVs over the recording; the map is that of its middle."
        )


#: Every imperfection, in the order of corrections: what currents and speed are, in which frame,
#: where and when the voltages act, and what of the currents magnetises.
IMPERFECTIONS: dict[str, DriveImperfection] = {
    one.name: one
    for one in (
        _CurrentGain(),
        _VoltageGain(),
        _SpeedGain(),
        _CurrentOffset(),
        _CurrentMismatch(),
        _SpeedLag(),
        _Angle(),
        _Sampling(),
        _Turn(),
        _Delay(),
        _Iron(),
        _IronOfRotation(),
        _IronOfChange(),
        _ResistanceDrift(),
        _MagnetDrift(),
    )
}


@dataclass(frozen=True, init=False)
class Accuracy:
    """Standard deviations of the errors of a recording chain; the defaults are an ordinary bench's.

    A limit of +-a alone is a standard deviation of a / sqrt(3) (JCGM 100:2008, 4.3.7).

    Parameters
    ----------
    current_gain, voltage_gain, speed_gain, torque_gain : float
        As a fraction of the reading, of all phases together.
    current_mismatch : float
        Of the phases' current gains among each other, as a fraction; needs theta_el.
    current_offset : float
        In each stationary axis, as a fraction of the largest current; needs theta_el.
    angle : float
        Of the d axis, electrical degrees; both currents and voltages turn with it.
    delay : float
        Of the voltage against the currents, samples.

    Raises
    ------
    InputError
        If a name is unknown, or a number is negative or not finite.
    """

    declared: Mapping[str, float]
    given: tuple[str, ...] = field(compare=False)

    def __init__(self, **declared: float) -> None:
        usual = {n: one.declared for n, one in IMPERFECTIONS.items() if one.declared < math.inf}
        usual["torque_gain"] = 0.005  # of the shaft's torque, in no balance of voltages
        for name, value in declared.items():
            if name not in usual:
                raise InputError(f"accuracy {name} is unknown; known are {', '.join(usual)}.")
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"accuracy {name} must be >= 0 and finite, got {value}.")
        object.__setattr__(self, "declared", {**usual, **declared})
        object.__setattr__(self, "given", tuple(declared))

    @classmethod
    def exact(cls) -> "Accuracy":
        """Return that of a recording without systematic errors, such as a simulated one."""
        return cls(**dict.fromkeys(cls().declared, 0.0))

    def origin(self, name: str) -> str:
        """Return whether a deviation was declared or is assumed; empty of what is no entry."""
        origin = "declared" if name in self.given else "assumed"
        return origin if name in self.declared else ""

    def deviations(self, experiments: Sequence[Experiment]) -> dict[str, float]:
        """Return them by name, SI units; an offset's is that of the largest current."""
        largest = max(float(np.hypot(*e.stack(CURRENTS).T).max()) for e in experiments)
        units = {n: one.declared_unit for n, one in IMPERFECTIONS.items() if n in self.declared}
        units[_CurrentOffset.name] = largest
        return {name: unit * self.declared[name] for name, unit in units.items()}


DEFAULT_ACCURACY = Accuracy()


def budget_rows(
    left: Mapping[str, float],
    experiments: Sequence[Experiment],
    drive: KnownDrive,
    origins: Mapping[str, str] | None = None,
) -> tuple[Imperfection, ...]:
    """Return the budget's rows of what is left, deviations by name; estimated unless said."""
    return tuple(
        replace(row, origin=(origins or {}).get(name, "estimated"))
        for name, one in IMPERFECTIONS.items()
        if left.get(name) and one.recorded(experiments)
        for row in one.rows(left[name], drive)
    )


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


def _clock(experiment: Experiment) -> FloatArray:
    """Return when each sample is on the clock of its recording, -1/2 to 1/2, (time,)."""
    place, length = experiment.place, (len(experiment) - 1) * experiment.time_step
    first, last = (
        t / max(place.duration, 1e-300) - 0.5 for t in (place.start, place.start + length)
    )
    return np.linspace(first, last, len(experiment))
