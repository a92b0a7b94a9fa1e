"""Methods of penode: those of the paper, what is conventional, and the command itself."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Protocol

import equinox as eqx
import jax
import numpy as np

from penode.arrays import JaxArray
from penode.data.experiment import Experiment
from penode.data.load import load
from penode.data.windows import Contiguous
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.fit.outcome import AGREED
from penode.horizon.identifiability import Start
from penode.horizon.selection import Longest
from penode.identify import identify
from penode.paper.conventional.linear_methods import CoenergyLeastSquares, FluxPredictor
from penode.paper.conventional.stationary_averaging import StationaryAveraging
from penode.paper.conventional.trained_methods import CurrentPredictor, PaperRecipe
from penode.pmsm.balance.start import weak_start
from penode.pmsm.machine.holds import HOLDS
from penode.pmsm.machine.terms import Term
from penode.pmsm.recording.channels import drive_recording
from penode.training.plan import Plan, Stage
from penode.training.second_order import LevenbergMarquardt
from validate.command import identify as by_command

Answer = dict[str, Any]
#: A method: a log's file, its entry of ``tasks.json`` and a folder of its own to what it answers.
Method = Callable[[Path, dict[str, Any], Path], Answer]


class Identifies(Protocol):
    """A method of `penode.paper.conventional`."""

    def identify(self, experiments: list[Experiment]) -> Fit:
        """Return the fit of recordings."""


class KnownResistance(Term):
    """R i with an R that is known, in ohm."""

    role: ClassVar[str] = "resistance"
    title: ClassVar[str] = "The known resistance"

    value: float = eqx.field(static=True)

    def drop(self, x: JaxArray, u: Any, flux: Any) -> JaxArray:
        """Return R i in V."""
        return self.value * x


@dataclass(frozen=True)
class GradientNetwork:
    """A gradient network trained one step ahead, with R of the name plate."""

    resistance: float

    def identify(self, experiments: list[Experiment]) -> Fit:
        """Return the fit of recordings."""
        runs = [drive_recording(e) for e in experiments]
        start = weak_start(runs, "convex")[0]
        known = (KnownResistance(self.resistance), *start.terms[1:])
        stage = Stage(1, LevenbergMarquardt(60))
        plan = Plan((stage,), Contiguous(), hold=HOLDS["dq"])
        model = replace(start, terms=known)
        return identify(Start(model), runs, plan=plan, purpose=Longest())


def answer_of(fit: Fit, currents: dict[str, list[float]]) -> Answer:
    """Return what a fit answers; its interval where it has one."""
    answer: Answer = {}
    if "R" in fit.parameters:
        estimate = fit.parameters["R"]
        answer["R"] = estimate.value
        low, high = estimate.interval_95
        if np.isfinite(high - low) and high > low:
            answer |= {"low": low, "high": high}
    psi = fit.flux_map(np.array(currents["i_d"]), np.array(currents["i_q"]))
    named = zip(("psi_d", "psi_q"), psi, strict=True)
    return answer | {name: np.asarray(one, float).tolist() for name, one in named}


def fitted(choose: Callable[[dict[str, Any]], Identifies]) -> Method:
    """Return the method that identifies a log as it is with what `choose` makes of its entry."""

    def method(file: Path, told: dict[str, Any], _folder: Path) -> Answer:
        try:
            return answer_of(choose(told).identify([load(file)]), told["currents"])
        except (InputError, FloatingPointError, np.linalg.LinAlgError) as error:
            return {"refused": str(error)}
        finally:
            jax.clear_caches()  # nothing else drops the programs of a log

    return method


def by_penode(file: Path, told: dict[str, Any], folder: Path) -> Answer:
    """Answer by ``penode identify FILE``, nothing given beside; only what it stands by counts."""
    ended = by_command([file], folder / "result")
    jax.clear_caches()
    if ended.result is None:
        return {"refused": ended.last_line}
    fit = ended.fit()
    if fit.horizon.verdict not in AGREED:
        return {"refused": f"{fit.horizon.verdict}: {fit.horizon.reason}"}
    return answer_of(fit, told["currents"])


def by_recipe(horizon: int, epochs: int) -> Method:
    """Return the paper's recipe at a horizon; R's rate fits the machine."""

    def choose(told: dict[str, Any]) -> Identifies:
        rate = 0.01 * told["name_plate"]["R"]
        return PaperRecipe(horizon, epochs, growth_epochs=epochs // 8, resistance_rate=rate)

    return fitted(choose)


METHODS: dict[str, Method] = {
    "stationary averaging": fitted(lambda _: StationaryAveraging()),
    "weak least squares": fitted(lambda _: CoenergyLeastSquares()),
    "flux predictor": fitted(lambda _: FluxPredictor()),
    "current predictor": fitted(lambda _: CurrentPredictor()),
    "source, H = 1": by_recipe(1, 200),
    "source, H = 50": by_recipe(50, 200),
    "gradient network": fitted(lambda told: GradientNetwork(told["name_plate"]["R"])),
    "penode": by_penode,
}
