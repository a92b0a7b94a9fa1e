"""Long text files are parsed block by block; that may change neither a value nor a sentence."""

import tracemalloc
from contextlib import nullcontext

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from penode.data.readers import csv
from penode.errors import InputError

ROWS = 60


def lines(end="\n"):
    """Lines of a good file; data row r is element r."""
    rng = np.random.default_rng(3)
    return ["t,x,on"] + [f"{k},{x!r},{k % 2}" for k, x in enumerate(rng.normal(size=ROWS).tolist())]


def parse(rows, end="\n"):
    return csv.read("run.csv", (end.join(rows) + end).encode()).columns


def refusal(rows):
    with pytest.raises(InputError) as caught:
        parse(rows)
    return str(caught.value)


@pytest.fixture(params=[1, 40, 500])
def block(request, monkeypatch):
    monkeypatch.setattr(csv, "_BLOCK", request.param)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_blocks_give_the_same_columns(monkeypatch, end):
    whole = parse(lines(), end)
    assert {len(values) for values in whole.values()} == {ROWS}
    monkeypatch.setattr(csv, "_BLOCK", 40)
    for name, values in parse(lines(), end).items():
        np.testing.assert_array_equal(values, whole[name])


@pytest.mark.parametrize("row", [1, 2, 31, ROWS])
def test_a_bad_cell_is_named_by_its_row_and_line(block, row):
    rows = lines()
    rows[row] = f"{row},oops,0"
    rows.insert(1, "")
    assert f"data row {row} (line {row + 2}), channel x: found 'oops'" in refusal(rows)


def test_the_first_bad_column_is_named_and_a_short_row_before_it(block):
    rows = lines()
    rows[3], rows[40] = "2,oops,0", "bad,1,0"
    assert "data row 40 (line 41), channel t: found 'bad'" in refusal(rows)
    rows[50] = "1,2"
    assert "data row 50 (line 51) has 2 cells" in refusal(rows)


def test_truth_values_are_those_of_a_whole_column(block):
    words = [row.rsplit(",", 1)[0] + (",true", ",FALSE")[k % 2] for k, row in enumerate(lines())]
    rows = [lines()[0], *words[1:]]
    np.testing.assert_array_equal(parse(rows)["on"], [k % 2 == 0 for k in range(1, ROWS + 1)])
    rows[45] = lines()[45]
    assert "data row 1 (line 2), channel on: found 'FALSE'" in refusal(rows)
    mixed = lines()
    mixed[20] = words[20]
    assert "data row 20 (line 21), channel on: found 'true'" in refusal(mixed)


def outcome(content):
    try:
        return {name: list(values) for name, values in csv.read("run.csv", content).columns.items()}
    except InputError as error:
        return str(error)


@given(
    rows=st.text('",;\t \r\n12.-e_x\u0663', max_size=12),
    head=st.sampled_from(["a,b\n1,2", "a;b\n1;2", "a\n1", "a;b\n1,5;on", "a,b\non,1.5"]),
)
def test_a_block_parsed_at_once_gives_what_its_split_rows_give(rows, head):
    content = f"{head}\n{rows}\n".encode()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(csv, "_BLOCK", 5)  # the first row is a block of its own
        at_once = outcome(content)
        patch.setattr(csv._Rows, "_parsed_at_once", lambda *block: None)
        assert outcome(content) == at_once


def test_a_quoted_cell_may_go_on_in_the_next_line(block):
    rows = lines()
    rows[30] = '"30\n",1.5,0'
    rows[55] = "55,oops,0"
    assert "data row 55 (line 57)" in refusal(rows)
    del rows[55]
    assert parse(rows)["t"][29] == 30


@pytest.mark.parametrize("place", [5, 700, 1000])
def test_the_first_byte_that_is_no_text_is_counted(block, place):
    content = "\n".join(lines()).encode()
    content = content[:place] + b"\x81" + content[place:]
    with pytest.raises(InputError, match=rf"not UTF-8 text \(byte {place + 1}\)"):
        csv.read("run.csv", content)


@pytest.mark.parametrize("bad", [False, True])
def test_memory_is_about_that_of_text_and_numbers(monkeypatch, bad):
    """Strings for every cell of the file would take some twenty times its size."""
    monkeypatch.setattr(csv, "_BLOCK", 1 << 14)
    rng = np.random.default_rng(0)
    rows = [",".join(f"{x:.6f}" for x in row) for row in rng.normal(size=(20_000, 5))]
    if bad:
        rows[10_000] = "oops" + rows[10_000]
    content = ("a,b,c,d,e\n" + "\n".join(rows)).encode()
    place = pytest.raises(InputError, match=r"data row 10001 \(line 10002\), channel a")
    tracemalloc.start()
    with place if bad else nullcontext():
        csv.read("run.csv", content)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1.5 * len(content)


def test_columns_of_text_are_told_by_their_first_cell(block):
    rows = ["t,x,when"] + [f"{row},12:0{k % 10}" for k, row in enumerate(two_columns())]
    table = csv.read("run.csv", "\n".join(rows).encode())
    assert list(table.columns) == ["t", "x"]
    assert {len(values) for values in table.columns.values()} == {ROWS}
    assert table.text == {"when": ("data row 1 (line 2)", "12:00")}


def test_a_number_far_down_a_column_of_text_is_seen(block):
    rows = ["t,x,when"] + [f"{row},noon" for row in two_columns()]
    rows[50] = rows[50].replace("noon", "12")
    assert "data row 1 (line 2), channel when: found 'noon'" in refusal(rows)


def two_columns():
    return [line.rsplit(",", 1)[0] for line in lines()[1:]]
