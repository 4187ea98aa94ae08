"""Where the filaments of a section are: normalised coordinates, local volume fraction, neighbours, outline.

A section is an array of centres (n_filaments, 2): y across and z along the compaction, um.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import special
from scipy.spatial import Voronoi, cKDTree

from cgfibre.build.system import FilamentSystem, FloatArray, IntArray
from cgfibre.errors import InputError

#: directions that sample the hull of the discs: its area comes out low by at most 2e-4
N_DIRECTIONS = 360


@dataclass(frozen=True)
class Normalisation:
    """Origin (2,) and half size (2,) in um by which coordinates are normalised (thesis Eq 7-5)."""

    centre: FloatArray
    half_size: FloatArray


@dataclass(frozen=True)
class Distribution:
    """Gaussian description of normalised filament coordinates; every array has y in 0 and z in 1.

    ``coordinates`` (n_filaments, 2), normalised; ``mean`` and ``sd`` (2,) of the fitted Gaussian (sd with n - 1);
    quality of the fit: ``ks_distance`` (2,) largest distance between the cumulative distributions (0 is perfect),
    ``r_squared`` (2,) of the normal probability plot (1 is perfect).
    """

    coordinates: FloatArray
    mean: FloatArray
    sd: FloatArray
    ks_distance: FloatArray
    r_squared: FloatArray

    def density(self, axis: int, at: ArrayLike) -> FloatArray:
        """Density f(x) = exp(-(x - mu)^2/(2 sd^2))/(sd sqrt(2 pi)) along axis 0 (y) or 1 (z) (thesis Eq 7-4)."""
        z = (np.asarray(at, dtype=float) - self.mean[axis]) / self.sd[axis]
        return np.asarray(np.exp(-(z**2) / 2) / (self.sd[axis] * np.sqrt(2 * np.pi)))


def checked_centres(centres: ArrayLike, least: int = 1) -> FloatArray:
    """Centres as an array (n, 2); InputError for another shape, fewer than ``least`` or values that are not finite."""
    c = np.asarray(centres, dtype=float)
    if c.ndim != 2 or c.shape[1] != 2 or len(c) < least:
        raise InputError("centres", c.shape, f"shape (n, 2) with n at least {least}")
    if not np.all(np.isfinite(c)):
        raise InputError("centres", int(np.sum(~np.isfinite(c).all(axis=1))), "finite centres only (mask the others)")
    return c


def checked_radii(diameter: ArrayLike, n: int, zero: bool = False) -> FloatArray:
    """(n,) radii of one diameter or n; InputError for others and for those not above zero (``zero``: below it)."""
    d = np.asarray(diameter, dtype=float)
    if d.ndim > 1 or (d.ndim == 1 and len(d) != n) or not np.all(d >= 0 if zero else d > 0):
        raise InputError("diameter", diameter, f"one value or {n} values, above zero")
    return np.broadcast_to(d / 2, (n,))


def section_at(system: FilamentSystem, positions: FloatArray, x: float) -> FloatArray:
    """(n_filaments, 2) y and z of every filament where it passes the plane at ``x`` (um), linearly between beads.

    ``positions`` (n_beads, 3) um, unwrapped. A filament that passes the plane several times counts at its first
    passing; one that does not reach it gives nan. Periodic images of the plane count. Filaments of one bead (sections)
    are where their bead is. Raises InputError for positions of another shape.
    """
    if positions.shape != (system.n_beads, 3):
        raise InputError("positions", positions.shape, f"shape ({system.n_beads}, 3)")
    out = np.full((system.n_filaments, 2), np.nan)
    single = np.diff(system.filament_start) == 1
    out[single] = positions[system.first_beads[single], 1:]
    bonds = system.bonds()
    start = positions[bonds[:, 0]]
    d = positions[bonds[:, 1]] - start
    size = system.box[:, 1] - system.box[:, 0]
    for axis in np.flatnonzero(system.periodic):
        d[:, axis] -= size[axis] * np.round(d[:, axis] / size[axis])
    low = np.minimum(start[:, 0], start[:, 0] + d[:, 0])
    plane = np.full(len(bonds), float(x))
    if system.periodic[0]:
        plane += size[0] * np.ceil((low - x) / size[0])
    hit = np.flatnonzero((plane >= low) & (plane <= low + np.abs(d[:, 0])))
    filament, first = np.unique(system.filament_of_bead[bonds[hit, 0]], return_index=True)
    hit = hit[first]
    run = d[hit, 0]
    # a segment that lies in the plane is taken at its first bead
    share = np.divide(plane[hit] - start[hit, 0], run, out=np.zeros(len(hit)), where=run != 0)
    out[filament] = start[hit, 1:] + share[:, None] * d[hit, 1:]
    return out


def bundle_size(centres: ArrayLike, diameter: ArrayLike) -> tuple[float, float]:
    """Width (y) and thickness (z) of the bundle in um, outer surfaces of the discs included.

    ``centres`` (n, 2) um; ``diameter`` one value or (n,), um.
    """
    c = checked_centres(centres)
    r = checked_radii(diameter, len(c))[:, None]
    size = (c + r).max(axis=0) - (c - r).min(axis=0)
    return float(size[0]), float(size[1])


def normalisation(centres: ArrayLike, diameter: ArrayLike) -> Normalisation:
    """Origin and overall half width and half thickness of an uncompacted bundle (thesis Eq 7-5).

    The half sizes include the filament's radius (the assembly's overall radii of Eq 7-5). The thesis' own program (E.6)
    divides by the largest coordinate of a centre instead: pass ``diameter=0`` for that. Raises InputError where a half
    size would then be zero.
    """
    c = checked_centres(centres)
    r = checked_radii(diameter, len(c), zero=True)[:, None]
    low, high = (c - r).min(axis=0), (c + r).max(axis=0)
    if np.any(high <= low):
        raise InputError("diameter", diameter, "above zero for a bundle of one row or column")
    return Normalisation(centre=(low + high) / 2, half_size=(high - low) / 2)


def fit_distribution(centres: ArrayLike, reference: Normalisation) -> Distribution:
    """Mean and s.d. of the normalised coordinates (c - c0)/R, as a Gaussian (thesis Eqs 7-4, 7-5, E.6).

    ``centres`` (n, 2) um, n at least 3; ``reference`` from the bundle *before* compaction, for the states before and
    after alike. Coordinates of the reference state lie in -1..1 (the thesis' "between 0 and 1" is their magnitude). A
    coordinate that does not vary (a single row) has sd 0, ks_distance 1 and r_squared nan.
    """
    coordinates = (checked_centres(centres, least=3) - reference.centre) / reference.half_size
    mean, sd = coordinates.mean(axis=0), coordinates.std(axis=0, ddof=1)
    ks, r2 = np.ones(2), np.full(2, np.nan)
    n = len(coordinates)
    rank = np.arange(1, n + 1)
    # medians of order statistics (Filliben), as scipy.stats.probplot has them; scipy.stats itself takes 0.3 s to import
    median = (rank - 0.3175) / (n + 0.365)
    median[0], median[-1] = 1 - 0.5 ** (1 / n), 0.5 ** (1 / n)
    for axis in np.flatnonzero(sd > 1e-12):
        ordered = np.sort(coordinates[:, axis])
        below = special.ndtr((ordered - mean[axis]) / sd[axis])
        ks[axis] = max(np.max(rank / n - below), np.max(below - (rank - 1) / n))
        r2[axis] = np.corrcoef(special.ndtri(median), ordered)[0, 1] ** 2
    return Distribution(coordinates=coordinates, mean=mean, sd=sd, ks_distance=ks, r_squared=r2)


def polygon_area(vertices: ArrayLike) -> float:
    """Area of a closed polygon (n, 2) by the shoelace formula, (1/2) |sum(y_i z_i+1 - y_i+1 z_i)| (thesis E.2).

    With the centres of the outer layer in order this is the area of the thesis: ``polygon_area(centres[outer])``.
    """
    v = checked_centres(vertices, least=3)
    v = v - v[0]
    following = np.roll(v, -1, axis=0)
    return float(abs(np.sum(v[:, 0] * following[:, 1] - v[:, 1] * following[:, 0])) / 2)


def outline(centres: ArrayLike, diameter: ArrayLike) -> FloatArray:
    """(n_vertices, 2) convex outline of the discs, counter-clockwise, um: the hull of the centres grown by the radius.

    The outermost point of the discs in each of :data:`N_DIRECTIONS` directions; inscribed in the exact hull. Defined
    for a single filament or a row as well. ``diameter`` one value or (n,), um.
    """
    c = checked_centres(centres)
    r = checked_radii(diameter, len(c))
    angle = 2 * np.pi * np.arange(N_DIRECTIONS) / N_DIRECTIONS
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    farthest = np.argmax(c @ direction.T + r[:, None], axis=0)
    return c[farthest] + r[farthest, None] * direction


def area_strain(area: ArrayLike, initial_area: float) -> FloatArray:
    """Area strain A/A0 - 1, negative in compaction (thesis 7.4 and E.2; the program there prints the ratio A/A0)."""
    if not initial_area > 0:
        raise InputError("initial_area", initial_area, "above zero")
    return np.asarray(area, dtype=float) / initial_area - 1


def _clip(polygon: FloatArray, normal: FloatArray, offset: float) -> FloatArray:
    """Part of a convex polygon where normal . v <= offset (Sutherland and Hodgman)."""
    height = polygon @ normal - offset
    inside = height <= 0
    following = np.concatenate([polygon[1:], polygon[:1]])
    next_height = np.append(height[1:], height[0])
    crosses = inside != (next_height <= 0)
    step = np.divide(height, height - next_height, out=np.zeros(len(height)), where=crosses)
    cut = polygon + step[:, None] * (following - polygon)
    both = np.stack([polygon, cut], axis=1).reshape(-1, 2)
    return both[np.stack([inside, crosses], axis=1).ravel()]


def _clip_all(polygon: FloatArray, normals: FloatArray, offsets: FloatArray) -> FloatArray:
    """Part of a convex polygon in all half planes; the deepest cut first leaves most of the others nothing to do."""
    for _ in range(len(normals)):
        excess = (polygon @ normals.T - offsets).max(axis=0)
        deepest = int(np.argmax(excess))
        if excess[deepest] <= 1e-12 * np.abs(offsets).max():
            break
        polygon = _clip(polygon, normals[deepest], offsets[deepest])
    return polygon


def _sides(polygon: FloatArray, inside: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Half planes normal . v <= offset of a convex polygon, in either sense, round the point ``inside``."""
    along = np.concatenate([polygon[1:], polygon[:1]]) - polygon
    length = np.hypot(along[:, 0], along[:, 1])
    keep = length > 0
    normals = np.stack([along[keep, 1], -along[keep, 0]], axis=1) / length[keep, None]
    offsets = (normals * polygon[keep]).sum(axis=1)
    outward = np.where(offsets >= normals @ inside, 1.0, -1.0)
    return normals * outward[:, None], offsets * outward


def local_volume_fraction(centres: ArrayLike, diameter: ArrayLike, reach: float | None = None) -> FloatArray:
    """(n,) volume fraction (pi D^2/4)/A of each filament's Voronoi cell.

    Cells are clipped by the bundle's :func:`outline`, the convex hull of the discs; between two flat platens that
    outline lies in their faces. A bay in the outline thus counts as room of the filaments round it; ``reach`` (um), if
    given, also limits a cell to that distance from its centre. The cells are those of equal discs; ``diameter`` one
    value or (n,). Inside a hexagonal lattice of pitch p it is pi D^2/(2 sqrt(3) p^2). Raises InputError for coincident
    centres.
    """
    c = checked_centres(centres)
    r = checked_radii(diameter, len(c))
    hull = outline(c, diameter)
    middle = hull.mean(axis=0)
    c, hull = c - middle, hull - middle
    edge = np.roll(hull, -1, axis=0) - hull
    edge_length = np.linalg.norm(edge, axis=1)
    hull, edge = hull[edge_length > 0], edge[edge_length > 0]
    normals = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / edge_length[edge_length > 0, None]
    offsets = np.einsum("ij,ij->i", hull, normals)
    # far sites close the outer cells; their bisectors lie beyond the hull
    far = 10 * np.abs(hull).max() * np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1], [-1, -1], [1, -1]])
    if len(c) > 1 and nearest_neighbour_distance(c).min() <= 1e-9 * r.max():
        raise InputError("centres", "coincident", "distinct centres")
    diagram = Voronoi(np.concatenate([c, far]))
    inside = (diagram.vertices @ normals.T <= offsets + 1e-9 * r.max()).all(axis=1)
    corner_count = np.array([len(diagram.regions[r]) for r in diagram.point_region[: len(c)]])
    first = np.cumsum(corner_count) - corner_count
    corner = np.concatenate([diagram.regions[r] for r in diagram.point_region[: len(c)]])
    # qhull orders the corners of a 2D cell, in either sense
    v = diagram.vertices[corner] - np.repeat(c, corner_count, axis=0)
    following = np.arange(len(v)) + 1
    following[first + corner_count - 1] = first
    area = np.abs(np.add.reduceat(v[:, 0] * v[following, 1] - v[:, 1] * v[following, 0], first)) / 2
    beyond = ~inside[corner]
    if reach is not None:
        beyond |= (v**2).sum(axis=1) > reach**2
    angle = 2 * np.pi * np.arange(36) / 36
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for i in np.flatnonzero(np.logical_or.reduceat(beyond, first)):
        # a cell has a few sides, the hull hundreds: cut the hull by the sides
        cell = _clip_all(hull, *_sides(v[first[i] : first[i] + corner_count[i]] + c[i], c[i]))
        if reach is not None:
            cell = _clip_all(cell, around, around @ c[i] + reach)
        area[i] = polygon_area(cell)
    return np.pi * r**2 / area


def coordination_number(centres: ArrayLike, diameter: ArrayLike, tolerance: float) -> IntArray:
    """(n,) neighbours of each filament whose surfaces are at most ``tolerance`` um apart (0: touching)."""
    c = checked_centres(centres)
    r = checked_radii(diameter, len(c))
    pairs = cKDTree(c).query_pairs(2 * r.max() + tolerance, output_type="ndarray")
    gap = np.linalg.norm(c[pairs[:, 0]] - c[pairs[:, 1]], axis=1) - r[pairs[:, 0]] - r[pairs[:, 1]]
    return np.bincount(pairs[gap <= tolerance].ravel(), minlength=len(c)).astype(np.int64)


def nearest_neighbour_distance(centres: ArrayLike) -> FloatArray:
    """(n,) distance in um from each centre to the nearest other one; n at least 2."""
    c = checked_centres(centres, least=2)
    return np.asarray(cKDTree(c).query(c, k=[2])[0], dtype=np.float64).ravel()
