"""Points at rest beside recordings: how well one model explains both."""

from collections.abc import Iterator, Sequence

import jax
import numpy as np
from scipy.special import chdtri

from penode.arrays import BoolArray, FloatArray, float64, on_device
from penode.data.experiment import Experiment
from penode.fit.fit import Fit
from penode.fit.outcome import Objection
from penode.horizon.identifiability import Start
from penode.horizon.ladder import HorizonFit, LadderProblem
from penode.horizon.objections import Check
from penode.models.measured import measured_units
from penode.training.steady_points import Rest
from penode.validation.comparison import StationaryComparison

#: Probability of points as far from the model as those that are said to contradict it.
_CHANCE = 1e-3


def compared_at_rest(
    start: Start, problem: LadderProblem, rung: HorizonFit, raw: FloatArray, moving: BoolArray
) -> StationaryComparison | None:
    """Return the points of a start beside the model of raw parameters; None without points.

    `moving` (parameter,) are those that the rung trained. Without a point the model is what one
    step of Gauss and Newton makes of it.
    """
    points, objective = start.points, rung.objective or problem.objective
    rest = next((p for p in objective.loss.penalties if isinstance(p, Rest)), None)
    if points is None or rest is None:
        return None
    layout, terms = objective.layout, rung.solution.terms
    with float64():
        here = on_device(raw)
        read, states = (np.asarray(f(layout, layout.values(here))) for f in (rest.read, rest.state))
        slopes = jax.jacfwd(lambda raw: rest.read(layout, layout.values(raw)))(here)
        slopes = np.asarray(slopes)[..., moving] / rest.std[..., None]
    covariance = terms.count * float(rest.scale) * terms.inverse
    gaps = (rest.measured - read) / rest.std
    own = np.einsum("qpi,ij,rpj->pqr", slopes, covariance, slopes)
    inverse = np.linalg.inv(np.eye(len(read)) - own)
    rows = slopes.reshape(gaps.size, -1)
    all_left_out = np.eye(gaps.size) - rows @ covariance @ rows.T
    squares = float(gaps.ravel() @ np.linalg.solve(all_left_out, gaps.ravel()))
    apart = np.einsum("pqr,rp->qp", inverse, gaps) * rest.std
    wide = np.sqrt(np.einsum("pqq->qp", inverse)) * rest.std
    units = measured_units(start.model)
    return StationaryComparison(
        name=points.name,
        quantities=tuple(points.std),
        units=tuple(units[name] for name in points.std),
        states=states.T,
        measured=rest.measured.T,
        fitted=read.T,
        without=(rest.measured - apart).T,
        deviation=wide.T,
        distance=float(np.sqrt(max(squares, 0.0) / gaps.size)),
    )


def checks_of_points(start: Start) -> tuple[Check, ...]:
    """Return the check of a start's points, none without."""
    if start.points is None:
        return ()

    def points_contradict(fit: Fit, experiments: Sequence[Experiment]) -> Iterator[Objection]:
        said = fit.stationary
        if said is None:
            return
        if said.measured.size * said.distance**2 > chdtri(said.measured.size, _CHANCE):
            yield Objection(
                "points contradict",
                f"{said.name}: what sensors measured at rest is {said.distance:.2g} standard "
                "deviations (rms) from what the recordings say of it.",
                "Check units and std of the points, and what differs from the recordings.",
            )

    return (points_contradict,)
