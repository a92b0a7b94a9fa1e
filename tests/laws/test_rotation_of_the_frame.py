"""The voltage equation is the same in a frame turned by any constant angle."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from penode import Predictor
from penode.arrays import float64
from penode.models.parameters import with_batch_axis


def turned(model, rotation):
    """Return the machine that holds psi'(i') = Q psi(Q' i')."""
    network = model.flux.network
    network = replace(
        network,
        offset=rotation @ network.offset,
        stiffness=rotation @ network.stiffness @ rotation.T,
        directions=network.directions @ rotation.T,
    )
    return replace(model, flux=replace(model.flux, network=network))


@pytest.mark.parametrize("angle", [0.4, np.pi / 2, -2.0])
def test_predictions_turn_with_the_frame(systems, rng, angle):
    model = systems["coenergy machine"].model
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    currents, voltages = rng.uniform(-80, 80, (2, 2, 40))
    speed = rng.uniform(-300, 300, (1, 40))
    predictor = Predictor(1e-3)
    step = jax.jit(lambda model, x, u: predictor.step(model, x[None], lambda offset: u)[0])
    with float64():
        plain = np.asarray(step(with_batch_axis(model), currents, np.vstack([voltages, speed])))
        seen = step(
            with_batch_axis(turned(model, rotation)),
            rotation @ currents,
            np.vstack([rotation @ voltages, speed]),
        )
    assert np.abs(plain - currents).max() > 1.0
    np.testing.assert_allclose(seen, rotation @ plain, rtol=0, atol=1e-11)
