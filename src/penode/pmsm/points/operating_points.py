"""A table of operating points: read, and checked before any fit."""

from collections.abc import Sequence
from dataclasses import astuple
from pathlib import Path

import numpy as np

from penode.data.experiment import Experiment, Source
from penode.data.load import read
from penode.data.mapping import Origin, si_values
from penode.data.table import TIME, Table
from penode.errors import InputError
from penode.pmsm.machine.space_vectors import CURRENTS
from penode.pmsm.machine.terms import SPEED
from penode.pmsm.recording.drive_mapping import MAPPED, TIME_STEP, DriveMapping

#: Fewest points, and slowest speed in rad/s at which a voltage shows the flux linkage.
FEWEST, _STANDSTILL = 8, 1e-3
#: From so many rows on they are looked at as samples, which change by less than this part of their
#: range from one to the next.
_MANY, _STEP = 200, 0.02


def load_runs(
    paths: Sequence[Path], mapping: DriveMapping
) -> tuple[list[Experiment], Experiment | None]:
    """Load files that are all recordings, or all tables of operating points.

    Parameters
    ----------
    paths : sequence of Path
    mapping : DriveMapping
        Where the channels come from.

    Returns
    -------
    list of Experiment
        Recordings, or the stretches of them.
    Experiment or None
        The operating points of all tables, those of the first in front.

    Raises
    ------
    InputError
        If a table of points is given beside a recording, a table is given twice or has other
        channels than the first, or as the loaders say.
    """
    recordings: list[Experiment] = []
    tables: list[Experiment] = []
    for path in paths:
        table, source = read(path)
        own = mapping.suited(table)
        if own.is_table_of_points(table):
            tables.append(points_of(path, own, table, source))
        else:
            recordings += own.stretches_of(path, table, source)
    if tables and recordings:
        raise InputError(
            f"{tables[0].name}: a table of operating points (no column {TIME}) must stand beside "
            f"other tables only, got it with {recordings[0].name}; beside recordings give it with "
            "--points."
        )
    return recordings, _joined(tables) if tables else None


def _joined(tables: Sequence[Experiment]) -> Experiment:
    """Return the points of all tables."""
    first, *others = tables
    if not others:
        return first
    for k, other in enumerate(others, 1):
        if other.source.sha256 in [one.source.sha256 for one in tables[:k]]:
            raise InputError(f"{other.name}: operating points must be given once; remove a copy.")
        if apart := sorted(set(first.channels) ^ set(other.channels)):
            raise InputError(
                f"{other.name}: columns must be those of {first.name}, got {apart[0]} in one of "
                "them alone; add it to the other, or remove it."
            )
    channels = {n: np.concatenate([one.channels[n] for one in tables]) for n in first.channels}
    files = [one.source for one in tables]
    source = Source(*(", ".join(each) for each in zip(*map(astuple, files), strict=True)))
    return Experiment(", ".join(one.name for one in tables), 1.0, channels, source)


def points_of(path: str | Path, mapping: DriveMapping, table: Table, source: Source) -> Experiment:
    """Make operating points of the columns of a file.

    Parameters
    ----------
    path : str or Path
        For messages.
    mapping : DriveMapping
        Where the channels come from.
    table : Table
    source : Source

    Returns
    -------
    Experiment
        A sample a point, SI units; its time step means nothing.

    Raises
    ------
    InputError
        If a cell is no number, there are fewer than 8 points, none of them turns, or the rows are
        samples of a recording whose time is missing.
    """
    origins = {
        name: mapping.channels[name].origin if name in mapping.channels else Origin(name, si)
        for name, si in MAPPED.items()
        if name != TIME
    }
    present = {n: o for n, o in origins.items() if o.column in table.columns}
    channels = {
        name: mapping.scaled(name, si_values(str(path), table, name, origin)[0])
        for name, origin in present.items()
    }
    points = Experiment(Path(path).name, 1.0, channels, source)
    if len(points) < FEWEST:
        raise InputError(
            f"{path}: operating points must be >= {FEWEST}, got {len(points)}; measure points over "
            "the plane of currents."
        )
    if np.abs(points.channels[SPEED.name]).max() < _STANDSTILL:
        raise InputError(
            f"{path}: {SPEED.name} must differ from 0 at some point, got 0 at all of "
            f"{len(points)}; voltages at rest show R alone, and nothing of the flux linkage."
        )
    currents = points.stack(CURRENTS)
    span = max(float(np.ptp(currents, axis=0).max()), 1e-300)
    step = float(np.median(np.hypot(*np.diff(currents, axis=0).T))) / span
    if len(points) >= _MANY and step < _STEP:
        raise InputError(
            f"{path}: no column {TIME}, and {len(points)} rows that follow each other like "
            f"samples: the currents change by {100 * step:.2g} % of their range from row to "
            f"row; map the column of {TIME} of a recording in a study file, or give {TIME_STEP} "
            "there, in s; or give operating points in any order."
        )
    return points
