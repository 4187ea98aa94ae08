"""Where a filament's beads stand, what they weigh and how its ends are held.

All filaments share their stations along x, so beads in contact lie in the same cross-section.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from cgfibre.build.spacing import SpacingSpec
from cgfibre.build.spacing import stations as lay_stations
from cgfibre.build.system import FilamentType, FloatArray, IntArray
from cgfibre.errors import InputError
from cgfibre.mechanics import rod
from cgfibre.mechanics.support import axial_end_stiffness, chain_end, far_field_stiffness
from cgfibre.plan.contact import ContactPlan
from cgfibre.plan.model import CONTACT, FREE, GRIP_STIFFENING, LEFT, RIGHT, ROD_DAMPING, Beads
from cgfibre.scene import Scene

#: part of the limiting time step that is used: the limit is a bound already, this is room for large rotation
SAFETY = 0.9
#: the same for beads whose mass is chosen for the step: more room costs nothing there, and their bonds are damped too
FREE_SAFETY = 0.65
#: a far field is worth treating apart when the filament is this many times longer than the zone that needs fine beads
FAR_FIELD_RATIO = 3.0
#: displacement over height to which half a bundle does as all of it (carbon-37: alike to 14 of 54 um; to 30 um the
#: force of the half changed by 9 % on halving the platen speed, that of all of it by 3 %)
SYMMETRIC_STRAIN = 1 / 3
COARSE = 0.05  # of the length: spacing of graded far-field beads


def fine_zone(scene: Scene, height: float, bending_length: float) -> tuple[float, float]:
    """Part of the filaments that needs fine beads, um: the platen, and beyond it what bends or touches.

    Margin: two heights of the assembly or the boundary layer sqrt(EI/P) of a tensioned filament, whichever is more.
    """
    length = scene.bundle.length
    lo, hi = platen_span(scene)
    margin = max(2 * height, bending_length)
    return max(0.0, lo - margin), min(length, hi + margin)


def _centred(length: float, width: float | str) -> tuple[float, float]:
    span = length if width == "full" else float(width)
    return (length - span) / 2, (length + span) / 2


def platen_span(scene: Scene) -> tuple[float, float]:
    """x of the top platen's edges, um."""
    return _centred(scene.bundle.length, scene.platens.width)


def bottom_span(scene: Scene) -> tuple[float, float]:
    """x of the bottom platen's edges, um; as the top one unless the scene says otherwise."""
    asked = scene.platens.bottom_width
    return platen_span(scene) if asked is None else _centred(scene.bundle.length, asked)


def choose_far_field(scene: Scene, level: str, zone: tuple[float, float]) -> tuple[str, str]:
    """(form, reason) of the far field: none, graded or condensed."""
    asked, length = scene.model.far_field, scene.bundle.length
    if asked != "auto":
        if asked == "condensed" and (level != "chain" or scene.ends.support != "simply-supported"):
            raise InputError(
                "model.far_field",
                asked,
                'graded: the condensed form needs level = "chain" and '
                "simply-supported ends (it has no bead for a rod's rotation)",
            )
        beyond = max(zone[0], length - zone[1])
        if asked != "none" and beyond <= 2 * scene.filament.diameter:
            if asked == "condensed":
                expected = f"'auto' or 'none': only {beyond:.3g} um are left beyond the zone that needs fine beads"
                raise InputError("model.far_field", asked, expected)
            return "none", "the fine zone is all of the filament, nothing is left to grade"
        return asked, "as asked in the scene"
    if length <= FAR_FIELD_RATIO * (zone[1] - zone[0]) or scene.ends.support == "symmetry":
        return "none", "the fine zone is most of the filament"
    if level == "chain" and scene.ends.support == "simply-supported" and scene.ends.tension > 0:
        return "condensed", "beyond the zone a filament is a pre-tensioned beam, whose end stiffness is known exactly"
    return "graded", "coarse beads beyond the zone carry its stiffness"


@dataclass(frozen=True)
class Layout:
    """Where the beads of every filament stand: ``stations`` um, ``role``, the ``zone`` of fine beads um, the form of
    the ``far_field`` and the constants of its condensed end (else empty); ``half``: only the right half is modelled."""

    stations: FloatArray
    role: IntArray
    zone: tuple[float, float]
    far_field: str
    condensed: dict[str, float]
    half: bool = False


def choose_symmetry(scene: Scene, level: str, far_field: str, strain: float) -> tuple[bool, str]:
    """(half, reason): whether the right half of the assembly is modelled in place of all of it.

    Straight filaments between centred platens are their own mirror image about mid-span; only a free left end, or a
    buckling that takes sides, is lost, so a bundle pressed deep (``strain``, the displacement over the height) is
    modelled whole. A rod would need its turn about y and z held there.
    """
    against = ""
    if level != "chain":
        against = "only chains have it"
    elif not scene.bundle.straight or scene.model.torsion == "dihedral":
        against = "twisted or migrating filaments are not their own mirror image"
    elif scene.ends.support == "symmetry":
        against = "a periodic cell has no middle"
    elif far_field == "condensed":
        against = "a condensed far field is short already"
    asked = scene.model.symmetry
    if asked == "half" and against:
        raise InputError("model.symmetry", asked, f"'auto' or 'none': {against}")
    if asked == "none":
        return False, "as asked in the scene"
    if against:
        return False, against
    if asked == "auto" and scene.bundle.count > 1 and strain > SYMMETRIC_STRAIN:
        return False, (
            f"pressed by {strain:.0%} of its height it gives way where columns buckle, and buckling takes sides: a "
            "half locks and yields at other displacements"
        )
    return True, "straight filaments between centred platens: the left half mirrors the right one, at half the cost"


def lay_beads(
    scene: Scene,
    filament: FilamentType,
    level: str,
    spacing: float,
    zone: tuple[float, float],
    far_field: str,
    half: bool = False,
    segments: bool = False,
) -> Layout:
    """Stations and roles of the beads at most ``spacing`` um apart in the ``zone``.

    ``segments``: filaments touch along their segments, so any length of them meets its neighbours and platens need no
    bead at their edges. ``half``: mid-span lies between two beads, with segments on one.
    """
    length = scene.bundle.length
    anchors = tuple(x for span in (platen_span(scene), bottom_span(scene)) for x in span if 0 < x < length)
    if segments:
        anchors = (length / 2,) if half else ()
    extras: dict[str, float] = {}
    if far_field == "none":
        spec = SpacingSpec(length=length, fine=spacing, anchors=anchors)
    else:
        spec = SpacingSpec(
            length=length, fine=spacing, zone=zone, coarse=max(spacing, COARSE * length), anchors=anchors
        )
    stations = lay_stations(spec)
    if half and not segments and len(stations) % 2:
        # one segment more between the anchors about mid-span: the plane of symmetry halves no bead
        inner = np.array([x for x in (0.0, length, *anchors, *(spec.zone or ()))])
        lo, hi = np.max(inner[inner < length / 2]), np.min(inner[inner > length / 2])
        count = np.count_nonzero((stations > lo - 1e-9) & (stations < hi + 1e-9)) - 1
        stations = lay_stations(replace(spec, fine=float(hi - lo) / (count + 1) * (1 + 1e-9)))
    support = scene.ends.support
    if far_field == "condensed":
        inside = (stations >= zone[0] - 1e-9) & (stations <= zone[1] + 1e-9)
        stations = stations[inside]
        segment = float(stations[1] - stations[0])
        outside = float(stations[0])
        stiffness = far_field_stiffness(outside, filament.EI, scene.ends.tension)
        end = chain_end(stiffness, segment, filament.EI, scene.ends.tension)
        extras = {
            "hinge": end.hinge,
            "transverse": end.spring,
            "distance": end.distance,
            "axial": float(axial_end_stiffness(outside, filament.EA)),
        }
        stations = np.concatenate([[stations[0] - end.distance], stations, [stations[-1] + end.distance]])
    elif support == "clamped":
        # two held beads make a clamp: one more beyond each end
        stations = np.concatenate([[-(stations[1] - stations[0])], stations, [2 * stations[-1] - stations[-2]]])
    elif support == "symmetry":
        stations = stations[:-1]  # a closed filament: the last station is the first of the next cell
    gaps = np.diff(stations)
    widest = np.maximum(np.append(gaps, gaps[-1]), np.insert(gaps, 0, gaps[0]))
    # one filament alone has no neighbours for its beads to miss
    meets = scene.bundle.count == 1 or segments
    reach = max(filament.diameter, spacing) if meets else filament.diameter
    role = np.where(widest <= reach * (1 + 1e-9), CONTACT, FREE)
    if support != "symmetry":
        held = 2 if support == "clamped" else 1
        role[:held], role[-held:] = LEFT, RIGHT
    halved = half and len(stations) % 2 == int(segments)
    return Layout(stations, role.astype(np.int64), zone, far_field, extras, halved)


def bond_lengths(stations: FloatArray, closed: bool, length: float) -> FloatArray:
    """Lengths between stations, um, with the closing one of a periodic cell."""
    gaps = np.diff(stations)
    return np.append(gaps, length - (stations[-1] - stations[0])) if closed else gaps


def _check_natural_length(scene: Scene) -> None:
    """Refuse periodic rods under tension: they could not be laid out in their natural length."""
    cut = scene.bundle.twist_state == "tensioned" and not scene.bundle.straight
    if scene.ends.tension > 0 or cut:
        raise InputError(
            "assembly.twist_state" if cut else "ends.tension",
            "tensioned" if cut else f"{scene.ends.tension:g} nN",
            f"{'stress-free' if cut else '0 N'} with symmetry ends at level rod (a periodic rod cannot be laid out in "
            'its natural length), or model.level = "chain"',
        )


def finish_beads(
    scene: Scene, filament: FilamentType, level: str, layout: Layout, softening: float, contact: ContactPlan
) -> tuple[Beads, float]:
    """(beads, limiting time step us): real masses under contact, for the rest the mass that the same step allows.

    The limit adds bounds of stretching and bending to those of six contacts with their damping: it is proven, not
    tried.
    """
    if level == "rod" and scene.ends.support == "symmetry":
        _check_natural_length(scene)
    support, stations, role, extras = scene.ends.support, layout.stations, layout.role, layout.condensed
    closed = support == "symmetry"
    gaps = bond_lengths(stations, closed, scene.bundle.length)
    EA, tension = filament.EA / softening, scene.ends.tension
    n = len(stations)
    mass = np.zeros(n)
    np.add.at(mass, np.arange(len(gaps)), 0.5 * gaps)
    np.add.at(mass, (np.arange(len(gaps)) + 1) % n, 0.5 * gaps)
    mass *= filament.mass_per_length
    clamped = support == "clamped" and level == "chain"
    chain = rod.chain_coefficients(gaps, EA, filament.EI, closed=closed, clamped=(clamped, clamped))
    hinge = np.zeros(n)
    if closed:
        hinge[:] = chain.angle
    else:
        hinge[1:-1] = chain.angle
    if extras:
        hinge[1] = hinge[-2] = extras["hinge"]
    if level == "rod":
        every = rod.rod_coefficients(gaps, EA, filament.EI, filament.GJ, filament.kGA)
        bound = rod.rod_stiffness_bound(gaps, filament.diameter, every, tension, closed=closed)
        if support == "simply-supported":
            gripped = (2 + GRIP_STIFFENING) * every.kt[[0, -1]] / (rod.SPHERE_INERTIA * filament.diameter**2)
            bound[[0, -1]] = np.maximum(bound[[0, -1]], gripped)
    else:
        actual = rod.ChainCoefficients(chain.bond, hinge if closed else hinge[1:-1])
        bound = rod.chain_stiffness_bound(gaps, actual, tension, closed=closed)
        if extras:
            bound[[0, -1]] += max(extras["transverse"], extras["axial"])
    real = role == CONTACT
    touching, damping = contact.bounds(rod.SPHERE_INERTIA if level == "rod" else math.inf)
    bonds = 2 * ROD_DAMPING * np.sqrt(bound[real] * mass[real]) if level == "rod" else 0.0
    limit = float(rod.limiting_time_step(bound[real] + touching, mass[real], damping + bonds))
    mass[~real] = rod.mass_for_time_step(bound[~real], SAFETY * limit, fraction=FREE_SAFETY)
    held = int(np.sum(role == RIGHT))
    beads = Beads(
        stations=stations,
        role=role,
        mass=mass,
        hinge=hinge,
        support="periodic" if closed else "condensed" if extras else "symmetric" if layout.half else "simple",
        end_load=tension / held if held else 0.0,
        tension=tension,
        far_spring=(extras["transverse"], extras["axial"]) if extras else (0.0, 0.0),
        closed=closed,
        far_field=layout.far_field,
        zone=layout.zone,
    )
    return beads, limit
