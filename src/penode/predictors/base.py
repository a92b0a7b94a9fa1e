"""Predictor: model and solver, the map g from the past and the input to the next sample."""

from dataclasses import dataclass, replace
from functools import cached_property

import jax.numpy as jnp

from penode.arrays import FloatArray, JaxArray
from penode.data.rates import alike
from penode.models.base import Model
from penode.predictors.band_limited import BandLimitedHold
from penode.predictors.delays import delayed
from penode.predictors.field import Field
from penode.predictors.holds import Drive, Hold, RecordedHold, ZeroOrderHold
from penode.predictors.input_table import InputTable
from penode.predictors.one_step import RungeKutta, Substeps
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

    @cached_property
    def table(self) -> InputTable | None:
        """What sub-steps or a band-limited hold read between samples; None without them."""
        needed = isinstance(self.solver, Substeps) or isinstance(self.hold, BandLimitedHold)
        if self.past > 1 or not needed or not isinstance(self.hold, RecordedHold):
            return None
        return InputTable.of(self.solver, self.hold)

    @property
    def substeps(self) -> int:
        """Of each sample."""
        return self.table.count if self.table else 1

    @property
    def program(self) -> tuple[object, ...]:
        """What compiled code depends on that is given inputs and sub-steps at run time."""
        if self.table is None:
            return self.time_step, self.solver, self.hold
        return self.time_step, self.table.solver, self.table.places

    def at(self, time_step: float) -> "Predictor":
        """Return the predictor of another time step in s; itself where that is its own."""
        return self if alike(self.time_step, time_step) else replace(self, time_step=time_step)

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
            The inputs and, where a table is needed, those at all places of all sub-steps.
        """
        return self.table.rows(inputs) if self.table else inputs

    def step(self, model: Model, history: JaxArray, drive: Drive) -> JaxArray:
        """Predict the next sample and put it in front of the history.

        Parameters
        ----------
        model : Model
            Parameters carry a trailing batch axis (1 or batch).
        history : array, shape (past, state, batch)
            State at t_k first, then at t_(k-1) and before.
        drive : callable
            Input (row, batch) by offset from sample k, as `prepared` gives its rows. Of a model
            with delayed inputs offsets lie far back, and may differ over the batch.

        Returns
        -------
        array, shape (past, state, batch)
            Predicted state at t_(k+1) first (paper, eqs. for the explicit single-step, the
            multistep and the implicit predictor).
        """
        drive = delayed(model, drive, self.time_step)
        if self.table:
            return self.table.step(model, history, drive(0), self.time_step)
        field = Field(model, drive, self.hold, self.time_step)
        ahead = self.solver.advance(field, history)[None]
        return ahead if self.past == 1 else jnp.concatenate([ahead, history[:-1]])
