"""For those who write their own physics, training or analysis; nothing here knows of machines.

Solvers and holds
    `RungeKutta` with a tableau of `RUNGE_KUTTA`, `AdamsBashforth` with one of `ADAMS_BASHFORTH`,
    `ImplicitMidpoint`, `Trapezoidal`, `Substeps`; `ZeroOrderHold`, `FirstOrderHold`,
    `BandLimitedHold`; `Inputs`, what a derivative gets.
Learned maps and transforms
    `TanhLayers`, `ConvexGradient`, `Polynomial`, `Spline`, and what combines them: `LinearSkip`,
    `Gradient`, `Scaled`; `Positive`, `Bounded`, `PositiveDefinite`; `Normal`, a prior.
Training
    `Loss` with `Prefilter`, scales, weights and domains; penalties; the optimisers
    `LevenbergMarquardt`, `FirstOrder`, `BestOf`; `SteadyPoints`, measured at rest.
Horizon
    `default_plan`; the selectors `Plateau`, `Longest`, `HeldOut`; `Checkpoint`; `LearnedPrior`;
    `weight_matrix`, which shows how a horizon weighs the residual; `profile`, the likelihood over
    one parameter, and `bootstrap`; what joins a result: `Imperfection`, `Objection`.
Data and validation
    `read`, `cut`, `excerpt`; `compare`, `power_spectrum`, `find_lines`.

The everyday names are in `penode`; what these return and are made of stands in the modules below.
"""

from penode.data.load import read
from penode.data.stretches import excerpt
from penode.data.windows import cut
from penode.fit.outcome import Objection
from penode.horizon.bootstrap import Bootstrap, bootstrap
from penode.horizon.checkpoint import Checkpoint
from penode.horizon.default_plan import default_plan
from penode.horizon.held_out import HeldOut
from penode.horizon.learned_prior import LearnedPrior
from penode.horizon.loss_weighting import weight_matrix
from penode.horizon.profile import Profile, profile
from penode.horizon.selection import Longest, Plateau
from penode.horizon.uncertainty_budget import Imperfection
from penode.models.compositions import Gradient, LinearSkip, Scaled
from penode.models.encoded import Encoded
from penode.models.inputs import Inputs
from penode.models.kalman import ExtendedKalman
from penode.models.networks import ConvexGradient, TanhLayers
from penode.models.parameters import Normal, with_batch_axis
from penode.models.polynomials import Polynomial
from penode.models.splines import Spline
from penode.models.transforms import Bounded, Positive, PositiveDefinite
from penode.predictors.band_limited import BandLimitedHold
from penode.predictors.holds import FirstOrderHold, ZeroOrderHold
from penode.predictors.implicit import ImplicitMidpoint, Trapezoidal
from penode.predictors.multistep import AdamsBashforth
from penode.predictors.one_step import RungeKutta, Substeps
from penode.predictors.tableaus import ADAMS_BASHFORTH, RUNGE_KUTTA
from penode.training.first_order import FirstOrder
from penode.training.loss import Loss, Prefilter, equation, increment_deviation, last_step
from penode.training.multi_start import BestOf
from penode.training.noise import StudentT
from penode.training.penalties import (
    Orthogonality,
    Priors,
    Smoothness,
    SoftReciprocity,
    WeightDecay,
)
from penode.training.second_order import LevenbergMarquardt
from penode.training.steady_points import SteadyPoints
from penode.validation.free_run import compare
from penode.validation.residual_lines import find_lines, power_spectrum

__all__ = [
    "ADAMS_BASHFORTH",
    "RUNGE_KUTTA",
    "AdamsBashforth",
    "BandLimitedHold",
    "BestOf",
    "Bootstrap",
    "Bounded",
    "Checkpoint",
    "ConvexGradient",
    "Encoded",
    "ExtendedKalman",
    "FirstOrder",
    "FirstOrderHold",
    "Gradient",
    "HeldOut",
    "Imperfection",
    "ImplicitMidpoint",
    "Inputs",
    "LearnedPrior",
    "LevenbergMarquardt",
    "LinearSkip",
    "Longest",
    "Loss",
    "Normal",
    "Objection",
    "Orthogonality",
    "Plateau",
    "Polynomial",
    "Positive",
    "PositiveDefinite",
    "Prefilter",
    "Priors",
    "Profile",
    "RungeKutta",
    "Scaled",
    "Smoothness",
    "SoftReciprocity",
    "Spline",
    "SteadyPoints",
    "StudentT",
    "Substeps",
    "TanhLayers",
    "Trapezoidal",
    "WeightDecay",
    "ZeroOrderHold",
    "bootstrap",
    "compare",
    "cut",
    "default_plan",
    "equation",
    "excerpt",
    "find_lines",
    "increment_deviation",
    "last_step",
    "power_spectrum",
    "profile",
    "read",
    "weight_matrix",
    "with_batch_axis",
]


def __dir__() -> list[str]:
    return sorted(__all__)
