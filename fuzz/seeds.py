"""Good files of every format, small, for `fuzz.readers` to damage."""

import gzip
import io
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import h5py
import numpy as np
import openpyxl
import polars as pl
from asammdf import MDF
from asammdf import Signal as MdfSignal
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat
from scipy.sparse import eye_array

SAMPLES = 12
TIME = np.arange(SAMPLES) * 1e-3
X = np.random.default_rng(0).normal(size=SAMPLES)


def _mat_variables() -> dict[str, Any]:
    signals = np.zeros((1, 2), dtype=[("values", object), ("label", object)])
    signals[0, 0] = (X[:, None], "i_d")
    signals[0, 1] = (np.stack([X, -X], axis=1), "")
    cell = np.empty((1, 2), dtype=object)
    cell[0, 0], cell[0, 1] = X, "text"
    return {
        "t": TIME,
        "log": {"time": TIME, "x": X, "deep": {"y": X}, "name": "motor"},
        "scope": {"time": TIME[:, None], "signals": signals},
        "abc": np.stack([X, 2 * X, 3 * X], axis=1).astype(np.float32),
        "n": np.arange(SAMPLES, dtype=np.int16),
        "space_vector": X + 1j * X,
        "on": X > 0,
        "cell": cell,
        "sparse": eye_array(4).tocsc(),
    }


def _mat(*names: str, packed: bool = False) -> bytes:
    written = io.BytesIO()
    variables = {name: v for name, v in _mat_variables().items() if not names or name in names}
    savemat(written, variables, do_compression=packed)
    return written.getvalue()


def _hdf5(**options: Any) -> bytes:
    written = io.BytesIO()
    with h5py.File(written, "w", **options) as file:
        file["t"], file["x"] = TIME, X
        file.create_dataset("packed", data=X, chunks=(4,), compression="gzip")
        file.create_dataset("checked", data=X[None], chunks=(1, 5), fletcher32=True, shuffle=True)
        file["z"] = np.array(list(zip(X, X, strict=True)), dtype=[("real", float), ("imag", float)])
        scope, parts = file.create_group("scope"), file.create_group("#refs#")
        scope["time"] = TIME[None]
        text = parts.create_dataset("label", data=np.array([[105], [100]], dtype=np.uint16))
        text.attrs["MATLAB_class"] = np.bytes_("char")
        values = parts.create_dataset("values", data=X[None])
        signals = scope.create_group("signals")
        for name, node in (("values", values), ("label", text)):
            signals.create_dataset(name, data=np.array([[node.ref]], dtype=h5py.ref_dtype))
    return written.getvalue()


def _mdf(compression: int) -> bytes:
    table = {"raw_0": 0, "phys_0": 0.0, "raw_1": 9, "phys_1": 1.5}
    rational = {"P1": 0, "P2": 2, "P3": 1, "P4": 0, "P5": 0.1, "P6": 1}
    words = {"val_0": 0, "text_0": b"off", "val_1": 1, "text_1": b"on", "default": b"?"}
    counts = np.arange(SAMPLES, dtype=np.uint16)
    channels = [MdfSignal(X, TIME, unit="mA", name="x")]
    for name, conversion in (
        ("linear", {"a": 0.1, "b": 2.0}),
        ("table", table),
        ("rational", rational),
        ("words", words),
    ):
        channels.append(MdfSignal(counts, TIME, name=name, conversion=conversion))
    invalid = np.arange(SAMPLES) == 5
    with tempfile.TemporaryDirectory() as folder, MDF(version="4.10") as file:
        file.append(channels)
        slow = np.array([b"a", b"bc", b"c"])
        file.append([MdfSignal(slow, TIME[::4], name="word", encoding="utf-8")])
        file.append([MdfSignal(X, TIME, name="partly", invalidation_bits=invalid)])
        saved = file.save(Path(folder) / "seed.mf4", compression=compression)
        return Path(saved).read_bytes()


def _parquet(**options: Any) -> bytes:
    written = io.BytesIO()
    whole = pl.Series("n", np.arange(SAMPLES), dtype=pl.Int16)
    flag = pl.Series("on", X > 0)
    pl.DataFrame([pl.Series("t", TIME), pl.Series("x", X), whole, flag]).write_parquet(
        written, **options
    )
    return written.getvalue()


def _xlsx() -> bytes:
    book, written = openpyxl.Workbook(), io.BytesIO()
    book.active.append(["t", "x (A)"])
    for k in range(SAMPLES):
        book.active.append([1e-3 * k, float(k)])
    book.save(written)
    return written.getvalue()


def _tdms() -> bytes:
    written = io.BytesIO()
    wave = {"wf_increment": 1e-3, "wf_start_time": np.datetime64("2024-05-01"), "unit_string": "A"}
    with TdmsWriter(written) as file:
        for _ in range(2):
            file.write_segment(
                [
                    ChannelObject("fast", "x", X, properties=wave),
                    ChannelObject("slow", "Time", TIME[::4]),
                    ChannelObject("slow", "n", np.arange(3, dtype=np.int16)),
                    ChannelObject("slow", "word", ["a", "b", "c"]),
                ]
            )
    return written.getvalue()


def _csv(separator: str = ",", comma: bool = False, units: str = "", end: str = "\n") -> bytes:
    rows = [f"{t!r}{separator}{x!r}" for t, x in zip(TIME.tolist(), X.tolist(), strict=True)]
    rows = [row.replace(".", ",") for row in rows] if comma else rows
    head = [f"t{separator}x", *([units] if units else [])]
    return (end.join([*head, *rows]) + end).encode()


_STUDY = """
flux_map = "coenergy"
horizon = 25
pole_pairs = 5
seed = 3
terms = ["temperature_resistance"]
angle_orders = [6, 12]
resample = "linear"
[channels]
t = { column = "Zeit", unit = "ms" }
u_d = { column = "ud", unit = "V", delay = -1, scale = 1e-3 }
i_d = { column = "Id [A]", unit = "mA", rms = true, sign = -1 }
omega_el = { column = "n", unit = "1/min", mechanical = true }
u_a = { column = "duty", times = "u_dc", unit = "V" }
[name_plate]
resistance = 0.1
"""

#: Format -> a function that makes its good files.
SEEDS: Mapping[str, Callable[[], list[bytes]]] = MappingProxyType(
    {
        "mat": lambda: [_mat(), *(_mat(name) for name in _mat_variables())],
        "mat packed": lambda: [_mat(packed=True), _mat("t", "log", packed=True)],
        "mat 7.3": lambda: [_hdf5(), _hdf5(libver="latest"), _hdf5(userblock_size=512)],
        "mdf": lambda: [_mdf(0), _mdf(1), _mdf(2)],
        "parquet": lambda: [
            _parquet(),
            _parquet(compression="uncompressed"),
            _parquet(compression="gzip", row_group_size=5),
        ],
        "tdms": lambda: [_tdms()],
        "xlsx": lambda: [_xlsx()],
        "csv": lambda: [
            _csv(),
            _csv("\t", units="ms\tA"),
            _csv(";", comma=True, end="\r\n"),
            b"\xef\xbb\xbf" + _csv(" , "),
            b"t,on\n" + b"".join(b"%d,true\n" % k for k in range(SAMPLES)),
            _csv().replace(b"0.003", b'"0.003"'),
        ],
        "csv packed": lambda: [gzip.compress(_csv(), mtime=0)],
        "study": lambda: [_STUDY.encode()],
    }
)
