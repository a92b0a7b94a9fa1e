"""Which columns of a user's file are the channels of a drive, and in what convention."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from penode.data.experiment import Experiment
from penode.data.load import experiment_of, read
from penode.data.mapping import Origin
from penode.data.table import TIME, list_names
from penode.errors import InputError
from penode.pmsm.recording.channels import CANONICAL, PHASES, missing_channels

#: Channel of a recorded file -> SI unit, the time included.
RECORDED = {TIME: "s", **CANONICAL, **PHASES}

#: Channels that may be given as rms values, and those that may be given of the shaft.
IN_RMS = ("u_d", "u_q", "i_d", "i_q")
OF_SHAFT = ("omega_el", "theta_el")


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
        Key of `RECORDED` -> where it comes from; empty where the file has the names of `RECORDED`.
    pole_pairs : int or None
        Needed where something is mechanical.
    resample : bool
        Put channels of different sampling times onto one clock; see
        `penode.data.mapping.map_channels`.

    Raises
    ------
    InputError
        If a channel cannot be rms or mechanical, or pole_pairs is needed and missing.
    """

    channels: Mapping[str, DriveOrigin] = field(default_factory=dict)
    pole_pairs: int | None = None
    resample: bool = False

    def __post_init__(self) -> None:
        for name, channel in self.channels.items():
            if channel.rms and name not in IN_RMS:
                raise InputError(
                    f"rms = true came for {name}, which is no amplitude; it may stand at "
                    f"{', '.join(IN_RMS)}."
                )
            if channel.mechanical and name not in OF_SHAFT:
                raise InputError(
                    f"mechanical = true came for {name}; it may stand at {', '.join(OF_SHAFT)}."
                )
            if channel.mechanical and self.pole_pairs is None:
                raise InputError(
                    f"{name} is mechanical and pole_pairs is missing; add pole_pairs of the "
                    "machine, as a whole number."
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
        table, source = read(path)
        origins = {name: channel.origin for name, channel in self.channels.items()}
        if not self.channels:
            origins = {n: Origin(n, si) for n, si in RECORDED.items() if n in table.columns}
        missing = missing_channels(origins)
        if missing and not self.channels:
            raise InputError(
                f"{path}: no column {', '.join(missing)}; the columns are "
                f"{list_names(table.columns)}; rename them, or map them by a study file, which "
                "penode init begins."
            )
        if missing:
            raise InputError(
                f"{path}: the study file maps no channel {', '.join(missing)}; name its column "
                "in [channels]."
            )
        run = experiment_of(table, source, origins, self.resample)
        channels = {name: values * self._factor(name) for name, values in run.channels.items()}
        return replace(run, channels=channels)

    def _factor(self, name: str) -> float:
        channel = self.channels.get(name)
        if channel is None:
            return 1.0
        if channel.mechanical and self.pole_pairs is not None:
            return float(self.pole_pairs)
        return math.sqrt(2.0) if channel.rms else 1.0
