"""Reader of text files with one header line: comma-separated values and their relatives.

Rows are parsed block by block, so that a long file takes little more memory than its text and its
numbers. A block of nothing but numbers is parsed in one go; any other is split row by row first, to
find the row and channel that a refusal has to name.
"""

import codecs
import csv
import gzip
import io
import mmap
import re
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from penode.arrays import FloatArray
from penode.data.gathered import Gathered, forget, on_disk
from penode.data.table import Column, Table, cell_error, clean_names
from penode.data.units import unit_name
from penode.errors import InputError

# Marks that separate cells where every line has them; they are no part of a number.
_RARE_SEPARATORS = "\t;|"
_MARK = b"\xef\xbb\xbf"
#: What begins a line above the column names that is none of them.
_COMMENTS = ("#", "%", "//")
_BLOCK = 1 << 23
#: Characters of a word in a block that is parsed in one go, one more than may be used.
_WORD = 32
#: Most lines of titles above the column names.
_ABOVE = 50
#: What no text in Windows-1252 has: controls but tabulators and ends of lines and pages.
_CONTROLS = r"\x00-\x08\x0b\x0e-\x1f\x7f"
#: Bytes of the longest line of column names.
_HEADER = 1 << 22
#: Bytes that a compressed file may be unpacked to.
_UNPACKED = 1 << 30


def read(file: str, content: bytes | mmap.mmap) -> Table:
    """Read the columns of a CSV file, float64 and finite, in the order and the units of the file.

    The text is UTF-8, UTF-16 with a byte-order mark, or else Windows-1252. Cells are separated by
    commas, semicolons, tabulators or ``|``; numbers have a decimal point, or a comma where that
    does not separate cells. Below the header may stand a row of units, above it titles, and lines
    that begin with ``#``, ``%`` or ``//``, of which the last is the header where numbers or units
    follow it. Spaces around names and cells, a byte-order mark, blank lines and columns of
    ``true`` and ``false`` are accepted. A column without a number in any row is text and left out.
    """
    content = _as_utf8(file, content)
    start, line = len(_MARK) if content[: len(_MARK)] == _MARK else 0, 1
    while _is_comment(content, start):
        start, line = _line_end(content, start), line + 1
    start, above = _below_titles(content, start)
    line += above
    body = _line_end(content, start)
    below = _line_end(content, body)
    if body - start > _HEADER:
        raise InputError(
            f"{file}: line {line} has {body - start} bytes where a line of column names was "
            "wanted; add the names, and end each row with a line feed."
        )
    header, second = _uncommented(content[start:body]), content[body:below].decode()
    dialect = _dialect(header, second, content.find(b",", body) >= 0)
    names = _header_names(file, line, header, dialect)
    units = _units(names, second, dialect)
    rows = _Rows(file, names, dialect, line + 1 if units else line)
    for block in _blocks(content, below if units else body):
        rows.add(block)
    return Table(rows.columns(), units, text=rows.text())


def read_packed(file: str, content: bytes) -> Table:
    """Read a CSV file that gzip compressed; refuse it if damaged or more than 1 GiB unpacked."""
    return read(file, on_disk(_unpacked(file, content)))


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


def _as_utf8(file: str, content: bytes | mmap.mmap) -> bytes | mmap.mmap:
    """Return the text in UTF-8; refuse what is none."""
    if not any(block.strip() for block in _blocks(content, 0)):
        raise InputError(f"{file}: the file is empty; it must have a header line and data rows.")
    if content[:4] == b"PAR1":
        raise InputError(
            f"{file}: the content is parquet, not CSV text; rename the file to end in .parquet."
        )
    where = ""
    wide = content[:2] in (b"\xff\xfe", b"\xfe\xff")
    for encoding in ("utf-16",) if wide else ("utf-8", "cp1252"):
        text = _decoded(content, encoding, "\0" if encoding == "utf-8" else _CONTROLS)
        try:
            if encoding != "utf-8":
                return on_disk(block.encode() for block in text)
            for _ in text:
                pass
            return content
        except UnicodeDecodeError as error:
            where = where or f" (byte {error.start + 1})"
        except _ControlError:
            pass
    raise InputError(
        f"{file}: the content is binary or not UTF-8 text{where}; export it as CSV in UTF-8."
    )


class _ControlError(ValueError):
    """A character that no text has."""


def _decoded(content: bytes | mmap.mmap, encoding: str, controls: str) -> Iterator[str]:
    """Yield the text block by block; errors count bytes from the file's beginning."""
    decoder, none = codecs.getincrementaldecoder(encoding)(), re.compile(f"[{controls}]")
    for first in range(0, len(content), _BLOCK):
        last = first + _BLOCK
        kept = len(decoder.getstate()[0])
        try:
            text = decoder.decode(content[first:last], last >= len(content))
        except UnicodeDecodeError as error:
            error.start += first - kept
            raise
        if none.search(text):
            raise _ControlError
        yield text
        if isinstance(content, mmap.mmap):
            forget(content)


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


@dataclass(frozen=True)
class _Dialect:
    """How the cells of a file are written."""

    separator: str
    decimal_comma: bool

    def split(self, line: str) -> list[str]:
        """Split one line into cells."""
        return next(csv.reader([line.strip(" \r\n")], delimiter=self.separator), [])

    def numbers(self, cells: Iterable[str]) -> list[float | None]:
        """Return the numbers that cells hold, None where they hold none."""
        if self.decimal_comma:
            # A point beside decimal commas separates thousands: 1.234 is no number then.
            cells = (cell.replace(".", "_").replace(",", ".") for cell in cells)
        return [_number(cell) for cell in cells]


def _dialect(header: str, second: str, comma_below: bool) -> _Dialect:
    """Return how cells are written, from the header, the line below it and commas in the data."""
    lines = [line for line in (header, second) if line.strip()]
    rare = (mark for mark in _RARE_SEPARATORS if all(mark in line for line in lines))
    separator = next(rare, ",")
    return _Dialect(separator, separator != "," and comma_below)


def _is_comment(content: bytes | mmap.mmap, start: int) -> bool:
    """Return whether a line is a comment above the names: no numbers and no units follow it."""
    body = _line_end(content, start)
    line, below = content[start:body], content[body : _line_end(content, body)]
    if max(len(line), len(below)) > _HEADER or not line.decode().lstrip().startswith(_COMMENTS):
        return False
    header, second = _uncommented(line), below.decode()
    dialects = (_dialect(second, "", comma) for comma in (False, True))
    try:
        numbers = [n for one in dialects for n in one.numbers(one.split(second))]
        cells = _dialect(header, second, False).split(header)
    except csv.Error:
        return False
    named = bool(second.strip()) and not any(number is not None for number in numbers)
    return named and not _units(cells, second, _dialect(header, second, False))


def _below_titles(content: bytes | mmap.mmap, start: int) -> tuple[int, int]:
    """Return where the line of names begins below titles, and how many lines those are.

    Titles have fewer cells than the names, which have as many as the row of numbers that follows.
    """
    ends = [start]
    while len(ends) <= _ABOVE + 2 and ends[-1] < len(content):
        ends.append(_line_end(content, ends[-1]))
    if ends[-1] - start > _HEADER:
        return start, 0
    lines = [content[a:b].decode() for a, b in pairwise(ends)]
    for above, (names, *below) in enumerate(zip(lines, lines[1:], lines[2:], strict=False)):
        dialect = _dialect(names, below[0], any("," in line for line in below))
        try:
            cells, *rows = map(dialect.split, (names, *below))
            titles = [dialect.split(line) for line in lines[:above]]
        except csv.Error:
            break
        alike = len(cells) == len(rows[0]) > max(map(len, titles), default=1)
        named = all(number is None for number in dialect.numbers(cells))
        if alike and named and any(n is not None for row in rows for n in dialect.numbers(row)):
            return ends[above], above
    return start, 0


def _uncommented(line: bytes) -> str:
    """Return a line without the mark of a comment that begins it."""
    text = line.decode()
    bare = text.lstrip()
    return next((bare.removeprefix(m) for m in _COMMENTS if bare.startswith(m)), text)


def _header_names(file: str, line: int, header: str, dialect: _Dialect) -> list[str]:
    """Split the line of column names."""
    if not header.strip():
        raise InputError(
            f"{file}: line {line} is blank; make the line of column names the first one."
        )
    try:
        cells = dialect.split(header)
    except csv.Error as error:
        raise _unsplittable(file, line, error) from error
    if None not in dialect.numbers(cells):
        raise InputError(f"{file}: line {line} holds numbers, not column names; add a header line.")
    return clean_names(file, cells)


def _units(names: list[str], second: str, dialect: _Dialect) -> dict[str, str]:
    """Return the units in the line below the header, none where it is a row of data.

    A row of units holds at least one that is known, such as V, and no number but 1.
    """
    try:
        cells = [cell.strip() for cell in dialect.split(second)]
    except csv.Error:
        return {}
    units = {unit_name(cell) for cell in cells} - {None, "1"}
    other = dialect.numbers(cell for cell in cells if cell != "1")
    if len(cells) != len(names) or any(one is not None for one in other) or not units:
        return {}
    return {name: cell for name, cell in zip(names, cells, strict=True) if cell}


class _Channel:
    """What one column held so far: its values, and whether numbers and words were among them."""

    def __init__(self) -> None:
        self.values = Gathered()
        self.number = False
        # Something else than numbers and truth values.
        self.other = False
        # Row among those of the file, line and text of the first cell that is no finite number.
        self.first: tuple[int, int, str] | None = None

    @property
    def is_text(self) -> bool:
        """Whether no row has had a number."""
        if self.first is None or self.number:
            return False
        return self.other and self.first[2].strip() != ""


#: Of a column in a block: finite numbers, or text.
_Cells = FloatArray | list[str]


class _Rows:
    """The parse of a file's rows, block by block, of which the first has ``lines`` above it."""

    def __init__(self, file: str, names: Sequence[str], dialect: _Dialect, lines: int) -> None:
        self._file, self._dialect = file, dialect
        self._channels = {name: _Channel() for name in names}
        self._rows, self._lines = 0, lines

    def add(self, block: bytes) -> None:
        """Add a block of rows; refuse a row that has not one cell for each column.

        What is wrong with a cell is kept for `columns`: a row of another length is refused first.
        """
        lines = [block.count(b"\n")]
        columns = self._parsed_at_once(block)
        if columns is None:
            columns, lines = self._split(block)
        for channel, cells in zip(self._channels.values(), columns, strict=True):
            self._add_cells(channel, cells, lines)
        self._rows += len(columns[0])
        self._lines += lines[-1]

    def _parsed_at_once(self, block: bytes) -> list[_Cells] | None:
        """Return the columns: finite numbers, and cells where earlier blocks held anything else.

        None if that cannot be had.
        """
        if not block.strip() or (self._dialect.decimal_comma and b"." in block):
            return None
        if self._dialect.decimal_comma:
            block = block.replace(b",", b".")
        words = [channel.first is not None for channel in self._channels.values()]
        row = np.dtype([(f"{k}", f"U{_WORD}" if word else "f8") for k, word in enumerate(words)])
        parse = partial(np.loadtxt, comments=None, quotechar='"', encoding="utf-8", ndmin=1)
        try:
            table: NDArray[Any] = parse(io.BytesIO(block), row, delimiter=self._dialect.separator)
        except ValueError:
            return None
        columns = [table[name] for name in row.names or ()]
        if not all(map(_whole, columns)):
            return None
        # A copy each, so that what is gathered of one column is let go of by itself.
        return [one.copy() if one.dtype == np.float64 else self._words(one) for one in columns]

    def _words(self, cells: NDArray[np.str_]) -> list[str]:
        """Return cells as they are in the file."""
        words: list[str] = cells.tolist()
        return [cell.replace(".", ",") for cell in words] if self._dialect.decimal_comma else words

    def _split(self, block: bytes) -> tuple[list[_Cells], list[int]]:
        """Return columns of cells, and the line of each row and the last, counted in the block."""
        text = io.TextIOWrapper(io.BytesIO(block), encoding="utf-8", newline="")
        reader = csv.reader(text, delimiter=self._dialect.separator)
        rows: list[list[str]] = []
        lines: list[int] = []
        try:
            for cells in reader:
                if not "".join(cells).strip() and len(cells) <= 1:
                    continue  # a blank line
                rows.append(cells)
                lines.append(reader.line_num)
                if len(cells) != len(self._channels):
                    raise self._other_length(len(rows), lines[-1], len(cells))
        except csv.Error as error:
            raise _unsplittable(self._file, self._lines + reader.line_num, error) from error
        columns = map(list, zip(*rows, strict=True)) if rows else ([] for _ in self._channels)
        return list(columns), [*lines, reader.line_num]

    def _other_length(self, row: int, line: int, cells: int) -> InputError:
        fix = "write one cell for each column"
        if row == 1 and not self._rows:
            fix += ", or remove lines that stand above the column names"
        return InputError(
            f"{self._file}: {_place(self._rows + row, self._lines + line)} has {cells} cells where "
            f"the header names {len(self._channels)} columns; {fix}."
        )

    def _add_cells(self, channel: _Channel, cells: _Cells, lines: Sequence[int]) -> None:
        """Add numbers or cells to a column; truth values become 1 and 0."""
        if isinstance(cells, np.ndarray):
            channel.number = True
            channel.values.add(cells)
            return
        distinct = list(set(cells))
        numbers = dict(zip(distinct, self._dialect.numbers(distinct), strict=True))
        values = np.array([numbers[cell] for cell in cells], dtype=np.float64)
        other = np.flatnonzero(~np.isfinite(values)).tolist()
        channel.number |= len(other) < len(cells)
        if other:
            values[other] = [_TRUTHS.get(cells[row].strip().lower(), np.nan) for row in other]
            channel.other |= bool(np.isnan(values).any())
            if channel.first is None:
                row = other[0]
                channel.first = (self._rows + row + 1, self._lines + lines[row], cells[row])
        channel.values.add(values)

    def text(self) -> dict[str, tuple[str, str]]:
        """Return the columns without a number: place and content of the first cell."""
        return {
            name: (_place(*c.first[:2]), c.first[2])
            for name, c in self._channels.items()
            if c.first and c.is_text
        }

    def columns(self) -> dict[str, Column]:
        """Return the columns, those of text left out; refuse a cell that is not a finite number.

        A column may hold truth values only. The message names the first such cell of the first such
        column.
        """
        numeric = {name: c for name, c in self._channels.items() if not c.is_text}
        for name, channel in numeric.items():
            if channel.first is not None and (channel.other or channel.number):
                row, line, cell = channel.first
                raise cell_error(self._file, _place(row, line), name, cell)
        return {name: channel.values.whole() for name, channel in numeric.items()}


_TRUTHS = {"true": 1.0, "false": 0.0}


def _whole(column: NDArray[Any]) -> bool:
    """Return whether all numbers are finite, or all cells were shorter than they are kept."""
    if column.dtype == np.float64:
        return bool(np.isfinite(column).all())
    return bool(np.char.str_len(column).max() < _WORD)


def _number(cell: str) -> float | None:
    """Return the number that a cell holds; underscores and digits beyond ASCII are Python's."""
    cell = cell.strip()
    try:
        return float(cell) if cell.isascii() and "_" not in cell else None
    except ValueError:
        return None


def _place(row: int, line: int) -> str:
    return f"data row {row} (line {line})"


def _unsplittable(file: str, line: int, error: csv.Error) -> InputError:
    """Make the refusal of a line, counted from 1, that cannot be split into cells."""
    return InputError(
        f"{file}: line {line} cannot be split into cells ({error}); "
        "look there and above for an unclosed quotation mark."
    )
