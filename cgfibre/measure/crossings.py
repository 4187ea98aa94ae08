"""Where filaments of warp and weft cross in plan view, which lies above, and whether any has passed through another."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from cgfibre.build.system import FilamentSystem, FloatArray, IntArray, whole_periods
from cgfibre.errors import InputError
from cgfibre.measure.fabric import Fabric, Lines, TowLine, lines_of
from cgfibre.measure.guards import Guard, filaments_through_each_other
from cgfibre.measure.segments import period_of, stretched, wrapped
from cgfibre.record import Frames

#: of the mean segment: beads of both lines at the same place of the plan are taken this far apart
NUDGE = 1e-6 * np.array([0.618034, 0.414214])
#: segments whose candidates are searched at a time
SLAB = 20_000


@dataclass(frozen=True)
class Crossings:
    """Crossings of two sets of lines in plan view, in order of first and second line, (n,) unless said.

    ``first`` and ``second``: index of the lines in their sets; ``place`` (n, 3) um, half-way between them, on the first
    line's image; ``gap`` um, height of the first over the second; ``turn`` +1 where the second crosses the first from
    its right to its left, else -1; ``distance`` um between the two straight lines through the crossing segments, never
    negative (below ``gap`` where they climb); ``along`` (n, 2) um, arc length of either polyline to the crossing.
    """

    first: IntArray
    second: IntArray
    place: FloatArray
    gap: FloatArray
    turn: IntArray
    distance: FloatArray
    along: FloatArray

    def __len__(self) -> int:
        return len(self.first)

    def order(self, n_first: int, n_second: int) -> IntArray:
        """(n_first, n_second) sum over crossings of turn times +1 where the first lies above, -1 where below.

        A topological invariant: two lines that cross once have +-1; a bay that slides over or under the other line adds
        two crossings of opposite turn, which cancel; it changes by 2 when one passes through the other, and only then
        (as long as no end slides under the other line). Periodic lines: over one period of both.
        """
        out = np.zeros((n_first, n_second), dtype=np.int64)
        np.add.at(out, (self.first, self.second), self.turn * np.where(self.gap > 0, 1, -1))
        return out


@dataclass(frozen=True)
class _Pieces:
    start: FloatArray
    vector: FloatArray
    line: IntArray
    along: FloatArray


def _pieces(lines: Lines) -> _Pieces:
    vector = np.diff(lines.points, axis=0)
    line = np.repeat(np.arange(len(lines)), np.diff(lines.start))
    keep = line[1:] == line[:-1]
    length = np.where(keep, np.linalg.norm(vector, axis=1), 0.0)
    along = np.concatenate([[0.0], np.cumsum(length)])
    along -= along[lines.start[:-1]][line]
    return _Pieces(lines.points[:-1][keep], vector[keep], line[:-1][keep], along[:-1][keep])


def crossings_of(first: Lines, second: Lines, period: FloatArray, tilt: float = 0.0) -> Crossings:
    """All crossings in plan view of a line of ``first`` with one of ``second``, periodic images counted once.

    ``period`` (3,) um, 0 along axes that do not repeat; ``tilt`` um of the cell. Where beads of both lie at the
    same place of the plan the second set is moved by :data:`NUDGE` of a segment, so that every crossing is found
    exactly once.
    """
    a, b = _pieces(first), _pieces(second)
    mean = np.linalg.norm(np.concatenate([a.vector, b.vector])[:, :2], axis=1).mean()
    b = replace(b, start=b.start + np.append(mean * NUDGE, 0.0))
    middle = [(p.start + p.vector / 2)[:, :2] for p in (a, b)]
    box = np.where(period[:2] > 0, period[:2], 0.0)
    inside = [wrapped(m, box, tilt) for m in middle]
    reach = sum(float(np.linalg.norm(p.vector[:, :2], axis=1).max()) for p in (a, b)) / 2 + 1e-9 * mean
    reach *= stretched(box, tilt)
    tree = cKDTree(inside[1], boxsize=box if box.any() else None)
    found: list[tuple[np.ndarray, ...]] = []
    for i in range(0, len(a.line), SLAB):
        near = tree.query_ball_point(inside[0][i : i + SLAB], reach)
        one = np.repeat(np.arange(i, i + len(near)), [len(n) for n in near])
        other = np.array([k for n in near for k in n], dtype=np.int64)
        shift = whole_periods(middle[0][one] - middle[1][other], box, tilt)
        found.append(_meeting(a, b, one, other, shift))
    s, t, one, other = (np.concatenate(c) for c in zip(*found, strict=True))
    order = np.lexsort((s, one, b.line[other], a.line[one]))  # the same in every frame
    s, t, one, other = s[order], t[order], one[order], other[order]
    u, v = a.vector[one], b.vector[other]
    on_a = a.start[one] + s[:, None] * u
    on_b = b.start[other] + t[:, None] * v
    cross = np.cross(u, v)
    # the distance of two lines is the part of the gap along their common normal
    gap = on_a[:, 2] - on_b[:, 2]
    along = np.stack(
        [p.along[k] + x * np.linalg.norm(w, axis=1) for p, k, x, w in ((a, one, s, u), (b, other, t, v))], 1
    )
    place = on_a.copy()
    place[:, 2] -= gap / 2
    return Crossings(
        first=a.line[one],
        second=b.line[other],
        place=place,
        gap=gap,
        turn=np.where(cross[:, 2] > 0, 1, -1),
        distance=np.abs(gap * cross[:, 2]) / np.linalg.norm(cross, axis=1),
        along=along,
    )


def _meeting(a: _Pieces, b: _Pieces, one: IntArray, other: IntArray, shift: FloatArray) -> tuple[np.ndarray, ...]:
    """Shares (0 up to, not including, 1) at which candidate pieces cross, and the indices of the pieces; ``shift``
    (n, 2) um brings those of ``b`` to their image."""
    w = b.start[other, :2] + shift - a.start[one, :2]
    u, v = a.vector[one, :2], b.vector[other, :2]
    det = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    parallel = det == 0
    safe = np.where(parallel, 1.0, det)
    s = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / safe
    t = (w[:, 0] * u[:, 1] - w[:, 1] * u[:, 0]) / safe
    hit = ~parallel & (s >= 0) & (s < 1) & (t >= 0) & (t < 1)
    return s[hit], t[hit], one[hit], other[hit]


def _subset(lines: Lines, chosen: IntArray) -> Lines:
    parts = [lines[int(i)] for i in chosen]
    start = np.concatenate([[0], np.cumsum([len(p) for p in parts])])
    return Lines(np.concatenate(parts), start, lines.closed[chosen], lines.filament[chosen])


def filament_crossings(fabric: Fabric, positions: FloatArray) -> Crossings:
    """Crossings of warp filaments (``first``) and weft filaments (``second``), numbered as in the system."""
    lines = lines_of(fabric.system, positions)
    warp, weft = (np.flatnonzero(fabric.filament_axis == k) for k in (0, 1))
    found = crossings_of(_subset(lines, warp), _subset(lines, weft), period_of(fabric.system), fabric.system.tilt)
    return replace(found, first=warp[found.first], second=weft[found.second])


def tow_crossings(fabric: Fabric, lines: list[TowLine]) -> Crossings:
    """Crossings of the centre lines of warp tows (``first``) and weft tows (``second``), numbered as in the fabric."""
    sets = []
    for axis in (0, 1):
        chosen = [line for line in lines if line.axis == axis]
        start = np.concatenate([[0], np.cumsum([len(line.points) for line in chosen])])
        sets.append(
            Lines(
                np.concatenate([line.points for line in chosen]),
                start,
                np.array([line.closed for line in chosen]),
                np.array([line.tow for line in chosen], dtype=np.int64),
            )
        )
    found = crossings_of(sets[0], sets[1], period_of(fabric.system), fabric.system.tilt)
    return replace(found, first=sets[0].filament[found.first], second=sets[1].filament[found.second])


def _runs_along(fabric: Fabric, axis: int) -> tuple[FilamentSystem, IntArray]:
    """The filaments of one axis as a system that runs along x, and the beads of the fabric that it is made of.

    Weft has x and y exchanged. Where the fabric repeats across the filaments all stand there twice, so that those on
    either side of the boundary meet (pairs away from it are then followed twice).
    """
    system = fabric.system
    chosen = np.flatnonzero(fabric.filament_axis == axis)
    beads = np.concatenate([np.arange(system.filament_start[i], system.filament_start[i + 1]) for i in chosen])
    counts = np.diff(system.filament_start)[chosen]
    swap = [0, 1, 2] if axis == 0 else [1, 0, 2]
    copies = 2 if system.periodic[1 - axis] else 1
    n = len(chosen) * copies
    box = system.box[swap].copy()
    box[1] = (-np.inf, np.inf)
    return (
        FilamentSystem(
            positions=np.zeros((len(beads) * copies, 3)),
            filament_start=np.concatenate([[0], np.cumsum(np.tile(counts, copies))]),
            closed=np.tile(system.closed[chosen], copies),
            tow=np.zeros(n, dtype=np.int64),
            filament_type=np.tile(system.filament_type[chosen], copies),
            types=system.types,
            box=box,
            periodic=np.array([system.periodic[axis], False, False]),
            prestrain=np.zeros(n),
        ),
        beads,
    )


def _along_x(fabric: Fabric, frames: Frames, axis: int, beads: IntArray) -> Frames:
    """Frames of the beads, unwrapped along each filament, x and y exchanged for weft, with the copy beside them."""
    period = period_of(fabric.system)
    swap = [0, 1, 2] if axis == 0 else [1, 0, 2]
    positions = frames.positions[:, beads][:, :, swap]
    if period[1 - axis] > 0:
        positions = np.concatenate([positions, positions + np.array([0.0, period[1 - axis], 0.0])], axis=1)
    return Frames(frames.step, frames.displacement_um, positions)


def through_each_other(fabric: Fabric, frames: Frames) -> Guard:
    """Number of pairs of filaments that have passed through each other since the first frame.

    Warp and weft: the order of crossing (:meth:`Crossings.order`) of every pair equals that of the first frame. Warp
    and warp, weft and weft: winding, by :func:`filaments_through_each_other` on the filaments of each axis, with their
    periodic neighbours (a pair that passed counts once for either copy). Raises InputError for frames of another number
    of beads.
    """
    name = "filaments through each other"
    system = fabric.system
    if frames.positions.shape[1:] != (system.n_beads, 3):
        raise InputError("frames", frames.positions.shape, f"shape (n_frames, {system.n_beads}, 3)")
    if len(frames) < 2:
        return Guard(name, True, float("nan"), 0.0, f"{name}: not applicable, it takes two frames")
    if not np.all(np.isfinite(frames.positions)):
        return Guard(name, False, float("nan"), 0.0, f"{name}: positions are not finite")
    n = system.n_filaments
    orders = [filament_crossings(fabric, positions).order(n, n) for positions in frames.positions]
    changed = np.zeros((n, n), dtype=bool)
    note = ""
    for k, order in enumerate(orders[1:], start=1):
        now = order != orders[0]
        if now.any() and not note:
            i, j = np.argwhere(now)[0]
            note = f"; first {i} and {j}, by a displacement of {frames.displacement_um[k]:.4g} um"
        changed |= now
    crossing = int(np.sum(orders[0] != 0))
    passed, beside = int(changed.sum()), 0
    for axis in (0, 1):
        part, beads = _runs_along(fabric, axis)
        found = filaments_through_each_other(part, _along_x(fabric, frames, axis, beads))
        if not found.ok:
            beside += int(found.value)
            note = note or found.message.partition("followed")[2]
    total = passed + beside
    message = f"{name}: {total or 'no'} pairs ({crossing} that cross, and all side by side, followed){note}"
    return Guard(name, total == 0, float(total), 0.0, message)
