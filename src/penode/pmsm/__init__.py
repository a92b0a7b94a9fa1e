"""Permanent-magnet synchronous machines: flux-linkage map and resistance from a drive recording.

From a recording to a result
    `load_study`, `guess_study`, `check_recordings`; `identify` with a `Study` and the
    `Accuracy` of the bench; `write`.
What the result is used for
    `export`, `ControlledMachine`, `control_loci` and single loci, `compare_maps`, `tabulate`,
    `machine_report`, `torque_of` a recording.
What the model is made of
    `Machine`: a flux map (`FLUX_MAPS`) and terms (`Resistance`, `TemperatureResistance`,
    `Rotation`, `DeadTime`, `PhaseDeadTime`; write your own as a `Term`).
"""

from penode.horizon.held_out import PURPOSES
from penode.pmsm.balance.start import nominal_start, weak_start
from penode.pmsm.balance.term_selection import CANDIDATES, Structure, structure_of
from penode.pmsm.comparison.map_comparison import MapComparison, compare_maps, compare_resistances
from penode.pmsm.control.controlled_machine import ControlledMachine
from penode.pmsm.control.loci import (
    ControlLoci,
    Locus,
    base_speed,
    characteristic_current,
    control_loci,
    loci_csv,
    most_torque_over_speed,
    mtpa,
    mtpv,
    voltage_limit_curve,
)
from penode.pmsm.conventions.check import Conventions, check_conventions
from penode.pmsm.exports.formats import FORMATS, export
from penode.pmsm.machine.dead_time import DeadTime, PhaseDeadTime
from penode.pmsm.machine.flux_grid import FluxGrid, read_grid, tabulate
from penode.pmsm.machine.flux_maps import FLUX_MAPS, FluxMap
from penode.pmsm.machine.frames import abc_from_dq, dq_from_abc
from penode.pmsm.machine.holds import HOLDS, StationaryFrame
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.term_registry import TERMS
from penode.pmsm.machine.terms import (
    Channel,
    Resistance,
    Rotation,
    TemperatureResistance,
    Term,
)
from penode.pmsm.recording.channels import drive_recording
from penode.pmsm.recording.drive_mapping import DriveMapping, DriveOrigin
from penode.pmsm.recording.guess import StudyGuess, guess_study
from penode.pmsm.recording.imperfections import Accuracy
from penode.pmsm.recording.name_plate import NamePlate
from penode.pmsm.recording.study_text import study_text
from penode.pmsm.recording_check import RecordingCheck, check_recordings
from penode.pmsm.report.line_causes import NamedLine, named_lines
from penode.pmsm.report.machine_report import machine_report
from penode.pmsm.result_files import flux_map_csv, write
from penode.pmsm.simulation.simulated_drive import torque_of
from penode.pmsm.study import identify
from penode.pmsm.study_file import StudyFile, load_study
from penode.pmsm.study_settings import Study

__all__ = [
    "CANDIDATES",
    "FLUX_MAPS",
    "FORMATS",
    "HOLDS",
    "PURPOSES",
    "TERMS",
    "Accuracy",
    "Channel",
    "ControlLoci",
    "ControlledMachine",
    "Conventions",
    "DeadTime",
    "DriveMapping",
    "DriveOrigin",
    "FluxGrid",
    "FluxMap",
    "Locus",
    "Machine",
    "MapComparison",
    "NamePlate",
    "NamedLine",
    "PhaseDeadTime",
    "RecordingCheck",
    "Resistance",
    "Rotation",
    "StationaryFrame",
    "Structure",
    "Study",
    "StudyFile",
    "StudyGuess",
    "TemperatureResistance",
    "Term",
    "abc_from_dq",
    "base_speed",
    "characteristic_current",
    "check_conventions",
    "check_recordings",
    "compare_maps",
    "compare_resistances",
    "control_loci",
    "dq_from_abc",
    "drive_recording",
    "export",
    "flux_map_csv",
    "guess_study",
    "identify",
    "load_study",
    "loci_csv",
    "machine_report",
    "most_torque_over_speed",
    "mtpa",
    "mtpv",
    "named_lines",
    "nominal_start",
    "read_grid",
    "structure_of",
    "study_text",
    "tabulate",
    "torque_of",
    "voltage_limit_curve",
    "weak_start",
    "write",
]


def __dir__() -> list[str]:
    return sorted(__all__)
