"""Figures any identification has: a parameter over the horizons, predictions, what is left over."""

from penode.report.ladder import parameter_over_ladder
from penode.report.overlay import overlay
from penode.report.spectrum import residual_spectrum

__all__ = ["overlay", "parameter_over_ladder", "residual_spectrum"]
