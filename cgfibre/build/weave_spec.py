"""What a woven fabric is and where its tows run: patterns, centre lines without overlap, closed-form geometry.

x is the warp direction, y the weft direction, z that of compaction. Warp tow j runs along x at y = (j + 1/2)
``warp_spacing``, weft tow i along y at x = (i + 1/2) ``weft_spacing``. At a crossing the upper tow's axis is at +h, the
lower one's at -h', h + h' = (t + t') / 2 + gap for thicknesses t, t'.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import gcd
from typing import Literal

import numpy as np
from scipy.optimize import brentq

from cgfibre.build.system import BoolArray, FloatArray
from cgfibre.build.tow_path import TowPath
from cgfibre.build.tow_shape import TowShape
from cgfibre.errors import InputError

PathKind = Literal["auto", "cosine", "taut"]
Ends = Literal["inflection", "flat", "crest"]
#: of the distance between two axes at a crossing: nearness that counts as touching
TOUCH = 2e-5


def plain() -> BoolArray:
    """(2, 2) plain weave: one over, one under."""
    return twill(1, 1, 1)


def twill(over: int, under: int, step: int = 1) -> BoolArray:
    """(n, n) twill, n = over + under: each warp over ``over`` wefts, under ``under``, shifted by ``step`` a warp.

    Raises :class:`InputError` for counts below 1 and a step that is a multiple of n.
    """
    for key, value in (("over", over), ("under", under)):
        if int(value) != value or value < 1:
            raise InputError(f"twill.{key}", value, "a whole number of at least 1")
    n = over + under
    if int(step) != step or step % n == 0:
        raise InputError("twill.step", step, f"a whole number that is no multiple of {n}")
    i, j = np.indices((n, n))
    return np.asarray((i - step * j) % n < over)


def satin(harness: int, step: int) -> BoolArray:
    """(n, n) warp-faced satin, n = ``harness``: each warp dips under one weft of n, ``step`` on from warp to warp.

    Raises :class:`InputError` unless n is at least 5, and ``step`` from 2 to n - 2 without a common divisor.
    """
    if int(harness) != harness or harness < 5:
        raise InputError("satin.harness", harness, "a whole number of at least 5")
    if int(step) != step or not 2 <= step <= harness - 2 or gcd(step, harness) != 1:
        raise InputError(
            "satin.step", step, f"a number from 2 to {harness - 2} without a common divisor with {harness}"
        )
    i, j = np.indices((harness, harness))
    return np.asarray((i - step * j) % harness != 0)


def pattern_from_rows(rows: str | Sequence[str]) -> BoolArray:
    """(n_weft, n_warp) pattern from text, a row a weft: "1" or "X" where the warp is on top, "0" or "." where the weft.

    ``rows`` is a list of strings or one string with line breaks or commas; blanks are ignored. Raises
    :class:`InputError` for other characters and rows of unequal length.
    """
    lines = rows.replace(",", "\n").splitlines() if isinstance(rows, str) else list(rows)
    lines = [line for line in ("".join(str(row).split()) for row in lines) if line]
    if not lines or len({len(line) for line in lines}) != 1 or set("".join(lines)) - set("10Xx."):
        raise InputError("weave.pattern", rows, "rows of equal length of 1 or X (warp on top) and 0 or .")
    return np.array([[c in "1Xx" for c in line] for line in lines])


@dataclass(frozen=True, eq=False)
class WeaveSpec:
    """What is asked of a weave.

    Attributes
    ----------
    pattern : (n_weft, n_warp) bool, True where the warp passes over the weft
    warp, weft : sections of the tows
    warp_spacing : um, distance of neighbouring warp tows, along y
    weft_spacing : um, distance of neighbouring weft tows, along x
    periodic : a cell that repeats along x and y, or a finite patch
    repeats : of the pattern along x and y; of a periodic cell alone
    tows : (n_warp, n_weft) of a finite patch; ``None`` is the pattern once
    gap : um, clearance between the tows at a crossing
    balance : the warp's share of the amplitude, 0 (straight warp) to 1 (straight weft); ``None`` makes both flush,
        t_weft / (t_warp + t_weft): amplitudes h_warp = t_weft / 2, h_weft = t_warp / 2
    path : "cosine" (a flat crest, as short as keeps clear of the section crossed, and half a cosine), "taut" (the
        shortest line: around the section crossed, then straight; Peirce's geometry for round tows), "auto" takes the
        cosine where it keeps clear and "taut" elsewhere
    ends : of a patch's tows: "inflection" cuts them half a spacing beyond their last crossing (between an upper and a
        lower crossing an inflection: no moment there, z held by symmetry); "flat" runs that half spacing on straight
        (zero slope); "crest" runs a whole spacing on, to where the next tow would cross (zero slope)

    Raises :class:`InputError` for values out of range.
    """

    pattern: BoolArray
    warp: TowShape
    weft: TowShape
    warp_spacing: float
    weft_spacing: float
    periodic: bool = True
    repeats: tuple[int, int] = (1, 1)
    tows: tuple[int, int] | None = None
    gap: float = 0.0
    balance: float | None = None
    path: PathKind = "auto"
    ends: Ends = "inflection"

    def __post_init__(self) -> None:
        pattern = np.asarray(self.pattern)
        if pattern.ndim != 2 or pattern.size == 0 or pattern.dtype != np.bool_:
            raise InputError("weave.pattern", pattern.shape, "a bool array (n_weft, n_warp)")
        for key in ("warp_spacing", "weft_spacing"):
            if not (np.isfinite(getattr(self, key)) and getattr(self, key) > 0.0):
                raise InputError(f"weave.{key}", getattr(self, key), "a finite length above 0")
        for key, spacing, shape in (
            ("weave.warp_spacing", self.warp_spacing, self.warp),
            ("weave.weft_spacing", self.weft_spacing, self.weft),
        ):
            if spacing < shape.width * (1.0 - 1e-9):
                raise InputError(key, spacing, f"at least the width of the tows, {shape.width:g} um")
        for key, pair in (("weave.repeats", self.repeats), ("weave.tows", self.tows)):
            if pair is not None and (len(pair) != 2 or any(int(k) != k or k < 1 for k in pair)):
                raise InputError(key, pair, "two whole numbers of at least 1")
        if self.periodic and self.tows is not None:
            raise InputError("weave.tows", self.tows, "no tows for a periodic cell: it has the pattern's, repeated")
        if not self.periodic and tuple(self.repeats) != (1, 1):
            raise InputError("weave.repeats", self.repeats, "1, 1 for a finite patch: give the number of tows")
        if not (np.isfinite(self.gap) and self.gap >= 0.0):
            raise InputError("weave.gap", self.gap, "a finite length of at least 0 um")
        if self.balance is not None and not 0.0 <= self.balance <= 1.0:
            raise InputError("weave.balance", self.balance, "a number from 0 to 1")
        if self.path not in ("auto", "cosine", "taut"):
            raise InputError("weave.path", self.path, "'auto', 'cosine' or 'taut'")
        if self.ends not in ("inflection", "flat", "crest"):
            raise InputError("weave.ends", self.ends, "'inflection', 'flat' or 'crest'")

    @property
    def counts(self) -> tuple[int, int]:
        """(n_warp, n_weft) tows in the cell or patch."""
        n_weft, n_warp = self.pattern.shape
        if self.periodic:
            return n_warp * self.repeats[1], n_weft * self.repeats[0]
        return self.tows if self.tows is not None else (n_warp, n_weft)

    @property
    def size(self) -> tuple[float, float]:
        """(x, y) um: the cell's edges; a patch's tows each count one spacing."""
        n_warp, n_weft = self.counts
        return n_weft * self.weft_spacing, n_warp * self.warp_spacing

    @property
    def amplitudes(self) -> tuple[float, float]:
        """(h_warp, h_weft) um of the axes above and below the middle plane."""
        t, u = self.warp.thickness, self.weft.thickness
        share = u / (t + u) if self.balance is None else self.balance
        total = 0.5 * (t + u) + self.gap
        return share * total, (1.0 - share) * total

    def over(self, i: int, j: int) -> bool:
        """Whether warp tow j passes over weft tow i, any whole numbers (the pattern repeats)."""
        n_weft, n_warp = self.pattern.shape
        return bool(self.pattern[i % n_weft, j % n_warp])


@dataclass(frozen=True)
class Transition:
    """Half the way from a crest to the next trough, 0 <= u <= p / 2: (n,) u and z um, and slope angle rad.

    ``crest`` um, half length of the flat crest (cosine); ``kind``, "cosine" or "taut"; the other half follows by point
    symmetry about (p / 2, 0).
    """

    u: FloatArray
    z: FloatArray
    angle: FloatArray
    crest: float
    kind: str


def minimum_spacing(tow: TowShape, crossed: TowShape, amplitude: float | None = None, gap: float = 0.0) -> float:
    """Least spacing in um of neighbouring ``crossed`` tows for a ``tow`` that passes over one and under the next.

    The line that touches both sections grown by d = t / 2 + gap passes through the middle of their centres
    (0, -h') and (p, h'): p / 2 sin a + h' cos a = H(a), H(a) = h(a) + d with h the support function of the section. So
    p = min over a of 2 (H(a) - h' cos a) / sin a; sqrt(3) D for round tows of equal amplitude (Peirce's jamming, J.
    Text. Inst. 28, 1937, T45). ``amplitude`` um is h' of the crossed tows; ``None`` takes t / 2, flush tows.
    """
    h = 0.5 * tow.thickness if amplitude is None else amplitude
    a = np.linspace(0.0, 0.5 * np.pi, 20_001)[1:]
    n = np.column_stack([np.sin(a), np.cos(a)])
    room = crossed.support(n) + 0.5 * tow.thickness + gap - h * n[:, 1]
    return float(np.min(2.0 * room / n[:, 0]))


def transition(spec: WeaveSpec, warp: bool, resolution: float | None = None) -> Transition:
    """How warp (or weft) tows go from one side of the fabric to the other, see :class:`WeaveSpec` ``path``.

    ``resolution`` um, largest step of the points; ``None`` is p / 400. Raises :class:`InputError` where the spacing is
    below :func:`minimum_spacing`, and where a cosine is asked for and none keeps clear.
    """
    tow, crossed = (spec.warp, spec.weft) if warp else (spec.weft, spec.warp)
    key = "weave.weft_spacing" if warp else "weave.warp_spacing"
    p = spec.weft_spacing if warp else spec.warp_spacing
    h, other = spec.amplitudes if warp else spec.amplitudes[::-1]
    reach = 0.5 * tow.thickness + spec.gap
    step = p / 400.0 if resolution is None else resolution
    if not (np.isfinite(step) and step > 0.0):
        raise InputError("weave.resolution", step, "a finite length above 0")
    crest = None if spec.path == "taut" else _crest(crossed, p, h, other, reach)
    if crest is not None:
        n = max(int(np.ceil((0.5 * p - crest) / step)), 100)
        u = np.linspace(crest, 0.5 * p, n + 1)
        z, angle = _cosine(u, p, h, crest)
        flat = np.linspace(0.0, crest, int(np.ceil(crest / step)) + 1)[:-1]
        zero = np.zeros(len(flat))
        return Transition(np.append(flat, u), np.append(zero + h, z), np.append(zero, angle), crest, "cosine")
    least = minimum_spacing(tow, crossed, other, spec.gap)
    if p < least * (1.0 - 1e-9):
        raise InputError(
            key, p, f"at least {least:.5g} um: closer tows leave no way between them for one {tow.thickness:g} um thick"
        )
    if spec.path == "cosine":
        raise InputError("weave.path", "cosine", f"'auto' or 'taut' at {key} = {p:g} um: every cosine overlaps")
    return _taut(crossed, p, h, other, reach, step)


def _cosine(u: FloatArray, p: float, h: float, crest: float) -> tuple[FloatArray, FloatArray]:
    k = np.pi / (p - 2.0 * crest)
    return h * np.cos(k * (u - crest)), np.arctan(-h * k * np.sin(k * (u - crest)))


def _crest(crossed: TowShape, p: float, h: float, other: float, reach: float) -> float | None:
    """Shortest flat crest in um whose cosine stays ``reach`` from the section crossed; ``None`` where none does."""

    def clear(crest: float) -> bool:
        u = np.linspace(crest, 0.5 * p, 300)
        z, _ = _cosine(u, p, h, crest)
        return bool(np.min(crossed.signed_distance(np.column_stack([u, z + other]))) >= reach * (1.0 - TOUCH))

    if clear(0.0):
        return 0.0
    tried = np.linspace(0.0, 0.5 * p, 101)[1:-1]
    fits = next((k for k, c in enumerate(tried) if clear(float(c))), None)
    if fits is None:
        return None
    low, high = (tried[fits - 1] if fits else 0.0), tried[fits]
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if clear(float(middle)) else (middle, high)
    return float(high)


def _taut(crossed: TowShape, p: float, h: float, other: float, reach: float, step: float) -> Transition:
    """Along the section crossed, grown by ``reach``, and then straight to the middle (see :func:`minimum_spacing`)."""

    def beyond(a: float) -> float:
        n = np.array([np.sin(a), np.cos(a)])
        return float(0.5 * p * n[0] + other * n[1] - crossed.support(n) - reach)

    # the first angle whose tangent reaches the middle
    angles = np.linspace(0.0, 0.5 * np.pi, 2001)
    above = [k for k, a in enumerate(angles) if beyond(float(a)) >= 0.0]
    if above and above[0] > 0:
        tangent = float(brentq(beyond, angles[above[0] - 1], angles[above[0]], xtol=1e-14))
    elif above:
        tangent = 0.0
    else:  # jammed within rounding
        tangent = float(angles[np.argmax([beyond(float(a)) for a in angles])])
    a = np.linspace(0.0, tangent, 401)
    arc = crossed.edge(a) + reach * np.column_stack([np.sin(a), np.cos(a)]) - np.array([0.0, other])
    u = np.concatenate([[0.0], arc[:, 0], [0.5 * p]])
    z = np.concatenate([[h], arc[:, 1], [0.0]])
    angle = np.concatenate([[0.0], -a, [-tangent]])
    keep = np.concatenate([[True], np.hypot(np.diff(u), np.diff(z)) > 1e-9 * p])
    keep[-1] = True
    return Transition(*_refined(u[keep], z[keep], angle[keep], step), 0.0, "taut")


def _refined(u: FloatArray, z: FloatArray, angle: FloatArray, step: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """More points on stretches longer than ``step``."""
    n = np.maximum(np.ceil(np.hypot(np.diff(u), np.diff(z)) / step - 1e-9), 1).astype(int)
    k = np.repeat(np.arange(len(n)), n)
    at = k + (np.arange(len(k)) - np.repeat(np.cumsum(n) - n, n)) / n[k]
    at = np.append(at, len(n))
    nodes = np.arange(len(u))
    return np.interp(at, nodes, u), np.interp(at, nodes, z), np.interp(at, nodes, angle)


def weave_paths(spec: WeaveSpec, resolution: float | None = None) -> list[TowPath]:
    """Centre lines of all tows, warp tows first.

    Between two crossings on the same side a tow stays flat; between an upper and a lower one it follows
    :func:`transition`. Periodic: paths start at x = 0 (y = 0), half a spacing before the first crossing, and close on
    their image one cell on. Raises :class:`InputError` as :func:`transition`.
    """
    n_warp, n_weft = spec.counts
    change = {warp: transition(spec, warp, resolution) for warp in (True, False)}
    paths = []
    for j in range(n_warp):
        sides = np.array([spec.over(i, j) for i in range(-1, n_weft + 1)])
        u, z, angle = _line(sides, spec.weft_spacing, change[True], spec)
        points = np.column_stack([u, np.full_like(u, (j + 0.5) * spec.warp_spacing), z])
        paths.append(_path(points, angle, 0, spec, j, n_weft))
    for i in range(n_weft):
        sides = np.array([not spec.over(i, j) for j in range(-1, n_warp + 1)])
        u, z, angle = _line(sides, spec.warp_spacing, change[False], spec)
        points = np.column_stack([np.full_like(u, (i + 0.5) * spec.weft_spacing), u, z])
        paths.append(_path(points, angle, 1, spec, n_warp + i, n_warp))
    return paths


def _line(sides: BoolArray, p: float, change: Transition, spec: WeaveSpec) -> tuple[FloatArray, FloatArray, FloatArray]:
    """u, z, slope angle of a tow that is up at crossings where ``sides``, one virtual crossing before and after."""
    u2 = np.concatenate([change.u, p - change.u[-2::-1]])
    z2 = np.concatenate([change.z, -change.z[-2::-1]])
    a2 = np.concatenate([change.angle, change.angle[-2::-1]])
    h = change.z[0]
    last = len(sides) - 2
    us, zs, angles = [], [], []
    for k in range(len(sides) - 1):
        outer = not spec.periodic and spec.ends == "flat" and k in (0, last)
        here, there = sides[k], sides[k + 1]
        if outer:  # the inner crossing's side, straight on
            here = there = there if k == 0 else here
        sign = 1.0 if here else -1.0
        flat = here == there
        # nodes of the cosine or the arcs also where it is flat: the middle is a node then too
        us.append((k - 0.5) * p + u2[:-1])
        zs.append((np.full_like(u2, h) if flat else z2)[:-1] * sign)
        angles.append((np.zeros_like(u2) if flat else a2)[:-1] * sign)
    end = sides[-1] if not (not spec.periodic and spec.ends == "flat") else sides[-2]
    u = np.append(np.concatenate(us), (last + 0.5) * p)
    z = np.append(np.concatenate(zs), h if end else -h)
    angle = np.append(np.concatenate(angles), 0.0)
    if spec.periodic or spec.ends != "crest":
        half = len(change.u) - 1  # the middle of the first and of the last stretch
        u, z, angle = (v[half : len(v) - half] for v in (u, z, angle))
        u[0], u[-1] = 0.0, last * p
    return u, z, angle


def _path(points: FloatArray, angle: FloatArray, axis: int, spec: WeaveSpec, index: int, crossings: int) -> TowPath:
    tangent, normal = np.zeros_like(points), np.zeros_like(points)
    tangent[:, axis], tangent[:, 2] = np.cos(angle), np.sin(angle)
    normal[:, axis], normal[:, 2] = -np.sin(angle), np.cos(angle)
    shape = spec.warp if axis == 0 else spec.weft
    p = spec.weft_spacing if axis == 0 else spec.warp_spacing
    path = TowPath(points, tangent, normal, shape, spec.periodic, axis == 0, index)
    at = np.interp((np.arange(crossings) + 0.5) * p, points[:, axis], path.arc)
    return replace(path, crossings=at)


@dataclass(frozen=True)
class WeaveGeometry:
    """What follows from a weave's spec; pairs are (warp, weft).

    Attributes: ``crimp_angle`` rad, largest; ``crimp`` mean arc length / projected length - 1; ``amplitude`` um;
    ``path`` kinds; ``crest`` um, half length of flat crests; ``minimum_spacing`` (of warp tows along y, of weft tows
    along x) um; ``thickness`` um of the fabric; ``volume_fraction`` of tows in it; ``cover_factor``, share of the plane
    covered; ``areal_density`` pg/um2 (= g/m2), None unless tows' masses were given.
    """

    crimp_angle: tuple[float, float]
    crimp: tuple[float, float]
    amplitude: tuple[float, float]
    path: tuple[str, str]
    crest: tuple[float, float]
    minimum_spacing: tuple[float, float]
    thickness: float
    volume_fraction: float
    cover_factor: float
    areal_density: float | None


def weave_geometry(spec: WeaveSpec, mass_per_length: tuple[float, float] | None = None) -> WeaveGeometry:
    """Crimp, thickness, volume fraction, cover and areal density of the repeating pattern.

    Cosine without a flat crest: tan(angle) = pi h / p, and the arc length of one crossing is
    (2 / pi) sqrt(p^2 + (pi h)^2) E(m), m = (pi h)^2 / (p^2 + (pi h)^2). Taut round tows: Peirce's equations,
    p = (l - D a) cos a + D sin a and 2 h = (l - D a) sin a + D (1 - cos a), D = t + t', l the arc length of one
    crossing. Cover: k + k' - k k' with k = width / spacing. Thickness: the highest surface less the lowest,
    max(h + t / 2) over both tows, twice. ``mass_per_length`` pg/um of a (warp, weft) tow.
    Raises :class:`InputError` as :func:`weave_paths`.
    """
    cell = replace(spec, periodic=True, repeats=(1, 1), tows=None)
    paths = weave_paths(cell)
    x, y = cell.size
    groups = [[q for q in paths if q.is_warp], [q for q in paths if not q.is_warp]]
    change = [transition(cell, True), transition(cell, False)]
    lengths = [sum(q.arc_length for q in g) for g in groups]
    h = cell.amplitudes
    thickness = 2.0 * max(h[0] + 0.5 * cell.warp.thickness, h[1] + 0.5 * cell.weft.thickness)
    volume = lengths[0] * cell.warp.area + lengths[1] * cell.weft.area
    k, q = cell.warp.width / cell.warp_spacing, cell.weft.width / cell.weft_spacing
    mass = None
    if mass_per_length is not None:
        mass = (lengths[0] * mass_per_length[0] + lengths[1] * mass_per_length[1]) / (x * y)
    return WeaveGeometry(
        crimp_angle=(max(q.crimp_angle for q in groups[0]), max(q.crimp_angle for q in groups[1])),
        crimp=(lengths[0] / (len(groups[0]) * x) - 1.0, lengths[1] / (len(groups[1]) * y) - 1.0),
        amplitude=h,
        path=(change[0].kind, change[1].kind),
        crest=(change[0].crest, change[1].crest),
        minimum_spacing=(
            max(cell.warp.width, minimum_spacing(cell.weft, cell.warp, h[0], cell.gap)),
            max(cell.weft.width, minimum_spacing(cell.warp, cell.weft, h[1], cell.gap)),
        ),
        thickness=thickness,
        volume_fraction=volume / (x * y * thickness),
        cover_factor=k + q - k * q,
        areal_density=mass,
    )


def consistent_plain(
    thickness: float | None = None, spacing: float | None = None, crimp_angle: float | None = None
) -> tuple[float, float, float]:
    """(thickness um, spacing um, crimp angle rad) of a balanced plain weave from two: tan(angle) = pi t / (2 p).

    A cosine of amplitude t / 2 (touching tows). All three are checked against each other: the thesis' carbon weave (8
    degrees, 0.225 mm, 0.07 mm; section 8.4) is not consistent: it needs 26 degrees, or 0.78 mm, or 0.020 mm.
    Raises :class:`InputError` for fewer than two, values out of range, and three that differ by more than 1 %.
    """
    given = {"thickness": thickness, "spacing": spacing, "crimp_angle": crimp_angle}
    for key, value in given.items():
        if value is not None and not (np.isfinite(value) and value > 0.0):
            raise InputError(f"weave.{key}", value, "a finite number above 0")
    if crimp_angle is not None and crimp_angle >= 0.5 * np.pi:
        raise InputError("weave.crimp_angle", crimp_angle, "an angle below pi / 2 rad")
    if sum(v is not None for v in given.values()) < 2:
        raise InputError("weave", given, "two of thickness, spacing and crimp angle")
    if crimp_angle is None:
        assert thickness is not None and spacing is not None
        return thickness, spacing, float(np.arctan(0.5 * np.pi * thickness / spacing))
    slope = float(np.tan(crimp_angle))
    if spacing is None:
        assert thickness is not None
        return thickness, 0.5 * np.pi * thickness / slope, crimp_angle
    fits = 2.0 * spacing * slope / np.pi
    if thickness is not None and abs(fits / thickness - 1.0) > 0.01:
        angle = float(np.degrees(np.arctan(0.5 * np.pi * thickness / spacing)))
        raise InputError(
            "weave.crimp_angle",
            crimp_angle,
            f"an angle that fits tows {thickness:g} um thick at {spacing:g} um: {np.radians(angle):.4g} rad "
            f"({angle:.3g} degrees), or a spacing of {0.5 * np.pi * thickness / slope:.4g} um, "
            f"or a thickness of {fits:.4g} um",
        )
    return (fits if thickness is None else thickness), spacing, crimp_angle
