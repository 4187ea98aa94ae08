"""Write a LAMMPS data file from plain arrays; only here do zero-based indices become one-based."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np

from cgfibre.build.system import FloatArray, IntArray

CHUNK = 100_000  # rows formatted at a time: bounds the memory of a large assembly


@dataclass(frozen=True)
class Topology:
    """One kind of bonded interaction: ``members`` (n, 2..4) zero-based beads, ``kind`` (n,) zero-based types,
    ``coefficients`` one tuple a type, ``style`` the LAMMPS style in the section's title."""

    name: str
    members: IntArray
    kind: IntArray
    coefficients: Sequence[tuple[float, ...]]
    style: str


@dataclass(frozen=True)
class DataFile:
    """Content of a data file: the atom columns after ``id``, topologies, pair coefficients, start displacements.

    ``atom_columns`` each (n_atoms,); ``atom_format`` one %-format a column; ``pair_rows`` (i, j zero-based, words).
    ``start``, ``rest``, ``natural`` (n_atoms, 3) and ``turn`` (n_atoms, 4) or None: written as the sections ``Start``,
    ``Rest``, ``Natural`` and ``Turn`` for fix property/atom.
    """

    title: str
    atom_style: str
    atom_columns: Sequence[np.ndarray]
    atom_format: Sequence[str]
    n_types: int
    box: FloatArray
    pair_style: str
    pair_rows: Sequence[tuple[int, int, str]]
    topologies: Sequence[Topology] = field(default_factory=tuple)
    start: FloatArray | None = None
    rest: FloatArray | None = None
    natural: FloatArray | None = None
    turn: FloatArray | None = None


def _rows(f: IO[str], columns: Sequence[np.ndarray], formats: Sequence[str]) -> None:
    line = " ".join(formats) + "\n"
    n = len(columns[0])
    for a in range(0, n, CHUNK):
        block = [c[a : a + CHUNK].tolist() for c in columns]
        f.writelines(line % row for row in zip(*block, strict=True))


def _lines(f: IO[str], title: str, lines: Iterable[str]) -> None:
    f.write(f"\n{title}\n\n")
    f.writelines(line + "\n" for line in lines)


def write_data(path: Path, data: DataFile) -> None:
    """Write ``data`` with 17 significant digits, so that reading it back gives the same numbers."""
    n = len(data.atom_columns[0])
    with path.open("w") as f:
        f.write(f"LAMMPS data file: {data.title}\n\n{n} atoms\n{data.n_types} atom types\n")
        for t in data.topologies:
            f.write(f"{len(t.members)} {t.name.lower()}s\n{len(t.coefficients)} {t.name.lower()} types\n")
        f.write("\n")
        for (lo, hi), axis in zip(data.box.tolist(), "xyz", strict=True):
            f.write(f"{lo:.17g} {hi:.17g} {axis}lo {axis}hi\n")
        _lines(f, "Masses", (f"{i + 1} 1" for i in range(data.n_types)))  # unused: every bead has its own mass
        if data.pair_rows:
            rows = (f"{i + 1} {j + 1} {words}" for i, j, words in data.pair_rows)
            _lines(f, f"PairIJ Coeffs # {data.pair_style}", rows)
        for t in data.topologies:
            if t.style:
                _lines(
                    f,
                    f"{t.name} Coeffs # {t.style}",
                    (f"{i + 1} " + " ".join(f"{c:.17g}" for c in row) for i, row in enumerate(t.coefficients)),
                )
        f.write(f"\nAtoms # {data.atom_style}\n\n")
        ids = np.arange(1, n + 1)
        _rows(f, [ids, *data.atom_columns], ["%d", *data.atom_format])
        for t in data.topologies:
            if not len(t.members):
                continue
            f.write(f"\n{t.name}s\n\n")
            members = [t.members[:, k] + 1 for k in range(t.members.shape[1])]
            _rows(f, [np.arange(1, len(t.members) + 1), t.kind + 1, *members], ["%d"] * (2 + len(members)))
        for name in ("Start", "Rest", "Natural", "Turn"):
            vectors = getattr(data, name.lower())
            if vectors is not None:
                f.write(f"\n{name}\n\n")
                _rows(f, [ids, *vectors.T], ["%d", *["%.17g"] * vectors.shape[1]])


def group_types(*keys: FloatArray, digits: int = 10) -> tuple[IntArray, IntArray]:
    """Give equal rows of ``keys`` (each (n,)) one type: (kind (n,), first row of each type (n_types,)).

    Rows are equal when they agree in ``digits`` significant digits, so round-off does not multiply the types.
    """
    table = np.column_stack(keys) if keys else np.empty((0, 0))
    if len(table) == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    with np.errstate(divide="ignore"):
        scale = 10.0 ** (digits - 1 - np.floor(np.log10(np.abs(table))))
    scale[~np.isfinite(scale)] = 1.0
    _, first, kind = np.unique(np.round(table * scale) / scale, axis=0, return_index=True, return_inverse=True)
    return kind.reshape(-1).astype(np.int64), first.astype(np.int64)
