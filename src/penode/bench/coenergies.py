"""Closed forms of a machine's coenergy W(i_d, i_q, theta_el), J, of currents in A and rad.

Neither is a sum of hyperbolic functions of linear combinations of the currents, so a map learned in
that class has no exact copy of the truth.
"""

import math
from dataclasses import dataclass

import jax.numpy as jnp

from penode.arrays import JaxArray


@dataclass(frozen=True)
class SaturatingCoenergy:
    """Coenergy of a saturating interior-magnet machine with 6th and 12th harmonics.

    With the magnet as a current ``i_f`` in the d axis, the iron that both axes share saturates with
    the norm of the total excitation, the q axis has iron of its own, q current takes a little d
    flux away, and the slots modulate the rest::

        W =   psi_0 i_d + (L_d i_d^2 + L_q i_q^2) / 2
            + psi_s a sqrt(1 + ((i_d + i_f)/a)^2 + (i_q/b)^2)
            + psi_t c sqrt(1 + (i_q/c)^2)
            - psi_x i_d (i_q/e)^2 / (1 + (i_q/e)^2)
            + sqrt(1 + (i_d^2 + i_q^2)/i_h^2) sum_n (d_n i_d cos n theta + q_n i_q sin n theta)

    The mirror symmetry ``W(i_d, -i_q, -theta) = W(i_d, i_q, theta)`` of a machine without skew
    holds term by term, and ``W(0, 0, theta)`` is constant (no cogging torque).
    """

    # psi_0, the part of the magnet's flux linkage outside the saturating iron, Vs.
    magnet_flux: float
    # L_d and L_q, which stay under saturation, H.
    leakage_d: float
    leakage_q: float
    # psi_s, the saturation flux linkage of the iron shared by both axes, Vs.
    shared_flux: float
    # a and b, the currents at which the shared iron saturates, A.
    shared_current_d: float
    shared_current_q: float
    # i_f, A.
    magnet_current: float
    # psi_t, Vs, and c, A, of the q axis' own iron.
    own_flux: float
    own_current: float
    # psi_x, Vs, the d flux linkage lost under q current, and e, A, where it is lost.
    cross_flux: float
    cross_current: float
    # (n, d_n, q_n): order of the angle, a multiple of 6, and amplitudes at no current, Vs.
    harmonics: tuple[tuple[int, float, float], ...]
    # i_h, at which the harmonics have grown by 40 to 110 %, A.
    harmonic_current: float

    def __call__(self, i_d: JaxArray, i_q: JaxArray, theta_el: JaxArray) -> JaxArray:
        """Return the coenergy, of the shape to which the arguments broadcast."""
        x = (i_d + self.magnet_current) / self.shared_current_d
        y = i_q / self.shared_current_q
        shared = self.shared_flux * self.shared_current_d * jnp.sqrt(1 + x**2 + y**2)
        own = self.own_flux * self.own_current * jnp.sqrt(1 + (i_q / self.own_current) ** 2)
        z = (i_q / self.cross_current) ** 2
        lost = self.cross_flux * i_d * z / (1 + z)
        linear = self.magnet_flux * i_d + (self.leakage_d * i_d**2 + self.leakage_q * i_q**2) / 2
        growth = jnp.sqrt(1 + (i_d**2 + i_q**2) / self.harmonic_current**2)
        slots = sum(
            d * i_d * jnp.cos(n * theta_el) + q * i_q * jnp.sin(n * theta_el)
            for n, d, q in self.harmonics
        )
        return linear + shared + own - lost + growth * slots


@dataclass(frozen=True)
class HarmonicCoenergy:
    """Coenergy as a table of terms whose harmonics turn with the excitation of the stator.

    With the magnet as a current ``i_f`` in the d axis and the total excitation saturating at
    ``I``::

        x = (i_d + i_f) / I,    y = i_q / I,    rho = sqrt(1 + x^2 + y^2),    v = (x + j y) / rho
        W = (L_d i_d^2 + L_q i_q^2) / 2
            + I sum c |v|^(2k) rho Re(v^m exp(j n theta))         over the terms (n, m, k, c)

    v is the direction of the excitation, of length 0 to 1 as the iron saturates; ``v^m e^(jn
    theta)`` with m = n depends on the excitation's direction against the stator's teeth alone,
    which is why few terms near m = n carry order n. Away from the origin psi tends to
    ``L i + const(direction)``, so the machine saturates sanely outside the map it was fitted to.
    The mirror symmetry ``W(i_d, -i_q, -theta) = W(i_d, i_q, theta)`` of a machine without skew
    holds term by term. Harmonics of W without current are taken off: there is no cogging torque.
    """

    # I, at which the iron saturates, A.
    scale_current: float
    # i_f, A.
    magnet_current: float
    # L_d and L_q, H.
    leakage_d: float
    leakage_q: float
    # (n, m, k, c): order of the angle, powers of v and of its squared length, flux linkage in Vs.
    terms: tuple[tuple[int, int, int, float], ...]

    @property
    def orders(self) -> tuple[int, ...]:
        """The harmonics of the electrical angle, ascending, without the mean."""
        return tuple(sorted({n for n, _, _, _ in self.terms} - {0}))

    def __call__(self, i_d: JaxArray, i_q: JaxArray, theta_el: JaxArray) -> JaxArray:
        """Return the coenergy, of the shape to which the arguments broadcast."""
        x = (i_d + self.magnet_current) / self.scale_current
        y = i_q / self.scale_current
        rho = jnp.sqrt(1 + x**2 + y**2)
        v = _powers((x + 1j * y) / rho, max(m for _, m, _, _ in self.terms))
        square = _powers((x**2 + y**2) / rho**2, max(k for _, _, k, _ in self.terms))
        total = (self.leakage_d * i_d**2 + self.leakage_q * i_q**2) / (2 * self.scale_current)
        for order in (0, *self.orders):
            terms = [(m, k, c) for n, m, k, c in self.terms if n == order]
            wave = rho * sum(c * square[k] * v[m] for m, k, c in terms)
            if order:
                wave = (wave - self._at_rest(order)) * jnp.exp(1j * order * theta_el)
            total = total + wave.real
        return self.scale_current * total

    def _at_rest(self, order: int) -> float:
        """Return the amplitude of one order of W / I without current in Vs."""
        x = self.magnet_current / self.scale_current
        rho = math.hypot(1.0, x)
        v = x / rho
        return rho * sum(c * v ** (m + 2 * k) for n, m, k, c in self.terms if n == order)


def _powers(base: JaxArray, highest: int) -> list[JaxArray]:
    """Return the powers 0 to highest, each from the one before: quicker to compile than ``**``."""
    powers = [jnp.ones_like(base)]
    for _ in range(highest):
        powers.append(powers[-1] * base)
    return powers
