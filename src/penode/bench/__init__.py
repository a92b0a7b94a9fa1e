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

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
