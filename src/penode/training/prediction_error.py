"""The prediction error: where a window starts, how it goes on, and what is compared. One for all.

Loss, gradient, Gauss-Newton terms, scores and estimated starts all call these functions.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import (
    SHORTEST,
    FloatArray,
    IntArray,
    JaxArray,
    on_device,
    shared_length,
    with_shared_length,
)
from penode.data.windows import Windows
from penode.errors import InputError
from penode.models.base import Model
from penode.models.explicit_time import driving_channels
from penode.models.inputs import Inputs
from penode.models.layout import Layout, Parts
from penode.models.measured import free_states, predicted_outputs
from penode.predictors.base import Predictor
from penode.predictors.delays import Recorded, delayed
from penode.predictors.holds import Drive
from penode.predictors.input_table import Substep
from penode.training.loss import NO_FILTER, Loss, every_step, states


class Batch(eqx.Module):
    """Windows inside compiled code."""

    # States (state, time) of all recordings where windows start: measured, or first guesses.
    states: JaxArray
    # (input, time), or (place * input, time * sub-step) of a predictor with an `InputTable`.
    inputs: JaxArray
    starts: JaxArray
    # Which recording each window is cut from, (batch,).
    recording: JaxArray
    # 1 for windows that count and 0 for padding, (batch,).
    used: JaxArray
    # Of each sample, of a predictor with an `InputTable`; 1 of others.
    substeps: JaxArray
    # Measured outputs (output, time); no rows where states are measured as they are.
    outputs: JaxArray
    # First sample of each recording.
    begins: JaxArray

    def drive(self, step: JaxArray, number: JaxArray | int = 0) -> Drive:
        """Return the inputs by offset from sample `step` of each window.

        With a table they are what sub-step `number` after a sample reads, (place * input, batch).
        """
        begin = self.begins[self.recording]
        return Recorded(self.inputs, self.starts + step, begin, self.substeps, number)

    def of_windows(self, starts: JaxArray, recording: JaxArray, used: JaxArray) -> "Batch":
        """Return other windows of the same recordings."""
        return replace(self, starts=starts, recording=recording, used=used)

    def part(self, first: JaxArray, size: int) -> "Batch":
        """Return `size` windows from the window `first` on."""
        arrays = (self.starts, self.recording, self.used)
        return self.of_windows(*(jax.lax.dynamic_slice(a, (first,), (size,)) for a in arrays))

    def parts(self, most: int) -> tuple[JaxArray, ...]:
        """Return starts, recording and used in parts of at most `most` windows, (part, size).

        The parts are of one size; the last window pads, unused.
        """
        count = len(self.starts)
        number = -(-count // most)
        size = -(-count // number)
        padding = (0, number * size - count)
        starts, recording = (
            jnp.pad(a, padding, mode="edge").reshape(number, size)
            for a in (self.starts, self.recording)
        )
        return starts, recording, jnp.pad(self.used, padding).reshape(number, size)

    def recorded(self, step: JaxArray) -> JaxArray:
        """Return the recorded states (state, batch) at sample `step` of each window."""
        return self.states[:, self.starts + step]

    def output(self, step: JaxArray) -> JaxArray:
        """Return the measured outputs (output, batch) at sample `step` of each window."""
        return self.outputs[:, self.starts + step]


#: Sub-steps that there is room for in a table of so many numbers: one program then serves them all.
_ROOM, _MOST_NUMBERS = 16, 4_000_000


def compiled_windows(
    error: "PredictionError", windows: Windows, capacity: int, order: IntArray | None = None
) -> Batch:
    """Return the windows for compiled code, padded to a length: one program for a whole ladder.

    The last window pads: a rollout from elsewhere could overflow, and zero times that is nan.
    Recordings are padded too, so that others of about the same length share the program. The
    windows' inputs are those that the predictor prepared.
    """
    order = np.arange(len(windows.starts)) if order is None else order
    order = np.pad(order, (0, capacity - len(order)), mode="edge")
    return Batch(
        states=with_shared_length(windows.states.T),
        inputs=_compiled_inputs(error.predictor, windows.inputs),
        starts=on_device(windows.starts[order]),
        recording=on_device(windows.recording[order]),
        used=on_device((np.arange(capacity) < len(windows.starts)).astype(float)),
        substeps=on_device(error.predictor.substeps),
        outputs=with_shared_length(windows.measured.T[: len(error.model.outputs)]),
        begins=on_device(windows.begins),
    )


def _compiled_inputs(predictor: Predictor, inputs: FloatArray) -> JaxArray:
    """Return prepared inputs (time, row) as a batch has them."""
    if predictor.table is None:
        return with_shared_length(inputs.T)
    count = predictor.table.count
    by_substep = inputs.reshape(len(inputs) * count, -1).T
    each = max(shared_length(len(inputs)), SHORTEST)
    roomy = _ROOM * each * len(by_substep) <= _MOST_NUMBERS
    room = max(count, _ROOM) if roomy else max(count, 2)
    missing = [(0, 0), (0, room * each - by_substep.shape[1])]
    return on_device(np.pad(by_substep, missing, mode="edge"))


@dataclass(frozen=True, eq=False)
class PredictionError:
    """Scaled k-step-ahead error of a model.

    Errors are divided by `scale` (quantity,), in the units of the loss's domain; that of noise with
    outliers is part of it. Two are equal if
    one compiled program serves both that takes the scale as an argument and leaves out the
    penalties.
    """

    predictor: Predictor
    layout: Layout[Model]
    scale: FloatArray | JaxArray
    loss: Loss
    model: Model
    # Whether nothing that is measured moves the state, filter or not.
    simulates: bool = False

    def __post_init__(self) -> None:
        unknown = sorted(set(self.loss.free_starts) - set(self.model.states))
        if unknown:
            raise InputError(
                f"free_starts must name states, got {', '.join(unknown)}; the states are "
                f"{', '.join(self.model.states)}."
            )
        if self.model.outputs and self.loss.free_starts:
            raise InputError(
                f"free_starts must be empty for {type(self.model).__name__}, whose outputs make "
                f"every start free, got {', '.join(self.loss.free_starts)}; leave it out."
            )
        hidden = free_states(self.model)
        if hidden and self.loss.domain is not states:
            raise InputError(
                f"{', '.join(hidden)} is not measured, but errors in the equation's "
                "domain need every state; measure errors in the states."
            )
        if self.predictor.past > 1 and (len(self.free) or self.filters or self.encodes):
            names = ", ".join(self.model.states[k] for k in self.free)
            what = f"starts of {names} are to be estimated"
            if not names:
                what = "starts are to be encoded" if self.encodes else "states are to be filtered"
            raise InputError(
                f"{what}, but {self.predictor.solver} starts from {self.predictor.past} samples; "
                "choose a one-step solver."
            )

    @cached_property
    def _form(self) -> tuple[Any, ...]:
        loss = self.loss
        freed = tuple(sorted(loss.free_starts.items()))
        measured = loss.domain, loss.weight, loss.prefilter, loss.noise and loss.noise.degrees
        return self.predictor.program, self.layout, *measured, freed, self.filters, self.encodes

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PredictionError) and self._form == other._form

    def __hash__(self) -> int:
        return hash(self._form)

    def by_time_step(
        self, windows: Windows
    ) -> Iterator[tuple[IntArray, "PredictionError", Windows]]:
        """Yield the windows of each time step, their places among all, and the error of these."""
        for places, alike in windows.by_time_step:
            predictor = self.predictor.at(alike.time_step)
            same = predictor is self.predictor
            yield places, self if same else replace(self, predictor=predictor), alike

    @cached_property
    def free(self) -> IntArray:
        """Rows of the states whose start each window estimates."""
        if self.encodes:
            return np.empty(0, dtype=np.int64)
        freed = {*free_states(self.model), *self.loss.free_starts}
        return np.array([k for k, n in enumerate(self.model.states) if n in freed], dtype=np.int64)

    @property
    def stiffness(self) -> FloatArray | JaxArray:
        """Inverse squared deviations of the starts' corrections, shape (free,)."""
        names = [self.model.states[k] for k in self.free]
        given = [self.loss.free_starts.get(name, np.inf) for name in names]
        if None not in given:
            return np.array(given, dtype=float) ** -2.0
        as_measured = np.array([one is None for one in given])
        deviation = np.array([np.inf if one is None else one for one in given])
        backend = np if isinstance(self.scale, np.ndarray) else jnp
        return backend.where(as_measured, self.scale[self.free], deviation) ** -2.0

    def squares(self, residual: JaxArray) -> JaxArray:
        """Return what of scaled residuals, of any shape, is summed."""
        return residual**2 if self.loss.noise is None else self.loss.noise.squares(residual)

    def squares_of_weighted(self, residual: JaxArray) -> JaxArray:
        """Return what is summed of residuals that were multiplied by the roots of their weights."""
        noise = self.loss.noise
        return residual**2 if noise is None else noise.squares(noise.unweighted(residual))

    def held(self, correction: JaxArray) -> tuple[JaxArray, JaxArray]:
        """Return what corrections (free, batch) of starts are as weighted residuals, and slopes."""
        slope, noise = jnp.sqrt(jnp.asarray(self.stiffness))[:, None], self.loss.noise
        if noise is not None:
            slope = slope * jnp.sqrt(noise.weight(slope * correction))
        return slope * correction, slope

    @cached_property
    def compared(self) -> IntArray:
        """Rows of the outputs, or of the domain's quantity, that are compared."""
        if not self.plain:
            return np.arange(len(self.model.outputs) or len(self.scale))
        unmeasured = self.model.unmeasured
        return np.array([k for k, n in enumerate(self.model.states) if n not in unmeasured])

    @property
    def spent(self) -> int:
        """Values that a window's start takes of those at its steps, beside its first sample's."""
        own = len(self.compared) if self.model.outputs else 0
        return int(np.sum(self.stiffness == 0)) - own

    def start(self, parts: Parts, correction: JaxArray, batch: Batch) -> JaxArray:
        """Return where predictions start, (past, state, batch), present first: what sensors read.

        The correction (free, batch), SI units, is added to the free states.
        """
        model = self._model(parts, batch)
        if self.encodes:
            steps = [jnp.asarray(-j) for j in range(model.encoded_samples)]
            measured = jnp.stack([self._measured(model, step, batch) for step in steps])
            inputs = jnp.stack([self._input(model, step, batch).values for step in steps])
            return model.encoded(measured, inputs)[None]
        past = [
            model.corrected(batch.recorded(jnp.asarray(-j))) for j in range(self.predictor.past)
        ]
        if len(self.free):
            past[0] = past[0].at[self.free].add(correction)
        return jnp.stack(past)

    def step(
        self,
        parts: Parts,
        history: JaxArray,
        step: JaxArray,
        batch: Batch,
        substeps: int | None = None,
    ) -> JaxArray:
        """Return the history (past, state, batch) one sample on from sample `step`.

        Reverse mode wants to know when compiled how many sub-steps there are.
        """
        history = self.updated(parts, history, step, batch)
        if self.predictor.table is None:
            return self.substep(parts, history, step, 0, batch)

        def one(number: JaxArray, history: JaxArray) -> JaxArray:
            return self.substep(parts, history, step, number, batch)

        count = batch.substeps if substeps is None else substeps
        ahead: JaxArray = jax.lax.fori_loop(0, count, one, history)
        return ahead

    @property
    def encodes(self) -> bool:
        """Whether past samples say where a window starts."""
        return self.model.encoded_samples > 0 and not self.simulates

    @property
    def past(self) -> int:
        """Samples up to a window's first that its start is made of."""
        return max(self.predictor.past, self.model.encoded_samples if self.encodes else 0)

    @property
    def filters(self) -> bool:
        """Whether what is measured moves the state on the way."""
        return bool(self.model.covariances) and not self.simulates

    def updated(self, parts: Parts, history: JaxArray, step: JaxArray, batch: Batch) -> JaxArray:
        """Return the history (1, state, batch) behind what was measured at sample `step`."""
        if not self.filters:
            return history
        model = self._model(parts, batch)
        measured = self._measured(model, step, batch)
        return model.filtered(history[0], measured, self._input(model, step, batch))[None]

    def _measured(self, model: Model, step: JaxArray, batch: Batch) -> JaxArray:
        if model.outputs:
            return batch.output(step)
        return model.corrected(batch.recorded(step))[self.compared]

    def substep(
        self,
        parts: Parts,
        history: JaxArray,
        step: JaxArray,
        number: JaxArray | int,
        batch: Batch,
    ) -> JaxArray:
        """Return the history one sub-step on; of a predictor without a table a whole sample.

        How many there are is an argument of compiled code, ``batch.substeps``.
        """
        model, predictor = self._model(parts, batch), self.predictor
        if predictor.table is None:
            return predictor.step(model, history, batch.drive(step))
        rows, start = (
            delayed(model, batch.drive(step, n), predictor.time_step)(0) for n in (number, 0)
        )
        start = start[: len(driving_channels(model))]
        part = Substep(number, batch.substeps, start, predictor.time_step)
        return predictor.table.substep(model, history, rows, part)

    def residual(
        self, parts: Parts, predicted: JaxArray, step: JaxArray, horizon: JaxArray, batch: Batch
    ) -> JaxArray:
        """Return the weighted, scaled error (output, batch) of the prediction for sample `step`.

        The prefilter comes after it. Of a model with outputs the first sample, step 0, counts too,
        as one residual whatever the weight of the steps.
        """
        model, weight = self._model(parts, batch), self.weight(step, horizon)[:, None]
        if model.outputs:
            gap = batch.output(step) - predicted_outputs(
                model, predicted, self._input(model, step, batch)
            )
            return gap * jnp.where(step == 0, 1 / jnp.asarray(self.scale)[:, None], weight)
        measured = model.corrected(batch.recorded(step))
        gap = self.loss.domain(model, measured) - self.loss.domain(model, predicted)
        return (gap * weight)[self.compared]

    def _input(self, model: Model, step: JaxArray, batch: Batch) -> Inputs:
        """Return the input at sample `step` of each window."""
        names = driving_channels(self.model)
        rows = delayed(model, batch.drive(step), self.predictor.time_step)(0)
        return Inputs(rows[: len(names)], names)

    def _model(self, parts: Parts, batch: Batch) -> Model:
        count = self.layout.experiments
        if count == 1:
            return self.layout.model_of(parts)
        own = batch.recording == jnp.arange(count)[:, None]
        return self.layout.model_of(parts, own.astype(parts[0].dtype))

    @property
    def plain(self) -> bool:
        """Whether errors are measured in the states, so that dr/dx is minus the weight."""
        return self.loss.domain is states and not self.model.outputs

    @property
    def is_filtered_one_step(self) -> bool:
        """Whether the loss sums k-step errors as they are: filtered one-step errors, all alike.

        Starts may be estimated, of states that are measured.
        """
        loss = self.loss
        plainly = loss.prefilter == NO_FILTER and loss.noise is None
        as_it_is = loss.weight is every_step and plainly and not (self.filters or self.encodes)
        return self.plain and as_it_is and not self.model.unmeasured

    @property
    def start_stiffness(self) -> FloatArray:
        """What corrections of starts cost, in squares of scaled states, (state,); inf if held."""
        cost = np.full(len(self.model.states), np.inf)
        cost[self.free] = self.stiffness * np.asarray(self.scale)[self.free] ** 2
        return cost

    def weight(self, step: JaxArray, horizon: JaxArray) -> JaxArray:
        """Return what multiplies the error of each quantity, shape (quantity,)."""
        return jnp.sqrt(self.loss.weight(step, horizon)) / jnp.asarray(self.scale)
