"""The paper: its studies on the simulated bench, the methods beside them, a forecast of the bias.

A selector of the horizon
    `Spectral`, and the `BiasForecast` that it chooses by.

`penode reproduce` rebuilds the studies. Nothing else of penode imports this package.
"""

from penode.paper.spectral import BiasForecast, Spectral

__all__ = ["BiasForecast", "Spectral"]


def __dir__() -> list[str]:
    return sorted(__all__)
