"""The report's section on torque: the dq plane with its limits, and torque over speed."""

from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go

from penode.arrays import BoolArray, FloatArray
from penode.fit.fit import Fit
from penode.pmsm.control.controlled_machine import (
    ControlledMachine,
    largest_current,
    voltage_limit_of,
)
from penode.pmsm.control.loci import (
    BEYOND,
    ControlLoci,
    Locus,
    backed_current,
    control_loci,
    voltage_limit_curve,
)
from penode.pmsm.machine.standstill import STANDSTILL, excited_axes
from penode.pmsm.report.flux_sections import current_grid
from penode.report import palette, panels
from penode.report.document import KeyValue, KeyValues, Section, picture
from penode.report.quantities import number, with_unit
from penode.report.region_map import region_maps

_POINTS, _GRID = 24, 121
#: Speeds of the voltage limits that are drawn, over the base speed.
_SPEEDS = (1.0, 1.5, 3.0)
_MTPA, _MTPV = palette.ONE_STEP.light, palette.MARKER_LINE.light
_VOLTAGE, _LIMIT = palette.FREE_RUN.light, palette.INK.light
_STYLES = "Lines are solid where recordings have been and dotted where they are extrapolations."
_NO_LINK = (
    "No voltage of the DC link is known, so no voltage limit is drawn: record u_dc, or write it "
    "into the study file; penode loci --u-max draws it for any voltage."
)


@dataclass(frozen=True, eq=False)
class _Operation:
    """A machine with its loci; without pole pairs torque is that of one, and speed electrical."""

    machine: ControlledMachine
    loci: ControlLoci
    pole_pairs: int | None
    # The largest current that was recorded, A.
    largest: float

    @classmethod
    def of(cls, fit: Fit) -> "_Operation":
        """Return the machine up to the largest current at which recordings back MTPA."""
        pairs = fit.provenance.get("pole_pairs")
        machine = ControlledMachine.of(fit, pairs or 1)
        largest = largest_current(fit)
        limit = backed_current(machine, largest)
        loci = control_loci(machine, limit, voltage_limit_of(fit), _POINTS)
        return cls(machine, loci, pairs, largest)

    @property
    def torque_unit(self) -> str:
        return "Nm" if self.pole_pairs else "Nm per pole pair"

    @property
    def speed_unit(self) -> str:
        return "rpm of the shaft" if self.pole_pairs else "Hz, electrical"

    def speed(self, speed: FloatArray) -> FloatArray:
        """Return speeds, rad/s, as they are shown: mechanical in rpm, electrical in Hz."""
        return speed * (30 / np.pi if self.pole_pairs else 1 / (2 * np.pi))

    @property
    def speeds(self) -> list[tuple[float, str]]:
        """Speeds of the voltage limits that are drawn, rad/s, and as they are shown."""
        base = self.loci.base_speed or 0.0
        shown = [float(self.speed(np.array(ratio * base))) for ratio in _SPEEDS]
        rounded = [shown[0], *(float(f"{one:.2g}") for one in shown[1:])]
        return [(base * one / shown[0], number(one)) for one in rounded]

    @property
    def base_speed(self) -> str:
        """The base speed with its unit."""
        unit = "rpm" if self.pole_pairs else "Hz"
        return f"{self.speeds[0][1]}\N{NO-BREAK SPACE}{unit}"

    @property
    def most_torque(self) -> str:
        """The most torque at the current limit, and where."""
        locus = self.loci.mtpa
        i_d, i_q = (number(one) for one in locus.current[:, -1])
        torque = f"{number(float(locus.torque[-1]))} {self.torque_unit}"
        beyond = "" if locus.supported[-1] else ", an extrapolation"
        return f"{torque} at i_d {i_d} A, i_q {i_q} A{beyond}"


def torque_and_operating_points(fit: Fit) -> Section | None:
    """Return the section on torque; None where the constant of the flux linkage is not known."""
    if fit.provenance.get(STANDSTILL) or not excited_axes(fit).all():
        return None
    operation = _Operation.of(fit)
    loci, limit = operation.loci, operation.loci.voltage_limit
    volts = _NO_LINK
    if limit is not None:
        volts = (
            f"Orange: where the voltage is at {with_unit(limit, 'V')} (peak of a phase, "
            "u_dc over √3), with R and any identified dead time, at the speed written "
            f"beside it in {operation.speed_unit}; at that speed no current outside can be held."
        )
    slow = "" if loci.mtpv.torque.size else ", which is not reached within the current limit"
    figures = [
        picture(
            f"Most torque for the current: {operation.most_torque}",
            f"Torque in {operation.torque_unit} over the currents, averaged over the angle. MTPA: "
            f"most torque for each current; MTPV: most torque for each flux linkage{slow}. The "
            f"circle, {with_unit(loci.current_limit, 'A')}, is as far as recordings back MTPA, and "
            f"the limit here; penode loci --i-max draws another. {volts} {_STYLES} Grey, "
            "outside the dashed outline, no recording has been.",
            torque_plane,
            operation,
            fit,
        )
    ]
    if loci.over_speed is not None:
        figures.append(
            picture(
                f"The torque of {with_unit(loci.current_limit, 'A')} up to {operation.base_speed}",
                "Most torque within the limits of current and voltage, and its mechanical power. "
                f"{_STYLES}",
                torque_over_speed,
                operation,
                loci.over_speed,
            )
        )
    doubt = "" if fit.horizon.answered else "For diagnosis only; the data cannot answer. "
    pairs = (
        ""
        if operation.pole_pairs
        else " The pole pairs are not known, so torque is that of one pole pair: set pole_pairs."
    )
    return Section(
        "Torque and operating points",
        f"{doubt}What the map says of torque and of the currents that a controller asks for, "
        f"before friction and iron losses.{pairs}",
        [_key_values(operation), *figures],
    )


def _key_values(operation: _Operation) -> KeyValues:
    loci = operation.loci
    torque, backed = float(loci.mtpa.torque[-1]), bool(loci.mtpa.supported[-1])
    current = float(np.hypot(*loci.characteristic.current)[0])
    most = BEYOND * operation.largest
    far = "an extrapolation" if current <= most else "1.5 times the largest recorded"
    short, near = bool(loci.characteristic.supported[0]), bool(current <= most)
    each = "" if operation.pole_pairs else "per pole pair, "
    reach = "as far as recordings back MTPA" if backed else "an extrapolation"
    items = [
        KeyValue(
            "Most torque, MTPA",
            f"{number(torque)}\N{NO-BREAK SPACE}Nm",
            f"{each}at {with_unit(loci.current_limit, 'A')}, {reach}",
            torque,
            not backed,
        ),
        KeyValue(
            "Characteristic current",
            with_unit(current, "A") if near else f"more than {with_unit(most, 'A')}",
            f"steady short circuit at high speed{'' if short else f', {far}'}",
            current if near else None,
        ),
    ]
    if loci.base_speed is not None and loci.voltage_limit is not None:
        rest = (
            f"where the voltage of {with_unit(loci.current_limit, 'A')} on MTPA is "
            f"{with_unit(loci.voltage_limit, 'V')}"
        )
        rest += ", of the shaft" if operation.pole_pairs else ", electrical"
        items.append(KeyValue("Base speed", operation.base_speed, rest, loci.base_speed))
    return KeyValues(tuple(items))


def torque_plane(operation: _Operation, fit: Fit) -> go.Figure:
    """Draw torque over the currents with MTPA, MTPV, the current circle and voltage limits."""
    grid, loci, machine = current_grid(fit, _GRID), operation.loci, operation.machine
    mesh = np.stack(grid.mesh)
    torque = machine.torque(mesh.reshape(2, -1)).reshape(mesh.shape[1:])
    title = f"<b>Torque</b> in {operation.torque_unit}"
    figure = region_maps(grid, [title], torque[None], "Nm")
    figure.update_traces(showlegend=False)
    angle = np.linspace(-np.pi, np.pi, 181)
    circle = loci.current_limit * np.stack([np.cos(angle), np.sin(angle)])
    _draw(figure, "current limit", (_LIMIT, 1.2), circle, machine.supported(circle.T))
    if loci.base_speed is not None and loci.voltage_limit is not None:
        for speed, shown in operation.speeds:
            curve = voltage_limit_curve(machine, speed, loci.voltage_limit, loci.current_limit)
            _draw(
                figure,
                f"voltage limit, {operation.speed_unit}",
                (_VOLTAGE, 1.6),
                curve.current,
                curve.supported,
            )
            _label(figure, curve.current, shown)
    for name, colour, locus in (("MTPA", _MTPA, loci.mtpa), ("MTPV", _MTPV, loci.mtpv)):
        if locus.torque.size:
            _draw(figure, name, (colour, 2.6), locus.current, locus.supported)
    return _with_legend(figure)


def torque_over_speed(operation: _Operation, locus: Locus) -> go.Figure:
    """Draw the most torque of a locus over the speed, and the mechanical power below it."""
    assert locus.speed is not None
    figure = panels.panelled(panels.Grid([1.0], [210.0, 150.0], gaps=[26.0]))
    speed, power = operation.speed(locus.speed), 1e-3 * locus.torque * locus.speed
    for row, (values, unit) in enumerate(((locus.torque, "Nm"), (power, "kW")), 1):
        at = np.stack([speed, values])
        _draw(figure, "most torque", (_MTPA, 2.2), at, locus.supported, row)
        name = "torque" if row == 1 else "power"
        figure.update_yaxes(title_text=f"{name} in {unit}", rangemode="tozero", row=row)
    figure.update_xaxes(title_text=f"speed in {operation.speed_unit}", row=2)
    figure.update_xaxes(range=[0.0, float(speed.max())])
    return figure.update_layout(showlegend=False)


def _draw(
    figure: go.Figure,
    name: str,
    look: tuple[str, float],
    at: FloatArray,
    supported: BoolArray,
    row: int = 1,
) -> None:
    """Draw a line of points (2, point), dotted, and over it solid where recordings have been."""
    colour, width = look
    first = name not in {trace.name for trace in figure.data}
    for dash, y in (("dot", at[1]), ("solid", np.where(supported, at[1], np.nan))):
        figure.add_scatter(
            x=at[0],
            y=y,
            mode="lines",
            name=name,
            legendgroup=name,
            showlegend=first and dash == "solid",
            line={"color": colour, "width": width, "dash": dash},
            hovertemplate="%{x:.4~g}, %{y:.4~g}",
            row=row,
            col=1,
        )


def _label(figure: go.Figure, current: FloatArray, text: str) -> None:
    """Write beside the point of a curve, (2, point), that has the most i_d."""
    if np.isfinite(current).any():
        i_d, i_q = current[:, int(np.nanargmax(current[0]))]
        figure.add_scatter(
            x=[i_d],
            y=[i_q],
            text=[f"<b>{text}</b>"],
            mode="text",
            textposition="bottom right",
            textfont={"color": _VOLTAGE, "size": 12, "shadow": palette.HALO.light},
            hoverinfo="skip",
            showlegend=False,
        )


def _with_legend(figure: go.Figure) -> go.Figure:
    """Make room for the legend above the title of the panel, two rows of it on narrow pages."""
    narrow = figure.layout.meta["narrow"]
    top, narrow_top = 62, 106
    height = figure.layout.height + top - panels.MARGIN["t"]
    narrow = {
        **narrow,
        "height": narrow["height"] + narrow_top - panels.MARGIN["t"],
        "margin": {**panels.MARGIN, "t": narrow_top},
    }
    return figure.update_layout(
        showlegend=True, height=height, margin={"t": top}, meta={"narrow": narrow}
    )
