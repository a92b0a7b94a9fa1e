"""The Lissajous reference against its formula."""

import numpy as np

from penode.pmsm.bench.references import Lissajous


def test_it_follows_the_formula_and_stays_in_the_disc():
    time = np.arange(20000) * 1e-4
    i_d, i_q = Lissajous(300.0, rate_d=14.0, rate_q=15.0)(time).T
    np.testing.assert_allclose(i_q, 300.0 * np.sin(15.0 * time), atol=1e-12)
    np.testing.assert_allclose(
        i_d, 300.0 * np.abs(np.cos(15.0 * time)) * np.sin(14.0 * time), atol=1e-5
    )
    length = np.hypot(i_d, i_q)
    assert length.max() <= 300.0 * (1 + 1e-12)
    assert i_d.min() < -295.0
    assert i_d.max() > 295.0
