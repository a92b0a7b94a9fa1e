"""What a fit says of each physical parameter, of each horizon, and of the one selected."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

#: Verdicts under which the horizons that agree are one answer, and their mean is reported.
AVERAGED = ("plateau", "H = 1 suffices")


@dataclass(frozen=True)
class Estimate:
    """One physical parameter as reported.

    Attributes
    ----------
    value, std : float
        Estimate and its standard deviation, in ``unit``.
    interval_95 : tuple of float
        Lower and upper end of the 95 % interval, in ``unit``.
    unit : str
        SI unit.
    identifiability : float or None
        Share of the parameter's low-passed regressor that no regressor of the learned map explains:
        1 is independent, 0 is indistinguishable; None where it was not computed.
    """

    value: float
    std: float
    interval_95: tuple[float, float]
    unit: str
    identifiability: float | None = None


@dataclass(frozen=True)
class Rung:
    """One horizon of the ladder.

    Attributes
    ----------
    horizon : int
        Steps of one sample.
    parameters, std : mapping of str to float
        Physical parameters and their standard deviations (HAC sandwich), SI units.
    rmse : float
        Root mean squared k-step-ahead error on the training windows: in the states' unit, or in
        standard deviations of the channels where units differ.
    free_run_rmse : float or None
        Free-run error on the training recordings, in the state's unit; None where it diverged.
    iterations : int
        Gauss-Newton evaluations spent.
    outcome : str
        Why the optimiser stopped, as a sentence.
    """

    horizon: int
    parameters: Mapping[str, float]
    std: Mapping[str, float]
    rmse: float
    free_run_rmse: float | None
    iterations: int
    outcome: str


@dataclass(frozen=True)
class HorizonChoice:
    """The selected horizon and why.

    Attributes
    ----------
    selected : int
        Steps of one sample.
    verdict : str
        ``"plateau"``, ``"H = 1 suffices"``, ``"predicts best"``, ``"fixed"``, ``"no plateau"``,
        ``"not identifiable"`` or ``"stopped"``. The data cannot answer under ``"no plateau"`` and
        ``"not identifiable"``; under ``"predicts best"``, ``"fixed"``, and ``"stopped"`` by a
        person before the ladder's end, that is not known.
    reason : str
        One or two sentences for a person.
    ladder : tuple of Rung
        Every horizon tried, shortest first.
    plateau : tuple of int
        Horizons that agree with the selected one.
    """

    selected: int
    verdict: str
    reason: str
    ladder: tuple[Rung, ...]
    plateau: tuple[int, ...] = ()

    @property
    def answered(self) -> bool:
        """Whether the data could answer, as far as was tested."""
        return self.verdict not in ("no plateau", "not identifiable")


def estimate_of(document: Mapping[str, Any]) -> Estimate:
    """Return an estimate from its JSON; null is not a number."""
    value, std, *interval = (
        np.nan if number is None else float(number)
        for number in (document["value"], document["std"], *document["interval_95"])
    )
    low, high = interval
    return Estimate(value, std, (low, high), document["unit"], document["identifiability"])


def horizon_of(document: Mapping[str, Any]) -> HorizonChoice:
    """Return a choice of the horizon from its JSON."""
    ladder = tuple(Rung(**rung) for rung in document["ladder"])
    return HorizonChoice(**{**document, "ladder": ladder, "plateau": tuple(document["plateau"])})
