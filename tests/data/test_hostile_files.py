"""Files made to be read wrongly: devices, links, formulas, control characters, missing values."""

import gzip
import hashlib
import io
import os
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import polars as pl
import pytest
from asammdf import MDF
from asammdf import Signal as MdfSignal
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from penode.data.content import Content
from penode.data.load import load, read
from penode.data.readers import csv
from penode.errors import InputError, printable

TIME = np.arange(12) * 1e-3
X = np.random.default_rng(0).normal(size=12)
ROWS = "".join(f"{t!r},{x!r}\n" for t, x in zip(TIME.tolist(), X.tolist(), strict=True))
CSV = f"t,x\n{ROWS}".encode()


def refusal(call, *arguments):
    with pytest.raises(InputError) as caught:
        call(*arguments)
    sentence = str(caught.value)
    assert sentence == printable(sentence)
    assert sentence.endswith(".")
    return sentence


# --- the file itself --------------------------------------------------------------------------


@pytest.mark.skipif(sys.platform == "win32", reason="no such files there")
@pytest.mark.parametrize("suffix", ["csv", "mat"])
def test_pipes_and_devices_are_refused_before_they_are_opened(tmp_path, suffix):
    pipe, device = tmp_path / f"pipe.{suffix}", tmp_path / f"zero.{suffix}"
    os.mkfifo(pipe)
    device.symlink_to("/dev/zero")
    for path in (pipe, device):
        assert "pipe or a device" in refusal(read, path)


def test_a_name_that_the_system_refuses_is_refused(tmp_path):
    assert "cannot be read (File name too long)" in refusal(read, tmp_path / f"{'x' * 5000}.csv")


def test_a_link_to_a_file_is_a_file(tmp_path):
    (tmp_path / "file.csv").write_bytes(CSV)
    (tmp_path / "run.csv").symlink_to(tmp_path / "file.csv")
    np.testing.assert_array_equal(load(tmp_path / "run.csv").channels["x"], X)


def test_a_link_to_nothing_is_called_one(tmp_path):
    (tmp_path / "run.csv").symlink_to("gone.csv")
    assert "a link to what is not there" in refusal(read, tmp_path / "run.csv")


@pytest.mark.parametrize("suffix", ["csv", "mat"])
def test_a_file_that_was_reserved_and_never_written_is_refused_unread(tmp_path, suffix):
    with (tmp_path / f"run.{suffix}").open("wb") as file:
        file.truncate(1 << 30)
    assert "never written" in refusal(read, tmp_path / f"run.{suffix}")


@pytest.mark.parametrize("change", [lambda file: file.write(b"9"), lambda file: file.truncate(10)])
def test_a_file_that_changes_while_it_is_read_is_refused(tmp_path, change):
    path = tmp_path / "run.csv"
    path.write_bytes(CSV)
    with Content(str(path)) as content:
        with path.open("ab") as file:
            change(file)
        assert "changed while it was read" in refusal(content.all)


@pytest.mark.parametrize("suffix", ["csv", "mat"])
def test_the_digest_is_of_the_bytes_that_were_decoded(tmp_path, suffix):
    path = tmp_path / f"run.{suffix}"
    path.write_bytes(CSV) if suffix == "csv" else savemat(path, {"x": X})
    assert read(path)[1].sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


# --- names ------------------------------------------------------------------------------------

NAME = "x\x1b[2J\r\u202e"
SHOWN = r"x\x1b[2J\r\u202e"


def test_control_characters_of_names_are_escaped_in_every_format(tmp_path, decode):
    name = NAME.replace("\r", "")
    shown = SHOWN.replace(r"\r", "")
    tdms, hdf5 = io.BytesIO(), io.BytesIO()
    with TdmsWriter(tdms) as file:
        file.write_segment([ChannelObject("g", name, X)])
    with h5py.File(hdf5, "w") as file:
        file[name] = X
    found = [
        csv.read("run.csv", CSV.replace(b"x", name.encode())),
        decode("tdms", "run", tdms.getvalue()),
        decode("mat", "run", hdf5.getvalue()),
        decode("mdf", "run", mdf(tmp_path, name=name)),
    ]
    assert [list(table.columns)[-1] for table in found] == [shown] * 4


def test_sentences_show_control_characters_and_leave_letters():
    assert str(InputError(f"{NAME}, Kühler\u00a0µ °")) == f"{SHOWN}, Kühler\u00a0µ °"


# --- MDF --------------------------------------------------------------------------------------


def mdf(folder, conversion=None, name="x", samples=X):
    with MDF(version="4.10") as file:
        file.append([MdfSignal(samples, TIME, name=name, conversion=conversion)])
        return Path(file.save(folder / "run.mf4", overwrite=True)).read_bytes()


def test_a_formula_is_refused_by_name(tmp_path, decode):
    content = mdf(tmp_path, {"formula": "X1 + 1"})
    sentence = refusal(decode, "mdf", "run.mf4", content)
    assert "channel x is computed by the formula 'X1 + 1'" in sentence


COUNTS = np.arange(12, dtype=np.uint16)


@pytest.mark.parametrize(
    ("conversion", "expected"),
    [
        ({"a": 0.5, "b": -1.0}, 0.5 * COUNTS - 1),
        (
            {"P1": 0, "P2": 2, "P3": 1, "P4": 0, "P5": 0.5, "P6": 4},
            (2 * COUNTS + 1) / (COUNTS / 2 + 4),
        ),
        (
            {"raw_0": 0.0, "phys_0": 1.0, "raw_1": 10.0, "phys_1": 3.0, "interpolation": True},
            np.interp(COUNTS, [0, 10], [1, 3]),
        ),
    ],
    ids=["linear", "rational", "table"],
)
def test_conversions_to_numbers_are_applied(tmp_path, decode, conversion, expected):
    table = decode("mdf", "run.mf4", mdf(tmp_path, conversion, samples=COUNTS))
    np.testing.assert_allclose(table.columns["x"], expected, rtol=1e-12)


def test_other_kinds_of_mdf_are_refused(decode):
    assert "not closed" in refusal(decode, "mdf", "run.mf4", b"UnFinMF 4.10    ")
    assert "must be 4, got '3.30'" in refusal(decode, "mdf", "run.mf4", b"MDF     3.30    ")


def test_channels_of_text_are_left_out(tmp_path, decode):
    words = {"val_0": 0, "text_0": b"off", "val_1": 1, "text_1": b"on", "default": b"?"}
    content = mdf(tmp_path, words, samples=COUNTS)
    assert list(decode("mdf", "run.mf4", content).columns) == []


def test_samples_that_are_declared_and_not_there_are_refused(tmp_path, decode):
    content = mdf(tmp_path)
    group = content.index(b"##CG") + 24 + 6 * 8 + 8  # header, links, record id: number of samples
    assert int.from_bytes(content[group : group + 8], "little") == 12
    content = content[:group] + (13).to_bytes(8, "little") + content[group + 8 :]
    assert "declares 13 samples and holds 12" in refusal(decode, "mdf", "run.mf4", content)


def test_a_group_that_does_not_count_in_seconds_has_no_times(tmp_path, decode):
    content = mdf(tmp_path)
    place = content.index(
        (2).to_bytes(1, "little") + (1).to_bytes(1, "little"), content.index(b"##CN")
    )
    angle = content[: place + 1] + (2).to_bytes(1, "little") + content[place + 2 :]
    table = decode("mdf", "run.mf4", angle)
    assert list(table.columns) == ["time", "x"]
    assert table.units.get("t") is None


# --- MATLAB -----------------------------------------------------------------------------------


def hdf5(build):
    written = io.BytesIO()
    with h5py.File(written, "w") as file:
        file["t"] = TIME
        build(file)
    return written.getvalue()


def outside(folder):
    with h5py.File(folder / "other.h5", "w") as file:
        file["secret"] = X
    return str(folder / "other.h5")


def test_links_are_not_followed_and_harm_nothing(tmp_path, decode):
    def build(file):
        file["dangling"] = h5py.SoftLink("/nothing")
        file["gone"] = h5py.ExternalLink("gone.h5", "/x")
        file["other"] = h5py.ExternalLink(outside(tmp_path), "/secret")

    assert list(decode("mat", "run.mat", hdf5(build)).columns) == ["t"]


@pytest.mark.parametrize("kind", ["external", "virtual"])
def test_values_of_another_file_are_refused(tmp_path, decode, kind):
    def build(file):
        if kind == "external":
            (tmp_path / "raw").write_bytes(X.tobytes())
            file.create_dataset("x", (12,), float, external=[(str(tmp_path / "raw"), 0, 96)])
        else:
            layout = h5py.VirtualLayout((12,), float)
            layout[:] = h5py.VirtualSource(outside(tmp_path), "secret", (12,))
            file.create_virtual_dataset("x", layout)

    assert "in another file" in refusal(decode, "mat", "run.mat", hdf5(build))


@pytest.mark.parametrize("options", [{}, {"chunks": (1000,)}, {"chunks": (4,)}])
def test_values_that_are_declared_and_not_stored_are_refused(decode, options):
    def build(file):
        values = file.create_dataset(
            "x", (10**12 if options != {"chunks": (4,)} else 12,), float, **options
        )
        values[:4] = 1.0 if options else np.array([])

    def empty(file):
        file.create_dataset("x", (10**12,), float)

    content = hdf5(build if options else empty)
    assert "holds fewer" in refusal(decode, "mat", "run.mat", content)


def test_groups_that_hold_each_other_are_refused(decode):
    def build(file):
        group = file.create_group("a")
        group["a"] = group

    assert "(RecursionError)" in refusal(decode, "mat", "run.mat", hdf5(build))


def test_groups_within_groups_by_many_ways_are_refused(decode):
    """By their number, or on a slow machine by the time that it takes."""

    def build(file):
        for _ in range(14):
            file["b"] = inner = file.create_group("a")
            file = inner
        file["x"] = X

    sentence = refusal(decode, "mat", "run.mat", hdf5(build))
    assert "(RecursionError)" in sentence or "took longer than 3 s of computing" in sentence


def test_complex_vectors_and_structs_within_structs(decode):
    written = io.BytesIO()
    parts = np.zeros((1, 2), dtype=[("Data", object), ("Name", object)])
    parts[0, 0], parts[0, 1] = (X, "a"), (-X, "b")
    deep = {"time": TIME, "in": {"y": X, "short": X[:3]}}
    savemat(written, {"z": X + 0j, "w": X + 2j * X, "run": {"Y": parts}, "log": deep})
    table = decode("mat", "run.mat", written.getvalue())
    names = ["z", "w.real", "w.imag", "run.Y1.Data", "run.Y2.Data", "log.time", "log.in.y"]
    assert list(table.columns) == names
    np.testing.assert_array_equal(table.columns["w.imag"], 2 * X)
    np.testing.assert_array_equal(table.columns["run.Y2.Data"], -X)
    assert table.clocks == dict.fromkeys(["log.time", "log.in.y"], "log.time")

    def build(file):
        pair = [("real", float), ("imag", float)]
        file["z"] = np.array(list(zip(X, 0 * X, strict=True)), dtype=pair)
        file["w"] = np.array(list(zip(X, 2 * X, strict=True)), dtype=pair)

    table = decode("mat", "run.mat", hdf5(build))
    assert list(table.columns) == ["t", "w.real", "w.imag", "z"]
    np.testing.assert_array_equal(table.columns["z"], X)


def test_two_vectors_of_one_name_are_refused(decode):
    written = io.BytesIO()
    parts = np.zeros((1, 1), dtype=[("x", object)])
    parts = np.repeat(parts, 2, axis=1)
    parts[0, 0]["x"], parts[0, 1]["x"] = X, X
    savemat(written, {"log": parts, "log1": {"x": X}})
    assert "duplicate column name log1.x" in refusal(decode, "mat", "run.mat", written.getvalue())


# --- TDMS -------------------------------------------------------------------------------------


def test_a_tdms_file_cut_in_its_values_is_refused(decode):
    written = io.BytesIO()
    with TdmsWriter(written) as file:
        file.write_segment([ChannelObject("g", "t", TIME), ChannelObject("g", "x", X)])
    for lost in (8, 96, 100):
        sentence = refusal(decode, "tdms", "run.tdms", written.getvalue()[:-lost])
        assert "cut short" in sentence


# --- text -------------------------------------------------------------------------------------


def test_a_column_without_values_beside_one_with_some_is_refused(tmp_path):
    written = io.BytesIO()
    with TdmsWriter(written) as file:
        file.write_segment([ChannelObject("g", "t", TIME), ChannelObject("g", "x", X)])
        file.write_segment([ChannelObject("g", "none", np.empty(0))])
    (tmp_path / "run.tdms").write_bytes(written.getvalue())
    assert "column none has no values" in refusal(load, tmp_path / "run.tdms")


def test_packed_text_is_read_and_bounded(tmp_path, monkeypatch):
    path = tmp_path / "run.CSV.gz"
    path.write_bytes(gzip.compress(CSV))
    np.testing.assert_array_equal(load(path).channels["x"], X)
    path.write_bytes(gzip.compress(CSV)[:-20])
    assert "cut short" in refusal(load, path)
    path.write_bytes(CSV)
    assert "not gzip" in refusal(load, path)
    monkeypatch.setattr(csv, "_UNPACKED", 1000)
    path.write_bytes(gzip.compress(CSV + b"\n" * 1000))
    assert "when unpacked" in refusal(load, path)


def test_a_hundred_thousand_columns_take_no_long_time():
    names = ",".join(f"c{k}" for k in range(100_000))
    began = time.process_time()
    assert len(csv.read("run.csv", f"{names}\n".encode()).columns) == 100_000
    assert time.process_time() - began < 10.0


def test_a_file_without_ends_of_lines_is_refused():
    sentence = refusal(csv.read, "run.csv", b"1," * 2_500_000)
    assert "line 1 has 5000000 bytes where a line of column names was wanted" in sentence


def test_lines_above_the_names_are_suspected():
    sentence = refusal(csv.read, "run.csv", b"bench 3\n" + CSV.replace(b"\n", b",0\n", 1))
    assert "(line 2) has 3 cells where the header names 1 columns; write one" in sentence
    assert "or remove lines that stand above the column names" in sentence


@pytest.mark.parametrize("mark", ["#", "%", "//"])
@pytest.mark.parametrize("units", ["", "s,V\n"])
def test_comments_above_the_names_are_passed_over(mark, units):
    names = f"t,x\n{units}"
    above = f"{mark} bench 3; hall 2, 21 degC\n{mark}\n"
    for head in (above + names, f"{mark} {names}", f"{above}{mark} {names}"):
        table = csv.read("run.csv", f"{head}{ROWS}".encode())
        np.testing.assert_array_equal(table.columns["x"], X)
        assert table.units == ({"t": "s", "x": "V"} if units else {})
    bad = f"{above}{names}{ROWS}0.1,none\n".encode()
    line = len(TIME) + 4 + bool(units)
    assert f"data row {len(TIME) + 1} (line {line})" in refusal(csv.read, "run.csv", bad)


def test_a_comment_may_stand_above_decimal_commas():
    rows = b"t;x\n0,0;1,5\n0,1;2,5\n"
    for head in (b"# bench 3, hall 2\n", b"# "):
        table = csv.read("run.csv", head + rows)
        np.testing.assert_array_equal(table.columns["x"], [1.5, 2.5])


def test_a_column_that_is_left_out_is_refused_by_name(tmp_path):
    """It stands in the file, so that "there is no such column" would not help."""
    words = np.array([b"a"] * 12, dtype="S4")

    def build(file):
        file["u"] = h5py.SoftLink("/t")
        file["x"] = X

    tdms = io.BytesIO()
    with TdmsWriter(tdms) as file:
        file.write_segment([ChannelObject("g", "t", TIME), ChannelObject("g", "u", ["a"] * 12)])
    states = {"val_0": 0, "text_0": b"off", "val_1": 1, "text_1": b"on", "default": b"?"}
    mat5 = io.BytesIO()
    savemat(mat5, {"t": TIME, "x": X, "u": "words"})
    files = {
        "link.mat": hdf5(build),
        "words.mat": hdf5(lambda file: file.create_dataset("u", data=words)),
        "run.mat": mat5.getvalue(),
        "run.tdms": tdms.getvalue(),
        "run.mf4": mdf(tmp_path, states, name="u", samples=COUNTS),
    }
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
        table, _ = read(tmp_path / name)
        assert "u" not in table.columns
        assert "u cannot be used as a column" in refusal(table.require_numbers, name, "u")


def test_more_rows_than_a_file_can_hold_are_refused_undecoded(decode):
    written = io.BytesIO()
    pl.DataFrame({"on": pl.repeat(True, 20_000_000, eager=True)}).write_parquet(
        written, row_group_size=20_000_000
    )
    sentence = refusal(decode, "parquet", "run.parquet", written.getvalue())
    assert "20000000 rows are declared in a file of" in sentence


def test_words_of_any_length_in_hdf5_are_left_out(decode):
    words = np.array(["warm", "cold"], dtype=h5py.string_dtype())
    table = decode("mat", "run.mat", hdf5(lambda file: file.create_dataset("state", data=words)))
    assert list(table.columns) == ["t"]
    assert "state" in table.left_out


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-be", "cp1252"])
@pytest.mark.parametrize("title", ["", "Prüfstand 2, Messung 4\n", "Prüfstand\n\nK. Huber\n"])
def test_other_encodings_and_titles_are_read(encoding, title):
    mark = b"\xfe\xff" if encoding == "utf-16-be" else b""
    text = title + ("t [s],ü [°C],w [A]\n" if title else "t [s],ü [°C]\n")
    text += "".join(f"{0.1 * k},{k}" + (",1\n" if title else "\n") for k in range(9))
    columns = csv.read("run.csv", mark + text.encode(encoding)).columns
    np.testing.assert_array_equal(columns["ü [°C]"], np.arange(9.0))
    bad = text.replace("8,", "x,")
    line = 10 + title.count("\n")
    assert f"data row 9 (line {line})" in refusal(csv.read, "r", mark + bad.encode(encoding))


def test_a_row_of_units_and_decimal_commas_below_a_title():
    text = "Prüfstand 2 / Messung 4\nt;u\ns;V\n0,1;2,5\n0,2;3\n"
    table = csv.read("run.csv", text.encode("cp1252"))
    assert table.units == {"t": "s", "u": "V"}
    np.testing.assert_array_equal(table.columns["u"], [2.5, 3.0])


def test_a_row_that_is_too_wide_is_no_recording_below_a_title():
    sentence = refusal(csv.read, "run.csv", b"t,x\n0,1,2\n1,2,3\n")
    assert "has 3 cells where the header names 2 columns" in sentence
    wide = refusal(csv.read, "run.csv", b"t,x,y\ns,V\n0,1\n0.1,2\n")
    assert "has 2 cells where the header names 3 columns" in wide


@pytest.mark.parametrize("end", ['0.01,"', '0.01,"\n', '0.01," \n', '",0.01'])
def test_a_quotation_mark_alone_is_refused_without_a_word_of_the_library(capfd, end):
    with pytest.raises(InputError):
        csv.read("run.csv", CSV + end.encode())
    assert capfd.readouterr() == ("", "")
