"""Paths of filaments: (n_filaments, n_stations, 3) arrays of x, y, z in um, all sampled at the same stations x.

The section as given stands at mid-length, (first + last station) / 2, where the platens press. Twist is in turns per
um: positive is Z twist, a right-handed helix (seen from the side with the axis upright, the filaments in front rise to
the right, like the bar of the letter Z); moving along +x a filament turns from +y towards +z. Negative is S twist.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from cgfibre.build.packing import min_distance
from cgfibre.build.system import FloatArray
from cgfibre.errors import InputError


def straight(centres: FloatArray, stations: FloatArray) -> FloatArray:
    """Filaments parallel to x through ``centres`` (n, 2) at ``stations`` (m,): (n, m, 3) um."""
    path = np.empty((len(centres), len(stations), 3))
    path[:, :, 0] = stations
    path[:, :, 1:] = centres[:, None, :]
    return path


def helical(centres: FloatArray, stations: FloatArray, twist: float) -> FloatArray:
    """Filaments that turn about the x axis by 2 pi ``twist`` (x - xm), xm mid-length: (n, m, 3) um.

    y = y0 cos a - z0 sin a, z = y0 sin a + z0 cos a; ``twist`` turns per um, positive Z (right-handed), see the module.
    Straight chords join the beads: a filament at radius R cuts its corner by R (1 - cos(pi twist s)) at spacing s.
    """
    path = straight(centres, stations)
    _turn(path, twist)
    return path


def helix_stretch(radius: FloatArray, twist: float) -> FloatArray:
    """Length of a helix over its axial length, less one: sqrt(1 + (2 pi n R)^2) - 1, same shape as ``radius``."""
    a = 2.0 * np.pi * twist * np.asarray(radius, dtype=float)
    return a**2 / (1.0 + np.sqrt(1.0 + a**2))  # the same without cancellation


def helix_curvature(radius: FloatArray, twist: float) -> FloatArray:
    """Curvature of a helix in 1/um, R w^2 / (1 + (R w)^2) with w = 2 pi n, same shape as ``radius``."""
    w = 2.0 * np.pi * twist
    r = np.asarray(radius, dtype=float)
    return r * w**2 / (1.0 + (r * w) ** 2)


def path_lengths(path: FloatArray) -> FloatArray:
    """(n,) um, length of the chain of straight segments through (n, m, 3) points."""
    return np.linalg.norm(np.diff(path, axis=1), axis=2).sum(axis=1)


def largest_overlap(path: FloatArray, diameter: float) -> float:
    """Largest overlap D - d of two filaments' beads in one cross-section, um; 0 where none touch.

    A nearest-neighbour search (cKDTree) in each plane of ``path`` (n, m, 3); the beads of one station must share x.
    """
    if len(path) < 2:
        return 0.0
    deepest = 0.0
    for k in range(path.shape[1]):
        deepest = max(deepest, diameter - min_distance(path[:, k, 1:]))
    return deepest


def migration_radius(
    angle: FloatArray, inner: float, outer: float, height: float, wavelength: float, phase: float = 0.0
) -> FloatArray:
    """Radius of a migrating helix, R = Rmin + (Rmax - Rmin)/2 (1 - cos(2 pi h t / lambda + phase)), um (Eq. 2-2).

    ``angle`` t rad is the helix' rotation and ``height`` h um its axial advance per radian, so that h t = x; Rmin and
    Rmax ``inner`` and ``outer`` um; lambda ``wavelength`` um along x. The thesis' print (after Sreprateep and Bohez,
    Computer-Aided Design and Applications 3, 2006, 367-376) has lost its fraction bars; this is the form in which h is
    the height, lambda the wavelength, and the period of R is lambda (our reading: the paper itself was not read).
    Raises :class:`InputError` unless 0 <= Rmin <= Rmax and lambda > 0.
    """
    if not 0.0 <= inner <= outer:
        raise InputError("inner", inner, f"a radius from 0 to the outer one, {outer:g}")
    if not wavelength > 0.0:
        raise InputError("wavelength", wavelength, "a length above 0 um")
    wave = 1.0 - np.cos(2.0 * np.pi * height * np.asarray(angle, dtype=float) / wavelength + phase)
    return inner + 0.5 * (outer - inner) * wave


@dataclass(frozen=True)
class MigrationSpec:
    """How filaments change their radius along the length.

    Attributes
    ----------
    period : um along x, from the inside to the outside and back
    law : a key of :data:`MIGRATION_LAWS`
    inner, outer : fractions of the section's largest centre radius between which filaments migrate; others stay
    max_overlap : overlap over diameter that the builder accepts
    planes_per_period : control planes, between which paths are cubic splines
    """

    period: float
    law: str = "exchange"
    inner: float = 0.0
    outer: float = 1.0
    max_overlap: float = 0.02
    planes_per_period: int = 256

    def __post_init__(self) -> None:
        if not (np.isfinite(self.period) and self.period > 0.0):
            raise InputError("migration.period", self.period, "a finite length above 0 um")
        if self.law not in MIGRATION_LAWS:
            raise InputError("migration.law", self.law, "one of " + ", ".join(sorted(MIGRATION_LAWS)))
        if not 0.0 <= self.inner < self.outer <= 1.0:
            raise InputError("migration.inner, outer", (self.inner, self.outer), "fractions 0 <= inner < outer <= 1")
        if not self.max_overlap > 0.0:
            raise InputError("migration.max_overlap", self.max_overlap, "a fraction of the diameter above 0")
        if self.planes_per_period < 16:
            raise InputError("migration.planes_per_period", self.planes_per_period, "at least 16")


#: passes of smoothing along x, each followed by pushing apart
SMOOTHING = 3

RadiusLaw = Callable[[FloatArray, FloatArray, "MigrationSpec"], Callable[[float], FloatArray]]


def exchange_law(radius: FloatArray, direction: FloatArray, spec: MigrationSpec) -> Callable[[float], FloatArray]:
    """Target radii (n,) as a function of x that keep the section's radial density at every x.

    Each migrating filament's rank of radius u in (0, 1) runs up and down at a constant rate, a triangular wave of the
    period, and R = Q(u) with Q the quantile function of the section's own radii: filaments exchange places, and the
    radii at any x are spread as in the section. For a section of uniform density R^2 is then linear in x, the "ideal
    migration" of yarn mechanics; for one built with Eq. 2-1 the packing probability holds along the length. The cosine
    of Eq. 2-2 would gather filaments at both of its ends.
    """
    largest = float(radius.max(initial=0.0))
    moving = np.flatnonzero((radius >= spec.inner * largest) & (radius <= spec.outer * largest))
    order = moving[np.argsort(radius[moving], kind="stable")]
    sorted_radii = radius[order]
    at = (np.arange(len(order)) + 0.5) / max(len(order), 1)
    # phase in periods: rising filaments on (0, 1/2), falling ones on (1/2, 1)
    phase = np.where(direction[order] > 0, 0.5 * at, 1.0 - 0.5 * at)

    def target(x: float) -> FloatArray:
        f = np.mod(phase + x / spec.period, 1.0)
        r = radius.copy()
        r[order] = np.interp(1.0 - np.abs(1.0 - 2.0 * f), at, sorted_radii)
        return r

    return target


def cosine_law(radius: FloatArray, direction: FloatArray, spec: MigrationSpec) -> Callable[[float], FloatArray]:
    """Target radii (n,) as a function of x by Eq. 2-2 (:func:`migration_radius`), its phase from the section's radius.

    The density is not kept: filaments gather near both limits, and overlaps are what :func:`migrating` can push aside.
    """
    largest = float(radius.max(initial=0.0))
    inner, outer = spec.inner * largest, spec.outer * largest
    moving = (radius >= inner) & (radius <= outer) & (outer > inner)
    phase = np.zeros_like(radius)
    phase[moving] = np.arccos(np.clip(1.0 - 2.0 * (radius[moving] - inner) / (outer - inner), -1.0, 1.0))
    phase = np.where(direction > 0, phase, -phase)

    def target(x: float) -> FloatArray:
        r = inner + 0.5 * (outer - inner) * (1.0 - np.cos(2.0 * np.pi * x / spec.period + phase))
        return np.where(moving, r, radius)

    return target


#: name -> target radii from (radii of the section, +1 outwards or -1 inwards, spec)
MIGRATION_LAWS: dict[str, RadiusLaw] = {"exchange": exchange_law, "cosine": cosine_law}


@dataclass(frozen=True)
class MigratingPaths:
    """Paths (n, m, 3) um and (n,) arc lengths um of migrating filaments."""

    path: FloatArray
    arc_lengths: FloatArray


def migrating(
    centres: FloatArray,
    stations: FloatArray,
    diameter: float,
    spec: MigrationSpec,
    twist: float,
    rng: np.random.Generator,
) -> MigratingPaths:
    """Filaments that migrate between inside and outside, twisted on top: paths and arc lengths.

    From mid-length, where the section is the one given, control planes are stepped towards both ends: each filament
    moves towards the target radius of its law at unchanged angle (half of them outwards first, chosen at random), by
    0.15 D at most, then pairs that overlap are pushed apart along their line until none is closer than 1.005 D or 200
    rounds are over, so filaments pass each other sideways; the planes are then smoothed along x and pushed apart again.
    Paths are cubic splines through them (no kinks), turned as in :func:`helical`. How well it went is for
    :func:`largest_overlap` to say (under 1 % of D in rings at 31 % void). Filaments in a crowd come late: at 256 planes
    a period 127 filaments cover about 3/4 of the outer radius, at 512 planes 7/8, in dense sections less.
    Arc lengths are integrated over the control planes, not over the stations.
    """
    xm = 0.5 * float(stations[0] + stations[-1])
    half = 0.5 * float(stations[-1] - stations[0])
    steps = max(int(np.ceil(half / spec.period * spec.planes_per_period)), 4)
    dx = half / steps
    radius = np.hypot(centres[:, 0], centres[:, 1])
    # neighbours in radius go opposite ways, so that inwards and outwards balance at every radius
    order = np.argsort(radius, kind="stable")
    direction = np.empty(len(centres))
    coins = rng.integers(0, 2, (len(centres) + 1) // 2) * 2.0 - 1.0
    direction[order] = np.column_stack([coins, -coins]).ravel()[: len(centres)]
    target = MIGRATION_LAWS[spec.law](radius, direction, spec)
    angle = rng.uniform(0.0, 2.0 * np.pi, len(centres))  # way out for a filament on the axis
    control = np.empty((2 * steps + 1, len(centres), 2))
    control[steps] = centres
    for sign in (1, -1):
        for k in range(1, steps + 1):
            c = control[steps + sign * (k - 1)]
            control[steps + sign * k] = _step(c, target(sign * k * dx), angle, diameter)
    for _ in range(SMOOTHING):
        inner = 0.25 * control[:-2] + 0.5 * control[1:-1] + 0.25 * control[2:]
        control[1:-1] = inner
        control[steps] = centres
        for k in range(2 * steps + 1):
            if k != steps:
                control[k] = _push_apart(control[k], 1.005 * diameter)
    spline = CubicSpline(xm + dx * np.arange(-steps, steps + 1), control, axis=0)
    path = np.empty((len(centres), len(stations), 3))
    path[:, :, 0] = stations
    path[:, :, 1:] = spline(stations).transpose(1, 0, 2)
    lengths = _arc_lengths(spline, twist)
    _turn(path, twist)
    return MigratingPaths(path, lengths)


def _turn(path: FloatArray, twist: float) -> None:
    x = path[0, :, 0]
    a = 2.0 * np.pi * twist * (x - 0.5 * (x[0] + x[-1]))
    cos, sin = np.cos(a), np.sin(a)
    y = path[:, :, 1].copy()
    path[:, :, 1] *= cos
    path[:, :, 1] -= path[:, :, 2] * sin
    path[:, :, 2] *= cos
    path[:, :, 2] += y * sin


def _step(c: FloatArray, target: FloatArray, angle: FloatArray, diameter: float) -> FloatArray:
    r = np.hypot(c[:, 0], c[:, 1])
    on_axis = r < 1e-6 * diameter
    way = np.where(
        on_axis[:, None],
        np.column_stack([np.cos(angle), np.sin(angle)]),
        c / np.where(on_axis, 1.0, r)[:, None],
    )
    # a filament that is late must not leap over others
    move = np.clip(target - r, -0.15 * diameter, 0.15 * diameter)
    return _push_apart(c + way * move[:, None], 1.005 * diameter)


def _push_apart(c: FloatArray, distance: float) -> FloatArray:
    n = len(c)
    skin = 0.3 * distance
    for _ in range(20):
        start = c
        pairs = cKDTree(c).query_pairs(distance + skin, output_type="ndarray")
        for _ in range(10):
            i, j = pairs[:, 0], pairs[:, 1]
            v = c[i] - c[j]
            d = np.hypot(v[:, 0], v[:, 1])
            hit = d < distance * (1.0 - 1e-4)
            if not hit.any():
                if np.abs(c - start).max() < 0.35 * skin:
                    return c
                break
            i, j = i[hit], j[hit]
            push = v[hit] * (0.5 * (distance - d[hit]) / np.maximum(d[hit], 1e-9 * distance))[:, None]
            shift = np.column_stack([np.bincount(i, push[:, a], n) - np.bincount(j, push[:, a], n) for a in (0, 1)])
            c = c + shift
    return c


def _arc_lengths(spline: CubicSpline, twist: float) -> FloatArray:
    """(n,) um: integral of sqrt(1 + |c'|^2) in the turned frame, Simpson's rule over the control planes."""
    x = spline.x
    w = 2.0 * np.pi * twist

    def speed(at: FloatArray) -> FloatArray:
        c, d = spline(at), spline(at, 1)
        return np.sqrt(1.0 + (d[..., 0] - w * c[..., 1]) ** 2 + (d[..., 1] + w * c[..., 0]) ** 2)

    total = np.zeros(spline.c.shape[-2])
    for k in range(0, len(x) - 1, 64):  # in blocks, for memory
        at = x[k : k + 65]
        h = np.diff(at)[:, None]
        ends, middle = speed(at), speed(0.5 * (at[:-1] + at[1:]))
        total += np.sum(h / 6.0 * (ends[:-1] + 4.0 * middle + ends[1:]), axis=0)
    return total
