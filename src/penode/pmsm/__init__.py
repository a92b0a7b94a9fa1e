"""Permanent-magnet synchronous machines: flux-linkage map and resistance from a drive recording.

From a recording to a result
    `load_study` or `guess_study`, `check_recordings`, `check_points`; `identify` with a `Study`
    and the `Accuracy` of the bench, `identify_points` where all stand still,
    `identify_with_points` where both were recorded; `drive_recording` of phases for what a fit
    is asked of them; `write`.
What the result is used for
    `export`, `ControlledMachine`, `control_loci`, `mtpa` and `operating_points`, `compare_maps`,
    `torque_of` a recording.
What the model is made of
    `Machine`: a flux map and terms (`TERMS`; write your own as a `Term`).

Whatever else is used by a few is imported from its own module.
"""

from penode.pmsm.comparison.map_comparison import compare_maps
from penode.pmsm.control.controlled_machine import ControlledMachine
from penode.pmsm.control.loci import control_loci, mtpa
from penode.pmsm.control.operating_points import operating_points
from penode.pmsm.exports.formats import export
from penode.pmsm.machine.dead_time import DeadTime
from penode.pmsm.machine.model import Machine
from penode.pmsm.machine.term_registry import TERMS
from penode.pmsm.machine.terms import Channel, Resistance, TemperatureResistance, Term
from penode.pmsm.points.check import check_points
from penode.pmsm.points.identify import identify_points
from penode.pmsm.recording.channels import drive_recording
from penode.pmsm.recording.guess import guess_study
from penode.pmsm.recording.imperfections import Accuracy
from penode.pmsm.recording.name_plate import NamePlate
from penode.pmsm.recording.study_text import study_text
from penode.pmsm.recording_check import check_recordings
from penode.pmsm.report.line_causes import named_lines
from penode.pmsm.result_files import write
from penode.pmsm.simulation.simulated_drive import torque_of
from penode.pmsm.study import identify, identify_with_points
from penode.pmsm.study_file import load_study
from penode.pmsm.study_settings import Study

__all__ = [
    "TERMS",
    "Accuracy",
    "Channel",
    "ControlledMachine",
    "DeadTime",
    "Machine",
    "NamePlate",
    "Resistance",
    "Study",
    "TemperatureResistance",
    "Term",
    "check_points",
    "check_recordings",
    "compare_maps",
    "control_loci",
    "drive_recording",
    "export",
    "guess_study",
    "identify",
    "identify_points",
    "identify_with_points",
    "load_study",
    "mtpa",
    "named_lines",
    "operating_points",
    "study_text",
    "torque_of",
    "write",
]


def __dir__() -> list[str]:
    return sorted(__all__)
