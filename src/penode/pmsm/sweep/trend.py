"""Trend: how fast a quantity changes over dates, against the scatter about a straight line."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date

import numpy as np
from scipy.special import stdtrit

from penode.arrays import FloatArray

_YEAR = 365.25
#: Confidence from which a change is called a drift: of a hundred machines without, one is.
_CONFIDENCE = 0.99


@dataclass(frozen=True)
class Trend:
    """A straight line through a quantity over dates, its slope in the quantity's unit a year.

    ``half_95`` is half of the slope's 95 % interval, by Student's distribution of the scatter about
    the line; ``significant`` where the 99 % interval leaves zero out.
    """

    mean: float
    per_year: float
    half_95: float
    significant: bool


def trend_of(dates: Sequence[date], values: FloatArray) -> Trend | None:
    """Fit a line to finite values over dates; None below three different dates or four values.

    What all recordings of a bench have in common, such as the gain of a sensor, changes none of
    this; the scatter from recording to recording decides.
    """
    if len(set(dates)) < 3 or len(values) < 4:
        return None
    years = np.array([one.toordinal() for one in dates]) / _YEAR
    line, covariance = np.polyfit(years - years.mean(), values, 1, cov=True)
    slope, deviation = float(line[0]), float(np.sqrt(covariance[0, 0]))
    sure, usual = (float(stdtrit(len(values) - 2, (1 + p) / 2)) for p in (_CONFIDENCE, 0.95))
    significant = abs(slope) > sure * deviation
    return Trend(float(np.mean(values)), slope, usual * deviation, significant)
