"""Capsules as they lie: the force of segments on each other and on platens against closed forms, beads held.

Levels "chain, capsules" and "rod, capsules". Nothing is to depend on where the beads lie.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.integrate import quad

from cgfibre.build.bundle import BundleSpec, build_bundle
from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.cases.experiment import Measured, Outcome, moved, run, scene
from cgfibre.cases.rods import AWAY, D, filament
from cgfibre.mechanics.contact import LineContact, contact_modulus, crossing_prefactor
from cgfibre.plan.model import Plan

R = D / 2
#: nothing moves but what an experiment moves, and no support takes force off an end bead
HELD = ("unfix integrate", "unfix hold_left", "unfix hold_right")
#: contacts as stiff as they are
REAL = {"contact.softening": 1.0}
#: of the two points in which the plugin takes the force along a touching stretch
GAUSS = 1 / math.sqrt(3)


def line_law() -> LineContact:
    """Line contact of two carbon filaments."""
    f = scene({}).filament
    return LineContact.between(R, R, f.E2, f.nu23, f.E2, f.nu23)


def platen_law() -> LineContact:
    """Line contact of a carbon filament on a rigid platen."""
    f = scene({}).filament
    return LineContact.on_rigid_plane(R, f.E2, f.nu23)


def posed(
    level: str, spacing: float, shapes: Sequence[FloatArray], changes: Mapping[str, object] | None = None
) -> tuple[Plan, FilamentSystem]:
    """Plan and system of filaments through these beads, (n, 3) um each, all of as many segments of ``spacing`` D."""
    plan, one = filament(level, spacing, (len(shapes[0]) - 1) * spacing, REAL | dict(changes or {}))
    centres = np.array([[0.0, 2 * D * k] for k in range(len(shapes))])
    spec = BundleSpec(one.types[0], centres, plan.beads.stations)
    system = build_bundle(spec, np.random.default_rng(0))
    points = np.concatenate(shapes)
    # pinned rods have a grip a segment beyond their ends, and a filament may be carried on by two segments
    reach = float(np.max(np.abs(points))) + (3 * spacing + 4) * D
    return plan, replace(system, positions=points, box=np.array([[-reach, reach]] * 3))


def straight(segments: int, spacing: float, through: Sequence[float] = (0, 0, 0), angle: float = 0.0) -> FloatArray:
    """(segments + 1, 3) um: a straight filament in the plane of x and y whose middle lies at ``through``."""
    along = (np.arange(segments + 1) - segments / 2) * spacing * D
    turn = math.radians(angle)
    way = np.array([math.cos(turn), math.sin(turn), 0.0])
    return np.asarray(through, dtype=float) + along[:, None] * way


def segments_for(spacing: float) -> int:
    """Segments of a filament of 10 at least, and of 40 D."""
    return max(10, math.ceil(40 / spacing))


def reading(
    folder: Path, plan: Plan, system: FilamentSystem, commands: Sequence[str], probes: str, **variables: float | str
) -> tuple[FloatArray, Outcome]:
    """(values of ``probes`` after 20 steps, outcome) of what the commands hold."""
    probe = f'fix probe all ave/time 20 1 20 {probes} file probe.txt format " %.17g"'
    out = run(folder, system, moved(plan, 1e-9, 40, sample=20), [*HELD, *commands, probe], **(AWAY | variables))
    return out.rows("probe.txt")[-1, 1:], out


UPPER = ["group upper molecule 2", "compute grip upper reduce sum fx fy fz"]


# --- normal forces ---------------------------------------------------------------------------------------------------


def line_contact(folder: Path, level: str, spacing: float, load: float = 1.0) -> list[Measured]:
    """Two parallel filaments, out of register by 0.37 s, at the approach that plane strain gives ``load`` N/mm: the
    load per length of overlap. The law itself at every load."""
    law, n = line_law(), segments_for(spacing)
    approach = float(law.approach(load * 1e6))
    shift = 0.37 * spacing * D
    shapes = [straight(n, spacing), straight(n, spacing, (shift, 0, D - approach))]
    plan, system = posed(level, spacing, shapes)
    (_, _, force), out = reading(folder, plan, system, UPPER, "c_grip[*]")
    found = force / (n * spacing * D - shift)
    return [
        Measured(f"line contact, {load:g} N/mm", level, spacing, "line load", "nN/um", found, load * 1e6, out.time.cpu)
    ]


def lens_width(overlap: float, angle: float) -> float:
    """Half width of the lens of two filaments that cross at ``angle`` degrees, along the axes, um."""
    return math.sqrt(overlap * (2 * D - overlap)) / math.sin(math.radians(angle))


def lens_overlap(width: float, angle: float) -> float:
    """Overlap of two crossing filaments whose lens is ``width`` um wide to each side."""
    half = width * math.sin(math.radians(angle))
    return D - math.sqrt(D**2 - half**2)


def crossing_force(overlap: float, angle: float) -> float:
    """Force across two long filaments whose axes pass at D - ``overlap``: the line law over the lens, nN."""
    law, sine, away = line_law(), math.sin(math.radians(angle)), D - overlap
    width = lens_width(overlap, angle)

    def push(s: float) -> float:
        distance = math.hypot(away, s * sine)
        return float(law.line_load(max(D - distance, 0.0))) * away / distance

    return 2 * float(quad(push, 0, width, epsrel=1e-10)[0])


def hertz_force(overlap: float, angle: float) -> float:
    """Hertz' force of filaments that cross, nN."""
    f = scene({}).filament
    modulus = float(contact_modulus(f.E2, f.nu23, f.E2, f.nu23))
    return float(crossing_prefactor(modulus, R, R, math.radians(angle))) * overlap**1.5


#: where the crossing point lies on the lower and the upper filament, in segments from a bead
PLACES = {"between beads": (0.5, 0.37), "on a bead": (0.0, 0.5), "near both": (0.02, -0.03), "on both": (0.0, 0.0)}


def blend(width: float) -> float:
    """Part of the line law in the force of a lens of half width ``width`` R, see crossing_law.h."""
    t = min(max((width - 0.25) / 0.75, 0.0), 1.0)
    return t * t * (3 - 2 * t)


def sampled_force(overlap: float, angle: float, cuts: Sequence[float]) -> float:
    """Force across two filaments that cross as the plugin takes it, at two points of each stretch of the lens, which
    beads cut at ``cuts`` um from its middle along the one filament."""
    sine, away, law = math.sin(math.radians(angle)), D - overlap, line_law()
    whole = lens_width(overlap, angle)
    ends = np.array([-whole, *sorted(c for c in cuts if abs(c) < whole), whole])
    total = 0.0
    for lo, hi in pairwise(ends):
        near = 0.0 if lo <= 0 <= hi else min(abs(lo), abs(hi))
        deepest = D - math.hypot(away, near * sine)
        lens = lens_width(deepest, angle)
        share = blend(lens / R)
        mean = D - math.sqrt((D - deepest) ** 2 + (D**2 - (D - deepest) ** 2) / 3)
        spring = hertz_force(deepest, angle) / (2 * lens * mean)
        half = (hi - lo) / 2
        for s in ((hi + lo) / 2 - GAUSS * half, (hi + lo) / 2 + GAUSS * half):
            distance = math.hypot(away, s * sine)
            f = share * float(law.line_load(D - distance)) + (1 - share) * spring * (D - distance)
            total += half * f * away / distance
    return total


def crossing(folder: Path, level: str, spacing: float, angle: float = 90.0, width: float = 0.2) -> list[Measured]:
    """Two filaments that cross with a lens of ``width`` R to each side of the crossing, wherever that lies on their
    segments (PLACES; the force furthest from the closed form): Hertz' force to 0.25 R, the line law's from 1 R on, a
    blend of both between.

    Stated is what two points of every stretch make of it.
    """
    n = 2 * math.ceil(max(8, 24 / spacing / math.sin(math.radians(max(angle, 20)))) / 2)
    overlap = lens_overlap(width * R, angle)
    exact = blend(width) * crossing_force(overlap, angle) + (1 - blend(width)) * hertz_force(overlap, angle)
    s, turn, worst = spacing * D, math.radians(angle), None
    for place, (lower, upper) in PLACES.items():
        first = straight(n, spacing) - np.array([lower * s, 0, 0])
        way = np.array([math.cos(turn), math.sin(turn), 0.0])
        second = straight(n, spacing, (0, 0, D - overlap), angle) - upper * s * way
        plan, system = posed(level, spacing, [first, second])
        (_, _, force), out = reading(folder / place.replace(" ", "-"), plan, system, UPPER, "c_grip[*]")
        beads = np.arange(-n, n + 1) * s
        cuts = [*(beads - lower * s), *((beads - upper * s) / math.cos(turn) if angle < 90 else [])]
        stated = sampled_force(overlap, angle, cuts) / exact - 1
        case = f"crossing at {angle:g} degrees, lens {width:g} R"
        one = Measured(case, level, spacing, "force", "nN", float(force), exact, out.time.cpu, stated)
        if worst is None or abs(one.error) > abs(worst.error):
            worst = one
    assert worst is not None
    return [worst]


def end_overlap(folder: Path, level: str, spacing: float) -> list[Measured]:
    """A filament that lies on another with 0.37 of its length, the rest beyond the end: load on the overlap alone."""
    law, n, share = line_law(), segments_for(spacing), 0.37
    length = n * spacing * D
    approach = float(law.approach(1e6))
    shapes = [straight(n, spacing), straight(n, spacing, ((1 - share) * length, 0, D - approach))]
    plan, system = posed(level, spacing, shapes)
    (_, _, force), out = reading(folder, plan, system, UPPER, "c_grip[*]")
    return [Measured("end overlap", level, spacing, "force", "nN", float(force), 1e6 * share * length, out.time.cpu)]


def off_the_end(folder: Path, level: str, spacing: float) -> list[Measured]:
    """A filament carried along another at an even height until it has left it: the largest difference of its force from
    that of the overlap, over the full force."""
    law, n, rows, every = line_law(), segments_for(spacing), 400, 10
    length = n * spacing * D
    shapes = [straight(n, spacing), straight(n, spacing, (0, 0, D - float(law.approach(1e6))))]
    plan, system = posed(level, spacing, shapes, {"contact.friction": 0.0, "contact.damping_ratio": 1e-9})
    box = system.box.copy()
    box[0, 1] += 1.1 * length
    steps = rows * every
    travel = 1.02 * length
    speed = travel / steps / plan.timestep
    out = run(
        folder,
        replace(system, box=box),
        moved(plan, 1e-9, steps, sample=steps),
        [
            *HELD,
            *UPPER,
            f"fix carry upper move linear {speed:.17g} 0 0",
            f'fix probe all ave/time {every} 1 {every} c_grip[*] file probe.txt format " %.17g"',
        ],
        **AWAY,
    )
    step, _, _, force = out.rows("probe.txt").T
    exact = 1e6 * np.maximum(length - step * plan.timestep * speed, 0)
    off = float(np.max(np.abs(force - exact)) / exact[0])
    return [Measured("off the end", level, spacing, "force off", "1", off, 0.0, out.time.cpu)]
