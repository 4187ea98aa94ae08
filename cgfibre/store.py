"""results.h5: an H5MD trajectory with the record, the system, the scene, the plan and the statistics beside it.

Layout (schema 1; every dataset has a ``units`` attribute):

    /h5md, /particles/filaments, /connectivity/bonds   H5MD 1.1, positions in nm and time in ns: units that H5MD
                                                       readers know (MDAnalysis refuses um)
    /record/<column of curve.csv>, cycle, phase, width_um   the curve; columns of a cell loaded in its plane
    /system/...                                        the FilamentSystem, um
    /distribution/... or, of a weave, /fabric/...      statistics, one row a frame
    /scene (TOML), /plan, /summary (JSON)              text
"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from cgfibre.build.system import FilamentSystem, FilamentType
from cgfibre.errors import InputError, StoreError
from cgfibre.record import CELL_COLUMNS, CURVE_COLUMNS, CYCLE_COLUMNS, Curve, Frames, phases

if TYPE_CHECKING:
    import MDAnalysis

SCHEMA = 1
NM_PER_UM = 1000.0
NS_PER_US = 1000.0
SYSTEM_UNITS = {"positions": "um", "box": "um"}
TYPE_UNITS = {"diameter": "um", "EA": "nN", "EI": "nN um2", "GJ": "nN um2", "kGA": "nN", "mass_per_length": "pg/um"}


@dataclass(frozen=True)
class Results:
    """What a results file holds. ``distribution`` and, of a weave, ``fabric`` map a name to (values, units), one row a
    frame; texts as written."""

    system: FilamentSystem
    curve: Curve
    frames: Frames
    timestep: float
    distribution: Mapping[str, tuple[np.ndarray, str]]
    scene: str
    plan: str
    summary: Mapping[str, Any]
    fabric: Mapping[str, tuple[np.ndarray, str]] = field(default_factory=dict)


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """Write beside ``path`` and put it in place at the end, so that a full disk or a kill leaves the old file whole."""
    part = path.with_name(path.name + ".part")
    try:
        yield part
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def _put(group: h5py.Group, name: str, values: Any, units: str, **options: Any) -> h5py.Dataset:
    data = group.create_dataset(name, data=values, **options)
    data.attrs["units"] = units
    return data


def write_results(path: Path, results: Results) -> None:
    """Write ``results`` to ``path`` at once: either the whole file is there afterwards or the old one is."""
    with _replacing(path) as part, h5py.File(part, "w") as f:
        f.attrs["cgfibre_schema"] = SCHEMA
        for name, text in (
            ("scene", results.scene),
            ("plan", results.plan),
            ("summary", json.dumps(dict(results.summary))),
        ):
            _put(f, name, text, "text")
        _write_trajectory(f, results)
        _write_system(f.create_group("system"), results.system)
        record = f.create_group("record")
        for name, units in CURVE_COLUMNS.items():
            _put(record, name, results.curve[name], units)
        for name in CYCLE_COLUMNS:
            _put(record, name, getattr(results.curve, name), "1")
        _put(record, "width_um", results.curve.width_um, "um")
        for name, values in results.curve.cell.items():
            _put(record, name, values, CELL_COLUMNS[name])
        for group, statistics in (("distribution", results.distribution), ("fabric", results.fabric)):
            if statistics or group == "distribution":
                rows = f.create_group(group)
                for name, (values, units) in statistics.items():
                    _put(rows, name, values, units)


def _write_trajectory(f: h5py.File, results: Results) -> None:
    system, frames = results.system, results.frames
    h5md = f.create_group("h5md")
    h5md.attrs["version"] = np.array([1, 1], dtype=np.int32)
    h5md.create_group("author").attrs["name"] = "cgfibre user"
    creator = h5md.create_group("creator")
    creator.attrs["name"], creator.attrs["version"] = "cgfibre", str(SCHEMA)
    particles = f.create_group("particles/filaments")
    box = particles.create_group("box")
    box.attrs["dimension"] = 3
    box.attrs["boundary"] = [("periodic" if p else "none").encode() for p in system.periodic]
    position = particles.create_group("position")
    n = len(frames)
    time = frames.step * results.timestep
    _put(position, "step", frames.step, "1")
    _stamp(_put(position, "time", time * NS_PER_US, "ns"))
    chunks = (1, system.n_beads, 3) if n else None
    _stamp(
        _put(
            position,
            "value",
            frames.positions.reshape(n, system.n_beads, 3) * NM_PER_UM,
            "nm",
            chunks=chunks,
            compression="lzf" if n else None,
            shuffle=bool(n),
        )
    )
    if np.any(system.periodic):
        edges = box.create_group("edges")
        bounds = np.broadcast_to(system.box, (n, 3, 2)) if frames.box is None else frames.box
        size = (bounds[:, :, 1] - bounds[:, :, 0])[:, :, None] * np.eye(3) * NM_PER_UM
        size[:, 1, 0] = frames.tilt * NM_PER_UM
        edges["step"], edges["time"] = position["step"], position["time"]
        _stamp(_put(edges, "value", size, "nm"))
    if frames.box is not None:  # edges alone do not say where the box lies
        _put(box, "bounds", frames.box, "um")
        _put(box, "tilt", frames.tilt, "um")
    _put(particles, "id", np.arange(system.n_beads), "1")
    _put(particles, "species", system.filament_type[system.filament_of_bead], "1")
    # an observable of H5MD is a group; MDAnalysis refuses the file over a bare dataset
    displacement = f.create_group("observables/platen_displacement")
    displacement["step"], displacement["time"] = position["step"], position["time"]
    _stamp(_put(displacement, "value", frames.displacement_um, "um"))
    factor = f.create_group("observables/contact_factor")
    factor["step"], factor["time"] = position["step"], position["time"]
    _stamp(_put(factor, "value", frames.factor, "1"))
    _put(f.create_group("connectivity"), "bonds", system.bonds(), "1")


def _stamp(data: h5py.Dataset) -> None:
    data.attrs["unit"] = data.attrs["units"]  # H5MD's own word for it


def _write_system(group: h5py.Group, system: FilamentSystem) -> None:
    for name in ("positions", "filament_start", "closed", "tow", "filament_type", "box", "periodic", "prestrain"):
        _put(group, name, getattr(system, name), SYSTEM_UNITS.get(name, "1"))
    types = group.create_group("types")
    for name, units in TYPE_UNITS.items():
        _put(types, name, np.array([asdict(t)[name] for t in system.types]), units)
    _put(group, "provenance", json.dumps(system.provenance), "text")


@contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    """A results file of this schema, open for reading; StoreError when it is missing, damaged or of another schema."""
    try:
        with h5py.File(path, "r") as f:
            schema = f.attrs.get("cgfibre_schema")
            if schema != SCHEMA:
                raise StoreError(
                    f"{path}: schema version {schema}, this version reads {SCHEMA}; run cgfibre measure on "
                    "its folder to write it again"
                )
            yield f
    except FileNotFoundError as error:
        raise StoreError(f"{path}: no such file") from error
    except (OSError, KeyError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise StoreError(
            f"{path}: not a complete cgfibre results file ({reason}); run cgfibre measure on its folder"
        ) from error


def read_results(path: Path) -> Results:
    """Read a results file; StoreError when it is missing, damaged or of another schema."""
    with _opened(path) as f:
        return _read(f)


def _text(f: h5py.Group, name: str) -> str:
    value = f[name][()]
    return value.decode() if isinstance(value, bytes) else str(value)


def _read(f: h5py.File) -> Results:
    record, position, box = f["record"], f["particles/filaments/position"], f["particles/filaments/box"]
    step = position["step"][()]
    time = position["time"][()] / NS_PER_US
    moving = step > 0
    return Results(
        system=_read_system(f["system"]),
        curve=Curve(
            {name: record[name][()] for name in CURVE_COLUMNS},
            record["phase"][()],
            record["width_um"][()],
            record["cycle"][()] if "cycle" in record else np.ones(len(record["phase"]), dtype=np.int64),
            {name: record[name][()] for name in CELL_COLUMNS if name in record},
        ),
        frames=Frames(
            step,
            f["observables/platen_displacement/value"][()],
            position["value"][()] / NM_PER_UM,
            # an earlier version had none
            f["observables/contact_factor/value"][()] if "contact_factor" in f["observables"] else np.ones(len(step)),
            box["bounds"][()] if "bounds" in box else None,
            box["tilt"][()] if "tilt" in box else np.empty(0),
        ),
        timestep=float(time[moving][0] / step[moving][0]) if moving.any() else 0.0,
        distribution=_statistics(f["distribution"]),
        scene=_text(f, "scene"),
        plan=_text(f, "plan"),
        summary=json.loads(_text(f, "summary")),
        fabric=_statistics(f["fabric"]) if "fabric" in f else {},
    )


def _statistics(group: h5py.Group) -> dict[str, tuple[np.ndarray, str]]:
    return {name: (d[()], str(d.attrs["units"])) for name, d in group.items()}


def _read_system(group: h5py.Group) -> FilamentSystem:
    types = group["types"]
    columns = {name: types[name][()] for name in TYPE_UNITS}
    count = len(columns["diameter"])
    return FilamentSystem(
        **{
            name: group[name][()]
            for name in (
                "positions",
                "filament_start",
                "closed",
                "tow",
                "filament_type",
                "box",
                "periodic",
                "prestrain",
            )
        },
        types=tuple(FilamentType(**{name: float(c[i]) for name, c in columns.items()}) for i in range(count)),
        provenance=json.loads(_text(group, "provenance")),
    )


def open_universe(path: Path) -> MDAnalysis.Universe:
    """The run as an MDAnalysis Universe with bonds; a residue is a filament, a segment a tow, ``radii`` in Angstrom.

    Lengths are in Angstrom and time in ps, as always in MDAnalysis (1 um = 1e4 Angstrom). Frames are read lazily.
    Raises StoreError when the file is missing, damaged, of another schema or without a frame.
    """
    import MDAnalysis as mda

    with _opened(path) as f:
        system = _read_system(f["system"])
        if len(f["particles/filaments/position/step"]) == 0:
            raise StoreError(f"{path}: no frames were stored, so there is no trajectory to open")
    universe = mda.Universe.empty(
        system.n_beads,
        n_residues=system.n_filaments,
        n_segments=int(system.tow.max()) + 1,
        atom_resindex=system.filament_of_bead,
        residue_segindex=system.tow,
        trajectory=False,
    )
    universe.add_TopologyAttr("resids", np.arange(1, system.n_filaments + 1))
    universe.add_TopologyAttr("names", ["F"] * system.n_beads)
    universe.add_TopologyAttr("types", (system.filament_type[system.filament_of_bead] + 1).astype(str))
    universe.add_TopologyAttr("radii", system.diameter[system.filament_of_bead] / 2 * 1e4)
    universe.add_TopologyAttr("bonds", [tuple(b) for b in system.bonds().tolist()])
    universe.load_new(str(path), format="H5MD", driver=None)
    return universe


def write_curve(path: Path, curve: Curve) -> None:
    """curve.csv: the columns of the interface, one row a sample, loading then unloading.

    A weave that is loaded in its plane has those of :data:`CELL_COLUMNS` behind them; a run of several cycles two more
    at the end, ``cycle`` (from 1) and ``phase`` (0 loading, 1 holding, 2 unloading).
    """
    more = CYCLE_COLUMNS if curve.cycles > 1 else ()
    with _replacing(path) as part, part.open("w", newline="") as f:
        writer = csv.writer(f)
        writer.writerow([*CURVE_COLUMNS, *curve.cell, *more])
        columns = [curve[name] for name in CURVE_COLUMNS] + list(curve.cell.values())
        columns += [getattr(curve, name) for name in more]
        for row in zip(*columns, strict=True):
            writer.writerow([int(row[0]), *(f"{x:.10g}" for x in row[1:])])


def write_columns(path: Path, columns: Mapping[str, Sequence[Any] | np.ndarray]) -> None:
    """A CSV file of columns of equal length, named by their keys; numbers to ten figures, text as it is."""
    with _replacing(path) as part, part.open("w", newline="") as f:
        writer = csv.writer(f)
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow([x if isinstance(x, str) else f"{x:.10g}" for x in row])


@dataclass(frozen=True)
class Table:
    """A table with a name, notes in words, and columns of equal length: name -> (values, units); texts have "text"."""

    name: str
    notes: Mapping[str, str]
    columns: Mapping[str, tuple[Sequence[Any] | np.ndarray, str]]


def write_tables(path: Path, tables: Iterable[Table]) -> None:
    """An HDF5 file with a group a table, its notes as attributes; in place at once."""
    with _replacing(path) as part, h5py.File(part, "w") as f:
        f.attrs["cgfibre_schema"] = SCHEMA
        for table in tables:
            group = f.create_group(table.name)
            for name, note in table.notes.items():
                group.attrs[name] = note
            for name, (values, units) in table.columns.items():
                _put(group, name, [str(v) for v in values] if units == "text" else np.asarray(values), units)


def read_tables(path: Path) -> list[Table]:
    """Tables of an HDF5 file; StoreError when it is missing, damaged or of another schema."""
    with _opened(path) as f:
        return [
            Table(
                name,
                {key: str(note) for key, note in group.attrs.items()},
                {
                    key: (d.asstr()[()] if d.attrs["units"] == "text" else d[()], str(d.attrs["units"]))
                    for key, d in group.items()
                },
            )
            for name, group in f.items()
        ]


def write_rows(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """A CSV file of texts and numbers, in place at once; numbers to 10 digits, nan as an empty cell."""
    with _replacing(path) as part, part.open("w", newline="") as f:
        writer = csv.writer(f)
        writer.writerow(header)
        for row in rows:
            writer.writerow([("" if np.isnan(v) else f"{v:.10g}") if isinstance(v, float) else v for v in row])


def read_curve(path: Path) -> Curve:
    """The curve of a curve.csv, also one that another version wrote; its widths are not there (nan).

    Without columns of its own the phase is told from the displacement. Raises OSError, and ValueError for a table that
    lacks a column.
    """
    with path.open(newline="") as f:
        rows = list(csv.DictReader(f))
    try:
        columns = {name: np.array([float(row[name]) for row in rows]) for name in CURVE_COLUMNS}
    except (KeyError, TypeError) as error:
        raise ValueError(f"{path.name} lacks the column {error}") from None
    if len(rows) < 2:
        raise ValueError(f"{path.name} has no rows")
    cell = {name: np.array([float(row[name]) for row in rows]) for name in CELL_COLUMNS if name in rows[0]}
    if all(name in rows[0] for name in CYCLE_COLUMNS):
        cycle, phase = (np.array([int(row[name]) for row in rows]) for name in CYCLE_COLUMNS)
    else:
        cycle, phase = np.ones(len(rows), dtype=np.int64), phases(columns["displacement_um"])
        phase[0] = 0
    return Curve(columns, phase, np.full(len(rows), np.nan), cycle, cell)


def read_points(path: Path) -> list[tuple[str, float, float]]:
    """(label, cpu_s, error) of every row of a small CSV with these columns; OSError, KeyError or ValueError if not."""
    with path.open(newline="") as f:
        return [(row["label"], float(row["cpu_s"]), float(row["error"])) for row in csv.DictReader(f)]


def write_table(path: Path, columns: Mapping[str, tuple[Sequence[Any], str]]) -> None:
    """A CSV of columns (values, units), units left to their names; numbers that are not finite stay empty."""
    with _replacing(path) as part, part.open("w", newline="") as f:
        writer = csv.writer(f)
        writer.writerow(columns)
        for row in zip(*(values for values, _ in columns.values()), strict=True):
            writer.writerow([f"{x:.6g}" if isinstance(x, float) and np.isfinite(x) else _cell(x) for x in row])


def _cell(value: Any) -> Any:
    return "" if isinstance(value, float) else value


def check_folder(out: Path, names: Iterable[str], force: bool, more: str = "") -> None:
    """Refuse an ``--out`` that is a file, or that holds one of ``names`` of earlier results unless ``force``.

    ``more`` ends the message: what else can be done about it. Raises InputError; writes nothing.
    """
    present = [name for name in names if (out / name).exists()]
    if present and not force:
        expected = f"an empty or new folder (it holds {present[0]}); --force overwrites{more}"
        raise InputError("--out", str(out), expected)
    if out.exists() and not out.is_dir():
        raise InputError("--out", str(out), "a folder, not a file")


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """JSON with indentation; non-finite numbers become null, which is what JSON knows."""
    with _replacing(path) as part:
        part.write_text(json.dumps(plain(values), indent=2, allow_nan=False) + "\n")


def plain(value: Any) -> Any:
    """``value`` as JSON knows it: arrays as lists, non-finite numbers as None."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
