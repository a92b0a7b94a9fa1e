"""The simulated bench: a machine whose truth is known, driven and recorded like a real one.

Recording
    `simulate` gives a recording, `record` also the truth behind it; `load_config` reads a run from
    a TOML file.
Machines
    `TRACTION_300A` and the others in `MACHINES`; `import_machine` from a flux table,
    `identified_machine` from a result; `true_flux_map` of any.
Current references
    `Lissajous`, `Steps` and `stationary_grid`, or any function of time.
The drive and its imperfections
    `Drive`: `Inverter` (`DeadTime`, `StationaryHold`), `CurrentSensors`, `Resolver`, `Winding`.

It shares no code with the estimator. The records of the rarer imperfections stand beside these in
their modules; a TOML file names them all.
"""

from penode.bench.coenergy_table import true_flux_map
from penode.bench.config import load_config
from penode.bench.drive import Drive
from penode.bench.inverter import DeadTime, Inverter, StationaryHold
from penode.bench.machines import MACHINES, TRACTION_300A, Machine
from penode.bench.map_import import identified_machine, import_machine
from penode.bench.references import Lissajous, Steps, stationary_grid
from penode.bench.run import record, simulate
from penode.bench.sensors import CurrentSensors, Resolver
from penode.bench.winding import Winding

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


def __dir__() -> list[str]:
    return sorted(__all__)
