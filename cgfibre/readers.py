"""Tables of numbers in text: CSV, TSV and files of test instruments, read in bounded memory.

A file is notes ("twist: 0.26 turn/cm"; a leading "#" is no part of them), a line of column names with units in it or in
the next line, then rows of numbers. Delimiter (tab, semicolon, comma, spaces), decimal sign, encoding (UTF-8, UTF-16,
Latin-1), names and units are found from the first lines. Rows beyond a limit are folded: means of 2, 4, 8, ...
consecutive ones, so that the memory does not grow with the file.

:func:`read_table` reads all columns and refuses rows that are not whole, :func:`read_record` the columns that a test
needs and leaves some rows out.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from typing import TextIO

import numpy as np
import numpy.typing as npt

from cgfibre import units
from cgfibre.errors import InputError

FloatArray = npt.NDArray[np.float64]

HEAD = 400  # lines looked at for the form, in which the first rows must lie
LONGEST = 10_000  # characters of such a line; more is no table
BLOCK = 100_000  # lines parsed at a time
#: share of rows without numbers beyond which a record is refused
MISSING = 0.1
BLANK = {"", "nan", "na", "n/a", "-", "--", "---"}
#: beside what :mod:`cgfibre.units` knows, in a line of units
UNIT_MARKS = {"", "-", "1", "%", "°C", "C", "V"}
DELIMITERS = ("\t", ";", ",", None)
_BRACKETS = re.compile(r"\s*[\(\[]\s*([^()\[\]]*?)\s*[\)\]]\s*$")
_SUFFIX = re.compile(r"\s*(?:[/,_]\s*|\s)([^\s/,_]+)\s*$")
_NOTE = re.compile(r"([^:=;\t,]{1,40}?)\s*[:=;\t,]\s*(\S.*)")


@dataclass(frozen=True)
class Form:
    """How a text is written: its ``source`` for messages, ``delimiter`` (None: white space), decimal ``comma``,
    ``start`` the first line of numbers, ``headers`` (m,) of the columns as written ("" if none), their ``names`` (m,)
    and ``units`` (m,; "" if none), ``notes`` of the lines above (lower case keys, text values)."""

    source: str
    delimiter: str | None
    comma: bool
    start: int
    headers: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    notes: Mapping[str, str]

    @property
    def listed(self) -> str:
        """The columns, for messages."""
        return ", ".join(repr(h) for h in self.headers) if any(self.headers) else f"{len(self.names)} without names"

    def find(self, words: Sequence[str], letters: Sequence[str] = (), taken: Collection[int] = ()) -> int | None:
        """Index of the first column, none of ``taken``, with a word that begins like one of ``words`` or with one of
        ``letters`` as its whole name; None without one."""
        for i, header in enumerate(self.names):
            name = header.lower().replace("_", " ").strip()
            if i not in taken and (name in letters or any(re.search(rf"\b{re.escape(w)}", name) for w in words)):
                return i
        return None

    def index(self, name: str, key: str) -> int:
        """Index of the column called ``name`` (in any case) or of that number, from 1; InputError names ``key``."""
        name = name.strip()
        for known in (self.headers, self.names):
            lower = [n.lower() for n in known]
            if name and name.lower() in lower:
                return lower.index(name.lower())
        if name.isdigit() and 1 <= int(name) <= len(self.names):
            return int(name) - 1
        raise InputError(key, name, f"a column of {self.source} ({self.listed}) or its number")


@dataclass(frozen=True)
class Table(Form):
    """A text's columns of numbers, ``values`` (n, m)."""

    values: FloatArray

    def __len__(self) -> int:
        return len(self.values)

    def quantity(self, column: int, unit: str, default: str) -> FloatArray:
        """(n,) column in the engine unit ``unit``; ``default`` is its unit where the file states none.

        Raises InputError where the file's unit does not measure such a quantity.
        """
        written = self.units[column] or default
        key = f"{self.source}: unit of {self.names[column]!r}"
        if not written:
            raise InputError(key, "(not given)", units.describe(unit) + " in the column's name, as in 'force (N)'")
        return self.values[:, column] * _factor(written, unit, key, f"a unit of {units.describe(unit)}")


@dataclass(frozen=True)
class Wanted:
    """A column to read: ``name``, the ``unit`` to give it in, ``words`` by which headers know it.

    Attributes: ``letters`` whole names of a column that mean it, such as "t"; ``required``: refuse a file without it.
    """

    name: str
    unit: str
    words: tuple[str, ...]
    letters: tuple[str, ...] = ()
    required: bool = True


@dataclass(frozen=True)
class Record:
    """Columns of a file in the units asked for, how many rows there were, and what was done to them.

    ``folded`` consecutive rows are one sample; ``missing`` rows had no number where one was needed; ``notes`` say in
    words what was assumed.
    """

    columns: Mapping[str, FloatArray]
    rows: int
    folded: int
    missing: int
    notes: tuple[str, ...]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))


def read_table(path: Path, most: int | None = None) -> Table:
    """The table of a text file; InputError (one line) for a file that is missing, empty, binary or no table.

    ``most`` as in :func:`parse_table`.
    """
    with _opened(path) as f:
        return parse_table(_lines(f, path.name), path.name, most)


def parse_table(lines: Iterable[str], source: str, most: int | None = None) -> Table:
    """The table of lines of text, of two columns or more; memory holds the numbers and a block of text.

    With ``most``, longer tables are folded while they are read, so that no more than ``most`` samples come out.
    Raises InputError: no rows, a row of another length, text or nan among the numbers (with its line).
    """
    form, lines = _form(lines, source)
    if len(form.names) < 2:
        raise InputError(source, "1 column", "two columns or more, between tab, semicolon, comma or space")
    rows = _Rows(form, tuple(range(len(form.names))), whole=True)
    return Table(**vars(form), values=rows.read_all(lines, most).done())


def read_record(
    path: Path,
    wanted: Sequence[Wanted],
    columns: Sequence[str] = (),
    given_units: Sequence[str] = (),
    rising: str = "",
    limit: int = 2**18,
) -> Record:
    """The wanted columns of a text file.

    ``columns`` name them in the order of ``wanted`` (name in the header, or number from 1); without, they are known by
    their words. ``given_units`` overrule the header's; where neither tells, the units of ``wanted`` are assumed and
    noted. ``rising`` names a column that must not go back. No more than ``limit`` samples come out.
    Raises InputError, in one line, for a file that cannot be read, is empty or binary, lacks a column, knows another
    unit, goes back in time or has too many rows without numbers.
    """
    with _opened(path) as f:
        form, lines = _form(_lines(f, path.name), path.name)
        chosen = _choose(form, wanted, columns)
        factors, notes = _factors(form, chosen, given_units)
        rows = _Rows(form, tuple(chosen.values()), rising=rising)
        rows.at = next((i for i, w in enumerate(chosen) if w.name == rising), -1)
        fold = rows.read_all(lines, limit)
    if rows.missing:
        notes.append(f"{rows.missing} of {rows.rows} rows left out ({rows.first_missing})")
    if fold.factor > 1:
        notes.append(f"{fold.factor} consecutive rows averaged into one sample")
    table = fold.done()
    found = {w.name: table[:, i] * factors[i] for i, w in enumerate(chosen)}
    return Record(found, rows.rows, fold.factor, rows.missing, tuple(notes))


# --- text ------------------------------------------------------------------------------------------------------------


def _opened(path: Path) -> TextIO:
    try:
        with path.open("rb") as f:
            start = f.read(1 << 16)
    except OSError as error:
        raise InputError("FILE", str(path), f"a file that can be read ({(error.strerror or '').lower()})") from None
    if start[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return path.open(encoding="utf-16")
    if b"\0" in start:
        raise InputError(path.name, "binary", "a text file of columns")
    try:
        codecs.getincrementaldecoder("utf-8")().decode(start)
    except UnicodeDecodeError:
        return path.open(encoding="latin-1")
    return path.open(encoding="utf-8-sig", errors="replace")


def _lines(f: TextIO, source: str) -> Iterator[str]:
    """Lines of text; a line without end is no table and must not fill the memory."""
    while True:
        try:
            line = f.readline(1 << 20)
        except UnicodeError:
            raise InputError(source, "binary", "a text file of columns") from None
        if not line:
            return
        if len(line) >= 1 << 20:
            raise InputError(source, line[:20] + "...", "a table of rows (a line is a million characters long)")
        yield line


def _split(line: str, delimiter: str | None) -> list[str]:
    line = line.strip("\r\n")
    if delimiter is None:
        return [c.strip('"') for c in line.split()]
    try:
        cells = [c.strip() for c in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:  # a field longer than csv takes
        return []
    if len(cells) > 1 and not cells[-1]:  # a delimiter at the end of every line
        cells.pop()
    return cells


def _number(text: str, comma: bool) -> float | None:
    """The number of a cell, nan for a blank, None for other text."""
    if text.lower() in BLANK:
        return np.nan
    if "_" in text or (comma and "." in text):  # 1_000 is a number to Python
        return None
    try:
        return float(text.replace(",", ".") if comma else text)
    except ValueError:
        return None


def _width(line: str, delimiter: str | None, comma: bool) -> int:
    """Number of cells of a line of numbers; 0 for any other line."""
    numbers = [_number(c, comma) for c in _split(line, delimiter)]
    return len(numbers) if None not in numbers and any(n == n for n in numbers) else 0


# --- form ------------------------------------------------------------------------------------------------------------


def _form(lines: Iterable[str], source: str) -> tuple[Form, Iterator[str]]:
    """The form in which the first lines hold the most numbers, in several columns if possible; lines from the first
    row on."""
    rest = iter(lines)
    head = [line[:LONGEST] for line in islice(rest, HEAD)]
    first = next((line.strip() for line in head if line.strip()), "")
    if not first:
        raise InputError(source, "empty", "a table of numbers below its header")
    best, form = (False, 0), None
    for delimiter in DELIMITERS:
        for comma in (False, True) if delimiter != "," else (False,):
            widths = [_width(line, delimiter, comma) for line in head]
            start, rows = _table_start(widths)
            if (score := (widths[start] > 1, rows * widths[start])) > best:
                best, form = score, (delimiter, comma, start, widths[start])
    if form is None:
        shown = first if len(first) <= 40 else first[:37] + "..."
        raise InputError(source, shown, "a table of numbers below its header")
    delimiter, comma, start, count = form
    return Form(source, delimiter, comma, start, *_header(head[:start], delimiter, count)), chain(head[start:], rest)


def _table_start(widths: Sequence[int]) -> tuple[int, int]:
    """First line of the table and how many lines of its width there are.

    The width is that of the longest run of lines of numbers; the table begins at the first line of that width from
    which on three in four are (a gap in the table is none, a number in the header no beginning).
    """
    start = length = best_start = best = 0
    for i, w in enumerate(widths):
        start, length = (start, length + 1) if length and w == widths[i - 1] and w else (i, int(w > 0))
        if length > best:
            best_start, best = start, length
    same = [w == widths[best_start] for w in widths]
    for i in range(best_start):
        if same[i] and 4 * sum(same[i:]) >= 3 * (len(widths) - i):
            return i, sum(same[i:])
    return best_start, sum(same[best_start:])


def _header(
    lines: Sequence[str], delimiter: str | None, count: int
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...], dict[str, str]]:
    """(headers, names, units, notes) of the lines above the rows."""
    lines = [bare for line in lines if (bare := line.strip().lstrip("#%").strip())]
    cells = [_cells(line, delimiter, count) for line in lines]
    named = [i for i, c in enumerate(cells) if any(c)]
    headers, unit_row = [""] * count, [""] * count
    if named:
        last = named[-1]
        if named[-2:-1] == [last - 1] and all(
            c in UNIT_MARKS or _BRACKETS.fullmatch(c) or _known(c) for c in cells[last]
        ):
            unit_row = [m[1] if (m := _BRACKETS.fullmatch(c)) else c for c in cells[last]]
            last -= 1
        headers, lines = cells[last], lines[:last]
    split = [_split_unit(h) for h in headers]
    names = tuple(name or f"column {i}" for i, (name, _) in enumerate(split, start=1))
    written = tuple(row or unit for row, (_, unit) in zip(unit_row, split, strict=True))
    notes = {m[1].strip('" ').lower(): m[2].strip('";,\t ') for line in lines if (m := _NOTE.match(line))}
    return tuple(headers), names, written, notes


def _cells(line: str, delimiter: str | None, count: int) -> list[str]:
    """The cells of a line above the rows if it has as many; names of several words may stand between spaces."""
    ways = [_split(line, delimiter)]
    if delimiter is None:
        ways += [[c for c in re.split(p, line) if c] for p in (r"\s{2,}|\t", r"(?<=[\)\]])\s+")]
    return next((cells for cells in ways if len(cells) == count), [])


def _known(unit: str) -> bool:
    return any(_ratio(unit, kind) for kind in units.KINDS)


def _ratio(unit: str, target: str) -> float | None:
    try:
        return units.parse(f"1 {unit}", target, "")
    except InputError:
        return None


def _split_unit(header: str) -> tuple[str, str]:
    """(name, unit) of "Force (N)", "Force [N]", "Force / N", "Force_N" or "Force N"."""
    if (m := _BRACKETS.search(header)) and m.start():
        return header[: m.start()].strip(), m[1]
    if (m := _SUFFIX.search(header)) and m.start() and _known(m[1]):
        return header[: m.start()].strip(), m[1]
    return header, ""


def _factor(written: str, unit: str, key: str, expected: str) -> float:
    """Size of the unit ``written`` in ``unit``; InputError if it has none."""
    ratio = _ratio(written, unit)
    if ratio is None:
        raise InputError(key, written, expected)
    return ratio


# --- which columns ---------------------------------------------------------------------------------------------------


def _choose(form: Form, wanted: Sequence[Wanted], columns: Sequence[str]) -> dict[Wanted, int]:
    """Column number of each wanted column that is there, in the order of ``wanted``."""
    needed, count = [w for w in wanted if w.required], len(form.names)
    if count < len(needed):
        raise InputError(form.source, f"{count} column(s)", "columns of " + " and ".join(w.name for w in needed))
    if columns:
        if len(columns) == len(needed):
            wanted = needed
        if len(columns) != len(wanted):
            raise InputError("--columns", ",".join(columns), f"{len(wanted)} names: {','.join(w.name for w in wanted)}")
        return {w: form.index(c, "--columns") for w, c in zip(wanted, columns, strict=True)}
    if not any(form.headers):
        for several in (needed, wanted):
            if count == len(several):
                return {w: i for i, w in enumerate(several)}
        raise InputError(form.source, form.listed, f"--columns with {len(wanted)} numbers, such as 1,2,3")
    found: dict[Wanted, int] = {}
    for w in wanted:
        i = form.find(w.words, w.letters, found.values())
        if i is not None:
            found[w] = i
        elif w.required:
            raise InputError(form.source, form.listed, f"a column of the {w.name}; name it with --columns")
    return found


def _factors(form: Form, chosen: Mapping[Wanted, int], given: Sequence[str]) -> tuple[list[float], list[str]]:
    """What turns each column into the unit asked for, and what was assumed."""
    if given and len(given) != len(chosen):
        raise InputError("--units", ",".join(given), f"{len(chosen)} units: {','.join(w.name for w in chosen)}")
    factors, assumed = [], []
    for k, (w, i) in enumerate(chosen.items()):
        written = given[k].strip() if given else form.units[i]
        if not written:
            assumed.append(f"{w.name} in {w.unit}")
        key = "--units" if given else f"{form.source}: unit of {form.names[i]!r}"
        expected = f"a unit of {w.name} such as {w.unit} (--units overrules the file)"
        factors.append(_factor(written or w.unit, w.unit, key, expected))
    return factors, [f"no unit in the header: {', '.join(assumed)} assumed"] if assumed else []


# --- rows ------------------------------------------------------------------------------------------------------------


@dataclass
class _Rows:
    """Rows of numbers from blocks of lines, in turn; counts what it left out.

    ``columns`` are read; ``whole``: rows must have the columns of the form, and none may be left out; column ``at``,
    called ``rising``, must not fall (-1: none).
    """

    form: Form
    columns: tuple[int, ...]
    whole: bool = False
    rising: str = ""
    at: int = -1
    rows: int = 0
    missing: int = 0
    first_missing: str = ""
    last: float = -np.inf

    def read_all(self, lines: Iterator[str], limit: int | None) -> _Fold:
        """All rows, folded to ``limit``; InputError where there are none, or too many without numbers."""
        fold, line = _Fold(len(self.columns), limit), self.form.start
        while block := list(islice(lines, BLOCK)):
            fold.add(self._read(block, line))
            line += len(block)
        if self.missing > (0 if self.whole else max(3, MISSING * self.rows)):
            found = f"{self.missing} of {self.rows} rows without numbers"
            raise InputError(self.form.source, found, f"{len(self.form.names)} finite numbers: {self.first_missing}")
        if self.rows == self.missing:
            raise InputError(self.form.source, "no row of numbers", "a table of numbers below its header")
        return fold

    def _read(self, block: list[str], line: int) -> FloatArray:
        """(n, columns) numbers of the lines after line number ``line``, without rows that lack one."""
        numbers = line + 1 + np.arange(len(block))
        table = self._fast(block)
        if table is None or len(table) != len(block):
            kept = [k for k, text in enumerate(block) if text.strip() and not text.lstrip().startswith("#")]
            numbers = numbers[kept]
            table = np.array([self._slow(block[k]) for k in kept]).reshape(-1, len(self.columns))
        good = np.isfinite(table).all(axis=1)
        if not good.all() and not self.missing:
            n = int(numbers[np.argmin(good)])
            self.first_missing = f"line {n} reads {block[n - line - 1].strip()[:60]!r}"
        self.missing += int(np.sum(~good))
        self.rows += len(table)
        table, numbers = table[good], numbers[good]
        if self.at >= 0 and len(table):
            values = np.concatenate([[self.last], table[:, self.at]])
            back = np.flatnonzero(np.diff(values) < 0)
            if len(back):
                k = int(back[0])
                found = f"{values[k + 1]:.6g} after {values[k]:.6g} in line {numbers[k]}"
                raise InputError(self.form.source, found, f"{self.rising} that does not go back")
            self.last = float(values[-1])
        return table

    def _fast(self, block: list[str]) -> FloatArray | None:
        """The whole block by numpy's reader; None where a line is out of the ordinary."""
        form = self.form
        lines = [line.replace(",", ".") for line in block] if form.comma else block
        if not any(line.strip() for line in lines):
            return np.empty((0, len(self.columns)))
        columns = None if self.whole else self.columns  # without, numpy wants rows of one length
        try:
            table = np.loadtxt(lines, delimiter=form.delimiter, usecols=columns, ndmin=2, comments=None, quotechar='"')
        except (ValueError, IndexError):
            return None
        return table if table.shape[1] == len(self.columns) else None

    def _slow(self, line: str) -> list[float]:
        cells = _split(line, self.form.delimiter)
        if self.whole and len(cells) != len(self.columns):
            return [np.nan] * len(self.columns)
        numbers = [_number(cells[i], self.form.comma) if i < len(cells) else None for i in self.columns]
        return [np.nan if n is None else n for n in numbers]


@dataclass
class _Fold:
    """Rows of ``width`` numbers up to a limit (None: all); beyond it, means of ``factor`` consecutive ones."""

    width: int
    limit: int | None
    factor: int = 1
    held: int = 0
    parts: list[FloatArray] = field(default_factory=list)
    #: fewer rows than make a sample
    rest: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.rest = np.empty((0, self.width))

    def add(self, rows: FloatArray) -> None:
        """Take rows in."""
        rows = np.concatenate([self.rest, rows])
        while True:
            samples = len(rows) // self.factor
            self.parts.append(self._means(rows[: samples * self.factor], self.factor))
            self.rest = rows[samples * self.factor :].copy()
            self.held += samples
            if self.limit is None or self.held < self.limit:
                return
            table = np.concatenate(self.parts)
            odd = np.repeat(table[self.held - self.held % 2 :], self.factor, axis=0)
            self.parts = [self._means(table[: self.held - len(table) % 2], 2)]
            self.held, self.factor = len(self.parts[0]), 2 * self.factor
            rows = np.concatenate([odd, self.rest])

    def _means(self, rows: FloatArray, n: int) -> FloatArray:
        return rows if n == 1 else np.asarray(rows.reshape(-1, n, self.width).mean(axis=1))

    def done(self) -> FloatArray:
        """All that was taken in, the last rows too where they are at least half a sample."""
        last = [self.rest.mean(axis=0, keepdims=True)] if len(self.rest) and 2 * len(self.rest) >= self.factor else []
        return np.concatenate([*self.parts, *last])
