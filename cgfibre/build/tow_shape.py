"""Cross-sections of tows: symmetric convex outlines of a width and a thickness, described by their support function.

Section coordinates are (y, z): y across the tow (its width), z through it (its thickness), the axis at the origin.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from cgfibre.build.system import BoolArray, FloatArray
from cgfibre.errors import InputError

Section = Literal["circular", "elliptic", "lenticular", "rectangular", "racetrack"]
SECTIONS: tuple[str, ...] = get_args(Section)
#: directions in which a section is measured: half a degree apart
DIRECTIONS = 720


@dataclass(frozen=True)
class TowShape:
    """A tow's section.

    Attributes
    ----------
    section : "circular" (width = thickness); "elliptic"; "lenticular", two arcs of radius (w^2 + t^2) / (4 t);
        "rectangular"; "racetrack", a rectangle w - t wide with two half circles of radius t / 2 at its ends
    width : um, across the tow
    thickness : um, at its middle

    Raises :class:`InputError` for an unknown section, sizes not above 0, a width below the thickness, and a circle
    whose width is not its thickness.
    """

    section: Section
    width: float
    thickness: float

    def __post_init__(self) -> None:
        if self.section not in SECTIONS:
            raise InputError("tow.section", self.section, "one of " + ", ".join(SECTIONS))
        for key in ("width", "thickness"):
            value = getattr(self, key)
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"tow.{key}", value, "a finite length above 0")
        if self.section == "circular" and abs(self.width - self.thickness) > 1e-9 * self.width:
            raise InputError("tow.width", self.width, f"the thickness, {self.thickness:g} um, for a circular section")
        if self.width < self.thickness * (1.0 - 1e-9):
            raise InputError("tow.width", self.width, f"at least the thickness, {self.thickness:g} um")

    @property
    def arc_radius(self) -> float:
        """Radius in um of the arcs of a lenticular section, (w^2 + t^2) / (4 t)."""
        return (self.width**2 + self.thickness**2) / (4.0 * self.thickness)

    @property
    def area(self) -> float:
        """Area in um2; of the lens R^2 (2 a - sin 2 a) with sin a = w / (2 R)."""
        w, t = self.width, self.thickness
        if self.section in ("circular", "elliptic"):
            return float(np.pi * w * t / 4.0)
        if self.section == "rectangular":
            return w * t
        if self.section == "racetrack":
            return float((w - t) * t + np.pi * t**2 / 4.0)
        a = float(np.arcsin(min(0.5 * w / self.arc_radius, 1.0)))
        return float(self.arc_radius**2 * (2.0 * a - np.sin(2.0 * a)))

    def half_thickness_at(self, y: FloatArray | float) -> FloatArray:
        """Half the thickness in um at ``y`` um from the middle (any shape); 0 outside the width."""
        y = np.abs(np.asarray(y, dtype=float))
        w, t = self.width, self.thickness
        if self.section in ("circular", "elliptic"):
            z = 0.5 * t * np.sqrt(np.maximum(1.0 - (2.0 * y / w) ** 2, 0.0))
        elif self.section == "rectangular":
            z = np.full_like(y, 0.5 * t)
        elif self.section == "racetrack":
            z = np.sqrt(np.maximum(0.25 * t**2 - np.maximum(y - 0.5 * (w - t), 0.0) ** 2, 0.0))
        else:
            z = np.sqrt(np.maximum(self.arc_radius**2 - y**2, 0.0)) - (self.arc_radius - 0.5 * t)
        return np.where(y <= 0.5 * w, np.maximum(z, 0.0), 0.0)

    def support(self, direction: FloatArray) -> FloatArray:
        """h(n) = max of n . x over the section, um, for unit ``direction`` (..., 2); even in both components."""
        n = np.abs(np.asarray(direction, dtype=float))
        ny, nz = n[..., 0], n[..., 1]
        a, b = 0.5 * self.width, 0.5 * self.thickness
        if self.section in ("circular", "elliptic"):
            return np.asarray(np.hypot(a * ny, b * nz))
        if self.section == "rectangular":
            return np.asarray(a * ny + b * nz)
        if self.section == "racetrack":
            return np.asarray((a - b) * ny + b)
        r = self.arc_radius
        return np.asarray(np.where(r * ny <= a, r - (r - b) * nz, a * ny))

    def edge(self, angle: FloatArray | float) -> FloatArray:
        """(..., 2) point of the outline whose outward normal is (sin angle, cos angle), 0 <= angle <= pi/2.

        Where a straight side has that normal, its outer end (larger y for 0, lower z for pi/2 keeps 0).
        """
        angle = np.asarray(angle, dtype=float)
        s, c = np.sin(angle), np.cos(angle)
        a, b = 0.5 * self.width, 0.5 * self.thickness
        if self.section in ("circular", "elliptic"):
            h = np.hypot(a * s, b * c)
            return np.stack([a * a * s / h, b * b * c / h], axis=-1)
        if self.section == "rectangular":
            return np.stack([np.full_like(s, a), np.full_like(s, b)], axis=-1)
        if self.section == "racetrack":
            return np.stack([a - b + b * s, b * c], axis=-1)
        r = self.arc_radius
        tip = r * s > a
        return np.stack([np.where(tip, a, r * s), np.where(tip, 0.0, r * c - (r - b))], axis=-1)

    def outline(self, n: int = 200) -> FloatArray:
        """(n, 2) points of the outline at equal arc length, anticlockwise from (w/2, 0)."""
        angle = np.linspace(0.5 * np.pi, 0.0, 2000)
        quarter = self.edge(angle)
        a, b = 0.5 * self.width, 0.5 * self.thickness
        quarter = np.concatenate([[[a, 0.0]], quarter, [[0.0, b]]])
        right = np.concatenate([quarter, quarter[::-1] * (-1.0, 1.0)])
        ring = np.concatenate([right, -right])
        s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(ring, axis=0).T))])
        at = np.arange(n) * s[-1] / n
        return np.column_stack([np.interp(at, s, ring[:, 0]), np.interp(at, s, ring[:, 1])])

    def signed_distance(self, points: FloatArray) -> FloatArray:
        """(n,) distance in um of ``points`` (n, 2) from the outline, negative inside: max over n of n . x - h(n).

        The best of :data:`DIRECTIONS` directions and a parabola through its neighbours: 1e-8 of the distances
        involved. Inside it is the depth under the nearest tangent, which is the distance from the outline.
        """
        step, quarter = 2.0 * np.pi / DIRECTIONS, DIRECTIONS // 4
        # the section is symmetric: one quadrant says all, and a direction beyond its ends where the outline is smooth
        first = -1 if self.section in ("circular", "elliptic", "lenticular") else 0
        last = quarter + (1 if self.section in ("circular", "elliptic", "racetrack") else 0)
        angle = step * np.arange(first, last + 1)
        n = np.column_stack([np.sin(angle), np.cos(angle)])
        beyond = np.abs(points) @ n.T - self.support(n)
        best, row = np.argmax(beyond, axis=1), np.arange(len(beyond))
        k = np.clip(best, 1, len(n) - 2)
        before, here, after = (beyond[row, k + step] for step in (-1, 0, 1))
        bend = 2.0 * here - before - after
        gain = (before - after) ** 2 / (8.0 * np.where(bend > 0.0, bend, 1.0))
        return np.asarray(beyond[row, best] + np.where((k == best) & (bend > 0.0), gain, 0.0))

    def contains(self, points: FloatArray, margin: float = 0.0) -> BoolArray:
        """(n,) whether ``points`` (n, 2) lie inside, at least ``margin`` um from the outline."""
        return np.asarray(self.signed_distance(points) <= -margin)
