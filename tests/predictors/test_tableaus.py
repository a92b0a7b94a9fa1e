"""Tableaus are checked data: what is not an explicit method of weight one is refused."""

import itertools

import numpy as np
import pytest

from penode.predictors.tableaus import EULER, RK4, RUNGE_KUTTA, ButcherTableau


@pytest.mark.parametrize(
    "a",
    [
        ((1.0, 0.0),),  # implicit first row
        (),  # a row is missing
        ((0.5,), (0.5,)),  # the second row is too short
        ((0.5,), (0.0, 0.5)),  # one row too many
    ],
)
def test_a_table_that_is_not_explicit_is_refused(a):
    with pytest.raises(ValueError, match="wrong: rows of a must have lengths"):
        ButcherTableau("wrong", 2, a, (0.5, 0.5))


@pytest.mark.parametrize("b", [(0.5, 0.4), (1.0, 1e-12)])
def test_weights_must_add_up_to_one(b):
    with pytest.raises(ValueError, match=r"wrong: weights b must add up to 1, got"):
        ButcherTableau("wrong", 2, ((1.0,),), b)


def test_nodes_are_row_sums():
    assert EULER.nodes == (0.0,)
    assert RK4.nodes == (0.0, 0.5, 0.5, 1.0)


@pytest.mark.parametrize("tableau", [EULER, RK4], ids=lambda t: t.name)
def test_order_conditions(tableau):
    """The conditions on a, b and c up to the order claimed (Butcher 2008, table 304)."""
    stages = len(tableau.b)
    a = np.array([(*row, *[0.0] * (stages - len(row))) for row in ((), *tableau.a)])
    b, c = np.array(tableau.b), np.array(tableau.nodes)
    conditions = {
        1: [(b.sum(), 1)],
        2: [(b @ c, 1 / 2)],
        3: [(b @ c**2, 1 / 3), (b @ a @ c, 1 / 6)],
        4: [
            (b @ c**3, 1 / 4),
            ((b * c) @ a @ c, 1 / 8),
            (b @ a @ c**2, 1 / 12),
            (b @ a @ a @ c, 1 / 24),
        ],
    }
    for order in range(1, tableau.order + 1):
        for found, wanted in conditions[order]:
            assert found == pytest.approx(wanted, abs=1e-15)


@pytest.mark.parametrize("table", RUNGE_KUTTA, ids=lambda t: t.name)
def test_stages_cover_the_step_once_and_lie_in_their_middle_on_average(table):
    """What holds for a while within a step is weighed by how long it holds, and at its time."""
    if None in table.parts:
        assert set(table.parts) == {None}
        assert min(table.b) < 0
        return
    weighed = [(part, b) for part, b in zip(table.parts, table.b, strict=True) if b > 0]
    if table.order == 1:
        assert table.parts == ((0.0, 0.0),)
        return
    lengths = {part: part[1] - part[0] for part, _ in weighed}
    for part, length in lengths.items():
        assert sum(b for other, b in weighed if other == part) == pytest.approx(length, abs=1e-15)
    ends = sorted(lengths)
    assert [ends[0][0], ends[-1][1]] == pytest.approx([0.0, 1.0])
    assert all(a[1] == pytest.approx(b[0]) for a, b in itertools.pairwise(ends))
    middles = [0.5 * sum(part) for part in table.parts]
    assert np.dot(table.b, middles) == pytest.approx(np.dot(table.b, table.nodes), abs=1e-14)


def test_parts_of_the_classic_method():
    sixth = pytest.approx((0.0, 1 / 6))
    assert RK4.parts[0] == sixth
    assert RK4.parts[1] == RK4.parts[2] == pytest.approx((1 / 6, 5 / 6))
    assert RK4.parts[3] == pytest.approx((5 / 6, 1.0))
