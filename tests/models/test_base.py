"""What a model offers when it writes its derivative only."""

import jax.numpy as jnp
import pytest

from penode import Model


def test_model_cannot_be_made_without_a_derivative():
    with pytest.raises(TypeError, match="derivative"):
        Model()


def test_defaults_are_an_empty_map_and_no_functions(systems):
    model = systems["linear machine"].model
    assert Model.learned(model, jnp.ones((2, 7))).shape == (0, 7)
    assert dict(Model.maps(model)) == {}
