"""The machines that are simulated, by what their drives need to know of them."""

from dataclasses import dataclass

MOTULATOR, GEM = "motulator", "gym-electric-motor"


@dataclass(frozen=True)
class Machine:
    """A machine of a simulator; its flux map is the simulator's affair.

    Attributes
    ----------
    name, simulator : str
    resistance : float
        Of a phase, in ohm.
    pole_pairs : int
    current : float
        Amplitude up to which it is driven, in A.
    base_rpm : float
        Speed of the shaft that the fractions of a kind refer to.
    link_voltage : float
        In V.
    """

    name: str
    simulator: str
    resistance: float
    pole_pairs: int
    current: float
    base_rpm: float
    link_voltage: float


MACHINES = {
    machine.name: machine
    for machine in (
        Machine("IPM 2.2 kW", MOTULATOR, 3.6, 3, 6.0, 1500.0, 540.0),
        Machine("THOR PM-SyRM 5.1 kW", MOTULATOR, 0.2, 2, 22.0, 2550.0, 310.0),
        Machine("SyRM 6.7 kW", MOTULATOR, 0.54, 2, 20.0, 2000.0, 540.0),
        Machine("PM-SyRM 5.6 kW", MOTULATOR, 0.63, 2, 12.0, 1400.0, 540.0),
        Machine("IPM 50 kW", GEM, 0.018, 3, 200.0, 1500.0, 400.0),
        Machine("SPM servo 0.4 ohm", GEM, 0.4, 4, 20.0, 2500.0, 300.0),
        Machine("SynRM 0.57 ohm", GEM, 0.57, 4, 10.0, 1500.0, 200.0),
    )
}
