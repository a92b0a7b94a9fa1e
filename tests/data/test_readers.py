"""What each reader makes of its format, and what it refuses."""

import io
import sys
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import polars as pl
import pytest
from asammdf import MDF
from asammdf import Signal as MdfSignal
from hypothesis import given, settings
from hypothesis import strategies as st
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from penode.data.load import load, read
from penode.data.readers import mdf, tdms
from penode.errors import InputError

TIME = np.arange(12) * 1e-3
X = np.random.default_rng(0).normal(size=12)


def columns(path: Path) -> dict[str, np.ndarray]:
    return read(path)[0].columns


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        load(path)
    sentence = str(caught.value)
    assert sentence.startswith(str(path))
    assert "\n" not in sentence
    assert sentence.endswith(".")
    return sentence


# --- text -------------------------------------------------------------------------------------


def text_file(folder: Path, *lines: str) -> Path:
    path = folder / "run.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("mark", [",", ";", "\t", "|"])
def test_every_separator(tmp_path, mark):
    rows = [f"{t!r}{mark}{x!r}" for t, x in zip(TIME.tolist(), X.tolist(), strict=True)]
    run = load(text_file(tmp_path, f"t{mark}x", *rows))
    np.testing.assert_array_equal(run.channels["x"], X)


@settings(max_examples=50, deadline=None)
@given(values=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=8, max_size=20))
def test_decimal_commas_are_read_to_the_last_digit(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("comma")
    rows = [f"{k}e-3;{v!r}".replace(".", ",") for k, v in enumerate(values)]
    np.testing.assert_array_equal(load(text_file(path, "t;x", *rows)).channels["x"], values)


def test_a_separator_in_a_name_is_no_separator(tmp_path):
    rows = [f"{t!r},{x!r}" for t, x in zip(TIME.tolist(), X.tolist(), strict=True)]
    assert list(columns(text_file(tmp_path, "t,|x|", *rows))) == ["t", "|x|"]


@pytest.mark.parametrize("cell", ["1.234,5", "1,234,5", "1.234"])
def test_thousands_are_refused_not_guessed(tmp_path, cell):
    rows = [f"0,{k:03d};1,5" for k in range(9)]
    sentence = refusal(text_file(tmp_path, "t;x", *rows, f"0,009;{cell}"))
    assert "data row 10 (line 11), channel x" in sentence


def test_a_row_of_units_is_kept_and_used(tmp_path):
    path = text_file(tmp_path, "t,x,T", "[ms],mA,°C", *[f"{k},{k},{20 + k}" for k in range(9)])
    assert read(path)[0].units == {"t": "[ms]", "x": "mA", "T": "°C"}
    run = load(path)
    assert run.time_step == pytest.approx(1e-3, rel=1e-12)
    np.testing.assert_allclose(run.channels["x"], np.arange(9) / 1e3, rtol=1e-15)
    np.testing.assert_array_equal(run.channels["T"], 20 + np.arange(9))


def test_lines_are_counted_from_the_top_below_a_row_of_units(tmp_path):
    path = text_file(tmp_path, "t,x", "s,A", *[f"{k},{k}" for k in range(9)], "9,oops")
    assert "data row 10 (line 12), channel x" in refusal(path)


@pytest.mark.parametrize("first", ["-,-", "1,1", "note,NA", ",", "0,A"])
def test_what_is_no_row_of_units_is_a_row_of_data(tmp_path, first):
    path = text_file(tmp_path, "t,x", first, *[f"{k},{k}" for k in range(2, 11)])
    if first == "1,1":
        assert len(load(path)) == 10
    else:
        assert "data row 1 (line 2)" in refusal(path)


# --- MATLAB -----------------------------------------------------------------------------------


def test_vectors_structs_and_matrices(tmp_path):
    path = tmp_path / "run.mat"
    log = {"time": TIME, "x": X, "gain": 3.0, "deep": {"y": X}, "name": "motor"}
    savemat(path, {"log": log, "abc": np.stack([X, 2 * X, 3 * X], axis=1), "n": np.arange(12)})
    table, _ = read(path)
    inside = ["log.time", "log.x", "log.deep.y"]
    assert list(table.columns) == [*inside, "abc_1", "abc_2", "abc_3", "n"]
    np.testing.assert_array_equal(table.columns["abc_2"], 2 * X)
    assert table.clocks == dict.fromkeys(inside, "log.time")
    assert table.numbers == {"log.gain": 3.0}
    assert {values.dtype for values in table.columns.values()} == {np.dtype(np.float64)}


def test_simulink_structure_with_time(tmp_path):
    path = tmp_path / "run.mat"
    signals = np.zeros((1, 2), dtype=[("values", object), ("label", object)])
    signals[0, 0] = (X[:, None], "i_d")
    signals[0, 1] = (np.stack([X, -X], axis=1), "")
    savemat(path, {"scope": {"time": TIME[:, None], "signals": signals, "blockName": "a/b"}})
    table, _ = read(path)
    names = ["scope.time", "scope.i_d", "scope.signals2_1", "scope.signals2_2"]
    assert list(table.columns) == names
    assert set(table.clocks.values()) == {"scope.time"}
    np.testing.assert_array_equal(table.columns["scope.signals2_2"], -X)


def test_simulink_structure_in_a_file_of_version_7_3(tmp_path):
    path = tmp_path / "run.mat"
    with h5py.File(path, "w") as file:
        scope = file.create_group("scope")
        scope.create_dataset("time", data=TIME[None])
        parts = file.create_group("#refs#")
        references = {"values": [], "label": []}
        for k, (values, label) in enumerate([(X[None], "i_d"), (-X[None], "i_q")]):
            references["values"].append(parts.create_dataset(f"v{k}", data=values).ref)
            codes = np.array([[ord(letter)] for letter in label], dtype=np.uint16)
            written = parts.create_dataset(f"l{k}", data=codes)
            written.attrs["MATLAB_class"] = np.bytes_("char")
            references["label"].append(written.ref)
        signals = scope.create_group("signals")
        for name, held in references.items():
            signals.create_dataset(name, data=np.array([held], dtype=h5py.ref_dtype))
        cell = file.create_dataset("cell", data=np.array([held], dtype=h5py.ref_dtype))
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
    table, _ = read(path)
    assert list(table.columns) == ["scope.time", "scope.i_d", "scope.i_q"]
    np.testing.assert_array_equal(table.columns["scope.i_q"], -X)


def test_mat_without_vectors(tmp_path):
    path = tmp_path / "run.mat"
    savemat(path, {"Ts": 1e-4, "note": "nothing"})
    assert "no numeric vector" in refusal(path)


# --- MDF and TDMS -----------------------------------------------------------------------------


def two_groups_mdf(path: Path) -> None:
    with MDF(version="4.10") as file:
        file.append([MdfSignal(X, TIME, unit="mA", name="x"), MdfSignal(X, TIME, name="twice")])
        slow = TIME[::4]
        words = MdfSignal(np.array([b"a", b"b", b"c"]), slow, name="word", encoding="utf-8")
        file.append([MdfSignal(X[::4], slow, unit="rpm", name="n"), words])
        file.append([MdfSignal(X[::4], slow, name="twice")])
        file.save(path, overwrite=True)


def test_mdf_groups_share_clocks_and_double_names_get_their_group(tmp_path):
    two_groups_mdf(tmp_path / "run.mf4")
    table, _ = read(tmp_path / "run.mf4")
    assert set(table.columns) == {"t", "t_2", "x", "n", "group 1/twice", "group 3/twice"}
    assert table.units == {"t": "s", "t_2": "s", "x": "mA", "n": "rpm"}
    assert (table.clocks["x"], table.clocks["n"]) == ("t", "t_2")
    assert table.clocks["group 3/twice"] == "t_2"
    np.testing.assert_array_equal(table.columns["t_2"], TIME[::4])


def test_invalid_samples_of_mdf_are_a_gap(tmp_path):
    path = tmp_path / "run.mf4"
    invalid = np.arange(12) == 5
    with MDF(version="4.10") as file:
        file.append([MdfSignal(X, TIME, name="x", invalidation_bits=invalid)])
        file.save(path, overwrite=True)
    assert "gap between data rows 5 and 6" in refusal(path)


def test_tdms_waveforms_and_groups_with_a_time_channel(tmp_path):
    path = tmp_path / "run.tdms"
    begin = np.datetime64("2024-05-01T12:00:00")
    late = {"wf_increment": 1e-3, "wf_start_time": begin + np.timedelta64(2, "ms")}
    first = {"wf_increment": 1e-3, "wf_start_time": begin, "unit_string": "A"}
    with TdmsWriter(path) as file:
        file.write_segment(
            [
                ChannelObject("fast", "x", X, properties=first),
                ChannelObject("late", "y", X, properties=late),
                ChannelObject("slow", "Time", TIME[::4]),
                ChannelObject("slow", "n", X[::4]),
                ChannelObject("slow", "word", ["a", "b", "c"]),
            ]
        )
    table, _ = read(path)
    assert list(table.columns) == ["t", "t_2", "x", "y", "Time", "n"]
    assert table.units["x"] == "A"
    assert table.clocks["n"] == "Time"
    np.testing.assert_allclose(table.columns["t_2"], TIME + 2e-3, rtol=1e-12)


def workbook(path, rows):
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    book.create_sheet("notes").append(["nothing of this"])
    book.save(path)


def test_the_first_sheet_of_a_workbook_is_read_as_text_would_be(tmp_path):
    path = tmp_path / "run.xlsx"
    noted = [[t, x, "ok", None] for t, x in zip(TIME.tolist(), X.tolist(), strict=True)]
    head = [["Bench 4, Monday"], [], ["t (s)", "I d", "state"], ["s", "mA", "-"]]
    workbook(path, [*head, *noted[:5], [], *noted[5:], [None, None]])
    table, source = read(path)
    assert list(table.columns) == ["t (s)", "I d"]
    assert list(table.text) == ["state"]
    assert table.units["I d"] == "mA"
    # The workbook is written with 16 digits.
    np.testing.assert_allclose(table.columns["t (s)"], TIME, rtol=1e-15)
    np.testing.assert_allclose(table.columns["I d"], X, rtol=1e-15)
    assert len(source.sha256) == 64


@pytest.mark.parametrize("cell", [None, "n/a"])
def test_a_cell_of_a_workbook_that_is_no_number_is_named_by_its_row(tmp_path, cell):
    path = tmp_path / "run.xlsx"
    rows = [[t, x] for t, x in zip(TIME.tolist(), X.tolist(), strict=True)]
    rows[3][1] = cell
    workbook(path, [["Bench 4, Monday"], [], ["t", "x"], *rows])
    assert "channel x" in (sentence := refusal(path))
    assert "line 7" in sentence


@pytest.mark.parametrize("content", [b"t,x\n0,1\n", b"", b"\xd0\xcf\x11\xe0 an old workbook"])
def test_what_is_no_workbook_is_refused(decode, content):
    with pytest.raises(InputError, match=r"^run: no Excel workbook"):
        decode("xlsx", "run", content)


def test_a_workbook_without_its_library_is_refused_with_the_extra(tmp_path, monkeypatch):
    path = tmp_path / "run.xlsx"
    workbook(path, [["t", "x"], [0, 1]])
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert "pip install 'penode[excel]'" in refusal(path)


@pytest.mark.parametrize(
    ("reader", "library", "start"),
    [(mdf, "asammdf", b"MDF     4.10    "), (tdms, "nptdms", b"TDSm")],
)
def test_a_missing_library_is_named_with_its_extra(monkeypatch, reader, library, start):
    monkeypatch.setitem(sys.modules, library, None)
    extra = reader.__name__.rpartition(".")[2]
    with pytest.raises(InputError, match=rf"pip install 'penode\[{extra}\]'"):
        reader.read("run.mf4", io.BytesIO(start))


@pytest.mark.parametrize("suffix", ["mat", "mf4", "tdms"])
def test_other_content_is_refused(decode, suffix):
    reader = suffix.replace("mf4", "mdf")
    for content in (b"t,x\n0,1\n", b""):
        with pytest.raises(InputError, match=f"^run: .*(MATLAB|{reader.upper()})"):
            decode(reader, "run", content)


@pytest.mark.parametrize("suffix", ["mat", "hdf5", "mf4", "tdms"])
def test_a_file_cut_short_never_crashes(tmp_path, decode, suffix):
    path = tmp_path / ("run.mat" if suffix == "hdf5" else f"run.{suffix}")
    if suffix == "mat":
        savemat(path, {"t": TIME, "x": X})
    elif suffix == "hdf5":
        with h5py.File(path, "w") as file:
            file["t"], file["x"] = TIME, X
    elif suffix == "mf4":
        two_groups_mdf(path)
    else:
        with TdmsWriter(path) as file:
            file.write_segment([ChannelObject("g", "t", TIME), ChannelObject("g", "x", X)])
    whole, reader = path.read_bytes(), {"hdf5": "mat", "mf4": "mdf"}.get(suffix, suffix)
    for share in (0.1, 0.3, 0.5, 0.7, 0.9):
        with pytest.raises(InputError, match=r"^run: "):
            decode(reader, "run", whole[: int(share * len(whole))])


def test_parquet_is_read_as_before(tmp_path):
    path = tmp_path / "run.parquet"
    pl.DataFrame({"t": TIME, "x": X}).write_parquet(path)
    assert read(path)[0].units == {}
    np.testing.assert_array_equal(load(path).channels["x"], X)
