"""Filaments as smooth rods between their beads: which segments come near each other, and how they touch."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from cgfibre.build.overlap import segment_distance
from cgfibre.build.system import FilamentSystem, FloatArray, IntArray
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
    vector = positions[bonds[:, 1]] - start
    size = system.box[:, 1] - system.box[:, 0]
    for axis in np.flatnonzero(system.periodic):
        vector[:, axis] -= size[axis] * np.round(vector[:, axis] / size[axis])
    return Segments(bonds, start, vector, system.filament_of_bead[bonds[:, 0]])


def near_pairs(segments: Segments, reach: float) -> Iterator[tuple[IntArray, IntArray]]:
    """Pairs (a, b) of segments of different filaments that may come within ``reach`` um, some far ones and some twice.

    Segments longer than the reach are cut into pieces; periodic axes are not wrapped.
    """
    length = np.linalg.norm(segments.vector, axis=1)
    # pieces no shorter than the reach; coarser where a full-length filament would give millions
    piece = max(reach, float(length.sum()) / 4e6)
    n = np.maximum(1, np.ceil(length / piece)).astype(np.int64)
    segment = np.repeat(np.arange(len(length)), n)
    share = (np.arange(len(segment)) - np.repeat(np.cumsum(n) - n, n) + 0.5) / n[segment]
    middle = segments.start[segment] + share[:, None] * segments.vector[segment]
    radius = reach + piece
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


def minimum_axis_distance(system: FilamentSystem, positions: FloatArray, reach: float) -> float:
    """Least distance in um between the axes (segments) of two filaments, inf where none come within ``reach`` um.

    Sections: between centres. Axes may cross at any angle. Periodic axes are not wrapped: contacts across a boundary
    are not seen. Raises InputError for non-finite positions.
    """
    if not np.all(np.isfinite(positions)):
        raise InputError("positions", int(np.sum(~np.isfinite(positions))), "finite values only")
    if system.is_section:
        beads = system.first_beads
        near = cKDTree(positions[beads]).query_pairs(reach, output_type="ndarray")
        d = positions[beads[near[:, 0]]] - positions[beads[near[:, 1]]]
        return float(np.linalg.norm(d, axis=1).min(initial=np.inf))
    segments = segments_of(system, positions)
    best = np.inf
    for a, b in near_pairs(segments, reach):
        distance = segment_distance(segments.start[a], segments.vector[a], segments.start[b], segments.vector[b])
        best = min(best, float(distance.min(initial=np.inf)))
    return best if best <= reach else float("inf")


def segment_contacts(
    system: FilamentSystem, positions: FloatArray, law: LineLaw, touching: np.ndarray | None = None
) -> Contacts:
    """Stretches in which segments of different filaments touch, as ``pair_style capsule`` finds them.

    Every point of the filament of the lower number belongs to the segment of the other between whose end planes it
    lies; the force is the integral of ``law`` over the stretch by two Gauss points (parallel filaments; where they
    cross under large angles the engine takes Hertz' ellipse, which this leaves out). ``touching`` (n_beads,) bool: a
    segment takes part if both its beads do. ``beads`` of the result are the segments' first ones, ``overlap`` is that
    in the middle of the stretch, ``x`` its place. Raises InputError for non-finite positions.
    """
    if not np.all(np.isfinite(positions)):
        raise InputError("positions", int(np.sum(~np.isfinite(positions))), "finite values only")
    s = segments_of(system, positions)
    radius = system.diameter[s.filament] / 2
    length = np.linalg.norm(s.vector, axis=1)
    unit = s.vector / length[:, None]
    before, after = _end_planes(system, s, unit)
    takes_part = np.ones(len(length), bool)
    if touching is not None:
        takes_part = touching[s.bonds[:, 0]] & touching[s.bonds[:, 1]]
    found: list[tuple[np.ndarray, ...]] = []
    for one, other in near_pairs(s, 2 * float(radius.max(initial=0.0))):
        keep = takes_part[one] & takes_part[other]
        pairs = np.sort(np.column_stack([one[keep], other[keep]]), axis=1)
        pairs = np.unique(pairs, axis=0)
        a, b = pairs[:, 0], pairs[:, 1]
        w = s.start[a] - s.start[b]
        t, v = unit[a], unit[b]
        cosine, along = np.sum(t * v, 1), np.sum(w * v, 1)
        p0, m = w - along[:, None] * v, t - cosine[:, None] * v
        reach = radius[a] + radius[b]
        M, Q, C = np.maximum(np.sum(m * m, 1), 1e-14), np.sum(p0 * m, 1), np.sum(p0 * p0, 1) - reach**2
        root = np.sqrt(np.maximum(Q**2 - M * C, 0.0))
        lo = np.maximum(0.0, (-Q - root) / M)
        hi = np.minimum(length[a], (-Q + root) / M)
        hi = np.where(Q**2 > M * C, hi, lo)
        end = w - length[b][:, None] * v
        for alpha, beta in (
            (np.sum(w * before[b], 1), np.sum(t * before[b], 1)),
            (-np.sum(end * after[b], 1), -np.sum(t * after[b], 1)),
        ):
            with np.errstate(divide="ignore", invalid="ignore"):
                at = -alpha / beta
            lo = np.where(beta > 0, np.maximum(lo, at), lo)
            hi = np.where(beta < 0, np.minimum(hi, at), hi)
            hi = np.where((beta == 0) & (alpha < 0), lo, hi)
        half, middle = (hi - lo) / 2, (hi + lo) / 2
        hit = half > SLIVER * length[a]

        def overlap(at: FloatArray, parabola: tuple[FloatArray, ...] = (C, Q, M, reach)) -> FloatArray:
            c, q, m, d = parabola
            return np.asarray(d - np.sqrt(np.maximum(c + d**2 + at * (2 * q + at * m), 0.0)))

        force = sum(half * law(np.maximum(overlap(middle + g * half), 0.0)) for g in (-GAUSS, GAUSS))
        x = s.start[a][:, 0] + middle * t[:, 0]
        found.append((a[hit], b[hit], overlap(middle)[hit], np.asarray(force)[hit], x[hit]))
    columns = [np.concatenate(c) for c in zip(*found, strict=True)] if found else [np.zeros(0)] * 5
    pair = np.column_stack(columns[:2]).astype(np.int64)
    depth, force, x = columns[2:]
    # slabs overlap: a pair may have come twice
    pair, once = np.unique(pair, axis=0, return_index=True)
    return Contacts(
        beads=s.bonds[pair, 0],
        filaments=s.filament[pair],
        overlap=depth[once],
        force=force[once],
        x=x[once],
    )


def _end_planes(system: FilamentSystem, s: Segments, unit: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Normals (n, 3) of the planes at both ends of each segment: halving the angle to the next one, if there is one."""
    into, out = np.full(system.n_beads, -1), np.full(system.n_beads, -1)
    out[s.bonds[:, 0]] = into[s.bonds[:, 1]] = np.arange(len(s.bonds))
    previous, following = into[s.bonds[:, 0]], out[s.bonds[:, 1]]
    before = unit + np.where(previous[:, None] >= 0, unit[previous], 0.0)
    after = unit + np.where(following[:, None] >= 0, unit[following], 0.0)
    return before, after
