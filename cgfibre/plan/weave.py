"""Planner of weaves: their tows, or all filaments of these, in a periodic cell or a patch between two platens."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.errors import InputError
from cgfibre.mechanics import rod
from cgfibre.mechanics.contact import damping_coefficient
from cgfibre.plan.common import checked_step, friction
from cgfibre.plan.contact import CAPSULE_DAMPING, TANGENTIAL_DAMPING, TANGENTIAL_RATIO, damping_ratio
from cgfibre.plan.cost import predicted_seconds
from cgfibre.plan.model import (
    CONTACT,
    LEFT,
    RIGHT,
    Beads,
    Choice,
    Contact,
    ErrorPart,
    Motion,
    Omission,
    Plan,
    Platens,
    Sampling,
    Woven,
)
from cgfibre.plan.motion import BLOCK, CHECKPOINTS, READINGS, SPEED_RATIO, film_time
from cgfibre.plan.tow_law import ChainLaw, chain_law, tow_law
from cgfibre.plan.tows import TowModel, greatest_curvature, tow_level, tow_models
from cgfibre.scene import Scene

#: part of the tow's thickness by which the chord of a segment may miss its centre line, and least segments a crossing
SAGITTA, LEAST_SEGMENTS = 0.005, 10
#: part of the load at the stop from which on the accuracy asked for shall hold
REFERENCE_LOAD = 0.1
#: the accuracy over which the platen's bound is taken, over that asked for
GAIN = 1.0
#: background drag over the frequency of the fabric on its contacts
DRAG = 0.1
#: pairs of crossing tows that a bead may be pressed by at once
PAIRS = 2
#: displacement planned for a stop by load, over that of the static estimate
MARGIN = 1.5
#: part of the thickness beyond which no fabric is pressed
DEEPEST = 0.75
#: of a diameter: how far beads may go before neighbours are looked for again
SKIN = 0.05
#: stiffness of a patch's ends over that of a segment's stretching
END_SHARE = 0.05
#: mean error of a platen at its bound, over the accuracy of the bound
SPEED_ERROR = 0.5
#: errors promised, measured on the nylon weave: halving of the bead spacing, laws of tows that no test gave
SPACING_ERROR = 0.02


def plan_weave(scene: Scene) -> Plan:
    """Plan of a weave; InputError names what in the scene cannot be modelled."""
    resolve = _resolve(scene)
    if resolve.value == "filament":
        raise InputError("model.resolve", "filament", "'tow'")
    return plan_tows(scene, [resolve])


def _resolve(scene: Scene) -> Choice:
    asked = scene.model.resolve
    if asked != "auto":
        return Choice("resolved", asked, "as asked in the scene")
    return Choice(
        "resolved",
        "tow",
        "each tow a chain with its rigidities and a soft law across: filaments inside it are not asked for "
        "(model.resolve = 'filament' has them)",
    )


@dataclass(frozen=True)
class Fabric:
    """The static estimate of a fabric at rest between platens: every crossing carries its share of the load from the
    upper platen through both tows to the lower one, and tows do not bend.

    ``crossings`` in the cell; ``pair`` force (nN) of one crossing at an overlap (um); ``top`` and ``bottom`` force of a
    platen on the whole cell at the depth by which it overlaps the highest tow.
    """

    crossings: int
    pair: Callable[[float], float]
    top: Callable[[float], float]
    bottom: Callable[[float], float]
    most: float

    def displacement(self, force: float) -> float:
        """Of the platen at a force on the cell, um."""

        def depth(of: Callable[[float], float], wanted: float) -> float:
            if of(self.most) < wanted:
                return self.most
            return float(brentq(lambda d: of(d) - wanted, 0.0, self.most))

        return depth(self.pair, force / self.crossings) + depth(self.top, force) + depth(self.bottom, force)

    def force(self, displacement: float) -> float:
        """On the cell at a displacement of the platen, nN."""
        high = self.crossings * self.pair(self.most)
        if self.displacement(high) < displacement:
            return high
        return float(brentq(lambda f: self.displacement(f) - displacement, 0.0, high))

    def stiffness(self, force: float) -> float:
        """Tangent nN/um of the cell at a force."""
        step = 0.05 * force
        return 2 * step / (self.displacement(force + step) - self.displacement(force - step))


def fabric(scene: Scene, system: FilamentSystem, laws: tuple[ChainLaw, ChainLaw]) -> Fabric:
    """The static estimate for tows with these laws (warp, weft; a crossing takes their mean)."""
    w = scene.weave
    diameter = system.diameter[system.filament_of_bead]
    kind = system.filament_type[system.filament_of_bead]
    share = system.tributary_lengths()
    z = system.positions[:, 2]
    thickness = min(w.tow.thickness, w.weft.thickness)
    wide = float(np.mean([t.diameter for t in system.types]))
    s = np.linspace(-1.0, 1.0, 201)
    chains = len(np.unique(system.tow[system.filament_type == 0])) and int(
        np.sum(system.filament_type == 0) / len(np.unique(system.tow[system.filament_type == 0]))
    )
    other = int(
        np.sum(system.filament_type == system.filament_type[-1])
        / len(np.unique(system.tow[system.filament_type == system.filament_type[-1]]))
    )

    def pair(overlap: float) -> float:
        half = math.sqrt(max(0.0, 2 * wide * overlap))
        y = overlap * (1 - s**2)
        f = 0.5 * (laws[0].force(y) + laws[1].force(y))
        return chains * other * half * float(np.trapezoid(f, s))

    def platen(sign: float) -> Callable[[float], float]:
        reach = sign * z + diameter / 2
        gap = np.max(reach) - reach
        use = gap < thickness

        def force(depth: float) -> float:
            y = np.maximum(depth - gap[use], 0.0)
            f = np.where(kind[use] == 0, laws[0].force(y, True), laws[1].force(y, True))
            return float(np.sum(f * share[use]))

        return force

    return Fabric(w.tows.warp * w.tows.weft, pair, platen(1.0), platen(-1.0), 0.5 * thickness)


def _spacing(scene: Scene) -> tuple[float, Choice]:
    asked, w = scene.model.spacing, scene.weave
    if asked != "auto":
        return float(asked), Choice("bead spacing", f"{float(asked):.4g} um at most", "as asked in the scene")
    thickness = min(w.tow.thickness, w.weft.thickness)
    curvature = greatest_curvature(scene)
    chord = math.sqrt(8 * SAGITTA * thickness / curvature) if curvature > 0 else math.inf
    cell = min(w.spacing.warp, w.spacing.weft) / LEAST_SEGMENTS
    spacing = min(chord, cell)
    why = (
        f"chords miss the curved tow by {curvature * spacing**2 / 8 / thickness:.1%} of its thickness at most"
        if chord < cell
        else f"{LEAST_SEGMENTS} segments from crossing to crossing"
    )
    return spacing, Choice("bead spacing", f"{spacing:.4g} um at most", why)


def tow_contact(scene: Scene, tows: tuple[TowModel, TowModel], laws: tuple[ChainLaw, ChainLaw]) -> Contact:
    """The contact between tows: a stiffness where the law is linear and all tows are alike, else a table."""
    pair = _mean_rows(laws, "pair")
    linear = laws[0].linear if laws[0].linear == laws[1].linear else 0.0
    stiffness = linear or float(np.max(np.diff([r[1] for r in pair]) / np.diff([r[0] for r in pair])))
    mass = min(t.chain.mass_per_length for t in tows)
    c = scene.contact
    return Contact(
        law="hooke" if linear else "table",
        kn=stiffness,
        kt=TANGENTIAL_RATIO * stiffness,
        gamma=float(damping_coefficient(damping_ratio(scene, CAPSULE_DAMPING), stiffness, mass, mass)),
        friction=c.friction,
        softening=1.0,
        line_stiffness=stiffness,
        shape="capsule",
        kinetic=c.kinetic_friction,
        by_angle=c.friction_by_angle,
        pair=() if linear else pair,
        platen=() if linear else _mean_rows(laws, "platen"),
    )


def _mean_rows(laws: tuple[ChainLaw, ChainLaw], of: str) -> tuple[tuple[float, float, float | None], ...]:
    """Rows of the mean law of warp and weft."""
    one, two = (getattr(law, of) for law in laws)
    d = one[0]
    load = 0.5 * (one[1] + np.interp(d, two[0], two[1]))
    back = None if one[2] is None else 0.5 * (one[2] + np.interp(d, two[0], two[2]))
    return tuple((float(d[k]), float(load[k]), None if back is None else float(back[k])) for k in range(len(d)))


def plan_tows(scene: Scene, choices: list[Choice]) -> Plan:
    """Plan of a weave whose tows are chains."""
    w = scene.weave
    level = _level(scene)
    choices.append(level)
    tows = tow_models(scene)
    spacing, choice = _spacing(scene)
    system = tow_level(scene, spacing)
    longest = float(np.max(system.bond_lengths()))
    modulus = 2 / (1 / tows[0].modulus + 1 / tows[1].modulus)
    law = tow_law(scene, modulus)
    laws = (
        chain_law(law, tows[0].chain.diameter, tows[0].shape.width, tows[0].chains),
        chain_law(law, tows[1].chain.diameter, tows[1].shape.width, tows[1].chains),
    )
    contact = tow_contact(scene, tows, laws)
    estimate = fabric(scene, system, laws)
    area = w.size[0] * w.size[1]
    height, depth, load = _stop(scene, system, estimate, area)
    choices += [
        Choice("chains", _chains(tows), "a round tow is one, a flat one a ribbon of parallel ones"),
        choice,
        Choice("contact law", _law(scene, modulus), "across a tow, between tows; platens meet half of that compliance"),
        friction(scene),
        _rest(scene),
    ]
    axial = 1.0 if scene.model.axial_softening == "auto" else float(scene.model.axial_softening)
    choices.append(
        Choice(
            "axial softening", f"{axial:g}", "the cell is held: crimp that is pressed out goes into the tows' length"
        )
    )
    beads, limit = _beads(scene, system, contact, laws, depth, axial)
    timestep, step = checked_step(scene, limit)
    choices.append(step)
    mass = float(np.sum(beads.mass))
    motion, sampling, more = plan_pressing(scene, estimate, mass, timestep, depth, load)
    choices += more
    drag = DRAG * math.sqrt(estimate.stiffness(REFERENCE_LOAD * load) / mass) * float(np.mean(beads.mass))
    lengths = [float(np.sum(system.bond_lengths()[_of_type(system, k)])) for k in (0, 1)]
    volume = sum(t.fibres * length / t.chains for t, length in zip(tows, lengths, strict=True))
    woven = Woven(
        "tow",
        w.size,
        volume,
        w.cell == "periodic",
        w.rest == "stress-free",
        skin=SKIN * float(np.min(system.diameter)),
        end_stiffness=END_SHARE * min(t.chain.EA for t in tows) / longest,
        asked_spacing=spacing,
    )
    cost = f"{level.value}, capsules"
    return Plan(
        level=level.value,
        spacing=longest,
        pitch=min(w.spacing.warp, w.spacing.weft),
        width=w.size[1],
        height=height,
        n_filaments=system.n_filaments,
        n_beads=system.n_beads,
        beads=beads,
        axial_softening=axial,
        timestep=timestep,
        timestep_limit=limit,
        drag=drag,
        turning_drag=drag * 0.1 * max(t.chain.diameter for t in tows) ** 2,
        torsion="none",
        contact=contact,
        platens=_platens(scene, contact, min(t.chain.mass_per_length for t in tows)),
        motion=motion,
        sampling=sampling,
        predicted_seconds=predicted_seconds(cost, system.n_beads, motion, sampling),
        choices=tuple(choices),
        omissions=_omissions(scene, tows),
        promise=(
            ErrorPart("platen speed", SPEED_ERROR * motion.eps * motion.pace, "inertia of the fabric"),
            ErrorPart("bead spacing", SPACING_ERROR, "chords in place of curved tows"),
        ),
        woven=woven,
    )


def _of_type(system: FilamentSystem, kind: int) -> np.ndarray:
    """(n_bonds,) bool: bonds of filaments of a type."""
    return np.asarray(system.filament_type[system.filament_of_bead[system.bonds()[:, 0]]] == kind)


def _level(scene: Scene) -> Choice:
    asked = scene.model.level
    if asked != "auto":
        return Choice("level", asked, "as asked in the scene")
    return Choice("level", "chain", "stretch and bending of tows; twist and rolling of a tow are not asked for")


def _chains(tows: tuple[TowModel, TowModel]) -> str:
    each = [f"{t.chains} x {t.chain.diameter:.4g} um" for t in tows]
    return each[0] if each[0] == each[1] else f"{each[0]} (warp), {each[1]} (weft)"


def _law(scene: Scene, modulus: float) -> str:
    c = scene.contact
    if c.table is not None:
        return f"table of {c.table.of.replace('_', ' ')}, {len(c.table.rows)} rows"
    name = "linear" if c.law == "auto" else c.law
    return f"{name}, {(c.stiffness or 0.1):.3g} of the tow's modulus {modulus * 1e-6:.4g} GPa"


def _rest(scene: Scene) -> Choice:
    if scene.weave.rest == "woven-in":
        return Choice("rest shape", "straight", "woven in, as asked: tows press on each other at their crossings")
    return Choice(
        "rest shape", "as built", "constant forces balance the bending of the tows as built: no stress at rest"
    )


def _stop(scene: Scene, system: FilamentSystem, estimate: Fabric, area: float) -> tuple[float, float, float]:
    """(height as built um, planned displacement um, load nN expected there)."""
    radius = system.diameter[system.filament_of_bead] / 2
    z = system.positions[:, 2]
    height = float(np.max(z + radius) - np.min(z - radius))
    stop = scene.platens.stop
    if stop.displacement is not None or stop.thickness is not None:
        depth = stop.displacement if stop.displacement is not None else height - float(stop.thickness or 0.0)
        if not 0 < depth < DEEPEST * height:
            least = (1 - DEEPEST) * height
            expected = f"a thickness from {least:.4g} um to below the {height:.4g} um as built"
            raise InputError(f"platens.stop.{stop.kind}", f"{stop.value:g} um", expected)
        return height, depth, estimate.force(depth)
    load = float(stop.force) if stop.force is not None else float(stop.pressure or 0.0) * area
    return height, min(MARGIN * estimate.displacement(load), DEEPEST * height), load


def _beads(
    scene: Scene,
    system: FilamentSystem,
    contact: Contact,
    laws: tuple[ChainLaw, ChainLaw],
    depth: float,
    softening: float,
) -> tuple[Beads, float]:
    """(beads, limiting time step us): real masses, bounds of stretching, bending and contacts with their damping."""
    lengths, start = system.bond_lengths(), 0
    mass, hinge, bound = (np.zeros(system.n_beads) for _ in range(3))
    role = np.full(system.n_beads, CONTACT)
    place = np.zeros(system.n_beads)
    for i in range(system.n_filaments):
        a, b = int(system.filament_start[i]), int(system.filament_start[i + 1])
        closed, kind = bool(system.closed[i]), system.types[int(system.filament_type[i])]
        n = b - a if closed else b - a - 1
        gaps = lengths[start : start + n]
        start += n
        chain = rod.chain_coefficients(gaps, kind.EA / softening, kind.EI, closed=closed)
        bound[a:b] = rod.chain_stiffness_bound(gaps, chain, closed=closed, bent=True)
        hinge[a:b] = chain.angle if closed else np.concatenate([[0.0], chain.angle, [0.0]])
        place[a + 1 : b] = np.cumsum(gaps)[: b - a - 1]
        if not closed:
            for end in (a, b - 1):  # in the middle, where a tow changes sides, or at a float
                role[end] = LEFT if abs(system.positions[end, 2]) < 0.1 * kind.diameter else RIGHT
                bound[end] += END_SHARE * kind.EA / float(np.min(gaps))
    share = system.tributary_lengths()
    kind_of = system.filament_type[system.filament_of_bead]
    per_length = np.array([t.mass_per_length for t in system.types])[kind_of]
    mass = per_length * share
    lever = 1 + 4 * (system.diameter[system.filament_of_bead] / 2 / np.min(lengths)) ** 2
    pair, wall = (max(law.slope(depth)[k] for law in laws) for k in (0, 1))
    touching = share * (2 * PAIRS * pair + wall) * np.maximum(1.0, TANGENTIAL_RATIO * lever)
    gamma = contact.gamma * math.sqrt(2)
    damping = share * (2 * PAIRS * contact.gamma + gamma) * np.maximum(1.0, TANGENTIAL_DAMPING * lever)
    limit = float(rod.limiting_time_step(bound + touching, mass, damping))
    beads = Beads(
        stations=place,
        role=role.astype(np.int64),
        mass=mass,
        hinge=hinge,
        support="periodic" if bool(np.all(system.closed)) else "patch",
        end_load=0.0,
        closed=bool(np.all(system.closed)),
    )
    return beads, limit


def _platens(scene: Scene, contact: Contact, mass: float) -> Platens:
    stiffness = 2 * contact.kn
    return Platens(
        shape="flat",
        kn=stiffness,
        kt=TANGENTIAL_RATIO * stiffness,
        gamma=float(damping_coefficient(damping_ratio(scene, CAPSULE_DAMPING), stiffness, mass)),
        friction=scene.platens.friction,
        top_span=None,
        bottom_span=None,
        contact_length=scene.weave.size[0],
    )


def plan_pressing(
    scene: Scene, estimate: Fabric, mass: float, timestep: float, depth: float, load: float
) -> tuple[Motion, Sampling, list[Choice]]:
    """Speeds, phases and sampling: v <= eps F/sqrt(k m) of the whole fabric on its own stiffness, growing with F."""
    eps = GAIN * scene.model.accuracy
    reference = estimate.displacement(REFERENCE_LOAD * load)
    d = np.linspace(min(reference, depth / 2), depth, 60)
    force = np.array([estimate.force(float(x)) for x in d])
    stiffness = np.array([estimate.stiffness(f) for f in force])
    bound = eps * force / np.sqrt(stiffness * mass)
    first = float(bound[0]) / 2
    rise = np.minimum.accumulate(bound[::-1])[::-1] / first - 1
    growth = float(np.max(d / np.clip(rise, 1e-3, SPEED_RATIO - 1)))
    last = first * min(SPEED_RATIO, 1 + depth / growth)
    allowed = (first, last, growth)
    choices = []
    if scene.platens.speed == "auto":
        reason = f"v <= eps F/sqrt(k m) of the fabric on its contacts, eps = {eps:g}, from {REFERENCE_LOAD:.0%} load"
        most = scene.model.most_steps
        if most != "auto":
            faster = film_time(first, last, growth, depth) / timestep / most
            if faster > 1:
                first, last = first * faster, last * faster
                reason += f"; raised {faster:.3g} times to end within {most:.2g} steps"
        choices.append(Choice("platen speed", f"{first:.3g} to {last:.3g} m/s", reason))
    else:
        first = last = float(scene.platens.speed)
        growth = depth
        choices.append(Choice("platen speed", f"{first:.4g} m/s", "as asked in the scene"))
    impedance = math.sqrt(float(stiffness[0]) * mass) / eps
    choices.append(
        Choice(
            "quasi-static above",
            f"{impedance * first * 1e-9:.2g} N at first touch, {impedance * last * 1e-9:.2g} N at {last:.3g} m/s",
            "v sqrt(k m)/eps: below it inertia is more than the accuracy asked for",
        )
    )
    unload = scene.platens.unload
    phases = 2 if unload else 1
    total = film_time(first, last, growth, depth) / timestep
    every = max(1, round(total * phases / scene.output.samples / READINGS))
    sample = every * READINGS
    load_steps = max(sample, math.ceil(total / sample) * sample)
    first, last = first * total / load_steps, last * total / load_steps
    hold = math.ceil(scene.platens.hold / timestep / sample) * sample
    planned = load_steps * phases + hold
    frame = max(1, round(planned / scene.output.frames / sample)) * sample
    checkpoint = max(1, round(planned / CHECKPOINTS / frame)) * frame
    stop = scene.platens.stop
    motion = Motion(
        first=first,
        last=last,
        growth=growth,
        load_steps=load_steps,
        hold_steps=hold,
        unload=unload,
        stop_force=stop.force if stop.force is not None else math.inf,
        stop_pressure=stop.pressure if stop.pressure is not None else math.inf,
        planned_displacement=depth,
        quasi_static_impedance=impedance,
        eps=eps,
        fastest=math.inf,
        pace=_pace((first, last, growth), allowed, d),
    )
    block = math.ceil(BLOCK / sample) * sample
    return motion, Sampling(sample, every, frame, checkpoint, block), choices


def _pace(speeds: tuple[float, float, float], allowed: tuple[float, float, float], d: FloatArray) -> float:
    """Mean over displacements of one (first, last, growth) over another."""

    def speed(of: tuple[float, float, float]) -> FloatArray:
        return np.minimum(of[0] * (1 + d / of[2]), of[1])

    return float(np.mean(speed(speeds) / speed(allowed)))


def _omissions(scene: Scene, tows: tuple[TowModel, TowModel]) -> tuple[Omission, ...]:
    left = [
        Omission(
            "filaments inside a tow",
            "a tow is as stiff across as its law says, wherever it is pressed",
            "that of the law: a tow widens under load, which no chain does",
        ),
        Omission("twist and rolling of tows", "beads of a chain do not spin", "small where tows cross in a fabric"),
        Omission("gravity, adhesion, moisture", "small beside contact forces", "below 1e-3 of the force"),
    ]
    if any(t.chains > 1 for t in tows):
        left.append(
            Omission(
                "bending of a flat tow in its plane",
                "its parallel chains are not joined",
                "none under platens; shear of the fabric meets too little resistance",
            )
        )
    return tuple(left)
