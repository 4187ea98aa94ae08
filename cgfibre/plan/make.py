"""From a scene to a plan: one planner a level, in a table to extend."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cgfibre.build.bundle import filament_type
from cgfibre.build.packing import ArrangementSpec, arrange, pitch_from_void_fraction
from cgfibre.build.system import FilamentType, FloatArray
from cgfibre.errors import InputError
from cgfibre.mechanics import rod, support
from cgfibre.plan.beads import (
    SAFETY,
    bottom_span,
    choose_far_field,
    choose_symmetry,
    fine_zone,
    finish_beads,
    lay_beads,
    platen_span,
)
from cgfibre.plan.contact import OVERLAP_LIMIT, ContactPlan, plan_contact
from cgfibre.plan.model import CONTACT, Beads, Choice, Motion, Omission, Plan, Platens
from cgfibre.plan.motion import Bodies, depths_below_top, plan_motion, planned_displacement
from cgfibre.scene import Scene

#: background drag rate over the lowest natural frequency; 1.0 raised the force of carbon-37 by 12 %
DRAG = 0.05
#: seconds a bead and step on one core, measured on carbon-37; the calibrated cost model is still to come
COST = {"chain": 8e-8, "rod": 6e-7, "section": 3e-7}
STEP_COST = 1.5e-5  # seconds a step, however few the beads
#: of contacts: beads need no smaller step for the real stiffness than bending asks for; a section's discs do
CONTACT_SOFTENING = {"chain": 1.0, "rod": 1.0, "section": 10.0}
MAX_AXIAL_SOFTENING = 30.0
DISC_INERTIA = 0.125  # of m D^2
SHEAR = 0.9  # Timoshenko coefficient of a solid circle


@dataclass(frozen=True)
class Outline:
    """What the planners of all levels start from: the section as arranged and the filament's constants."""

    filament: FilamentType
    centres: FloatArray
    pitch: float
    width: float
    height: float
    displacement: float


def arrangement_spec(scene: Scene) -> ArrangementSpec:
    """The scene's arrangement as the builders take it."""
    a = scene.assembly
    if a.fibre_volume_fraction is not None:
        fraction: float | None = a.fibre_volume_fraction
    else:
        fraction = None if a.void_fraction is None else 1 - a.void_fraction
    return ArrangementSpec(
        name=a.arrangement,
        count=a.count,
        pitch=a.pitch,
        volume_fraction=fraction,
        first_angle=a.first_angle,
        aspect=1.0 if a.aspect is None else a.aspect,
        **({} if a.migration is None else {"epsilon": a.migration.epsilon, "beta": a.migration.beta}),
    )


def scene_filament(scene: Scene) -> FilamentType:
    """Section constants of the scene's filament."""
    f = scene.filament
    return filament_type(f.diameter, f.E1, f.G12, f.density, SHEAR)


def outline(scene: Scene) -> Outline:
    """Arrange the section and check the planned stop against it."""
    spec = arrangement_spec(scene)
    d = scene.filament.diameter
    centres = arrange(spec, d, np.random.default_rng(scene.assembly.seed))
    pitch = (
        spec.pitch if spec.pitch is not None else pitch_from_void_fraction(d, 1 - float(spec.volume_fraction or 0.69))
    )
    width, height = (float(np.ptp(centres[:, k])) + d for k in (0, 1))
    depth = planned_displacement(scene, height, width, len(centres))
    return Outline(scene_filament(scene), centres, max(pitch, d), width, height, depth)


def _choose_level(scene: Scene) -> Choice:
    asked = scene.model.level
    if asked != "auto":
        return Choice("level", asked, "as asked in the scene")
    if scene.assembly.twist or scene.assembly.migration is not None:
        return Choice("level", "rod", "filaments that twist or migrate carry torsion and cross each other")
    return Choice("level", "chain", "straight parallel filaments: stretch and bending, no torsion")


def _common_omissions(scene: Scene, level: str) -> list[Omission]:
    left = [
        Omission(
            "filament flattening",
            "a bead's section stays round; contacts take the compliance of the line contact, "
            f"its secant at {scene.contact.line_load * 1e-6:g} N/mm",
            "the approach of two filaments errs by up to half of itself a decade of load away (4 % D at 1 N/mm)",
        ),
        Omission(
            "gravity, adhesion, moisture", "small beside contact forces of micronewtons", "below 1e-3 of the force"
        ),
    ]
    if level == "chain":
        left.append(
            Omission(
                "torsion and rolling of filaments",
                "beads of a chain do not spin",
                "friction cannot roll a filament: right while mu N D/2 < GJ/L, else forces are too high",
            )
        )
    if level in ("chain", "rod"):
        left.append(
            Omission(
                "smoothness of the filament's surface",
                "beads are spheres a diameter apart",
                "friction along a filament ripples; the bundle nests by up to 13 % D where filaments cross columns",
            )
        )
    if not scene.platens.unload:
        left.append(Omission("unloading", "the scene does not ask for it", "none on the loading curve"))
    return left


def _platens(scene: Scene, contact: ContactPlan, contact_length: float, edges: bool) -> Platens:
    p, length = scene.platens, scene.assembly.length
    radius = 0.0
    if p.shape == "crimped" and p.crimp_angle is not None:
        lo, hi = platen_span(scene)
        radius = (hi - lo) / 2 / math.sin(p.crimp_angle)
    return Platens(
        shape=p.shape,
        kn=contact.wall_kn,
        kt=contact.wall_kt,
        gamma=contact.wall_gamma,
        friction=p.friction,
        top_span=platen_span(scene) if edges and p.width != "full" else None,
        bottom_span=bottom_span(scene) if edges and bottom_span(scene) != (0.0, length) else None,
        contact_length=contact_length,
        crimp_radius=radius,
        crimp_centre=length / 2,
        convex=p.curvature == "convex",
        bottom_crimped=p.crimp_side == "both",
    )


def _friction(scene: Scene) -> Choice:
    return Choice(
        "friction",
        f"{scene.contact.friction:g} between filaments, {scene.platens.friction:g} on platens",
        "Coulomb, stated separately in the scene; a filament never touches itself",
    )


def _softening(scene: Scene, level: str) -> Choice:
    asked = scene.contact.softening
    if asked != "auto":
        return Choice("contact softening", f"{asked:g}", "as asked in the scene")
    if CONTACT_SOFTENING[level] == 1:
        return Choice("contact softening", "1", "the real contact stiffness needs no shorter step than bending does")
    return Choice(
        "contact softening",
        f"{CONTACT_SOFTENING[level]:g}",
        "a softer contact allows a longer step and a faster "
        f"platen; what overlap this adds is checked against {OVERLAP_LIMIT:.0%} D",
    )


def _checked_step(scene: Scene, limit: float) -> Choice:
    asked = scene.model.timestep
    if asked == "auto":
        return Choice("time step", f"{SAFETY * limit:.4g} us", f"{SAFETY} of the stability limit {limit:.4g} us")
    if asked >= limit:
        raise InputError("model.timestep", f"{asked:g} us", f"less than the stability limit {limit:.4g} us")
    return Choice("time step", f"{asked:.4g} us", f"as asked in the scene; the limit is {limit:.4g} us")


def _axial(scene: Scene, level: str, spacing: float, filament: FilamentType) -> Choice:
    """EA may be softened until stretching is no stiffer than bending: that is what the step would wait for."""
    asked = scene.model.axial_softening
    if asked != "auto":
        return Choice("axial softening", f"{asked:g}", "as asked in the scene")
    if level != "chain":
        return Choice("axial softening", "1", "bending and twist of the beads limit the step as much as stretching")
    # axial 4 EA/(s m) against bending 16 EI/(s^3 m)
    balance = filament.EA * spacing**2 / (4 * filament.EI)
    strain = scene.ends.tension / filament.EA
    cap = MAX_AXIAL_SOFTENING if strain == 0 else min(MAX_AXIAL_SOFTENING, END_STRAIN / strain)
    value = max(1.0, min(balance, cap))
    return Choice(
        "axial softening",
        f"{value:.4g}",
        f"stretching as stiff as bending: a longer step; the end load strains the filament {value * strain:.2g}",
    )


#: largest strain that the end load may cause in softened filaments
END_STRAIN = 2e-3


def _filament_plan(scene: Scene, out: Outline, level: str, choices: list[Choice]) -> Plan:
    """Levels chain and rod: filaments as beads along x."""
    f, d = out.filament, scene.filament.diameter
    asked = scene.model.spacing
    spacing = d if asked == "auto" else float(asked)
    choices.append(
        Choice(
            "bead spacing",
            f"{spacing:.4g} um at most",
            "one diameter: the largest at which beads of neighbouring filaments always meet"
            if asked == "auto"
            else "as asked in the scene",
        )
    )
    tension = scene.ends.tension
    layer = math.sqrt(f.EI / tension) if tension > 0 else scene.assembly.length
    zone = fine_zone(scene, out.height, layer)
    far, why = choose_far_field(scene, level, zone)
    choices.append(Choice("far field", far, why))
    axial = _axial(scene, level, spacing, f)
    softening = _softening(scene, level)
    choices += [axial, softening, _friction(scene)]
    law = "hooke" if scene.contact.law == "auto" else scene.contact.law
    choices.append(
        Choice(
            "contact law",
            law,
            f"line contact of parallel cylinders, secant at {scene.contact.line_load * 1e-6:g} N/mm"
            if law == "hooke"
            else "crossing cylinders (Hertz, Mindlin)",
        )
    )
    half, reason = choose_symmetry(scene, level, far, scene.model.torsion == "dihedral")
    layout = lay_beads(scene, f, level, spacing, zone, far, half)
    choices.append(Choice("symmetry", "the right half" if layout.half else "none", reason))
    stations = layout.stations
    # what a bead under the platen stands for: the spacing there
    lo, hi = platen_span(scene)
    under = (stations > lo - 1e-6) & (stations < hi + 1e-6)
    bead = float(np.max(np.diff(stations[under]))) if under.sum() > 1 else spacing
    mass = bead * f.mass_per_length
    contact = plan_contact(scene, law, bead, mass, float(softening.value))
    beads, limit = finish_beads(scene, f, level, layout, float(axial.value), contact)
    step = _checked_step(scene, limit)
    choices.append(step)
    timestep = SAFETY * limit if scene.model.timestep == "auto" else float(scene.model.timestep)
    width = 0.0 if scene.platens.width == "full" else float(scene.platens.width)
    stiffness = 1 / float(rod.platen_compliance(scene.assembly.length, f.EI, width=width, tension=tension))
    span = scene.assembly.length if far == "none" else zone[1] - zone[0]
    frequency = float(rod.bending_frequency(span, f.EI, f.mass_per_length, tension=tension))
    if far != "none":  # the zone swings on the soft far field
        frequency = min(frequency, math.sqrt(stiffness / (f.mass_per_length * span)))
    bodies = Bodies(
        depths_below_top(out.centres),
        out.pitch,
        stiffness,
        frequency,
        contact.tangent_kn,
        mass,
        len(out.centres) * len(stations),
        bends=far == "none",
    )
    motion, sampling, motion_choices = plan_motion(scene, bodies, timestep, out.displacement)
    choices += motion_choices
    omissions = _common_omissions(scene, level)
    if far == "condensed":
        omissions.append(Omission("filaments beyond the fine zone", why, "within 2 % of graded beads (measured)"))
    if not np.all(beads.role == CONTACT) and far != "none":
        omissions.append(
            Omission("contact beyond the fine zone", "filaments there fan out to their supports", "not measured")
        )
    if far != "none":
        choices.append(
            Choice(
                "bead mass",
                "numerical beyond the fine zone",
                "a quasi-static run needs no inertia: coarse beads weigh what the common step allows",
            )
        )
    drag = DRAG * frequency
    n_beads = len(out.centres) * (len(stations) // 2 + 1 if layout.half else len(stations))
    return Plan(
        level=level,
        spacing=bead,
        pitch=out.pitch,
        width=out.width,
        height=out.height,
        n_filaments=len(out.centres),
        n_beads=n_beads,
        beads=beads,
        axial_softening=float(axial.value),
        timestep=timestep,
        timestep_limit=limit,
        drag=drag * mass,
        turning_drag=drag * rod.SPHERE_INERTIA * mass * d**2,
        torsion=scene.model.torsion,
        contact=contact.pair,
        platens=_platens(scene, contact, hi - lo, edges=True),
        motion=motion,
        sampling=sampling,
        predicted_seconds=_seconds(level, n_beads, motion),
        choices=tuple(choices),
        omissions=tuple(omissions),
        free_span=min(lo, 2 * layer) if lo > 0 else math.inf,
    )


def _section_plan(scene: Scene, out: Outline, level: str, choices: list[Choice]) -> Plan:
    """Level section: one disc a filament on springs."""
    f, length, tension = out.filament, scene.assembly.length, scene.ends.tension
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
    softening = _softening(scene, level)
    choices += [softening, _friction(scene)]
    mass = f.mass_per_length * depth
    law = "hooke"
    contact = plan_contact(scene, law, depth, mass, float(softening.value))
    if scene.model.spring == "thesis":
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
    choices.append(
        Choice(
            "torsional springs",
            f"{turn:.4g} nN um/rad",
            f"{scene.model.torsional_spring}: "
            + {"none": "discs roll freely", "thesis": "GJ/L (Eq 7-2)", "exact": "4 GJ/L, both ends held"}[
                scene.model.torsional_spring
            ],
        )
    )
    inertia = DISC_INERTIA * mass * f.diameter**2
    touching, damping = contact.bounds(DISC_INERTIA)
    limit = float(rod.limiting_time_step(touching + max(k, turn * mass / inertia), mass, damping))
    choices.append(_checked_step(scene, limit))
    timestep = SAFETY * limit if scene.model.timestep == "auto" else float(scene.model.timestep)
    frequency = float(support.support_frequency(k, mass))
    bodies = Bodies(depths_below_top(out.centres), out.pitch, k, frequency, contact.tangent_kn, mass, len(out.centres))
    motion, sampling, motion_choices = plan_motion(scene, bodies, timestep, out.displacement)
    choices += motion_choices
    beads = Beads(
        stations=np.zeros(1),
        role=np.zeros(1, dtype=np.int64),
        mass=np.array([mass]),
        hinge=np.zeros(1),
        support="springs",
        end_load=0.0,
    )
    omissions = [
        *_common_omissions(scene, level),
        Omission(
            "everything along the filaments",
            "nothing varies along the length but the bending that the springs stand for",
            "springs are linear: too soft once filaments deflect by more than about a tenth of the free span",
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
        platens=_platens(scene, contact, depth, edges=False),
        motion=motion,
        sampling=sampling,
        predicted_seconds=_seconds(level, n, motion),
        choices=tuple(choices),
        omissions=tuple(omissions),
        depth=depth,
        springs=(k, turn),
    )


def _seconds(level: str, n_beads: int, motion: Motion) -> float:
    """Predicted engine seconds on one core."""
    steps = motion.load_steps * (2 if motion.unload else 1) + motion.hold_steps
    return (STEP_COST + COST[level] * n_beads) * steps


PLANNERS: dict[str, Callable[[Scene, Outline, str, list[Choice]], Plan]] = {
    "chain": _filament_plan,
    "rod": _filament_plan,
    "section": _section_plan,
}


def make_plan(scene: Scene) -> Plan:
    """The plan of a scene; InputError names what in the scene cannot be modelled."""
    level = _choose_level(scene)
    if level.value not in PLANNERS:
        raise InputError("model.level", level.value, "one of " + ", ".join(PLANNERS))
    return PLANNERS[level.value](scene, outline(scene), level.value, [level])
