"""Predictor: model and solver, the map g from the past and the input to the next sample."""

from dataclasses import dataclass

from penode.arrays import JaxArray
from penode.models.base import Model
from penode.predictors.one_step import runge_kutta_step
from penode.predictors.tableaus import RK4, ButcherTableau


@dataclass(frozen=True)
class Predictor:
    """How a model's next sample is computed: x_(k+1) = g(x_k, u_k, theta).

    Attributes
    ----------
    time_step : float
        Sampling interval in s; u[k] is held from t_k to t_(k+1).
    solver : ButcherTableau
        Explicit method, one step a sample.
    """

    time_step: float
    solver: ButcherTableau = RK4

    def step(self, model: Model, x: JaxArray, u: JaxArray) -> JaxArray:
        """Predict the next sample.

        Parameters
        ----------
        model : Model
            Parameters carry a trailing batch axis (1 or batch).
        x : array, shape (state, batch)
            State at t_k.
        u : array, shape (input, batch)
            Input held from t_k to t_(k+1).

        Returns
        -------
        array, shape (state, batch)
            Predicted state at t_(k+1) (paper, eq. for the explicit single-step predictor).
        """
        return runge_kutta_step(self.solver, lambda z: model.derivative(z, u), x, self.time_step)
