"""For those who write their own physics, training or analysis; nothing here knows of machines.

Solvers and holds
    `RungeKutta` with a tableau such as `RK4`, `AdamsBashforth`, `ImplicitMidpoint`, `Trapezoidal`,
    `Substeps`; `ZeroOrderHold`, `FirstOrderHold`, `BandLimitedHold`.
Learned maps and transforms
    `TanhLayers`, `ConvexGradient`, `Polynomial`, `Spline`, and what combines them: `LinearSkip`,
    `QuadraticSkip`, `Gradient`, `Scaled`; `Positive`, `Bounded`, `PositiveDefinite`; `Normal`.
Training
    `Loss` with `Prefilter`, scales and domains; penalties; the optimisers `LevenbergMarquardt`,
    `FirstOrder`, `BestOf`, `CoarseToFine`; `Objective` and `Problem` beneath them.
Horizon
    `LadderProblem`, the selectors `Plateau`, `Longest`, `HeldOut`, `Anchor`; `Checkpoint`;
    `loss_weighting`, which shows how each horizon weighs the residual; what joins the uncertainty
    budget: `Imperfection`, `Contribution`.
Data and validation
    `read`, `cut`, `excerpt`, `inspect`; `compare`, `find_lines`, `residual_correlations`.

The everyday names are in `penode`.
"""

from penode.arrays import Leaf, float64
from penode.data.excitation import check_excitation
from penode.data.load import read
from penode.data.mapping import Origin
from penode.data.quality import Finding, inspect
from penode.data.stretches import Excerpt, excerpt
from penode.data.windows import Placement, cut
from penode.fit.learned_uncertainty import LearnedUncertainty
from penode.fit.outcome import (
    Contribution,
    Estimate,
    HorizonChoice,
    HorizonSummary,
    Objection,
)
from penode.horizon.checkpoint import Checkpoint
from penode.horizon.cross_checks import Anchor
from penode.horizon.default_plan import default_plan
from penode.horizon.held_out import HeldOut
from penode.horizon.ladder import HORIZONS, Climb, HorizonFit, LadderProblem, fitting_plan
from penode.horizon.learned_prior import LearnedPrior
from penode.horizon.loss_weighting import LossWeighting, linearised, loss_weighting, weight_matrix
from penode.horizon.parallel_starts import Sweep, sweep
from penode.horizon.selection import Choice, Longest, Plateau, Selector
from penode.horizon.uncertainty_budget import Imperfection
from penode.models.compositions import Gradient, LinearSkip, QuadraticSkip, Scaled
from penode.models.inputs import Inputs
from penode.models.layout import Layout
from penode.models.learned_map import LearnedMap
from penode.models.networks import ConvexGradient, TanhLayers
from penode.models.parameters import Normal, with_batch_axis
from penode.models.polynomials import Polynomial
from penode.models.splines import Spline
from penode.models.transforms import Bounded, Identity, Positive, PositiveDefinite, Transform
from penode.predictors.band_limited import BandLimitedHold
from penode.predictors.holds import FirstOrderHold, Hold, ZeroOrderHold
from penode.predictors.implicit import ImplicitMidpoint, Trapezoidal
from penode.predictors.multistep import AdamsBashforth
from penode.predictors.one_step import RungeKutta, Substeps
from penode.predictors.solver import Solver
from penode.predictors.tableaus import (
    AB2,
    AB3,
    AB4,
    AB5,
    ADAMS_BASHFORTH,
    DOPRI5,
    EULER,
    HEUN,
    MIDPOINT,
    RALSTON,
    RK3,
    RK4,
    RK4_38,
    RUNGE_KUTTA,
    AdamsBashforthTable,
    ButcherTableau,
)
from penode.training.coarse_to_fine import CoarseToFine
from penode.training.covariance import Reported
from penode.training.first_order import FirstOrder
from penode.training.gauss_newton_terms import GaussNewtonTerms, residual_scale
from penode.training.loss import (
    Discounted,
    Loss,
    Prefilter,
    channel_deviation,
    equation,
    every_step,
    increment_deviation,
    last_step,
    states,
)
from penode.training.multi_start import BestOf
from penode.training.penalties import (
    GaussianPrior,
    Orthogonality,
    Penalty,
    Priors,
    Smoothness,
    SoftReciprocity,
    WeightDecay,
)
from penode.training.plan import Optimiser, Problem, Solution
from penode.training.residuals import Objective
from penode.training.second_order import LevenbergMarquardt
from penode.training.weak_form import WeakRegression, weak_regression
from penode.validation.comparison import Comparison
from penode.validation.coverage import supported
from penode.validation.free_run import compare
from penode.validation.residual_lines import Line, find_lines, power_spectrum
from penode.validation.residual_tests import (
    Correlations,
    Spectrum,
    residual_correlations,
    residual_spectrum,
)

__all__ = [
    "AB2",
    "AB3",
    "AB4",
    "AB5",
    "ADAMS_BASHFORTH",
    "DOPRI5",
    "EULER",
    "HEUN",
    "HORIZONS",
    "MIDPOINT",
    "RALSTON",
    "RK3",
    "RK4",
    "RK4_38",
    "RUNGE_KUTTA",
    "AdamsBashforth",
    "AdamsBashforthTable",
    "Anchor",
    "BandLimitedHold",
    "BestOf",
    "Bounded",
    "ButcherTableau",
    "Checkpoint",
    "Choice",
    "Climb",
    "CoarseToFine",
    "Comparison",
    "Contribution",
    "ConvexGradient",
    "Correlations",
    "Discounted",
    "Estimate",
    "Excerpt",
    "Finding",
    "FirstOrder",
    "FirstOrderHold",
    "GaussNewtonTerms",
    "GaussianPrior",
    "Gradient",
    "HeldOut",
    "Hold",
    "HorizonChoice",
    "HorizonFit",
    "HorizonSummary",
    "Identity",
    "Imperfection",
    "ImplicitMidpoint",
    "Inputs",
    "LadderProblem",
    "Layout",
    "Leaf",
    "LearnedMap",
    "LearnedPrior",
    "LearnedUncertainty",
    "LevenbergMarquardt",
    "Line",
    "LinearSkip",
    "Longest",
    "Loss",
    "LossWeighting",
    "Normal",
    "Objection",
    "Objective",
    "Optimiser",
    "Origin",
    "Orthogonality",
    "Penalty",
    "Placement",
    "Plateau",
    "Polynomial",
    "Positive",
    "PositiveDefinite",
    "Prefilter",
    "Priors",
    "Problem",
    "QuadraticSkip",
    "Reported",
    "RungeKutta",
    "Scaled",
    "Selector",
    "Smoothness",
    "SoftReciprocity",
    "Solution",
    "Solver",
    "Spectrum",
    "Spline",
    "Substeps",
    "Sweep",
    "TanhLayers",
    "Transform",
    "Trapezoidal",
    "WeakRegression",
    "WeightDecay",
    "ZeroOrderHold",
    "channel_deviation",
    "check_excitation",
    "compare",
    "cut",
    "default_plan",
    "equation",
    "every_step",
    "excerpt",
    "find_lines",
    "fitting_plan",
    "float64",
    "increment_deviation",
    "inspect",
    "last_step",
    "linearised",
    "loss_weighting",
    "power_spectrum",
    "read",
    "residual_correlations",
    "residual_scale",
    "residual_spectrum",
    "states",
    "supported",
    "sweep",
    "weak_regression",
    "weight_matrix",
    "with_batch_axis",
]


def __dir__() -> list[str]:
    return sorted(__all__)
