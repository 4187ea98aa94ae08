"""Filaments inside the section of a tow: (n, 2) um of (y, z) about its axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy.optimize import brentq

from cgfibre.build.packing import ROW, min_distance, relaxed_packing
from cgfibre.build.system import FloatArray
from cgfibre.build.tow_shape import DIRECTIONS, Section, TowShape
from cgfibre.errors import InputError

Packing = Literal["random", "hexagonal"]


@dataclass(frozen=True)
class SectionOutline:
    """A tow's section as an outline for :func:`cgfibre.build.packing.relaxed_packing`.

    ``margin`` um, least depth of a centre, whatever the diameter: filaments of a twisted tow are packed as if thicker,
    but reach to its surface. A centre is inside when n . c <= h(n) - margin for all n; the energy is half the square of
    the largest excess.
    """

    shape: TowShape
    margin: float

    def penalty(self, centres: FloatArray, diameter: float) -> tuple[float, FloatArray]:
        """Energy and its (n, 2) gradient, um2 and um."""
        angle = np.linspace(0.0, 0.5 * np.pi, DIRECTIONS // 4 + 1)
        n = np.column_stack([np.sin(angle), np.cos(angle)])
        # outside the polygon whose corners lie on the outline, not the one whose sides touch it
        depth = self.margin + 1e-4 * self.shape.thickness
        beyond = np.abs(centres) @ n.T - self.shape.support(n) + depth
        worst = np.argmax(beyond, axis=1)
        excess = np.maximum(beyond[np.arange(len(centres)), worst], 0.0)
        return 0.5 * float(excess @ excess), excess[:, None] * n[worst] * np.sign(centres)

    def sample(self, count: int, diameter: float, rng: np.random.Generator) -> FloatArray:
        """(count, 2) um, uniform at random where a filament's centre may be."""
        half = np.array([0.5 * self.shape.width, 0.5 * self.shape.thickness])
        kept, found = [np.zeros((0, 2))], 0
        for _ in range(1000):
            trial = (2.0 * rng.random((4 * count + 64, 2)) - 1.0) * half
            trial = trial[self.shape.contains(trial, self.margin)]
            kept.append(trial)
            found += len(trial)
            if found >= count:
                break
        points = np.concatenate(kept)[:count]
        # a section hardly larger than a filament: the rest starts on its axis
        return np.concatenate([points, 1e-3 * self.margin * rng.standard_normal((count - len(points), 2))])


def packed_section(
    shape: TowShape,
    count: int,
    diameter: float,
    packing: Packing,
    rng: np.random.Generator,
    distance: float | None = None,
    jitter: float = 0.0,
) -> FloatArray:
    """Centres (count, 2) um of filaments that lie wholly inside a section, no two nearer than ``distance`` um.

    "random": as :func:`cgfibre.build.packing.random_packing`, inside the section. "hexagonal": rows along the width,
    the widest lattice of which ``count`` points fit (those deepest inside). ``distance`` None is the diameter;
    ``jitter`` um is the standard deviation of random shifts, after which overlaps are relaxed.
    Raises :class:`InputError` for values out of range and where the filaments were not found to fit.
    """
    if isinstance(count, bool) or int(count) != count or count < 1:
        raise InputError("filaments.count", count, "a whole number of at least 1")
    if packing not in get_args(Packing):
        raise InputError("filaments.packing", packing, "'random' or 'hexagonal'")
    for key, value in (("diameter", diameter), ("distance", diameter if distance is None else distance)):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"filaments.{key}", value, "a finite length above 0")
    if not (np.isfinite(jitter) and jitter >= 0.0):
        raise InputError("filaments.jitter", jitter, "a finite length of at least 0 um")
    apart = diameter if distance is None else max(distance, diameter)
    outline = SectionOutline(shape, 0.5 * diameter)
    fraction = count * np.pi * diameter**2 / (4.0 * shape.area)
    refusal = InputError(
        "filaments.count",
        count,
        f"filaments of {diameter:.4g} um that fit a {shape.section} section of "
        f"{shape.width:.5g} x {shape.thickness:.5g} um "
        f"({packing}, {apart:.4g} um apart; these would fill {fraction:.3f} of it)",
    )
    if diameter > shape.thickness * (1.0 + 1e-9) or fraction > 1.0:
        raise refusal
    if count == 1:
        return np.zeros((1, 2))
    centres = _hexagonal(shape, count, diameter, apart) if packing == "hexagonal" else None
    if packing == "random":
        centres = relaxed_packing(count, apart, outline, rng)
    if centres is None:
        raise refusal
    if jitter > 0.0:
        shaken = relaxed_packing(count, apart, outline, rng, centres + jitter * rng.standard_normal(centres.shape))
        centres = centres if shaken is None else shaken
    return centres


def loosened_section(
    shape: TowShape, centres: FloatArray, diameter: float, distance: float, rng: np.random.Generator
) -> FloatArray:
    """A packing of :func:`packed_section` with no two centres nearer than ``distance`` um, (n, 2) um.

    Filaments that are far enough apart stay where they are, and the others move by about what they lack, so that one
    seed means one specimen whatever distance its bead spacing asks for. Raises :class:`InputError` where they do not
    fit.
    """
    if min_distance(centres) >= distance:
        return centres
    found = relaxed_packing(len(centres), distance, SectionOutline(shape, 0.5 * diameter), rng, centres)
    if found is None:
        expected = f"filaments of {diameter:.4g} um that fit the section {distance:.4g} um apart"
        raise InputError("filaments.count", len(centres), expected)
    return found


def _hexagonal(shape: TowShape, count: int, diameter: float, apart: float) -> FloatArray | None:
    """The widest lattice that has ``count`` points inside, over nine places of its origin; None below ``apart``."""

    def inside(pitch: float, shift: tuple[float, float]) -> FloatArray:
        rows, cols = (int(x / pitch) + 3 for x in (shape.thickness, shape.width))
        j, i = (g.ravel() for g in np.mgrid[-rows : rows + 1, -cols : cols + 1])
        points = pitch * np.column_stack([i + 0.5 * (j % 2) + shift[0], ROW * (j + shift[1])])
        return points[shape.contains(points, 0.5 * diameter * (1.0 - 1e-9))]

    best: tuple[float, FloatArray] | None = None
    # no lattice puts many more points into a section than its area over that of a cell
    widest = max(1.6 * float(np.sqrt(shape.area / (ROW * count))), apart)
    for shift in ((y, z) for y in (0.0, 0.25, 0.5) for z in (0.0, 0.5, 0.25)):
        # points inside against pitch is no monotone function: scan, widest first
        for pitch in np.geomspace(widest, apart, 150):
            if best is not None and pitch <= best[0] * (1.0 + 1e-9):
                break
            points = inside(float(pitch), shift)
            if len(points) >= count:
                best = float(pitch), points
                break
    if best is None:
        return None
    points = best[1]
    depth = np.round(shape.signed_distance(points) / apart, 9)
    keep = np.lexsort([points[:, 0], points[:, 1], depth])[:count]
    return np.asarray(points[np.sort(keep)])


def holding(section: Section, thickness: float, count: int, diameter: float, volume_fraction: float) -> TowShape:
    """The section of a given thickness um that ``count`` filaments fill to ``volume_fraction``: its width follows.

    Area count pi D^2 / (4 Vf). Raises :class:`InputError` where the width would be below the thickness.
    """
    if not 0.0 < volume_fraction < 1.0:
        raise InputError("filaments.volume_fraction", volume_fraction, "a number between 0 and 1")
    area = count * np.pi * diameter**2 / (4.0 * volume_fraction)
    if section == "circular":
        width = float(np.sqrt(4.0 * area / np.pi))
        return TowShape(section, width, width)
    least = TowShape(section, thickness, thickness).area
    if area < least:
        raise InputError(
            "tow.thickness", thickness, f"thinner: a section as wide as thick has {least:.4g} of {area:.4g} um2"
        )
    high = 2.0 * thickness
    while TowShape(section, high, thickness).area < area:
        high *= 2.0
    width = brentq(lambda w: TowShape(section, w, thickness).area - area, thickness, high, xtol=1e-9 * thickness)
    return TowShape(section, float(width), thickness)
