"""Flux maps: flux linkage and differential inductance as functions of the dq currents."""

from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx

from penode.arrays import JaxArray
from penode.models.networks import ConvexGradient, TanhLayers


class FluxMap(eqx.Module):
    """A network between scaled currents and scaled flux linkages.

    Attributes
    ----------
    network : TanhLayers or ConvexGradient
        Dimensionless map from 2 inputs to 2 outputs with its Jacobian.
    current_scale : float
        A (peak) for one unit of the network's input.
    flux_scale : float
        Vs for one unit of the network's output.
    """

    network: TanhLayers | ConvexGradient
    current_scale: float = eqx.field(static=True)
    flux_scale: float = eqx.field(static=True)

    def flux_and_inductance(self, currents: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return psi (2, batch) in Vs and L = d psi / d i (2, 2, batch) in H.

        Parameters
        ----------
        currents : array, shape (2, batch)
            i_d and i_q in A (peak).
        """
        value, jacobian = self.network.value_and_jacobian(currents / self.current_scale)
        return self.flux_scale * value, self.flux_scale / self.current_scale * jacobian


@dataclass(frozen=True)
class FluxMapKind:
    """A family of flux maps a user can name.

    Attributes
    ----------
    draw : callable
        ``draw(seed)`` gives an untrained network.
    reciprocal : bool
        Whether d psi_d / d i_q = d psi_q / d i_d holds by construction. A map without it can
        absorb a wrong resistance at constant speed (the gauge).
    """

    draw: Callable[[int], TanhLayers | ConvexGradient]
    reciprocal: bool


#: To add a family, add one entry; its network needs `value_and_jacobian`.
FLUX_MAPS: dict[str, FluxMapKind] = {
    "coenergy": FluxMapKind(lambda seed: ConvexGradient.random(2, 12, seed), reciprocal=True),
    "mlp": FluxMapKind(lambda seed: TanhLayers.random((2, 6, 4, 2), seed), reciprocal=False),
}
