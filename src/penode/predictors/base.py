"""Predictor: model and solver, the map g from the past and the input to the next sample."""

from dataclasses import dataclass

import jax.numpy as jnp

from penode.arrays import FloatArray, JaxArray
from penode.models.base import Model
from penode.predictors.band_limited import BandLimitedHold
from penode.predictors.field import Field
from penode.predictors.holds import Drive, Hold, ZeroOrderHold
from penode.predictors.one_step import RungeKutta
from penode.predictors.places import places_of
from penode.predictors.solver import Solver
from penode.predictors.tableaus import RK4

DEFAULT_SOLVER: Solver = RungeKutta(RK4)
DEFAULT_HOLD: Hold = ZeroOrderHold()


@dataclass(frozen=True)
class Predictor:
    """How a model's next sample is computed: x_(k+1) = g(x_k, ..., u_(k+1), u_k, ..., theta).

    Attributes
    ----------
    time_step : float
        Sampling interval in s.
    solver : Solver
        A Runge-Kutta method, sub-steps of one, a multistep or an implicit method.
    hold : Hold
        The input between samples; u[k] is held from t_k to t_(k+1) by default.
    """

    time_step: float
    solver: Solver = DEFAULT_SOLVER
    hold: Hold = DEFAULT_HOLD

    def __post_init__(self) -> None:
        if isinstance(self.hold, BandLimitedHold):
            hold = self.hold.prepared_for(places_of(self.solver))
            object.__setattr__(self, "hold", hold)

    @property
    def past(self) -> int:
        """Measured samples a prediction starts from, the present one included."""
        return self.solver.past

    def prepared(self, inputs: FloatArray) -> FloatArray:
        """Return a recording's inputs as `step` wants its drive to give them.

        Parameters
        ----------
        inputs : ndarray, shape (time, input)
            Of one recording, or one stretch of it.

        Returns
        -------
        ndarray, shape (time, row)
            The inputs, and behind them what a band-limited hold adds; most holds add nothing.
        """
        return self.hold.prepared(inputs) if isinstance(self.hold, BandLimitedHold) else inputs

    def step(self, model: Model, history: JaxArray, drive: Drive) -> JaxArray:
        """Predict the next sample and put it in front of the history.

        Parameters
        ----------
        model : Model
            Parameters carry a trailing batch axis (1 or batch).
        history : array, shape (past, state, batch)
            State at t_k first, then at t_(k-1) and before.
        drive : callable
            Input (row, batch) by offset from sample k, as `prepared` gives its rows.

        Returns
        -------
        array, shape (past, state, batch)
            Predicted state at t_(k+1) first (paper, eqs. for the explicit single-step, the
            multistep and the implicit predictor).
        """
        field = Field(model, drive, self.hold, self.time_step)
        ahead = self.solver.advance(field, history)[None]
        return ahead if self.past == 1 else jnp.concatenate([ahead, history[:-1]])
