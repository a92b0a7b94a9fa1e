"""The truth behind a simulated recording: what an identification is to be measured against."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

from penode.arrays import FloatArray
from penode.bench.coenergy_table import true_flux_map
from penode.bench.drive import Drive
from penode.bench.machines import Machine
from penode.bench.references import Reference
from penode.bench.shaft import RPM, Speed

#: Version of the dictionary that `truth_of` returns.
SCHEMA = 1


@dataclass(frozen=True, eq=False)
class Trace:
    """True values of the sensors' signals at the sampling instants."""

    # Terminal i_d and i_q (time, 2), A, in the true rotor frame.
    current: FloatArray
    # Electrical, within one mechanical turn: (time,), rad and rad/s.
    theta_el: FloatArray
    omega_el: FloatArray
    # Of the winding (time,), degC.
    temperature: FloatArray


@dataclass(frozen=True, eq=False)
class Truth:
    """How a recording was made."""

    machine: Machine
    # Everything around it, imperfections included.
    drive: Drive
    # As it was asked for, rpm.
    speed: Speed
    reference: Reference
    # s.
    duration: float
    # Of the noise.
    seed: int
    trace: Trace

    def flux_map(self, i_d: FloatArray, i_q: FloatArray) -> FloatArray:
        """Return the flux linkage a map without angle should find, at the magnets' temperature.

        psi_d and psi_q in Vs, the currents' broadcast shape + (2,); see `true_flux_map`.
        """
        warm = self.drive.magnet_temperature
        change = 0.0 if warm is None else self.machine.magnet_flux_change(warm)
        linkage: FloatArray = true_flux_map(self.machine, i_d, i_q) + np.array([change, 0.0])
        return linkage

    @property
    def phase_resistances(self) -> FloatArray:
        """Resistance of the phases a, b, c in ohm at the run's mean temperature, shape (3,)."""
        mean = self.machine.resistance_at(float(self.trace.temperature.mean()))
        factors = np.array(self.drive.winding.phase_factors or (1.0, 1.0, 1.0))
        return np.asarray(mean * factors, dtype=np.float64)

    @property
    def resistance(self) -> float:
        """Resistance in ohm that an identification should find: the mean of the phases."""
        return float(self.phase_resistances.mean())

    @property
    def mean_speed_rpm(self) -> float:
        """Mean true mechanical speed in revolutions per minute."""
        return float(self.trace.omega_el.mean() / RPM / self.machine.pole_pairs)


def truth_of(truth: Truth) -> dict[str, Any]:
    """Return the truth as what JSON can hold, without the traces.

    Arguments are as they were given; resistances (ohm) are those at the run's mean temperature,
    temperatures [start, end] in degC, ``dead_time_voltage`` dU in V.
    """
    temperature, inverter = truth.trace.temperature, truth.drive.inverter
    lost = 0.0
    if inverter.dead_time is not None:
        lost = truth.drive.dc_voltage * inverter.dead_time.duration / truth.drive.time_step
    as_given = ("machine", "drive", "reference", "speed", "duration", "seed")
    return {
        "schema": SCHEMA,
        **{name: plain(getattr(truth, name)) for name in as_given},
        "resistance": truth.resistance,
        "phase_resistances": truth.phase_resistances.tolist(),
        "temperature": [float(temperature[0]), float(temperature[-1])],
        "mean_speed_rpm": truth.mean_speed_rpm,
        "dead_time_voltage": lost,
        "voltage_delay_samples": inverter.delay,
        "voltage_hold": inverter.hold.frame,
    }


def plain(value: Any) -> Any:
    """Return a value as what JSON can hold.

    Records become their fields beside ``kind``, the name of their class; arrays and tuples
    become lists; what else is no JSON becomes its name.
    """
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if is_dataclass(value) and not isinstance(value, type):
        held = {one.name: plain(getattr(value, one.name)) for one in fields(value)}
        return {"kind": type(value).__name__, **held}
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    return getattr(value, "__qualname__", type(value).__name__)
