"""Values of a learned map, and of its band, over the states that are its arguments."""

import inspect
from dataclasses import dataclass

import numpy as np

from penode.arrays import BoolArray, FloatArray, float64, on_device
from penode.fit.fit import Fit
from penode.fit.outcome import NORMAL_95
from penode.models.parameters import with_batch_axis
from penode.report.quantities import Scale, scale_for, symbol
from penode.report.region_map import RegionGrid
from penode.validation.coverage import supported

#: Space around the excited region, as a fraction of its width.
MARGIN = 0.08


@dataclass(frozen=True, eq=False)
class MapValues:
    """A learned map (component, point), in the unit of ``scale``, at points of its states.

    ``half_band`` is half the width of the 95 % band, nan where there is none; ``inside`` (point,)
    are the points in the excited region; ``titles`` is the markup of each component.
    """

    name: str
    titles: tuple[str, ...]
    values: FloatArray
    half_band: FloatArray
    inside: BoolArray
    scale: Scale


def map_columns(fit: Fit, name: str) -> tuple[int, ...] | None:
    """Return the columns of ``fit.excited`` that a learned map depends on, by argument names.

    None where an argument is no state, unless there are as many arguments as states: they then have
    the order of the states.
    """
    states = fit.model.states
    try:
        signature = inspect.signature(fit.model.maps()[name])
    except ValueError:  # written in C
        return None
    required = [one.name for one in signature.parameters.values() if one.default is one.empty]
    if set(required) <= set(states):
        return tuple(states.index(argument) for argument in required)
    return tuple(range(len(states))) if len(required) == len(states) else None


def region_grid(fit: Fit, columns: tuple[int, int], points: int) -> RegionGrid:
    """Return a grid, ``points`` per axis, around the excited region of two states, with a margin.

    The margin is the same along both axes where the states share a unit.
    """
    names, units = (
        (one[columns[0]], one[columns[1]]) for one in (fit.model.states, fit.model.state_units)
    )
    excited = fit.excited[:, list(columns)]
    low, high = excited.min(axis=0), excited.max(axis=0)
    margin = MARGIN * np.maximum(high - low, 1e-9)
    margin = np.full(2, margin.max()) if units[0] == units[1] else margin
    x, y = (np.linspace(a - m, b + m, points) for a, b, m in zip(low, high, margin, strict=True))
    mesh = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    inside = fit.supported(mesh) if len(fit.model.states) == 2 else supported(excited, mesh)
    markup = (symbol(names[0]), symbol(names[1]))
    return RegionGrid(x, y, np.reshape(inside, (points, points)), excited, markup, units)


def map_values(fit: Fit, name: str, columns: tuple[int, ...], points: FloatArray) -> MapValues:
    """Evaluate a learned map at points (point, argument), SI units, of the states in ``columns``.

    There is a band where the component is an output of the model's ``learned``; it holds for the
    other states at their medians.
    """
    values = np.asarray(getattr(fit, name)(*points.T), dtype=np.float64)
    shape = values.shape[:-1]
    values = np.broadcast_to(values, (*shape, len(points))).reshape(-1, len(points))
    states = np.tile(np.median(fit.excited, axis=0), (len(points), 1))
    states[:, list(columns)] = points
    scale = scale_for(values, fit.model.map_units.get(name, ""))
    titles = [symbol(name) + "".join(f"[{k}]" for k in index) for index in np.ndindex(shape)]
    return MapValues(
        name,
        tuple(titles),
        values * scale.factor,
        NORMAL_95 * scale.factor * _deviation(fit, states, values),
        supported(fit.excited[:, list(columns)], points),
        scale,
    )


def _deviation(fit: Fit, states: FloatArray, values: FloatArray) -> FloatArray:
    """Return the deviation of each component that is an output of ``learned``, else nan."""
    with float64():
        model = with_batch_axis(fit.model)
        outputs = np.asarray(model.learned(on_device(states.T)))
    deviation = np.full(values.shape, np.nan)
    if not len(outputs):
        return deviation
    of_learned = fit.learned_deviation(states).T
    for row, value in enumerate(values):
        for output, output_deviation in zip(outputs, of_learned, strict=True):
            if np.allclose(value, output, rtol=1e-6, atol=1e-9 * float(np.abs(output).max())):
                deviation[row] = output_deviation
    return np.where(np.isfinite(deviation), deviation, np.nan)
