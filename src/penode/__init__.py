"""penode: physical parameters and learned maps from recorded data, at the horizon that fits.

These are the names for every day. `penode.engine` has those for writing one's own training,
`penode.pmsm` those for machines, `penode.bench` those of the simulated drive, and `penode.paper`,
which is imported by itself, those of the paper. Modules below these five may move.
"""

from importlib.metadata import version

from penode import bench, engine, pmsm
from penode.data.experiment import Experiment
from penode.data.load import load, load_stretches
from penode.data.save import save
from penode.data.windows import Contiguous, Jittered, Windows
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.horizon.identifiability import Start
from penode.horizon.ladder import ladder_plan
from penode.identify import Stopped, identify
from penode.models.base import Model
from penode.models.parameters import delay, nuisance, parameter, physical
from penode.predictors.base import Predictor
from penode.training.plan import Plan, Stage

__version__ = version("penode")

__all__ = [
    "Contiguous",
    "Experiment",
    "Fit",
    "InputError",
    "Jittered",
    "Model",
    "Plan",
    "Predictor",
    "Stage",
    "Start",
    "Stopped",
    "Windows",
    "bench",
    "delay",
    "engine",
    "identify",
    "ladder_plan",
    "load",
    "load_stretches",
    "nuisance",
    "parameter",
    "physical",
    "pmsm",
    "save",
]


def __dir__() -> list[str]:
    return sorted(__all__)
