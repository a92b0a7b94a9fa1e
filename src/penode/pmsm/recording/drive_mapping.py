"""Which columns of a user's file are the channels of a drive, and in what convention."""

import math
from collections import ChainMap
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import cast

import numpy as np

from penode.arrays import FloatArray
from penode.data.experiment import Experiment, Source
from penode.data.gathered import gathered, in_pieces
from penode.data.load import experiments_of, in_one_piece, read
from penode.data.mapping import Origin
from penode.data.table import TIME, Table, list_names
from penode.data.units import unit_name
from penode.errors import InputError
from penode.pmsm.machine.space_vectors import CURRENTS
from penode.pmsm.machine.standstill import TURN, stands_still
from penode.pmsm.machine.terms import ANGLE, SPEED
from penode.pmsm.recording.channels import CANONICAL, missing_channels
from penode.pmsm.recording.stationary_frame import LINK, STATIONARY

#: Channel of a recorded file -> SI unit, the time included.
RECORDED = {TIME: "s", **CANONICAL, **STATIONARY}

#: Torque of the shaft, an output of operating points, and all that a study file may map.
TORQUE = "torque"
MAPPED = {**RECORDED, TORQUE: "Nm"}

#: Channels that every operating point has.
OF_POINTS = ("u_d", "u_q", "i_d", "i_q", "omega_el")

#: SI unit of the channels that may be recorded per unit -> entry that says what 1 is.
BASES = {"V": "u_base", "A": "i_base", "rad/s": "omega_base"}

#: Channels that may be given as rms values, and those that may be given of the shaft.
IN_RMS = ("u_d", "u_q", "i_d", "i_q")
OF_SHAFT = ("omega_el", "theta_el")

#: Channels that a study file may give as a number where no column holds them.
AS_NUMBERS = (LINK, SPEED.name)
#: Entry that says how far even samples are apart, in s, where no column holds the time.
TIME_STEP = "time_step"
#: What is to be done about a speed that no column holds.
_STOOD_STILL = (
    f"; for a rotor that stood still, give {SPEED.name} = 0 in the study file "
    "(penode init --standstill)"
)

#: Units of a column that is a fraction of something.
FRACTIONS = ("1", "%")


@dataclass(frozen=True)
class DriveOrigin:
    """Where one channel of a drive comes from.

    Attributes
    ----------
    origin : Origin
        Column, unit, scale, sign, delay.
    rms : bool
        The column holds rms values; the channel gets the peak values, sqrt(2) times as large.
    mechanical : bool
        The column belongs to the shaft; the channel gets the electrical speed or angle.
    """

    origin: Origin
    rms: bool = False
    mechanical: bool = False


@dataclass(frozen=True)
class DriveMapping:
    """How the recordings of one test bench become drive recordings.

    Attributes
    ----------
    channels : mapping of str to DriveOrigin
        Key of `MAPPED` -> where it comes from; empty where the file has the names of `RECORDED`.
    pole_pairs : int or None
        Needed where something is mechanical.
    resample : bool
        Put channels of different sampling times onto one clock; see
        `penode.data.mapping.map_channels`.
    constants : mapping of str to float
        ``u_dc`` in V where no channel holds it, ``omega_el`` of 0 for a rotor that stood still,
        what 1 is in V, A and rad/s of channels that were recorded per unit: values of `BASES`, and
        ``time_step`` in s of a steady clock, where no column holds the time or its stamps jitter.
    others : tuple of DriveMapping
        Of recordings with other columns: each recording is read by the first that has its own.

    Raises
    ------
    InputError
        If a channel cannot be rms or mechanical, pole_pairs is needed and missing, u_dc
        or omega_el is both a constant and a channel, or omega_el is a constant other than 0.
    """

    channels: Mapping[str, DriveOrigin] = field(default_factory=dict)
    pole_pairs: int | None = None
    resample: bool = False
    constants: Mapping[str, float] = field(default_factory=dict)
    others: tuple["DriveMapping", ...] = ()

    def __post_init__(self) -> None:
        for name, channel in self.channels.items():
            if channel.rms and name not in IN_RMS:
                raise InputError(
                    f"channel {name}: rms = true is for amplitudes only: {', '.join(IN_RMS)}."
                )
            if channel.mechanical and name not in OF_SHAFT:
                raise InputError(
                    f"channel {name}: mechanical = true is for {', '.join(OF_SHAFT)} only."
                )
            if channel.mechanical and self.pole_pairs is None:
                raise InputError(
                    f"{name} is mechanical and pole_pairs is missing; add pole_pairs of the "
                    "machine, as a whole number."
                )

        for name in (LINK, SPEED.name):
            if name in self.constants and name in self.channels:
                raise InputError(
                    f"{name} is a number ({self.constants[name]:g}) and a channel; remove one."
                )
        speed = self.constants.get(SPEED.name, 0.0)
        if speed:
            raise InputError(
                f"{SPEED.name} must be 0, of a rotor that stood still, or a channel, got "
                f"{speed:g}; map the column of the speed in [channels]."
            )

    def load(self, path: str | Path) -> Experiment:
        """Load a recording into the channels of `RECORDED`.

        Parameters
        ----------
        path : str or Path
            A file that `penode.data.load.read` knows.

        Returns
        -------
        Experiment
            SI units, peak values, electrical speed and angle.

        Raises
        ------
        InputError
            If a channel is missing, or as `penode.data.load` and `map_channels` say.
        """
        return in_one_piece(self.load_stretches(path))

    def load_stretches(self, path: str | Path) -> tuple[Experiment, ...]:
        """Load a recording that may have gaps; see `load` and `penode.data.load.load_stretches`.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        tuple of Experiment
            What lies between the gaps, in order of time.
        """
        table, source = read(path)
        own = self.suited(table)
        if own.is_table_of_points(table):
            raise InputError(
                f"{path}: no column {TIME}: a table of operating points must be given to penode "
                "identify or check, alone; give a recording with its time here."
            )
        return own.stretches_of(path, table, source)

    def is_table_of_points(self, table: Table) -> bool:
        """Return whether a file has what operating points have, and no time."""
        named = {name: one.origin.column for name, one in self.channels.items()}
        timed = TIME in named or TIME in table.columns or bool(table.clocks)
        timed |= TIME_STEP in self.constants
        return not timed and all(named.get(n, n) in table.columns for n in OF_POINTS)

    def stretches_of(
        self, path: str | Path, table: Table, source: Source
    ) -> tuple[Experiment, ...]:
        """Make recordings of the columns of a file; see `load_stretches`."""
        table = self._timed(table)
        origins = {n: channel.origin for n, channel in self.channels.items()}
        if TORQUE in origins and origins[TORQUE].column not in table.columns:
            del origins[TORQUE]  # mapped for operating points
        if not self.channels:
            for name in RECORDED:
                table.require_numbers(str(path), name)
            origins = {n: Origin(n, si) for n, si in MAPPED.items() if n in table.columns}
            if table.clocks.get(TORQUE) != table.clocks.get(CURRENTS[0]):
                origins.pop(TORQUE, None)  # of another device, and nobody asked for it
        constant = {n: self.constants[n] for n in AS_NUMBERS if n in self.constants}
        constant = {name: value for name, value in constant.items() if name not in origins}
        self._require(path, table, {*origins, *constant})
        _require_own_columns(path, table, origins)
        origins = {n: self._in_base(str(path), table, n, o) for n, o in origins.items()}
        steady = self.constants.get(TIME_STEP)
        found = experiments_of(table, source, origins, self.resample, steady)
        runs = tuple(self._completed(run, constant) for run in found)
        if SPEED.name in self.constants:
            _require_standstill(path, runs)
        return runs

    def suited(self, table: Table) -> "DriveMapping":
        """Return the first mapping, of this one and the others, whose columns a file has.

        This one where there is none, which then says what is missing.
        """
        return next((one for one in (self, *self.others) if one._is_of(table)), self)

    def _is_of(self, table: Table) -> bool:
        if not self.channels:
            return not missing_channels([name for name in RECORDED if name in table.columns])
        named = {name: one.origin.column for name, one in self.channels.items()}
        named.pop(TORQUE, None)
        if table.clocks:  # channel groups have their own times
            named.pop(TIME, None)
        return all(column in table.columns for column in named.values())

    def _timed(self, table: Table) -> Table:
        """Return a table with times by the study file's step where it has none of its own."""
        step = self.constants.get(TIME_STEP)
        if step is None or TIME in table.columns or TIME in self.channels or table.clocks:
            return table
        used = [channel.origin.column for channel in self.channels.values()] or list(CANONICAL)
        samples = next((len(table.columns[one]) for one in used if one in table.columns), 0)
        times = gathered(np.arange(samples, dtype=np.float64) * step)
        return replace(
            table, columns=ChainMap({TIME: times}, cast("dict[str, FloatArray]", table.columns))
        )

    def _completed(self, run: Experiment, constant: Mapping[str, float]) -> Experiment:
        """Return a recording with its channels scaled, and those that no column holds."""
        channels = {name: self.scaled(name, values) for name, values in run.channels.items()}
        channels |= {name: gathered(np.full(len(run), value)) for name, value in constant.items()}
        return replace(run, channels=channels)

    def _require(self, path: str | Path, table: Table, present: Collection[str]) -> None:
        """Refuse a file from which no drive recording can be made."""
        missing = missing_channels(present)
        still = _STOOD_STILL if list(missing) == [SPEED.name] else ""
        if missing and not table.columns:
            raise InputError(
                f"{path}: no column of numbers, where {', '.join(missing)} were wanted; export the "
                "recording again, with a line of names above its numbers."
            )
        if missing and {"psi_d", "psi_q"} <= set(table.columns):
            raise InputError(
                f"{path}: this is a flux map or loci, with columns psi_d and psi_q; give the "
                f"recording, with {', '.join(missing)} too."
            )
        if missing and not self.channels:
            raise InputError(
                f"{path}: no column {', '.join(missing)}; the columns are "
                f"{list_names(table.columns)}; rename them, or map them by a study file, which "
                f"penode init {path} --out study.toml begins{still}."
            )
        if missing:
            raise InputError(
                f"{path}: the study file maps no channel {', '.join(missing)}; name its column "
                f"in [channels]{still}."
            )

    def _in_base(self, file: str, table: Table, name: str, origin: Origin) -> Origin:
        """Return an origin that gives fractions of the base where there is a base."""
        base = BASES.get(origin.si)
        given = origin.unit or table.units.get(origin.column, "")
        fraction = unit_name(given) in FRACTIONS
        if base is None or origin.times:
            return origin
        if base in self.constants and given and not fraction:
            raise InputError(
                f"{file}: channel {name}: column {origin.column} has unit {given!r} beside "
                f'{base}; remove {base}, or set unit = "1" for a column per unit.'
            )
        if base in self.constants:
            return replace(origin, si="1")
        if fraction:
            raise InputError(
                f"{file}: channel {name}: column {origin.column} is per unit ({given}) and {base} "
                f"is missing; add {base}, what 1 is in {origin.si}, to the study file."
            )
        return origin

    def scaled(self, name: str, values: FloatArray) -> FloatArray:
        """Return a channel's values (sample,) as peak and electrical values, SI units."""
        factor = self._factor(name)
        return values if factor == 1.0 else in_pieces(lambda piece: piece * factor, values)

    def _factor(self, name: str) -> float:
        channel = self.channels.get(name, DriveOrigin(Origin(name)))
        base = "" if channel.origin.times else BASES.get(MAPPED.get(name, ""), "")
        factor = self.constants.get(base, 1.0)
        if channel.mechanical and self.pole_pairs is not None:
            factor *= self.pole_pairs
        return factor * math.sqrt(2.0) if channel.rms else factor


def _require_own_columns(path: str | Path, table: Table, origins: Mapping[str, Origin]) -> None:
    """Refuse a column that moves and is two channels."""
    own: dict[tuple[str, int, str], str] = {}
    for name, origin in origins.items():
        other = own.setdefault((origin.column, origin.sign, origin.times), name)
        if other == name or origin.column not in table.columns:
            continue
        if np.ptp(table.columns[origin.column]) > 0:
            used = {one.column for one in origins.values()}
            rest = [one for one in table.columns if one not in {TIME, *used}]
            raise InputError(
                f"{path}: column {origin.column} is mapped to {other} and to {name}; give each its "
                f"own{f' (not used: {list_names(rest)})' if rest else ''}."
            )


def _require_standstill(path: str | Path, runs: Sequence[Experiment]) -> None:
    """Refuse a recording whose speed or angle turns though the study file says it does not."""
    angles = [run.channels[ANGLE.name] for run in runs if ANGLE.name in run.channels]
    turned = max((float(np.ptp(np.unwrap(angle))) for angle in angles), default=0.0)
    if not stands_still(runs) or turned > TURN:
        moving = SPEED if not stands_still(runs) else ANGLE
        raise InputError(
            f"{path}: {SPEED.name} = 0 in the study file, and channel {moving.name} turns by more "
            f"than {TURN:g} electrical rad; map the column of the speed in place of the number."
        )
