"""Groups of signals as one table: shared clocks, names of their own, times in a column."""

import numpy as np
import pytest

from penode.data.table import Signal, clocks_within, list_names, table_of
from penode.errors import InputError

FAST, SLOW = np.arange(8) * 1e-3, np.arange(4) * 1e-2


def signal(group, name, times=FAST, unit=""):
    count = 8 if times is None else len(times)
    return Signal(group, name, unit, lambda: np.arange(count, dtype=float), times)


def test_signals_sampled_together_share_one_clock():
    """Times that are equal are one clock, though each signal brought an array of its own."""
    table = table_of(
        "run", [signal("a", "x"), signal("b", "y", FAST.copy()), signal("c", "z", SLOW, "V")]
    )
    assert list(table.columns) == ["t", "t_2", "x", "y", "z"]
    assert table.clocks == {"t": "t", "t_2": "t_2", "x": "t", "y": "t", "z": "t_2"}
    assert table.units == {"t": "s", "t_2": "s", "z": "V"}
    np.testing.assert_array_equal(table.columns["t_2"], SLOW)


def test_a_signal_called_as_a_clock_gets_its_group():
    table = table_of("run", [signal("a", "t"), signal("a", "x"), signal("b", "x", SLOW)])
    assert set(table.columns) == {"t", "t_2", "a/t", "a/x", "b/x"}


def test_signals_without_times_have_the_time_column_of_their_group_alone():
    names = [("a", "Zeit"), ("a", "x"), ("b", "y")]
    table = table_of("run", [signal(*name, None) for name in names])
    assert table.clocks == {"Zeit": "Zeit", "x": "Zeit"}
    double = [signal("a", "time", None), signal("b", "time", None), signal("b", "y", None)]
    assert table_of("run", double).clocks == {
        "a/time": "a/time",
        "b/time": "b/time",
        "y": "b/time",
    }


def test_two_signals_of_one_name_in_a_group_are_refused():
    with pytest.raises(InputError, match=r"^run: duplicate column name a/x;"):
        table_of("run", [signal("a", "x"), signal("a", "x", SLOW)])


@pytest.mark.parametrize(
    ("names", "clock"),
    [("Zeit time T", "T"), ("Zeit TIME x", "TIME"), ("ZEIT x", "ZEIT"), ("times x", None)],
)
def test_the_shortest_name_of_a_time_is_taken(names, clock):
    members = {name: f"log.{name}" for name in names.split()}
    tied = clocks_within(members)
    assert set(tied.values()) == (set() if clock is None else {f"log.{clock}"})
    assert set(tied) == (set() if clock is None else set(members.values()))


@pytest.mark.parametrize(("count", "end"), [(0, "none"), (20, "c19"), (21, "c19 and 1 more")])
def test_a_list_of_names_is_cut_after_twenty(count, end):
    assert list_names(f"c{k}" for k in range(count)).endswith(end)
