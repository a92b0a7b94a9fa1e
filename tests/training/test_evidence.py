"""What data say of a learned part, as a Gaussian."""

import numpy as np

from penode.data.windows import Windows
from penode.training.covariance import ScoreSeries
from penode.training.evidence import Information, Rows
from penode.training.gauss_newton_terms import GaussNewtonTerms


def test_information_that_rounding_makes_indefinite_still_has_an_evidence(rng):
    """The Schur complement of columns that the others span is zero, and rounding is as it likes."""
    span, scores = rng.normal(size=(400, 3)), rng.normal(size=(6, 400))
    columns = np.concatenate([span, span @ rng.normal(size=(3, 2)), rng.normal(size=(400, 1))], 1)
    normal = columns.T @ columns
    normal[3:5, 3:5] -= 1e-10 * normal[3:5, 3:5].max() * np.eye(2)
    terms = GaussNewtonTerms(1.0, 400, normal, scores.sum(axis=1), scores)
    starts = np.arange(400)
    windows = Windows(np.zeros((401, 1)), np.zeros((401, 0)), starts, 0 * starts, 1, 1, 1.0)
    data = Information.of(terms, np.arange(6) >= 3, ScoreSeries.of_windows(windows))
    assert np.linalg.eigvalsh(data.matrix)[0] >= -1e-15 * np.linalg.eigvalsh(data.matrix)[-1]
    assert np.isfinite(Rows(1e-8 * np.eye(3), np.zeros(3)).evidence(data))
