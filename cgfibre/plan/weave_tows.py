"""Planner of weaves at tow level: a round tow is one chain or rod, a flat one a ribbon of chains."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from cgfibre.build.system import FilamentSystem
from cgfibre.mechanics.contact import damping_coefficient
from cgfibre.plan.arches import arches
from cgfibre.plan.common import checked_step, friction
from cgfibre.plan.contact import CAPSULE_DAMPING, TANGENTIAL_RATIO, damping_ratio
from cgfibre.plan.cost import joint_cost, predicted_seconds
from cgfibre.plan.model import Choice, Contact, ErrorPart, Omission, Plan, Platens, Ribbon
from cgfibre.plan.pressing import REFERENCE_LOAD, plan_pressing
from cgfibre.plan.ribbons import plan_ribbon, ribbon_bound
from cgfibre.plan.tow_law import STIFFNESS, ChainLaw, chain_law, tow_law
from cgfibre.plan.tows import TowModel, greatest_curvature, tow_models, woven_system
from cgfibre.plan.weave_common import (
    Pace,
    Touching,
    built_height,
    cell_choices,
    chain_beads,
    planned_stop,
    rest_choice,
    woven_plan,
)
from cgfibre.plan.woven_rods import left_out, level_of_tows, torsion_choices
from cgfibre.scene import Scene

#: part of the tow's thickness by which the chord of a segment may miss its centre line, and least segments a crossing
SAGITTA, LEAST_SEGMENTS = 0.005, 10
#: background drag over the frequency of the fabric on its contacts
DRAG = 0.1
#: pairs of crossing tows that a bead may be pressed by at once
PAIRS = 2
#: mean error of a platen at its bound, over the accuracy of the bound
SPEED_ERROR = 0.5
#: errors promised, measured on the nylon weave: halving of the bead spacing, laws of tows that no test gave
SPACING_ERROR = 0.02


@dataclass(frozen=True)
class Fabric:
    """The static estimate of a fabric at rest between platens: every crossing carries its share of the load from the
    upper platen through both tows to the lower one, beside the flanks of tows that are arches.

    ``crossings`` in the cell; ``pair`` force (nN) of one crossing, with its flanks, at a way (um) by which its two axes
    come nearer: the gap as built, then their overlap; ``top`` and ``bottom`` force of a platen on the whole cell at the
    depth by which it overlaps the highest tow.
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


def fabric(scene: Scene, system: FilamentSystem, laws: tuple[ChainLaw, ChainLaw], softening: float = 1.0) -> Fabric:
    """The static estimate for tows with these laws (warp, weft; a crossing takes their mean) and their EA divided by
    ``softening``."""
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
    flanks = arches(scene, system, softening)

    def pair(way: float) -> float:
        overlap = max(0.0, way - w.gap)
        half = math.sqrt(2 * wide * overlap)
        y = overlap * (1 - s**2)
        f = 0.5 * (laws[0].force(y) + laws[1].force(y))
        return chains * other * half * float(np.trapezoid(f, s)) + flanks(way)

    def platen(sign: float) -> Callable[[float], float]:
        reach = sign * z + diameter / 2
        gap = np.max(reach) - reach
        use = gap < thickness

        def force(depth: float) -> float:
            y = np.maximum(depth - gap[use], 0.0)
            f = np.where(kind[use] == 0, laws[0].force(y, True), laws[1].force(y, True))
            return float(np.sum(f * share[use]))

        return force

    return Fabric(w.tows.warp * w.tows.weft, pair, platen(1.0), platen(-1.0), 0.5 * thickness + w.gap)


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
        both_sides=True,  # soft tows touch over lengths like their segments'
    )


def _mean_rows(laws: tuple[ChainLaw, ChainLaw], of: str) -> tuple[tuple[float, float, float | None], ...]:
    """Rows of the mean law of warp and weft."""
    one, two = (getattr(law, of) for law in laws)
    d = one[0]
    load = 0.5 * (one[1] + np.interp(d, two[0], two[1]))
    back = None if one[2] is None else 0.5 * (one[2] + np.interp(d, two[0], two[2]))
    return tuple((float(d[k]), float(load[k]), None if back is None else float(back[k])) for k in range(len(d)))


def plan_tows(scene: Scene, choices: list[Choice]) -> Plan:
    """Plan of a weave whose tows are chains or rods."""
    w = scene.weave
    tows = tow_models(scene)
    level = level_of_tows(scene, tows)
    choices.append(level)
    spacing, choice = _spacing(scene)
    system = woven_system(scene, "tow", spacing)
    longest = float(np.max(system.bond_lengths()))
    modulus = 2 / (1 / tows[0].modulus + 1 / tows[1].modulus)
    law = tow_law(scene, modulus)
    laws = (
        chain_law(law, tows[0].chain.diameter, tows[0].shape.width, tows[0].chains),
        chain_law(law, tows[1].chain.diameter, tows[1].shape.width, tows[1].chains),
    )
    contact = tow_contact(scene, tows, laws)
    axial = 1.0 if scene.model.axial_softening == "auto" else float(scene.model.axial_softening)
    estimate = fabric(scene, system, laws, axial)
    height = built_height(system)
    stops = planned_stop(scene, height, estimate)
    choices += [
        Choice(f"{level.value}s", _chains(tows), "a round tow is one, a flat one a ribbon of parallel ones"),
        choice,
        Choice("contact law", _law(scene, modulus), "across a tow, between tows; platens meet half of that compliance"),
        friction(scene),
        rest_choice(scene, level.value),
        *torsion_choices(scene, level.value, tows),
    ]
    choices.append(
        Choice(
            "axial softening", f"{axial:g}", "the cell is held: crimp that is pressed out goes into the tows' length"
        )
    )
    platens = _platens(scene, contact, min(t.chain.mass_per_length for t in tows))
    pair, wall = (max(law.slope(stops.depth)[k] for law in laws) for k in (0, 1))
    touching = Touching(PAIRS, pair, wall, contact.gamma, platens.gamma, contact.both_sides)
    ribbon = None
    if level.value == "chain":
        ribbon, more = plan_ribbon(scene, system, tows, law, stops.depth, axial)
        choices += more
    joints = 0.0 if ribbon is None else np.sum(ribbon_bound(system, ribbon), axis=0)
    beads, limit = chain_beads(system, touching, axial, level.value, joints)
    timestep, step = checked_step(scene, limit)
    choices.append(step)
    mass = float(np.sum(beads.mass))
    motion, sampling, more = plan_pressing(scene, estimate, mass, timestep, stops)
    choices += more
    frequency = math.sqrt(estimate.stiffness(REFERENCE_LOAD * stops.load) / mass)
    drag = DRAG * frequency * float(np.mean(beads.mass))
    lengths = [float(np.sum(system.bond_lengths()[_of_type(system, k)])) for k in (0, 1)]
    volume = sum(t.fibres * length / t.chains for t, length in zip(tows, lengths, strict=True))
    pace = Pace(2 * math.pi / frequency, timestep, stops)
    woven = woven_plan(scene, "tow", system, volume, spacing, pace)
    choices += cell_choices(scene, woven)
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
        platens=platens,
        motion=motion,
        sampling=sampling,
        predicted_seconds=predicted_seconds(cost, system.n_beads, motion, sampling, joint_cost(ribbon), woven),
        choices=tuple(choices),
        omissions=_omissions(scene, tows, ribbon, level.value),
        promise=(
            ErrorPart("platen speed", SPEED_ERROR * motion.eps * motion.pace, "inertia of the fabric"),
            ErrorPart("bead spacing", SPACING_ERROR, "chords in place of curved tows"),
        ),
        woven=woven,
        ribbon=ribbon,
    )


def _of_type(system: FilamentSystem, kind: int) -> np.ndarray:
    """(n_bonds,) bool: bonds of filaments of a type."""
    return np.asarray(system.filament_type[system.filament_of_bead[system.bonds()[:, 0]]] == kind)


def _chains(tows: tuple[TowModel, TowModel]) -> str:
    each = [f"{t.chains} x {t.chain.diameter:.4g} um" for t in tows]
    return each[0] if each[0] == each[1] else f"{each[0]} (warp), {each[1]} (weft)"


def _law(scene: Scene, modulus: float) -> str:
    c = scene.contact
    if c.table is not None:
        return f"table of {c.table.of.replace('_', ' ')}, {len(c.table.rows)} rows"
    name = "linear" if c.law == "auto" else c.law
    return f"{name}, {(c.stiffness or STIFFNESS):.3g} of the tow's modulus {modulus * 1e-6:.4g} GPa"


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


def _omissions(
    scene: Scene, tows: tuple[TowModel, TowModel], ribbon: Ribbon | None, level: str
) -> tuple[Omission, ...]:
    left = [
        Omission(
            "filaments inside a tow",
            "a tow is as stiff across as its law says, wherever it is pressed",
            "that of the law: a tow widens under load, which no chain or rod does",
        )
    ]
    if any(t.chains == 1 for t in tows):
        left += left_out(level, "tows")
    left.append(Omission("gravity, adhesion, moisture", "small beside contact forces", "below 1e-3 of the force"))
    if ribbon is not None:
        left.append(
            Omission(
                "stiffness of a flat tow against sliding of its chains and bending across its width",
                "loose filaments do both",
                "a solid tow's shear and the bending of its section are missing",
            )
        )
    elif any(t.chains > 1 for t in tows):
        left.append(
            Omission(
                "bending of a flat tow in its plane, and its twist",
                "parallel chains are joined at level chain alone",
                "chains between crossings drift from each other",
            )
        )
    return tuple(left)
