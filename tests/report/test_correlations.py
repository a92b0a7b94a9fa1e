"""What is said of a residual's correlations: no more than chance explains, and no less."""

import numpy as np
import pytest

from penode.report.correlations import correlations, correlations_caption, correlations_title
from penode.validation.residual_tests import Correlations

LAGS = 41
LIMIT = 0.1


def made(own=(), cross=(), limits=(LIMIT, LIMIT)):
    """Return correlations of one state with two inputs; what is given as (lag, size) is not 0."""
    past, inputs = np.zeros((LAGS, 1)), np.zeros((LAGS, 1, 2))
    past[0] = 1.0
    for lag, size in own:
        past[lag] = size
    for lag, which, size in cross:
        inputs[lag, 0, which] = size
    of = ("run.csv", ("i",), ("u", "omega"))
    return Correlations(*of, past, LIMIT, inputs, np.array([limits]))


def beyond(count, size=1.5 * LIMIT):
    return [(1 + k, (-1) ** k * size) for k in range(count)]


@pytest.mark.parametrize(
    ("own", "white"),
    [
        ((), True),
        (beyond(2), True),  # of 40 lags, 5 %
        (beyond(3), False),
        ([(7, 1.9 * LIMIT)], True),
        ([(7, -2.1 * LIMIT)], False),  # chance is there once in four million lags
    ],
)
def test_a_residual_is_white_as_long_as_chance_explains_it(own, white):
    title, caption = (say(made(own)) for say in (correlations_title, correlations_caption))
    said = "is white" if white else "is correlated with its past"
    assert title == f"The residual {said} and unrelated to the inputs"
    assert ("textbook deviations are wrong" in caption) == (not white)
    assert "response that the model lacks" not in caption


@pytest.mark.parametrize(
    ("own", "noise"),
    [
        ([(1, -0.5)], True),
        ([(1, -0.5), (7, -2.1 * LIMIT)], False),
        ([(1, -0.7)], False),
        ([(1, 0.5)], False),
        ((), False),
    ],
)
def test_noise_that_two_predictions_share_is_called_so(own, noise):
    title, caption = (say(made(own)) for say in (correlations_title, correlations_caption))
    assert (title == "The residual is the sensors' noise and unrelated to the inputs") == noise
    assert ("gives -0.5 at a lag of one sample" in caption) == ((1, -0.5) in own)
    assert ("textbook deviations are wrong" in caption) == (bool(own) and not noise)


def test_the_input_named_is_the_furthest_beyond_its_own_limit():
    """The speed's correlation is larger; but so is what chance gives it."""
    found = made(cross=[(3, 0, -0.3), (3, 1, 0.35)], limits=(0.1, 0.3))
    assert correlations_title(found) == (
        "The residual is white and related to u (correlation up to 0.30)"
    )
    assert "response that the model lacks" in correlations_caption(found)


def test_without_inputs_only_the_past_is_spoken_of():
    alone = Correlations("run.csv", ("i",), (), made().own, LIMIT)
    assert correlations_title(alone) == "The residual is white"


def test_bands_are_the_limits_and_an_input_has_one_colour():
    figure = correlations(made(limits=(0.2, 0.4)))
    assert [(s.y0, s.y1) for s in figure.layout.shapes] == [(-LIMIT, LIMIT), (-0.4, 0.4)]
    inputs = [trace for trace in figure.data if trace.legendgroup in ("u", "omega")]
    assert len({trace.line.color for trace in inputs}) == 2
