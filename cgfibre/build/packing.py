"""Filament centres in a cross-section: (n, 2) arrays of (y, z) in um about the origin.

Every regular arrangement keeps all centres at least one pitch apart and has its mean at the origin; a random packing
keeps them at least one diameter apart inside an envelope about the origin. ``ARRANGEMENTS`` is the table to extend.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import wraps
from typing import Any, Protocol, TypeVar, cast

import numpy as np
from scipy.optimize import minimize
from scipy.sparse import csr_array
from scipy.spatial import ConvexHull, QhullError, cKDTree
from scipy.special import ellipe
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from cgfibre.build.system import FloatArray, IntArray
from cgfibre.errors import InputError

#: distance between close-packed rows over the pitch
ROW = float(np.sqrt(3.0) / 2.0)
#: fibre volume fraction of touching filaments in hexagonal order, pi / (2 sqrt 3)
HEXAGONAL_LIMIT = float(np.pi / (2.0 * np.sqrt(3.0)))
#: what a random packing is asked for at most: random close packing of equal discs, 0.82 to 0.84; beyond it they order
RANDOM_LIMIT = 0.84
#: rounds after which moving filaments apart ends, improved by less than 1e-3 or not
SEPARATION_ROUNDS = 20


Build = TypeVar("Build", bound=Callable[..., FloatArray | None])


def _one_thread(function: Build) -> Build:
    """Without BLAS threads: L-BFGS gains nothing here, and waiting threads cost 20 times on a busy machine."""

    @wraps(function)
    def limited(*args: Any, **kwargs: Any) -> FloatArray | None:
        with threadpool_limits(1, user_api="blas"):
            return function(*args, **kwargs)

    return cast(Build, limited)


@dataclass(frozen=True)
class ArrangementSpec:
    """What is asked of a cross-section.

    Attributes
    ----------
    name : a key of :data:`ARRANGEMENTS`
    count : filaments
    pitch : um, least distance of two centres; ``None`` takes it from ``volume_fraction`` (hexagonal relation)
    volume_fraction : fibre volume fraction; for the random packings that of the envelope
    aspect : width (y) over height (z) of the outline; used by ``rectangular``, ``elliptic``, ``racetrack`` and
        ``random-rectangular``
    first_angle : rad, angle of the first filament of each ring from +y towards +z; used by the ring arrangements
    epsilon, beta : parameters of the packing probability of ``virtual``
    centres : (y, z) um of each filament, of ``file`` alone
    """

    name: str
    count: int
    pitch: float | None = None
    volume_fraction: float | None = None
    aspect: float = 1.0
    first_angle: float = 0.0
    epsilon: float = 0.05
    beta: float = 0.3
    centres: tuple[tuple[float, float], ...] | None = None


def pitch_from_void_fraction(diameter: float, void_fraction: float) -> float:
    """Centre distance in um of hexagonal packing, p = D sqrt(pi / (2 sqrt(3) (1 - void))).

    The thesis' 8.028 um for D = 7 um (6.4) is a void fraction of 31.05 %; 31 % exactly is 8.025 um.
    Raises :class:`InputError` unless D > 0 and void is in [1 - pi / (2 sqrt 3), 1) (overlap below).
    """
    _positive("diameter", diameter)
    low = 1.0 - HEXAGONAL_LIMIT
    if not low - 1e-12 <= void_fraction < 1.0:
        raise InputError("void_fraction", void_fraction, f"a number from {low:.4f} (touching) to below 1")
    return max(diameter * float(np.sqrt(HEXAGONAL_LIMIT / (1.0 - void_fraction))), diameter)


def void_fraction_from_pitch(diameter: float, pitch: float) -> float:
    """Void fraction of hexagonal packing, 1 - pi D^2 / (2 sqrt(3) p^2); inverse of :func:`pitch_from_void_fraction`.

    Raises :class:`InputError` unless 0 < D <= p.
    """
    _positive("diameter", diameter)
    if not pitch >= diameter:
        raise InputError("pitch", pitch, f"at least the diameter {diameter:g} um")
    return 1.0 - HEXAGONAL_LIMIT * (diameter / pitch) ** 2


def ring_counts(rings: int) -> IntArray:
    """(rings + 1,) filaments of full circular arrangements of 0 .. ``rings`` rings, 1 + 3 n (n + 1): 1, 7, 19, 37, ...

    62 rings make the thesis' "12 000" filament tow of 11 719. Raises :class:`InputError` for a negative number.
    """
    if rings < 0:
        raise InputError("rings", rings, "a number of rings, 0 or more")
    n = np.arange(rings + 1, dtype=np.int64)
    return 1 + 3 * n * (n + 1)


def circular(count: int, pitch: float, first_angle: float = 0.0) -> FloatArray:
    """One filament and rings l = 1, 2, ... of 6 l at radius l * pitch (thesis 6.4), (count, 2) um.

    ``first_angle`` rad turns the first filament of every ring from +y towards +z: 0 leaves no column of filaments under
    a platen, pi/2 is the thesis' aligned middle column. A count that leaves the last ring unfilled spreads its
    remainder evenly over it. Filaments run ring after ring, anticlockwise seen from +x.
    Raises :class:`InputError` for a count below 1 or a pitch not above 0.
    """
    _positive("pitch", pitch)
    ring, k, filled = _ring_sites(_counted(count))
    angle = first_angle + 2.0 * np.pi * k / filled
    return _finish(pitch * ring[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]), pitch)


def hexagonal(count: int, pitch: float) -> FloatArray:
    """The ``count`` points of a hexagonal lattice nearest a lattice point, rows parallel to y, (count, 2) um.

    Points of equal distance are taken by |z|, then z, then y. Raises :class:`InputError` as :func:`circular`.
    """
    return racetrack(count, pitch, 1.0)


def rectangular(count: int, pitch: float, aspect: float = 1.0) -> FloatArray:
    """Close-packed layers parallel to y, every other one shifted by half a pitch (thesis 7.5.3), (count, 2) um.

    The number of layers is the one whose outline comes nearest to ``aspect`` (outline width m p, or (m + 1/2) p where
    layers are shifted; height p + (r - 1) sqrt(3)/2 p); all layers have m filaments but the top one, which takes the
    rest in its middle. One filament a layer makes a straight column of one pitch: count = 2 with aspect < 1 is one
    above the other. Raises :class:`InputError` as :func:`circular`, and for an aspect not above 0.
    """
    _positive("pitch", pitch)
    _positive("aspect", aspect)
    layers = np.arange(1, _counted(count) + 1)
    m = -(-count // layers)
    keep = -(-count // m) == layers  # no empty layer
    layers, m = layers[keep], m[keep]
    column = m == 1
    width = m + np.where((layers > 1) & ~column, 0.5, 0.0)
    height = 1.0 + (layers - 1) * np.where(column, 1.0, ROW)
    best = int(np.argmin(np.abs(np.log(width / height / aspect))))
    per_layer = int(m[best])
    layer, i = np.divmod(np.arange(count), per_layer)
    rest = count - (int(layers[best]) - 1) * per_layer
    y = i + np.where(layer == layers[best] - 1, (per_layer - rest) // 2, 0.0)
    z = layer * 1.0
    if per_layer > 1:
        y, z = y + 0.5 * (layer % 2), ROW * z
    return _finish(pitch * np.column_stack([y, z]), pitch)


@_one_thread
def elliptic(count: int, pitch: float, aspect: float = 1.0) -> FloatArray:
    """Elliptic rings, outline ``aspect`` wide over high, (count, 2) um.

    Thesis E.8 places ring l of 6 l filaments at equal steps of t on y = a (l + 1) cos t, z = b l sin t. With
    a = b = p this keeps the pitch (but leaves the axis empty, and its aspect follows from the count: 1.17 at six
    rings). b is the distance of rings at the short axis, so b < D makes every ring overlap the next; a >> b leaves the
    long sides loose. Here the semi-axes keep the thesis' constant difference, (l + e) p and l p, with e for the aspect
    asked, each ring has filaments at equal arc length of about pi/3 p as the circular rings have (ring 0 is the line of
    half length e p), and the overlaps that this leaves are relaxed inside an ellipse of that aspect, opened by 3 % of
    area at a time from a disc fraction of 0.73 (the circular rings have 0.75 for discs of one pitch) until 2 % of p is
    left at most, for which the whole section is opened.
    aspect = 1 is :func:`circular` with ``first_angle`` = pi/2. Raises :class:`InputError` as :func:`rectangular`.
    """
    _positive("pitch", pitch)
    _positive("aspect", aspect)
    if aspect < 1.0:
        return elliptic(count, pitch, 1.0 / aspect)[:, ::-1].copy()
    if aspect == 1.0:
        return circular(count, pitch, 0.5 * np.pi)
    start = _elliptic_rings(_counted(count), aspect)
    extent = np.maximum(np.abs(start).max(axis=0), 1.0)
    d, fraction = 1.0 + 1e-9, 0.75
    while True:
        fraction *= 0.97
        envelope = Envelope.of(count, d, fraction, aspect, oval=True)
        room = np.array(envelope.half) - 0.5 * d
        if room.min() < 0.0:
            continue
        centres, _ = _relax(start * (room / extent), d, envelope, rounds=8)
        if min_distance(centres) > 0.98:  # what little is left opens the whole section evenly
            return _finish(pitch * centres, pitch)


def racetrack(count: int, pitch: float, aspect: float = 1.0) -> FloatArray:
    """Close-packed rows inside a racetrack: a rectangle with two half circles at its ends, (count, 2) um.

    The thesis (7.5.3) puts halves of a ring arrangement on the ends of a close-packed rectangle and gives no
    coordinates: ring filaments at the seam stand p apart in z, rows sqrt(3)/2 p, so the two cannot meet at one pitch
    without centres nearer than p or a gap. Here one hexagonal lattice fills the whole outline: the ``count`` lattice
    points nearest the line |y| <= c, z = 0, with R^2 (pi + 4 (aspect - 1)) = count p^2 sqrt(3)/2 and
    c = R (aspect - 1). aspect < 1 stands it on end (rows then parallel to z). aspect = 1 is :func:`hexagonal`.
    Points of equal distance are taken by |z|, then z, then |y|, then y. Raises :class:`InputError` as
    :func:`rectangular`.
    """
    _positive("pitch", pitch)
    _positive("aspect", aspect)
    if aspect < 1.0:
        return racetrack(count, pitch, 1.0 / aspect)[:, ::-1].copy()
    radius = float(np.sqrt(_counted(count) * ROW / (np.pi + 4.0 * (aspect - 1.0))))
    half = radius * (aspect - 1.0)
    rows = int(radius / ROW) + 3
    cols = int(half + radius) + 3
    j = np.arange(-rows, rows + 1)
    twice_y = 2 * np.arange(-cols, cols + 1)[None, :] + (j % 2)[:, None]
    jj = np.broadcast_to(j[:, None], twice_y.shape).ravel()
    twice_y = twice_y.ravel()
    beyond = np.maximum(0.5 * np.abs(twice_y) - half, 0.0)
    # rounded, so that ties do not hang on the last bit
    distance = np.round(beyond**2 + (ROW * jj) ** 2, 9)
    order = np.lexsort([twice_y, np.abs(twice_y), jj, np.abs(jj), distance])[:count]
    order = order[np.lexsort([twice_y[order], jj[order]])]
    return _finish(pitch * np.column_stack([0.5 * twice_y[order], ROW * jj[order]]), pitch)


def packing_probability(radius: FloatArray, outer_radius: float, epsilon: float, beta: float) -> FloatArray:
    """Probability that a virtual location at ``radius`` holds a filament, same shape as ``radius`` (Eq. 2-1).

    p(R) = (1 - 2 eps) ((e - exp(R / Rmax)) / (e - 1))^beta + eps, after Sreprateep and Bohez (Computer-Aided Design and
    Applications 3, 2006, 367-376); 1 - eps on the axis, eps at Rmax. The thesis' print loses eps and beta, and its text
    the exponent; this form is the one other implementations of the scheme use (the paper itself was not read).
    Raises :class:`InputError` unless 0 <= eps <= 1/2, beta >= 0 and 0 <= R <= Rmax.
    """
    if not 0.0 <= epsilon <= 0.5:
        raise InputError("epsilon", epsilon, "a number from 0 to 0.5")
    if not beta >= 0.0:
        raise InputError("beta", beta, "a number of at least 0")
    _positive("outer_radius", outer_radius)
    x = np.asarray(radius, dtype=float) / outer_radius
    if np.any(x < 0.0) or np.any(x > 1.0 + 1e-12):
        raise InputError("radius", float(np.max(np.abs(x)) * outer_radius), f"radii from 0 to {outer_radius:g}")
    base = np.maximum((np.e - np.exp(x)) / (np.e - 1.0), 0.0)
    return (1.0 - 2.0 * epsilon) * base**beta + epsilon


def virtual_locations(count: int, pitch: float, rng: np.random.Generator, spec: ArrangementSpec) -> FloatArray:
    """Ring locations filled at random with the packing probability of Sreprateep and Bohez, (count, 2) um.

    Rings as in :func:`circular` are taken until the expected number of filaments, the sum of
    :func:`packing_probability` over all locations with Rmax = the outermost ring plus half a pitch, reaches ``count``;
    then ``count`` locations are drawn without replacement, weighted by it (open packing, dense in the middle). The ring
    axis is the origin; the mean of the centres is not. Raises :class:`InputError` as :func:`packing_probability`.
    """
    _positive("pitch", pitch)
    rings = int(np.sqrt(_counted(count) / 3.0))
    while True:
        total = int(ring_counts(rings)[-1])
        ring, k, filled = _ring_sites(total)
        p = packing_probability(ring.astype(float), rings + 0.5, spec.epsilon, spec.beta)
        if p.sum() >= count and np.count_nonzero(p) >= count:
            break
        if total > 1000 * count + 1000:
            raise InputError("epsilon, beta", (spec.epsilon, spec.beta), "a packing probability not almost zero")
        rings += 1
    taken = np.sort(rng.choice(total, size=count, replace=False, p=p / p.sum()))
    angle = spec.first_angle + 2.0 * np.pi * k[taken] / filled[taken]
    centres = pitch * ring[taken, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return _no_closer(centres, pitch)


class Outline(Protocol):
    """What holds a random packing."""

    def penalty(self, centres: FloatArray, diameter: float) -> tuple[float, FloatArray]:
        """Energy and its (n, 2) gradient, um2 and um, of filaments that stand out; zero exactly when all are inside."""
        ...

    def sample(self, count: int, diameter: float, rng: np.random.Generator) -> FloatArray:
        """(count, 2) um, uniform at random where a filament's centre may be."""
        ...


@dataclass(frozen=True)
class Envelope:
    """The outline that holds a random packing, about the origin: an ellipse (a circle), or a rectangle.

    ``half`` um, half width and half height; ``oval``, whether it is an ellipse. A filament is inside when its centre is
    in the same figure with both halves less by D/2.
    """

    half: tuple[float, float]
    oval: bool

    @classmethod
    def of(cls, count: int, diameter: float, volume_fraction: float, aspect: float, oval: bool) -> Envelope:
        """The envelope of area count pi D^2 / (4 Vf)."""
        area = count * np.pi * diameter**2 / (4.0 * volume_fraction)
        half = float(np.sqrt(area / aspect / (np.pi if oval else 4.0)))
        return cls((aspect * half, half), oval)

    @property
    def area(self) -> float:
        """Area in um2."""
        return (np.pi if self.oval else 4.0) * self.half[0] * self.half[1]

    def penalty(self, centres: FloatArray, diameter: float) -> tuple[float, FloatArray]:
        """Energy and its (n, 2) gradient, um2 and um, of filaments that stand out; zero exactly when all are inside."""
        room = np.maximum(np.array(self.half) - 0.5 * diameter, 1e-12)
        if not self.oval:
            excess = centres - np.clip(centres, -room, room)
            return 0.5 * float(np.sum(excess**2)), excess
        rho = np.maximum(np.hypot(centres[:, 0] / room[0], centres[:, 1] / room[1]), 1.0)
        stiff = float(room.min()) ** 2
        return 0.5 * stiff * float(np.sum((rho - 1.0) ** 2)), stiff * ((rho - 1.0) / rho)[:, None] * centres / room**2

    def sample(self, count: int, diameter: float, rng: np.random.Generator) -> FloatArray:
        """(count, 2) um, uniform at random where a filament's centre may be."""
        room = np.array(self.half) - 0.5 * diameter
        u = rng.random((count, 2))
        if not self.oval:
            return (2.0 * u - 1.0) * room
        r, t = np.sqrt(u[:, 0]), 2.0 * np.pi * u[:, 1]
        return room * np.column_stack([r * np.cos(t), r * np.sin(t)])


def random_packing(
    count: int, diameter: float, volume_fraction: float, rng: np.random.Generator, aspect: float | None = None
) -> FloatArray:
    """Random packing to a given fibre volume fraction without overlap, (count, 2) um.

    Vf = count pi D^2 / (4 A) with A the area of the :class:`Envelope` (a circle, or a rectangle of ``aspect``), inside
    which every filament lies wholly. Points uniform at random are relaxed to zero overlap energy
    1/2 sum max(D - d, 0)^2 (L-BFGS over a neighbour list); a start that jams is shaken with falling amplitude and
    relaxed again. No two centres are nearer than D, in floating point. The same generator gives the same packing.
    About 0.8 can be reached with a hundred filaments and more; raises :class:`InputError` where none was found (few
    filaments in a circle: 0.5 for two, 0.78 for seven at best), and for values out of range.
    """
    _positive("diameter", diameter)
    _counted(count)
    if not 0.0 < volume_fraction <= RANDOM_LIMIT:
        raise InputError("volume_fraction", volume_fraction, f"a number above 0, at most {RANDOM_LIMIT}")
    if aspect is not None:
        _positive("aspect", aspect)
    oval = aspect is None
    envelope = Envelope.of(count, diameter, volume_fraction, 1.0 if aspect is None else aspect, oval)
    refusal = InputError(
        "assembly.fibre_volume_fraction",
        volume_fraction,
        f"a fraction that {count} filaments can reach at random without overlap",
    )
    if min(envelope.half) < 0.5 * diameter * (1.0 + 1e-9):
        raise refusal
    best = relaxed_packing(count, diameter, envelope, rng)
    if best is None:
        raise refusal
    return best


@_one_thread
def relaxed_packing(
    count: int, diameter: float, envelope: Outline, rng: np.random.Generator, start: FloatArray | None = None
) -> FloatArray | None:
    """Filaments at random inside an outline without overlap, (count, 2) um; ``None`` where 20 shakes found none.

    The search of :func:`random_packing`, from points uniform at random or from ``start`` (count, 2) um.
    """
    d = diameter * (1.0 + 1e-9)  # a margin for rounding, so that the end state keeps D exactly
    best = envelope.sample(count, d, rng) if start is None else start
    best, energy = _relax(best, d, envelope)
    shakes = 20
    for k in range(shakes):
        if energy == 0.0:
            break
        amplitude = 0.25 * d * (1.0 - k / shakes)
        trial, e = _relax(best + amplitude * rng.standard_normal(best.shape), d, envelope)
        if e < energy:
            best, energy = trial, e
    if min_distance(best) < diameter or envelope.penalty(best, diameter)[0] > 0.0:
        return None
    return best


@_one_thread
def separated(centres: FloatArray, diameter: float) -> FloatArray:
    """Centres (n, 2) um moved as little as clears every overlap: no two of them nearer than ``diameter``.

    Least sum of squared shifts subject to |c_i - c_j| >= D. Each round replaces the distances by their tangents at the
    last state, which distances never fall below, and solves that quadratic programme exactly in its dual (one
    multiplier a near pair); so every round keeps clear of overlap and none moves further than the last (the
    convex-concave procedure, Yuille and Rangarajan 2003). A local minimum; where only pairs overlap, the minimum: each
    filament moves by half the overlap. Centres without overlap come back as they are.
    Raises :class:`InputError` for two centres nearer than half a diameter: two finds of one filament.
    """
    _positive("diameter", diameter)
    start = np.array(centres, dtype=float)
    least = min_distance(start)
    if least >= diameter:
        return start
    if least < 0.5 * diameter:
        expected = f"at least half a diameter apart, {diameter / 2:g} um"
        raise InputError("centres", f"two of them {least:.4g} um apart", expected)
    d = diameter * (1.0 + 1e-7)  # what the dual leaves open
    state, moved = start, np.inf
    for _ in range(SEPARATION_ROUNDS):
        state = _moved_apart(start, state, d)
        total = float(np.sum((state - start) ** 2))
        if total > (1.0 - 1e-3) * moved:
            break
        moved = total
    return _no_closer(state, diameter)


def _moved_apart(start: FloatArray, state: FloatArray, d: float) -> FloatArray:
    """Nearest positions to ``start`` that keep pairs apart along the directions they have in ``state``."""
    reach = 1.3 * d
    while True:
        pairs = cKDTree(state).query_pairs(reach, output_type="ndarray")
        i, j = pairs[:, 0], pairs[:, 1]
        v = state[i] - state[j]
        n = v / np.hypot(v[:, 0], v[:, 1])[:, None]
        short = d - np.sum(n * (start[i] - start[j]), axis=1)
        count, row = len(start), np.arange(len(pairs))
        at = np.tile(row, 2), np.concatenate([i, j])
        pull = [csr_array((np.concatenate([n[:, k], -n[:, k]]), at), (len(row), count)) for k in (0, 1)]

        def dual(
            force: FloatArray, pull: list[csr_array] = pull, short: FloatArray = short
        ) -> tuple[float, FloatArray]:
            shift = [p.T @ force for p in pull]
            value = 0.5 * sum(float(s @ s) for s in shift) - float(short @ force)
            return value, sum(p @ s for p, s in zip(pull, shift, strict=True)) - short

        solved = minimize(
            dual,
            np.maximum(short, 0.0) / 2,
            jac=True,
            method="L-BFGS-B",
            bounds=[(0.0, None)] * len(row),
            options={"maxiter": 5000, "maxfun": 10_000, "ftol": 1e-15, "gtol": 1e-9 * d, "maxcor": 30},
        )
        result = start + np.column_stack([p.T @ solved.x for p in pull])
        # pairs that were too far to be heeded may have met
        if min_distance(result) >= d * (1 - 1e-6) or reach > 3.0 * d:
            return result
        reach += 0.5 * d


def enclosing_area(centres: FloatArray, diameter: float) -> float:
    """Area in um2 of the convex hull of the filaments' discs: hull of the centres, grown by D/2."""
    low, high = centres.min(axis=0), centres.max(axis=0)
    area, rim = 0.0, 2.0 * float(np.hypot(*(high - low)))  # centres in one line: there and back
    if len(centres) >= 3:
        with suppress(QhullError):
            hull = ConvexHull(centres)
            area, rim = float(hull.volume), float(hull.area)
    return area + 0.5 * diameter * rim + 0.25 * np.pi * diameter**2


def min_distance(centres: FloatArray) -> float:
    """Least distance of two centres in um; infinite for fewer than two."""
    if len(centres) < 2:
        return float("inf")
    nearest = np.asarray(cKDTree(centres).query(centres, k=2)[0])
    return float(nearest[:, 1].min())


Arrangement = Callable[[ArrangementSpec, float, np.random.Generator], FloatArray]

#: name -> centres from (spec, diameter, generator)
ARRANGEMENTS: dict[str, Arrangement] = {
    "circular": lambda s, d, rng: circular(s.count, _pitch(s, d), s.first_angle),
    "hexagonal": lambda s, d, rng: hexagonal(s.count, _pitch(s, d)),
    "rectangular": lambda s, d, rng: rectangular(s.count, _pitch(s, d), s.aspect),
    "elliptic": lambda s, d, rng: elliptic(s.count, _pitch(s, d), s.aspect),
    "racetrack": lambda s, d, rng: racetrack(s.count, _pitch(s, d), s.aspect),
    "virtual": lambda s, d, rng: virtual_locations(s.count, _pitch(s, d), rng, s),
    "file": lambda s, d, rng: _given(s, d),
    "random": lambda s, d, rng: random_packing(s.count, d, _fraction(s), rng),
    "random-rectangular": lambda s, d, rng: random_packing(s.count, d, _fraction(s), rng, s.aspect),
}


def arrange(spec: ArrangementSpec, diameter: float, rng: np.random.Generator) -> FloatArray:
    """Filament centres (count, 2) um of an arrangement for filaments of ``diameter`` um.

    Raises :class:`InputError` for an unknown name, a pitch below the diameter, or what the arrangement itself refuses.
    """
    if spec.name not in ARRANGEMENTS:
        raise InputError("arrangement", spec.name, "one of " + ", ".join(sorted(ARRANGEMENTS)))
    _positive("diameter", diameter)
    return ARRANGEMENTS[spec.name](spec, diameter, rng)


def _pitch(spec: ArrangementSpec, diameter: float) -> float:
    if spec.pitch is None:
        return pitch_from_void_fraction(diameter, 1.0 - _fraction(spec))
    if not spec.pitch >= diameter:
        raise InputError("pitch", spec.pitch, f"at least the diameter {diameter:g} um")
    return spec.pitch


def _given(spec: ArrangementSpec, diameter: float) -> FloatArray:
    """The spec's own centres about their mean, overlaps cleared."""
    if spec.centres is None or len(spec.centres) != spec.count:
        raise InputError("centres", None if spec.centres is None else len(spec.centres), f"{spec.count} centres")
    centres = np.array(spec.centres, dtype=float)
    return separated(centres - centres.mean(axis=0), diameter)


def _fraction(spec: ArrangementSpec) -> float:
    if spec.volume_fraction is None:
        raise InputError("volume_fraction", None, f"a fibre volume fraction for the arrangement {spec.name!r}")
    return spec.volume_fraction


def _positive(key: str, value: float) -> None:
    if not (value > 0.0 and np.isfinite(value)):
        raise InputError(key, value, "a finite number above 0")


def _counted(count: int) -> int:
    if isinstance(count, bool) or int(count) != count or count < 1:
        raise InputError("count", count, "a whole number of at least 1")
    return int(count)


def _ring_sites(count: int) -> tuple[IntArray, IntArray, IntArray]:
    """Of the first ``count`` ring filaments: ring, place in it, and how many share that ring."""
    i = np.arange(count, dtype=np.int64)
    ring = np.ceil((np.sqrt(12.0 * i + 9.0) - 3.0) / 6.0 - 1e-12).astype(np.int64)
    k = i - np.where(ring > 0, 1 + 3 * ring * (ring - 1), 0)
    return ring, k, np.bincount(ring)[ring]


def _ellipse_points(a: float, b: float, n: int) -> FloatArray:
    """(n, 2) points at equal arc length on an ellipse, the first at the top, anticlockwise."""
    t = 0.5 * np.pi + np.linspace(0.0, 2.0 * np.pi, 64 * max(n, 16) + 1)
    s = np.concatenate([[0.0], np.cumsum(np.hypot(a * np.diff(np.cos(t)), b * np.diff(np.sin(t))))])
    at = np.interp(np.arange(n) * s[-1] / n, s, t)
    return np.column_stack([a * np.cos(at), b * np.sin(at)])


def _elliptic_rings(count: int, aspect: float) -> FloatArray:
    """Rings of semi-axes l + e and l about a line of half length e, in units of the pitch; the last one part filled."""
    # area of the outline pi A B = count pi / 3, as for the circular rings
    e = (aspect - 1.0) * float(np.sqrt(count / (3.0 * aspect)))
    m = count if count == 2 else min(int(2.0 * e + 1e-9) + 1, count)
    half = 0.5 * (m - 1) if m in (1, count) else e
    parts = [np.column_stack([np.linspace(-half, half, m), np.zeros(m)])]
    left, ring = count - m, 0
    while left > 0:
        ring += 1
        # perimeter 4 a E(1 - b^2 / a^2); a filament every pi / 3 of it
        perimeter = 4.0 * (ring + e) * float(ellipe(1.0 - (ring / (ring + e)) ** 2))
        n = min(int(perimeter * 3.0 / np.pi + 1e-9), left)
        parts.append(_ellipse_points(ring + e, float(ring), n))
        left -= n
    return np.concatenate(parts)


def _finish(centres: FloatArray, pitch: float) -> FloatArray:
    return _no_closer(centres - centres.mean(axis=0), pitch)


def _no_closer(centres: FloatArray, pitch: float) -> FloatArray:
    """Open by what rounding took, so that no distance is below the pitch in floating point."""
    opening = 2.0**-51
    while (least := min_distance(centres)) < pitch:
        centres = centres * max(pitch / least, 1.0 + opening)
        opening *= 2.0  # far from the origin one unit in the last place is not enough
    return centres


def _overlap_energy(
    x: FloatArray, i: IntArray, j: IntArray, diameter: float, envelope: Outline
) -> tuple[float, FloatArray]:
    c = x.reshape(-1, 2)
    n = len(c)
    v = c[i] - c[j]
    r = np.hypot(v[:, 0], v[:, 1])
    hit = r < diameter
    i, j, r = i[hit], j[hit], r[hit]
    overlap = diameter - r
    push = v[hit] * (overlap / np.maximum(r, 1e-300))[:, None]
    energy, gradient = envelope.penalty(c, diameter)
    for axis in (0, 1):
        gradient[:, axis] += np.bincount(j, push[:, axis], n) - np.bincount(i, push[:, axis], n)
    return energy + 0.5 * float(overlap @ overlap), gradient.ravel()


def _relax(centres: FloatArray, diameter: float, envelope: Outline, rounds: int = 60) -> tuple[FloatArray, float]:
    """Nearest state of least overlap; the neighbour list is made anew when filaments have moved half its skin."""
    skin, steps, last = 0.4 * diameter, 60, np.inf
    for _ in range(rounds):
        pairs = cKDTree(centres).query_pairs(diameter + skin, output_type="ndarray")
        result = minimize(
            _overlap_energy,
            centres.ravel(),
            args=(pairs[:, 0], pairs[:, 1], diameter, envelope),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": steps, "ftol": 0.0, "gtol": 1e-13 * diameter, "maxcor": 20},
        )
        moved = result.x.reshape(-1, 2)
        far = float(np.hypot(*(moved - centres).T).max()) >= 0.5 * skin
        centres = moved
        if far:
            continue
        if result.fun == 0.0 or result.fun > 0.9 * last:
            return centres, float(result.fun)
        last = float(result.fun)
    pairs = cKDTree(centres).query_pairs(diameter, output_type="ndarray")
    return centres, _overlap_energy(centres.ravel(), pairs[:, 0], pairs[:, 1], diameter, envelope)[0]
