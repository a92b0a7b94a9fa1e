from . import bench, engine, pmsm
from .data.experiment import Experiment
from .data.load import load, load_stretches
from .data.save import save
from .data.windows import Contiguous, Jittered, Windows
from .errors import InputError
from .fit.fit import Fit
from .horizon.identifiability import Start
from .horizon.ladder import ladder_plan
from .identify import Stopped, identify
from .models.base import Model
from .models.parameters import delay, nuisance, parameter, physical
from .predictors.base import Predictor
from .training.plan import Plan, Stage

__version__: str

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
