"""Loading: round trips, time steps, and every refusal with the words a person needs."""

import hashlib
import io
import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from penode.data.experiment import Experiment
from penode.data.load import load
from penode.data.readers import csv, parquet
from penode.data.table import Table
from penode.errors import InputError

SLOW_RUN = "runs/slow_1500rpm.csv"


def frame(samples: int = 12, time_step: float = 0.1, seed: int = 0) -> pl.DataFrame:
    rng = np.random.default_rng(seed)
    return pl.DataFrame(
        {
            "t": np.arange(samples) * time_step,
            "x": rng.standard_normal(samples),
            "u": rng.standard_normal(samples),
        }
    )


def lines(samples: int = 12) -> list[str]:
    """Lines of a good CSV file: line 1 the header, data row r in line r + 1."""
    return ["t,x,u"] + [f"{0.1 * k:.1f},{k},{-k}.5" for k in range(samples)]


def write(path: Path, rows: list[str]) -> Path:
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def refusal(path: Path) -> str:
    """Load a bad file and return the sentence it is refused with."""
    with pytest.raises(InputError) as caught:
        load(path)
    sentence = str(caught.value)
    assert path.name in sentence
    assert "\n" not in sentence
    assert sentence.endswith(".")
    return sentence


def assert_words(sentence: str, *words: str) -> None:
    missing = [word for word in words if word not in sentence]
    assert not missing, f"{missing} not in: {sentence}"


# --- what a good file gives -------------------------------------------------------------------


@pytest.mark.parametrize("name", ["run.txt", "run.tsv"])
def test_text_with_tabs_is_a_table(tmp_path: Path, name: str) -> None:
    rows = [row.replace(",", "\t") for row in lines()]
    run = load(write(tmp_path / name, rows))
    np.testing.assert_array_equal(run.channels["x"], np.arange(12.0))


def test_experiment_holds_channels_time_step_and_source(tmp_path: Path) -> None:
    path = write(tmp_path / "run.csv", lines())
    run = load(path)
    assert isinstance(run, Experiment)
    assert run.name == "run.csv"
    assert list(run.channels) == ["x", "u"]
    assert run.time_step == pytest.approx(0.1, rel=1e-12)
    np.testing.assert_array_equal(run.channels["x"], np.arange(12.0))
    assert run.source.path == str(path)
    assert run.source.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_name_and_string_path_are_taken(tmp_path: Path) -> None:
    run = load(str(write(tmp_path / "run.csv", lines())), name="first")
    assert run.name == "first"


def test_columns_of_other_names_are_named(tmp_path: Path) -> None:
    file = tmp_path / "heater.csv"
    rows = "".join(f"{0.5 * k},{k},{k + 0.5},text\n" for k in range(10))
    file.write_text("time_ms,power,T_heater,note\n" + rows)
    with pytest.raises(InputError, match=r"columns=\{'t': \.\.\.\} in penode\.load"):
        load(file)
    names = {"t": "time_ms", "P": "power", "T": "T_heater"}
    experiment = load(file, columns=names)
    assert set(experiment.channels) == {"P", "T"}
    assert experiment.time_step == 0.5
    np.testing.assert_array_equal(experiment.channels["T"], np.arange(10) + 0.5)
    with pytest.raises(InputError, match="no column watts for channel P"):
        load(file, columns=names | {"P": "watts"})


def test_suffix_in_capitals_is_known(tmp_path: Path) -> None:
    assert len(load(write(tmp_path / "RUN.CSV", lines()))) == 12


@settings(max_examples=20, deadline=None)
@given(
    values=st.lists(
        st.floats(allow_nan=False, allow_infinity=False, width=64), min_size=8, max_size=30
    )
)
def test_csv_and_parquet_hold_the_same_recording(
    tmp_path_factory: pytest.TempPathFactory, values: list[float]
) -> None:
    folder = tmp_path_factory.mktemp("round_trip")
    table = pl.DataFrame({"t": np.arange(len(values)) * 1e-4, "x": values})
    table.write_csv(folder / "run.csv")
    table.write_parquet(folder / "run.parquet")
    text = csv.read("run.csv", (folder / "run.csv").read_bytes()).columns
    with (folder / "run.parquet").open("rb") as source:
        binary = dict(parquet.read("run.parquet", source).columns)
    np.testing.assert_array_equal(text["x"], values)
    np.testing.assert_array_equal(binary["x"], values)
    np.testing.assert_array_equal(text["t"], binary["t"])


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_booleans_and_integers_become_float(tmp_path: Path, suffix: str) -> None:
    table = frame().with_columns(
        flag=pl.Series([k % 2 == 0 for k in range(12)]), count=pl.Series(range(12))
    )
    path = tmp_path / f"run.{suffix}"
    table.write_csv(path) if suffix == "csv" else table.write_parquet(path)
    run = load(path)
    np.testing.assert_array_equal(run.channels["flag"], [1.0, 0.0] * 6)
    np.testing.assert_array_equal(run.channels["count"], np.arange(12.0))
    assert {values.dtype for values in run.channels.values()} == {np.dtype(np.float64)}


@pytest.mark.parametrize(
    "change",
    [
        lambda text: b" t , x,u " + text[5:],
        lambda text: b"\xef\xbb\xbf" + text,
        lambda text: text.replace(b"\n", b"\r\n"),
        lambda text: text.replace(b"\n", b"\r"),
        lambda text: text.replace(b",", b" , "),
        lambda text: text + b"\n\n",
        lambda text: b'"t","x","u"' + text[5:],
    ],
    ids=["spaced names", "byte-order mark", "CRLF", "CR", "spaced cells", "blank end", "quotes"],
)
def test_harmless_variants_of_csv_are_read_alike(tmp_path: Path, change) -> None:
    plain = write(tmp_path / "plain.csv", lines())
    other = tmp_path / "other.csv"
    other.write_bytes(change(plain.read_bytes()))
    expected, run = load(plain), load(other)
    assert list(run.channels) == ["x", "u"]
    assert run.time_step == expected.time_step
    for name, values in expected.channels.items():
        np.testing.assert_array_equal(run.channels[name], values)


def test_brackets_in_the_file_name_are_no_pattern(tmp_path: Path) -> None:
    write(tmp_path / "a.csv", lines(20))
    assert len(load(write(tmp_path / "[a].csv", lines(12)))) == 12


def test_twenty_thousand_rows_load_quickly(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    columns = {"t": np.round(np.arange(20_000) * 1e-4, 4)}
    columns |= {f"x{k}": np.round(rng.standard_normal(20_000), 6) for k in range(6)}
    path = tmp_path / "run.csv"
    pl.DataFrame(columns).write_csv(path)
    walls = []
    for _ in range(5):
        begin = time.perf_counter()
        run = load(path)
        walls.append(time.perf_counter() - begin)
    assert len(run) == 20_000
    assert min(walls) < 0.1


# --- the file itself --------------------------------------------------------------------------


def test_file_not_found(tmp_path: Path) -> None:
    assert_words(refusal(tmp_path / "gone.csv"), "not found", "check the path")


def test_directory(tmp_path: Path) -> None:
    folder = tmp_path / "runs.csv"
    folder.mkdir()
    assert_words(refusal(folder), "directory", ".csv", ".parquet")


@pytest.mark.parametrize(("name", "word"), [("run.xls", ".xls"), ("run", "no suffix")])
def test_unknown_suffix(tmp_path: Path, name: str, word: str) -> None:
    assert_words(
        refusal(write(tmp_path / name, lines())), word, ".csv or .parquet or .mat or .mf4 or .tdms"
    )


def test_unreadable_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path, mode: str, **options: object) -> bytes:
        raise PermissionError(13, "Permission denied", str(path))

    path = write(tmp_path / "run.csv", lines())
    monkeypatch.setattr(Path, "open", refuse)
    assert_words(refusal(path), "cannot be read", "Permission denied")


@pytest.mark.parametrize("content", [b"", b"\n \n"])
def test_empty_csv(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(content)
    assert_words(refusal(path), "empty")


def test_empty_parquet(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    path.write_bytes(b"")
    assert_words(refusal(path), "empty")


@pytest.mark.parametrize(
    "content",
    [bytes(range(256)) * 8, b"\x1f\x8b\x08\x00rest", b"t,x\n0,\0\n", b"t\xe4,x\n0,\x02\n"],
    ids=["bytes", "gzip", "nul", "control"],
)
def test_binary_csv(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(content)
    assert_words(refusal(path), "binary", "UTF-8")


def test_parquet_content_named_csv(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    frame().write_parquet(path)
    assert_words(refusal(path), "parquet", "rename")


def test_text_named_parquet(tmp_path: Path) -> None:
    assert_words(refusal(write(tmp_path / "run.parquet", lines())), "not parquet", ".csv")


def test_truncated_and_garbled_parquet(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    frame(2000).write_parquet(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert_words(refusal(path), "damaged")
    path.write_bytes(b"PAR1" + b"\0" * 50 + b"\x10\0\0\0PAR1")
    assert_words(refusal(path), "damaged")


# --- names ------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_header_only(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run.{suffix}"
    table = frame().clear()
    table.write_csv(path) if suffix == "csv" else table.write_parquet(path)
    assert_words(refusal(path), "header", "no data rows")


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_no_time_column(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run.{suffix}"
    table = frame().rename({"t": "time"})
    table.write_csv(path) if suffix == "csv" else table.write_parquet(path)
    assert_words(refusal(path), "no column t", "time, x, u")


def test_long_lists_of_names_are_cut(tmp_path: Path) -> None:
    header = ",".join(f"c{k}" for k in range(30))
    path = write(tmp_path / "run.csv", [header] + [",".join(["1"] * 30)] * 9)
    assert_words(refusal(path), "c0, c1", "c19 and 10 more")


def test_time_column_alone(tmp_path: Path) -> None:
    path = write(tmp_path / "run.csv", ["t"] + [str(k) for k in range(10)])
    assert_words(refusal(path), "no column besides t")


def test_duplicate_names(tmp_path: Path) -> None:
    rows = lines()
    rows[0] = "t,x, x"
    assert_words(refusal(write(tmp_path / "run.csv", rows)), "duplicate", "name x")


def test_duplicate_names_in_parquet_after_stripping(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    frame().rename({"u": " x"}).write_parquet(path)
    assert_words(refusal(path), "duplicate", "name x")


def test_column_without_name(tmp_path: Path) -> None:
    rows = lines()
    rows[0] = "t,,u"
    assert_words(refusal(write(tmp_path / "run.csv", rows)), "column 2 of 3", "no name")


def test_no_header(tmp_path: Path) -> None:
    path = write(tmp_path / "run.csv", lines()[1:])
    assert_words(refusal(path), "line 1", "numbers", "header")


def test_blank_lines_alone(tmp_path: Path) -> None:
    rows = ["", *(line.replace(",", "") for line in lines())]
    assert_words(refusal(write(tmp_path / "run.csv", rows)), "line 1 is blank")


# --- cells ------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", ["abc", "1_000", "NA", "1x", "0x10", "true"])
def test_text_in_a_csv_cell(tmp_path: Path, text: str) -> None:
    rows = lines()
    rows[5] = f"0.4,{text},1"
    sentence = refusal(write(tmp_path / "run.csv", rows))
    assert_words(sentence, "data row 5 (line 6)", "channel x", repr(text))


@pytest.mark.parametrize("text", ["nan", "NaN", "inf", "-inf", "1e999"])
def test_csv_cell_not_finite(tmp_path: Path, text: str) -> None:
    rows = lines()
    rows[7] = f"0.6,1,{text}"
    sentence = refusal(write(tmp_path / "run.csv", rows))
    assert_words(sentence, "data row 7 (line 8)", "channel u", repr(text))


@pytest.mark.parametrize("text", ["", "  ", '""'])
def test_csv_cell_missing(tmp_path: Path, text: str) -> None:
    rows = lines()
    rows[3] = f"0.2,{text},1"
    sentence = refusal(write(tmp_path / "run.csv", rows))
    assert_words(sentence, "data row 3 (line 4)", "channel x", "missing")


def test_blank_lines_count_as_lines_but_not_as_rows(tmp_path: Path) -> None:
    rows = lines()
    rows[5] = "0.4,oops,1"
    rows.insert(3, "")
    sentence = refusal(write(tmp_path / "run.csv", rows))
    assert_words(sentence, "data row 5 (line 7)", "'oops'")


@pytest.mark.parametrize(("row", "count"), [("0.3,1", "2 cells"), ("0.3,1,2,3", "4 cells")])
def test_ragged_row(tmp_path: Path, row: str, count: str) -> None:
    rows = lines()
    rows[4] = row
    sentence = refusal(write(tmp_path / "run.csv", rows))
    assert_words(sentence, "data row 4 (line 5)", count, "3 columns")


def test_decimal_commas(tmp_path: Path) -> None:
    rows = ["t,x"] + [f"0,{k},1,5" for k in range(10)]
    assert_words(refusal(write(tmp_path / "run.csv", rows)), "data row 1", "4 cells")


@pytest.mark.parametrize("word", ["fine", "2026-11-23 10:00:01", " - "])
def test_a_column_of_text_is_left_out(tmp_path: Path, word: str) -> None:
    rows = [row + ("," + "comment" if k == 0 else "," + word) for k, row in enumerate(lines())]
    plain, with_text = (load(write(tmp_path / "run.csv", r)) for r in (lines(), rows))
    assert with_text.channels.keys() == plain.channels.keys()
    for name, values in plain.channels.items():
        np.testing.assert_array_equal(with_text.channels[name], values)


@pytest.mark.parametrize("number", [1, 5, 12])
def test_a_number_among_words_is_refused(tmp_path: Path, number: int) -> None:
    """A column of measurements with words in it is not one of words."""
    rows = [row + ",x" for row in lines()]
    rows[0] = lines()[0] + ",comment"
    rows[number] = lines()[number] + ",1.5"
    sentence = refusal(write(tmp_path / "run.csv", rows))
    assert_words(
        sentence, f"data row {1 + (number == 1)}", "channel comment", "'x'", "remove the column"
    )


def test_text_where_times_were_wanted_is_refused(tmp_path: Path) -> None:
    rows = [row if k == 0 else "10:00," + row.split(",", 1)[1] for k, row in enumerate(lines())]
    sentence = refusal(write(tmp_path / "run.csv", rows))
    assert_words(sentence, "data row 1 (line 2)", "channel t", "'10:00'")


def test_cell_longer_than_the_parser_takes(tmp_path: Path) -> None:
    rows = lines()
    rows[4] = '0.3,"' + "y" * 200_000
    sentence = refusal(write(tmp_path / "run.csv", rows))
    assert_words(sentence, "line 5", "quotation mark")
    assert len(sentence) < 500


@pytest.mark.parametrize(
    ("value", "word"), [(None, "missing"), (float("nan"), "nan"), (float("-inf"), "-inf")]
)
def test_parquet_value_missing_or_not_finite(
    tmp_path: Path, value: float | None, word: str
) -> None:
    path = tmp_path / "run.parquet"
    cells = [1.0] * 12
    cells[8] = value
    frame().with_columns(x=pl.Series(cells)).write_parquet(path)
    assert_words(refusal(path), "data row 9", "channel x", word)


@pytest.mark.parametrize(
    "series",
    [
        pl.Series(["fine"] * 12),
        pl.Series(["fine"] * 12, dtype=pl.Categorical),
        pl.Series(["1970-01-01"] * 12).str.to_date(),
    ],
    ids=["text", "words", "date"],
)
def test_parquet_column_of_text_is_left_out(tmp_path: Path, series: pl.Series) -> None:
    path = tmp_path / "run.parquet"
    frame().with_columns(note=series).write_parquet(path)
    assert set(load(path).channels) == set(frame().columns) - {"t"}
    frame().with_columns(t=series).write_parquet(path)
    assert_words(refusal(path), "data row 1", "channel t", f"'{series[0]}'")


def test_parquet_column_of_lists_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    frame().with_columns(other=pl.Series([[1.0]] * 12)).write_parquet(path)
    assert_words(refusal(path), "channel other", "numbers were wanted", "remove")


# --- whatever comes ----------------------------------------------------------------------------

CELLS = st.one_of(
    st.floats(width=32).map(str),
    st.sampled_from(["", " 1 ", "true", "1e400", "+.5", '"2"', "NA", "1_0", '"', "\t3", "é", "\r"]),
)


def load_or_refuse(path: Path) -> Experiment | None:
    """Load a file that may be bad; None where it is refused in one sentence that names it."""
    try:
        return load(path)
    except InputError as error:
        sentence = str(error)
    assert_words(sentence, path.name)
    assert "\n" not in sentence
    return None


@settings(max_examples=100, deadline=None)
@given(bad=st.lists(st.tuples(st.integers(1, 12), st.integers(0, 2), CELLS), max_size=3))
def test_any_cells_give_a_recording_or_a_refusal(
    tmp_path_factory: pytest.TempPathFactory, bad: list[tuple[int, int, str]]
) -> None:
    rows = [row.split(",") for row in lines()]
    for row, column, text in bad:
        rows[row][column] = text
    path = write(tmp_path_factory.mktemp("any") / "run.csv", [",".join(row) for row in rows])
    run = load_or_refuse(path)
    if run is not None:
        assert len(run) == 12
        for column, name in ((1, "x"), (2, "u")):
            cells = [row[column].strip().strip('"') for row in rows[1:]]
            np.testing.assert_array_equal(run.channels[name], [float(cell) for cell in cells])


@settings(max_examples=60, deadline=None)
@given(content=st.binary(max_size=200), start=st.sampled_from([b"", b"t,x\n"]))
def test_any_bytes_give_a_refusal(
    tmp_path_factory: pytest.TempPathFactory, start: bytes, content: bytes
) -> None:
    path = tmp_path_factory.mktemp("any") / "run.csv"
    path.write_bytes(start + content)
    with pytest.raises(InputError, match=r"^[^\n]*run\.[^\n]*$"):
        load(path)


@settings(max_examples=60, deadline=None)
@given(content=st.binary(max_size=200), start=st.sampled_from([b"", b"t,x\n", b"PAR1"]))
def test_any_bytes_are_no_parquet(
    decode: Callable[[str, str, bytes], Table], start: bytes, content: bytes
) -> None:
    with pytest.raises(InputError, match=r"^run.parquet: [^\n]*$"):
        decode("parquet", "run.parquet", start + content)


@settings(max_examples=60, deadline=None)
@given(place=st.integers(4, 2000), value=st.integers(0, 255))
def test_a_damaged_byte_in_parquet_never_crashes(
    decode: Callable[[str, str, bytes], Table], place: int, value: int
) -> None:
    written = io.BytesIO()
    frame(30).write_parquet(written)
    raw = bytearray(written.getvalue())
    raw[place % len(raw)] = value
    try:
        columns = decode("parquet", "run.parquet", bytes(raw)).columns
    except InputError as error:
        assert_words(str(error), "run.parquet")
        return
    assert all(np.isfinite(values).all() for values in columns.values())


# --- a real recording -------------------------------------------------------------------------


def test_recording_on_disk_if_present() -> None:
    default = Path(__file__).parents[3] / "shared" / "data"
    path = Path(os.environ.get("PENODE_DATA", default)) / SLOW_RUN
    if not path.is_file():
        pytest.skip(f"no {SLOW_RUN} here; set PENODE_DATA to the folder that holds it.")
    run = load(path)
    assert run.time_step == pytest.approx(1e-4, rel=1e-9)
    assert list(run.channels) == ["u_d", "u_q", "i_d", "i_q", "omega_el", "theta_el"]
    assert len(run) == 20_001
