"""What a solver's stages hand to a model: named inputs, and the part of the sample."""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from penode import Model
from penode.arrays import float64
from penode.errors import InputError
from penode.models.inputs import Inputs
from penode.predictors.base import Predictor
from penode.predictors.field import Field
from penode.predictors.holds import ZeroOrderHold
from penode.predictors.implicit import ImplicitMidpoint, Trapezoidal
from penode.predictors.multistep import AdamsBashforth
from penode.predictors.one_step import RungeKutta, Substeps
from penode.predictors.tableaus import AB3, DOPRI5, EULER, RK4

T = 0.1


def watching(see):
    """Return a model that stands still and shows its inputs at every stage."""

    class Watching(Model):
        states: ClassVar[tuple[str, ...]] = ("x",)
        inputs: ClassVar[tuple[str, ...]] = ("angle", "rate")
        state_units: ClassVar[tuple[str, ...]] = ("m",)
        input_rates: ClassVar[dict[str, str]] = {"angle": "rate"}

        def derivative(self, x, u):
            see(u)
            return 0.0 * x

    return Watching()


def spans(solver):
    """Return place and span of every stage of a step of a model that stands still."""
    seen = []

    def see(u):
        angle = u["angle"]
        seen.append((None if isinstance(angle, jax.core.Tracer) else float(angle[0]), u.span))

    with float64():
        rows = jnp.asarray([[0.0], [1.0 / T]])
        field = Field(watching(see), lambda k: rows, ZeroOrderHold(), T)
        solver.advance(field, jnp.zeros((solver.past, 1, 1)))
    return seen


def test_stages_of_a_step_stand_for_parts_of_it():
    sixth, third = T / 6, T / 3
    expected = [
        (0.0, (0, sixth)),
        (0.5, (-third, third)),
        (0.5, (-third, third)),
        (1.0, (-sixth, 0)),
    ]
    for (place, span), (wanted, part) in zip(spans(RungeKutta(RK4)), expected, strict=True):
        assert place == pytest.approx(wanted)
        assert span == pytest.approx(part, abs=1e-15)


def test_stages_of_sub_steps_stand_for_parts_of_theirs():
    """Of the second of two steps the first stage is at half the sample and stands for a twelfth."""
    with jax.disable_jit():  # each sub-step by itself, in numbers
        place, span = spans(Substeps(RungeKutta(RK4), 2))[4]
    assert place == pytest.approx(0.5)
    assert span == pytest.approx((0.0, T / 12), abs=1e-15)


def test_so_do_those_of_sub_steps_whose_inputs_are_tabulated():
    """Their length is known at run time alone."""
    seen = []

    def see(u):
        seen.append((float(u["angle"][0]), *map(float, u.part_for("this"))))

    predictor = Predictor(T, Substeps(RungeKutta(RK4), 2))
    with float64(), jax.disable_jit():
        rows = jnp.asarray(predictor.prepared(np.array([[0.0, 1.0 / T]])).T)
        predictor.step(watching(see), jnp.zeros((1, 1, 1)), lambda k: rows)
    assert len(seen) == 8
    assert seen[4] == pytest.approx((0.5, T / 24, T / 24), abs=1e-15)


def test_eulers_stage_stands_for_its_moment():
    assert spans(RungeKutta(EULER)) == [(0.0, (0.0, 0.0))]


@pytest.mark.parametrize("solver", [RungeKutta(DOPRI5), AdamsBashforth(AB3)])
def test_stages_that_stand_for_no_part_say_so(solver):
    assert {span for _, span in spans(solver)} == {None}


@pytest.mark.parametrize(
    ("solver", "parts"),
    [
        (Trapezoidal(), {(0.0, T / 2), (-T / 2, 0.0)}),
        (ImplicitMidpoint(), {(-T / 2, T / 2)}),
    ],
)
def test_stages_of_implicit_methods_stand_for_all_of_it(solver, parts):
    assert {tuple(np.round(span, 12)) for _, span in spans(solver)} == parts


# --- inputs by name ---------------------------------------------------------------------------

U = Inputs(jnp.asarray([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]), ("a", "b", "c"))


def test_rows_by_name_and_by_place():
    np.testing.assert_array_equal(U["b"], [3.0, 4.0])
    np.testing.assert_array_equal(U[1], U["b"])
    np.testing.assert_array_equal(U[-1], U["c"])
    np.testing.assert_array_equal(U["b", "c"], [[3.0, 4.0], [5.0, 6.0]])
    np.testing.assert_array_equal(U["c", "a"], [[5.0, 6.0], [1.0, 2.0]])
    assert [float(row[0]) for row in U] == [1.0, 3.0, 5.0]


def test_exchanged_rows_leave_the_others_alone():
    changed = U.over((-1.0, 2.0)).replaced(b=jnp.asarray([9.0, 9.0]))
    np.testing.assert_array_equal(changed.values, [[1.0, 2.0], [9.0, 9.0], [5.0, 6.0]])
    assert changed.span == (-1.0, 2.0)
    assert changed.part_for("this") == (0.5, 1.5)


def test_what_is_not_there_is_told():
    with pytest.raises(KeyError, match="no input 'd'; the model's inputs are a, b, c"):
        U["d"]
    with pytest.raises(IndexError):
        U[3]
    with pytest.raises(TypeError, match="an input is taken by its name or place"):
        U[1:]
    with pytest.raises(InputError, match="dead time takes its mean over the part of a sample"):
        U.over(None).part_for("dead time")
