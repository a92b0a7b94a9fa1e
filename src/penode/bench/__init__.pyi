from .coenergy_table import true_flux_map
from .config import load_config
from .drive import Drive
from .inverter import DeadTime, Inverter, StationaryHold
from .machines import MACHINES, TRACTION_300A, Machine
from .map_import import identified_machine, import_machine
from .references import Lissajous, Steps, stationary_grid
from .run import record, simulate
from .sensors import CurrentSensors, Resolver
from .winding import Winding

__all__ = [
    "MACHINES",
    "TRACTION_300A",
    "CurrentSensors",
    "DeadTime",
    "Drive",
    "Inverter",
    "Lissajous",
    "Machine",
    "Resolver",
    "StationaryHold",
    "Steps",
    "Winding",
    "identified_machine",
    "import_machine",
    "load_config",
    "record",
    "simulate",
    "stationary_grid",
    "true_flux_map",
]
