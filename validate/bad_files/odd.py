"""Odd but good files: each holds the good recording in a form that is rare."""

import gzip
from pathlib import Path

import h5py
import numpy as np
import polars as pl

from validate.bad_files.good import changed, csv, hdf5, mat, mdf, parquet, recording, tdms
from validate.bad_files.text_recordings import Made


def _struct_array() -> np.ndarray:
    """Return the recording as a struct of vectors in an array of one."""
    held = np.zeros((1, 1), dtype=[(name, object) for name in recording()])
    for name, values in recording().items():
        held[name][0, 0] = values[:, None]
    return held


def _complex(file: h5py.File) -> None:
    values = np.zeros(2500, dtype=[("real", float), ("imag", float)])
    values["real"] = recording()["i_q"]
    file["i_q"] = values


def _soft_link(file: h5py.File) -> None:
    file.create_group("#store#")["current"] = recording()["i_q"]
    file["i_q"] = h5py.SoftLink("/#store#/current")


def _beside(file: h5py.File) -> None:
    """Put beside the channels what may stand in a file and is no channel."""
    file["comments"] = np.array(["warm", "cold"], dtype=h5py.string_dtype())
    file["events"] = h5py.SoftLink("/nowhere")
    file["raw"] = h5py.ExternalLink("raw.h5", "/x")
    file.create_dataset("sweeps", (3,), dtype=h5py.vlen_dtype(np.float64))


def _linked(path: Path) -> None:
    (path.parent / "the recording itself.csv").write_text(csv())
    path.symlink_to("the recording itself.csv")


def _quoted() -> str:
    head, *rows = csv().splitlines()
    return "\r\n".join([head, *(",".join(f'"{c}"' for c in row.split(",")) for row in rows), ""])


#: Study file of the rows that need one: a struct's fields have the name of the struct before them.
_FIELDS = "[channels]\n" + "".join(f'{name} = "log.{name}"\n' for name in recording())
_COMMENTED = "# \N{DEGREE SIGN}C\n[channels]\n" + "".join(f'{n} = "{n}"\n' for n in recording())

#: Kind -> file, study file or None, and words of the refusal where it is refused by name.
ODD: dict[str, tuple[Made, bytes | None, str]] = {
    "CSV with a byte-order mark": (("run.csv", b"\xef\xbb\xbf" + csv().encode()), None, ""),
    "CSV, lines end in CR LF": (("run.csv", csv().replace("\n", "\r\n")), None, ""),
    "CSV, no end of the last line": (("run.csv", csv().rstrip("\n")), None, ""),
    "CSV, blank lines between": (("run.csv", csv().replace("\n", "\n\n")), None, ""),
    "CSV, spaces around cells": (("run.csv", csv(separator=" , ")), None, ""),
    "CSV, tabulators": (("run.csv", csv(separator="\t")), None, ""),
    "CSV, semicolons and decimal commas": (
        ("run.csv", csv(separator=";").replace(".", ",")),
        None,
        "",
    ),
    "CSV, every cell quoted": (("run.csv", _quoted()), None, ""),
    "CSV, capital suffix": (("RUN.CSV", csv()), None, ""),
    "CSV, comments above the header": (("run.csv", "# bench 3, hall 2\n" + csv()), None, ""),
    "CSV, a row of units": (("run.csv", csv(units="s,V,V,A,A,rad/s,rad")), None, ""),
    "CSV, a column of words": (
        ("run.csv", csv({**recording(), "state": np.array(["on"] * 2500)})),
        None,
        "",
    ),
    "CSV, a link to it": (("run.csv", _linked), None, ""),
    "CSV packed by gzip": (("run.csv.gz", gzip.compress(csv().encode())), None, ""),
    "CSV packed in two members": (
        (
            "run.csv.gz",
            gzip.compress(csv().encode()[:1000]) + gzip.compress(csv().encode()[1000:]),
        ),
        None,
        "",
    ),
    "CSV in UTF-16": (("run.csv", csv().encode("utf-16")), None, ""),
    "CSV in latin-1": (("run.csv", ("# Prüfstand, 20 °C\n" + csv()).encode("latin-1")), None, ""),
    "CSV, a path with spaces and umlauts": (("Prüf lauf.csv", csv()), None, ""),
    "MATLAB, a struct": (("run.mat", mat({"log": recording()})), _FIELDS.encode(), ""),
    "MATLAB, an array of one struct": (
        ("run.mat", mat({"log": _struct_array()})),
        _FIELDS.encode(),
        "",
    ),
    "MATLAB, complex of zero imaginary part": (
        ("run.mat", mat(changed(i_q=recording()["i_q"] + 0j))),
        None,
        "",
    ),
    "MATLAB, packed, rows": (
        ("run.mat", mat({n: v[None] for n, v in recording().items()}, do_compression=True)),
        None,
        "",
    ),
    "MATLAB, words, cells and empties beside": (
        ("run.mat", mat({**recording(), "name": "x", "c": np.array([[1, "a"]], object), "e": []})),
        None,
        "",
    ),
    "HDF5, complex of zero imaginary part": (
        ("run.mat", hdf5(_complex, changed(i_q=None))),
        None,
        "",
    ),
    "HDF5, a soft link for a channel": (
        ("run.mat", hdf5(_soft_link, changed(i_q=None))),
        None,
        "a link",
    ),
    "HDF5, vlen and dangling links beside": (("run.mat", hdf5(_beside)), None, ""),
    "HDF5, packed in chunks": (
        (
            "run.mat",
            hdf5(
                lambda f: f.create_dataset(
                    "i_q", data=recording()["i_q"], chunks=(64,), compression="gzip", shuffle=True
                ),
                changed(i_q=None),
            ),
        ),
        None,
        "",
    ),
    "Parquet, float32, gzip, many groups": (
        ("run.parquet", parquet(compression="gzip", row_group_size=100)),
        None,
        "",
    ),
    "Parquet, words and dates beside": (
        (
            "run.parquet",
            parquet(
                {**recording(), "s": ["on"] * 2500, "d": pl.Series(range(2500), dtype=pl.Date)}
            ),
        ),
        None,
        "",
    ),
    "MDF, a linear conversion": (
        ("run.mf4", mdf(changed(u_d=2 * recording()["u_d"] - 6), conversion={"a": 0.5, "b": 3.0})),
        None,
        "",
    ),
    "MDF, units in thousandths": (
        ("run.mf4", mdf(changed(i_d=1e3 * recording()["i_d"]), units={"i_d": "mA"})),
        None,
        "",
    ),
    "TDMS, a waveform": (
        ("run.tdms", tdms(changed(t=None), wf_increment=1e-4, wf_start_offset=0.0)),
        None,
        "",
    ),
    "a study file with a byte-order mark": (
        ("run.csv", csv()),
        b"\xef\xbb\xbf" + _COMMENTED.encode(),
        "",
    ),
}
