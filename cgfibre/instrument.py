"""Text files of test instruments: columns of numbers below header lines, read in bounded memory.

Delimiter (tab, semicolon, comma, spaces), decimal mark (point, comma), encoding (UTF-8, UTF-16, Latin-1), header lines
and the units in them are found from the first lines. Rows beyond a limit are folded: means of 2, 4, 8, ... consecutive
ones, so that the memory does not grow with the file.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from typing import TextIO

import numpy as np
import numpy.typing as npt

from cgfibre import units
from cgfibre.errors import InputError

FloatArray = npt.NDArray[np.float64]

SNIFFED = 400  # lines looked at for the layout
LONGEST = 10_000  # characters of a line of text; more is no table
BLOCK = 100_000  # lines parsed at a time
#: share of rows without numbers beyond which the file is refused
MISSING = 0.1
BLANK = {"", "nan", "na", "n/a", "-", "--", "---"}
DELIMITERS = ("\t", ";", ",", None)


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


@dataclass(frozen=True)
class _Layout:
    """How the file is written: delimiter, decimal mark, first line of data, names and units of the columns."""

    delimiter: str | None
    comma: bool
    start: int
    count: int
    names: tuple[str, ...]
    units: tuple[str, ...]


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
    noted. ``rising`` names a column that must not go back.
    Raises InputError, in one line, for a file that cannot be read, is empty or binary, lacks a column, knows another
    unit, goes back in time or has too many rows without numbers.
    """
    with _opened(path) as f:
        head = [line[:LONGEST] for line in islice(_lines(f, path), SNIFFED)]
        layout = _sniff(path, head)
        chosen = _choose(path, layout, wanted, columns)
        factors, notes = _factors(path, layout, chosen, given_units)
        fold = _Fold(len(chosen), limit)
        reader = _Rows(path, layout, tuple(chosen.values()), rising)
        at = next((i for i, w in enumerate(chosen) if w.name == rising), -1)
        lines = chain(head[layout.start :], _lines(f, path))
        while block := list(islice(lines, BLOCK)):
            fold.add(reader.read(block, at))
    table = fold.done()
    if reader.missing > max(3, MISSING * reader.rows):
        raise InputError(
            str(path), f"{reader.missing} of {reader.rows} rows without numbers", f"numbers: {reader.first_missing}"
        )
    if len(table) == 0:
        raise InputError(str(path), "no row of numbers", "a table of numbers below its header")
    if reader.missing:
        notes.append(f"{reader.missing} of {reader.rows} rows left out ({reader.first_missing})")
    if fold.factor > 1:
        notes.append(f"{fold.factor} consecutive rows averaged into one sample")
    return Record(
        {w.name: table[:, i] * factors[i] for i, w in enumerate(chosen)},
        reader.rows,
        fold.factor,
        reader.missing,
        tuple(notes),
    )


# --- text ------------------------------------------------------------------------------------------------------------


def _opened(path: Path) -> TextIO:
    try:
        with path.open("rb") as f:
            start = f.read(1 << 16)
    except OSError as error:
        raise InputError("FILE", str(path), f"a file that can be read ({(error.strerror or '').lower()})") from None
    if not start.strip():
        raise InputError("FILE", str(path), "a table of numbers (the file is empty)")
    if start[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return path.open(encoding="utf-16", newline=None)
    if b"\0" in start:
        raise InputError("FILE", str(path), "a text file (this one is binary)")
    try:
        codecs.getincrementaldecoder("utf-8")().decode(start)
    except UnicodeDecodeError:
        return path.open(encoding="latin-1")
    return path.open(encoding="utf-8-sig", errors="replace")


def _lines(f: TextIO, path: Path) -> Iterator[str]:
    """Lines of text; a line without end is no table and must not fill the memory."""
    while True:
        try:
            line = f.readline(1 << 20)
        except UnicodeError:
            raise InputError("FILE", str(path), "a text file") from None
        if not line:
            return
        if len(line) >= 1 << 20:
            raise InputError("FILE", str(path), "a table of rows (a line is a million characters long)")
        yield line


def _split(line: str, delimiter: str | None) -> list[str]:
    line = line.strip("\r\n")
    if delimiter is None:
        return line.split()
    cells = [c.strip() for c in next(csv.reader([line], delimiter=delimiter), [])]
    if cells and not cells[-1]:  # a delimiter at the end of every line
        cells.pop()
    return cells


def _number(text: str, comma: bool) -> float | None:
    """The number of a cell, nan for a blank, None for other text."""
    text = text.strip()
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
    cells = _split(line, delimiter)
    numbers = [_number(c, comma) for c in cells]
    return len(cells) if cells and None not in numbers and any(n == n for n in numbers if n is not None) else 0


def _sniff(path: Path, head: Sequence[str]) -> _Layout:
    best: tuple[tuple[int, int], tuple[str | None, bool, int, int]] | None = None
    for delimiter in DELIMITERS:
        for comma in (False, True) if delimiter != "," else (False,):
            widths = [_width(line, delimiter, comma) for line in head]
            start, length = _table_start(widths)
            if length and (best is None or (widths[start] > 1, length * widths[start]) > best[0]):
                best = (widths[start] > 1, length * widths[start]), (delimiter, comma, start, widths[start])
    if best is None:
        raise InputError("FILE", str(path), "a table of numbers (none was found in its first lines)")
    delimiter, comma, start, count = best[1]
    names, unit_row = _header(head[:start], delimiter, count)
    return _Layout(delimiter, comma, start, count, names, unit_row)


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
    return best_start, best


_BRACKETS = re.compile(r"\s*[\(\[]\s*([^()\[\]]*?)\s*[\)\]]\s*$")
_SUFFIX = re.compile(r"\s*(?:[/,_]\s*|\s)([^\s/,_]+)\s*$")


def _header(lines: Sequence[str], delimiter: str | None, count: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of the columns from the lines above them; empty where there are none."""
    last = [line for line in lines if line.strip()][-2:]
    none = ("",) * count
    if not last:
        return none, none
    cells = [_cells(line, delimiter, count) for line in last]
    if len(cells) == 2 and cells[0] and cells[1] and all(_looks_like_unit(c) for c in cells[1]):
        row = tuple(m[1] if (m := _BRACKETS.fullmatch(c)) else c for c in cells[1])
        return tuple(cells[0]), row
    if not cells[-1]:
        return none, none
    return tuple(cells[-1]), none


def _cells(line: str, delimiter: str | None, count: int) -> list[str]:
    line = line.strip().lstrip("#%").strip()
    cells = _split(line, delimiter)
    if len(cells) != count and delimiter is None:
        for pattern in (r"\s{2,}|\t", r"(?<=[\)\]])\s+"):
            cells = [c for c in re.split(pattern, line) if c]
            if len(cells) == count:
                break
    return cells if len(cells) == count else []


def _looks_like_unit(cell: str) -> bool:
    return bool(_BRACKETS.fullmatch(cell)) or (len(cell) <= 6 and _known(cell))


def _known(unit: str) -> bool:
    for target in ("s", "m", "N"):
        try:
            units.parse(f"1 {unit}", target, "")
        except InputError:
            continue
        return True
    return not unit


# --- which columns ---------------------------------------------------------------------------------------------------


def _bare(name: str) -> str:
    """A header without its unit."""
    bare = _BRACKETS.sub("", name).strip().strip('"')
    m = _SUFFIX.search(bare)
    return bare[: m.start()] if m and _known(m[1]) and m.start() else bare


def _choose(path: Path, layout: _Layout, wanted: Sequence[Wanted], columns: Sequence[str]) -> dict[Wanted, int]:
    """Column number of each wanted column that is there, in the order of ``wanted``."""
    needed = [w for w in wanted if w.required]
    if layout.count < len(needed):
        raise InputError(str(path), f"{layout.count} column(s)", "columns of " + " and ".join(w.name for w in needed))
    if columns:
        if len(columns) == len(needed) < len(wanted):
            wanted = needed
        if len(columns) != len(wanted):
            raise InputError("--columns", ",".join(columns), f"{len(wanted)} names: {','.join(w.name for w in wanted)}")
        return {w: _named(layout, c) for w, c in zip(wanted, columns, strict=True)}
    if not any(layout.names):
        if layout.count == len(needed):
            return {w: i for i, w in enumerate(needed)}
        if layout.count == len(wanted):
            return {w: i for i, w in enumerate(wanted)}
        raise InputError(
            str(path), f"{layout.count} columns without names", f"--columns with {len(wanted)} numbers, such as 1,2,3"
        )
    found: dict[Wanted, int] = {}
    for w in wanted:
        for i, name in enumerate(layout.names):
            if i not in found.values() and _means(name, w):
                found[w] = i
                break
        else:
            if w.required:
                named = ", ".join(repr(n) for n in layout.names)
                raise InputError(str(path), f"columns {named}", f"a column of the {w.name}; name it with --columns")
    return found


def _means(name: str, wanted: Wanted) -> bool:
    bare = _bare(name).lower().replace("_", " ").strip()
    return bare in wanted.letters or any(re.search(rf"\b{re.escape(word)}", bare) for word in wanted.words)


def _named(layout: _Layout, column: str) -> int:
    column = column.strip()
    lowered = [n.lower() for n in layout.names]
    bare = [_bare(n).lower() for n in layout.names]
    for names in (lowered, bare):
        if column and column.lower() in names:
            return names.index(column.lower())
    if column.isdigit() and 1 <= int(column) <= layout.count:
        return int(column) - 1
    starts = [i for i, n in enumerate(lowered) if column and n.startswith(column.lower())]
    if len(starts) == 1:
        return starts[0]
    named = ", ".join(repr(n) for n in layout.names if n) or "without names"
    raise InputError("--columns", column, f"a column of the file ({named}) or its number, 1 to {layout.count}")


def _factors(
    path: Path, layout: _Layout, chosen: Mapping[Wanted, int], given: Sequence[str]
) -> tuple[list[float], list[str]]:
    """What turns each column into the unit asked for, and what was assumed."""
    if given and len(given) != len(chosen):
        raise InputError("--units", ",".join(given), f"{len(chosen)} units: {','.join(w.name for w in chosen)}")
    factors, assumed = [], []
    for k, (w, i) in enumerate(chosen.items()):
        unit = given[k].strip() if given else _unit_of(layout, i, w)
        if not unit:
            factors.append(1.0)
            assumed.append(f"{w.name} in {w.unit}")
            continue
        try:
            factors.append(units.parse(f"1 {unit}", w.unit, ""))
        except InputError:
            key = "--units" if given else f"{path}, column {layout.names[i] or i + 1}"
            raise InputError(key, unit, f"a unit of {w.name} such as {w.unit} (--units overrules the file)") from None
    return factors, [f"no unit in the header: {', '.join(assumed)} assumed"] if assumed else []


def _unit_of(layout: _Layout, i: int, wanted: Wanted) -> str:
    """The unit that the header states for a column; empty: none."""
    if layout.units[i]:
        return layout.units[i]
    m = _BRACKETS.search(layout.names[i])
    if m:
        return m[1]
    m = _SUFFIX.search(layout.names[i])
    if m:
        try:
            units.parse(f"1 {m[1]}", wanted.unit, "")
        except InputError:
            return ""
        return m[1]
    return ""


# --- rows ------------------------------------------------------------------------------------------------------------


@dataclass
class _Rows:
    """Rows of numbers from blocks of lines, in turn; counts what it left out."""

    path: Path
    layout: _Layout
    columns: tuple[int, ...]
    rising: str
    rows: int = 0
    missing: int = 0
    first_missing: str = ""
    line: int = 0
    last: float = -np.inf

    def __post_init__(self) -> None:
        self.line = self.layout.start

    def read(self, block: list[str], at: int) -> FloatArray:
        """Numbers of the wanted columns, (n, columns), without rows that lack one; column ``at`` must not fall."""
        numbers = self.line + 1 + np.arange(len(block))
        table = self._fast(block)
        if table is None or len(table) != len(block):
            kept = [(n, line) for n, line in zip(numbers, block, strict=True) if line.strip()]
            numbers = np.array([n for n, _ in kept], dtype=np.int64)
            table = np.array([self._slow(line) for _, line in kept]).reshape(-1, len(self.columns))
        good = np.isfinite(table).all(axis=1)
        if not good.all():
            if not self.missing:
                k = int(np.argmin(good))
                text = block[int(numbers[k]) - self.line - 1].strip()[:60]
                self.first_missing = f"line {numbers[k]} reads {text!r}"
            self.missing += int(np.sum(~good))
        self.rows += len(table)
        table, numbers = table[good], numbers[good]
        if at >= 0 and len(table):
            values = np.concatenate([[self.last], table[:, at]])
            back = np.flatnonzero(np.diff(values) < 0)
            if len(back):
                k = int(back[0])
                found = f"{values[k + 1]:.6g} after {values[k]:.6g} in line {numbers[k]}"
                raise InputError(str(self.path), found, f"{self.rising} that does not go back")
            self.last = float(values[-1])
        self.line += len(block)
        return table

    def _fast(self, block: list[str]) -> FloatArray | None:
        """The whole block by numpy's reader; None where a line is out of the ordinary."""
        layout = self.layout
        lines = [line.replace(",", ".") for line in block] if layout.comma else block
        if not any(line.strip() for line in lines):
            return np.empty((0, len(self.columns)))
        try:
            return np.loadtxt(
                lines, delimiter=layout.delimiter, usecols=self.columns, ndmin=2, comments=None, quotechar='"'
            )
        except (ValueError, IndexError):
            return None

    def _slow(self, line: str) -> list[float]:
        cells = _split(line, self.layout.delimiter)
        values = []
        for i in self.columns:
            number = _number(cells[i], self.layout.comma) if i < len(cells) else None
            values.append(np.nan if number is None else number)
        return values


@dataclass
class _Fold:
    """Rows up to a limit; beyond it, means of ``factor`` consecutive ones."""

    width: int
    limit: int
    factor: int = 1
    used: int = 0
    buffer: FloatArray = field(init=False)
    rest: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.buffer = np.empty((self.limit, self.width))
        self.rest = np.empty((0, self.width))

    def add(self, rows: FloatArray) -> None:
        """Take rows in."""
        rows = np.concatenate([self.rest, rows]) if len(self.rest) else rows
        while len(rows) >= self.factor:
            whole = min(len(rows) // self.factor, self.limit - self.used)
            taken = rows[: whole * self.factor].reshape(whole, self.factor, self.width)
            self.buffer[self.used : self.used + whole] = taken.mean(axis=1)
            self.used += whole
            rows = rows[whole * self.factor :]
            if self.used == self.limit:
                half = self.limit // 2
                self.buffer[:half] = self.buffer[: 2 * half].reshape(half, 2, self.width).mean(axis=1)
                self.used, self.factor = half, 2 * self.factor
        self.rest = rows.copy()

    def done(self) -> FloatArray:
        """All that was taken in, the last rows too where they are at least half a sample."""
        if 2 * len(self.rest) >= self.factor and len(self.rest):
            return np.concatenate([self.buffer[: self.used], self.rest.mean(axis=0, keepdims=True)])
        return self.buffer[: self.used].copy()
