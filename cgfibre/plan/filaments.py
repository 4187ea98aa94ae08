"""Planner of the levels chain and rod: filaments as beads along x."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

from cgfibre.build.system import FilamentType
from cgfibre.mechanics import rod
from cgfibre.plan.beads import choose_far_field, choose_symmetry, fine_zone, finish_beads, lay_beads, platen_span
from cgfibre.plan.common import checked_step, common_omissions, friction, platens
from cgfibre.plan.contact import OVERLAP_LIMIT, TANGENTIAL_RATIO, line_contacts, plan_capsule, plan_contact
from cgfibre.plan.cost import predicted_seconds
from cgfibre.plan.level import natural_curvature, nothing_varies
from cgfibre.plan.model import CONTACT, Choice, Omission, Plan
from cgfibre.plan.motion import SPEED_GAIN, Bodies, depths_below_top, loose, plan_motion
from cgfibre.plan.outline import Outline
from cgfibre.plan.promise import promise
from cgfibre.scene import Scene

#: background drag rate over the lowest natural frequency; 1.0 raised the force of carbon-37 by 12 %
DRAG = 0.05
MAX_AXIAL_SOFTENING = 30.0
STRETCH_SHARE = 0.1
#: largest strain that the end load may cause in softened filaments
END_STRAIN = 2e-3
#: rods also swing in twist: at the gain of chains a twisted bundle had 6 % of the work as kinetic energy
ROD_GAIN = 1.0
#: chains of capsules: the force of carbon-37 to 12 um then errs by about 3 % on average at accuracy 0.05 (2.0 % at 1.2)
CAPSULE_GAIN = 1.6
#: parts of the accuracy that the spacing of one filament alone may spend on bending and on the platens' length
SPACING_SHARE, SQUEEZE_SHARE = 0.1, 0.3
#: longest segment that touches, in diameters, and least number of them along a filament
SEGMENT, LEAST_SEGMENTS = 4.0, 16
#: largest line load over its mean over the columns under a platen (carbon-37 at 30 um: 17), and the overlap over
#: diameter and the softening that it may have: to 12 um of carbon-37 a softening of 4 changed forces by 1 % at most, of
#: seven filaments 9 lowered them by 8 %
CONCENTRATION, SOFT_OVERLAP, MAX_SOFTENING = 20.0, 0.01, 3.0
#: displacement over the free length beside the platen beyond which a plan says what leaning filaments do
STEEP = 0.4
#: part of D by which the chord of a segment may miss the curved filament that it stands for
SAGITTA = 0.01


LAWS = {
    "line": "line contact of parallel cylinders itself, Hertz where they cross",
    "hooke": "line contact of parallel cylinders, secant at {load:g} N/mm",
    "hertz": "crossing cylinders (Hertz, Mindlin)",
}


def axial_softening(
    scene: Scene, level: str, spacing: float, filament: FilamentType, touching: float = math.inf
) -> Choice:
    """EA may be softened until stretching is no stiffer than bending: that is what the step would wait for.

    Where contacts hold the step (``touching``: their bound of a bead, nN/um), softening to STRETCH_SHARE of them is
    enough: more of it would only let filaments stretch.
    """
    asked = scene.model.axial_softening
    if asked != "auto":
        return Choice("axial softening", f"{asked:g}", "as asked in the scene")
    if level != "chain":
        return Choice("axial softening", "1", "bending and twist of the beads limit the step as much as stretching")
    # axial 4 EA/(s m) against bending 16 EI/(s^3 m)
    balance = filament.EA * spacing**2 / (4 * filament.EI)
    strain = scene.ends.tension / filament.EA
    cap = MAX_AXIAL_SOFTENING if strain == 0 else min(MAX_AXIAL_SOFTENING, END_STRAIN / strain)
    held = 4 * filament.EA / (spacing * STRETCH_SHARE * touching)
    value = max(1.0, min(balance, cap, held if math.isfinite(touching) else math.inf))
    why = "a tenth as stiff as contacts" if value == held else "stretching as stiff as bending"
    return Choice(
        "axial softening",
        f"{value:.4g}",
        f"{why}: a longer step; the end load strains the filament {value * strain:.2g}",
    )


def contact_shape(scene: Scene) -> Choice:
    """Whether filaments touch along their segments (capsules) or bead by bead."""
    asked, law = scene.contact.shape, scene.contact.law
    if asked == "beads":
        return Choice("contact", asked, "as asked, or because no plugin fits the engine (cgfibre plugin status)")
    if asked != "auto":
        return Choice("contact", asked, "as asked in the scene")
    if law == "hertz":
        return Choice("contact", "beads", "the law hertz is one of points; capsules find crossings themselves")
    return Choice(
        "contact",
        "capsule",
        "segments of smooth filaments: friction without ripple, crossings and parallel contacts by their own laws, and "
        "a spacing that bending alone decides",
    )


def _segment(scene: Scene, level: str, out: Outline) -> tuple[float, Choice]:
    """Spacing of beads whose segments touch, um: what bending and curvature allow."""
    d, length = scene.filament.diameter, scene.bundle.length
    lo, hi = platen_span(scene)
    width = 0.0 if scene.platens.width == "full" else hi - lo
    unit = float(rod.chain_bending_error(1.0, length, width=width, clamped=scene.ends.support == "clamped"))
    bending = math.sqrt(SPACING_SHARE * scene.model.accuracy / unit) if level == "chain" else math.inf
    curvature = natural_curvature(scene, out)
    chord = math.sqrt(8 * SAGITTA * d / curvature) if curvature > 0 else math.inf
    spacing = max(d, min(SEGMENT * d, bending, chord, length / LEAST_SEGMENTS))
    reason = f"segments touch along all their length: as long as bending (error {unit * spacing**2:.1g})"
    if curvature > 0:
        reason += f" and curvature (chords {curvature * spacing**2 / 8 / d:.1%} D off)"
    return spacing, Choice("bead spacing", f"{spacing:.4g} um at most", f"{reason} allow, {SEGMENT:g} D at most")


def _spacing(scene: Scene, level: str, far_field: str, shape: str, out: Outline) -> tuple[float, Choice]:
    """Bead spacing, um: one diameter, so that beads of neighbours meet; what bending allows for one filament alone and
    where segments touch."""
    asked, d = scene.model.spacing, scene.filament.diameter
    if asked != "auto":
        return float(asked), Choice("bead spacing", f"{float(asked):.4g} um at most", "as asked in the scene")
    if shape == "capsule":
        return _segment(scene, level, out)
    if scene.bundle.count > 1 or far_field != "none":
        return d, Choice(
            "bead spacing",
            f"{d:.4g} um at most",
            "one diameter: the largest at which beads of neighbouring filaments always meet"
            if scene.bundle.count > 1
            else "one diameter in the fine zone; the far field is coarse",
        )
    lo, hi = platen_span(scene)
    length = scene.bundle.length
    width = 0.0 if scene.platens.width == "full" else hi - lo
    unit = float(rod.chain_bending_error(1.0, length, width=width, clamped=scene.ends.support == "clamped"))
    bending = math.sqrt(SPACING_SHARE * scene.model.accuracy / unit) if level == "chain" else math.inf
    # between two platens it is squeezed: the beads on their edges count whole, s/w of the contact too much
    edges = SQUEEZE_SHARE * scene.model.accuracy * (hi - lo)
    spacing = max(d, min(bending, edges, length / 16))
    return spacing, Choice(
        "bead spacing",
        f"{spacing:.4g} um at most",
        "one filament has no neighbours to meet: as coarse as its bending and the platens' length in beads allow "
        f"(errors {unit * spacing**2:.1g} and {spacing / (hi - lo):.1g})",
    )


def squeeze_load(scene: Scene, out: Outline) -> float:
    """Line load of a column of filaments pressed by more than its gaps, nN/um; 0 where none is.

    Contacts and platens in a row take up the rest of the displacement, s = (n - 1) delta(f) + 2 delta_platen(f). No
    more than what the law takes up to its straight continuation.
    """
    gaps, count = out.column()
    squeeze = out.displacement - gaps
    if squeeze <= 0:
        return 0.0
    between, on_platen = line_contacts(scene)
    most = min(float(c.line_load(c.log_radius**2 / (2 * c.radius))) for c in (between, on_platen))

    def short(load: float) -> float:
        return (count - 1) * float(between.approach(load)) + 2 * float(on_platen.approach(load)) - squeeze

    return most if short(most) <= 0 else float(brentq(short, 0.0, most))


def line_softening(scene: Scene, out: Outline) -> Choice:
    """Line contacts may be softened as far as the overlap stays small under the load to expect.

    That is the bending force at the planned displacement over the platen's length and sqrt(n) columns, times
    CONCENTRATION: filaments press on each other where they sag against the platen's edges.
    """
    asked, d = scene.contact.softening, scene.filament.diameter
    if asked != "auto":
        return Choice("contact softening", f"{asked:g}", "as asked in the scene")
    if out.displacement > out.column()[0]:
        reason = "real contacts: filaments that stand one above the other are squeezed between the platens"
        return Choice("contact softening", "1", reason)
    lo, hi = platen_span(scene)
    columns = math.sqrt(len(out.centres))
    load = CONCENTRATION * out.bending_force(scene, out.displacement) / ((hi - lo) * columns)
    contact = line_contacts(scene)[0]
    load = min(load, scene.contact.line_load)
    overlap = float(contact.approach(load)) / d
    value = max(1.0, float(f"{min(SOFT_OVERLAP / overlap, MAX_SOFTENING):.3g}"))
    if value == 1:
        reason = f"real contacts: they overlap by {overlap:.1%} D under some {load * 1e-6:.2g} N/mm"
        return Choice("contact softening", "1", reason)
    return Choice(
        "contact softening",
        f"{value:g}",
        f"a longer step; surfaces overlap by {SOFT_OVERLAP:.1%} D in place of {overlap:.2%} under some "
        f"{load * 1e-6:.2g} N/mm, where platens and bending press most",
    )


def contact_softening(scene: Scene, filament: FilamentType, spacing: float, law: str) -> Choice:
    """Contacts may be softened until they are no stiffer than bending, as far as the overlap stays small."""
    asked = scene.contact.softening
    if asked != "auto":
        return Choice("contact softening", f"{asked:g}", "as asked in the scene")
    if law != "hooke":
        return Choice("contact softening", "1", "crossing contacts soften themselves at small loads")
    load, d = scene.contact.line_load, scene.filament.diameter
    stiffness = float(line_contacts(scene)[0].secant_stiffness(load))
    # six contacts against 16 EI/s^3 of bending
    six = float(rod.contact_stiffness_bound(stiffness * spacing, kt_ratio=TANGENTIAL_RATIO))
    balance = six * spacing**3 / (16 * filament.EI)
    most = OVERLAP_LIMIT * d * stiffness / load
    value = max(1.0, float(f"{min(balance, most):.3g}"))
    if value == 1:
        return Choice("contact softening", "1", "the real contact stiffness needs no shorter step than bending does")
    return Choice(
        "contact softening",
        f"{value:g}",
        f"contacts as stiff as bending: a longer step; at {load * 1e-6:g} N/mm surfaces overlap by "
        f"{value * load / stiffness / d:.1%} D in place of {load / stiffness / d:.1%}",
    )


def plan_filaments(scene: Scene, out: Outline, level: str, choices: list[Choice]) -> Plan:
    """Plan of a scene at level chain or rod."""
    f, d = out.filament, scene.filament.diameter
    tension = scene.ends.tension
    layer = math.sqrt(f.EI / tension) if tension > 0 else scene.bundle.length
    zone = fine_zone(scene, out.height, layer)
    far, why = choose_far_field(scene, level, zone)
    choices.append(Choice("far field", far, why))
    shape = contact_shape(scene)
    choices.append(shape)
    capsule = shape.value == "capsule"
    spacing, choice = _spacing(scene, level, far, shape.value, out)
    choices.append(choice)
    law = scene.contact.law
    if law == "auto":
        law = "line" if capsule else "hooke"
    softening = line_softening(scene, out) if law == "line" else contact_softening(scene, f, spacing, law)
    touching = math.inf
    if capsule:
        touching = plan_capsule(scene, law, spacing, f.mass_per_length, float(softening.value)).bounds()[0]
    axial = axial_softening(scene, level, spacing, f, touching)
    choices += [axial, softening, friction(scene)]
    choices.append(
        Choice(
            "contact law",
            law,
            LAWS[law].format(load=scene.contact.line_load * 1e-6),
        )
    )
    half, reason = choose_symmetry(scene, level, far, out.displacement / out.height)
    layout = lay_beads(scene, f, level, spacing, zone, far, half, capsule)
    choices.append(Choice("symmetry", "the right half" if layout.half else "none", reason))
    stations = layout.stations
    # what a bead under the platen stands for: the spacing there
    lo, hi = platen_span(scene)
    under = (stations > lo - 1e-6) & (stations < hi + 1e-6)
    bead = float(np.max(np.diff(stations[under]))) if under.sum() > 1 else spacing
    mass = bead * f.mass_per_length
    if capsule:
        contact = plan_capsule(scene, law, bead, f.mass_per_length, float(softening.value), squeeze_load(scene, out))
    else:
        contact = plan_contact(scene, law, bead, mass, float(softening.value))
    beads, limit = finish_beads(scene, f, level, layout, float(axial.value), contact)
    timestep, step = checked_step(scene, limit)
    choices.append(step)
    width = 0.0 if scene.platens.width == "full" else float(scene.platens.width)
    stiffness = 1 / float(rod.platen_compliance(scene.bundle.length, f.EI, width=width, tension=tension))
    span = scene.bundle.length if far == "none" else zone[1] - zone[0]
    frequency = float(rod.bending_frequency(span, f.EI, f.mass_per_length, tension=tension))
    if far != "none":  # the zone swings on the soft far field
        frequency = min(frequency, math.sqrt(stiffness / (f.mass_per_length * span)))
    # of the platen's hit: a diameter's length, however long the segments are
    hit = d if capsule else 1.0
    hit_kn, hit_mass = contact.tangent_kn * hit, f.mass_per_length * d if capsule else mass
    if nothing_varies(scene):  # no end supports to bend against
        stiffness, frequency = loose(hit_kn, hit_mass, out.height / d)
    n_beads = len(out.centres) * (len(stations) // 2 + 1 if layout.half else len(stations))
    bodies = Bodies(
        depths_below_top(out.centres),
        out.pitch,
        stiffness,
        frequency,
        hit_kn,
        hit_mass,
        n_beads,
        bends=far == "none",
        gain=ROD_GAIN if level == "rod" else CAPSULE_GAIN if capsule else SPEED_GAIN,
    )
    motion, sampling, motion_choices = plan_motion(scene, bodies, timestep, out.displacement, out.earlier, hi - lo)
    choices += motion_choices
    omissions = common_omissions(scene, level, shape.value)
    if far == "condensed":
        omissions.append(Omission("filaments beyond the fine zone", why, "within 2 % of graded beads (measured)"))
    beside = lo if far == "none" else math.inf
    if 0 < STEEP * beside < out.displacement:
        omissions.append(
            Omission(
                "long supports",
                f"the platen moves by {out.displacement / beside:.2g} of the {beside:.3g} um that bend beside it: "
                "filaments lean there and draw their sliding ends in",
                "that length shrinks as sqrt(1 - (d/a)^2), to nothing at d = a, where the run stops (11 719 filaments: "
                "at 97 of 100 um); a narrower platen or longer filaments",
            )
        )
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
        platens=platens(scene, contact, hi - lo, edges=True),
        motion=motion,
        sampling=sampling,
        predicted_seconds=predicted_seconds(f"{level}, capsules" if capsule else level, n_beads, motion, sampling),
        choices=tuple(choices),
        omissions=tuple(omissions),
        promise=promise(scene, out, level, bead, float(softening.value), motion, capsule),
        free_span=min(lo, 2 * layer) if lo > 0 else math.inf,
    )
