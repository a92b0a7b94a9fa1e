"""Machines drawn at random over decades of resistance, inductance and frequency."""

import ctypes
from dataclasses import dataclass, replace

import numpy as np

from validate.sampled_drive.library import ORDERS, Jet, MachineRecord, plant

#: Smallest and largest resistance in ohm, and inductance in H, of a machine that is drawn.
RESISTANCES, INDUCTANCES = (3e-3, 10.0), (20e-6, 50e-3)


@dataclass(frozen=True)
class Machine:
    """A synchronous machine, what `plant.c` computes with and what its drive needs to know.

    Attributes
    ----------
    resistance : float
        Of a phase, in ohm.
    pole_pairs : int
    rated_current, rated_voltage : float
        Amplitudes, in A and V; the link has twice the voltage.
    base_speed : float
        Electrical, in rad/s.
    iron : dict of str to float
        Entries of `MachineRecord` but the resistance: inductances in H, currents in A, the
        magnet in Vs.
    harmonics : ndarray, shape (orders, 5)
        Order and the amplitudes a, b, c, d in Vs.
    """

    resistance: float
    pole_pairs: int
    rated_current: float
    rated_voltage: float
    base_speed: float
    iron: dict[str, float]
    harmonics: np.ndarray

    def record(self) -> MachineRecord:
        """Return the machine as the plant reads it."""
        record = MachineRecord(resistance=self.resistance, **self.iron)
        for n, row in enumerate(self.harmonics[:ORDERS]):
            for name, value in zip(("order", "a", "b", "c", "d"), row, strict=True):
                getattr(record, name)[n] = float(value)
        return record

    def jet(self, i_d: float, i_q: float, angle: float = 0.0) -> dict[str, float]:
        """Return coenergy, fluxes, inductances and their slopes in the angle."""
        jet = Jet()
        plant().machine_jet(self.record(), i_d, i_q, angle, ctypes.byref(jet))
        return {name: getattr(jet, name) for name, _ in Jet._fields_}

    def flux(self, current: complex) -> complex:
        """Return psi_d + j psi_q in Vs at a current in A, without harmonics of the angle."""
        still = replace(self, harmonics=self.harmonics[:0])
        jet = still.jet(current.real, current.imag)
        return complex(jet["psi_d"], jet["psi_q"])


def draw_machine(
    random: np.random.Generator, *, harmonics: float = 0.004, skewed: bool = False, **fixed: float
) -> Machine:
    """Return a machine by per-unit values that are drawn.

    Parameters
    ----------
    random : numpy.random.Generator
    harmonics : float
        Amplitude of order 6 as a fraction of the magnet's flux linkage; 12 and 18 have 0.5 and
        0.3 of it.
    skewed : bool
        Whether the harmonics lack the mirror symmetry of a machine without skew.
    **fixed : float
        ``resistance`` (ohm), ``voltage`` (V), ``current`` (A), ``frequency`` (Hz), ``reactance``
        (per unit) and ``pole_pairs`` that are not drawn.
    """
    for _ in range(1000):
        machine = _drawn(random, fixed, harmonics, skewed)
        inductance = machine.jet(0.0, 0.0)
        low, high = min(inductance["l_dd"], inductance["l_qq"]), inductance["l_qq"]
        inside = INDUCTANCES[0] <= low and high <= INDUCTANCES[1]
        if fixed or (inside and RESISTANCES[0] <= machine.resistance <= RESISTANCES[1]):
            return machine
    raise RuntimeError(f"no machine with {fixed} in 1000 draws.")


def _drawn(
    random: np.random.Generator, fixed: dict[str, float], harmonics: float, skewed: bool
) -> Machine:
    def log_uniform(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    voltage, current = log_uniform(15, 400), log_uniform(5, 600)
    frequency, pole_pairs = log_uniform(40, 250), int(random.integers(2, 9))
    reactance, saliency = random.uniform(0.15, 0.45), random.uniform(1.0, 2.5)
    voltage, current = fixed.get("voltage", voltage), fixed.get("current", current)
    base = 2 * np.pi * fixed.get("frequency", frequency)
    reactance = fixed.get("reactance", reactance)
    resistance = fixed.get("resistance", random.uniform(0.01, 0.06) * voltage / current)
    l_d = reactance * voltage / current / base
    l_q, part_d, part_q = saliency * l_d, random.dirichlet([4] * 3), random.dirichlet([4] * 3)
    iron = {
        "leak_d": part_d[0] * l_d,
        "own_d": part_d[1] * l_d,
        "shared": part_d[2] * l_d,
        "leak_q": part_q[0] * l_q,
        "own_q": part_q[1] * l_q,
        "ratio": float(np.sqrt(part_q[2] * l_q / (part_d[2] * l_d))),
        "knee_d": current * random.uniform(0.8, 2.0),
        "knee_q": current * random.uniform(0.5, 1.2),
        "knee_s": current * random.uniform(0.8, 2.0),
        "magnet_current": current * random.uniform(0.1, 0.8),
        "bend": 0.5 / current,
        "iron_conductance": 0.0,
    }
    linkage = random.uniform(0.4, 0.7) * voltage / base
    blank = Machine(
        float(resistance),
        int(fixed.get("pole_pairs", pole_pairs)),
        current,
        voltage,
        base,
        {**iron, "magnet": 0.0},
        np.zeros((0, 5)),
    )
    iron["magnet"] = linkage - blank.flux(0j).real
    return replace(blank, iron=iron, harmonics=_harmonics(random, harmonics * linkage, skewed))


def _harmonics(random: np.random.Generator, amplitude: float, skewed: bool) -> np.ndarray:
    """Return orders 6, 12, 18; C even and D odd in the angle unless skewed."""
    rows = []
    for order, part in ((6, 1.0), (12, 0.5), (18, 0.3)):
        phase_c, phase_d = random.uniform(0, 2 * np.pi, 2) if skewed else (0.0, np.pi / 2)
        sign = random.choice((-1, 1), 2) * amplitude * part
        c, d = sign[0] * np.exp(1j * phase_c), sign[1] * np.exp(1j * phase_d)
        rows.append((order, c.real, c.imag, d.real, d.imag))
    return np.array(rows)
