"""Gauss-Newton sums over all windows: chunk by chunk, which caches hold, and side by side."""

import math
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache, lru_cache, partial
from typing import NamedTuple, TypeAlias, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from penode.arrays import (
    SHORTEST,
    FloatArray,
    IntArray,
    JaxArray,
    float64,
    on_device,
    shared_length,
)
from penode.data.windows import Windows
from penode.native.normal_matrix import NormalMatrix
from penode.predictors.base import Predictor
from penode.training.free_starts import sums_without_starts
from penode.training.prediction_error import Batch, PredictionError, compiled_windows

Result = TypeVar("Result")

#: Most windows a chunk, and bytes its sensitivities may have to stay near the core in its caches.
#: Of the few long windows of a short recording two chunks go side by side, hardly padded, of the
#: shortest recordings chunks half as wide; beyond `_LONG` samples most windows are short and many,
#: for which chunks twice as wide are faster.
#: Of models of many states or parameters not even half as many stay near, and windows are few.
CHUNK, _NARROW, _NEAR, _LONG = 32, 4, 131_072, 100_000
#: Windows that go through together where each has results of its own, of many windows.
_BLOCK = 128
#: Parts of the windows that are summed side by side: as many on every machine, so that a sum does
#: not depend on the number of cores.
STRANDS = 4
#: Parts of the first state's range: windows that start in one of them follow each other.
_PARTS = 10


class WindowSums(NamedTuple):
    """Sums over windows; S = -dr/d(value) is the slope of the residual r."""

    # r'r.
    squares: FloatArray
    # S'S, (value, value).
    normal: FloatArray
    # S'r of each window, (value, window).
    scores: FloatArray
    # Corrections of the windows' starts, (free, window), SI units.
    starts: FloatArray
    # Whether one was too far for one step from where it was looked for.
    far: bool


def summed(
    error: PredictionError,
    raw: FloatArray,
    windows: Windows,
    normal: bool = True,
    guess: FloatArray | None = None,
) -> WindowSums:
    """Return sums over windows, whose starts are looked for from a guess of them or from zero.

    One program serves every horizon and number of windows cut from the same recordings of one time
    step. Where `normal` is not wanted, what is returned in its place means nothing.
    """
    if guess is None:
        guess = np.zeros((len(error.free), len(windows)))
    parts = [
        (places, _summed(own, raw, alike, normal, guess[:, places]))
        for places, own, alike in error.by_time_step(windows)
    ]
    if len(parts) == 1:
        return parts[0][1]
    back = np.argsort(np.concatenate([places for places, _ in parts]))
    alone = [sums for _, sums in parts]
    return WindowSums(
        np.sum([sums.squares for sums in alone], axis=0),
        np.sum([sums.normal for sums in alone], axis=0),
        np.concatenate([sums.scores for sums in alone], axis=1)[:, back],
        np.concatenate([sums.starts for sums in alone], axis=1)[:, back],
        any(sums.far for sums in alone),
    )


def _summed(
    error: PredictionError, raw: FloatArray, windows: Windows, normal: bool, guess: FloatArray
) -> WindowSums:
    """Return the sums over windows of one time step."""
    order, batch, length = _laid_out(error, error.predictor, windows)
    with float64():
        guessed = np.pad(guess[:, order], ((0, 0), (0, len(batch.starts) - len(order))))
        shared = on_device(raw), on_device(error.scale), (batch, on_device(guessed))

    def add_up(first: int, count: int) -> Sequence[FloatArray]:
        with float64():
            span = first, count, int(normal)
            sums = _sum_over_chunks(error, *shared, span, windows.horizon)
            return [np.asarray(part) for part in sums]

    firsts = range(0, len(order), length)
    counts = [min(length, len(order) - first) for first in firsts]
    add_up(0, 0)  # compiles, where that is still to be done, once
    strands = list(_workers().map(add_up, firsts, counts))
    with np.errstate(invalid="ignore"):  # of rollouts that diverge
        squares, products = (np.sum([part[k] for part in strands], axis=0) for k in (0, 1))
    parts = [[part[k][:, :n] for part, n in zip(strands, counts, strict=True)] for k in (2, 3)]
    scores, starts = (np.concatenate(part, axis=1) for part in parts)
    if windows.horizon > 1:
        back = np.argsort(order)
        scores, starts = scores[:, back], starts[:, back]
    return WindowSums(squares, products, scores, starts, any(part[4] > 1 for part in strands))


@lru_cache(maxsize=2)
def _laid_out(
    error: PredictionError, predictor: Predictor, windows: Windows
) -> tuple[IntArray, Batch, int]:
    """Return windows in the order of their sums, as a batch, and how many a strand has.

    An optimiser asks for sums of the same windows many times. Errors are equal whatever the
    sub-steps, which are those of the predictor.
    """
    samples, order = shared_length(len(windows.states)), _neighbours(windows)
    width = _width(error, max(samples, SHORTEST))
    least = STRANDS * width
    capacity = least * math.ceil(samples / least)
    with float64():
        batch = compiled_windows(replace(error, predictor=predictor), windows, capacity, order)
    return order, batch, width * -(-len(order) // least)


def _neighbours(windows: Windows) -> IntArray:
    """Return the order in which windows near each other in the state space follow each other.

    Learned maps with local bases leave most columns of such a chunk at zero, which cost nothing
    then. Windows of one step are near each other as they come.
    """
    if windows.horizon == 1:
        return np.arange(len(windows.starts))
    start = windows.states[windows.starts]
    first = start[:, 0]
    part = np.floor((first - first.min()) / max(np.ptp(first), 1e-300) * _PARTS)
    return np.lexsort((start[:, -1], part))


def _width(error: PredictionError, samples: int) -> int:
    """Return how many windows a chunk has, of recordings padded to so many samples."""
    each = 8 * len(error.model.states) * (error.layout.size + len(error.free))
    widest = 2 * CHUNK if samples > _LONG else CHUNK if samples > SHORTEST else CHUNK // 2
    return next((n for n in (widest, CHUNK, CHUNK // 2) if n * each <= _NEAR), _NARROW)


class Block(NamedTuple):
    """A few windows of one time step; the batch is longer, and so are the corrections."""

    # Of each window among all, (window,).
    places: IntArray
    error: PredictionError
    horizon: int
    # Of the windows' starts, (free, batch), SI units.
    corrections: JaxArray
    batch: Batch


def over_blocks(
    function: Callable[[Block], Result],
    error: PredictionError,
    windows: Windows,
    corrections: FloatArray,
) -> Iterator[Result]:
    """Apply a function of float64 to windows, block by block and side by side.

    Corrections of their starts are (free, window), SI units. Blocks are of one size, or as wide as
    a chunk where windows are few: two programs serve any number of windows.
    """
    width = _BLOCK if len(windows) > _BLOCK else _width(error, len(windows.states))

    def of_block(given: tuple[IntArray, PredictionError, Windows]) -> Result:
        places, of_step, few = given
        own = np.pad(corrections[:, places], ((0, 0), (0, width - len(few))), mode="edge")
        with float64():
            batch = compiled_windows(of_step, few, width)
            return function(Block(places, of_step, few.horizon, on_device(own), batch))

    parts = [
        (places[first : first + width], of_step, alike.among(slice(first, first + width)))
        for places, of_step, alike in error.by_time_step(windows)
        for first in range(0, len(alike), width)
    ]
    yield of_block(parts[0])  # compiles, where that is still to be done
    yield from _workers().map(of_block, parts[1:])


_Totals: TypeAlias = tuple[JaxArray, NormalMatrix, JaxArray, JaxArray, JaxArray]


@partial(jax.jit, static_argnums=0)
def _sum_over_chunks(
    error: PredictionError,
    raw: JaxArray,
    scale: JaxArray,
    given: tuple[Batch, JaxArray],
    span: tuple[JaxArray, JaxArray, JaxArray],
    horizon: JaxArray,
) -> tuple[JaxArray, ...]:
    """Sum over a span of windows: the first, how many, and whether the normal matrix is wanted.

    Given are all windows, and a guess of the corrections of their starts (free, window).
    """
    (windows, guess), (first, count, wanted) = given, span
    error = replace(error, scale=scale)
    values = error.layout.values(raw)
    size, capacity = values.shape[0], windows.starts.shape[0] // STRANDS
    width = _width(error, windows.states.shape[1])

    def chunk(number: JaxArray, sums: _Totals) -> _Totals:
        batch = windows.part(first + number * width, width)
        guessed = jax.lax.dynamic_slice_in_dim(guess, first + number * width, width, axis=1)
        squares, scores, normal, corrections, attempts = sums_without_starts(
            error, values[:, None], horizon, batch, sums[1], guessed
        )
        here = (jnp.zeros_like(number), number * width)
        scores = jax.lax.dynamic_update_slice(sums[2], scores, here)
        corrections = jax.lax.dynamic_update_slice(sums[3], corrections, here)
        most = jnp.maximum(sums[4], attempts)
        return sums[0] + jnp.sum(squares), normal, scores, corrections, most

    nothing = (
        jnp.zeros((), values.dtype),
        NormalMatrix.zero(size, values, wanted),
        jnp.zeros((size, capacity), values.dtype),
        jnp.zeros((len(error.free), capacity), values.dtype),
        jnp.zeros((), int),
    )
    chunks = (count + width - 1) // width
    squares, normal, scores, *rest = jax.lax.fori_loop(0, chunks, chunk, nothing)
    return squares, normal.whole, scores, *rest


@cache
def _workers() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(min(STRANDS, os.cpu_count() or 1), thread_name_prefix="penode")
