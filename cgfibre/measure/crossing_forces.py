"""Forces, areas and pressures where tows cross: contacts of smooth filaments, grouped by the pair of tows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from cgfibre.build.system import FloatArray, IntArray, whole_periods
from cgfibre.measure.crossings import Crossings
from cgfibre.measure.fabric import Fabric
from cgfibre.measure.segments import GAUSS, LineLaw, Stretches, period_of, touching_stretches
from cgfibre.mechanics.contact import crossing_prefactor

#: half width of the lens of two crossing filaments over the radius: below the first their force is Hertz', above the
#: second the line law's (as ``pair_style capsule`` leads over)
SHORT_LENS, LONG_LENS = 0.25, 1.0
#: places and weights of the rule for contact areas
_RULE = np.polynomial.legendre.leggauss(8)


@dataclass(frozen=True)
class Touch:
    """Contacts of smooth filaments of one frame, one a touching pair of segments, (n,) unless said.

    ``filaments`` (n, 2), lower number first; ``force`` nN, normal, never negative; ``vector`` (n, 3) nN, the force on
    the first filament; ``place`` (n, 3) um, on the first filament's axis; ``length`` um of the stretch; ``area`` um2 in
    which the round surfaces, if undeformed, overlap, seen along the normal.
    """

    filaments: IntArray
    force: FloatArray
    vector: FloatArray
    place: FloatArray
    length: FloatArray
    area: FloatArray

    def __len__(self) -> int:
        return len(self.force)


@cache
def _hertz_table() -> tuple[FloatArray, FloatArray]:
    """ln(sin) and ln(g sin), with g = F/(E* sqrt(Re) delta^1.5) of Hertz' ellipse, 1/Re = (1/r1 + 1/r2)/2."""
    log_sine = np.linspace(-7.0, 0.0, 200)
    # two equal cylinders of r = 1: Re = 1
    g = crossing_prefactor(1.0, 1.0, 1.0, np.arcsin(np.exp(log_sine)))
    return log_sine, np.log(g) + log_sine


def _lens_stiffness(s: Stretches, radii: FloatArray, modulus: float) -> tuple[FloatArray, FloatArray]:
    """Part of the line law in the force, and the stiffness per length (kPa) of Hertz' lens of springs for the rest."""
    harmonic = 2 * radii[:, 0] * radii[:, 1] / s.reach
    nearest = np.clip(-s.Q / s.M, s.low, s.high)
    lens2 = np.maximum(-(s.C + nearest * (2 * s.Q + nearest * s.M)), 0.0)
    w = np.sqrt(lens2 / s.M) / harmonic
    u = np.clip((w - SHORT_LENS) / (LONG_LENS - SHORT_LENS), 0.0, 1.0)
    share = u * u * (3 - 2 * u)
    sine = np.sqrt(np.clip(s.M * harmonic**2 / (radii[:, 0] * radii[:, 1]), 1e-6, 1.0))
    at, value = _hertz_table()
    g = np.exp(np.interp(np.log(sine), at, value)) / sine
    opened = s.reach + np.sqrt(np.maximum(s.reach**2 - lens2, 0.0))
    stiffness = 0.75 * modulus * np.sqrt(harmonic * s.M / opened**3) * g
    return share, stiffness * (s.reach + np.sqrt(np.maximum(s.reach**2 - 2 / 3 * lens2, 0.0)))


def touches(
    fabric: Fabric,
    positions: FloatArray,
    law: LineLaw,
    modulus: float | None = None,
    touching: np.ndarray | None = None,
    both_sides: bool = False,
) -> Touch:
    """Contacts of a frame with their forces, by the engine's own rule (``pair_style capsule``), static.

    The normal force is the integral of ``law`` over the touching stretch by two Gauss points; with ``modulus`` E* (kPa,
    law ``line``) crossing filaments lead over to Hertz' ellipse where their lens is short beside the radius. Damping,
    friction and history of unloading are not in it. ``touching`` as in :func:`touching_stretches`; ``both_sides``: the
    mean of what either segment sees (``sides both``).

    Area: integral over the stretch of the width 2 sqrt(2 R d) of the overlap d of two cylinders, 1/R = 1/r1 + 1/r2: two
    that cross at a right angle have 2 pi r d, twice the area of Hertz' contact at that approach.
    """
    one = _touches(fabric, touching_stretches(fabric.system, positions, touching), law, modulus)
    if not both_sides:
        return one[1]
    other = _touches(fabric, touching_stretches(fabric.system, positions, touching, True), law, modulus)
    return _mean_of_sides(one, other)


def _mean_of_sides(one: tuple[IntArray, Touch], other: tuple[IntArray, Touch]) -> Touch:
    """Contacts by the filament of the lower number, and by the higher one, of the same pairs of segments in part."""
    pairs, place = np.unique(np.concatenate([one[0], other[0][:, ::-1]]), axis=0, return_inverse=True)
    here, there, n = place.ravel()[: len(one[0])], place.ravel()[len(one[0]) :], len(pairs)
    filaments = np.zeros((n, 2), dtype=np.int64)
    filaments[there], filaments[here] = other[1].filaments[:, ::-1], one[1].filaments
    position = np.zeros((n, 3))
    position[there], position[here] = other[1].place, one[1].place  # of the lower one's axis where it sees the other

    def half(name: str, sign: float = 1.0) -> FloatArray:
        mine, theirs = getattr(one[1], name), getattr(other[1], name)
        total = np.zeros((n, *mine.shape[1:]))
        total[here] = 0.5 * mine
        total[there] += 0.5 * sign * theirs
        return total

    return Touch(filaments, half("force"), half("vector", -1.0), position, half("length"), half("area"))


def _touches(fabric: Fabric, s: Stretches, law: LineLaw, modulus: float | None) -> tuple[IntArray, Touch]:
    """Segments and contacts of stretches, seen from the first of each pair."""
    radii = fabric.system.diameter[s.filaments] / 2
    share, soft = np.ones(len(s)), np.zeros(len(s))
    if modulus is not None:
        share, soft = _lens_stiffness(s, radii, modulus)
    half = (s.high - s.low) / 2
    total, moment, vector = np.zeros(len(s)), np.zeros(len(s)), np.zeros((len(s), 3))
    for g in (-GAUSS, GAUSS):
        at = s.at(np.asarray(g))
        overlap = np.maximum(s.overlap(at), 0.0)
        force = half * (share * law(overlap) + (1 - share) * soft * overlap)
        way = s.foot + at[:, None] * s.drift
        way /= np.maximum(np.linalg.norm(way, axis=1), 1e-300)[:, None]
        total += force
        moment += force * at
        vector += force[:, None] * way
    centre = np.where(total > 0, moment / np.where(total > 0, total, 1.0), s.at(np.zeros(())))
    # sines: the width's square root ends are smooth in them
    angle = np.pi / 2 * _RULE[0]
    weight = np.pi / 2 * _RULE[1] * np.cos(angle)
    deep = np.maximum(s.overlap(s.at(np.sin(angle)[:, None])), 0.0)
    relative = radii[:, 0] * radii[:, 1] / s.reach
    area = half * np.sum(weight[:, None] * 2 * np.sqrt(2 * relative * deep), axis=0)
    return s.segments, Touch(s.filaments, total, vector, s.start + centre[:, None] * s.unit, 2 * half, area)


@dataclass(frozen=True)
class CrossingLoads:
    """What the contacts at each tow crossing carry, (n_crossings,) unless said.

    ``warp``, ``weft`` tows and ``place`` (n, 3) um of the crossings; ``warp_above``; ``force`` (n, 3) nN on the upper
    tow; ``normal`` nN, sum of the magnitudes; ``area`` um2 (see :func:`touches`) and ``count`` of touching segments.
    """

    warp: IntArray
    weft: IntArray
    place: FloatArray
    warp_above: np.ndarray
    force: FloatArray
    normal: FloatArray
    area: FloatArray
    count: IntArray

    @property
    def through(self) -> FloatArray:
        """(n,) force that a crossing carries through the thickness, nN."""
        return self.force[:, 2]

    @property
    def pressure(self) -> FloatArray:
        """(n,) normal force over contact area, kPa; 0 where nothing touches."""
        return np.divide(self.normal, self.area, out=np.zeros(len(self.area)), where=self.area > 0)


def crossing_loads(fabric: Fabric, crossings: Crossings, touch: Touch) -> CrossingLoads:
    """Contacts of warp with weft, summed over each crossing of tows (``crossings`` of their centre lines).

    Tows that cross more than once: a contact belongs to the nearest crossing of its two tows in the plane.
    """
    n = len(crossings)
    tows = fabric.system.tow[touch.filaments]
    axes = fabric.axis[tows]
    across = axes[:, 0] != axes[:, 1]
    first_is_warp = axes[across, 0] == 0
    pair = tows[across]
    warp, weft = np.where(first_is_warp, pair.T, pair.T[::-1])
    period = period_of(fabric.system)[:2]
    owner = np.full(len(warp), -1)
    best = np.full(len(warp), np.inf)
    for k in range(n):
        mine = np.flatnonzero((warp == crossings.first[k]) & (weft == crossings.second[k]))
        d = touch.place[across][mine, :2] - crossings.place[k, :2]
        d -= whole_periods(d, period, fabric.system.tilt)
        distance = np.sum(d * d, axis=1)
        nearer = distance < best[mine]
        owner[mine[nearer]], best[mine[nearer]] = k, distance[nearer]
    # force on the warp, then on whichever lies above
    on_warp = np.where(first_is_warp, 1.0, -1.0)[:, None] * touch.vector[across]
    found = owner >= 0
    force = np.zeros((n, 3))
    np.add.at(force, owner[found], on_warp[found])
    above = crossings.gap > 0
    return CrossingLoads(
        warp=crossings.first,
        weft=crossings.second,
        place=crossings.place,
        warp_above=above,
        force=np.where(above, 1.0, -1.0)[:, None] * force,
        normal=np.asarray(np.bincount(owner[found], touch.force[across][found], n), dtype=np.float64),
        area=np.asarray(np.bincount(owner[found], touch.area[across][found], n), dtype=np.float64),
        count=np.bincount(owner[found], minlength=n).astype(np.int64),
    )
