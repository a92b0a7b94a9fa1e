"""Bad binary recordings: MATLAB, MDF, Parquet and TDMS, damaged or made to do harm."""

import struct
import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import polars as pl

from validate.bad_files.good import changed, csv, hdf5, mat, mdf, parquet, recording, tdms
from validate.bad_files.text_recordings import Made

N = 2500
_COUNTS = np.arange(N, dtype=np.uint16)
#: Head of a MATLAB file of version 5, little endian.
_HEAD = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"


def _nan(name: str) -> dict[str, np.ndarray]:
    """Return the recording with one value of a column that is not a number."""
    values = recording()[name].copy()
    values[1200] = np.nan
    return changed(**{name: values})


def _changed_bytes(content: bytes, place: int, to: bytes) -> bytes:
    return content[:place] + to + content[place + len(to) :]


# --- MATLAB, version 5 --------------------------------------------------------------------------


def _element(kind: int, body: bytes) -> bytes:
    return struct.pack("<II", kind, len(body)) + body + bytes(-len(body) % 8)


def _matrix(kind: int, shape: tuple[int, int], *parts: bytes) -> bytes:
    """Return a matrix of a class, called x."""
    flags = _element(6, struct.pack("<II", kind, 0))
    return _element(
        14, flags + _element(5, struct.pack("<ii", *shape)) + _element(1, b"x") + b"".join(parts)
    )


def _huge_struct() -> bytes:
    names = _element(5, struct.pack("<i", 8)) + _element(1, b"a".ljust(8, b"\0"))
    return _HEAD + _matrix(2, (30_000, 30_000), names)


def _zeros_packed(count: int) -> bytes:
    """Return the stream of zlib for many MiB of zeros behind the head of a matrix."""
    size = count << 20
    head = _matrix(6, (size // 8, 1))[8:] + struct.pack("<II", 9, size)
    made = zlib.compressobj(9)
    begin = made.compress(struct.pack("<II", 14, len(head) + size) + head)
    begin += made.flush(zlib.Z_FULL_FLUSH)
    piece = made.compress(bytes(1 << 20)) + made.flush(zlib.Z_FULL_FLUSH)
    body = begin + piece * count
    return _HEAD + struct.pack("<II", 15, len(body)) + body


def _deep_struct() -> bytes:
    inner: Any = recording()
    for _ in range(40):
        inner = {"a": inner}
    return mat({"x": inner})


# --- MATLAB, version 7.3 ------------------------------------------------------------------------


def _chunk_bomb(file: h5py.File) -> None:
    file.create_dataset(
        "x", (400_000_000,), float, chunks=(100_000_000,), compression="gzip", fillvalue=0.0
    )
    file["x"].id.set_extent((400_000_000,))
    packed = zlib.compress(bytes(1 << 20)) * 1
    for k in range(4):
        file["x"].id.write_direct_chunk((k * 100_000_000,), packed)


def _linked_groups(file: h5py.File) -> None:
    """Make groups that hold each other by two ways, which are a thousand million paths."""
    for _ in range(30):
        file["b"] = inner = file.create_group("a")
        file = inner
    file["x"] = np.zeros(N)


def _itself(file: h5py.File) -> None:
    group = file.create_group("a")
    group["a"] = group


def _declared(file: h5py.File, size: int, **options: Any) -> None:
    file.create_dataset("x", (size,), float, **options)


def _other_file(file: h5py.File) -> None:
    file.create_dataset("i_q", (N,), float, external=[("/etc/passwd", 0, 8 * N)])


def _words(file: h5py.File) -> None:
    file["i_q"] = np.array([b"one"] * N, dtype=h5py.string_dtype())


def _set_link(file: h5py.File, link: h5py.SoftLink | h5py.ExternalLink) -> None:
    file["i_q"] = link


def _unknown_filter() -> bytes:
    """Return a file whose column asks for a filter of another number than gzip's."""
    content = hdf5(
        lambda file: file.create_dataset(
            "packed", data=recording()["i_q"], chunks=(N,), compression="gzip"
        )
    )
    place = content.index(b"deflate") - 8
    return _changed_bytes(content, place, struct.pack("<H", 32015))


_MATLAB: dict[str, Made] = {
    "MATLAB, empty": ("run.mat", b""),
    "MATLAB, the head alone": ("run.mat", _HEAD),
    "MATLAB, text": ("run.mat", csv()),
    "MATLAB, of version 4": ("run.mat", mat(format="4")),
    "MATLAB, cut in half": ("run.mat", mat()[: len(mat()) // 2]),
    "MATLAB, packed and cut": ("run.mat", mat(do_compression=True)[:-500]),
    "MATLAB, a type byte changed": ("run.mat", _changed_bytes(mat(), 176, b"\x00")),
    "MATLAB, a huge struct in 208 bytes": ("run.mat", _huge_struct()),
    "MATLAB, a huge cell": ("run.mat", _HEAD + _matrix(1, (30_000, 30_000))),
    "MATLAB, 3 GiB in 3 MB": ("run.mat", lambda path: path.write_bytes(_zeros_packed(3072))),
    "MATLAB, 40 structs deep": ("run.mat", _deep_struct()),
    "MATLAB, numbers without a vector": ("run.mat", mat({"pole_pairs": 5, "name": "bench"})),
    "MATLAB, a current missing": ("run.mat", mat(changed(i_q=None))),
    "MATLAB, NaN": ("run.mat", mat(_nan("i_q"))),
    "MATLAB, currents of another length": ("run.mat", mat(changed(i_q=np.zeros(N - 1)))),
    "MATLAB, a complex current": ("run.mat", mat(changed(i_q=recording()["i_q"] * (1 + 1j)))),
    "HDF5, empty": ("run.mat", hdf5(columns={})),
    "HDF5, cut in half": ("run.mat", hdf5()[: len(hdf5()) // 2]),
    "HDF5, the signature alone": ("run.mat", b"\x89HDF\r\n\x1a\n"),
    "HDF5, 10^12 values declared": ("run.mat", hdf5(lambda file: _declared(file, 10**12))),
    "HDF5, 5 10^8 values in chunks": (
        "run.mat",
        hdf5(lambda file: _declared(file, 5 * 10**8, chunks=(1 << 20,))),
    ),
    "HDF5, a chunk that unpacks to more": ("run.mat", hdf5(_chunk_bomb)),
    "HDF5, groups in each other by many ways": ("run.mat", hdf5(_linked_groups)),
    "HDF5, a group in itself": ("run.mat", hdf5(_itself)),
    "HDF5, values of another file": ("run.mat", hdf5(_other_file, changed(i_q=None))),
    "HDF5, a link to another file": (
        "run.mat",
        hdf5(lambda f: _set_link(f, h5py.ExternalLink("/tmp/x.h5", "/x")), changed(i_q=None)),
    ),
    "HDF5, a dangling link for a channel": (
        "run.mat",
        hdf5(lambda f: _set_link(f, h5py.SoftLink("/nowhere")), changed(i_q=None)),
    ),
    "HDF5, words for a channel": ("run.mat", hdf5(_words, changed(i_q=None))),
    "HDF5, an unknown filter": ("run.mat", _unknown_filter()),
    "HDF5, NaN": ("run.mat", hdf5(columns=_nan("u_d"))),
}


# --- MDF, Parquet, TDMS -------------------------------------------------------------------------


def _mdf_with_itself() -> bytes:
    """Return an MDF file whose first group of data names itself as the next one."""
    content = mdf()
    place = content.index(b"##DG")
    return _changed_bytes(content, place + 24, struct.pack("<Q", place))


def _mdf_cycles(count: int) -> bytes:
    content = mdf()
    return _changed_bytes(content, content.index(b"##CG") + 24 + 48 + 8, struct.pack("<Q", count))


def _parquet_bomb(path: Path) -> None:
    flags = pl.DataFrame({f"x{k}": pl.repeat(True, 100_000_000, eager=True) for k in range(3)})
    flags.write_parquet(path, compression="zstd", row_group_size=10_000_000)


def _lists() -> dict[str, Any]:
    return {**recording(), "i_q": pl.Series([[1.0, 2.0]] * N)}


_OTHERS: dict[str, Made] = {
    "MDF, empty": ("run.mf4", b""),
    "MDF, text": ("run.mf4", csv()),
    "MDF, not closed": ("run.mf4", b"UnFinMF " + mdf()[8:]),
    "MDF, of version 3": ("run.mf4", mdf(version="3.30")),
    "MDF, cut in half": ("run.mf4", mdf()[: len(mdf()) // 2]),
    "MDF, the head alone": ("run.mf4", mdf()[:64]),
    "MDF, a group after itself": ("run.mf4", _mdf_with_itself()),
    "MDF, 10^12 samples declared": ("run.mf4", _mdf_cycles(10**12)),
    "MDF, one sample more than there are": ("run.mf4", _mdf_cycles(N + 1)),
    "MDF, a formula": ("run.mf4", mdf(conversion={"formula": "__import__('os').system('id')"})),
    "MDF, words for a channel": (
        "run.mf4",
        mdf(
            changed(u_d=_COUNTS % 2),
            conversion={"val_0": 0, "text_0": b"off", "val_1": 1, "text_1": b"on", "default": b"?"},
        ),
    ),
    "MDF, no group": ("run.mf4", mdf({"t": recording()["t"]})),
    "MDF, invalid samples all over": ("run.mf4", mdf(invalid=np.arange(N) % 70 == 5)),
    "MDF, a unit unknown": ("run.mf4", mdf(units={"i_d": "parsec"})),
    "MDF, voltages sampled slowly": (
        "run.mf4",
        mdf(changed(u_d=None), {"t": recording()["t"][::10], "u_d": recording()["u_d"][::10]}),
    ),
    "MDF, NaN": ("run.mf4", mdf(_nan("i_q"))),
    "Parquet, empty": ("run.parquet", b""),
    "Parquet, text": ("run.parquet", csv()),
    "Parquet, the signature alone": ("run.parquet", b"PAR1"),
    "Parquet, cut in half": ("run.parquet", parquet()[: len(parquet()) // 2]),
    "Parquet, no row": ("run.parquet", pl.DataFrame(recording()).clear().write_parquet),
    "Parquet, a missing value": (
        "run.parquet",
        parquet({**recording(), "i_q": pl.Series([None, *recording()["i_q"][1:]])}),
    ),
    "Parquet, NaN": ("run.parquet", parquet(_nan("i_q"))),
    "Parquet, words for a channel": (
        "run.parquet",
        parquet({**recording(), "i_q": pl.Series(["1.0"] * N)}),
    ),
    "Parquet, lists for a channel": ("run.parquet", parquet(_lists())),
    "Parquet, times of day": (
        "run.parquet",
        parquet({**recording(), "t": pl.Series(range(N), dtype=pl.Datetime)}),
    ),
    "Parquet, 300 million flags": ("run.parquet", _parquet_bomb),
    "TDMS, empty": ("run.tdms", b""),
    "TDMS, text": ("run.tdms", csv()),
    "TDMS, the tag alone": ("run.tdms", b"TDSm"),
    "TDMS, cut short": ("run.tdms", tdms()[:-1000]),
    "TDMS, a segment of 10^18 bytes": (
        "run.tdms",
        _changed_bytes(tdms(), 12, struct.pack("<Q", 10**18)),
    ),
    "TDMS, 4 10^9 objects": ("run.tdms", _changed_bytes(tdms(), 28, struct.pack("<I", 2**32 - 1))),
    "TDMS, no channel": ("run.tdms", tdms({})),
    "TDMS, words for a channel": ("run.tdms", tdms({**recording(), "i_q": ["a"] * N})),
    "TDMS, a channel that is short": ("run.tdms", tdms(changed(i_q=recording()["i_q"][:-1]))),
    "TDMS, a channel without values": ("run.tdms", tdms(changed(i_q=np.empty(0)))),
    "TDMS, an unknown unit": ("run.tdms", tdms(unit_string="parsec")),
    "TDMS, NaN": ("run.tdms", tdms(_nan("omega_el"))),
}

#: Bad recordings of binary formats.
BINARY: dict[str, Made] = {**_MATLAB, **_OTHERS}
