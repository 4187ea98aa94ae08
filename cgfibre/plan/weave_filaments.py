"""Planner of weaves filament by filament: every filament of every tow a chain or rod of smooth segments."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cgfibre.plan.common import checked_step, friction
from cgfibre.plan.contact import plan_capsule, plan_contact
from cgfibre.plan.cost import predicted_seconds
from cgfibre.plan.filaments import LAWS
from cgfibre.plan.model import Choice, ErrorPart, Omission, Plan, Platens
from cgfibre.plan.outline import scene_filament
from cgfibre.plan.pressing import REFERENCE_LOAD, plan_pressing
from cgfibre.plan.tows import greatest_curvature, woven_system
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
from cgfibre.plan.woven_rods import left_out
from cgfibre.scene import Scene

#: part of the tow's thickness by which the chord of a segment may miss its line, longest segment in diameters, and
#: least segments from crossing to crossing
SAGITTA, SEGMENT, LEAST_SEGMENTS = 0.005, 4.0, 10
#: pairs of filaments that press on a bead at once
PAIRS = 3
#: line load (nN/um) whose tangent bounds the step, over that of the load at the stop on a filament lying on others
CONCENTRATION = 20.0
#: k of van Wyk's p = k E (V^3 - V0^3) for woven, nearly parallel filaments: for the platen's speed alone
VAN_WYK = 2e-3
#: background drag over the frequency of the fabric
DRAG = 0.05
SPEED_ERROR, REARRANGEMENT, SPACING_ERROR = 0.5, 0.03, 0.02


@dataclass(frozen=True)
class FibreMat:
    """Van Wyk's law p = k E (V^3 - V0^3) of fibres ``modulus`` kPa at a volume fraction V = V0 h/(h - d).

    Of a cell with an ``area`` um2 and a ``height`` h um: what the platen is expected to meet.
    """

    modulus: float
    fraction: float
    height: float
    area: float

    def displacement(self, force: float) -> float:
        """Of the platen at a force, um."""
        v = (self.fraction**3 + force / self.area / (VAN_WYK * self.modulus)) ** (1 / 3)
        return self.height * (1 - self.fraction / v)

    def force(self, displacement: float) -> float:
        """On the cell at a displacement, nN."""
        v = self.fraction * self.height / (self.height - displacement)
        return VAN_WYK * self.modulus * (v**3 - self.fraction**3) * self.area

    def stiffness(self, force: float) -> float:
        """Tangent nN/um at a force."""
        d = self.displacement(force)
        v = self.fraction * self.height / (self.height - d)
        return 3 * VAN_WYK * self.modulus * v**3 * self.area / (self.height - d)


def plan_woven_filaments(scene: Scene, choices: list[Choice]) -> Plan:
    """Plan of a weave filament by filament."""
    w, f = scene.weave, scene_filament(scene)
    d = f.diameter
    level = Choice("level", "chain", "stretch and bending: filaments held by their neighbours hardly roll")
    if scene.model.level != "auto":
        level = Choice("level", scene.model.level, "as asked in the scene")
    spacing, choice = _spacing(scene)
    system = woven_system(scene, "filament", spacing)
    longest = float(np.max(system.bond_lengths()))
    area = w.size[0] * w.size[1]
    height = built_height(system)
    volume = float(np.sum(math.pi / 4 * d**2 * system.bond_lengths()))
    mat = FibreMat(scene.filament.E1, volume / (area * height), height, area)
    stops = planned_stop(scene, height, mat)
    beads_touch = scene.contact.shape == "beads"
    law = scene.contact.law
    if law == "auto":
        law = "hooke" if beads_touch else "line"
    softening = 1.0 if scene.contact.softening == "auto" else float(scene.contact.softening)
    # the load of a crossing on one filament of the upper tow, along what it touches
    crossings = w.tows.warp * w.tows.weft
    squeeze = min(CONCENTRATION * stops.load / crossings / max(w.tow.width, w.weft.width), scene.contact.line_load)
    if beads_touch:
        plan = plan_contact(scene, law, longest, f.mass_per_length * longest, softening)
    else:
        plan = plan_capsule(scene, law, longest, f.mass_per_length, softening, squeeze)
    share = longest if beads_touch else 1.0  # of what is a bead's, not of a length
    touching = Touching(
        PAIRS,
        plan.tangent_kn / share,
        plan.wall_tangent / share,
        plan.pair.gamma / share,
        plan.wall_gamma / share,
    )
    axial = 1.0 if scene.model.axial_softening == "auto" else float(scene.model.axial_softening)
    beads, limit = chain_beads(system, touching, axial, level.value)
    timestep, step = checked_step(scene, limit)
    mass = float(np.sum(beads.mass))
    motion, sampling, more = plan_pressing(scene, mat, mass, timestep, stops)
    frequency = math.sqrt(mat.stiffness(REFERENCE_LOAD * stops.load) / mass)
    drag = DRAG * frequency * float(np.mean(beads.mass))
    pace = Pace(2 * math.pi / frequency, timestep, stops)
    woven = woven_plan(scene, "filament", system, volume, spacing, pace)
    choices += [
        level,
        choice,
        Choice("contact", *_SHAPES[beads_touch]),
        Choice("contact law", law, LAWS[law].format(load=scene.contact.line_load * 1e-6)),
        friction(scene),
        rest_choice(scene, level.value),
        Choice("axial softening", f"{axial:g}", "the cell is held: crimp that is pressed out goes into their length"),
        step,
        *more,
        *cell_choices(scene, woven),
    ]
    cost = level.value if beads_touch else f"{level.value}, capsules"
    platens = Platens(
        shape="flat",
        kn=plan.wall_kn,
        kt=plan.wall_kt,
        gamma=plan.wall_gamma,
        friction=scene.platens.friction,
        top_span=None,
        bottom_span=None,
        contact_length=w.size[0],
        modulus=plan.wall_modulus,
    )
    return Plan(
        level=level.value,
        spacing=longest,
        pitch=d,
        width=w.size[1],
        height=height,
        n_filaments=system.n_filaments,
        n_beads=system.n_beads,
        beads=beads,
        axial_softening=axial,
        timestep=timestep,
        timestep_limit=limit,
        drag=drag,
        turning_drag=0.1 * drag * d**2,
        torsion="none",
        contact=plan.pair,
        platens=platens,
        motion=motion,
        sampling=sampling,
        predicted_seconds=predicted_seconds(cost, system.n_beads, motion, sampling, woven=woven),
        choices=tuple(choices),
        omissions=_OMISSIONS + left_out(level.value, "filaments"),
        promise=(
            ErrorPart("platen speed", SPEED_ERROR * motion.eps * motion.pace, "inertia of the fabric"),
            ErrorPart("bead spacing", SPACING_ERROR, "chords in place of curved filaments"),
            ErrorPart("rearrangements", REARRANGEMENT, "filaments give way at slightly other displacements"),
        ),
        woven=woven,
    )


_OMISSIONS: tuple[Omission, ...] = (
    Omission("filament flattening", "sections stay round", "contacts take the compliance of the line contact"),
    Omission("gravity, adhesion, moisture", "small beside contact forces", "below 1e-3 of the force"),
)


#: whether beads touch -> (value, reason)
_SHAPES = {
    False: ("capsule", "segments of smooth filaments: crossings and parallel contacts by their own laws"),
    True: ("beads", "as asked, or because no plugin fits the engine: filaments ripple and nest, the step is shorter"),
}


def _spacing(scene: Scene) -> tuple[float, Choice]:
    asked, w = scene.model.spacing, scene.weave
    if asked != "auto":
        return float(asked), Choice("bead spacing", f"{float(asked):.4g} um at most", "as asked in the scene")
    if scene.contact.shape == "beads":
        d = scene.filament.diameter
        return d, Choice("bead spacing", f"{d:.4g} um at most", "one diameter: beads further apart miss each other")
    thickness = min(w.tow.thickness, w.weft.thickness)
    curvature = greatest_curvature(scene)
    chord = math.sqrt(8 * SAGITTA * thickness / curvature) if curvature > 0 else math.inf
    cell = min(w.spacing.warp, w.spacing.weft) / LEAST_SEGMENTS
    spacing = max(scene.filament.diameter, min(chord, cell, SEGMENT * scene.filament.diameter))
    why = f"chords miss the curved line by {curvature * spacing**2 / 8 / thickness:.1%} of the tow's thickness at most"
    return spacing, Choice("bead spacing", f"{spacing:.4g} um at most", why)
