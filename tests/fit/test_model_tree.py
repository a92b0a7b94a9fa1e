"""Models and records as JSON values and arrays, and back; what classes are trusted."""

import sys

import jax
import numpy as np
import pytest

from penode.errors import InputError
from penode.fit.archive import from_json, to_json
from penode.fit.model_tree import describe_module, restore_module
from penode.fit.outcome import Contribution


def test_models_round_trip(system):
    arrays = {}
    document = from_json(to_json(describe_module(system.model, "model", arrays), exact=True))
    back = restore_module(document, arrays)
    assert type(back) is type(system.model)
    assert jax.tree.structure(back) == jax.tree.structure(system.model)
    for found, leaf in zip(jax.tree.leaves(back), jax.tree.leaves(system.model), strict=True):
        np.testing.assert_array_equal(found, leaf)


def test_static_fields_are_kept(systems):
    arrays = {}
    document = describe_module(systems["mlp machine"].model, "model", arrays)
    back = restore_module(from_json(to_json(document, exact=True)), arrays)
    assert (back.flux.current_scale, back.flux.flux_scale) == (100.0, 0.4)


@pytest.mark.parametrize(
    ("reference", "reason"),
    [
        ("penode_no_such_module:Model", "cannot be imported"),
        ("penode.no_such_module:Model", "cannot be imported"),
        ("penode.models.networks:NoSuchNetwork", "cannot be imported"),
        ("penode_no_such_module:Model", "add that folder to PYTHONPATH"),
        ("__main__:NoSuchModel", "move it into a module of its own"),
        ("builtins:dict", "is no model"),
        ("os:system", "is no model"),
    ],
)
def test_only_importable_model_parts_are_restored(reference, reason):
    with pytest.raises(InputError, match=rf"{reference}.*{reason}.*[.]$"):
        restore_module({"class": reference, "fields": {}}, {}, trust=True)


def test_records_mappings_and_what_json_has_no_number_for_round_trip():
    record = Contribution("gain", np.inf, "0.5 %")
    tree = (record, {"a": -np.inf, "b": (1.5, None)}, np.array([np.nan, 1.0]))
    arrays = {}
    document = to_json(describe_module(tree, "start", arrays), exact=True)
    found = restore_module(from_json(document), arrays)
    assert found[0] == record
    assert found[1] == {"a": -np.inf, "b": (1.5, None)}
    np.testing.assert_array_equal(found[2], tree[2])


# --- trust ------------------------------------------------------------------------------------

MODULE = """
import pathlib

import penode

pathlib.Path(__file__).with_name("was_run").touch()


class Cart(penode.Model):
    inputs = ("force",)
    mass: object = penode.physical("kg")

    def derivative(self, x, u):
        return x
"""
CART = {"class": "untrusted_cart:Cart", "fields": {"mass": 1.5}}


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Return the folder of a module that says when it is run."""
    (tmp_path / "untrusted_cart.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    sys.modules.pop("untrusted_cart", None)


def test_a_module_outside_penode_is_not_run_unasked(module):
    with pytest.raises(InputError, match=r"untrusted_cart:Cart.*--trust-classes.*trust=True.*[.]$"):
        restore_module(CART, {})
    assert not (module / "was_run").exists()


def test_a_trusted_module_is_run(module):
    assert restore_module(CART, {}, trust=True).mass == 1.5
    assert (module / "was_run").exists()


def test_a_module_that_the_program_has_imported_is_trusted(module):
    import untrusted_cart

    assert isinstance(restore_module(CART, {}), untrusted_cart.Cart)
