"""Sections of the report of a sweep on machines: resistance, map, and their drift."""

from collections.abc import Sequence

import polars as pl

from penode.pmsm.sweep.drift import Drift, drift_of
from penode.pmsm.sweep.fleet_figures import SINGLED, dates_of, over_dates
from penode.pmsm.sweep.fleet_trust import MOST, counted, cut, mean_of
from penode.report.document import Cell, Figure, Row, Section, Table
from penode.report.quantities import number, with_unit

#: Machine of recordings whose names say none.
UNNAMED = "not named"
_SPACE = "\N{NO-BREAK SPACE}"


class Machine:
    """One machine of a fleet: its rows, those that give an answer, the drifts of R and of psi_d."""

    def __init__(self, name: str, rows: pl.DataFrame):
        self.name, self.rows = name, rows
        self.sound = rows.filter(pl.col("answered"))
        self.drifts = [self._drift(quantity) for quantity in ("R", "psi_d")]

    def _drift(self, quantity: str) -> Drift | None:
        rows = self.sound.filter(pl.col(quantity).is_finite() & pl.col("date").is_not_null())
        return drift_of(dates_of(rows), rows[quantity].to_numpy())

    @property
    def drifting(self) -> bool:
        """Whether one of them is more than scatter."""
        return any(drift is not None and drift.significant for drift in self.drifts)

    @property
    def span(self) -> str:
        """First and last date."""
        dates = self.rows["date"].drop_nulls()
        if not len(dates):
            return "–"
        first, last = str(dates.min()), str(dates.max())
        return first if first == last else f"{first} to {last}"


def resistance(sound: pl.DataFrame, machines: Sequence[Machine]) -> Section:
    """Return the section on R of the rows that give an answer."""
    figure = over_dates(sound, "R", "ohm", ("R_low", "R_high"), _singled(machines))
    rows = [
        _machine_row(one, 0, "R", "ohm") for one in sorted(machines, key=lambda m: m.name)[:MOST]
    ]
    columns = ("machine", "dates", "recordings", "answered", "R", "spread", "change a year")
    return Section(
        "Resistance",
        "R of every recording that gives an answer, with its 95 % interval.",
        [
            Figure(
                _drift_title(machines, 0, "R"),
                "R follows the winding's temperature by 0.39 % a kelvin (copper): compare "
                "recordings of one temperature, or identify the term temperature_resistance.",
                figure,
            ),
            Table(
                "Machines: R",
                columns,
                tuple(rows),
                "Spread: deviation from recording to recording. Change: a line through the "
                f"answers with its 95 % interval, marked where the 99 % interval leaves zero out."
                f"{cut(len(machines))}",
            ),
        ],
    )


def flux_linkage_map(sound: pl.DataFrame, machines: Sequence[Machine]) -> Section:
    """Return the section on the map at one current."""
    lead = (
        "The flux-linkage map at the current that the study file names, zero by default; empty "
        "where a recording does not reach it."
    )
    if not len(sound.filter(pl.col("psi_d").is_finite())):
        return Section("Flux-linkage map", f"{lead} Here none does.", [])
    bands = sound.with_columns(
        (pl.col("psi_d") - 1.96 * pl.col("psi_d_std")).alias("psi_d_low"),
        (pl.col("psi_d") + 1.96 * pl.col("psi_d_std")).alias("psi_d_high"),
    )
    figure = over_dates(bands, "psi_d", "Vs", ("psi_d_low", "psi_d_high"), _singled(machines))
    rows = [
        _machine_row(one, 1, "psi_d", "Vs", inductances=True)
        for one in sorted(machines, key=lambda m: m.name)[:MOST]
    ]
    columns = ("machine", "psi_d", "spread", "psi_q", "L_dd", "L_qq", "change of psi_d a year")
    return Section(
        "Flux-linkage map",
        lead,
        [
            Figure(
                _drift_title(machines, 1, "psi_d"),
                "A magnet loses about 0.1 % of its flux linkage a kelvin (NdFeB); what stays lower "
                "at the same temperature is demagnetisation.",
                figure,
            ),
            Table("Machines: map", columns, tuple(rows), f"Means.{cut(len(machines))}"),
        ],
    )


def _singled(machines: Sequence[Machine]) -> list[str]:
    """Return the machines that are drawn apart: all if they are few, else those that drift."""
    named = [one for one in machines if one.name != UNNAMED]
    few = len(named) <= SINGLED
    return [one.name for one in named if few or one.drifting]


def _drift_title(machines: Sequence[Machine], which: int, name: str) -> str:
    known = [one for one in machines if one.drifts[which]]
    moved = [one for one in known if (d := one.drifts[which]) and d.significant]
    if not known:
        return f"{name} of every recording"
    if not moved:
        return f"{name} drifts in none of {counted(len(known), 'machine')}"
    return f"{name} drifts in {len(moved)} of {counted(len(known), 'machine')}"


def _machine_row(
    machine: Machine, which: int, name: str, unit: str, inductances: bool = False
) -> Row:
    drift, sound = machine.drifts[which], machine.sound
    values = sound[name].drop_nulls().drop_nans()
    mean = mean_of(sound, name)
    std = float(values.std() or 0.0) if len(values) > 1 else None  # type: ignore[arg-type]
    spread = "–" if std is None or not mean else f"{number(100 * std / mean, 2)}{_SPACE}%"
    middle = [Cell(with_unit(mean, unit, 4), mean, "number"), Cell(spread, kind="number")]
    head = [Cell(machine.name)]
    if inductances:
        units = (("psi_q", "Vs"), ("l_dd", "H"), ("l_qq", "H"))
        means = [(mean_of(sound, other), of) for other, of in units]
        middle += [Cell(with_unit(value, of), value, "number") for value, of in means]
    else:
        head += [Cell(machine.span), Cell(str(len(machine.rows)), kind="number")]
        head += [Cell(str(len(sound)), kind="number")]
    mark = "drifts" if drift and drift.significant else ""
    return Row((*head, *middle, Cell(_change(drift), kind="number")), mark)


def _change(drift: Drift | None) -> str:
    if drift is None or not drift.mean:
        return "–"
    slope, half = (100 * part / abs(drift.mean) for part in (drift.per_year, drift.half_95))
    return f"{slope:+.2f} ± {half:.2f}{_SPACE}%".replace("-", "−")
