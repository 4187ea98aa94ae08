"""Sections of a fabric: cut filaments, tows in the plane normal to their run, and the room left between fibres."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from cgfibre.build.system import FilamentSystem, FloatArray, IntArray, whole_periods
from cgfibre.errors import InputError
from cgfibre.measure.crossings import Crossings, crossings_of
from cgfibre.measure.distribution import outline, polygon_area
from cgfibre.measure.fabric import Fabric, Lines, TowLine, lines_of
from cgfibre.measure.segments import period_of, segments_of, wrapped

#: points along a bead-to-bead segment of a filament that lies in the plane of a cut
FINE = 8


@dataclass(frozen=True)
class Ellipses:
    """Filaments cut across, (n,) unless said: ``centres`` (n, 2) um, in the plane and z; half axes ``major`` and
    ``minor`` um; ``tilt`` rad of the major axis to the plane of the fabric; ``tow``; ``filament``."""

    centres: FloatArray
    major: FloatArray
    minor: FloatArray
    tilt: FloatArray
    tow: IntArray
    filament: IntArray

    def __len__(self) -> int:
        return len(self.major)


@dataclass(frozen=True)
class Band:
    """A filament that lies along the plane of a cut: ``line`` (n, 2) um and ``half_width`` (n,) um of the strip in
    which the plane cuts it; ``tow``; ``filament``."""

    line: FloatArray
    half_width: FloatArray
    tow: int
    filament: int

    def polygon(self) -> FloatArray:
        """(2 n, 2) outline of the strip, um."""
        way = np.gradient(self.line, axis=0)
        way /= np.maximum(np.linalg.norm(way, axis=1), 1e-300)[:, None]
        side = np.stack([-way[:, 1], way[:, 0]], axis=1) * self.half_width[:, None]
        return np.concatenate([self.line + side, (self.line - side)[::-1]])


@dataclass(frozen=True)
class Cut:
    """A plane section: normal to x (``axis`` 0) or y (1) at ``at`` um; seen within ``window`` (low, high) um along the
    other axis."""

    axis: int
    at: float
    window: tuple[float, float]
    ellipses: Ellipses
    bands: tuple[Band, ...]

    def from_edge(self, low: float) -> Cut:
        """The same, moved along the plane so that the window begins at ``low`` um."""
        shift = np.array([low - self.window[0], 0.0])
        return replace(
            self,
            window=(low, self.window[1] + float(shift[0])),
            ellipses=replace(self.ellipses, centres=self.ellipses.centres + shift),
            bands=tuple(replace(band, line=band.line + shift) for band in self.bands),
        )


@dataclass(frozen=True)
class PlaneFrame:
    """The axes of planes in which the weft runs (``axis`` 0, their normal) or the warp (1): x and y turned by ``angle``
    rad about z, so that these tows run along the other axis also where the weft is sheared.

    What repeats, um (0: nothing): ``along`` the planes; ``normal`` to them, where it is moved by ``skew`` along them.
    """

    axis: int
    angle: float
    along: float
    normal: float
    skew: float

    def of(self, points: FloatArray) -> FloatArray:
        """(..., 3) points or vectors on these axes, um."""
        return self._turned(points, self.angle)

    def back(self, points: FloatArray) -> FloatArray:
        """(..., 3) points on these axes as x, y, z, um."""
        return self._turned(points, -self.angle)

    @staticmethod
    def _turned(points: FloatArray, angle: float) -> FloatArray:
        if angle == 0:
            return points
        c, s = np.cos(angle), np.sin(angle)
        out = np.array(points, dtype=float)
        out[..., 0], out[..., 1] = c * points[..., 0] - s * points[..., 1], s * points[..., 0] + c * points[..., 1]
        return out


def plane_frame(system: FilamentSystem, axis: int) -> PlaneFrame:
    """Frame of the planes with the normal ``axis``: x and y themselves, but for those of a weft that is sheared."""
    x, y = period_of(system)[:2].tolist()
    if axis == 1 or system.tilt == 0:
        return PlaneFrame(axis, 0.0, (y, x)[axis], (x, y)[axis], system.tilt if y > 0 and axis == 1 else 0.0)
    angle = float(np.arctan2(system.tilt, system.box[1, 1] - system.box[1, 0]))
    return PlaneFrame(axis, angle, y / np.cos(angle), x * np.cos(angle), x * np.sin(angle))


def plane_window(system: FilamentSystem, positions: FloatArray, axis: int, at: float) -> tuple[float, float]:
    """What the plane ``at`` um with the normal ``axis`` shows along itself, um: one period of the cell, or the beads of
    a patch, from where the plane meets the one edge to where it meets the other."""
    frame, other = plane_frame(system, axis), 1 - axis
    if frame.along > 0:
        low, high = system.box[other].tolist()
    else:
        u = system.upright(positions[:, :2])[:, other]
        low, high = float(u.min()), float(u.max())
    if axis == 0:
        low, high = ((x + np.sin(frame.angle) * at) / np.cos(frame.angle) for x in (low, high))
    elif frame.along == 0:
        slope = system.tilt / float(np.ptp(system.box[1]))
        low, high = low + slope * at, high + slope * at
    return float(low), float(high)


def _window(
    fabric: Fabric, positions: FloatArray, axis: int, at: float, window: tuple[float, float] | None
) -> tuple[float, float]:
    if window is not None:
        if not window[1] > window[0]:
            raise InputError("window", window, "two rising coordinates, um")
        return window
    low, high = plane_window(fabric.system, positions, axis, at)
    radius = 0.0 if fabric.system.periodic[1 - axis] else float(fabric.system.diameter.max()) / 2
    return low - radius, high + radius


def _images(low: float, high: float, period: float, window: tuple[float, float]) -> list[float]:
    """Shifts that bring something between ``low`` and ``high`` into the window."""
    if period <= 0:
        return [0.0] if high >= window[0] and low <= window[1] else []
    first = int(np.ceil((window[0] - high) / period))
    last = int(np.floor((window[1] - low) / period))
    return [k * period for k in range(first, last + 1)]


def cut_fabric(
    fabric: Fabric, positions: FloatArray, axis: int, at: float, window: tuple[float, float] | None = None
) -> Cut:
    """The fabric cut by the plane x = ``at`` (``axis`` 0) or y = ``at`` (1), um, periodic images included.

    Where the weft is sheared, planes of axis 0 turn with it and ``at`` counts along their normal (:func:`plane_frame`).
    Filaments that run along the axis are cut in ellipses: half axes r and r/|t.n| with t the segment's tangent and n
    the plane's normal, the longer one along t in the plane. Those of the other direction lie in the plane: it cuts them
    in strips of half width sqrt(r^2 - d^2), d the distance of their axis from the plane. ``window`` um along the other
    axis; None: the cell, or all of a patch.
    """
    if axis not in (0, 1):
        raise InputError("axis", axis, "0 (normal to x, the warp) or 1 (normal to y, the weft)")
    system, other = fabric.system, 1 - axis
    low, high = span = _window(fabric, positions, axis, at, window)
    frame = plane_frame(system, axis)
    radius = system.diameter / 2
    segments = segments_of(system, positions)
    across = fabric.filament_axis[segments.filament] == axis
    start, vector = frame.of(segments.start[across]), frame.of(segments.vector[across])
    filament = segments.filament[across]
    begin = start[:, axis]
    steps = np.zeros(len(begin))
    if frame.normal > 0:
        # the plane's image at or above the segment's lower end
        lower = np.minimum(begin, begin + vector[:, axis])
        steps = np.ceil((lower - at) / frame.normal)
    plane = at + frame.normal * steps
    run = np.where(vector[:, axis] == 0, 1.0, vector[:, axis])
    share = (plane - begin) / run
    # 0 up to, not including, 1: a bead in the plane belongs to one of its segments
    hit = np.flatnonzero((vector[:, axis] != 0) & (share >= 0) & (share < 1))
    centre = start[hit] + share[hit, None] * vector[hit]
    unit = vector[hit] / np.linalg.norm(vector[hit], axis=1)[:, None]
    r = radius[filament[hit]]
    u = centre[:, other] - frame.skew * steps[hit]
    rows: list[tuple[float, int]] = []
    for k in range(len(hit)):
        for shift in _images(u[k] - r[k], u[k] + r[k], frame.along, span):
            rows.append((shift, k))
    shifts, of = np.array([row[0] for row in rows]), np.array([row[1] for row in rows], dtype=np.int64)
    ellipses = Ellipses(
        centres=np.stack([u[of] + shifts, centre[of, 2]], axis=1),
        major=r[of] / np.abs(unit[of, axis]),
        minor=r[of],
        tilt=np.arctan2(unit[of, 2], unit[of, other]),
        tow=system.tow[filament[hit]][of],
        filament=filament[hit][of],
    )
    bands: list[Band] = []
    lines = lines_of(system, positions)
    for i in np.flatnonzero(fabric.filament_axis == other).tolist():
        bands += _bands(frame, frame.of(lines[i]), bool(system.closed[i]), at, span, radius[i], int(system.tow[i]), i)
    return Cut(axis, float(at), (low, high), ellipses, tuple(bands))


def _bands(
    frame: PlaneFrame,
    points: FloatArray,
    closed: bool,
    at: float,
    span: tuple[float, float],
    radius: float,
    tow: int,
    filament: int,
) -> list[Band]:
    axis, other = frame.axis, 1 - frame.axis
    share = np.arange(FINE * (len(points) - 1) + 1) / FINE
    fine = np.stack([np.interp(share, np.arange(len(points)), points[:, k]) for k in range(3)], axis=1)
    run = points[-1] - points[0]
    if closed and run[other] < 0:
        fine, run = fine[::-1], -run
    wide = (span[0] - 2 * radius, span[1] + 2 * radius)
    found = []
    low, high = float(np.min(fine[:, axis])), float(np.max(fine[:, axis]))
    for shift in _images(low, high, frame.normal, (at - radius, at + radius)):
        skew = shift / frame.normal * frame.skew if frame.normal > 0 else 0.0
        line = fine + np.array([0.0, skew, 0.0] if axis == 0 else [skew, 0.0, 0.0])
        if closed:
            # one strip over the whole window: images one after the other
            u = line[:, other]
            shifts = _images(float(u.min()), float(u.max()), frame.along, wide)
            if not shifts:
                continue
            tiled = [line[:-1] + s / frame.along * run for s in shifts]
            line = np.concatenate([*tiled, line[-1:] + shifts[-1] / frame.along * run])
        d = line[:, axis] + shift - at
        inside = (np.abs(d) < radius) & (line[:, other] > wide[0]) & (line[:, other] < wide[1])
        edge = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
        for first, stop in edge.reshape(-1, 2).tolist():
            if stop - first >= 2:
                strip = slice(first, stop)
                half = np.sqrt(radius**2 - d[strip] ** 2)
                found.append(Band(line[strip][:, [other, 2]], half, tow, filament))
    return found


@dataclass(frozen=True)
class TowSections:
    """Sections of tows normal to their centre lines, at their crossings and half-way between, (n,) unless said.

    ``tow``; ``at_crossing`` bool; ``crossing`` index of the crossing (the one before, between two); ``width``,
    ``thickness`` um over all surfaces, along and normal to the plane of the fabric; ``area`` um2 of the convex outline;
    ``fraction`` of that area filled with filaments; ``place`` (n, 3) um.
    """

    tow: IntArray
    at_crossing: np.ndarray
    crossing: IntArray
    width: FloatArray
    thickness: FloatArray
    area: FloatArray
    fraction: FloatArray
    place: FloatArray

    def mean(self, name: str, axes: IntArray, axis: int, at_crossing: bool) -> float:
        """Mean of ``name`` over the tows of an axis, at crossings or between; nan where there are none."""
        chosen = (axes[self.tow] == axis) & (self.at_crossing == at_crossing)
        values = np.asarray(getattr(self, name))[chosen]
        return float(np.mean(values)) if len(values) else float("nan")


def section_of_tow(line: TowLine, at: float) -> tuple[FloatArray, FloatArray]:
    """Filaments of a tow in the plane normal to its centre line at arc length ``at`` um: (n, 2) across and up, um,
    relative to the centre line, and the place (3,) of the plane.

    ``up`` is normal to the line in the vertical plane through it. Filaments that do not pass the plane are left out.
    """
    t, spline = line.curve
    chord = float(np.clip(at, 0.0, t[-1])) if not line.closed else float(np.mod(at, t[-1]))
    centre = np.asarray(spline(chord)) + chord / t[-1] * line.run
    tangent = line.tangents(t, spline, np.asarray(chord))
    tangent = tangent / np.linalg.norm(tangent)
    across = np.array([-tangent[1], tangent[0], 0.0]) / np.hypot(tangent[0], tangent[1])
    up = np.cross(tangent, across)
    filaments = line.filaments
    if line.closed:
        step = line.run
        filaments = np.concatenate([filaments[:, :-1] - step, filaments[:, :-1], filaments + step], axis=1)
    ahead = (filaments - centre) @ tangent
    crosses = (ahead[:, :-1] <= 0) & (ahead[:, 1:] > 0)
    # of several passings the one nearest to the centre line
    off = np.where(crosses, np.linalg.norm(filaments[:, :-1] - centre, axis=2), np.inf)
    k = np.argmin(off, axis=1)
    use = np.flatnonzero(crosses.any(axis=1))
    a, b = ahead[use, k[use]], ahead[use, k[use] + 1]
    share = (-a / (b - a))[:, None]
    points = (1 - share) * filaments[use, k[use]] + share * filaments[use, k[use] + 1] - centre
    return np.stack([points @ across, points @ up], axis=1), centre


def _between(along: FloatArray, total: float, closed: bool) -> list[tuple[int, float]]:
    """(index of the crossing before, arc length) half-way between crossings that follow each other."""
    order = np.argsort(along)
    out = [(int(i), float(along[i] + along[j]) / 2) for i, j in pairwise(order)]
    if closed and len(order):
        out.append((int(order[-1]), float((along[order[-1]] + along[order[0]] + total) / 2)))
    return out


def tow_sections(
    fabric: Fabric, lines: list[TowLine], crossings: Crossings, platens: tuple[float, float] | None = None
) -> TowSections:
    """Width and thickness of every tow at its crossings and half-way between them.

    Filament level: from the filaments where they pass the plane normal to the tow's centre line, each a circle of its
    diameter. A tow of one chain, or of a ribbon of chains side by side, keeps its diameter but for what it gives to
    others: half of the overlap with the chains that it crosses (their mean). ``platens`` (bottom, top) um: what lies
    behind a platen's face is pressed flat.
    """
    diameter = fabric.system.diameter
    given = _given(fabric, lines, crossings)
    rows: list[tuple[int, bool, int, float, float, float, float, FloatArray]] = []
    for line in lines:
        members = fabric.members[line.tow]
        r = diameter[members] / 2
        mine = np.flatnonzero((crossings.first if line.axis == 0 else crossings.second) == line.tow)
        along = crossings.along[mine, line.axis]
        total = float(line.curve[0][-1])
        places = [(True, int(c), float(s)) for c, s in zip(mine, along, strict=True)]
        places += [(False, int(mine[c]), s) for c, s in _between(along, total, line.closed)]
        for at_crossing, c, s in places:
            points, centre = section_of_tow(line, s)
            if not len(points):
                continue
            radius = r if len(points) == len(members) else np.full(len(points), r.mean())
            low, high = (points - radius[:, None]).min(axis=0), (points + radius[:, None]).max(axis=0)
            bottom, top = low[1], high[1]
            if platens is not None:
                bottom, top = max(bottom, platens[0] - centre[2]), min(top, platens[1] - centre[2])
            if at_crossing:
                top -= given[c, line.axis]
            area = polygon_area(outline(points, 2 * radius))
            filled = float(np.sum(np.pi * radius**2)) / area
            rows.append((line.tow, at_crossing, c, high[0] - low[0], top - bottom, area, filled, centre))
    columns = list(zip(*rows, strict=True))
    return TowSections(
        tow=np.array(columns[0], dtype=np.int64),
        at_crossing=np.array(columns[1], dtype=bool),
        crossing=np.array(columns[2], dtype=np.int64),
        width=np.array(columns[3], dtype=float),
        thickness=np.array(columns[4], dtype=float),
        area=np.array(columns[5], dtype=float),
        fraction=np.array(columns[6], dtype=float),
        place=np.array(columns[7], dtype=float),
    )


def _given(fabric: Fabric, lines: list[TowLine], crossings: Crossings) -> FloatArray:
    """(n_crossings, 2) um by which a tow of one layer of chains, warp and weft, is thinner at a crossing."""
    system, of = fabric.system, {line.tow: line for line in lines}
    out = np.zeros((len(crossings), 2))
    for c, (warp, weft) in enumerate(zip(crossings.first, crossings.second, strict=True)):
        pair = of[int(warp)], of[int(weft)]
        flat = [_one_layer(line, float(system.diameter[fabric.members[line.tow]].min())) for line in pair]
        if not any(flat):
            continue
        one, other = (_as_lines(line, fabric) for line in pair)
        found = crossings_of(one, other, period_of(system), system.tilt)
        first, second = fabric.members[int(warp)][found.first], fabric.members[int(weft)][found.second]
        reach = (system.diameter[first] + system.diameter[second]) / 2
        overlap = np.maximum(reach - found.distance, 0.0)
        # tows that cross more than once: those nearest to this crossing
        mine = np.flatnonzero((crossings.first == warp) & (crossings.second == weft))
        apart = np.abs(found.along[:, :1] - crossings.along[mine, 0])
        near = mine[np.argmin(apart, axis=1)] == c
        out[c] = np.where(flat, np.mean(overlap[near]) / 2 if near.any() else 0.0, 0.0)
    return out


def _one_layer(line: TowLine, diameter: float) -> bool:
    """Whether all filaments of a tow lie at one height (its first station), as chains of a homogenised tow do."""
    return float(np.ptp(line.filaments[:, 0, 2])) < 0.05 * diameter


def _as_lines(line: TowLine, fabric: Fabric) -> Lines:
    n, m, _ = line.filaments.shape
    members = fabric.members[line.tow]
    return Lines(line.filaments.reshape(-1, 3), np.arange(n + 1) * m, np.full(n, line.closed), members)


# --- the room between fibres -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Room:
    """Void of a picture of fibres: ``fraction`` of its area, ``hydraulic_radius`` um (void area over the length of the
    fibres' outline), ``largest`` um, radius of the largest circle that fits, and its ``centre`` (2,) um."""

    fraction: float
    hydraulic_radius: float
    largest: float
    centre: FloatArray


def tow_image(
    fabric: Fabric, positions: FloatArray, cut: tuple[int, float], limits: FloatArray, pixel: float
) -> IntArray:
    """(rows, columns) tow that fills each pixel of a plane section, -1 where there is none; rows go up.

    ``cut`` (axis, place um) as of :func:`cut_fabric`; ``limits`` (2, 2) um, low and high in the plane and in z. A pixel
    is fibre where its centre lies within a radius of a segment. Periodic images included.
    """
    axis, at = cut
    size = np.maximum(1, np.round((limits[:, 1] - limits[:, 0]) / pixel).astype(int))
    u, z = (limits[k, 0] + (np.arange(size[k]) + 0.5) * pixel for k in (0, 1))
    seen = np.empty((size[1], size[0], 3))
    seen[..., axis], seen[..., 1 - axis], seen[..., 2] = at, u[None, :], z[:, None]
    tow, distance = _nearest_tow(fabric, positions, plane_frame(fabric.system, axis).back(seen.reshape(-1, 3)))
    return np.where(distance <= 0, tow, -1).reshape(size[1], size[0])


def _nearest_tow(fabric: Fabric, positions: FloatArray, points: FloatArray) -> tuple[IntArray, FloatArray]:
    """Tow whose surface is nearest to each point, and the distance of that surface (below 0 inside), um."""
    system = fabric.system
    segments, period = segments_of(system, positions), period_of(system)
    best = np.full(len(points), np.inf)
    tow = np.full(len(points), -1, dtype=np.int64)
    inside = _in_cell(system, points)
    for kind in np.unique(system.filament_type):
        chosen = np.flatnonzero(system.filament_type[segments.filament] == kind)
        radius = system.types[int(kind)].diameter / 2
        length = np.linalg.norm(segments.vector[chosen], axis=1)
        n = np.maximum(1, np.ceil(length / (radius / 2))).astype(np.int64)
        segment = np.repeat(chosen, n)
        share = (np.arange(len(segment)) - np.repeat(np.cumsum(n) - n, n) + 0.5) / np.repeat(n, n)
        sample = _in_cell(system, segments.start[segment] + share[:, None] * segments.vector[segment])
        count = min(3, len(segment))
        tree, of = _tree(sample, period, system.tilt)
        _, near = tree.query(inside, k=count)
        for k in of[np.reshape(near, (len(points), -1))].T:
            shift = whole_periods(inside - sample[k], period, system.tilt)
            start = sample[k] + shift - share[k, None] * segments.vector[segment[k]]
            vector = segments.vector[segment[k]]
            along = np.clip(np.sum((inside - start) * vector, 1) / np.sum(vector * vector, 1), 0, 1)
            d = np.linalg.norm(start + along[:, None] * vector - inside, axis=1) - radius
            nearer = d < best
            best[nearer], tow[nearer] = d[nearer], system.tow[segments.filament[segment[k][nearer]]]
    return tow, best


def _tree(points: FloatArray, period: FloatArray, tilt: float) -> tuple[cKDTree, IntArray]:
    """A tree that finds the nearest of ``points`` (n, 3), put into the cell, and which point each of its own is.

    The images around a tilted cell are points of the tree.
    """
    of = np.arange(len(points))
    if not (tilt and period[1] > 0):
        return cKDTree(points, boxsize=period if period.any() else None), of
    steps = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    shifts = np.column_stack([steps @ [period[0], tilt], steps[:, 1] * period[1], np.zeros(len(steps))])
    return cKDTree((points + shifts[:, None]).reshape(-1, 3)), np.tile(of, len(steps))


def _in_cell(system: FilamentSystem, points: FloatArray) -> FloatArray:
    """Points put back into the cell, whose corner is the origin."""
    period = period_of(system)
    out = wrapped(points - np.where(period > 0, system.box[:, 0], 0.0), period, system.tilt)
    if system.tilt and period[1] > 0:
        out[:, 0] += out[:, 1] * system.tilt / period[1]
    return out


def room_between(image: IntArray, pixel: float) -> Room:
    """Void of a picture as of :func:`tow_image`, by Euclidean distance and by Cauchy and Crofton's formula.

    Length of the outline = pi/2 times the mean over four directions of the crossings of its pixel lines times their
    distance; within 2 % for curves of many pixels. The picture's edge is no wall; circles may not cross it.
    """
    void = image < 0
    if not void.any():
        return Room(0.0, 0.0, 0.0, np.full(2, np.nan))
    straight = np.count_nonzero(void[1:] != void[:-1]) + np.count_nonzero(void[:, 1:] != void[:, :-1])
    slanted = np.count_nonzero(void[1:, 1:] != void[:-1, :-1]) + np.count_nonzero(void[1:, :-1] != void[:-1, 1:])
    length = np.pi / 8 * pixel * (straight + slanted / np.sqrt(2))
    # fibre pixels' centres: the surface lies half a pixel nearer
    depth = np.asarray(distance_transform_edt(np.pad(void, 1)))[1:-1, 1:-1]
    at = np.unravel_index(int(np.argmax(depth)), depth.shape)
    return Room(
        fraction=float(np.mean(void)),
        hydraulic_radius=float(np.sum(void)) * pixel**2 / length if length > 0 else float("inf"),
        largest=float(depth[at] - 0.5) * pixel,
        centre=(np.array([at[1], at[0]]) + 0.5) * pixel,
    )


def open_area(fabric: Fabric, positions: FloatArray, pixel: float) -> float:
    """Share of the plane that no filament covers, seen along z: where a straight line passes through the fabric.

    Over the periodic cell, or the rectangle (sheared with it) of a patch's centre lines. ``pixel`` um.
    """
    system, period = fabric.system, period_of(fabric.system)
    flat = positions.copy()
    flat[:, 2] = 0.0
    upright = system.upright(positions[:, :2])
    low = np.where(period[:2] > 0, system.box[:2, 0], upright.min(axis=0))
    high = np.where(period[:2] > 0, system.box[:2, 1], upright.max(axis=0))
    n = np.maximum(1, np.round((high - low) / pixel).astype(int))
    x, y = (low[k] + (np.arange(n[k]) + 0.5) * (high[k] - low[k]) / n[k] for k in (0, 1))
    grid = np.stack([*np.meshgrid(x, y, indexing="ij"), np.zeros((n[0], n[1]))], axis=-1).reshape(-1, 3)
    if system.tilt:
        grid[:, 0] += grid[:, 1] * system.tilt / float(np.ptp(system.box[1]))
    return float(np.mean(_nearest_tow(fabric, flat, grid)[1] > 0))
