"""A reluctance machine at standstill with voltages that flip when a current reaches its limit.

Simulated by itself, apart from the bench, whose drive follows currents.
"""

from dataclasses import dataclass

import numpy as np

from penode.data.experiment import Experiment

TIME_STEP, SUBSTEPS = 1e-4, 4


@dataclass(frozen=True)
class Reluctance:
    """psi = L i + grad sqrt(1 + (i_d / a)^2 + (i_q / b)^2) A, with R and a loss in the iron."""

    resistance: float = 10.0
    leakage: float = 0.05
    knee: tuple[float, float] = (2.0, 3.0)
    energy: float = 2.4
    #: Conductance parallel to the induced voltage, S.
    iron: float = 0.0

    def flux(self, current):
        """Return psi in Vs of currents (..., 2) in A."""
        scaled = current / np.square(self.knee)
        root = np.sqrt(1.0 + np.sum(current * scaled, axis=-1, keepdims=True))
        return self.leakage * current + self.energy * scaled / root

    def inductance(self, current):
        """Return d psi / d i (2, 2) in H at currents (2,) in A."""
        scaled = current / np.square(self.knee)
        root = np.sqrt(1.0 + current @ scaled)
        bend = np.diag(1.0 / np.square(self.knee)) / root - np.outer(scaled, scaled) / root**3
        return self.leakage * np.eye(2) + self.energy * bend

    def measured(self, magnetising, voltage):
        """Return the current that is measured, A: the iron's share is added."""
        return (magnetising + self.iron * voltage) / (1.0 + self.iron * self.resistance)


def injected(name, amplitude, delay=3, samples=500, machine=None, angle=0.0, noise=0.005, seed=0):
    """Return a log whose voltages of +-amplitude (2,), V, act some samples after their rows.

    They flip at 4.5 A. The log's d axis lies behind that of the machine by `angle`, rad; an axis
    without voltage is exactly zero.
    """
    machine, amplitude = machine or Reluctance(), np.asarray(amplitude, float)
    sign, current = np.ones(2), np.zeros(2)
    waiting = [np.zeros(2)] * delay
    rows, step = [], TIME_STEP / SUBSTEPS
    for _ in range(samples):
        measured = machine.measured(current, waiting[0] if delay else sign * amplitude)
        sign = np.where(measured * sign > 4.5, -sign, sign)
        asked = sign * amplitude
        rows.append((asked, measured))
        acting, *waiting = [*waiting, asked]

        def slope(i, u=acting):
            induced = u - machine.resistance * machine.measured(i, u)
            return np.linalg.solve(machine.inductance(i), induced)

        for _ in range(SUBSTEPS):
            half = current + 0.5 * step * slope(current)
            current = current + step * slope(half)
    voltage, current = (np.array(part) @ [1.0, 1j] for part in zip(*rows, strict=True))
    white = np.random.default_rng(seed).normal(0.0, noise, (2, samples))
    current = current + (white[0] * (amplitude[0] > 0) + 1j * white[1] * (amplitude[1] > 0))
    ahead = np.exp(1j * angle)
    channels = {"omega_el": np.zeros(samples)}
    for kind, vector in (("u", voltage * ahead), ("i", current * ahead)):
        channels |= {f"{kind}_d": vector.real, f"{kind}_q": vector.imag}
    return Experiment(name, TIME_STEP, channels)


def one_axis_a_file(**changed):
    """Return what a commissioning test leaves: d alone, q alone."""
    return [
        injected("d.csv", (130.0, 0.0), **{"seed": 1, **changed}),
        injected("q.csv", (0.0, 100.0), **{"seed": 2, **changed}),
    ]
