"""Limits of contacts: filaments that pass through each other, overlap by soft contacts, friction over beads."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from cgfibre.build.bundle import BundleSpec, build_bundle, build_section
from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.cases.experiment import moved, planned
from cgfibre.cases.limits import AWAY, SECTION, Bench, Point
from cgfibre.errors import InputError
from cgfibre.mechanics import contact as contact_mechanics
from cgfibre.mechanics.contact import bump_friction
from cgfibre.plan.contact import line_contacts
from cgfibre.plan.model import Plan

# --- crossing filaments ----------------------------------------------------------------------------------------------


def crossing_force(height: FloatArray, spacing: float, diameter: float, reach: int = 6) -> FloatArray:
    """Force over kn (um) between two straight chains that cross at right angles, axes ``height`` apart, at mid-bond.

    Beads at (i + 1/2) s and (j + 1/2) s: the sum of (D - r) z/r over pairs nearer than D, r^2 = z^2 + s^2 ((i + 1/2)^2
    + (j + 1/2)^2).
    """
    place = spacing * (np.arange(-reach, reach) + 0.5)
    across = place[:, None] ** 2 + place[None, :] ** 2
    z = np.asarray(height, dtype=np.float64)[:, None, None]
    r = np.sqrt(z**2 + across)
    return np.asarray(np.sum(np.maximum(diameter - r, 0.0) * z / r, axis=(1, 2)))


def crossing_barrier(spacing: float, diameter: float) -> float:
    """Largest force over kn (um) with which two crossing chains of stiff filaments resist being pushed through.

    The four beads about the crossing, a = s/sqrt(2) from it: 4 (D^(2/3) - a^(2/3))^(3/2), 0 from a = D on (s = 1.41
    D: they pass freely); exact for s >= 0.63 D. Closer beads touch more of their like: the greatest of
    :func:`crossing_force`.
    """
    if spacing * math.sqrt(2.5) >= diameter:
        a = spacing / math.sqrt(2)
        return 4 * max(diameter ** (2 / 3) - a ** (2 / 3), 0.0) ** 1.5
    reach = math.ceil(diameter / spacing) + 1
    return float(np.max(crossing_force(np.linspace(1e-4, 1, 20001) * diameter, spacing, diameter, reach)))


def crossed(spacing: float, softening: float) -> tuple[Plan, FilamentSystem]:
    """Two chains of ten bonds that cross at right angles at mid-bond, the second a diameter above the first."""
    segments = 11
    plan, one = planned(
        {
            "model.level": "chain",
            "model.spacing": f"{spacing} um",
            "assembly.length": f"{segments * spacing} um",
            "ends.tension": "0 nN",
            "contact.softening": softening,
            "contact.friction": 0.0,
            "contact.damping_ratio": 1e-6,  # the force of springs alone
        }
    )
    d = one.types[0].diameter
    # beads farther apart than D are not in contact by plan: here the question is what happens if they were
    plan = replace(plan, beads=replace(plan.beads, role=np.where(plan.beads.role == 1, 0, plan.beads.role)))
    spec = BundleSpec(one.types[0], np.array([[0.0, 0.0], [0.0, 2 * d]]), plan.beads.stations)
    system = build_bundle(spec, np.random.default_rng(0))
    n = len(plan.beads.stations)
    positions = system.positions.copy()
    middle = segments * spacing / 2
    positions[n:] = np.column_stack([np.full(n, middle), positions[:n, 0] - middle, np.full(n, d)])
    half = middle + 2 * d
    box = np.array([[middle - half, middle + half], [-half, half], [-3 * d, 3 * d]])
    return plan, replace(system, positions=positions, box=box)


def passing_force(bench: Bench, spacing: float, softening: float) -> tuple[float, float]:
    """(largest force nN, its closed form nN): the upper chain moved evenly down through the held lower one."""
    plan, system = crossed(spacing, softening)
    d, steps = system.types[0].diameter, 4000
    plan = moved(plan, 1e-9, steps)
    out = bench.run(
        system,
        plan,
        [
            "group upper molecule 2",
            "group lower subtract all upper",
            "unfix integrate",
            f"fix push upper move linear 0 0 {-1.2 * d / steps / plan.timestep:.17g}",
            "compute push upper reduce sum fz",
            'fix force all ave/time 10 1 10 c_push file force.txt format " %.15g"',
        ],
        drag=0.0,
        **AWAY,
    )
    # held ends are in no contact: chains are long enough for them to lie far off
    exact = plan.contact.kn * crossing_barrier(spacing, d)
    return float(np.max(out.rows("force.txt")[:, 1])), exact


def passing_against_spacing(
    bench: Bench, ratios: Sequence[float] = (0.5, 0.7, 0.85, 1.0, 1.15, 1.3, 1.4, 1.5, 2.0)
) -> Iterator[Point]:
    """Force that pushes crossing filaments through each other against s/D, contacts real."""
    for ratio in ratios:
        measured, exact = passing_force(bench, ratio * 7.0, 1.0)
        yield Point("contacts real", ratio, measured * 1e-9, exact * 1e-9, bench.lap())


def passing_against_softening(
    bench: Bench, softenings: Sequence[float] = (1.0, 3.0, 10.0, 30.0, 100.0)
) -> Iterator[Point]:
    """Force that pushes crossing filaments through each other against the softening of contacts."""
    for ratio in (0.5, 1.0, 1.3):
        for softening in softenings:
            measured, exact = passing_force(bench, ratio * 7.0, softening)
            yield Point(f"s = {ratio:g} D", softening, measured * 1e-9, exact * 1e-9, bench.lap())


#: N/mm times softening at which carbon discs overlap by 0.43 D
DEEPEST = 1.0

# --- overlap ---------------------------------------------------------------------------------------------------------


def stacked(bench: Bench, softening: float, line_load: float) -> tuple[float, float, float, float]:
    """(overlap/D, its closed form F/(kn D), thickness error/D a contact, its closed form) of two discs on each other.

    Between platens, at the platen's displacement that the line load (nN/um) takes; the thickness error is the overlap
    beyond the approach of the line contact at that load.
    """
    plan, one = planned({**SECTION, "contact.softening": softening})
    d = one.types[0].diameter
    system = build_section(BundleSpec(one.types[0], np.array([[0.0, 0.0], [0.0, d]])), np.random.default_rng(0))
    load = line_load * plan.depth
    travel = load * (2 / plan.platens.kn + 1 / plan.contact.kn)
    steps = 6000
    plan = moved(plan, travel / steps / plan.timestep, steps, 6000)
    drag = math.sqrt(plan.platens.kn * plan.beads.mass[0])
    out = bench.run(system, plan, spring_nN_um=1e-9, torsion_nN_um=0.0, drag=drag)
    force = float(out.record.mean["bottom_force"][-1])
    overlap = 1 - float(out.record.state["closest"][-1]) / d
    real = float(line_contacts_between().approach(line_load)) / d
    exact = float(contact_mechanics.relative_overlap(force, plan.contact.kn, d))
    law = line_load * softening / plan.contact.line_stiffness / d
    return overlap, exact, overlap - real, law - real


def line_contacts_between() -> contact_mechanics.LineContact:
    """Line contact of two filaments of the experiments' scene."""
    from cgfibre.cases.experiment import scene

    return line_contacts(scene({}))[0]


def overlap_against_softening(
    bench: Bench,
    softenings: Sequence[float] = (1.0, 3.0, 10.0, 30.0, 100.0),
    loads: Sequence[float] = (1e4, 1e5, 1e6),
) -> Iterator[Point]:
    """Overlap over D of two discs against the softening of their contact, at line loads of 0.01 to 1 N/mm."""
    for load in loads:
        for softening in softenings:
            if load * softening > DEEPEST * 1e7:
                continue  # the centre of a disc would pass a platen: nothing would be left to measure
            overlap, exact, _, _ = stacked(bench, softening, load)
            yield Point(f"{load * 1e-6:g} N/mm", softening, overlap, exact, bench.lap())


def thickness_error_against_load(
    bench: Bench, softenings: Sequence[float] = (1.0, 10.0), loads: Sequence[float] = (1e4, 1e5, 3e5, 1e6, 3e6, 1e7)
) -> Iterator[Point]:
    """Thickness lost a contact beyond the real approach, over D, against the line load (N/mm)."""
    for softening in softenings:
        for load in loads:
            if load * softening > DEEPEST * 1e7:
                continue
            _, _, error, exact = stacked(bench, softening, load)
            yield Point(f"softening {softening:g}", load * 1e-6, error, exact, bench.lap())


# --- friction over beads ---------------------------------------------------------------------------------------------


def dragged(bench: Bench, spacing: float, friction: float) -> float:
    """Largest F/N of one chain pulled along another by half a bead spacing, out of the nest to the top of a bead.

    The lower chain is held, the upper one pushed down by a dead load a bead and moved along x, free in z.
    """
    plan, one = planned(
        {
            "model.level": "chain",
            "model.spacing": f"{spacing} um",
            "assembly.length": f"{max(10, round(70 / spacing)) * spacing} um",
            "ends.tension": "0 nN",
            "contact.friction": friction,
            "model.axial_softening": 100,
        }
    )
    # all beads move alike: stretch and bending play no part and must not shorten the step
    hinge = plan.beads.hinge * 1e-2 * (spacing / 7.0) ** 4
    plan = replace(plan, timestep=4e-4, beads=replace(plan.beads, hinge=hinge))
    d = one.types[0].diameter
    z = float(contact_mechanics.nested_distance(spacing, d))
    centres = np.array([[0.0, 0.0], [0.0, 2 * d]])
    system = build_bundle(BundleSpec(one.types[0], centres, plan.beads.stations), np.random.default_rng(0))
    n = len(plan.beads.stations)
    positions = system.positions.copy()
    # the nest: half a bead off, and a hair into it
    positions[n:, 0] += spacing / 2
    positions[n:, 2] = z
    system = replace(system, positions=positions)
    # an approach of 1.5 % of the bumps' height s^2/(8 D), slow enough for damping to be 1 % of the load
    load, steps, settle = 3e5 * (spacing / d) ** 3, 60000, 10000
    every = steps // 400
    plan = moved(plan, 1e-9, settle + steps)
    speed = 0.5 * spacing / steps / plan.timestep
    # beads with a nest of their own; the ends, in no contact, follow them
    inner = f"{n + 2}:{2 * n - 2}"
    out = bench.run(
        system,
        plan,
        [
            "group upper molecule 2",
            f"group rider id {inner}",
            "group base subtract all upper",
            "unfix integrate",
            "unfix hold_left",
            "unfix hold_right",
            f"fix push rider addforce 0 0 {-load}",
            f"variable begun equal ternary(step<{settle},0,1)",
            f"variable way equal {speed:.17g}*v_begun*(step-{settle})*dt",
            f"variable pace equal {speed:.17g}*v_begun",
            "fix pull upper move variable v_way NULL NULL v_pace NULL NULL",
            "compute grip rider reduce sum fx",
            "variable pull equal c_grip/count(rider)",
            f'fix friction all ave/time {every} 1 {every} v_pull file friction.txt format " %.15g"',
        ],
        drag=0.0,
        **AWAY,
    )
    return float(np.max(-out.rows("friction.txt")[settle // every :, 1])) / load


def ripple_against_spacing(
    bench: Bench, ratios: Sequence[float] = (0.125, 0.25, 0.5, 0.75, 1.0, 1.25), friction: float = 0.2
) -> Iterator[Point]:
    """Peak of friction over normal force of one chain along another against s/D."""
    for ratio in ratios:
        try:
            exact = float(bump_friction(friction, ratio * 7.0, 7.0))
        except InputError:
            exact = math.inf
        yield Point(f"mu = {friction:g}", ratio, dragged(bench, ratio * 7.0, friction), exact, bench.lap())
