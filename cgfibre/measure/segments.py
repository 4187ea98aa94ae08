"""Filaments as smooth rods between their beads: which segments come near each other, and how they touch."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from cgfibre.build.overlap import segment_distance
from cgfibre.build.system import FilamentSystem, FloatArray, IntArray, whole_periods
from cgfibre.errors import InputError
from cgfibre.measure.contacts import Contacts

#: overlap (n,) um -> force per length (n,) nN/um
LineLaw = Callable[[FloatArray], FloatArray]
SLAB = 100_000  # pieces searched at a time
GAUSS = 1 / np.sqrt(3)
#: of a segment: stretches as short come and go with the rounding of stored positions
SLIVER = 1e-4


@dataclass(frozen=True)
class Segments:
    """Segments of a frame: ``bonds`` (n, 2) beads, ``start`` (n, 3) um, ``vector`` (n, 3) um from the first bead to the
    second (minimum image), ``filament`` (n,)."""

    bonds: IntArray
    start: FloatArray
    vector: FloatArray
    filament: IntArray


def segments_of(system: FilamentSystem, positions: FloatArray) -> Segments:
    """All segments of the assembly at ``positions`` (n_beads, 3) um."""
    bonds = system.bonds()
    start = positions[bonds[:, 0]]
    vector = system.nearest(positions[bonds[:, 1]] - start)
    return Segments(bonds, start, vector, system.filament_of_bead[bonds[:, 0]])


def wrapped(points: FloatArray, period: FloatArray, tilt: float = 0.0) -> FloatArray:
    """(n, k) points put back into the cell from 0 to ``period`` (k,) um along axes that repeat, k = 2 or 3; of a cell
    with a ``tilt`` um (see :class:`FilamentSystem`) in its upright image x - y tilt/period."""
    out = points.copy()
    if tilt and period[1] > 0:
        out[:, 0] -= out[:, 1] * tilt / period[1]
    for axis in np.flatnonzero(period > 0):
        # the second remainder: a tiny negative value rounds up to the period itself
        out[:, axis] = np.mod(np.mod(out[:, axis], period[axis]), period[axis])
    return out


def stretched(period: FloatArray, tilt: float) -> float:
    """How much farther apart two points may be in a cell's upright image than they are: its largest principal
    stretch."""
    slope = abs(tilt) / float(period[1]) if tilt and period[1] > 0 else 0.0
    return (slope + np.sqrt(slope**2 + 4)) / 2 if slope else 1.0


def near_pairs(
    segments: Segments, reach: float, period: FloatArray | None = None, tilt: float = 0.0
) -> Iterator[tuple[IntArray, IntArray]]:
    """Pairs (a, b) of segments of different filaments that may come within ``reach`` um, some far ones and some twice.

    Segments longer than the reach are cut into pieces. ``period`` (3,) um, 0 along an axis that does not repeat: pairs
    across its boundaries are found too, the second one's image as :func:`image_shift` has it; ``tilt`` um of the
    cell. None: nothing repeats.
    """
    length = np.linalg.norm(segments.vector, axis=1)
    # pieces no shorter than the reach; coarser where a full-length filament would give millions
    piece = max(reach, float(length.sum()) / 4e6)
    n = np.maximum(1, np.ceil(length / piece)).astype(np.int64)
    segment = np.repeat(np.arange(len(length)), n)
    share = (np.arange(len(segment)) - np.repeat(np.cumsum(n) - n, n) + 0.5) / n[segment]
    middle = segments.start[segment] + share[:, None] * segments.vector[segment]
    radius = reach + piece
    if period is not None and np.any(period > 0):
        tree = cKDTree(wrapped(middle, period, tilt), boxsize=period)
        a, b = segment[tree.query_pairs(radius * stretched(period, tilt), output_type="ndarray")].T
        keep = segments.filament[a] != segments.filament[b]
        yield a[keep], b[keep]
        return
    order = np.argsort(middle[:, 0], kind="stable")
    x = middle[order, 0]
    for i in range(0, len(order), SLAB):
        # each slab with the stretch beyond it that a pair can span
        stop = np.searchsorted(x, x[min(i + SLAB, len(x)) - 1] + radius, side="right")
        members = order[i:stop]
        pairs = members[cKDTree(middle[members]).query_pairs(radius, output_type="ndarray")]
        a, b = segment[pairs[:, 0]], segment[pairs[:, 1]]
        keep = segments.filament[a] != segments.filament[b]
        yield a[keep], b[keep]


def period_of(system: FilamentSystem) -> FloatArray:
    """(3,) size of the box along periodic axes, 0 along the others, um."""
    return system.period


def image_shift(segments: Segments, a: IntArray, b: IntArray, period: FloatArray, tilt: float = 0.0) -> FloatArray:
    """(n, 3) what brings segments ``b`` to their image nearest to ``a`` (between middles), um.

    A box narrower than two segments and a diameter has several near images: only this one is seen.
    """
    middle = segments.start + segments.vector / 2
    return whole_periods(middle[a] - middle[b], period, tilt)


def minimum_axis_distance(system: FilamentSystem, positions: FloatArray, reach: float) -> float:
    """Least distance in um between the axes (segments) of two filaments, inf where none come within ``reach`` um.

    Sections: between centres. Axes may cross at any angle; periodic images count. Raises InputError for non-finite
    positions.
    """
    if not np.all(np.isfinite(positions)):
        raise InputError("positions", int(np.sum(~np.isfinite(positions))), "finite values only")
    if system.is_section:
        beads = system.first_beads
        near = cKDTree(positions[beads]).query_pairs(reach, output_type="ndarray")
        d = positions[beads[near[:, 0]]] - positions[beads[near[:, 1]]]
        return float(np.linalg.norm(d, axis=1).min(initial=np.inf))
    segments, period = segments_of(system, positions), period_of(system)
    best = np.inf
    for a, b in near_pairs(segments, reach, period, system.tilt):
        other = segments.start[b] + image_shift(segments, a, b, period, system.tilt)
        distance = segment_distance(segments.start[a], segments.vector[a], other, segments.vector[b])
        best = min(best, float(distance.min(initial=np.inf)))
    return best if best <= reach else float("inf")


@dataclass(frozen=True)
class Stretches:
    """Stretches in which segments of different filaments touch, all arrays (n,) unless said.

    ``segments`` (n, 2), the filament of the lower number first unless asked the other way, and ``filaments`` (n, 2);
    ``first_beads`` (n, 2) of the segments; ``reach`` um, the sum of the radii. In terms of arc length s um along the
    first segment: ``low`` and ``high`` limits; squared distance of the point at s from the other's axis = ``reach``^2 +
    C + 2 Q s + M s^2; ``start`` (n, 3) um and ``unit`` (n, 3) of the first segment; ``foot`` (n, 3) and ``drift``
    (n, 3): the vector from the other's axis to the point at s is foot + s drift. M = sin^2 of the angle between the
    segments.
    """

    segments: IntArray
    filaments: IntArray
    first_beads: IntArray
    reach: FloatArray
    low: FloatArray
    high: FloatArray
    C: FloatArray
    Q: FloatArray
    M: FloatArray
    start: FloatArray
    unit: FloatArray
    foot: FloatArray
    drift: FloatArray

    def __len__(self) -> int:
        return len(self.reach)

    def at(self, place: FloatArray) -> FloatArray:
        """Arc length at a place from -1 (``low``) to 1 (``high``) of each stretch, um; broadcasts over leading axes."""
        return np.asarray((self.high + self.low) / 2 + (self.high - self.low) / 2 * place)

    def overlap(self, s: FloatArray) -> FloatArray:
        """Overlap at arc lengths s (..., n) um, negative for gaps, um."""
        square = self.C + self.reach**2 + s * (2 * self.Q + s * self.M)
        return np.asarray(self.reach - np.sqrt(np.maximum(square, 0.0)))


def touching_stretches(
    system: FilamentSystem, positions: FloatArray, touching: np.ndarray | None = None, higher_first: bool = False
) -> Stretches:
    """Stretches in which segments of different filaments touch, as ``pair_style capsule`` finds them.

    Every point of the filament of the lower number belongs to the segment of the other between whose end planes it
    lies; of the higher one, if ``higher_first``. ``touching`` (n_beads,) bool: a segment takes part if both its beads
    do. Periodic images count. Raises InputError for non-finite positions.
    """
    if not np.all(np.isfinite(positions)):
        raise InputError("positions", int(np.sum(~np.isfinite(positions))), "finite values only")
    s, period = segments_of(system, positions), period_of(system)
    radius = system.diameter[s.filament] / 2
    length = np.linalg.norm(s.vector, axis=1)
    unit = s.vector / length[:, None]
    before, after, goes_on = _end_planes(system, s, unit)
    takes_part = np.ones(len(length), bool)
    if touching is not None:
        takes_part = touching[s.bonds[:, 0]] & touching[s.bonds[:, 1]]
    ahead = positions[s.bonds[:, 1]] - positions[s.bonds[:, 0]]
    found: list[tuple[np.ndarray, ...]] = []
    for one, other in near_pairs(s, 2 * float(radius.max(initial=0.0)), period, system.tilt):
        keep = takes_part[one] & takes_part[other]
        pairs = np.sort(np.column_stack([one[keep], other[keep]]), axis=1)
        pairs = np.unique(pairs, axis=0)[:, :: -1 if higher_first else 1]
        a, b = pairs[:, 0], pairs[:, 1]
        shift = image_shift(s, a, b, period, system.tilt)
        w = s.start[a] - (s.start[b] + shift)
        t, v = unit[a], unit[b]
        cosine, along = np.sum(t * v, 1), np.sum(w * v, 1)
        p0, m = w - along[:, None] * v, t - cosine[:, None] * v
        reach = radius[a] + radius[b]
        M, Q, C = np.maximum(np.sum(m * m, 1), 1e-14), np.sum(p0 * m, 1), np.sum(p0 * p0, 1) - reach**2
        root = np.sqrt(np.maximum(Q**2 - M * C, 0.0))
        lo = np.maximum(0.0, (-Q - root) / M)
        hi = np.minimum(length[a], (-Q + root) / M)
        hi = np.where(Q**2 > M * C, hi, lo)
        # from the bead itself: the next segment's plane must be this one to the last bit
        stop = np.where(s.vector[b] == ahead[b], positions[s.bonds[b, 1]], s.start[b] + s.vector[b])
        end = s.start[a] - (stop + shift)
        for alpha, beta, edge in (
            (np.sum(w * before[b], 1), np.sum(t * before[b], 1), np.ones(len(b), bool)),
            (-np.sum(end * after[b], 1), -np.sum(t * after[b], 1), ~goes_on[b]),
        ):
            with np.errstate(divide="ignore", invalid="ignore"):
                at = -alpha / beta
            lo = np.where(beta > 0, np.maximum(lo, at), lo)
            hi = np.where(beta < 0, np.minimum(hi, at), hi)
            # a point in the plane itself belongs to the later segment
            hi = np.where((beta == 0) & ((alpha < 0) | ((alpha == 0) & ~edge)), lo, hi)
        hit = hi - lo > 2 * SLIVER * length[a]
        found.append(tuple(c[hit] for c in (pairs, reach, lo, hi, C, Q, M, s.start[a], t, p0, m)))
    if not found:
        empty, none = np.zeros(0), np.zeros((0, 3))
        pairs = np.zeros((0, 2), dtype=np.int64)
        return Stretches(pairs, pairs, pairs, empty, empty, empty, empty, empty, empty, none, none, none, none)
    # slabs overlap: a pair may have come twice
    pairs, once = np.unique(np.concatenate([f[0] for f in found]), axis=0, return_index=True)
    columns = [np.concatenate(c)[once] for c in zip(*(f[1:] for f in found), strict=True)]
    return Stretches(pairs, s.filament[pairs], s.bonds[pairs, 0], *columns)


def segment_contacts(
    system: FilamentSystem, positions: FloatArray, law: LineLaw, touching: np.ndarray | None = None
) -> Contacts:
    """Contacts of smooth filaments, one a stretch of :func:`touching_stretches`.

    The force is the integral of ``law`` over the stretch by two Gauss points (parallel filaments; where they cross
    under large angles the engine takes Hertz' ellipse, which this leaves out: see
    :mod:`cgfibre.measure.crossing_forces`). ``touching`` (n_beads,) bool: a segment takes part if both its beads do.
    ``beads`` of the result are the segments' first ones, ``overlap`` is that in the middle of the stretch, ``x`` its
    place. Raises InputError for non-finite positions.
    """
    found = touching_stretches(system, positions, touching)
    half, middle = (found.high - found.low) / 2, found.at(np.zeros(()))
    parts = [half * law(np.maximum(found.overlap(found.at(np.asarray(g))), 0.0)) for g in (-GAUSS, GAUSS)]
    return Contacts(
        beads=found.first_beads,
        filaments=found.filaments,
        overlap=found.overlap(middle),
        force=parts[0] + parts[1],
        x=found.start[:, 0] + middle * found.unit[:, 0],
    )


def _end_planes(system: FilamentSystem, s: Segments, unit: FloatArray) -> tuple[FloatArray, FloatArray, np.ndarray]:
    """Normals (n, 3) of the planes at both ends of each segment, halving the angle to the next one if there is one, and
    whether there is one behind its end."""
    into, out = np.full(system.n_beads, -1), np.full(system.n_beads, -1)
    out[s.bonds[:, 0]] = into[s.bonds[:, 1]] = np.arange(len(s.bonds))
    previous, following = into[s.bonds[:, 0]], out[s.bonds[:, 1]]
    before = unit + np.where(previous[:, None] >= 0, unit[previous], 0.0)
    after = unit + np.where(following[:, None] >= 0, unit[following], 0.0)
    return before, after, following >= 0
