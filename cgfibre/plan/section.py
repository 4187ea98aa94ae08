"""Planner of the level section: one disc a filament, on springs that stand for its bending between the supports."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cgfibre.errors import InputError
from cgfibre.mechanics import rod, support
from cgfibre.mechanics.elastica import SpringLaw, spring_law
from cgfibre.plan.common import checked_step, common_omissions, friction, platens
from cgfibre.plan.contact import OVERLAP_LIMIT, STIFFEN_FROM, STIFFEN_TO, line_contacts, plan_contact
from cgfibre.plan.cost import predicted_seconds
from cgfibre.plan.filaments import DRAG
from cgfibre.plan.level import nothing_varies
from cgfibre.plan.model import Beads, Choice, Omission, Plan, Platens
from cgfibre.plan.motion import PILE_GAIN, SPEED_GAIN, Bodies, depths_below_top, loose, plan_motion
from cgfibre.plan.outline import Outline
from cgfibre.plan.promise import promise
from cgfibre.plan.section_platens import middle_gap
from cgfibre.scene import Scene, Stop

DISC_INERTIA = 0.125  # of m D^2
#: without an estimate of the contacts' forces, or a way to make contacts stiffer later: a disc's contacts alone set its
#: step, softened it is longer
CONTACT_SOFTENING = 10.0
#: overlap over diameter that a mean column of discs may have at the stop, by the forces of its springs alone; the
#: deepest is some CONCENTRATION times that
SPRING_OVERLAP, CONCENTRATION = 0.005, 2.0
MAX_SOFTENING = 1e4
#: springs of at most this part of a contact's stiffness
SPRING_SHARE = 0.1
#: deflection over the free span beside the platen (of a beam under mid-span: half its length) up to which springs are
#: taken as linear: 1 % soft there
LINEAR_SPRING = 0.1
#: discs go sideways as well as down: the springs' law reaches so far beyond the planned displacement
SPRING_MARGIN = 1.2


def filament_springs(scene: Scene, out: Outline) -> tuple[float, float]:
    """(nN/um, nN um/rad) that hold a filament at its middle, for small deflections; none in a periodic cell."""
    if nothing_varies(scene):
        return 0.0, 0.0
    f, length, tension = out.filament, scene.bundle.length, scene.ends.tension
    loaded = 0.0 if scene.platens.width == "full" else float(scene.platens.width)
    if scene.model.spring == "thesis":
        k = float(support.thesis_mid_span_stiffness(length, f.EI, tension))
    else:
        k = 1 / float(rod.platen_compliance(length, f.EI, width=loaded, tension=tension))
    turn = {
        "none": 0.0,
        "thesis": float(support.thesis_torsional_stiffness(length, f.GJ)),
        "exact": float(support.mid_span_torsional_stiffness(length, f.GJ)),
    }[scene.model.torsional_spring]
    return k, turn


def disc_beads(scene: Scene, mass: float) -> Beads:
    """A filament, or a bundle of them, as one disc of ``mass`` pg on its springs (none in a periodic cell)."""
    return Beads(
        stations=np.zeros(1),
        role=np.zeros(1, dtype=np.int64),
        mass=np.array([mass]),
        hinge=np.zeros(1),
        support="periodic" if nothing_varies(scene) else "springs",
        end_load=0.0,
    )


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
    mass = f.mass_per_length * depth
    free = nothing_varies(scene)
    plugin = scene.contact.shape != "beads"
    span = (length - (0.0 if scene.platens.width == "full" else width)) / 2
    large: SpringLaw | None = None
    k, turn = filament_springs(scene, out)
    if free:
        choices.append(Choice("springs", "none", "a periodic cell has no end supports to bend against"))
    elif scene.model.spring == "thesis":
        choices.append(
            Choice("springs", f"{k:.4g} nN/um", "Eq 7-1 of the thesis, as asked (21 % stiff for a long filament)")
        )
    else:
        loaded = 0.0 if scene.platens.width == "full" else width
        if _wants_elastica(scene, plugin, out.displacement / span):
            large = spring_law(length, f.EI, tension, loaded, SPRING_MARGIN * out.displacement)
        choices.append(_spring_choice(k, large))
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
    columns = out.width / out.pitch
    hardening = 1.0 if large is None else float(large(out.displacement)) / (k * out.displacement)
    bodies = Bodies(depths_below_top(out.centres), out.pitch, k, 0.0, 0.0, mass, len(out.centres), columns=columns)
    most = 0.0 if free else float(bodies.force(np.array(out.displacement), f.diameter)) / columns * hardening
    softening = _softening(scene, plugin and not free, depth, most, k)
    choices += [softening, friction(scene)]
    contact = plan_contact(scene, "hooke", depth, mass, float(softening.value))
    inertia = DISC_INERTIA * mass * f.diameter**2
    touching, damping = contact.bounds(DISC_INERTIA)
    limit = float(rod.limiting_time_step(touching + max(_stiffest(k, large), turn * mass / inertia), mass, damping))
    timestep, step = checked_step(scene, limit)
    choices.append(step)
    if free:
        stiffness, frequency = loose(contact.tangent_kn, mass, out.height / scene.filament.diameter)
    else:
        stiffness, frequency = k, float(support.support_frequency(k, mass))
    bodies = replace(
        bodies,
        stiffness=stiffness,
        frequency=frequency,
        contact_stiffness=contact.tangent_kn,
        columns=0.0 if free else columns,
        gain=SPEED_GAIN if free else PILE_GAIN,
    )
    platen = platens(scene, contact, depth, edges=False, across=_curved(scene, out))
    if scene.platens.shape == "crimped":
        choices.append(_crimp(scene, platen))
        out = _from_crimped(scene, out, platen)
    motion, sampling, motion_choices = plan_motion(scene, bodies, timestep, out.displacement, out.earlier, depth)
    choices += motion_choices
    omissions = [
        *common_omissions(scene, level),
        Omission(
            "everything along the filaments",
            "nothing varies along the length" + ("" if free else " but the bending that the springs stand for"),
            "none" if free else _spring_error(large, out.displacement / span),
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
        beads=disc_beads(scene, mass),
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
        # contacts as soft as springs allow overlap no more than those of the least softening
        promise=promise(scene, out, level, 0.0, min(float(softening.value), CONTACT_SOFTENING), motion),
        depth=depth,
        springs=(k, turn),
        spring_law=large,
        disc_fixes="plugin" if plugin else "engine",
        stiffen=float(softening.value) if plugin and scene.contact.softening == "auto" else 1.0,
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


def _wants_elastica(scene: Scene, plugin: bool, steepness: float) -> bool:
    """Whether springs take the law of large deflections, for a planned deflection over the free span."""
    asked = scene.model.spring
    if asked == "elastica" and not plugin:
        raise InputError(
            "model.spring", asked, "'exact' or 'thesis': springs of any law need the plugin (cgfibre plugin build)"
        )
    return asked == "elastica" or (asked == "auto" and plugin and steepness > LINEAR_SPRING)


def _spring_choice(k: float, large: SpringLaw | None) -> Choice:
    beam = "a pre-tensioned beam pushed by the platen's two edges"
    if large is None:
        return Choice("springs", f"{k:.4g} nN/um", f"{beam}, exact for small deflections")
    last = large.deflection[-1]
    ratio = large.force[-1] / (k * last)
    return Choice(
        "springs",
        f"{k:.4g} nN/um, {ratio:.3g} times that at {last:.3g} um",
        f"{beam}, exact for large deflections (elastica, its ends slide)",
    )


def _spring_error(large: SpringLaw | None, steepness: float) -> str:
    if large is None and steepness <= LINEAR_SPRING:
        return f"below 1 %: filaments deflect by {steepness:.2g} of the free span at most"
    if large is None:
        return (
            f"springs are linear: too soft for deflections of {steepness:.2g} of the free span (elastica: 1 % at a "
            "tenth, 16 % at a third, 50 % at a half)"
        )
    if math.isfinite(large.reach):
        return (
            f"beyond {large.reach:.3g} um a filament alone would be drawn through between the platen's edges: its law "
            "goes on by its tangent there; a longer assembly.length has room"
        )
    return "the same law for all directions, alone of the way from where a filament was built"


def _stiffest(k: float, large: SpringLaw | None) -> float:
    return k if large is None else float(np.max(large.stiffness(np.array(large.deflection))))


def _softening(scene: Scene, plugin: bool, depth: float, column: float, k: float) -> Choice:
    """Contacts as soft as the springs' forces allow, ``column`` nN in a column of discs at the stop."""
    asked = scene.contact.softening
    if asked != "auto":
        return Choice("contact softening", f"{asked:g}", "as asked in the scene")
    if not plugin:
        return Choice(
            "contact softening",
            f"{CONTACT_SOFTENING:g}",
            "a softer contact allows a longer step and a faster "
            f"platen; what overlap this adds is checked against {OVERLAP_LIMIT:.0%} D",
        )
    real = float(line_contacts(scene)[0].secant_stiffness(scene.contact.line_load)) * depth
    needed = max(CONCENTRATION * column / (SPRING_OVERLAP * scene.filament.diameter), k / SPRING_SHARE)
    value = min(max(real / needed, 1.0), MAX_SOFTENING)
    return Choice(
        "contact softening",
        f"{value:.4g}",
        f"springs press a column of discs with {column:.2g} nN at the stop: contacts as soft as that allows make the "
        f"longest step; from overlaps of {STIFFEN_FROM:.0%} D on they become real, as they are at {STIFFEN_TO:.1%} D",
    )
