"""Transforms are bijections onto admissible values; a layout maps trees to vectors and back."""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from penode import InputError, Model
from penode.arrays import float64
from penode.models.layout import Layout
from penode.models.parameters import Normal, Setting, nuisance, parameter, physical, with_batch_axis
from penode.models.parameters import settings as twin_tree
from penode.models.transforms import Bounded, Identity, Positive, PositiveDefinite


def positive_definite(value):
    return np.array_equal(value, value.T) and np.linalg.eigvalsh(value).min() > 0


#: transform -> shapes it takes, and whether a value is admissible.
TRANSFORMS = {
    Identity(): ([(), (3,), (2, 3)], lambda value: np.isfinite(value).all()),
    Positive(): ([(), (3,), (2, 3)], lambda value: (value > 0).all()),
    Bounded(-2.0, 0.5): ([(), (3,), (2, 3)], lambda value: ((value > -2) & (value < 0.5)).all()),
    PositiveDefinite(): ([(1, 1), (2, 2), (4, 4)], positive_definite),
}
CASES = [(t, shape) for t, (shapes, _) in TRANSFORMS.items() for shape in shapes]


@pytest.mark.parametrize(("transform", "shape"), CASES, ids=str)
@settings(max_examples=20)
@given(data=st.data())
def test_transforms_are_bijections_onto_admissible_values(transform, shape, data):
    raw = data.draw(arrays(np.float64, transform.size(shape), elements=st.floats(-3, 3)))
    with float64():
        value = np.asarray(transform.forward(jnp.asarray(raw), shape))
        assert value.shape == shape
        assert value.dtype == np.float64
        assert TRANSFORMS[transform][1](value)
        back = transform.inverse(value)
        again = np.asarray(transform.forward(jnp.asarray(back), shape))
    np.testing.assert_allclose(again, value, rtol=1e-9, atol=1e-12)
    # A factor is known to rounding times the matrix's condition; one of 1e14 can be drawn.
    if not isinstance(transform, PositiveDefinite) or np.linalg.cond(value) < 1e5:
        np.testing.assert_allclose(back, raw, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("transform", "shape"), CASES, ids=str)
def test_transforms_are_smooth_with_full_rank(transform, shape):
    raw = np.linspace(-1, 1, transform.size(shape))
    with float64():
        jacobian = jax.jit(jax.jacfwd(lambda r: transform.forward(r, shape).ravel()))(raw)
    assert np.linalg.matrix_rank(jacobian) == len(raw)


def test_positive_definite_is_the_cholesky_factor_with_logarithmic_diagonal():
    factor = np.array([[2.0, 0.0], [-0.5, 0.1]])
    raw = PositiveDefinite().inverse(factor @ factor.T)
    np.testing.assert_allclose(raw, [np.log(2.0), -0.5, np.log(0.1)], rtol=1e-12)


def test_bounded_is_a_logistic_function_between_its_bounds():
    raw = np.array([-1.0, 0.0, 2.0])
    with float64():
        found = Bounded(1.0, 5.0).forward(jnp.asarray(raw), (3,))
    np.testing.assert_allclose(found, 1.0 + 4.0 / (1 + np.exp(-raw)), rtol=1e-14)


def test_bounded_is_exact_close_to_its_bounds():
    value = np.array([1e-12, 1.0 - 1e-9])
    raw = Bounded(0.0, 1.0).inverse(value)
    np.testing.assert_allclose(raw, [np.log(1e-12), np.log(1e9)], rtol=1e-7)


@pytest.mark.parametrize(
    ("transform", "raw"),
    [(Positive(), -1e3), (Bounded(-2.0, 0.5), -1e3), (Bounded(-2.0, 0.5), 1e3)],
)
def test_what_training_ran_off_to_can_be_taken_up_again(transform, raw):
    """Training may drive a parameter beyond what floats can tell from its bound."""
    with float64():
        value = np.asarray(transform.forward(jnp.full(1, raw), (1,)))
        back = transform.inverse(value)
        assert np.isfinite(back).all()
        again = np.asarray(transform.forward(jnp.asarray(back), (1,)))
    np.testing.assert_allclose(again, value, rtol=1e-12)


@pytest.mark.parametrize(("low", "high"), [(1.0, 1.0), (2.0, -1.0), (0.0, np.nan)])
def test_bounds_that_leave_nothing_are_refused(low, high):
    with pytest.raises(ValueError, match="low must be below high"):
        Bounded(low, high)


class InBounds(Model):
    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ()
    state_units: ClassVar[tuple[str, ...]] = ("m",)

    share: object = physical("1", Bounded(0.0, 1.0))

    def derivative(self, x, u):
        return -self.share * x


@pytest.mark.parametrize("value", [0.0, 1.0, -0.2, 1.7])
def test_a_value_out_of_bounds_or_on_them_is_refused(value):
    with pytest.raises(InputError, match="share must have Bounded values"):
        Layout(InBounds(value)).raw(InBounds(value))


def test_a_parameter_is_copied_as_float64(systems):
    source = np.array(3, dtype=np.float32)
    model = type(systems["linear machine"].model)(L_d=source, L_q=2, R=1, psi=0)
    source[...] = 9
    leaves = (model.L_d, model.L_q, model.R, model.psi)
    assert all(leaf.dtype == np.float64 and leaf.shape == () for leaf in leaves)
    assert model.L_d == 3.0


def test_physical_is_a_scalar_of_the_physical_group():
    setting = physical("ohm", Positive()).metadata["setting"]
    assert setting == Setting("ohm", "physical", True, Positive())
    assert parameter().metadata["setting"] == Setting("", "learned", False, Identity())


def test_priors_and_nuisances_are_settings():
    belief = Normal(0.2, 0.05)
    setting = physical("ohm", prior=belief).metadata["setting"]
    assert setting == Setting("ohm", "physical", True, prior=belief)
    assert parameter(prior=belief).metadata["setting"].prior == belief
    assert parameter().metadata["setting"].prior is None
    setting = nuisance("A", Bounded(-1.0, 1.0), belief).metadata["setting"]
    assert setting == Setting("A", "nuisance", False, Bounded(-1.0, 1.0), belief, True)


class Believed(Model):
    """Priors on a constrained scalar and on a vector, none on what is between them."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ()
    state_units: ClassVar[tuple[str, ...]] = ("m",)

    mass: object = physical("kg", Positive(), Normal(2.0, 0.5))
    free: object = physical("m")
    bend: object = parameter(prior=Normal(-1.0, 4.0))

    def derivative(self, x, u):
        return -x


def test_beliefs_are_standardised_distances_in_units_of_the_values():
    """Of the mass and not of its logarithm."""
    layout = Layout(Believed(3.0, 7.0, [1.0, -3.0]))
    with float64():
        values = layout.values(jnp.asarray(layout.raw(Believed(3.0, 7.0, [1.0, -3.0]))))
        np.testing.assert_allclose(layout.beliefs(values), [2.0, 0.5, -0.5], rtol=1e-13)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("value", [0.0, -1.0])
def test_a_value_that_is_not_admissible_is_refused(systems, value):
    model = type(systems["linear machine"].model)(L_d=value, L_q=2.0, R=1.0, psi=0.0)
    with pytest.raises(InputError, match="L_d"):
        Layout(model).raw(model)


class WithConstant(Model):
    """A model whose author wrote a constant as a plain field."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    inputs: ClassVar[tuple[str, ...]] = ()
    state_units: ClassVar[tuple[str, ...]] = ("m",)

    gravity: float = 9.81

    def derivative(self, x, u):
        return self.gravity - x


def test_a_constant_is_not_trained():
    """Refused with the advice to declare it static, or left alone."""
    try:
        size = Layout(WithConstant()).size
    except InputError:
        return
    assert size == 0


# --- trees and vectors ------------------------------------------------------------------------


def test_settings_are_a_twin_tree(system):
    twin = twin_tree(system.model)
    assert jax.tree.structure(twin) == jax.tree.structure(system.model)
    assert tuple(jax.tree.leaves(twin)) == Layout(system.model).settings


def test_layout_round_trips(system):
    layout = Layout(system.model)
    raw = layout.raw(system.model)
    assert raw.shape == (layout.size,)
    with float64():
        back = layout.plain_model(raw)
        values = np.asarray(layout.values(jnp.asarray(raw)))
    assert jax.tree.structure(back) == jax.tree.structure(system.model)
    leaves = jax.tree.leaves(system.model)
    for found, given_leaf in zip(jax.tree.leaves(back), leaves, strict=True):
        assert isinstance(found, np.ndarray)
        np.testing.assert_allclose(found, given_leaf, rtol=1e-13)
    np.testing.assert_allclose(values, np.concatenate([x.ravel() for x in leaves]), rtol=1e-13)


def test_every_raw_entry_moves_the_model(system, rng):
    layout = Layout(system.model)
    raw = layout.raw(system.model) + 0.1 * rng.normal(size=layout.size)
    with float64():
        np.testing.assert_allclose(layout.raw(layout.plain_model(raw)), raw, rtol=1e-9, atol=1e-12)


def test_batched_model_has_the_batch_axis_last(systems, rng):
    model = systems["coenergy machine"].model
    layout = Layout(model)
    with float64():
        values = np.asarray(layout.values(jnp.asarray(layout.raw(model))))
        batch = values[:, None] * rng.uniform(0.5, 2.0, (len(values), 5))
        batched = layout.model(jnp.asarray(batch))
    for k in range(5):
        member = [np.asarray(leaf)[..., k].ravel() for leaf in jax.tree.leaves(batched)]
        np.testing.assert_array_equal(np.concatenate(member), batch[:, k])
    one = with_batch_axis(model)
    for leaf, plain in zip(jax.tree.leaves(one), jax.tree.leaves(model), strict=True):
        assert leaf.shape == (*plain.shape, 1)


def test_names_are_dotted_paths(systems):
    assert Layout(systems["duffing"].model).names == (
        "spring.weights[0]",
        "spring.weights[1]",
        "spring.biases[0]",
        "spring.biases[1]",
        "mass",
        "damping",
    )


@pytest.mark.parametrize(
    ("name", "physical_names", "values"),
    [
        ("duffing", ("mass", "damping"), (0.7, 0.3)),
        ("linear machine", ("L_d", "L_q", "R", "psi"), (2e-3, 3e-3, 0.2, 0.05)),
        ("mlp machine", ("R",), (0.05,)),
    ],
)
def test_physical_values_are_picked_in_their_units(systems, name, physical_names, values):
    model = systems[name].model
    layout = Layout(model)
    assert layout.physical == physical_names
    with float64():
        vector = layout.values(jnp.asarray(layout.raw(model)))
        np.testing.assert_allclose(layout.physical_values(vector), values, rtol=1e-14)


@pytest.mark.parametrize(
    ("name", "groups", "expected"),
    [
        ("linear machine", None, [1, 1, 1, 1]),
        ("linear machine", (), [0, 0, 0, 0]),
        ("linear machine", ("magnet",), [0, 0, 0, 1]),
        ("linear machine", ("physical", "magnet"), [1, 1, 1, 1]),
        ("duffing", ("physical",), [0] * 10 + [1, 1]),
        ("duffing", ("learned",), [1] * 10 + [0, 0]),
        # 2 offsets, 3 of the triangle, 6 directions, 3 biases, 3 gains, R.
        ("coenergy machine", ("learned",), [1] * 17 + [0]),
    ],
)
def test_members_are_raw_entries_of_the_groups(systems, name, groups, expected):
    members = Layout(systems[name].model).members(groups)
    assert members.dtype == np.bool_
    np.testing.assert_array_equal(members, np.array(expected, dtype=bool))


def test_model_without_physical_parameters_has_none(systems):
    layout = Layout(systems["duffing"].model.spring)
    assert layout.physical == ()
    with float64():
        assert layout.physical_values(jnp.ones(layout.size)).shape == (0,)


def test_a_definite_matrix_survives_the_rounding_of_its_product():
    """An entry of exp(-30) in the factor vanishes beside 1: the product is singular to rounding."""
    raw = np.array([-0.6, 0.11, -30.0])
    with float64():
        value = np.asarray(PositiveDefinite().forward(jnp.asarray(raw), (2, 2)))
        again = PositiveDefinite().forward(jnp.asarray(PositiveDefinite().inverse(value)), (2, 2))
    np.testing.assert_allclose(again, value, rtol=0, atol=1e-14)
    with pytest.raises(np.linalg.LinAlgError):
        PositiveDefinite().inverse(np.array([[1.0, 2.0], [2.0, 1.0]]))
