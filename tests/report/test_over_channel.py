"""The title of a residual along a channel: what is chance is said to be."""

import numpy as np

from penode.report.over_channel import over_channel_title
from penode.validation.residual_tests import OverChannel


def along(slope):
    random = np.random.default_rng(6)
    angle = random.uniform(-1, 1, 4000)
    residual = random.normal(size=(4000, 2)) + slope * angle[:, None]
    return over_channel_title([OverChannel.of("theta_el", angle, residual)])


def test_the_mean_of_noise_is_chance_and_that_of_a_slope_is_not():
    assert along(0.0).startswith(
        "The mean of the residual is nowhere beyond chance (of its rms at most "
    )
    assert along(0.0).endswith(" % along theta_el)")
    assert along(1.0).startswith("Mean of the residual as a share of its rms: at most ")
