"""FilamentSystem and plan to what a deck reads: bead types, masses, coefficients, parameters. One assembler a level."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from cgfibre.build.system import FilamentSystem, FloatArray, IntArray
from cgfibre.engine.capsule import capsule_parameters, tables
from cgfibre.engine.datafile import DataFile, Topology, group_types
from cgfibre.engine.fabric import fabric_box, fabric_parameters, rest_forces
from cgfibre.engine.mirror import right_half
from cgfibre.engine.natural import axis_and_angle, natural_shape, straight_shape
from cgfibre.engine.ribbon import joined, longest_joint, with_rungs
from cgfibre.engine.subbundle import law_files
from cgfibre.errors import InputError
from cgfibre.mechanics.elastica import SpringLaw
from cgfibre.plan.contact import STIFFEN_FROM, STIFFEN_TO, TANGENTIAL_DAMPING
from cgfibre.plan.model import CONTACT, GRIP, GRIP_STIFFENING, LEFT, RIGHT, ROD_DAMPING, Contact, Plan, every_bead
from cgfibre.plan.section_platens import first_touch

ROLES = 5
NEAR = 0.5  # of D: beads this near to a platen are given to its wall for a block of steps
GHOST_SPACINGS = 2.5  # bead spacings that ghost beads must reach at least: rods of two ranks are wrong below 2
CAPSULE_GHOST_SPACINGS = 3.3  # the same where segments touch
EDGE = 1e-3  # um: a bead that stands on a platen's edge counts as under it
#: smallest rest bend at which angle harmonic is safe: below 1 mrad it is silently wrong (lammps-findings)
HARMONIC_BEND = 0.01
#: a rod's angles carry this part of EI/s: they measure bending energy, see in.rod
ANGLE_GAUGE = 1e-6
#: kinds of rods that in.rod knows
ROD_KINDS = 2


@dataclass(frozen=True)
class Deck:
    """A deck's name, its parameters and its data file; ``tables`` are further files by name (one number a line),
    ``texts`` those of any form."""

    name: str
    parameters: dict[str, float | int | str]
    data: DataFile
    tables: dict[str, FloatArray]
    texts: Mapping[str, str] = field(default_factory=dict)


def pair_words(contact: Contact) -> str:
    """Coefficients of ``pair_style granular`` for one pair of types."""
    tangential = "linear_history" if contact.law == "hooke" else "mindlin"
    return (
        f"{contact.law} {contact.kn:.17g} {contact.gamma:.17g} tangential {tangential} {contact.kt:.17g} "
        f"{TANGENTIAL_DAMPING:g} {contact.friction:.17g} damping velocity"
    )


def beads_under(system: FilamentSystem, plan: Plan, span: tuple[float, float] | None) -> npt.NDArray[np.bool_]:
    """(n_beads,) bool: beads that a platen of this span presses, as built (None: a platen without edges)."""
    if plan.flat:
        return np.ones(system.n_beads, dtype=bool)
    touching = every_bead(system, plan.beads.role) == CONTACT
    if span is None:
        return touching
    x = system.positions[:, 0]
    return touching & (x > span[0] - EDGE) & (x < span[1] + EDGE)


def platen_heights(system: FilamentSystem, plan: Plan) -> tuple[float, float]:
    """(top, bottom) z of the flat platens at first touch, um: where they meet the assembly as built, sub-bundles
    where they meet the filaments that these stand for.

    Platens that are curved across a section: z of their surfaces at the middle.
    """
    if plan.discs is not None:
        return plan.discs.heights
    radius = system.diameter[system.filament_of_bead] / 2
    if plan.level == "section" and plan.platens.shape == "crimped":
        centres, p = system.positions[:, 1:], plan.platens
        return first_touch(p, centres, radius, True, 1.0), first_touch(p, centres, radius, p.bottom_crimped, -1.0)
    z = system.positions[:, 2]

    def reach(span: tuple[float, float] | None, sign: float) -> float:
        under = beads_under(system, plan, span)
        return float(sign * np.max(sign * z[under] + radius[under]))

    return reach(plan.platens.top_span, 1.0), reach(plan.platens.bottom_span, -1.0)


def _pair_rows(n_types: int, contact: Contact) -> list[tuple[int, int, str]]:
    words = pair_words(contact)
    return [(i, j, words) for i in range(n_types) for j in range(i, n_types)]


def _kind_of_bead(system: FilamentSystem) -> IntArray:
    """(n_beads,) index of the kind of each bead's filament."""
    return system.filament_type[system.filament_of_bead]


def _bead_types(system: FilamentSystem, role: IntArray) -> IntArray:
    return role * len(system.types) + _kind_of_bead(system) + 1


def _density(mass: FloatArray, diameter: FloatArray) -> FloatArray:
    return mass / (math.pi / 6 * diameter**3)


MAX_BINS = 3e5
NEVER = 1e300  # a stop that does not come


def _bin_size(system: FilamentSystem) -> float:
    """Size of neighbour bins that keeps their number down in the box of a long far field, um; 0: the engine's own."""
    size = system.box[:, 1] - system.box[:, 0]
    own = 0.5 * float(np.max(system.diameter))
    needed = float(np.prod(size) / MAX_BINS) ** (1 / 3)
    return needed if needed > own else 0.0


def _span_words(span: tuple[float, float] | None, edge: float) -> tuple[float | str, float | str]:
    return ("INF", "INF") if span is None else (span[0] - edge, span[1] + edge)


def _common(system: FilamentSystem, plan: Plan) -> dict[str, float | int | str]:
    top, bottom = platen_heights(system, plan)
    p, m, s = plan.platens, plan.motion, plan.sampling
    edge = 0.0 if plan.contact.per_length else EDGE
    top_lo, top_hi = _span_words(p.top_span, edge)
    bottom_lo, bottom_hi = _span_words(p.bottom_span, edge)
    values: dict[str, float | int | str] = {
        "timestep_us": plan.timestep,
        "timestep_limit_us": plan.timestep_limit,
        "filament_types": len(system.types),
        "largest_diameter_um": float(np.max(system.diameter)),
        "drag": plan.drag,
        "platen_shape": _platen_file(plan),
        "platen_top_um": top,
        "platen_bottom_um": bottom,
        "top_x_lo_um": top_lo,
        "top_x_hi_um": top_hi,
        "bottom_x_lo_um": bottom_lo,
        "bottom_x_hi_um": bottom_hi,
        "platen_friction": p.friction,
        "platen_kn": p.kn,
        "platen_kt": p.kt,
        "platen_gamma": p.gamma,
        "tangential_damping": TANGENTIAL_DAMPING,
        "contact_length_um": p.contact_length,
        "speed_first": m.first,
        "speed_last": m.last,
        "speed_growth_um": m.growth,
        "load_steps": m.load_steps,
        "hold_steps": m.hold_steps,
        "unload": int(m.unload),
        "sample_steps": s.sample,
        "sample_every": s.every,
        "frame_steps": s.frame,
        "checkpoint_steps": s.checkpoint,
        "block_steps": s.block,
        "near_um": NEAR * float(np.max(system.diameter)),
    }
    if m.cycles:
        values |= {"cycles": len(m.cycles), "stop_displacement_um": m.planned_displacement}
        for name in ("displacement_um", "force_nN", "pressure_kPa"):
            each = (getattr(target, name.rpartition("_")[0]) for target in m.cycles)
            values[f"cycle_{name}"] = "[" + ",".join(repr(min(x, NEVER)) for x in each) + "]"
    if math.isfinite(m.stop_force):
        values["stop_force_nN"] = m.stop_force
    if math.isfinite(m.stop_pressure):
        values["stop_pressure_kPa"] = m.stop_pressure
    if p.shape == "crimped":
        values |= _crimp(plan, top, bottom)
    if plan.contact.per_length:
        values |= capsule_parameters(plan)
    return values


def _platen_file(plan: Plan) -> str:
    """Which platens_*.inc the deck includes."""
    if plan.level == "subbundle":
        return plan.level
    if plan.level == "section":
        return "section_crimped" if plan.platens.shape == "crimped" else "section"
    return f"capsule_{plan.platens.shape}" if plan.contact.per_length else plan.platens.shape


def crimp_cylinders(plan: Plan, top: float, bottom: float) -> tuple[float, float]:
    """z of the axes of the crimped platens' cylinders, um: convex ones touch the flat heights at mid-span, concave ones
    at the platen's edges; those across a section have the heights at their middle."""
    p = plan.platens
    if plan.level == "section":
        offset = p.crimp_radius if p.convex else -p.crimp_radius
        return top + offset, bottom - offset
    span = p.top_span or (0.0, 2 * p.crimp_centre)
    half = (span[1] - span[0]) / 2
    offset = p.crimp_radius if p.convex else -math.sqrt(p.crimp_radius**2 - half**2)
    return top + offset, bottom - offset


def _crimp(plan: Plan, top: float, bottom: float) -> dict[str, float | int | str]:
    p = plan.platens
    top_z, bottom_z = crimp_cylinders(plan, top, bottom)
    side = "out" if p.convex else "in"
    return {
        "crimp_radius_um": p.crimp_radius,
        "crimp_centre_y_um" if plan.level == "section" else "crimp_centre_x_um": p.crimp_centre,
        "top_cylinder_z_um": top_z,
        "top_cylinder_side": side,
        "bottom_cylinder_z_um": bottom_z,
        "bottom_cylinder_side": side,
        "bottom_crimped": int(p.bottom_crimped),
    }


def _along(system: FilamentSystem, plan: Plan) -> tuple[IntArray, FloatArray]:
    """Role and mass of every bead."""
    return every_bead(system, plan.beads.role), every_bead(system, plan.beads.mass)


def _strain(system: FilamentSystem, plan: Plan) -> FloatArray:
    """(n_bonds,) axial strain of the softened filament as built: twist and end load, at their real tension."""
    t = system.types
    bonds = system.bonds()
    filament = system.filament_of_bead[bonds[:, 0]]
    EA = np.array([k.EA for k in t])[system.filament_type[filament]]
    if plan.beads.closed:  # no ends to pull: the tension is built in
        return plan.axial_softening * (system.prestrain[filament] + plan.beads.tension / EA)
    role = every_bead(system, plan.beads.role)
    right = role == RIGHT
    # every held bead is loaded: a bond between two of them carries the outer one's share
    loaded = np.where(right[bonds[:, 0]] & right[bonds[:, 1]], 1, max(1, int(np.sum(plan.beads.role == RIGHT))))
    tension = EA * system.prestrain[filament] + plan.beads.end_load * loaded
    if plan.beads.support == "symmetric":
        tension[role[bonds[:, 0]] == LEFT] = 0.0  # to the held bead: it gives a direction, no force
    return plan.axial_softening * tension / EA


def rest_bends(system: FilamentSystem) -> FloatArray:
    """(n_angles,) turn angle between neighbouring bonds as built, rad."""
    a, vectors = system.angles(), system.bond_vectors()
    bonds = system.bonds()
    out = np.full(system.n_beads, -1)
    out[bonds[:, 0]] = np.arange(len(bonds))
    u, v = vectors[out[a[:, 0]]], vectors[out[a[:, 1]]]
    cross = np.linalg.norm(np.cross(u, v), axis=1)
    return np.arctan2(cross, np.sum(u * v, axis=1))


def _molecules(system: FilamentSystem, plan: Plan) -> IntArray:
    """(n_beads,) molecule of every bead: what never touches itself, a filament or all chains of a tow."""
    whole = plan.woven is not None and plan.woven.resolve == "tow"
    return (system.tow if whole else np.arange(system.n_filaments))[system.filament_of_bead] + 1


def _chain(whole: FilamentSystem, plan: Plan) -> Deck:
    system, plan = right_half(whole, plan)
    role, mass = _along(system, plan)
    types = system.types
    bonds, angles = system.bonds(), system.angles()
    kind_of_bond = system.filament_type[system.filament_of_bead[bonds[:, 0]]]
    EA = np.array([t.EA for t in types])[kind_of_bond] / plan.axial_softening
    rest = system.bond_lengths() / (1 + _strain(system, plan))
    rungs, joints, joint_parameters = joined(system, plan)
    stiffness = every_bead(system, plan.beads.hinge)[angles[:, 1]]
    style = "cosine"
    rows: list[tuple[float, ...]]
    bend = rest_bends(system)
    if plan.torsion == "dihedral":
        # twist about the shape as built makes sense only if bending knows that shape too
        _check_curved(bend)
        style = "harmonic"
        angle_kind, first = group_types(stiffness, bend)
        rows = [(float(stiffness[i] / 2), 180 - math.degrees(bend[i])) for i in first]
    else:
        angle_kind, first = group_types(stiffness)
        rows = [(float(stiffness[i]),) for i in first]
    limit = plan.timestep_limit
    topologies = [with_rungs(bonds, EA / (2 * rest), rest, rungs), Topology("Angle", angles, angle_kind, rows, style)]
    topologies += joints
    if plan.torsion == "dihedral":
        limit = _dihedral_step(system, plan, bend, mass)
        topologies.append(_dihedrals(system))
    diameter = system.diameter[system.filament_of_bead]
    n_types = ROLES * len(types)
    p = system.positions
    data = DataFile(
        title="cgfibre, level chain, units micro",
        atom_style="hybrid",
        atom_columns=[
            _bead_types(system, role),
            p[:, 0],
            p[:, 1],
            p[:, 2],
            diameter,
            _density(mass, diameter),
            _molecules(system, plan),
        ],
        atom_format=["%d", "%.17g", "%.17g", "%.17g", "%.17g", "%.17g", "%d"],
        n_types=n_types,
        box=fabric_box(system, plan),
        pair_style="granular",
        pair_rows=[] if plan.contact.per_length else _pair_rows(n_types, plan.contact),
        topologies=topologies,
        rest=rest_forces(system, plan),
    )
    parameters = _common(system, plan) | {
        "ghost_cutoff_um": _ghost_cutoff(system, plan),
        "ghost_least_um": GHOST_SPACINGS * plan.spacing,
        "bin_um": _bin_size(system),
        # long bonds, of a far field or to held beads, must not cross from rank to rank
        "ranks_along_x": "*" if plan.beads.far_field == "none" and plan.beads.support != "symmetric" else "1",
        "timestep_limit_us": limit,
        "angle_style": style,
        "torsion": plan.torsion,
        "support": plan.beads.support,
        "end_load_nN": plan.beads.end_load,
        "boundary_x": "p" if plan.beads.closed else "m",
    }
    parameters |= fabric_parameters(system, plan, data.box) | joint_parameters
    if plan.beads.support == "symmetric":
        parameters |= {"mirror": 2, "plane_x_um": float(plan.beads.stations[1])}
    if plan.beads.support == "condensed":
        parameters["far_transverse_nN_um"], parameters["far_axial_nN_um"] = plan.beads.far_spring
    return Deck("in.chain", parameters, data, {}, tables(plan.contact))


def _ghost_cutoff(system: FilamentSystem, plan: Plan) -> float:
    """Reach of ghost beads, um. With a far field ranks share the filaments out across y and z, never along x, so its
    long bonds need no reach. Segments that touch want to know the ones behind and before them too, ribbons the beads
    that they join."""
    spacings = CAPSULE_GHOST_SPACINGS if plan.contact.per_length else GHOST_SPACINGS
    of_joints = 1.1 * longest_joint(system, plan) + (plan.woven.skin if plan.woven else 0.0)
    return max(spacings * plan.spacing + float(np.max(system.diameter)), of_joints) + 2.0


def _check_curved(bend: FloatArray) -> None:
    """Refuse dihedrals and angle harmonic where they are silently wrong: on (nearly) straight chains."""
    least = float(np.min(bend)) if len(bend) else 0.0
    if least < HARMONIC_BEND:
        raise InputError(
            "model.torsion",
            "dihedral",
            f"filaments bent by at least {HARMONIC_BEND} rad at every bead (here {least:.2g}): on a straight chain a "
            'dihedral is singular and follows the centre line, not the material\'s twist; use level = "rod"',
        )


def _dihedral_step(system: FilamentSystem, plan: Plan, bend: FloatArray, mass: FloatArray) -> float:
    """Limit of the time step with dihedrals, us: omega^2 = 64 GJ/(s^3 theta^2 m) for a bend theta a bead; refuses a
    plan's step above it.

    A dihedral's angle is (b.(r1 - 3 r2 + 3 r3 - r4))/(s theta), b the binormal: 2^6 for beads that move by turns.
    """
    quads = system.dihedrals()
    at = np.zeros(system.n_beads)
    at[system.angles()[:, 1]] = bend
    GJ = np.array([t.GJ for t in system.types])[system.filament_type[system.filament_of_bead[quads[:, 0]]]]
    s = np.linalg.norm(system.positions[quads[:, 2]] - system.positions[quads[:, 1]], axis=1)
    theta, m = np.min(at[quads[:, 1:3]], axis=1), np.min(mass[quads[:, 1:3]], axis=1)
    limit = 2 / math.sqrt(float(np.max(64 * GJ / (s**3 * theta**2 * m))) + (2 / plan.timestep_limit) ** 2)
    if plan.timestep > 0.99 * limit:
        raise InputError(
            "model.timestep",
            f"{plan.timestep:.4g} us",
            f"at most {0.65 * limit:.3g} us: dihedrals on filaments bent by "
            f"{float(np.min(theta)):.2g} rad a bead are stiffer than bending",
        )
    return limit


def _dihedrals(system: FilamentSystem) -> Topology:
    """Twist stiffness GJ/s of curved filaments: quadratic dihedrals about the shape as built."""
    quads = system.dihedrals()
    p = system.positions
    b1, b2, b3 = (p[quads[:, k + 1]] - p[quads[:, k]] for k in range(3))
    n1, n2 = np.cross(b1, b2), np.cross(b2, b3)
    length = np.linalg.norm(b2, axis=1)
    phi = np.degrees(np.arctan2(np.sum(np.cross(n1, n2) * b2, axis=1) / length, np.sum(n1 * n2, axis=1)))
    GJ = np.array([t.GJ for t in system.types])[system.filament_type[system.filament_of_bead[quads[:, 0]]]]
    kind, first = group_types(GJ / (2 * length), phi)
    return Topology(
        "Dihedral", quads, kind, [(float(GJ[i] / (2 * length[i])), float(phi[i])) for i in first], "quadratic"
    )


def _rod(system: FilamentSystem, plan: Plan) -> Deck:
    if len(system.types) > (ROD_KINDS if plan.woven is not None else 1):
        raise InputError("filament", f"{len(system.types)} kinds", "one kind of filament at level rod")
    if plan.beads.closed and (plan.beads.tension or np.any(system.prestrain)):
        raise InputError(
            "ends.tension",
            f"{plan.beads.tension:g} nN",
            "0 N (and no twist cut to length) with symmetry ends at level rod: a periodic rod cannot be laid out in "
            'its natural length; or level = "chain"',
        )
    role, mass = _along(system, plan)
    bonds, angles = system.bonds(), system.angles()
    strain = _strain(system, plan)
    woven_in = plan.woven is not None and not plan.woven.at_rest
    shape = straight_shape(system) if woven_in else natural_shape(system, strain)
    _check_upright(shape.segments[bonds[:, 0]])
    natural, segments = shape.positions, shape.segments
    positions, molecule, kind = system.positions, _molecules(system, plan), _kind_of_bead(system)
    n = system.n_beads
    bond_kind: FloatArray = kind[bonds[:, 0]].astype(np.float64) + 1
    rest = system.bond_lengths() / (1 + strain)
    lighter = np.minimum(mass[bonds[:, 0]], mass[bonds[:, 1]])
    if plan.beads.support == "simple" and int(np.sum(plan.beads.role == LEFT)) == 1:
        # a grip beyond each pinned end holds its turn about the filament by a bond with twist stiffness alone
        first, last = system.first_beads, system.last_beads
        firsts, lasts = (
            natural[first] - (natural[first + 1] - natural[first]),
            natural[last] + (natural[last] - natural[last - 1]),
        )
        natural = np.concatenate([natural, firsts, lasts])
        positions = np.concatenate([positions, firsts, positions[last] + (lasts - natural[last])])
        grips = np.arange(n, n + 2 * system.n_filaments)
        bonds = np.concatenate([bonds, np.column_stack([grips, np.concatenate([first, last])])])
        bond_kind = np.concatenate([bond_kind, np.zeros(len(grips))])
        grip_length = np.linalg.norm(natural[grips] - natural[np.concatenate([first, last])], axis=1)
        # the deck's twist stiffness is GJ over the length in the table: a short one makes a stiff grip
        rest = np.concatenate([rest, grip_length / GRIP_STIFFENING])
        lighter = np.concatenate([lighter, np.minimum(mass[first], mass[first]), mass[last]])
        role = np.concatenate([role, np.full(len(grips), GRIP)])
        mass = np.concatenate([mass, np.full(len(grips), mass[first[0]])])
        molecule = np.concatenate([molecule, np.tile(np.arange(1, system.n_filaments + 1), 2)])
        kind = np.concatenate([kind, np.zeros(len(grips), dtype=np.int64)])
        segments = np.concatenate([segments, np.zeros((len(grips), 3))])
    kinds, first_row = group_types(bond_kind, rest, lighter)
    gauge = every_bead(system, plan.beads.hinge)[angles[:, 1]] * ANGLE_GAUGE
    angle_kind, first_angle = group_types(gauge)
    diameter = np.array([t.diameter for t in system.types])[kind]
    n_types = ROLES * len(system.types)
    box = shape.box
    if plan.woven is not None and plan.woven.periodic and not woven_in:
        box = fabric_box(system, plan)
    if not plan.beads.closed:
        # grips stand a segment beyond the ends, which is far where the beads are coarse
        reach = np.concatenate([natural[:, 0], positions[:, 0]])
        room = float(np.max(diameter))
        box[0] = min(box[0, 0], reach.min() - room), max(box[0, 1], reach.max() + room)
    if plan.woven is None:  # as wide and as high to both sides
        box[1:] = np.max(np.abs(box[1:]), axis=1)[:, None] * np.array([-1.0, 1.0])
    capsules = plan.contact.per_length
    data = DataFile(
        title="cgfibre, level rod, units micro",
        atom_style="hybrid",
        # hybrid bpm/sphere angle: id type x y z molecule diameter density
        atom_columns=[
            role * len(system.types) + kind + 1,
            natural[:, 0],
            natural[:, 1],
            natural[:, 2],
            molecule,
            diameter,
            _density(mass, diameter),
        ],
        atom_format=["%d", "%.17g", "%.17g", "%.17g", "%d", "%.17g", "%.17g"],
        n_types=n_types,
        box=box,
        pair_style="granular",
        pair_rows=[] if capsules else _pair_rows(n_types, plan.contact),
        topologies=[
            Topology("Bond", bonds, kinds, [()] * len(first_row), ""),
            Topology("Angle", angles, angle_kind, [(float(gauge[i]),) for i in first_angle], "cosine"),
        ],
        start=positions - natural,
        natural=segments if capsules else None,
        turn=None if shape.turn is None else axis_and_angle(shape.turn),
    )
    ends = "clamped" if int(np.sum(plan.beads.role == LEFT)) == 2 else "pinned"
    parameters = _common(system, plan) | {
        "ghost_cutoff_um": _ghost_cutoff(system, plan),
        "ghost_least_um": GHOST_SPACINGS * plan.spacing,
        "bin_um": _bin_size(system),
        "ranks_along_x": "*" if plan.beads.far_field == "none" else "1",
        "turning_drag": plan.turning_drag,
        "bond_types": len(first_row),
        "angle_types": len(first_angle),
        "atom_types": n_types,
        "rod_damping": ROD_DAMPING,
        "rod_ends": "patch" if plan.beads.support == "patch" else ends,
        "angle_gauge": ANGLE_GAUGE,
        "support": plan.beads.support,
        "end_load_nN": plan.beads.end_load,
        "boundary_x": "p" if plan.beads.closed else "m",
    }
    for k, t in enumerate(system.types):
        suffix = "" if k == 0 else f"_{k + 1}"
        parameters |= {
            f"rod_diameter{suffix}": t.diameter,
            f"rod_EA{suffix}": t.EA / plan.axial_softening,
            f"rod_EI{suffix}": t.EI,
            f"rod_GJ{suffix}": t.GJ,
            f"rod_kGA{suffix}": t.kGA,
        }
    for axis, (low, high) in zip("xyz", box.tolist(), strict=True):
        parameters |= {f"box_{axis}_lo": low, f"box_{axis}_hi": high}
    parameters |= fabric_parameters(system, plan, box)
    if woven_in:
        parameters["woven_in"] = 1
    columns = {
        "bond_kinds.txt": bond_kind[first_row],
        "bond_lengths.txt": rest[first_row],
        "bond_masses.txt": lighter[first_row],
    }
    return Deck("in.rod", parameters, data, columns, tables(plan.contact))


def _check_upright(vectors: FloatArray) -> None:
    """Refuse bonds exactly along +z: bpm bonds have neither torsion nor bending there (tilted by 1e-10 they have)."""
    upright = np.hypot(vectors[:, 0], vectors[:, 1]) < 1e-12 * vectors[:, 2]
    if np.any(upright):
        raise InputError(
            "model.level",
            "rod",
            f"no segment exactly along +z (here {int(np.sum(upright))}): the engine's rods lose their torsion there; "
            "lay the filaments along x, number their beads downwards or tilt them by 1e-9",
        )


def section_deck(system: FilamentSystem, plan: Plan, name: str, pair_rows: list[tuple[int, int, str]]) -> Deck:
    """Deck ``name`` of discs on springs, one type a kind of filament for every role; ``pair_rows`` of its data file."""
    diameter = system.diameter
    n = system.n_filaments
    mass = np.full(n, plan.beads.mass[0])
    box = system.box
    zero = np.zeros(n)
    n_types = ROLES * len(system.types)
    data = DataFile(
        title=f"cgfibre, level {plan.level}, units micro",
        atom_style="hybrid",
        # hybrid sphere dipole bond: id type x y z diameter density q mux muy muz molecule;
        # LAMMPS' x, y are the scene's y, z
        atom_columns=[
            system.filament_type + 1,
            system.positions[:, 1],
            system.positions[:, 2],
            zero,
            diameter,
            _density(mass, diameter),
            zero,
            np.ones(n),
            zero,
            zero,
            np.arange(1, n + 1),
        ],
        atom_format=["%d", *["%.17g"] * 5, "%g", "%g", "%g", "%g", "%d"],
        n_types=n_types,
        box=np.array([box[1], box[2], [-float(np.max(diameter)), float(np.max(diameter))]]),
        pair_style="granular",
        pair_rows=pair_rows,
    )
    parameters = _common(system, plan) | {
        "spring_nN_um": plan.springs[0],
        "torsion_nN_um": plan.springs[1],
        "turning_drag": plan.turning_drag,
    }
    return Deck(name, parameters, data, {})


def _spring_table(law: SpringLaw) -> str:
    """The law as fix disc/support reads it."""
    rows = zip(law.deflection, law.force, strict=True)
    lines = [f"{i} {d:.17g} {f:.17g}\n" for i, (d, f) in enumerate(rows, 1)]
    return (
        "# deflection (um), force (nN) of a filament on its supports\nSPRING\n" + f"N {len(lines)}\n" + "".join(lines)
    )


def _section(system: FilamentSystem, plan: Plan) -> Deck:
    deck = section_deck(system, plan, "in.section", _pair_rows(ROLES * len(system.types), plan.contact))
    parameters = deck.parameters | {
        "contact_shape": "discs",
        "discs": plan.disc_fixes,
        "pair_kn": plan.contact.kn,
        "centre_um": float(np.mean(system.positions[:, 2])),
    }
    texts = {}
    if plan.spring_law is not None:
        parameters["spring_law"] = "table"
        texts["springs.txt"] = _spring_table(plan.spring_law)
    if plan.stiffen > 1:
        d = float(np.max(system.diameter))
        parameters |= {
            "paced": 1,
            "stop_displacement_um": plan.motion.planned_displacement,
            "stiffen_most": plan.stiffen,
            "stiffen_from_um": STIFFEN_FROM * d,
            "stiffen_to_um": STIFFEN_TO * d,
        }
    return replace(deck, parameters=parameters, texts=texts)


def _subbundle(system: FilamentSystem, plan: Plan) -> Deck:
    if plan.discs is None:
        raise ValueError("a plan of level subbundle says what its discs are")
    parameters, tables, texts = law_files(plan.discs, plan)
    deck = section_deck(system, plan, "in.subbundle", [])
    return replace(deck, parameters={**deck.parameters, **parameters}, tables=tables, texts=texts)


ASSEMBLERS: dict[str, Callable[[FilamentSystem, Plan], Deck]] = {
    "chain": _chain,
    "rod": _rod,
    "section": _section,
    "subbundle": _subbundle,
}


def assemble(system: FilamentSystem, plan: Plan) -> Deck:
    """Everything the deck of the plan's level reads."""
    return ASSEMBLERS[plan.level](system, plan)
