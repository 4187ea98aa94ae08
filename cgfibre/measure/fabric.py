"""Tows of a woven fabric: which run along x (warp) and along y (weft), their centre lines, crimp and angles.

A fabric is a :class:`FilamentSystem` with tow ids; at tow level a tow is one chain (or a ribbon of chains), at filament
level it has many filaments. Frames are (n_beads, 3) positions in um; periodic axes by minimum image.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from cgfibre.build.system import BoolArray, FilamentSystem, FloatArray, IntArray, whole_periods
from cgfibre.errors import InputError
from cgfibre.measure.segments import period_of, segments_of

#: samples between two stations of a centre line, for its angles
FINE = 16
#: places and weights of Gauss' rule between two stations, for lengths
_GAUSS = np.polynomial.legendre.leggauss(4)
#: a passage from one side of the fabric to the other lies within this part of the line's half height
PASSAGE = 0.5


@dataclass(frozen=True)
class Lines:
    """Filaments as unwrapped polylines: ``points`` (n, 3) um, line i from ``start[i]`` to ``start[i + 1]``.

    A closed filament ends on the image of its first bead. ``filament`` (n_lines,) says whose line it is.
    """

    points: FloatArray
    start: IntArray
    closed: BoolArray
    filament: IntArray

    def __len__(self) -> int:
        return len(self.filament)

    def __getitem__(self, i: int) -> FloatArray:
        return self.points[self.start[i] : self.start[i + 1]]

    def runs(self) -> FloatArray:
        """(n_lines, 3) from the first to the last point, um: the period of a closed filament."""
        return self.points[self.start[1:] - 1] - self.points[self.start[:-1]]


def lines_of(system: FilamentSystem, positions: FloatArray) -> Lines:
    """Every filament at ``positions`` (n_beads, 3) um as one polyline, from its first bead on, segment after segment.

    Raises InputError for a wrong shape, non-finite positions and sections (filaments of one bead).
    """
    if positions.shape != (system.n_beads, 3) or not np.all(np.isfinite(positions)):
        raise InputError("positions", positions.shape, f"shape ({system.n_beads}, 3), finite")
    if system.is_section:
        raise InputError("system", "a section", "filaments of two beads or more")
    segments = segments_of(system, positions)
    counts = np.bincount(segments.filament, minlength=system.n_filaments)
    start = np.concatenate([[0], np.cumsum(counts + 1)])
    points = np.zeros((start[-1], 3))
    first = np.zeros(start[-1], dtype=bool)
    first[start[:-1]] = True
    points[~first] = segments.vector
    run = np.cumsum(points, axis=0)
    run -= np.repeat(run[start[:-1]], counts + 1, axis=0)
    points = run + np.repeat(positions[system.first_beads], counts + 1, axis=0)
    return Lines(points, start, system.closed.copy(), np.arange(system.n_filaments))


@dataclass(frozen=True)
class Fabric:
    """A woven assembly: ``axis`` (n_tows,) 0 for warp (along x) and 1 for weft (along y, or along the tilted edge of a
    sheared cell), ``members`` the filaments of each tow. Tows are numbered as in ``system.tow``."""

    system: FilamentSystem
    axis: IntArray
    members: tuple[IntArray, ...]

    @property
    def n_tows(self) -> int:
        """Number of tows."""
        return len(self.members)

    @property
    def filament_axis(self) -> IntArray:
        """(n_filaments,) 0 for filaments of warp, 1 for those of weft."""
        return self.axis[self.system.tow]

    @property
    def single(self) -> BoolArray:
        """(n_tows,) whether the tow is one chain: a homogenised beam."""
        return np.array([len(m) == 1 for m in self.members])

    def area(self) -> float:
        """Area of the periodic cell in the plane, sheared or not, um2. Raises InputError where it does not repeat."""
        period = period_of(self.system)
        if not np.all(period[:2] > 0):
            raise InputError("system.periodic", self.system.periodic.tolist(), "x and y; give the area of a patch")
        return float(period[0] * period[1])


def fabric_of(system: FilamentSystem) -> Fabric:
    """Tows of ``system`` sorted into warp and weft by the way their filaments run as built.

    Raises InputError without both, for tows whose ids have gaps and for a tow whose filaments run both ways.
    """
    runs = system.upright(lines_of(system, system.positions).runs())
    along = np.argmax(np.abs(runs[:, :2]), axis=1)
    n = int(system.tow.max()) + 1
    members = tuple(np.flatnonzero(system.tow == t) for t in range(n))
    if not all(len(m) for m in members):
        raise InputError("system.tow", np.unique(system.tow).tolist(), "tows numbered from 0 without gaps")
    axis = np.array([along[m[0]] for m in members], dtype=np.int64)
    if np.any(along != axis[system.tow]):
        raise InputError("system.tow", int(np.sum(along != axis[system.tow])), "filaments of a tow along the same axis")
    if len(np.unique(axis)) != 2:
        raise InputError("system", f"{n} tows along {'xy'[int(axis[0])]}", "a fabric: tows along x and along y")
    return Fabric(system, axis, members)


@dataclass(frozen=True)
class TowLine:
    """Centre line of a tow: ``points`` (m, 3) um, the mean of ``filaments`` (n, m, 3) at equal shares of arc length.

    ``axis`` 0 along x, 1 along y; ``closed``: the last point is the image of the first.
    """

    tow: int
    axis: int
    closed: bool
    points: FloatArray
    filaments: FloatArray

    @property
    def run(self) -> FloatArray:
        """(3,) from the first to the last point, um."""
        return self.points[-1] - self.points[0]

    @cached_property
    def curve(self) -> tuple[FloatArray, CubicSpline]:
        """Chord length t (m,) at the points and the cubic spline through them, less the mean run t/t_end * run.

        Periodic for closed lines, so that slopes and bends go on over the end.
        """
        t = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))])
        drift = self.points - t[:, None] / t[-1] * self.run
        if self.closed:
            drift[-1] = drift[0]  # equal but for rounding
            return t, CubicSpline(t, drift, bc_type="periodic")
        return t, CubicSpline(t, drift, bc_type="not-a-knot" if len(t) > 3 else "natural")

    def tangents(self, t: FloatArray, spline: CubicSpline, at: FloatArray) -> FloatArray:
        """(..., 3) derivative of the line with respect to chord length at ``at``."""
        return np.asarray(spline(at, 1) + self.run / t[-1], dtype=np.float64)

    def length(self) -> float:
        """Arc length of the spline through the points, um."""
        t, spline = self.curve
        half = np.diff(t)[:, None] / 2
        at = (t[:-1, None] + t[1:, None]) / 2 + half * _GAUSS[0]
        return float(np.sum(half * _GAUSS[1] * np.linalg.norm(self.tangents(t, spline, at), axis=2)))

    def crimp(self) -> float:
        """Excess length L/l - 1, with l the way from end to end in the plane of the fabric.

        A line z = A cos(pi u/s) has L/l = (2/pi) sqrt(1 + k^2) E(k^2/(1 + k^2)), k = pi A/s.
        """
        return self.length() / float(np.linalg.norm(self.run[:2])) - 1.0

    def angles(self) -> tuple[float, float]:
        """Crimp angle in rad to the plane of the fabric: the largest, and the mean over the inflections.

        One inflection a passage from one side to the other: the steepest place where the line is within
        :data:`PASSAGE` of its half height. Both are atan(pi A/s) on z = A cos(pi u/s). A line that stays on one side
        has no passage; its second angle is 0.
        """
        t, spline = self.curve
        at = np.unique(t[:-1, None] + np.diff(t)[:, None] * np.arange(FINE + 1) / FINE)
        slope = self.tangents(t, spline, at)
        angle = np.abs(np.arctan2(slope[:, 2], np.hypot(slope[:, 0], slope[:, 1])))
        z = spline(at)[:, 2] + at / t[-1] * self.run[2]
        middle, half = (z.max() + z.min()) / 2, (z.max() - z.min()) / 2
        if half <= 1e-9 * t[-1]:
            return float(angle.max()), 0.0
        height = (z - middle) / half
        if self.closed:
            top = int(np.argmax(height[:-1]))
            height, angle = (np.append(np.roll(v[:-1], -top), v[top]) for v in (height, angle))
        steep = [float(angle[p].max()) for p in _passages(height)]
        return float(angle.max()), float(np.mean(steep)) if steep else 0.0


def _passages(height: FloatArray) -> list[slice]:
    """Stretches within PASSAGE of the middle that lead from one side to the other, or end an open line half-way."""
    inside = np.abs(height) <= PASSAGE
    edge = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    found = []
    for first, stop in edge.reshape(-1, 2).tolist():
        at_end = first == 0 or stop == len(height)
        if at_end:
            through = bool(np.abs(height[first:stop]).min() < 0.1)
        else:
            through = height[first - 1] * height[stop] < 0
        if through:
            found.append(slice(first, stop))
    return found


def tow_lines(fabric: Fabric, positions: FloatArray) -> list[TowLine]:
    """Centre line of every tow of a frame: the mean of its filaments bead by bead.

    Where they differ in number of beads, at equal shares of arc length, as many as the fullest has. Filaments
    are taken in the periodic image nearest to the first one of their tow.
    """
    lines = lines_of(fabric.system, positions)
    closed = fabric.system.closed
    out = []
    for tow, members in enumerate(fabric.members):
        counts = np.diff(lines.start)[members]
        share = np.linspace(0.0, 1.0, int(counts.max()))
        alike = bool(np.all(counts == counts[0]))  # beads of one number lie at one natural arc length
        filaments = np.array([lines[int(i)] if alike else _resampled(lines[int(i)], share) for i in members])
        middle = filaments.mean(axis=1)
        filaments += whole_periods(middle[0] - middle, period_of(fabric.system), fabric.system.tilt)[:, None]
        out.append(TowLine(tow, int(fabric.axis[tow]), bool(closed[members].all()), filaments.mean(axis=0), filaments))
    return out


def _resampled(points: FloatArray, share: FloatArray) -> FloatArray:
    """Points at equal shares of the polyline's arc length."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return np.stack([np.interp(share * length[-1], length, points[:, k]) for k in range(3)], axis=1)


def bare_crimp(amplitude: float, spacing: float) -> float:
    """Crimp L/l - 1 of z = A cos(pi u/s), from the complete elliptic integral of the second kind; A, s um."""
    from scipy.special import ellipe

    k2 = (np.pi * amplitude / spacing) ** 2
    return float(2 / np.pi * np.sqrt(1 + k2) * ellipe(k2 / (1 + k2)) - 1)


def areal_density(fabric: Fabric, positions: FloatArray, area: float | None = None) -> float:
    """Mass per area of the plane, g/m2 (= pg/um2): sum of mass per length times length as it lies, over ``area`` um2.

    ``area``: default the periodic cell's.
    """
    types = np.array([t.mass_per_length for t in fabric.system.types])[fabric.system.filament_type]
    return float(np.sum(types * filament_lengths(fabric, positions))) / (fabric.area() if area is None else area)


def filament_lengths(fabric: Fabric, positions: FloatArray) -> FloatArray:
    """(n_filaments,) sum of the segments, um."""
    segments = segments_of(fabric.system, positions)
    length = np.linalg.norm(segments.vector, axis=1)
    return np.asarray(np.bincount(segments.filament, length, fabric.system.n_filaments), dtype=np.float64)


def volume_fraction(
    fabric: Fabric,
    positions: FloatArray,
    thickness: float,
    area: float | None = None,
    fibre_area: FloatArray | float | None = None,
) -> float:
    """Fibre volume fraction between the platens: sum of fibre area times length, over area times thickness.

    ``thickness`` um between the platens; ``area`` um2, default the periodic cell's; ``fibre_area`` (n_filaments,) or
    one value, um2: default pi D^2/4 (of a tow that is one chain: the area of its fibres).
    """
    if not thickness > 0:
        raise InputError("thickness", thickness, "above zero")
    section = np.pi * fabric.system.diameter**2 / 4 if fibre_area is None else np.asarray(fibre_area, dtype=float)
    volume = float(np.sum(section * filament_lengths(fabric, positions)))
    return volume / ((fabric.area() if area is None else area) * thickness)
