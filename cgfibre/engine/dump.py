"""Read what a deck writes: record.txt, extremes.txt, trajectory.lammpstrj, state files.

A killed run leaves a last row or frame cut short, a resumed one repeats rows: both are put right here.
"""

from __future__ import annotations

import mmap
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cgfibre.build.system import FloatArray, IntArray

RECORD_COLUMNS = (
    "step",
    "displacement",
    "top_force",
    "bottom_force",
    "kinetic",
    "stored",
    "width",
    "pressure",
    "end_path",
    "leg",
    "phase",
)
EXTREME_COLUMNS = (
    "step",
    "displacement",
    "y_lo",
    "y_hi",
    "z_lo",
    "z_hi",
    "closest",
    "turn",
    "stored",
    "end_path",
    "time",
)
#: number of columns before decks had legs
OLD_RECORD_COLUMNS, OLD_EXTREME_COLUMNS = 9, 10

FRAME = b"ITEM: TIMESTEP\n"

END_OF_RESTART = b"LammpS RestartT"


#: of a weave that is loaded in its plane; the first row is the state at step 0
CELL_COLUMNS = ("step", "pull_x", "pull_y", "couple", "edge_x", "edge_y", "turned")
BALANCE_COLUMNS = ("step", "spring_force", "drag_force", "momentum", "contact_energy", "factor", "furthest")


@dataclass(frozen=True)
class RawRecord:
    """Columns of record.txt and extremes.txt at their common steps, engine units; ``step`` (n,) int.

    ``start`` is the state at step 0, empty when nothing was written yet; ``balance`` what a section's springs and
    contacts do (balance.txt), empty for other levels; ``cell`` of a weave that is loaded in its plane (cell.txt): (n +
    1,) from step 0 on, else empty.
    """

    step: IntArray
    mean: dict[str, FloatArray]
    state: dict[str, FloatArray]
    start: dict[str, float]
    balance: dict[str, FloatArray] = field(default_factory=dict)
    cell: dict[str, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True)
class State:
    """What a checkpoint's state file says."""

    file: str
    checkpoint: str
    phase: int
    step: int


def _table(path: Path, columns: int) -> FloatArray:
    """Rows of a fix ave/time file, whole rows only, the last of equal steps kept, rising steps."""
    if not path.exists():
        return np.empty((0, columns))
    text = path.read_bytes()
    text = text[: text.rfind(b"\n") + 1]
    rows = [line.split() for line in text.splitlines() if line and not line.startswith(b"#")]
    data = np.array([row for row in rows if len(row) == columns], dtype=float).reshape(-1, columns)
    # of rows with the same step the last one wins: a resumed run computed it again
    _, last = np.unique(data[::-1, 0], return_index=True)
    return data[::-1][last]


def _newest_table(path: Path, columns: tuple[str, ...], old: int) -> FloatArray:
    """Rows with all ``columns``, or else those with the first ``old`` of them."""
    table = _table(path, len(columns))
    earlier = table if len(table) else _table(path, old)
    return earlier if len(earlier) else table


def last_row(path: Path) -> list[float] | None:
    """The last whole row of a fix ave/time file, without reading the file; None when there is none."""
    if not path.exists():
        return None
    with path.open("rb") as f:
        f.seek(0, 2)
        f.seek(max(0, f.tell() - 4096))
        tail = f.read()
    lines = tail[: tail.rfind(b"\n") + 1].splitlines()
    if not lines or lines[-1].startswith(b"#"):
        return None
    try:
        return [float(x) for x in lines[-1].split()]
    except ValueError:
        return None


def read_record(folder: Path) -> RawRecord:
    """The record of a deck's folder; empty arrays when nothing was written yet.

    ``leg``, ``phase`` and ``time`` are not there where an earlier version wrote the deck.
    """
    mean = _newest_table(folder / "record.txt", RECORD_COLUMNS, OLD_RECORD_COLUMNS)
    state = _newest_table(folder / "extremes.txt", EXTREME_COLUMNS, OLD_EXTREME_COLUMNS)
    start = state[state[:, 0] == 0]
    balance = _table(folder / "balance.txt", len(BALANCE_COLUMNS))
    cell = _table(folder / "cell.txt", len(CELL_COLUMNS))
    steps = np.intersect1d(mean[:, 0], state[:, 0])
    for more in (balance, cell):
        if len(more):
            steps = np.intersect1d(steps, more[:, 0])
    cell = cell[np.isin(cell[:, 0], np.append(steps, 0.0))]
    mean, state, balance = (table[np.isin(table[:, 0], steps)] for table in (mean, state, balance))
    return RawRecord(
        step=mean[:, 0].astype(np.int64),
        mean={name: mean[:, k] for k, name in enumerate(RECORD_COLUMNS[: mean.shape[1]]) if k},
        state={name: state[:, k] for k, name in enumerate(EXTREME_COLUMNS[: state.shape[1]]) if k},
        start={name: float(start[0, k]) for k, name in enumerate(EXTREME_COLUMNS[: state.shape[1]]) if k}
        if len(start)
        else {},
        balance={name: balance[:, k] for k, name in enumerate(BALANCE_COLUMNS) if k} if len(balance) else {},
        cell={name: cell[:, k] for k, name in enumerate(CELL_COLUMNS) if k} if len(cell) else {},
    )


def mend_tables(folder: Path) -> None:
    """Cut a row that a kill or a full disk left unfinished off the tables before more is appended."""
    for path in (folder / f"{name}.txt" for name in ("record", "extremes", "balance", "cell")):
        if path.exists():
            whole = path.read_bytes().rfind(b"\n") + 1
            os.truncate(path, whole)


def _blocks(path: Path) -> Iterator[bytes]:
    """Texts of the frames of a dump, whole or not."""
    if not path.exists() or path.stat().st_size == 0:
        return
    with path.open("rb") as f, mmap.mmap(f.fileno(), 0, access=mmap.ACCESS_READ) as data:
        start = data.find(FRAME)
        while start >= 0:
            end = data.find(FRAME, start + 1)
            yield data[start : end if end >= 0 else len(data)]
            start = end


def iterate_frames(path: Path, n_beads: int) -> Iterator[tuple[int, FloatArray]]:
    """(step, positions (n_beads, 3) by bead id) of every whole frame in a text dump ``id mol type xu yu zu radius``.

    Beads beyond ``n_beads`` (a rod's grips come last) are dropped. A frame that a kill cut short is left out, also when
    a resumed run wrote on behind it.
    """
    for block in _blocks(path):
        found = _frame(block, n_beads)
        if found is not None:
            yield found


def frame_boxes(path: Path) -> dict[int, tuple[FloatArray, float]]:
    """Bounds (3, 2) of the box and its tilt along x, um, at every step of a dump; of equal steps the last.

    Of a tilted box the dump has the bounds around it, which reach as far as its corners.
    """
    found = {}
    for block in _blocks(path):
        head = block.split(b"\n", 8)
        if len(head) == 9:
            rows = np.array([row.split() for row in head[5:8]], dtype=float)
            tilt = float(rows[0, 2]) if rows.shape[1] > 2 else 0.0
            rows[0, 0] -= min(tilt, 0.0)
            rows[0, 1] -= max(tilt, 0.0)
            found[int(head[1])] = rows[:, :2], tilt
    return found


def _frame(block: bytes, n_beads: int) -> tuple[int, FloatArray] | None:
    """Step and positions of one frame; None when it is not whole."""
    head = block.split(b"\n", 9)
    if len(head) < 10:
        return None
    step, n = int(head[1]), int(head[3])
    rows = head[9].split(b"\n", n)
    if len(rows) <= n:
        return None
    table = np.array(b" ".join(rows[:n]).split(), dtype=float).reshape(n, 7)
    positions = np.full((n_beads, 3), np.nan)
    ids = table[:, 0].astype(np.int64) - 1
    keep = ids < n_beads
    positions[ids[keep]] = table[keep, 3:6]
    return step, positions


def _is_whole(checkpoint: Path) -> bool:
    """Whether a restart file ends as the engine ends them: on a full disk it writes half of one without a word."""
    if not checkpoint.exists():
        return False
    with checkpoint.open("rb") as f:
        f.seek(max(0, checkpoint.stat().st_size - 64))
        return END_OF_RESTART in f.read()


def read_states(folder: Path) -> list[State]:
    """Complete state files of a deck's folder, the newest checkpoint first."""
    states = []
    for path in sorted(folder.glob("state.[01]")):
        text = path.read_text(errors="replace")
        if not text.rstrip().endswith("# complete"):
            continue
        values = dict(re.findall(r"variable (\w+) index (\S+)", text))
        if _is_whole(folder / values["checkpoint"]):
            states.append(
                State(
                    path.name,
                    values["checkpoint"],
                    int(float(values["phase_at"])),
                    int(float(values["step_at"])),
                )
            )
    return sorted(states, key=lambda s: s.step, reverse=True)
