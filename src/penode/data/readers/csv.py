"""Reader of text files with one header line: comma-separated values and their relatives.

Rows are parsed block by block, so that a long file takes little more memory than its text and its
numbers. A fast parse takes every well-formed block. What it cannot take is parsed cell by cell,
slowly, to find the row and channel that a refusal has to name.
"""

import csv
import gzip
import importlib.util
import io
import mmap
import re
import tempfile
import warnings
import zlib
from collections.abc import Collection, Iterator

import numpy as np

from penode.data.gathered import forget, write
from penode.data.readers.csv_cells import Cells, Dialect, unsplittable
from penode.data.table import Column, Table, clean_names
from penode.data.units import unit_name
from penode.errors import InputError

# Marks that separate cells where every line has them; they are no part of a number.
_RARE_SEPARATORS = "\t;|"
# A quotation mark alone in a cell, at which polars panics, and says so to the terminal. Looked for
# by the mark: a search for what may stand before it takes three times as long as all the parsing.
_LONE_QUOTE = re.compile(rb'"(?<![^,;\t| \r\n]")(?![^,;\t| \r\n])')
_MARK = b"\xef\xbb\xbf"
#: Bytes of text that NumPy parses sooner than polars, ten times as fast, is imported.
_SHORT = 1 << 22
_BLOCK = 1 << 23
#: Bytes of the longest line of column names.
_HEADER = 1 << 22
#: Bytes that a compressed file may be unpacked to.
_UNPACKED = 1 << 30


def read(file: str, content: bytes | mmap.mmap) -> Table:
    """Read the columns of a CSV file, float64 and finite, in the order and the units of the file.

    Cells are separated by commas, semicolons, tabulators or ``|``; numbers have a decimal point, or
    a comma where that does not separate cells. Below the header may stand a row of units. Spaces
    around names and cells, a byte-order mark, blank lines and columns of ``true`` and ``false`` are
    accepted. A column without a number in any row is text and left out.
    """
    _check_text(file, content)
    start = len(_MARK) if content[: len(_MARK)] == _MARK else 0
    body = _line_end(content, start)
    below = _line_end(content, body)
    if body > _HEADER:
        raise InputError(
            f"{file}: line 1 has {body} bytes where a line of column names was wanted; add the "
            "names, and end each row with a line feed."
        )
    header, second = content[start:body].decode(), content[body:below].decode()
    dialect = _dialect(header, second, content.find(b",", body) >= 0)
    names = _header_names(file, header, dialect)
    units = _units(names, second, dialect)
    cells = Cells(file, names, dialect, 2 if units else 1)
    for block in _blocks(content, below if units else body):
        columns = _parse_fast(names, block, dialect, cells.text)
        if columns is None:
            cells.parse(io.TextIOWrapper(io.BytesIO(block), encoding="utf-8", newline=""))
        else:
            cells.add(columns, block.count(b"\n"))
    return Table(cells.columns(), units, text=cells.text)


def read_packed(file: str, content: bytes) -> Table:
    """Read a CSV file that gzip compressed; refuse it if damaged or more than 1 GiB unpacked."""
    with tempfile.TemporaryFile(prefix="penode-") as unpacked:
        size = 0
        for block in _unpacked(file, content):
            size += len(block)
            write(unpacked, block)
        if size:
            return read(file, mmap.mmap(unpacked.fileno(), 0, access=mmap.ACCESS_READ))
    return read(file, b"")


def _unpacked(file: str, content: bytes) -> Iterator[bytes]:
    size = 0
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(content)) as packed:
            while block := packed.read(_BLOCK):
                size += len(block)
                if size > _UNPACKED:
                    raise InputError(
                        f"{file}: the content is more than {_UNPACKED >> 20} MiB when unpacked; "
                        "unpack it yourself and name the .csv file."
                    )
                yield block
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise InputError(
            f"{file}: the content is not gzip, or damaged or cut short ({error}); copy it again."
        ) from error


def _check_text(file: str, content: bytes | mmap.mmap) -> None:
    """Refuse what is not text."""
    if not any(block.strip() for block in _blocks(content, 0)):
        raise InputError(f"{file}: the file is empty; a header line and data rows were wanted.")
    if content[:4] == b"PAR1":
        raise InputError(
            f"{file}: the content is parquet, not CSV text; rename the file to end in .parquet."
        )
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise InputError(f"{file}: the content is UTF-16 text; export it as CSV in UTF-8.")
    start, where = 0, None
    try:
        for block in _blocks(content, 0):
            block.decode()
            where = "" if b"\0" in block else where
            start += len(block)
    except UnicodeDecodeError as error:
        where = f" (byte {start + error.start + 1})"
    if where is not None:
        raise InputError(
            f"{file}: the content is binary or not UTF-8 text{where}, where CSV text was wanted; "
            "export it as CSV in UTF-8."
        )


def _line_end(content: bytes | mmap.mmap, start: int) -> int:
    """Return where the line that begins at ``start`` ends: behind LF, CR LF or CR."""
    feed = content.find(b"\n", start) + 1 or len(content)
    carriage = content.find(b"\r", start, feed) + 1 or feed
    return feed if feed == carriage + 1 and content[feed - 1 : feed] == b"\n" else carriage


def _blocks(content: bytes | mmap.mmap, start: int) -> Iterator[bytes]:
    """Yield whole lines of about 8 MiB; a quoted cell may hold more than one line."""
    while start < len(content):
        end, open_quote = start, False
        while open_quote or end == start:
            begin, end = end, content.find(b"\n", end + _BLOCK) + 1 or len(content)
            open_quote ^= content[begin:end].count(b'"') % 2 == 1
            open_quote &= end < len(content)
        yield content[start:end]
        start = end
        if isinstance(content, mmap.mmap):
            forget(content)


def _dialect(header: str, second: str, comma_below: bool) -> Dialect:
    """Return how cells are written, from the header, the line below it and commas in the data."""
    lines = [line for line in (header, second) if line.strip()]
    rare = (mark for mark in _RARE_SEPARATORS if all(mark in line for line in lines))
    separator = next(rare, ",")
    return Dialect(separator, separator != "," and comma_below)


def _header_names(file: str, header: str, dialect: Dialect) -> list[str]:
    """Split the first line into column names."""
    if not header.strip():
        raise InputError(f"{file}: line 1 is blank; make the line of column names the first one.")
    try:
        cells = dialect.split(header)
    except csv.Error as error:
        raise unsplittable(file, 1, error) from error
    if all(dialect.number(cell) is not None for cell in cells):
        raise InputError(
            f"{file}: line 1 holds numbers where column names were wanted; add a header line."
        )
    return clean_names(file, cells)


def _units(names: list[str], second: str, dialect: Dialect) -> dict[str, str]:
    """Return the units in the line below the header, none where it is a row of data.

    A row of units holds at least one that is known, such as V, and no number but 1.
    """
    try:
        cells = dialect.split(second)
    except csv.Error:
        return {}
    units = {unit_name(cell) for cell in cells} - {None, "1"}
    numbers = [cell for cell in cells if dialect.number(cell) is not None and cell.strip() != "1"]
    if len(cells) != len(names) or numbers or not units:
        return {}
    return {name: cell.strip() for name, cell in zip(names, cells, strict=True) if cell.strip()}


def _parse_fast(
    names: list[str], block: bytes, dialect: Dialect, text: Collection[str]
) -> dict[str, Column] | None:
    """Parse rows in one go but for columns of text; None if anything is out of the ordinary."""
    if dialect.decimal_comma and b"." in block:
        return None
    if len(block) < _SHORT or importlib.util.find_spec("polars") is None:
        return None if text else _by_numpy(names, block, dialect)
    return None if _LONE_QUOTE.search(block) else _by_polars(names, block, dialect, text)


def _by_numpy(names: list[str], block: bytes, dialect: Dialect) -> dict[str, Column] | None:
    if dialect.decimal_comma:
        block = block.replace(b",", b".")
    lines = io.TextIOWrapper(io.BytesIO(block), encoding="utf-8", newline="")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # rows that are all blank
            rows = np.loadtxt(lines, float, None, dialect.separator, quotechar='"', ndmin=2)
    except ValueError:
        return None
    if rows.shape[1] != len(names) or not np.isfinite(rows).all():
        return None
    return dict(zip(names, map(np.copy, rows.T), strict=True))


def _by_polars(
    names: list[str], block: bytes, dialect: Dialect, text: Collection[str]
) -> dict[str, Column] | None:
    import polars as pl

    try:
        frame = pl.read_csv(
            block,
            has_header=False,
            schema={name: pl.String() if name in text else pl.Float64() for name in names},
            separator=dialect.separator,
            decimal_comma=dialect.decimal_comma,
        )
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException):
        return None
    # a missing cell becomes NaN
    table = {name: frame[name].to_numpy() for name in names if name not in text}
    plain = all(np.isfinite(values).all() for values in table.values())
    for name in text:
        numbers = frame[name].str.strip_chars().str.replace(",", ".", literal=True)
        plain &= numbers.cast(pl.Float64, strict=False).null_count() == len(frame)
    return table if plain and table else None
