"""What the planners of a weave's tows and of its filaments share: beads of closed and open chains, stop, ends, cell."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.build.weave_spec import WeaveSpec, transition, weave_geometry
from cgfibre.errors import InputError
from cgfibre.mechanics import rod, trellis
from cgfibre.plan.contact import TANGENTIAL_DAMPING, TANGENTIAL_RATIO
from cgfibre.plan.model import CONTACT, LEFT, RIGHT, ROD_DAMPING, Beads, Choice, Woven
from cgfibre.plan.pressing import Estimate, Stops, preparation_steps, way_in_plane
from cgfibre.plan.tows import tow_models, weave_spec
from cgfibre.scene import Scene, Stop

#: displacement planned for a stop by load, over that of the static estimate
MARGIN = 1.5
#: part of the way estimated to a stop by load over which a weave is loaded in its plane alongside
SOON = 0.5
#: stops that say where, not how hard
BY_PLACE = ("displacement", "thickness")
#: part of a tow's crimp that tension is expected to take out of it at most
PULLED_OUT = 0.25
#: part of the thickness beyond which no fabric is pressed
DEEPEST = 0.75
#: of a diameter: how far beads may go before neighbours are looked for again
SKIN = 0.05
#: stiffness of a patch's ends over that of a segment's stretching
END_SHARE = 0.05
#: periods of the fabric in which a free edge finds its place
EDGE_PERIODS = 0.05
#: stiffness of crimped tows in the plane over their EA, roughly
CRIMPED = 0.3
#: part of a diameter that the end of a tow may be off the middle of the fabric and still be a crossing-over
MIDDLE = 0.1


@dataclass(frozen=True)
class Touching:
    """Stiffness (kPa) and damping (nN us/um2) that contacts add to a bead, per length: of ``pairs`` at once, which
    move too, and of one platen; ``both_sides`` as :class:`Contact`."""

    pairs: int
    pair: float
    platen: float
    pair_damping: float
    platen_damping: float
    both_sides: bool = False


def chain_beads(
    system: FilamentSystem,
    touching: Touching,
    softening: float,
    level: str = "chain",
    joints: FloatArray | float = 0.0,
) -> tuple[Beads, float]:
    """(beads, limiting time step us): real masses; bounds of stretching, bending, contacts with their damping, and what
    ``joints`` to other chains add to every bead, nN/um.

    Friction on a segment's side moves its ends by 1 +- 2 R/s: (1 + 4 (R/s)^2) times the stiffness along it. Seen from
    both sides half of it acts at 2 R, half at the axis: (1 + 8 (R/s)^2) times.
    """
    lengths, first = system.bond_lengths(), 0
    hinge, bound, place = (np.zeros(system.n_beads) for _ in range(3))
    role = np.full(system.n_beads, CONTACT, dtype=np.int64)
    known: dict[tuple[bytes, int, bool], tuple[FloatArray, FloatArray]] = {}
    for i in range(system.n_filaments):
        a, b = int(system.filament_start[i]), int(system.filament_start[i + 1])
        closed, kind = bool(system.closed[i]), int(system.filament_type[i])
        t = system.types[kind]
        gaps = lengths[first : first + b - a - (not closed)]
        first += len(gaps)
        key = (np.round(gaps, 6).tobytes(), kind, closed)
        if key not in known:
            chain = rod.chain_coefficients(gaps, t.EA / softening, t.EI, closed=closed)
            stiff = rod.chain_stiffness_bound(gaps, chain, closed=closed, bent=True)
            if level == "rod":
                every = rod.rod_coefficients(gaps, t.EA / softening, t.EI, t.GJ, t.kGA)
                stiff = rod.rod_stiffness_bound(gaps, t.diameter, every, closed=closed)
            known[key] = chain.angle if closed else np.concatenate([[0.0], chain.angle, [0.0]]), stiff
        hinge[a:b], bound[a:b] = known[key]
        place[a + 1 : b] = np.cumsum(gaps)[: b - a - 1]
        if not closed:
            for end in (a, b - 1):  # in the middle, where a tow changes sides, or at a float
                role[end] = LEFT if abs(_tow_height(system, i, end)) < MIDDLE * t.diameter else RIGHT
                bound[end] += END_SHARE * t.EA / float(np.min(gaps))
    share = system.tributary_lengths()
    kind_of = system.filament_type[system.filament_of_bead]
    mass = np.array([t.mass_per_length for t in system.types])[kind_of] * share
    slender = system.diameter[system.filament_of_bead] / 2 / float(np.median(lengths))
    lever = 1 + (8 if touching.both_sides else 4) * slender**2
    inertia = rod.SPHERE_INERTIA if level == "rod" else np.inf
    along = np.maximum(1.0, TANGENTIAL_RATIO * (lever if level == "chain" else 1 + 0.25 / inertia))
    stiffness = share * (2 * touching.pairs * touching.pair + touching.platen) * along
    sliding = np.maximum(1.0, TANGENTIAL_DAMPING * (lever if level == "chain" else 1 + 0.25 / inertia))
    damping = share * (2 * touching.pairs * touching.pair_damping + touching.platen_damping) * sliding
    if level == "rod":
        damping = damping + 2 * ROD_DAMPING * np.sqrt(bound * mass)
    limit = float(rod.limiting_time_step(bound + joints + stiffness, mass, damping))
    closed_all = bool(np.all(system.closed))
    beads = Beads(
        stations=place,
        role=role,
        mass=mass,
        hinge=hinge,
        support="periodic" if closed_all else "patch",
        end_load=0.0,
        closed=closed_all,
    )
    return beads, limit


def _tow_height(system: FilamentSystem, filament: int, end: int) -> float:
    """z of the middle of a tow's end, um: the mean over its filaments' ends at the same side."""
    first = end == system.filament_start[filament]
    members = np.flatnonzero(system.tow == system.tow[filament])
    ends = system.first_beads[members] if first else system.last_beads[members]
    return float(np.mean(system.positions[ends, 2]))


def planned_stop(scene: Scene, height: float, estimate: Estimate) -> Stops:
    """The planned stop and the cycles before it; InputError for one beyond what a fabric can give."""
    depth, load = _one_stop(scene, "platens.stop", scene.platens.stop, height, estimate)
    first, first_load = scene.platens.stop, load
    earlier: list[float] = []
    for k, cycle in enumerate(scene.platens.cycles):
        least, needed = _one_stop(scene, f"platens.cycles.{k}", cycle, height, estimate)
        earlier += cycle.times * [least if cycle.kind in BY_PLACE else min(least, depth)]
        first, first_load = (cycle, needed) if k == 0 else (first, first_load)
    way = (earlier or [depth])[0] if first.kind in BY_PLACE else SOON * estimate.displacement(first_load)
    return Stops(depth, load, way, tuple(earlier))


def _one_stop(scene: Scene, key: str, stop: Stop, height: float, estimate: Estimate) -> tuple[float, float]:
    length, width = scene.weave.size
    if stop.displacement is not None or stop.thickness is not None:
        depth = stop.displacement if stop.displacement is not None else height - float(stop.thickness or 0.0)
        if not 0 < depth < DEEPEST * height:
            least = (1 - DEEPEST) * height
            expected = f"a thickness from {least:.4g} um to below the {height:.4g} um as built"
            raise InputError(f"{key}.{stop.kind}", f"{stop.value:g} um", expected)
        return depth, estimate.force(depth)
    loads = (stop.force, (stop.pressure or 0.0) * length * width, (stop.line_force or 0.0) * length)
    load = next(float(x) for x in loads if x)
    return min(MARGIN * estimate.displacement(load) + crests_lost(scene), DEEPEST * height), load


def crests_lost(scene: Scene) -> float:
    """How much lower the crests of tows may come by what happens in the plane, um: those that are strained, or pulled.

    A tow whose crimp c loses a strain e keeps sqrt(1 - e/c) of its height above the middle. Under tension e is that of
    a tow by itself, T (1/EA + h^2/(2 EI)), but no more than :data:`PULLED_OUT` of its crimp: other tows hold it.
    """
    cell, spec = scene.in_plane, weave_spec(scene.weave)
    if (cell.strain.x, cell.strain.y, cell.tension.warp, cell.tension.weft) == (0, 0, 0, 0):
        return 0.0
    lost, crimp, heights = 0.0, weave_geometry(spec).crimp, spec.amplitudes
    given = ((cell.strain.x, cell.tension.warp), (cell.strain.y, cell.tension.weft))
    for (strain, pull), model, c, h in zip(given, tow_models(scene), crimp, heights, strict=True):
        tow = model.whole
        pulled = min(pull * (1 / tow.EA + h**2 / (2 * tow.EI)), PULLED_OUT * c)
        gone = min(max(strain, pulled), c)
        lost += h * (1 - math.sqrt(1 - gone / c)) if c > 0 and gone > 0 else 0.0
    return lost


def built_height(system: FilamentSystem) -> float:
    """From the lowest to the highest surface as built, um."""
    radius = system.diameter[system.filament_of_bead] / 2
    z = system.positions[:, 2]
    return float(np.max(z + radius) - np.min(z - radius))


def rest_choice(scene: Scene, level: str) -> Choice:
    """The shape in which nothing is bent."""
    if scene.weave.rest == "woven-in":
        return Choice("rest shape", "straight", "woven in, as asked: tows press on each other at their crossings")
    how = "constant forces balance the bending as built" if level == "chain" else "rods are at rest as built"
    return Choice("rest shape", "as built", f"{how}: no stress at rest")


@dataclass(frozen=True)
class Pace:
    """What loading in the plane goes by: a ``period`` of the fabric us, the ``timestep`` us, the planned ``stops``."""

    period: float
    timestep: float
    stops: Stops


def woven_plan(scene: Scene, resolve: str, system: FilamentSystem, volume: float, spacing: float, pace: Pace) -> Woven:
    """The weave's part of a plan; ``spacing`` is what the builder was given."""
    w, cell, longest = scene.weave, scene.in_plane, float(np.max(system.bond_lengths()))
    pulls = (cell.tension.warp * w.tows.warp, cell.tension.weft * w.tows.weft)
    free = [
        strain == 0 and (cell.edges == "free" or pull > 0)
        for strain, pull in zip((cell.strain.x, cell.strain.y), pulls, strict=True)
    ]
    EA = [
        float(np.sum([t.EA for t in np.array(system.types)[system.filament_type[runs_along(system) == k]]]))
        for k in (0, 1)
    ]
    return Woven(
        resolve,
        w.size,
        volume,
        w.cell == "periodic",
        w.rest == "stress-free",
        skin=SKIN * float(np.min(system.diameter)),
        end_stiffness=END_SHARE * min(t.EA for t in system.types) / longest,
        asked_spacing=spacing,
        strain=(cell.strain.x, cell.strain.y),
        tension=(pulls[0] if free[0] else None, pulls[1] if free[1] else None),
        shear=cell.shear,
        when=cell.when,
        over=way_in_plane(scene, pace.stops) if cell.when == "during" else 0.0,
        preparation=preparation_steps(scene, pace.period, pace.timestep),
        edge_drag=(CRIMPED * EA[0] * EDGE_PERIODS * pace.period, CRIMPED * EA[1] * EDGE_PERIODS * pace.period),
        tows=(w.tows.warp, w.tows.weft),
    )


def runs_along(system: FilamentSystem) -> np.ndarray:
    """(n_filaments,) 0 for filaments along x, 1 for those along y."""
    run = system.positions[system.last_beads] - system.positions[system.first_beads]
    return np.asarray(np.argmax(np.abs(run[:, :2]), axis=1))


def cell_choices(scene: Scene, woven: Woven) -> list[Choice]:
    """What happens in the plane, and when."""
    c = scene.in_plane
    if c.at_rest:
        return [Choice("in the plane", "held", "the fabric can neither spread nor shrink, as between mirrors")]
    parts = [f"strain {c.strain.x:g}, {c.strain.y:g}"] if (c.strain.x, c.strain.y) != (0, 0) else []
    parts += [f"sheared by {math.degrees(c.shear):.3g} deg"] if c.shear else []
    if (c.tension.warp, c.tension.weft) != (0, 0):
        parts.append(f"{c.tension.warp * 1e-9:.3g} N a warp tow, {c.tension.weft * 1e-9:.3g} N a weft tow")
    parts += ["free edges"] if c.edges == "free" else []
    steps = f"over {woven.preparation} steps"
    when = {
        "before": f"{steps} before the platens move, which stand at the fabric as built meanwhile",
        "during": f"in proportion to the first {woven.over:.4g} um of the platen's first loading, then held",
        "after": f"{steps} behind the last loading, the platens held",
    }
    choices = [Choice("in the plane", ", ".join(parts), when[c.when])]
    return choices + ([_sheared(scene)] if c.shear else [])


def _sheared(scene: Scene) -> Choice:
    """Where a trellis of these tows ends, and what its resistance leaves out."""
    w, shear = scene.weave, scene.in_plane.shear
    pairs = ((w.tow.width, w.spacing.warp), (w.weft.width, w.spacing.weft))
    lock = min(trellis.locking_angle(width, spacing) for width, spacing in pairs)
    parts = [f"lie side by side at {math.degrees(lock):.3g} deg"]
    spec = weave_spec(w)
    if w.tow.section == w.weft.section == "circular" and w.texgen is None and on_cosines(spec):
        spacings = (w.spacing.weft, w.spacing.warp)
        bearing = trellis.bearing_angle(sum(spec.amplitudes), spec.amplitudes, spacings)
        parts.insert(0, f"press on each other beside their crossings from {math.degrees(bearing):.3g} deg on")
    why = (
        "closed forms; round tows that are chains have no sides: the friction of their turning on each other is not in "
        "the couple that resists, /fabric/turning_couple of results.h5 tells it"
    )
    return Choice("trellis", f"area times {trellis.area_factor(shear):.4g}; tows {', '.join(parts)}", why)


def on_cosines(spec: WeaveSpec) -> bool:
    """Whether all tows change sides at every crossing, on cosines without a flat crest."""
    plain = all(np.all(spec.pattern != np.roll(spec.pattern, 1, axis)) for axis in (0, 1))
    return plain and all(t.kind == "cosine" and t.crest == 0 for t in (transition(spec, k) for k in (True, False)))
