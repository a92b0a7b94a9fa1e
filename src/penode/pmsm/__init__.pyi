from .comparison.map_comparison import compare_maps
from .control.controlled_machine import ControlledMachine
from .control.loci import control_loci, mtpa
from .control.operating_points import operating_points
from .exports.formats import export
from .machine.dead_time import DeadTime
from .machine.model import Machine
from .machine.term_registry import TERMS
from .machine.terms import Channel, Resistance, TemperatureResistance, Term
from .points.check import check_points
from .points.identify import identify_points
from .recording.channels import drive_recording
from .recording.guess import guess_study
from .recording.imperfections import Accuracy
from .recording.name_plate import NamePlate
from .recording.study_text import study_text
from .recording_check import check_recordings
from .report.line_causes import named_lines
from .result_files import write
from .simulation.simulated_drive import torque_of
from .study import identify, identify_with_points
from .study_file import load_study
from .study_settings import Study

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
