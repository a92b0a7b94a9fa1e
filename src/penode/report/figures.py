"""Figures any identification has: a parameter over the horizons, predictions, what is left over."""

from penode.report.correlations import correlations
from penode.report.ladder import parameter_over_ladder
from penode.report.overlay import overlay
from penode.report.spectrum import residual_spectrum

__all__ = ["correlations", "overlay", "parameter_over_ladder", "residual_spectrum"]
