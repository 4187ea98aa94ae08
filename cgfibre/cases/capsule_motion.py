"""Capsules in motion: pushed through each other, over bent filaments, energy of frictionless contact."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from cgfibre.build.system import FloatArray
from cgfibre.cases.capsule import HELD, UPPER, crossing_force, line_law, posed, sampled_force, segments_for, straight
from cgfibre.cases.experiment import Measured, moved, planned, run
from cgfibre.cases.rods import AWAY, D
from cgfibre.cases.touching import crossing_barrier

#: no friction, and as little damping as the scene allows
ELASTIC = {"contact.friction": 0.0, "contact.damping_ratio": 1e-9}


def bead_barrier() -> float:
    """Force that pushes crossing chains of beads through each other at s = D, real stiffness, nN."""
    return float(line_law().secant_stiffness(1e6)) * D * crossing_barrier(D, D)


def pushed_across(folder: Path, level: str, spacing: float, times: float = 2.0) -> list[Measured]:
    """A filament that crosses another at mid-segment, pushed down on it by ``times`` the force at which beads at s = D
    give way, all at once: it comes to rest above, where the line law says.

    The push grows over the first half of the run. Beads at this spacing would not even meet.
    """
    force, n, steps = times * bead_barrier(), 11, 20000
    shapes = [straight(n, spacing), straight(n, spacing, (0, 0, D), 90.0)]
    plan, system = posed(level, spacing, shapes, {"contact.friction": 0.0})
    # the push on the two beads beside the crossing: nothing bends
    first = system.n_beads // 2 + n // 2 + 1
    out = run(
        folder,
        system,
        moved(plan, 1e-9, steps, sample=steps),
        [
            "unfix hold_left",
            "unfix hold_right",
            "group lower molecule 1",
            f"group beside id {first} {first + 1}",
            "fix held lower setforce 0 0 0",
            f"variable push equal -{force / 2:.17g}*ternary(step<{steps // 2},step/{steps // 2},1)",
            "fix push beside addforce 0 0 v_push",
            "fix damp all viscous $(v_drag)",
            "compute where beside reduce ave z",
            'fix probe all ave/time 20 1 20 c_where file probe.txt format " %.17g"',
        ],
        **(AWAY | {"drag": math.sqrt(plan.contact.kn * D * plan.beads.mass[1])}),
    )
    z = out.rows("probe.txt")[:, 1]
    cuts = [(k + 0.5) * spacing * D for k in range(-n // 2, n // 2)]
    exact, stated = (
        float(brentq(lambda d, of=of: of(d) - force, 0.01 * D, 0.54 * D))
        for of in (lambda d: crossing_force(d, 90.0), lambda d: sampled_force(d, 90.0, cuts))
    )
    gap, own = D - exact, D - stated
    case = f"pushed across by {times:g} times the beads' barrier"
    return [
        Measured(case, level, spacing, "distance of axes", "um", float(z[-1]), gap, out.time.cpu, own / gap - 1),
        Measured(case, level, spacing, "passed", "1", float(np.any(z < 0.1 * D)), 0.0, 0.0),
    ]


def bent(segments: int, spacing: float, angle: float, fine: int = 1) -> FloatArray:
    """(fine segments + 1, 3) um: a filament bent by ``angle`` degrees at its middle, in the plane of x and y."""
    way = np.array([[math.cos(a), math.sin(a), 0.0] for a in (-math.radians(angle) / 2, math.radians(angle) / 2)])
    along = np.arange(segments * fine + 1) / fine - segments / 2
    return spacing * D * along[:, None] * np.where(along[:, None] < 0, way[0], way[1])


def over_a_bend(
    folder: Path, level: str, spacing: float, angle: float = 30.0, crossing: float = 90.0
) -> list[Measured]:
    """A straight filament carried along and over the joint of one bent by ``angle`` degrees, at an even height, lens of
    about 0.35 R: the force must neither jump nor count the joint twice.

    Largest difference from the same geometry in segments an eighth as long; largest step between two of 2000 rows, less
    that of an eighth; what all forces together add up to. All over the largest force.
    """
    n, rows = 8, 2000
    overlap = 0.03
    travel = 0.6 * spacing * D
    forces, cpu, stray = [], 0.0, 0.0
    for fine in (1, 8):
        lower = bent(n, spacing, angle, fine)
        upper = straight(n * fine, spacing / fine, (-travel / 2, 0.11 * D, D - overlap), crossing)
        plan, system = posed(level, spacing / fine, [lower, upper], ELASTIC)
        speed = travel / rows / plan.timestep
        out = run(
            folder / str(fine),
            system,
            moved(plan, 1e-9, rows, sample=rows),
            [
                *HELD,
                *UPPER,
                f"fix carry upper move linear {speed:.17g} 0 0",
                "compute whole all reduce sum fx fy fz",
                'fix probe all ave/time 1 1 1 c_grip[*] c_whole[*] file probe.txt format " %.17g"',
            ],
            **({"drag": 0.0, "turning_drag": 0.0} | AWAY),
        )
        table = out.rows("probe.txt")[:, 1:]
        forces.append(table[:, :3])
        cpu += out.time.cpu
        stray = max(stray, float(np.max(np.abs(table[:, 3:])) / np.max(np.abs(table[:, :3]))))
    size = float(np.max(np.abs(forces[1])))
    off = float(np.max(np.abs(forces[0] - forces[1]))) / size
    jump = float(np.max(np.abs(np.diff(forces[0], axis=0)))) / size
    case = f"over a bend of {angle:g} degrees, at {crossing:g}"
    return [
        Measured(case, level, spacing, "off an eighth", "1", off, 0.0, cpu),
        Measured(case, level, spacing, "largest step", "1", jump, 0.0, 0.0),
        Measured(case, level, spacing, "sum of forces", "1", stray, 0.0, 0.0),
    ]


def energy_drift(folder: Path, level: str, spacing: float, angle: float = 60.0, refine: int = 1) -> list[Measured]:
    """A filament that bounces under a dead load on one that it crosses (or lies on, ``angle`` 0), both held at their
    ends, without friction and damping: drift of the energy in 1e5 of the plan's steps over what falling to the first
    touch gives.

    ``refine``: as many times shorter steps.
    """
    n, steps = 2 * math.ceil(segments_for(spacing) / 2), 100000 * refine
    gap = 0.02
    shapes = [straight(n, spacing), straight(n, spacing, (0.23 * spacing * D, 0, D + gap), angle)]
    plan, system = posed(level, spacing, shapes, ELASTIC)
    plan = replace(plan, timestep=plan.timestep / refine)
    # it would bend one filament alone by ten gaps
    f, length = system.types[0], n * spacing * D
    load = 10 * gap * 384 / 5 * f.EI / length**3 / (n - 1)
    rows = 1000
    fall = load * gap * (n - 1)
    out = run(
        folder,
        system,
        moved(plan, 1e-9, steps, sample=steps),
        [
            "group upper molecule 2",
            "group pushed intersect upper contact",
            f"fix load pushed addforce 0 0 -{load:.17g}",
            "compute elastic all pe bond angle pair",
            "variable whole equal c_elastic+c_kinetic+f_load",
            f"fix probe all ave/time {steps // rows} 1 {steps // rows} v_whole c_kinetic c_contact_pairs "
            'file probe.txt format " %.17g"',
        ],
        **({"drag": 0.0} | AWAY),
    )
    step, energy, kinetic, contact = out.rows("probe.txt").T
    late = slice(rows // 50, None)
    drift = float(np.polyfit(step[late] / steps, energy[late], 1)[0]) / fall
    swing = float(np.std(energy)) / fall
    kind = "parallel" if angle == 0 else f"at {angle:g} degrees"
    case = f"bouncing {kind}" + (f", step over {refine}" if refine > 1 else "")
    if np.max(kinetic) < 0.5 * fall or np.max(contact) <= 0:
        raise RuntimeError("the filaments did not meet")
    return [
        Measured(case, level, spacing, "drift", "1", drift, 0.0, out.time.cpu),
        Measured(case, level, spacing, "scatter of energy", "1", swing, 0.0, 0.0),
    ]


def thickness_at(folder: Path, spacing: float, forces: FloatArray, count: int = 7, seed: int = 1) -> FloatArray:
    """Thickness, um, of a bundle of ``count`` filaments of 80 D pressed at 0.2 m/s, when the platen's force first
    reaches each of ``forces`` nN; chains of segments of ``spacing`` D, contacts real, EA softened alike at every
    spacing."""
    plan, system = planned(
        {
            "model.level": "chain, capsules",
            "model.spacing": f"{spacing * D} um",
            "model.axial_softening": 10.0,
            "assembly.count": count,
            "assembly.length": f"{80 * D} um",
            "assembly.jitter": "0.3 um",
            "assembly.seed": seed,
            "platens.width": f"{48 * D} um",
            "platens.friction": 0.3,
            "platens.stop": {"displacement": "10 um"},
            "contact.softening": 1.0,
        }
    )
    way, rows = 10.0, 125
    steps = math.ceil(way / 0.2 / plan.timestep / rows / 20) * rows * 20
    out = run(folder, system, moved(plan, way / steps / plan.timestep, steps, sample=steps // rows))
    shift, force = out.record.mean["displacement"], np.maximum.accumulate(out.record.mean["top_force"])
    if force[-1] < np.max(forces):
        raise RuntimeError(f"the bundle carried {force[-1]:.4g} nN")
    return plan.height - np.interp(forces, force, shift)
