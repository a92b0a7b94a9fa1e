"""Autocovariance of residuals: how far it reaches, and what it makes of an estimate."""

import math

import numpy as np

from penode.arrays import FloatArray

#: Most correlation from a sample to the next that a bandwidth is made for.
_MOST_ALIKE = 0.97


def bandwidth_of(series: FloatArray) -> int:
    """Return over how many samples series (quantity, sample) are correlated.

    That of Andrews for a series of the first order (Econometrica 59 (1991) 817,
    doi:10.2307/2938229), at least samples^(1/3).
    """
    samples, series = series.shape[1], np.nan_to_num(series)
    power = np.sum(series[:, :-1] ** 2, axis=1)
    along = np.sum(series[:, 1:] * series[:, :-1], axis=1)
    rho = np.clip(along / np.maximum(power, 1e-300), 0.0, _MOST_ALIKE)
    wanted = 1.1447 * (4 * rho**2 / (1 - rho**2) ** 2 * samples) ** (1 / 3)
    return math.ceil(float(np.max(wanted, initial=samples ** (1 / 3))))


def score_covariance(slopes: FloatArray, residual: FloatArray) -> FloatArray:
    """Return the covariance (estimate, estimate) of sum_t S_t' r_t under r's own autocovariance.

    Slopes are (output, estimate, time), residuals (output, time). The autocovariance is tapered as
    by Newey and West (1987, doi:10.2307/1913610).
    """
    samples, lags = residual.shape[1], bandwidth_of(residual)
    total = np.zeros((slopes.shape[1], slopes.shape[1]))
    for lag in range(min(lags, samples)):
        early, late = slice(0, samples - lag), slice(lag, samples)
        gamma = residual[:, early] @ residual[:, late].T / samples
        part = np.einsum(
            "qft,qr,rgt->fg", slopes[..., early], gamma, slopes[..., late], optimize=True
        )
        total += (1 - lag / lags) * (part if lag == 0 else part + part.T)
    return total


def effective_number(residual: FloatArray) -> float:
    """Return of how many independent values a residual (time,) says as much: N / (1 + 2 sum r_k).

    After Bayley and Hammersley (J. R. Stat. Soc. Suppl. 8 (1946) 184, doi:10.2307/2983560), with
    autocorrelations r_k tapered over the residual's own bandwidth; NaN of one that is not finite.
    """
    samples = len(residual)
    if not np.isfinite(residual).all():
        return np.nan
    power, lags = float(residual @ residual), bandwidth_of(residual[None])
    if power == 0:
        return float(samples)
    along = [residual[lag:] @ residual[: samples - lag] for lag in range(1, min(lags, samples))]
    taper = 1 - np.arange(1, len(along) + 1) / lags
    longer = 1 + 2 * float(taper @ np.array(along)) / power
    return samples / max(longer, 1.0)
