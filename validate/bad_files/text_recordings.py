"""Bad text recordings, and paths at which there is none."""

import gzip
import os
import socket
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from validate.bad_files.good import changed, csv, parquet, recording

#: A file's name, and what makes it at a path, or the bytes in it.
Made = tuple[str, Callable[[Path], object] | bytes | str]


def _row(number: int, line: str) -> str:
    """Return the good file with another line in place of a data row."""
    lines = csv().splitlines()
    lines[number] = line
    return "\n".join([*lines, ""])


def _cell(column: str, text: str) -> str:
    """Return the good file with another cell in data row 1200."""
    cells = csv().splitlines()[1200].split(",")
    cells[list(recording()).index(column)] = text
    return _row(1200, ",".join(cells))


def _times(change: Callable[[np.ndarray], object]) -> str:
    """Return the good file with times that were changed."""
    times = recording()["t"].copy()
    change(times)
    return csv(changed(t=times))


def _set(values: np.ndarray, place: object, value: object) -> None:
    values[place] = value  # type: ignore[index]


def _first(rows: int) -> str:
    return "\n".join([*csv().splitlines()[: rows + 1], ""])


def _sparse(path: Path, head: bytes = b"", size: int = 8 << 30) -> None:
    with path.open("wb") as file:
        file.write(head)
        file.truncate(size)


def _link(path: Path, to: str) -> None:
    path.symlink_to(to)


def _listen(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


def _gzip_bomb() -> bytes:
    """Return 2 GiB of zeros as members of 1 MiB, one behind the other."""
    return gzip.compress(bytes(1 << 20)) * 2048


def _long_with_one_bad_cell(path: Path) -> None:
    head, _, body = csv().partition("\n")
    path.write_text(f"{head}\n{body * 200}a,b,c,d,e,f,g\n")


#: Where there is nothing that can be read.
PATHS: dict[str, Made] = {
    "missing file": ("run.csv", lambda path: None),
    "missing folder": ("there/run.csv", lambda path: None),
    "a file where a folder should be": (
        "a.csv/run.csv",
        lambda path: path.parent.write_text("a file\n"),
    ),
    "a directory": ("run.csv", lambda path: path.mkdir()),
    "a pipe": ("run.csv", lambda path: os.mkfifo(path)),
    "a pipe for a binary file": ("run.mat", lambda path: os.mkfifo(path)),
    "an endless device": ("run.csv", partial(_link, to="/dev/zero")),
    "an endless device for a binary file": ("run.mf4", partial(_link, to="/dev/urandom")),
    "a socket": ("run.parquet", _listen),
    "a dangling link": ("run.csv", partial(_link, to="gone.csv")),
    "a link to itself": ("run.csv", partial(_link, to="run.csv")),
    "a file of the kernel": ("run.csv", partial(_link, to="/proc/self/maps")),
    "a name too long": ("x" * 300 + ".csv", lambda path: None),
    "a newline in the path": ("run\n[channels]\n.csv", lambda path: None),
    "an escape sequence in the path": ("run\x1b[2J.csv", lambda path: None),
    "a name that is not UTF-8": (os.fsdecode(b"run\xff.csv"), lambda path: None),
    "no suffix": ("run", csv()),
    "a suffix of a spreadsheet": ("run.xlsx", b"PK\x03\x04"),
    "a suffix of plain HDF5": ("run.h5", b"\x89HDF\r\n\x1a\n"),
    "8 GiB of zeros as CSV": ("run.csv", _sparse),
    "256 MiB with the head of a MATLAB file": (
        "run.mat",
        partial(_sparse, head=b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM", size=1 << 28),
    ),
    "256 MiB with the head of a parquet file": (
        "run.parquet",
        partial(_sparse, head=b"PAR1", size=1 << 28),
    ),
    "256 MiB with the head of an MDF file": (
        "run.mf4",
        partial(_sparse, head=b"MDF     4.10    ", size=1 << 28),
    ),
}

#: CSV and packed CSV.
TEXTS: dict[str, Made] = {
    "empty": ("run.csv", b""),
    "blank lines only": ("run.csv", "\n \n\n" * 100),
    "a byte-order mark only": ("run.csv", b"\xef\xbb\xbf"),
    "a header only": ("run.csv", "t,u_d,u_q,i_d,i_q,omega_el\n"),
    "a header and units only": ("run.csv", "t,u_d,u_q,i_d,i_q,omega_el\ns,V,V,A,A,rad/s\n"),
    "no header": ("run.csv", csv().partition("\n")[2]),
    "a blank first line": ("run.csv", "\n" + csv()),
    "lines above the header": ("run.csv", "recorded on bench 3\n" + csv()),
    "duplicate columns": ("run.csv", csv().replace("u_q", "u_d", 1)),
    "a column without a name": ("run.csv", csv().replace("u_q", "", 1)),
    "parquet called CSV": ("run.csv", parquet()),
    "a picture called CSV": ("run.csv", b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 8),
    "a spreadsheet called CSV": ("run.csv", b"PK\x03\x04\x14\0\x06\0" + bytes(500)),
    "gzip called CSV": ("run.csv", gzip.compress(csv().encode())),
    "a web page called CSV": ("run.csv", "<html><body>\n<p>Please sign in</p>\n</body></html>\n"),
    "a NUL among the rows": ("run.csv", _cell("i_d", "0\0")),
    "NaN": ("run.csv", _cell("i_d", "NaN")),
    "infinity": ("run.csv", _cell("u_q", "inf")),
    "a number beyond float64": ("run.csv", _cell("u_q", "1e400")),
    "an empty cell": ("run.csv", _cell("i_q", "")),
    "a unit in a cell": ("run.csv", _cell("u_d", "12.5 V")),
    "a spreadsheet's error": ("run.csv", _cell("u_d", "#REF!")),
    "a hexadecimal number": ("run.csv", _cell("u_d", "0x1F")),
    "an underscore in a number": ("run.csv", _cell("u_d", "1_000")),
    "thousands separated": ("run.csv", _cell("u_d", '"1,234.5"')),
    "a point among decimal commas": (
        "run.csv",
        csv(separator=";").replace(".", ",").replace("0,0001;", "0.0001;", 1),
    ),
    "a row that is short": ("run.csv", _row(900, "1,2,3")),
    "a row that is long": ("run.csv", _row(900, "1,2,3,4,5,6,7,8,9")),
    "cut in the last row": ("run.csv", csv()[:-60]),
    "an unclosed quotation mark": ("run.csv", _cell("u_d", '"1')),
    "a second header in between": ("run.csv", _row(1200, csv().partition("\n")[0])),
    "times that step back": ("run.csv", _times(lambda t: _set(t, slice(1200, None), t[:1300]))),
    "a time twice": ("run.csv", _times(lambda t: _set(t, 1200, t[1199]))),
    "gaps all over": (
        "run.csv",
        _times(lambda t: _set(t, slice(None), t + 0.1 * (np.arange(t.size) // 100))),
    ),
    "irregular times": (
        "run.csv",
        _times(lambda t: _set(t, slice(None), t + 4e-5 * np.sin(np.arange(t.size)))),
    ),
    "one time throughout": ("run.csv", _times(lambda t: _set(t, slice(None), 1.0))),
    "times of day": ("run.csv", _row(1200, "12:00:01,0,0,0,0,0,0")),
    "a sampling time of 1 s": ("run.csv", csv(changed(t=np.arange(2500.0)))),
    "no time": ("run.csv", csv(changed(t=None))),
    "no current": ("run.csv", csv(changed(i_q=None))),
    "no voltage": ("run.csv", csv(changed(u_d=None, u_q=None))),
    "neither speed nor angle": ("run.csv", csv(changed(omega_el=None, theta_el=None))),
    "time and nothing else": ("run.csv", csv({"t": recording()["t"]})),
    "one sample": ("run.csv", _first(1)),
    "seven samples": ("run.csv", _first(7)),
    "eight samples": ("run.csv", _first(8)),
    "an unknown unit": ("run.csv", csv(units="s,V,furlong,A,A,rad/s,rad")),
    "a unit of another quantity": ("run.csv", csv(units="s,V,A,A,A,rad/s,rad")),
    "a voltage that is stuck": ("run.csv", csv(changed(u_q=np.full(2500, 45.0)))),
    "a current that is stuck": ("run.csv", csv(changed(i_d=np.full(2500, -20.0)))),
    "all zeros": ("run.csv", csv({n: v * (n == "t") for n, v in recording().items()})),
    "100 000 columns": ("run.csv", ",".join(f"c{k}" for k in range(100_000)) + "\n"),
    "half a million rows and one bad": ("run.csv", _long_with_one_bad_cell),
    "a million quotation marks": ("run.csv", "t,x\n" + '"\n' * 1_000_001),
    "one line of 50 MB": ("run.csv", lambda path: path.write_text("1," * 25_000_000)),
    "packed, empty": ("run.csv.gz", b""),
    "packed, not gzip": ("run.csv.gz", csv()),
    "packed, cut short": ("run.csv.gz", gzip.compress(csv().encode())[:-100]),
    "packed, damaged": ("run.csv.gz", gzip.compress(csv().encode()).replace(b"\x55", b"\x56")),
    "packed, with a tail": ("run.csv.gz", gzip.compress(csv().encode()) + b"tail" * 20),
    "packed, 2 GiB in 2 MB": ("run.csv.gz", _gzip_bomb()),
}
