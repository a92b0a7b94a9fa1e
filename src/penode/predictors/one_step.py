"""One explicit Runge-Kutta step with the input held over the sample."""

from collections.abc import Callable

from penode.arrays import JaxArray
from penode.predictors.tableaus import ButcherTableau


def runge_kutta_step(
    tableau: ButcherTableau,
    derivative: Callable[[JaxArray], JaxArray],
    x: JaxArray,
    time_step: float,
) -> JaxArray:
    """Advance x' = derivative(x) by one step.

    Parameters
    ----------
    tableau : ButcherTableau
        The method.
    derivative : callable
        Maps a state (state, batch) to its derivative; the input is held inside it.
    x : array, shape (state, batch)
        State at the start of the step.
    time_step : float
        s.

    Returns
    -------
    array, shape (state, batch)
        State at the end of the step.
    """
    slopes = [derivative(x)]
    for row in tableau.a:
        slopes.append(derivative(x + time_step * _weighted(row, slopes)))
    return x + time_step * _weighted(tableau.b, slopes)


def _weighted(weights: tuple[float, ...], slopes: list[JaxArray]) -> JaxArray:
    terms = [w * k for w, k in zip(weights, slopes, strict=True) if w != 0.0]
    return sum(terms[1:], terms[0])
