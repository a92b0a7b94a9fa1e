"""One picture of a machine's control loci: the dq plane, and torque and power over speed."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import ndimage

from penode.arrays import FloatArray
from penode.pmsm.control.controlled_machine import ControlledMachine
from penode.pmsm.control.loci import ControlLoci, Locus
from penode.report import palette
from penode.report.png import D_AXIS, Q_AXIS, png

_INK, _MUTED, _VEIL = palette.INK.light, palette.MUTED.light, "#e4e9f0"
_MTPA, _MTPV, _SPEED, _POWER = D_AXIS, palette.MARKER_LINE.light, Q_AXIS, _INK
_PIXELS = 161
#: Current limits within which the characteristic current is drawn.
_NEAR = 1.25
_TO_RPM = 30 / np.pi


def loci_picture(machine: ControlledMachine, loci: ControlLoci, name: str) -> bytes:
    """Return a PNG of control loci.

    Left the dq plane: torque contours, MTPA, MTPV, most torque over speed, grey where no
    recording has been. Right torque and power over speed, or over the current without a voltage
    limit. Loci are dotted where they are extrapolations.
    """
    figure = Figure(figsize=(12, 6), layout="constrained")
    plane, curve = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
    _draw_plane(plane, machine, loci)
    if loci.over_speed is None:
        _draw_over_current(curve, loci)
    else:
        _draw_over_speed(curve, loci, loci.over_speed)
    handles, labels = plane.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower left", ncols=5, fontsize=9, frameon=False)
    return png(figure, (plane, curve), name)


def _draw_plane(axes: Axes, machine: ControlledMachine, loci: ControlLoci) -> None:
    limit = loci.current_limit
    short = float(np.hypot(*loci.characteristic.current)[0])
    near = short <= _NEAR * limit
    axis = max(1.08 * limit, 1.04 * short * near) * np.linspace(-1, 1, _PIXELS)
    mesh = np.stack(np.meshgrid(axis, axis))
    supported = machine.supported(mesh.reshape(2, -1).T).reshape(_PIXELS, _PIXELS)
    smooth = ndimage.gaussian_filter(supported.astype(np.float64), 1.2, mode="nearest")
    axes.contourf(*mesh, smooth, levels=[-1.0, 0.5], colors=[_VEIL])
    torque = np.where(np.hypot(*mesh) <= limit, machine.torque(mesh), np.nan)
    lines = axes.contour(*mesh, torque, levels=9, colors=_MUTED, linewidths=0.7, linestyles="solid")
    axes.clabel(lines, fontsize=7, fmt=lambda level: f"{level:.3g}".replace("-", "−"))
    angle = np.linspace(-np.pi, np.pi, 181)
    axes.plot(
        limit * np.cos(angle), limit * np.sin(angle), color=_INK, lw=0.8, label="current limit"
    )
    named = [(loci.mtpa, _MTPA, "MTPA"), (loci.mtpv, _MTPV, "MTPV")]
    if loci.over_speed is not None:
        named.append((loci.over_speed, _SPEED, "most torque over speed"))
    for locus, colour, label in named:
        if locus.torque.size:
            _draw_locus(axes, locus.current[0], locus.current[1], locus, colour, label)
    if near:
        axes.plot(
            *loci.characteristic.current, "x", color=_INK, ms=7, label="characteristic current"
        )
    axes.set(aspect="equal", xlabel="i_d (A)", ylabel="i_q (A)")
    axes.set_title(
        "Torque in Nm; grey, dotted: no recording has been there", loc="left", fontsize=10
    )


def _draw_over_speed(axes: Axes, loci: ControlLoci, locus: Locus) -> None:
    assert locus.speed is not None
    rpm = locus.speed * _TO_RPM
    _draw_locus(axes, rpm, locus.torque, locus, _SPEED, "torque")
    power = axes.twinx()
    _draw_locus(power, rpm, 1e-3 * locus.torque * locus.speed, locus, _POWER, "power")
    power.set_ylabel("power (kW)", color=_POWER)
    power.spines["top"].set_visible(False)
    axes.set(xlabel="speed (rpm)", xlim=(0, rpm.max()))
    axes.set_ylabel("torque (Nm)", color=_SPEED)
    for one in (axes, power):
        one.set_ylim(0, 1.08 * one.get_ylim()[1])
    title = f"Within {loci.current_limit:.4g} A and {loci.voltage_limit:.4g} V, peak of a phase"
    axes.set_title(title, loc="left", fontsize=10)


def _draw_over_current(axes: Axes, loci: ControlLoci) -> None:
    currents = np.hypot(*loci.mtpa.current)
    _draw_locus(axes, currents, loci.mtpa.torque, loci.mtpa, _MTPA, "MTPA")
    axes.set(xlabel="current (A, peak of a phase)", ylabel="torque (Nm)", xlim=0, ylim=0)
    axes.set_title("Most torque per ampere", loc="left", fontsize=10)


def _draw_locus(
    axes: Axes, x: FloatArray, y: FloatArray, locus: Locus, colour: str, label: str
) -> None:
    """Draw a line, solid where recordings have been and dotted elsewhere."""
    axes.plot(x, y, ":", color=colour, lw=1.8)
    axes.plot(x, np.where(locus.supported, y, np.nan), color=colour, lw=2.2, label=label)
