"""A flux map as it came: psi on a grid of currents and angles, before anything is fitted to it."""

from dataclasses import dataclass

from penode.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class FluxTable:
    """Flux linkage over a grid of currents, straight or polar, and the electrical angle.

    Currents (row, column) are peak values of a phase in A, angles (angle,) in rad, one for a
    map without angle; psi (row, column, angle) in Vs is NaN where the map has no value.
    """

    name: str
    i_d: FloatArray
    i_q: FloatArray
    theta_el: FloatArray
    psi_d: FloatArray
    psi_q: FloatArray

    @property
    def covered(self) -> BoolArray:
        """Where psi is given at every angle, shape (row, column)."""
        psi = self.psi_d + self.psi_q
        covered: BoolArray = (psi == psi).all(axis=2)
        return covered
