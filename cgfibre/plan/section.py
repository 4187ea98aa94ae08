"""Planner of the level section: one disc a filament, on springs that stand for its bending between the supports."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cgfibre.errors import InputError
from cgfibre.mechanics import rod, support
from cgfibre.plan.common import checked_step, common_omissions, friction, platens
from cgfibre.plan.contact import OVERLAP_LIMIT, plan_contact
from cgfibre.plan.cost import predicted_seconds
from cgfibre.plan.filaments import DRAG
from cgfibre.plan.level import nothing_varies
from cgfibre.plan.model import Beads, Choice, Omission, Plan, Platens
from cgfibre.plan.motion import Bodies, depths_below_top, loose, plan_motion
from cgfibre.plan.outline import Outline
from cgfibre.plan.promise import promise
from cgfibre.plan.section_platens import middle_gap
from cgfibre.scene import Scene, Stop

DISC_INERTIA = 0.125  # of m D^2
#: a disc's contacts alone set its step: softened, it is longer and the platen faster
CONTACT_SOFTENING = 10.0


def plan_section(scene: Scene, out: Outline, level: str, choices: list[Choice]) -> Plan:
    """Plan of a scene at level section; without springs where nothing varies along the filaments."""
    f, length, tension = out.filament, scene.bundle.length, scene.ends.tension
    width = length if scene.platens.width == "full" else float(scene.platens.width)
    depth = width if scene.model.depth == "auto" else float(scene.model.depth)
    choices.append(
        Choice(
            "depth",
            f"{depth:.4g} um",
            "the platen's width: discs touch along all of it"
            if scene.model.depth == "auto"
            else "as asked in the scene",
        )
    )
    softening = _softening(scene)
    choices += [softening, friction(scene)]
    mass = f.mass_per_length * depth
    law = "hooke"
    contact = plan_contact(scene, law, depth, mass, float(softening.value))
    free = nothing_varies(scene)
    if free:
        k = 0.0
        choices.append(Choice("springs", "none", "a periodic cell has no end supports to bend against"))
    elif scene.model.spring == "thesis":
        k = float(support.thesis_mid_span_stiffness(length, f.EI, tension))
        choices.append(
            Choice("springs", f"{k:.4g} nN/um", "Eq 7-1 of the thesis, as asked (21 % stiff for a long filament)")
        )
    else:
        loaded = 0.0 if scene.platens.width == "full" else width
        k = 1 / float(rod.platen_compliance(length, f.EI, width=loaded, tension=tension))
        choices.append(
            Choice("springs", f"{k:.4g} nN/um", "a pre-tensioned beam pushed by the platen's two edges, exact")
        )
    turn = {
        "none": 0.0,
        "thesis": float(support.thesis_torsional_stiffness(length, f.GJ)),
        "exact": float(support.mid_span_torsional_stiffness(length, f.GJ)),
    }[scene.model.torsional_spring]
    if free:
        turn = 0.0
    choices.append(
        Choice(
            "torsional springs",
            f"{turn:.4g} nN um/rad",
            "none: discs roll freely in a periodic cell"
            if free
            else f"{scene.model.torsional_spring}: "
            + {"none": "discs roll freely", "thesis": "GJ/L (Eq 7-2)", "exact": "4 GJ/L, both ends held"}[
                scene.model.torsional_spring
            ],
        )
    )
    inertia = DISC_INERTIA * mass * f.diameter**2
    touching, damping = contact.bounds(DISC_INERTIA)
    limit = float(rod.limiting_time_step(touching + max(k, turn * mass / inertia), mass, damping))
    timestep, step = checked_step(scene, limit)
    choices.append(step)
    if free:
        stiffness, frequency = loose(contact.tangent_kn, mass, out.height / scene.filament.diameter)
    else:
        stiffness, frequency = k, float(support.support_frequency(k, mass))
    bodies = Bodies(
        depths_below_top(out.centres), out.pitch, stiffness, frequency, contact.tangent_kn, mass, len(out.centres)
    )
    platen = platens(scene, contact, depth, edges=False, across=_curved(scene, out))
    if scene.platens.shape == "crimped":
        choices.append(_crimp(scene, platen))
        out = _from_crimped(scene, out, platen)
    motion, sampling, motion_choices = plan_motion(scene, bodies, timestep, out.displacement, out.earlier, depth)
    choices += motion_choices
    beads = Beads(
        stations=np.zeros(1),
        role=np.zeros(1, dtype=np.int64),
        mass=np.array([mass]),
        hinge=np.zeros(1),
        support="periodic" if free else "springs",
        end_load=0.0,
    )
    omissions = [
        *common_omissions(scene, level),
        Omission(
            "everything along the filaments",
            "nothing varies along the length" + ("" if free else " but the bending that the springs stand for"),
            "none"
            if free
            else "springs are linear: too soft once filaments deflect by more than about a tenth of the free span",
        ),
    ]
    if scene.platens.width != "full":
        omissions.append(
            Omission(
                "sag between the anvil's edges",
                "a slice moves as the anvil's edges do; filaments sag further in between (2.1 times at mid-span for "
                "0.5 mm on 0.7 mm) and meet their neighbours earlier",
                "forces of carbon-37 are 15 to 25 % below the chain level's to 10 um, half of them at 14 to 22 um "
                "(measured)",
            )
        )
    n = len(out.centres)
    drag = DRAG * frequency
    return Plan(
        level=level,
        spacing=0.0,
        pitch=out.pitch,
        width=out.width,
        height=out.height,
        n_filaments=n,
        n_beads=n,
        beads=beads,
        axial_softening=1.0,
        timestep=timestep,
        timestep_limit=limit,
        drag=drag * mass,
        turning_drag=drag * inertia,
        torsion="none",
        contact=contact.pair,
        platens=platen,
        motion=motion,
        sampling=sampling,
        predicted_seconds=predicted_seconds(level, n, motion, sampling),
        choices=tuple(choices),
        omissions=tuple(omissions),
        promise=promise(scene, out, level, 0.0, float(softening.value), motion),
        depth=depth,
        springs=(k, turn),
    )


def _curved(scene: Scene, out: Outline) -> tuple[float, float]:
    """y over which crimped platens are curved, um: the assembly's width as built unless the scene says otherwise."""
    y = out.centres[:, 0]
    asked = scene.platens.crimp_width
    width = out.width if asked == "auto" else float(asked)
    middle = float(y.min() + y.max()) / 2
    return middle - width / 2, middle + width / 2


def _crimp(scene: Scene, platen: Platens) -> Choice:
    angle = scene.platens.crimp_angle or 0.0
    half = platen.crimp_radius * math.sin(angle)
    return Choice(
        "crimped platens",
        f"{'convex' if platen.convex else 'concave'}, R = {platen.crimp_radius:.4g} um"
        + ("" if platen.bottom_crimped else ", the bottom one flat"),
        f"curved across the section: they lean by {math.degrees(angle):.3g} deg {half:.4g} um from the middle, as a "
        "crossing tow does; the thickness is that at the middle",
    )


def _from_crimped(scene: Scene, out: Outline, platen: Platens) -> Outline:
    """The outline with stops by thickness counted from the gap at the middle, where curved platens first touch."""
    gap = middle_gap(platen, out.centres, out.filament.diameter / 2)
    if not math.isfinite(gap):
        angle = scene.platens.crimp_angle or 0.0
        raise InputError(
            "platens.crimp_width",
            f"{2 * platen.crimp_radius * math.sin(angle):.4g} um",
            f"more than {math.sin(angle) * out.width:.4g} um: the assembly, {out.width:.4g} um wide, reaches beyond "
            "the platens' cylinders",
        )
    more = gap - out.height
    stops = [cycle for cycle in scene.platens.cycles for _ in range(cycle.times)]

    def moved(stop: Stop, depth: float) -> float:
        return depth + more if stop.kind == "thickness" else depth

    return replace(
        out,
        displacement=moved(scene.platens.stop, out.displacement),
        earlier=tuple(moved(s, d) for s, d in zip(stops, out.earlier, strict=True)),
    )


def _softening(scene: Scene) -> Choice:
    asked = scene.contact.softening
    if asked != "auto":
        return Choice("contact softening", f"{asked:g}", "as asked in the scene")
    return Choice(
        "contact softening",
        f"{CONTACT_SOFTENING:g}",
        "a softer contact allows a longer step and a faster "
        f"platen; what overlap this adds is checked against {OVERLAP_LIMIT:.0%} D",
    )
