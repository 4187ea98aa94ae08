"""Centre lines of tows: dense points with a frame, and beads at equal arc length on them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from cgfibre.build.system import FloatArray
from cgfibre.build.tow_shape import TowShape
from cgfibre.errors import InputError


@dataclass(frozen=True, eq=False)
class TowPath:
    """One tow's centre line, dense, with the frame of its section.

    Attributes
    ----------
    points : (n, 3) um; of a closed path the last point is the first one's periodic image
    tangent : (n, 3) unit vectors along the path
    normal : (n, 3) unit vectors through the tow's thickness (z of the section), square to the tangent
    shape : the section
    closed : whether the tow runs on through the periodic boundary
    is_warp : warp (along x) or weft
    index : of the tow, warp tows first
    crossings : (k,) um, arc length at which the tow crosses another: beads stand there
    """

    points: FloatArray
    tangent: FloatArray
    normal: FloatArray
    shape: TowShape
    closed: bool
    is_warp: bool
    index: int
    crossings: FloatArray = field(default_factory=lambda: np.zeros(0))

    @cached_property
    def arc(self) -> FloatArray:
        """(n,) arc length in um at each point, from 0."""
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))])

    @property
    def arc_length(self) -> float:
        """Length of the path in um."""
        return float(self.arc[-1])

    @property
    def projected_length(self) -> float:
        """Distance in um between the ends in the plane of the fabric."""
        return float(np.hypot(*(self.points[-1] - self.points[0])[:2]))

    @property
    def crimp(self) -> float:
        """Excess length, arc length / projected length - 1."""
        return self.arc_length / self.projected_length - 1.0

    @property
    def crimp_angle(self) -> float:
        """Largest angle in rad between the path and the plane of the fabric."""
        return float(np.arcsin(np.clip(np.max(np.abs(self.tangent[:, 2])), 0.0, 1.0)))

    @property
    def binormal(self) -> FloatArray:
        """(n, 3) unit vectors across the tow (y of the section): normal x tangent."""
        return np.cross(self.normal, self.tangent)

    def at(self, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Points, tangents and normals, (m, 3) each, at arc lengths ``s`` (m,) um between 0 and the arc length."""

        def between(values: FloatArray) -> FloatArray:
            return np.column_stack([np.interp(s, self.arc, values[:, k]) for k in range(3)])

        tangent, normal = between(self.tangent), between(self.normal)
        tangent /= np.linalg.norm(tangent, axis=1)[:, None]
        normal -= np.sum(normal * tangent, axis=1)[:, None] * tangent
        return between(self.points), tangent, normal / np.linalg.norm(normal, axis=1)[:, None]

    def stretched(self, factor: float) -> TowPath:
        """The same path with heights z multiplied by ``factor``, the section square to it."""
        stretch = np.array([1.0, 1.0, factor])
        tangent = self.tangent * stretch
        tangent /= np.linalg.norm(tangent, axis=1)[:, None]
        normal = self.normal - np.sum(self.normal * tangent, axis=1)[:, None] * tangent
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        points = self.points * stretch
        path = replace(self, points=points, tangent=tangent, normal=normal, crossings=np.zeros(0))
        return replace(path, crossings=np.interp(self.crossings, self.arc, path.arc))

    def moved(self, shift: FloatArray) -> TowPath:
        """The same path elsewhere."""
        return replace(self, points=self.points + shift)


def stations(path: TowPath, n: int | None = None, spacing: float | None = None) -> FloatArray:
    """(m,) arc lengths in um of the beads of a path.

    With ``n``, that many at equal arc length (closed: the last one step before the end). With ``spacing``, a bead
    stands at every crossing and those between two crossings are at equal steps of at most ``spacing``; where all
    crossings are equally far apart along the path, all steps are equal.
    Raises :class:`InputError` unless exactly one of both is given, and is above 0.
    """
    total = path.arc_length
    if (n is None) == (spacing is None):
        raise InputError("resample", (n, spacing), "either a number of beads or a spacing")
    if n is not None:
        if n < 2:
            raise InputError("resample.n", n, "at least 2 beads")
        return np.linspace(0.0, total, n + 1)[:-1] if path.closed else np.linspace(0.0, total, n)
    assert spacing is not None
    if not (np.isfinite(spacing) and spacing > 0.0):
        raise InputError("spacing", spacing, "a finite length above 0")
    nodes = path.crossings
    if path.closed:
        if not len(nodes):
            return np.arange(k := max(int(np.ceil(total / spacing - 1e-9)), 3)) * total / k
        nodes = np.append(nodes, nodes[0] + total)
    else:
        nodes = np.unique(np.concatenate([[0.0], nodes, [total]]))
    parts = []
    for a, b in pairwise(nodes):
        k = max(int(np.ceil((b - a) / spacing - 1e-9)), 1)
        parts.append(a + (b - a) * np.arange(k) / k)
    if path.closed:
        s = np.concatenate(parts) % total
        return np.sort(np.where(total - s < 1e-9 * total, 0.0, s))
    return np.concatenate([*parts, [total]])


def resample(path: TowPath, n: int | None = None, spacing: float | None = None) -> FloatArray:
    """(m, 3) um, the beads of a path: its points at :func:`stations`."""
    return path.at(stations(path, n, spacing))[0]
