"""Planner of the level subbundle: discs that each stand for many filaments, by a homogenised law of contact.

Discs of a size that keeps the fibre area, placed as the filaments are at a pitch that keeps the outline, on as many
springs: an assembly of equal discs has the same stresses against the same strains whatever the size of the discs, so
what is lost is what happens within a disc's width.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cgfibre.build.packing import ROW, ArrangementSpec, arrange, min_distance
from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.errors import InputError
from cgfibre.mechanics import rod, support
from cgfibre.mechanics.contact import damping_coefficient
from cgfibre.plan.common import checked_step, common_omissions, friction, platens
from cgfibre.plan.contact import BEAD_DAMPING, TANGENTIAL_RATIO, ContactPlan, damping_ratio, line_contacts
from cgfibre.plan.cost import predicted_seconds
from cgfibre.plan.filaments import DRAG
from cgfibre.plan.level import nothing_varies
from cgfibre.plan.model import Choice, Contact, Discs, Omission, Plan
from cgfibre.plan.motion import Bodies, depths_below_top, loose, plan_motion
from cgfibre.plan.outline import Outline, arrangement_spec
from cgfibre.plan.promise import promise
from cgfibre.plan.section import DISC_INERTIA, disc_beads, filament_springs
from cgfibre.scene import Scene
from cgfibre.scene_assembly import Subbundle
from cgfibre.subbundle_law import SubbundleLaw, Table, find_law

#: layers of discs below which a section flattens within their width: then a disc, which stays round, is no model of it
LEAST_LAYERS = 4.0
#: the count of discs may differ by this from that of filaments over the filaments of one
NEARBY = 0.08
#: kinds of discs that the spread of stiffness makes
GROUPS = 5
#: friction of the scene and of the law's runs may differ by this
FRICTION_TOLERANCE = 0.05
ARRANGEMENTS = ("circular", "hexagonal", "rectangular", "elliptic", "racetrack")


def asked_subbundle(scene: Scene) -> Subbundle:
    """The scene's table, or the defaults."""
    return scene.bundle.subbundle or Subbundle()


def disc_count(scene: Scene) -> int:
    """Number of discs: the count over the filaments of one; of the circular arrangement the nearest full rings."""
    wanted = scene.bundle.count / asked_subbundle(scene).filaments
    if scene.bundle.arrangement != "circular":
        return max(1, round(wanted))
    rings = (math.sqrt(12 * max(wanted, 1.0) - 3) - 3) / 6
    near = [1 + 3 * n * (n + 1) for n in (math.floor(rings), math.ceil(rings))]
    return min(near, key=lambda count: abs(math.log(count / wanted)))


def discs_spec(scene: Scene, pitch: float, count: int) -> ArrangementSpec:
    """The arrangement of the discs: the scene's, of fewer that are as much further apart, so that the area stays."""
    spec = arrangement_spec(scene)
    if spec.name not in ARRANGEMENTS:
        expected = "one of " + ", ".join(ARRANGEMENTS) + " with model.level = 'subbundle': others place each filament"
        raise InputError("assembly.arrangement", spec.name, expected)
    return replace(spec, count=count, pitch=pitch * math.sqrt(spec.count / count), volume_fraction=None)


def disc_centres(scene: Scene, out: Outline) -> tuple[FloatArray, float]:
    """((n, 2) centres um, pitch um) of the discs: arranged as the filaments are, then stretched along y and z until
    they fill the same outline, which lies half a layer or half a pitch beyond the centres: whole layers and columns of
    discs do not. Full rings fill it as they are; of other arrangements the count within NEARBY of the wanted one is
    taken that needs the least stretch (a lone disc on a layer of its own makes it large). No disc stands out of the
    filaments' height.

    Raises InputError where the discs would overlap for it.
    """
    wanted = disc_count(scene)
    circular = scene.bundle.arrangement == "circular"
    counts = range(math.ceil((1 - NEARBY) * wanted), math.floor((1 + NEARBY) * wanted) + 1)
    tried = [_stretched(scene, out, n) for n in ([wanted] if circular else counts)]
    centres, stretch, pitch = min(tried, key=lambda t: float(np.sum(np.abs(np.log(t[1])))))
    n = len(centres)
    size = _disc_size(scene, out, n)
    top = float(np.max(np.abs(centres[:, 1])))
    highest = max(out.height - size, 0.0) / 2
    if top > highest:
        centres = centres * np.array([1.0, highest / top])
    if n > 1 and min_distance(centres) < size * (1 - 1e-9):
        across, down = (100 * (stretch - 1)).tolist()
        raise InputError(
            "assembly.subbundle.filaments",
            asked_subbundle(scene).filaments,
            f"another number: {n} discs have to be moved by {across:+.0f} % across and {down:+.0f} % down to fill the "
            "filaments' outline, and then overlap",
        )
    return centres + (out.centres.max(axis=0) + out.centres.min(axis=0)) / 2, pitch


def _disc_size(scene: Scene, out: Outline, count: int) -> float:
    """Diameter of one of ``count`` discs, um."""
    asked = asked_subbundle(scene)
    size = find_law(asked.law).table(asked.mapping).size
    return size * math.sqrt(len(out.centres) / count) * scene.filament.diameter


def _stretched(scene: Scene, out: Outline, count: int) -> tuple[FloatArray, FloatArray, float]:
    """Centres of ``count`` discs stretched to the filaments' outline, about the origin, the stretch and their pitch."""
    spec = discs_spec(scene, out.pitch, count)
    pitch = float(spec.pitch or out.pitch)
    centres = arrange(spec, scene.filament.diameter, np.random.default_rng(scene.bundle.seed))
    centres = centres - (centres.max(axis=0) + centres.min(axis=0)) / 2
    stretch = np.ones(2)
    if spec.name != "circular":
        beyond = np.array([1.0, 1.0 if spec.name == "elliptic" else ROW])
        stretch = (np.ptp(out.centres, axis=0) + out.pitch * beyond) / (np.ptp(centres, axis=0) + pitch * beyond)
    return centres * stretch, stretch, pitch


def with_groups(system: FilamentSystem, scene: Scene) -> FilamentSystem:
    """The discs in GROUPS kinds of one size, as many of each, dealt out with the scene's seed."""
    kinds = np.arange(system.n_filaments) % GROUPS
    np.random.default_rng([scene.bundle.seed, GROUPS]).shuffle(kinds)
    return replace(system, types=system.types * GROUPS, filament_type=kinds)


def plan_subbundle(scene: Scene, out: Outline, level: str, choices: list[Choice]) -> Plan:
    """Plan of a scene at level subbundle."""
    asked, d = asked_subbundle(scene), scene.filament.diameter
    law = find_law(asked.law)
    table = law.table(asked.mapping)
    _check_friction(scene, law)
    centres, pitch = disc_centres(scene, out)
    n = len(centres)
    each = len(out.centres) / n
    size = table.size * math.sqrt(each) * d
    _check_layers(scene, out, each, size)
    length = scene.bundle.length
    width = length if scene.platens.width == "full" else float(scene.platens.width)
    depth = width if scene.model.depth == "auto" else float(scene.model.depth)
    softening = _softening(scene)
    choices += [
        Choice(
            "sub-bundles",
            f"{n} discs of {size:.4g} um",
            f"{each:.5g} filaments each: {len(out.centres)} filaments in the outline as arranged, the fibre area kept",
        ),
        Choice("depth", f"{depth:.4g} um", "the platen's width" if scene.model.depth == "auto" else "as asked"),
        softening,
        Choice(
            "law of contact",
            f"{law.name}, {asked.mapping}",
            f"homogenised from {law.filaments} filaments at friction {law.friction:g}; without dimension, so for any "
            "diameter and stiffness; equivalent Poisson's ratio " + f"{law.poisson_ratio:.2f}",
        ),
        Choice(
            "spread of stiffness",
            f"+-{asked.spread:.0%}",
            f"{GROUPS} kinds of sub-bundles, dealt out with the seed; two in contact are in series",
        ),
        friction(scene),
    ]
    mass = out.filament.mass_per_length * depth * each
    contact = _contact(scene, table, size, depth, mass, float(softening.value), asked.spread)
    k, turn = (each * stiffness for stiffness in filament_springs(scene, out))
    choices.append(Choice("springs", f"{k:.4g} nN/um, {turn:.4g} nN um/rad", f"{each:.5g} times those of a filament"))
    inertia = DISC_INERTIA * mass * size**2
    touching, damping = contact.bounds(DISC_INERTIA)
    limit = float(rod.limiting_time_step(touching + max(k, turn * mass / inertia), mass, damping))
    timestep, step = checked_step(scene, limit)
    choices.append(step)
    if nothing_varies(scene):
        stiffness, frequency = loose(contact.tangent_kn, mass, out.height / size)
    else:
        stiffness, frequency = k, float(support.support_frequency(k, mass))
    bodies = Bodies(depths_below_top(centres), out.pitch, stiffness, frequency, contact.tangent_kn, mass, n)
    motion, sampling, motion_choices = plan_motion(scene, bodies, timestep, out.displacement)
    choices += motion_choices
    drag = DRAG * frequency
    middle = (out.centres[:, 1].max() + out.centres[:, 1].min()) / 2
    heights = (float(middle + out.height / 2), float(middle - out.height / 2))
    stiffness_per_length = contact.pair.line_stiffness / contact.pair.softening
    return Plan(
        level=level,
        spacing=0.0,
        pitch=pitch,
        width=out.width,
        height=out.height,
        n_filaments=len(out.centres),
        n_beads=n,
        beads=disc_beads(scene, mass),
        axial_softening=1.0,
        timestep=timestep,
        timestep_limit=limit,
        drag=drag * mass,
        turning_drag=drag * inertia,
        torsion="none",
        contact=contact.pair,
        platens=platens(scene, contact, depth, edges=False),
        motion=motion,
        sampling=sampling,
        predicted_seconds=predicted_seconds(level, n, motion, sampling),
        choices=tuple(choices),
        omissions=tuple(_omissions(scene, level, each, size)),
        promise=promise(scene, out, level, 0.0, float(softening.value), motion),
        depth=depth,
        springs=(k, turn),
        discs=Discs(
            filaments=each,
            diameter=size,
            factors=tuple(np.linspace(1 - asked.spread, 1 + asked.spread, GROUPS).tolist()),
            overlap=_column(table.overlap, size),
            load=_column(table.load, stiffness_per_length * size),
            unload=None if table.unload is None else _column(table.unload, stiffness_per_length * size),
            heights=heights,
            centres=tuple((y, z) for y, z in centres.tolist()),
        ),
    )


def _softening(scene: Scene) -> Choice:
    if scene.contact.softening != "auto":
        return Choice("contact softening", f"{float(scene.contact.softening):g}", "as asked in the scene")
    return Choice("contact softening", "1", "few discs are cheap: the real stiffness")


def _column(values: FloatArray, scale: float) -> tuple[float, ...]:
    return tuple((values * scale).tolist())


def _contact(
    scene: Scene, table: Table, size: float, depth: float, mass: float, softening: float, spread: float
) -> ContactPlan:
    """Contact by the table; a platen is the plane of symmetry between two discs, so twice as stiff."""
    between, _ = line_contacts(scene)
    line = float(between.secant_stiffness(scene.contact.line_load))
    kn = line / softening * depth * table.steepest * (1 + spread)
    zeta = damping_ratio(scene, BEAD_DAMPING)
    pair = Contact(
        law="table",
        kn=kn,
        kt=TANGENTIAL_RATIO * kn,
        gamma=float(damping_coefficient(zeta, kn, mass, mass)),
        friction=scene.contact.friction,
        softening=softening,
        line_stiffness=line,
        shape="subbundle",
    )
    return ContactPlan(pair, 2 * kn, float(damping_coefficient(zeta, 2 * kn, mass)), kn, 2 * kn)


def _check_friction(scene: Scene, law: SubbundleLaw) -> None:
    if abs(scene.contact.friction - law.friction) > FRICTION_TOLERANCE:
        raise InputError(
            "contact.friction",
            scene.contact.friction,
            f"within {FRICTION_TOLERANCE:g} of {law.friction:g}, that of the sub-bundle law {law.name} (or another "
            "law: cgfibre homogenise)",
        )


def _check_layers(scene: Scene, out: Outline, each: float, size: float) -> None:
    layers = (out.height - out.displacement) / size
    if layers < LEAST_LAYERS:
        most = int(asked_subbundle(scene).filaments * (layers / LEAST_LAYERS) ** 2)
        advice = f"at most about {most}" if most >= 2 else "model.level = 'section'"
        raise InputError(
            "assembly.subbundle.filaments",
            asked_subbundle(scene).filaments,
            f"{advice}: {LEAST_LAYERS:g} layers of sub-bundles ({size:.3g} um) in the height pressed, or else the "
            f"section flattens within one, which stays round (here {layers:.2g} layers)",
        )


def _omissions(scene: Scene, level: str, each: float, size: float) -> list[Omission]:
    return [
        *common_omissions(scene, level),
        Omission(
            "everything along the filaments",
            "nothing varies along the length but the bending that the springs stand for",
            "as of level section",
        ),
        Omission(
            "filaments within a sub-bundle",
            f"{each:.4g} filaments move as one disc of {size:.3g} um: its shape stays round, and a platen engages them "
            "all at once",
            f"forces to a displacement of about {size / 2:.3g} um, and wherever gaps are as wide as a disc, are rough: "
            "see docs/subbundle.md for what was measured",
        ),
    ]
