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

from penode.arrays import FloatArray, JaxArray, float64
from penode.bench.coenergies import SaturatingCoenergy
from penode.bench.fitted_coenergies import BRUSA_HSM1, COMSOL_IPM, EV400V
from penode.errors import InputError

Coenergy: TypeAlias = Callable[[JaxArray, JaxArray, JaxArray], JaxArray]


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
    dc_voltage : float
        Voltage of the dc link that the machine is wound for in V.
    maximum_speed_rpm : float
        Largest mechanical speed in revolutions per minute.
    reference_temperature : float
        Temperature in degC of winding and magnets at which all values here hold.
    copper_coefficient : float
        Relative change of the resistance per K of winding temperature.
    magnet_coefficient : float
        Relative change of psi_PM per K of magnet temperature.
    inertia : float or None
        Moment of inertia of the rotor in kg m^2; None where it is not known.
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
    dc_voltage: float = 400.0
    maximum_speed_rpm: float = 12_000.0
    reference_temperature: float = 20.0
    copper_coefficient: float = 3.93e-3
    magnet_coefficient: float = -1.1e-3
    inertia: float | None = None

    def resistance_at(self, temperature: float) -> float:
        """Return the resistance of one phase in ohm at a winding temperature in degC."""
        return self.resistance * (
            1 + self.copper_coefficient * (temperature - self.reference_temperature)
        )

    def magnet_flux_change(self, temperature: float) -> float:
        """Return what psi_PM gains in Vs (loses, when negative) at a magnet temperature in degC.

        Adding it to psi_d at all currents adds a term linear in i_d to the coenergy, so L and
        reciprocity stay as they are.
        """
        warming = temperature - self.reference_temperature
        return self.magnet_coefficient * warming * self.magnet_flux_linkage


def torque(machine: Machine, i_d: FloatArray, i_q: FloatArray, theta_el: FloatArray) -> FloatArray:
    """Return the air-gap torque (time,), Nm, positive when it drives the rotor forward.

    ``3/2 p (psi_d i_q - psi_q i_d + dW/dtheta)`` of currents in A and the electrical angle in rad,
    (time,) each.
    """
    gradient = jax.grad(machine.coenergy, argnums=(0, 1, 2))
    with float64():
        arguments = [jnp.asarray(value) for value in (i_d, i_q, theta_el)]
        psi_d, psi_q, slope = map(np.asarray, jax.jit(jax.vmap(gradient))(*arguments))
    newton_metres: FloatArray = 1.5 * machine.pole_pairs * (psi_d * i_q - psi_q * i_d + slope)
    return newton_metres


#: An interior-magnet traction machine for 400 V and 300 A, with saturation, cross saturation, a
#: 6th harmonic of 1 % and a 12th of 0.4 % of psi_PM at no current. Invented.
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

#: The paper-like machine: fitted to an angle-resolved FEM map, harmonics included. The resistance
#: is assumed.
COMSOL_300A = Machine(
    name="comsol_300A",
    resistance=10e-3,
    pole_pairs=5,
    current_limit=300.0,
    magnet_flux_linkage=47.4e-3,
    inductance_d=114e-6,
    inductance_q=150e-6,
    angle_orders=COMSOL_IPM.orders,
    coenergy=COMSOL_IPM,
)

#: An 85 kW traction motor, fitted to its measured map; harmonics and temperature coefficients are
#: assumed.
BRUSA_250A = Machine(
    name="brusa_250A",
    resistance=17.9e-3,
    pole_pairs=3,
    current_limit=250.0,
    magnet_flux_linkage=70.8e-3,
    inductance_d=360e-6,
    inductance_q=850e-6,
    angle_orders=BRUSA_HSM1.orders,
    coenergy=BRUSA_HSM1,
)

#: A low-resistance traction machine at 60 degC, modelled on a FEM map at one rotor angle; the
#: magnet coefficient is the difference to the same source's map at 100 degC.
EV400V_420A = Machine(
    name="ev400v_420A",
    resistance=3.5e-3,
    pole_pairs=4,
    current_limit=420.0,
    magnet_flux_linkage=62.9e-3,
    inductance_d=134e-6,
    inductance_q=280e-6,
    angle_orders=EV400V.orders,
    coenergy=EV400V,
    maximum_speed_rpm=10_000.0,
    reference_temperature=60.0,
    copper_coefficient=3.40e-3,
    magnet_coefficient=-1.5e-3,
)

#: The built-in machines by name.
MACHINES: dict[str, Machine] = {
    built.name: built for built in (TRACTION_300A, COMSOL_300A, BRUSA_250A, EV400V_420A)
}


def machine(name: str) -> Machine:
    """Return a built-in machine by its name, a key of `MACHINES`."""
    if name not in MACHINES:
        raise InputError(
            f"there is no built-in machine {name!r}; choose one of {', '.join(MACHINES)}."
        )
    return MACHINES[name]
