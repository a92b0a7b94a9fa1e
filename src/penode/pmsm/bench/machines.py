"""Simulated machines: name-plate values and one coenergy, from which everything else follows.

The coenergy ``W(i_d, i_q, theta_el)`` of the dq frame is the only thing a machine states about its
iron. Its derivatives are the flux linkage, the differential inductance and the torque::

    psi = dW/di,    L = d2W/di2,    T = 3/2 p (psi_d i_q - psi_q i_d + dW/dtheta)

so reciprocity (L symmetric, d psi/d theta = d2W/(di dtheta)) holds because there is no other
way. The factor 3/2 belongs to the amplitude-invariant transform: the coenergy of the three phases
is 3/2 W, and the cross product is what dW/dtheta at constant phase currents adds to dW/dtheta at
constant dq currents.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import FloatArray, JaxArray

Coenergy: TypeAlias = Callable[[JaxArray, JaxArray, JaxArray], JaxArray]


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

    Square roots and quotients on purpose: a map learned as a sum of hyperbolic functions has no
    exact copy of it. The mirror symmetry ``W(i_d, -i_q, -theta) = W(i_d, i_q, theta)`` of a machine
    without skew holds term by term, and ``W(0, 0, theta)`` is constant (no cogging torque).

    Attributes
    ----------
    magnet_flux : float
        psi_0, the part of the magnet's flux linkage outside the saturating iron, in Vs.
    leakage_d, leakage_q : float
        L_d and L_q, the inductances that stay under saturation, in H.
    shared_flux : float
        psi_s, the saturation flux linkage of the iron shared by both axes, in Vs.
    shared_current_d, shared_current_q : float
        a and b, the currents at which the shared iron saturates, in A.
    magnet_current : float
        i_f, the magnet's excitation of the shared iron, in A.
    own_flux, own_current : float
        psi_t in Vs and c in A, saturation flux linkage and current of the q axis' own iron.
    cross_flux, cross_current : float
        psi_x in Vs and e in A, the d flux linkage lost under q current and where it is lost.
    harmonics : tuple of (int, float, float)
        ``(n, d_n, q_n)``: order of the electrical angle (a multiple of 6), and the amplitudes of
        psi_d and psi_q at no current, in Vs.
    harmonic_current : float
        i_h, the current at which the harmonics have grown by 40 to 110 %, in A.
    """

    magnet_flux: float
    leakage_d: float
    leakage_q: float
    shared_flux: float
    shared_current_d: float
    shared_current_q: float
    magnet_current: float
    own_flux: float
    own_current: float
    cross_flux: float
    cross_current: float
    harmonics: tuple[tuple[int, float, float], ...]
    harmonic_current: float

    def __call__(self, i_d: JaxArray, i_q: JaxArray, theta_el: JaxArray) -> JaxArray:
        """Return the coenergy W of the dq frame.

        Parameters
        ----------
        i_d, i_q : array, any shapes that broadcast
            Currents in A.
        theta_el : array
            Electrical angle of the d axis in rad.

        Returns
        -------
        array of the broadcast shape
            Coenergy in J.
        """
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
class Machine:
    """A simulated machine: what its data sheet says, and the iron it really has.

    Attributes
    ----------
    name : str
        Label that recordings and messages carry.
    resistance : float
        Resistance of one phase in ohm.
    pole_pairs : int
        Number of pole pairs p.
    current_limit : float
        Largest permitted current, peak value of a phase, in A.
    magnet_flux_linkage : float
        Data-sheet value of psi_PM in Vs; the mean d flux linkage at no current.
    inductance_d, inductance_q : float
        Data-sheet inductances in H, which a controller is tuned from; the truth saturates.
    angle_orders : tuple of int
        The harmonics of the electrical angle that the coenergy contains, multiples of 6.
    coenergy : callable
        ``W(i_d, i_q, theta_el)`` in J, written with `jax.numpy` so that it can be differentiated,
        and hashable, as functions and frozen records are.
    """

    name: str
    resistance: float
    pole_pairs: int
    current_limit: float
    magnet_flux_linkage: float
    inductance_d: float
    inductance_q: float
    angle_orders: tuple[int, ...]
    coenergy: Coenergy


def torque(machine: Machine, i_d: FloatArray, i_q: FloatArray, theta_el: FloatArray) -> FloatArray:
    """Return the air-gap torque, ``3/2 p (psi_d i_q - psi_q i_d + dW/dtheta)``.

    Parameters
    ----------
    machine : Machine
        The machine.
    i_d, i_q : ndarray, shape (time,)
        Currents in A.
    theta_el : ndarray, shape (time,)
        Electrical angle of the d axis in rad.

    Returns
    -------
    ndarray, shape (time,)
        Torque in Nm, positive when it drives the rotor forward.
    """
    gradient = jax.grad(machine.coenergy, argnums=(0, 1, 2))
    with jax.enable_x64(True):
        arguments = [jnp.asarray(value) for value in (i_d, i_q, theta_el)]
        psi_d, psi_q, slope = map(np.asarray, jax.jit(jax.vmap(gradient))(*arguments))
    newton_metres: FloatArray = 1.5 * machine.pole_pairs * (psi_d * i_q - psi_q * i_d + slope)
    return newton_metres


#: An interior-magnet traction machine for 400 V and 300 A, with saturation, cross saturation, a
#: 6th harmonic of 1 % and a 12th of 0.4 % of psi_PM at no current.

TRACTION_300A = Machine(
    name="traction_300A",
    resistance=10e-3,
    pole_pairs=5,
    current_limit=300.0,
    magnet_flux_linkage=58e-3,
    inductance_d=180e-6,
    inductance_q=450e-6,
    angle_orders=(6, 12),
    coenergy=SaturatingCoenergy(
        magnet_flux=28e-3,
        leakage_d=120e-6,
        leakage_q=140e-6,
        shared_flux=42e-3,
        shared_current_d=250.0,
        shared_current_q=220.0,
        magnet_current=250.0,
        own_flux=34e-3,
        own_current=130.0,
        cross_flux=3e-3,
        cross_current=200.0,
        harmonics=((6, 0.58e-3, -0.46e-3), (12, 0.23e-3, 0.18e-3)),
        harmonic_current=300.0,
    ),
)
