"""Values of a data sheet, for what no recording identifies."""

from dataclasses import dataclass


@dataclass(frozen=True)
class NamePlate:
    """What the data sheet says of a machine; None where it says nothing.

    Attributes
    ----------
    magnet_flux_linkage : float or None
        psi_PM in Vs, peak value of a phase.
    resistance : float or None
        Of one phase in ohm, at the winding's temperature while it was recorded.
    """

    magnet_flux_linkage: float | None = None
    resistance: float | None = None


NO_PLATE = NamePlate()
