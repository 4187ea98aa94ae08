"""Tables of numbers in text: CSV, TSV and instrument files with header lines, units and decimal commas.

A file is notes, a line of column names (with units in it or in the next line), then rows of numbers. Notes are lines
such as "twist: 0.26 turn/cm"; a leading "#" is no part of them. The separator (tab, semicolon, comma, spaces) and the
decimal sign are found from the rows.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cgfibre import units
from cgfibre.errors import InputError

FloatArray = npt.NDArray[np.float64]

#: lines in which the first rows must lie
HEAD = 400
#: rows parsed at a time, a power of two so that means of consecutive rows never cross blocks
BLOCK = 2**16
#: (separator, decimal sign), the first of the best taken; "" is any white space
_FORMS = (("\t", "."), ("\t", ","), (";", "."), (";", ","), (",", "."), ("", "."), ("", ","))
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf(inity)?)", re.IGNORECASE)
#: "Force (N)", "Force [N]", "Force / N" or "Force_N"
_WITH_UNIT = re.compile(r"(?P<name>.*?)\s*(?:[(\[]\s*(?P<bracket>[^)\]]*)\s*[)\]]|\s/\s*(?P<slash>\S+))\s*")


@dataclass(frozen=True)
class Table:
    """Columns of numbers: ``source`` for messages, ``names`` (m,) and ``units`` (m,) as written ("" if none),
    ``values`` (n, m), ``notes`` of the lines above (lower case keys, text values)."""

    source: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: FloatArray
    notes: dict[str, str]

    def __len__(self) -> int:
        return len(self.values)

    def find(self, words: Sequence[str]) -> int | None:
        """Index of the first column whose name has one of the words, the first word first; None without one."""
        for word in words:
            for i, name in enumerate(self.names):
                if word.lower() in name.lower():
                    return i
        return None

    def index(self, name: str, key: str) -> int:
        """Index of the column called ``name`` (in any case) or of that number, from 1; InputError names ``key``."""
        lower = [n.lower() for n in self.names]
        if name.strip().lower() in lower:
            return lower.index(name.strip().lower())
        if name.strip().isdigit() and 1 <= int(name) <= len(self.names):
            return int(name) - 1
        raise InputError(key, name, f"a column of {self.source}: {self.listed}, or its number")

    @property
    def listed(self) -> str:
        """The names of the columns, for messages."""
        return ", ".join(repr(n) for n in self.names)

    def quantity(self, column: int, unit: str, default: str) -> FloatArray:
        """(n,) column in the engine unit ``unit``; ``default`` is its unit where the file states none.

        Raises InputError where the file's unit does not measure such a quantity.
        """
        written = self.units[column] or default
        key = f"{self.source}: unit of {self.names[column]!r}"
        if not written:
            raise InputError(key, "(not given)", units.describe(unit) + " in the column's name, as in 'force (N)'")
        try:
            factor = units.parse(f"1 {written}", unit, key)
        except InputError:
            raise InputError(key, written, f"a unit of {units.describe(unit)}") from None
        return self.values[:, column] * factor


def read_table(path: Path, most: int | None = None) -> Table:
    """The table of a text file; InputError (one line) for a file that is missing, empty, binary or no table.

    ``most`` as in :func:`parse_table`.
    """
    try:
        with path.open(encoding="utf-8-sig", errors="replace", newline=None) as lines:
            return parse_table(lines, path.name, most)
    except OSError as error:
        raise InputError("FILE", str(path), f"a file that can be read ({(error.strerror or 'no').lower()})") from None


def parse_table(lines: Iterable[str], source: str, most: int | None = None) -> Table:
    """The table of lines of text; rows stream through, so that memory holds the numbers and no text.

    With ``most``, longer tables are folded while they are read: means of 2, 4, 8 ... consecutive rows, so that at most
    twice as many are held and no more than ``most`` come out.
    Raises InputError: no rows, columns without a name that are not numbered, a row of another length, text or nan among
    the numbers (with its line).
    """
    stream = iter(lines)
    head = list(itertools.islice(stream, HEAD))
    if any("\0" in line for line in head):
        raise InputError(source, "binary", "a text file of columns (CSV, TSV)")
    separator, decimal, first = _form(head, source)
    names, written, notes = _header(head[:first], separator, len(_fields(head[first], separator)))
    rows = _rows(itertools.chain(head[first:], stream), (separator, decimal), source, first + 1, len(names))
    return Table(source, names, written, _folded(rows, most), notes)


def _folded(rows: Iterator[list[float]], most: int | None) -> FloatArray:
    """(n, columns) of all rows, or of means of consecutive ones, the last of fewer."""
    parts: list[FloatArray] = []
    factor, held = 1, 0
    while block := list(itertools.islice(rows, BLOCK)):
        parts.append(_means(np.array(block, dtype=np.float64), factor))
        held += len(parts[-1])
        while most is not None and held > most and factor < BLOCK:
            parts, factor = [_means(np.concatenate(parts), 2)], 2 * factor
            held = len(parts[0])
    return np.concatenate(parts)


def _means(values: FloatArray, factor: int) -> FloatArray:
    if factor == 1:
        return values
    starts = np.arange(0, len(values), factor)
    count = np.diff(np.append(starts, len(values)))
    return np.asarray(np.add.reduceat(values, starts, axis=0) / count[:, None])


def _fields(line: str, separator: str) -> list[str]:
    line = line.strip("\r\n").strip(" ")
    parts = line.split(separator) if separator else line.split()
    parts = [p.strip().strip('"').strip() for p in parts]
    return parts[:-1] if len(parts) > 1 and not parts[-1] else parts  # a separator at the end of the line


def _is_row(line: str, separator: str, decimal: str) -> int:
    """Number of fields of a row of numbers; 0 for any other line. Empty fields count as missing numbers."""
    fields = _fields(line, separator)
    if decimal == ",":
        if any("." in f for f in fields):
            return 0
        fields = [f.replace(",", ".") for f in fields]
    filled = [f for f in fields if f]
    if len(filled) < 1 or not all(_NUMBER.fullmatch(f) for f in filled):
        return 0
    return len(fields)


def _form(head: list[str], source: str) -> tuple[str, str, int]:
    """(separator, decimal sign, first row): the form in which most lines are rows, of the most columns."""
    if not any(line.strip() for line in head):
        raise InputError(source, "empty", "a table of numbers with a line of column names")
    best, answer = (0, 0), None
    for separator, decimal in _FORMS:
        counts = [_is_row(line, separator, decimal) for line in head]
        rows = [k for k, n in enumerate(counts) if n >= 2]
        if rows and (len(rows), counts[rows[0]]) > best:
            best, answer = (len(rows), counts[rows[0]]), (separator, decimal, rows[0])
    if answer is None:
        raise InputError(source, _shown(head), "rows of two numbers or more, between tab, semicolon, comma or space")
    return answer


def _shown(head: list[str]) -> str:
    text = next(line.strip() for line in head if line.strip())
    return text if len(text) <= 40 else text[:37] + "..."


def _header(lines: list[str], separator: str, columns: int) -> tuple[tuple[str, ...], tuple[str, ...], dict[str, str]]:
    """(names, units, notes) of what stands above the rows."""
    lines = [line.lstrip("# ").rstrip() for line in lines]
    rows = [_fields(line, separator) for line in lines]
    if not separator:  # a name and its unit in brackets may be two fields
        joined = [_fields(re.sub(r"\s+([(\[])", r"\1", line), "") for line in lines]
        rows = [one if len(one) == columns else two for one, two in zip(rows, joined, strict=True)]
    named = [k for k, fields in enumerate(rows) if len(fields) == columns and any(fields)]
    noted = lines
    names, written = [f"column {k + 1}" for k in range(columns)], [""] * columns
    if named:
        last = named[-1]
        # a line of units under the line of names
        if len(named) > 1 and named[-2] == last - 1 and all(_unit(f) for f in rows[last] if f):
            names, written = rows[last - 1], [f.strip("()[]") for f in rows[last]]
            noted = lines[: last - 1]
        else:
            names = rows[last]
            noted = lines[:last]
        for k, name in enumerate(names):
            if not written[k]:
                names[k], written[k] = _split_unit(name)
    notes = {}
    for line in noted:
        match = re.match(r"([^:=;\t,]{1,40}?)\s*[:=;\t,]\s*(\S.*)", line)
        if match:
            notes[match[1].strip().strip('"').lower()] = match[2].strip().strip('";,\t ')
    return tuple(names), tuple(written), notes


def _unit(text: str) -> bool:
    return bool(re.fullmatch(r"[(\[]?\s*(-|%|1|°|[A-Za-zµμ]{1,6}([*/·^]?-?[A-Za-zµμ\d]+)*)\s*[)\]]?", text))


def _split_unit(text: str) -> tuple[str, str]:
    match = _WITH_UNIT.fullmatch(text)
    if match and match["name"]:
        return match["name"].strip(), (match["bracket"] or match["slash"] or "").strip()
    name, underscore, unit = text.rpartition("_")
    if underscore and name and re.fullmatch(r"[µμnmcdkMG]?(m|N|Pa|s)", unit.replace("um", "µm")):
        return name, unit
    return text, ""


def _rows(lines: Iterable[str], form: tuple[str, str], source: str, first: int, columns: int) -> Iterator[list[float]]:
    """The rows of numbers; InputError names the first line that is none."""
    separator, decimal = form
    for number, line in enumerate(lines, start=first):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        fields = _fields(line, separator)
        shown = line.strip()[:40]
        if len(fields) != columns:
            raise InputError(f"{source}, line {number}", shown, f"{columns} numbers, as above")
        try:
            row = [float(f.replace(",", ".") if decimal == "," else f) for f in fields]
        except ValueError:
            raise InputError(f"{source}, line {number}", shown, f"{columns} numbers") from None
        if not all(map(math.isfinite, row)):
            raise InputError(f"{source}, line {number}", shown, "finite numbers")
        yield row
