"""Voids between the filaments of a section, and maps of volume fraction: where the room for resin is.

A section is an array of centres (n_filaments, 2): y across and z along the compaction, um. A void is the room round one
locally largest empty circle: the triangles of the Delaunay triangulation of the centres, put together as they drain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, QhullError

from cgfibre.build.system import FloatArray, IntArray
from cgfibre.errors import InputError
from cgfibre.measure.distribution import checked_centres, checked_radii

#: two voids are one where the throat between them is this share of the smaller's largest circle; in a hexagonal lattice
#: it never is (sqrt(3)/2 at most), in a square one that is a little out of order it always is
SAME_VOID = 0.9
#: a circle whose middle lies on a side to this share of the triangle's height is that of both triangles
LEVEL = 1e-9


@dataclass(frozen=True)
class Voids:
    """Voids between filaments, none of those that open outwards.

    ``area`` (n_voids,) um2; ``wetted`` (n_voids,) length of filament surface round each, um; ``radius`` (n_voids,) of
    the largest circle in each, um, and its ``centre`` (n_voids, 2); ``throat`` (n_throats,) widths of the gaps
    between two filaments that lead from one void to the next, um (0: they touch). ``corners`` (n_triangles, 3) indices
    of filaments and ``void`` (n_triangles,): the triangles that make up the voids, for drawing.
    """

    area: FloatArray
    wetted: FloatArray
    radius: FloatArray
    centre: FloatArray
    throat: FloatArray
    corners: IntArray
    void: IntArray

    def __len__(self) -> int:
        return len(self.area)

    @property
    def hydraulic_radius(self) -> float:
        """Area of all voids over their wetted length, um; inside a lattice (1 - Vf) D/(4 Vf). nan without voids."""
        wetted = float(np.sum(self.wetted))
        return float(np.sum(self.area)) / wetted if wetted > 0 else float("nan")


def _none() -> Voids:
    empty, index = np.zeros(0), np.zeros(0, dtype=np.int64)
    return Voids(empty, empty, empty, np.zeros((0, 2)), empty, np.zeros((0, 3), dtype=np.int64), index)


def find_voids(centres: ArrayLike, diameter: ArrayLike, probe: float | None = None) -> Voids:
    """The voids between filaments: areas, wetted lengths, largest circles and the throats between them.

    Each Delaunay triangle of the centres holds the circle that touches its three discs. Where the middle of that
    circle lies beyond a side, the triangle belongs to the void beyond (the flow of Edelsbrunner, Facello and Liang,
    Discrete Applied Mathematics 88, 1998, 83); so do triangles with a gap between them that is wider than ``probe``
    (um; None: the largest diameter) or as wide as they are (:data:`SAME_VOID`). What then runs out over the edge of the
    triangulation is no void but outside: bays, the gaps along a platen, open sides.

    Area of a triangle's void: its own less the sectors of its discs, plus half of each lens in which two discs overlap.
    Hexagonal lattice of pitch p: sqrt(3) p^2/4 - pi D^2/8 each with a circle of radius p/sqrt(3) - D/2; square lattice:
    p^2 - pi D^2/4, p/sqrt(2) - D/2; wetted pi D/2 and pi D. ``centres`` (n, 2) um; ``diameter`` one value or (n,). The
    triangulation is exact for equal diameters, near enough for those of one kind of filament. None are found among
    fewer than three filaments or along one row.
    """
    c = checked_centres(centres)
    r = checked_radii(diameter, len(c))
    reach = 2 * float(r.max()) if probe is None else probe
    if not reach >= 0:
        raise InputError("probe", probe, "zero or more")
    if len(c) < 3:
        return _none()
    try:
        mesh = Delaunay(c)
    except QhullError:  # one row
        return _none()
    corners = mesh.simplices.astype(np.int64)
    n = len(corners)
    area, wetted = _triangle_voids(c, r, corners)
    middle, radius, weight = _touching_circles(c, r, corners)
    # side k of a triangle lies opposite corner k; everything beyond the hull is node n
    gap = np.stack([_gap(c, r, corners[:, (k + 1) % 3], corners[:, (k + 2) % 3]) for k in range(3)], axis=1)
    beyond = np.where(mesh.neighbors < 0, n, mesh.neighbors).astype(np.int64)
    here = np.broadcast_to(np.arange(n)[:, None], beyond.shape)
    open_side = gap > reach
    least = weight.min(axis=1)
    flows = (np.arange(3) == np.argmin(weight, axis=1)[:, None]) & (least < LEVEL)[:, None]
    basin = _joined(here[open_side | flows], beyond[open_side | flows], n + 1)
    # circles whose middle lies in their own triangle are the largest of their void
    own = np.where(least > -LEVEL, radius, 0.0)
    largest = np.zeros(basin.max() + 1)
    np.maximum.at(largest, basin[:n], own)
    largest[basin[n]] = np.inf
    one, other = basin[here], basin[beyond]
    alike = (one != other) & (gap / 2 >= SAME_VOID * np.minimum(largest[one], largest[other]))
    basin = _joined(one[alike], other[alike], len(largest))[basin]
    inside = basin[:n] != basin[n]
    if not inside.any():
        return _none()
    names, void = np.unique(basin[:n][inside], return_inverse=True)
    total = [np.bincount(void, values[inside], len(names)).astype(float) for values in (area, wetted)]
    # a void's largest circle: the last of its triangles in order of radius
    own, middle = own[inside], middle[inside]
    order = np.argsort(own, kind="stable")
    best = np.zeros(len(names), dtype=np.int64)
    best[void[order]] = order
    leads = (basin[here] < basin[beyond]) & (basin[here] != basin[n]) & (basin[beyond] != basin[n])
    return Voids(
        area=np.maximum(total[0], 0.0),
        wetted=total[1],
        radius=np.maximum(own[best], 0.0),
        centre=middle[best],
        throat=np.maximum(gap[leads], 0.0),
        corners=corners[inside],
        void=void.astype(np.int64),
    )


def _joined(one: IntArray, other: IntArray, n: int) -> IntArray:
    """(n,) number of the group of each node under these links."""
    links = coo_array((np.ones(len(one), dtype=np.int8), (one, other)), shape=(n, n))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)


def _gap(c: FloatArray, r: FloatArray, i: IntArray, j: IntArray) -> FloatArray:
    """Distance of the surfaces of filaments i and j; below 0 where they overlap."""
    return np.asarray(np.hypot(*(c[i] - c[j]).T) - r[i] - r[j])


def _triangle_voids(c: FloatArray, r: FloatArray, corners: IntArray) -> tuple[FloatArray, FloatArray]:
    """(n_triangles,) void area and wetted length of each triangle."""
    a, b, d = (c[corners[:, k]] for k in range(3))
    u, v = b - a, d - a
    area = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    wetted = np.zeros(len(corners))
    for k in range(3):
        i, j, m = (corners[:, (k + s) % 3] for s in range(3))
        u, v = c[j] - c[i], c[m] - c[i]
        angle = np.abs(np.arctan2(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0], (u * v).sum(axis=1)))
        area -= angle * r[i] ** 2 / 2
        wetted += angle * r[i]
        # the lens of i and j is symmetric about the side: half of it lies here
        apart = np.hypot(u[:, 0], u[:, 1])
        for p, q in ((i, j), (j, i)):
            cosine = (apart**2 + r[p] ** 2 - r[q] ** 2) / (2 * apart * r[p])
            inside = np.arccos(np.clip(cosine, -1.0, 1.0))
            area += r[p] ** 2 * (inside - np.sin(inside) * np.cos(inside)) / 2
            wetted -= r[p] * inside
    return area, wetted


def _touching_circles(c: FloatArray, r: FloatArray, corners: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Middle (n, 2) and radius (n,) of the circle that touches three discs from between; barycentric coordinates of
    the middle (n, 3): a negative one says that it lies beyond the side opposite that corner.

    |x - c_i| = rho + r_i (problem of Apollonius): the differences of the squares are linear in x and rho.
    """
    a, ra = c[corners[:, 0]], r[corners[:, 0]]
    u, v = c[corners[:, 1]] - a, c[corners[:, 2]] - a
    rb, rc = r[corners[:, 1]], r[corners[:, 2]]
    twice = 2 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])

    def solve(f: FloatArray, g: FloatArray) -> FloatArray:
        x = np.stack([f * v[:, 1] - g * u[:, 1], g * u[:, 0] - f * v[:, 0]], axis=1)
        return np.asarray(x / twice[:, None])

    with np.errstate(divide="ignore", invalid="ignore"):
        fixed = solve((u**2).sum(1) + ra**2 - rb**2, (v**2).sum(1) + ra**2 - rc**2)
        slope = solve(2 * (ra - rb), 2 * (ra - rc))
        # |fixed + slope rho|^2 = (rho + ra)^2
        p2 = 1 - (slope**2).sum(1)
        p1 = ra - (fixed * slope).sum(1)
        p0 = ra**2 - (fixed**2).sum(1)
        root = np.sqrt(np.maximum(p1**2 - p2 * p0, 0.0))
        radius = -p0 / (p1 + root)
        at = fixed + slope * radius[:, None]
        along_u = 2 * (at[:, 0] * v[:, 1] - at[:, 1] * v[:, 0]) / twice
        along_v = 2 * (u[:, 0] * at[:, 1] - u[:, 1] * at[:, 0]) / twice
    weight = np.stack([1 - along_u - along_v, along_u, along_v], axis=1)
    return a + at, radius, np.where(np.isfinite(weight), weight, 0.0)


@dataclass(frozen=True)
class FractionMap:
    """Volume fraction on a grid: edges ``y`` (n_y + 1,) and ``z`` (n_z + 1,) of its cells, um; ``fraction`` (n_z, n_y)
    of each cell that filaments cover, or of the window about it."""

    y: FloatArray
    z: FloatArray
    fraction: FloatArray

    @property
    def void_fraction(self) -> FloatArray:
        """(n_z, n_y) share that filaments leave free."""
        return 1 - self.fraction


def fraction_map(
    centres: ArrayLike, diameter: ArrayLike, cell: float, window: float = 0.0, box: ArrayLike | None = None
) -> FractionMap:
    """Volume fraction on a grid of square cells of about ``cell`` um, averaged over a square ``window`` um wide.

    A cell's fraction is the exact area of the discs in it; the window takes the whole cells nearest to its width, an
    odd number, and ends at the box. ``box`` (2, 2) um: low and high y, low and high z; None: round the discs. Sum of
    fraction x cell area is the discs' area within the box as long as they do not overlap and no window is asked for.
    ``centres`` (n, 2) um; ``diameter`` one value or (n,). Raises InputError for a box or a cell without size.
    """
    c = checked_centres(centres)
    r = checked_radii(diameter, len(c))
    if box is None:
        low, high = (c - r[:, None]).min(axis=0), (c + r[:, None]).max(axis=0)
    else:
        limits = np.asarray(box, dtype=float)
        if limits.shape != (2, 2) or not np.all(limits[:, 1] > limits[:, 0]):
            raise InputError("box", box, "((low y, high y), (low z, high z))")
        low, high = limits[:, 0], limits[:, 1]
    if not cell > 0 or not window >= 0:
        raise InputError("cell", (cell, window), "a cell above zero, a window of zero or more")
    n = np.maximum(np.round((high - low) / cell).astype(int), 1)
    if n.prod() > 50_000_000:
        raise InputError("cell", cell, "at most 5e7 cells")
    size = (high - low) / n
    covered = np.zeros((n[1], n[0]))
    # corners of the cells that a disc may reach, about its own; beyond the box they do not count
    first = np.floor((c - r[:, None] - low) / size).astype(int)
    most = np.ceil(2 * r.max() / size).astype(int) + 1
    for part in np.array_split(np.arange(len(c)), max(1, len(c) * int(most.prod()) // 2_000_000)):
        iy = first[part, 0, None] + np.arange(most[0] + 1)
        iz = first[part, 1, None] + np.arange(most[1] + 1)
        y = (low[0] + iy * size[0] - c[part, 0, None]) / r[part, None]
        z = (low[1] + iz * size[1] - c[part, 1, None]) / r[part, None]
        corner = disc_below(y[:, None, :], z[:, :, None]) * r[part, None, None] ** 2
        inside = np.diff(np.diff(corner, axis=1), axis=2)
        row = np.broadcast_to(iz[:, :-1, None], inside.shape)
        column = np.broadcast_to(iy[:, None, :-1], inside.shape)
        keep = (row >= 0) & (row < n[1]) & (column >= 0) & (column < n[0])
        np.add.at(covered, (row[keep], column[keep]), inside[keep])
    covered /= size.prod()
    for axis, width in ((0, size[1]), (1, size[0])):
        covered = _averaged(covered, axis, 2 * round((window / width - 1) / 2) + 1 if window > width else 1)
    y, z = (low[k] + size[k] * np.arange(n[k] + 1) for k in range(2))
    return FractionMap(y, z, np.clip(covered, 0.0, 1.0))


def _averaged(values: FloatArray, axis: int, window: int) -> FloatArray:
    """Running mean over ``window`` (odd) entries, fewer at the ends."""
    n = values.shape[axis]
    low = np.maximum(np.arange(n) - window // 2, 0)
    high = np.minimum(np.arange(n) + window // 2 + 1, n)
    zero = np.zeros_like(np.take(values, [0], axis=axis))
    total = np.concatenate([zero, np.cumsum(values, axis=axis)], axis=axis)
    count = np.expand_dims(high - low, 1 - axis)
    return np.asarray((np.take(total, high, axis=axis) - np.take(total, low, axis=axis)) / count)


def disc_below(x: ArrayLike, y: ArrayLike) -> FloatArray:
    """Area of the unit disc where X <= x and Y <= y; arrays broadcast.

    With S(t) = pi/2 + t sqrt(1 - t^2) + asin t, the area where X <= t: a corner (x, y) inside the disc leaves
    x y + (S(x) + S(y))/2 - pi/4; outside it S(x) + S(y) - pi for x, y >= 0, else the lesser of the two, or nothing.
    """
    x, y = np.broadcast_arrays(np.clip(np.asarray(x, float), -1, 1), np.clip(np.asarray(y, float), -1, 1))
    sx, sy = (np.pi / 2 + t * np.sqrt(1 - t**2) + np.arcsin(t) for t in (x, y))
    outside = np.select([(x >= 0) & (y >= 0), y >= 0, x >= 0], [sx + sy - np.pi, sx, sy], 0.0)
    return np.where(x**2 + y**2 < 1, x * y + (sx + sy) / 2 - np.pi / 4, outside)
