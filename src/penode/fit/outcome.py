"""What a fit says of each physical parameter, of each horizon, and of the one selected."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from penode.validation.metrics import NORMAL_95 as NORMAL_95

#: Verdicts under which the horizons that agree are one answer.
AGREED = ("plateau", "H = 1 suffices")

#: Verdict on a result that objections speak against.
IMPLAUSIBLE = "implausible"

#: Verdict on a result that recordings do not determine.
NOT_IDENTIFIABLE = "not identifiable"

#: Verdicts under which the data cannot answer.
_REFUSED = ("no plateau", NOT_IDENTIFIABLE, IMPLAUSIBLE)


@dataclass(frozen=True)
class Objection:
    """One thing that speaks against a result.

    Attributes
    ----------
    name : str
        Of the kind, in two or three words.
    reason, repair : str
        What was found, and the cheapest repair, a sentence each.
    verdict : str
        ``"implausible"`` of what makes a result wrong however narrow its intervals are, or
        ``"not identifiable"``.
    """

    name: str
    reason: str
    repair: str
    verdict: str = IMPLAUSIBLE


@dataclass(frozen=True)
class Contribution:
    """One row of the uncertainty budget of a quantity (JCGM 100:2008).

    Attributes
    ----------
    source : str
        What the uncertainty comes from, in a few words.
    std : float
        Standard deviation that it contributes, in the quantity's unit.
    accuracy : str
        What was assumed of the source, such as ``"0.5 %"``; empty where the data show it.
    remedy : str
        What would make it smaller, as a sentence.
    origin : str
        Of an accuracy of the bench: ``"assumed"``, ``"declared"`` in the study, or ``"estimated"``
        from the recordings; empty of other rows.
    """

    source: str
    std: float
    accuracy: str = ""
    remedy: str = ""
    origin: str = ""


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
        Fraction of the parameter's low-passed regressor that no regressor of the learned map
        explains: 1 is independent, 0 is indistinguishable; None where it was not computed.
    meaning : str
        What it is, in a few words; empty where the model does not say.
    budget : tuple of Contribution
        What the standard deviation is made of, the largest first; the squares add.
    """

    value: float
    std: float
    interval_95: tuple[float, float]
    unit: str
    identifiability: float | None = None
    meaning: str = ""
    budget: tuple[Contribution, ...] = ()

    @property
    def statistical_std(self) -> float:
        """Standard deviation that the data themselves show, nothing assumed of their sensors."""
        if not self.budget:
            return self.std
        return float(np.sqrt(sum(row.std**2 for row in self.budget if not row.accuracy)))

    @property
    def sensor_std(self) -> float:
        """Standard deviation by the accuracy of sensors, assumed or declared, in ``unit``.

        Sensors err alike in all that is measured by them.
        """
        rows = (row for row in self.budget if row.origin in ("assumed", "declared"))
        return float(np.sqrt(sum(row.std**2 for row in rows)))

    @property
    def statistical_interval_95(self) -> tuple[float, float]:
        """Ends of the 95 % interval that the data themselves show."""
        if not any(row.accuracy for row in self.budget):
            return self.interval_95
        half = NORMAL_95 * self.statistical_std
        return self.value - half, self.value + half

    @classmethod
    def of(
        cls,
        value: float,
        std: float,
        unit: str,
        identifiability: float | None = None,
        meaning: str = "",
        budget: tuple[Contribution, ...] = (),
    ) -> "Estimate":
        """Return the estimate with its 95 % interval; the arguments are attributes."""
        half = NORMAL_95 * std
        interval = (value - half, value + half)
        return cls(value, std, interval, unit, identifiability, meaning, budget)


@dataclass(frozen=True)
class HorizonSummary:
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
        Free-run error on the training recordings over all states; None where it diverged or the
        states' units differ.
    free_run_errors : mapping of str to float or None
        The same of each state, in its unit.
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
    free_run_errors: Mapping[str, float | None] = field(default_factory=dict)


@dataclass(frozen=True)
class HorizonChoice:
    """The selected horizon and why.

    Attributes
    ----------
    selected : int
        Steps of one sample.
    verdict : str
        ``"plateau"``, ``"H = 1 suffices"``, ``"predicts best"``, ``"fixed"``, ``"no plateau"``,
        ``"not identifiable"``, ``"implausible"`` or ``"stopped"``. The data cannot answer under
        ``"no plateau"``, ``"not identifiable"`` and ``"implausible"``; under ``"predicts best"``,
        ``"fixed"``, and ``"stopped"`` by a person before the end of ladder or cross-check, that is
        not known.
    reason : str
        One or two sentences for a person.
    ladder : tuple of HorizonSummary
        Every horizon tried, shortest first.
    plateau : tuple of int
        Horizons that agree with the selected one.
    objections : tuple of Objection
        What speaks against the result as a whole; the first of them gives the reason.
    """

    selected: int
    verdict: str
    reason: str
    ladder: tuple[HorizonSummary, ...]
    plateau: tuple[int, ...] = ()
    objections: tuple[Objection, ...] = ()

    @property
    def answered(self) -> bool:
        """Whether the data could answer, as far as was tested."""
        return self.verdict not in _REFUSED
