"""The simulated bench: a machine whose truth is known, driven and recorded like a real one.

Recording
    `simulate` gives a recording, `record` also the truth behind it; `load_config` reads a run from
    a TOML file.
Machines
    `TRACTION_300A` and the others in `MACHINES`; `import_machine` from a flux table,
    `identified_machine` from a result.
Current references
    `Lissajous`, `Spiral`, `Steps`, `stationary_grid`, each with an `Injection` if wanted, in a
    `Domain`.
The drive and its imperfections
    `Drive`: `Inverter` (`DeadTime`, `DeviceDrop`, `Switching`), `CurrentSensors`, `Resolver`,
    `SpeedSensor`, `Winding` (`Warming`, `IronLoss`), the shaft's `SpeedPoints` or `FreeShaft`.

It shares no code with the estimator.
"""

from penode.bench.coenergies import HarmonicCoenergy, SaturatingCoenergy
from penode.bench.coenergy_table import CoenergyTable, SplineCoenergy, true_flux_map
from penode.bench.config import Simulation, load_config, shipped_configs
from penode.bench.current_controller import CurrentController
from penode.bench.current_sensors import CurrentSensors, Quantisation
from penode.bench.drive import Drive
from penode.bench.identified import identified_machine
from penode.bench.inverter import (
    DeadTime,
    DeviceDrop,
    Inverter,
    RotorHold,
    StationaryHold,
    Switching,
)
from penode.bench.machines import (
    BRUSA_250A,
    COMSOL_300A,
    EV400V_420A,
    MACHINES,
    TRACTION_300A,
    Machine,
    machine,
    torque,
)
from penode.bench.map_import import ImportedMachine, MapFindings, import_machine
from penode.bench.references import (
    GENERATOR,
    MOTOR,
    WHOLE_DISC,
    Domain,
    Injection,
    Lissajous,
    Reference,
    Spiral,
    Steps,
    stationary_grid,
)
from penode.bench.run import Recording, record, simulate
from penode.bench.sensors import Resolver, SpeedSensor
from penode.bench.shaft import FreeShaft, SpeedPoints, SpeedRipple
from penode.bench.switching import CarrierPwm
from penode.bench.truth import Trace, Truth
from penode.bench.winding import IronLoss, Warming, Winding

__all__ = [
    "BRUSA_250A",
    "COMSOL_300A",
    "EV400V_420A",
    "GENERATOR",
    "MACHINES",
    "MOTOR",
    "TRACTION_300A",
    "WHOLE_DISC",
    "CarrierPwm",
    "CoenergyTable",
    "CurrentController",
    "CurrentSensors",
    "DeadTime",
    "DeviceDrop",
    "Domain",
    "Drive",
    "FreeShaft",
    "HarmonicCoenergy",
    "ImportedMachine",
    "Injection",
    "Inverter",
    "IronLoss",
    "Lissajous",
    "Machine",
    "MapFindings",
    "Quantisation",
    "Recording",
    "Reference",
    "Resolver",
    "RotorHold",
    "SaturatingCoenergy",
    "Simulation",
    "SpeedPoints",
    "SpeedRipple",
    "SpeedSensor",
    "Spiral",
    "SplineCoenergy",
    "StationaryHold",
    "Steps",
    "Switching",
    "Trace",
    "Truth",
    "Warming",
    "Winding",
    "identified_machine",
    "import_machine",
    "load_config",
    "machine",
    "record",
    "shipped_configs",
    "simulate",
    "stationary_grid",
    "torque",
    "true_flux_map",
]


def __dir__() -> list[str]:
    return sorted(__all__)
