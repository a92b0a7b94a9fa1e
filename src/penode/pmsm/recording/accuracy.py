"""Accuracy of a test bench: what its sensors, its angle and its timing are worth.

No statistics of one recording shows an error that is the same in every sample: a gain of all
currents of 1 % changes the resistance by 1 % and leaves every residual as it was. What the bench's
data sheets say of such errors therefore joins the uncertainty budget.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from penode.data.experiment import Experiment
from penode.errors import InputError
from penode.horizon.uncertainty_budget import Imperfection
from penode.pmsm.machine.space_vectors import (
    CURRENTS,
    VOLTAGES,
    Pair,
    Vector,
    in_frame_ahead,
    with_mismatch,
    with_offset,
    with_vector,
)
from penode.pmsm.machine.terms import ANGLE, SPEED


@dataclass(frozen=True)
class Accuracy:
    """Standard deviations of the errors of a recording chain; the defaults are an ordinary bench's.

    A limit of +-a without further knowledge is a standard deviation of a / sqrt(3) (JCGM 100:2008,
    4.3.7).

    Attributes
    ----------
    current_gain, voltage_gain : float
        Of all phases together, as a fraction of the reading.
    current_mismatch : float
        Of the phases' current gains among each other, as a fraction; needs theta_el.
    current_offset : float
        In each stationary axis, as a fraction of the largest current; needs theta_el.
    speed_gain : float
        As a fraction of the reading.
    angle : float
        Of the d axis, electrical degrees; both currents and voltages turn with it.
    delay : float
        Of the voltage against the currents, samples.

    Raises
    ------
    InputError
        If a number is negative or not finite.
    """

    current_gain: float = 0.005
    voltage_gain: float = 0.005
    current_mismatch: float = 0.002
    current_offset: float = 0.001
    speed_gain: float = 0.0005
    angle: float = 0.5
    delay: float = 0.02

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"accuracy {entry.name} = {value} came; give a number from 0.")

    @classmethod
    def exact(cls) -> "Accuracy":
        """Return that of a recording without systematic errors, such as a simulated one."""
        return cls(**{entry.name: 0.0 for entry in fields(cls)})

    def imperfections(self, experiments: Sequence[Experiment]) -> tuple[Imperfection, ...]:
        """Return what recordings may be wrong by, one standard deviation each.

        Parameters
        ----------
        experiments : sequence of Experiment
            With u_d, u_q, i_d, i_q and omega_el; what happens in the stationary frame is left out
            where theta_el was not recorded.
        """
        largest = max(float(np.hypot(*e.stack(CURRENTS).T).max()) for e in experiments)
        offset = self.current_offset * largest
        every = self._of_the_rotor_frame()
        if all(ANGLE.name in e.channels for e in experiments):
            every += self._of_the_phases(offset)
        return tuple(one for size, one in every if size)

    def _of_the_rotor_frame(self) -> list[tuple[float, Imperfection]]:
        angle = float(np.deg2rad(self.angle))
        calibrate = "Calibrate the {} sensors, and give their accuracy in the study file."
        return [
            (
                self.current_gain,
                Imperfection(
                    "gain of the currents",
                    f"{100 * self.current_gain:.3g} %",
                    calibrate.format("current"),
                    _changed(CURRENTS, lambda i, e, n: i * (1 + n * self.current_gain)),
                ),
            ),
            (
                self.voltage_gain,
                Imperfection(
                    "gain of the voltages",
                    f"{100 * self.voltage_gain:.3g} %",
                    calibrate.format("voltage"),
                    _changed(VOLTAGES, lambda u, e, n: u * (1 + n * self.voltage_gain)),
                ),
            ),
            (
                self.speed_gain,
                Imperfection(
                    "gain of the speed",
                    f"{100 * self.speed_gain:.3g} %",
                    "Compute the speed from the angle.",
                    _scaled_speed(self.speed_gain),
                ),
            ),
            (
                self.angle,
                Imperfection(
                    "angle of the d axis",
                    f"{self.angle:.3g} °",
                    "Align the encoder at standstill, or by the back-EMF.",
                    lambda e, n: in_frame_ahead(e, n * angle),
                ),
            ),
            (
                self.delay,
                Imperfection(
                    "delay of the voltage",
                    f"{self.delay:.3g} samples",
                    "Measure when the recorded voltage acts, and give it in the study file.",
                    _changed(
                        VOLTAGES, lambda u, e, n: u - n * self.delay * np.diff(u, prepend=u[:1])
                    ),
                ),
            ),
        ]

    def _of_the_phases(self, offset: float) -> list[tuple[float, Imperfection]]:
        """Return errors of single phases: seen from the rotor they turn."""

        def mismatched(axis: complex) -> Imperfection:
            size = axis * self.current_mismatch
            return Imperfection(
                "gains of the phases among each other",
                f"{100 * self.current_mismatch:.3g} %",
                "Calibrate the current sensors against each other.",
                lambda e, n: with_mismatch(e, n * size),
            )

        def shifted(axis: complex) -> Imperfection:
            return Imperfection(
                "offset of the currents",
                f"{offset:.2g} A",
                "Zero the current sensors before recording.",
                lambda e, n: with_offset(e, n * offset * axis),
            )

        axes = (1.0, 1j)
        return [
            *((self.current_mismatch, mismatched(axis)) for axis in axes),
            *((self.current_offset, shifted(axis)) for axis in axes),
        ]


DEFAULT_ACCURACY = Accuracy()


def _changed(
    pair: Pair, change: Callable[[Vector, Experiment, float], Vector]
) -> Callable[[Experiment, float], Experiment]:
    """Return a change of a space vector by some deviations as one of experiments."""

    def applied(experiment: Experiment, deviations: float) -> Experiment:
        return with_vector(experiment, pair, lambda v: change(v, experiment, deviations))

    return applied


def _scaled_speed(gain: float) -> Callable[[Experiment, float], Experiment]:
    def applied(experiment: Experiment, deviations: float) -> Experiment:
        speed = (1 + deviations * gain) * experiment.channels[SPEED.name]
        return replace(experiment, channels={**experiment.channels, SPEED.name: speed})

    return applied
