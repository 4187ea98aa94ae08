"""Friction of capsules: filaments dragged along, across and askew over others, between platens, and turned by it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.cases.capsule import HELD, R, line_law, posed, segments_for, straight
from cgfibre.cases.experiment import Measured, Outcome, moved, run_on
from cgfibre.cases.friction import MU, parallel_filaments
from cgfibre.cases.rods import AWAY, D
from cgfibre.mechanics import rod
from cgfibre.plan.model import Plan

#: of friction against the crossing angle, degrees: some of the thesis' table 3-1
BY_ANGLE = {0.0: 0.429, 10.0: 0.285, 45.0: 0.198, 90.0: 0.23}
ROWS = 400  # of force along a way


@dataclass(frozen=True)
class Drag:
    """How far (x, y) um a filament is dragged in how many steps, at an even height or free to rise under ``load`` nN a
    bead; on how many ranks."""

    way: tuple[float, float]
    load: float = 0.0
    steps: int = 20000
    ranks: int = 1


def dragged(
    folder: Path, assembly: tuple[Plan, FilamentSystem], drag: Drag, **variables: float | str
) -> tuple[FloatArray, Outcome]:
    """(rows, outcome): the last filament dragged over the held others. A row: x, y um gone, force on the others (3) nN,
    its height um."""
    plan, system = assembly
    steps, load = drag.steps, drag.load
    every = steps // ROWS
    n = system.n_filaments
    speed = [x / steps / plan.timestep for x in drag.way]
    held = [c for c in HELD if plan.beads.support != "periodic" or "hold" not in c]
    out = run_on(
        drag.ranks,
        folder,
        system,
        moved(plan, 1e-9, steps, sample=steps),
        [
            *held,
            f"group upper molecule {n}",
            "group lower subtract all upper",
            *([f"fix push upper addforce 0 0 {-load:.17g}"] if load else []),
            f"fix pull upper move linear {speed[0]:.17g} {speed[1]:.17g} {'NULL' if load else '0'}",
            "compute grip lower reduce sum fx fy fz",
            "compute where upper reduce ave z",
            f'fix friction all ave/time {every} 1 {every} c_grip[*] c_where file friction.txt format " %.17g"',
        ],
        {"drag": 0.0, "turning_drag": 0.0} | AWAY | variables,
    )
    rows = out.rows("friction.txt")
    gone = rows[:, :1] * plan.timestep * np.array(speed)
    return np.column_stack([gone, rows[:, 1:]]), out


def _ratios(case: str, grid: tuple[str, float], ratio: FloatArray, mu: float, cpu: float) -> list[Measured]:
    """Mean of F/N and its ripple, largest less least over the mean."""
    mean = float(np.mean(ratio))
    return [
        Measured(case, *grid, "mean F/N", "1", mean, mu, cpu),
        Measured(case, *grid, "ripple of F/N", "1", float(np.ptp(ratio)) / mean, 0.0, 0.0),
    ]


def _rise(case: str, grid: tuple[str, float], z: FloatArray) -> Measured:
    return Measured(case, *grid, "rise and fall over D", "1", float(np.ptp(z)) / D, 0.0, 0.0)


def sliding_along(folder: Path, level: str, spacing: float) -> list[Measured]:
    """One filament slides along the top of another under 0.1 N/mm, over a segment, beads first in register and first
    half a segment off: F/N, its ripple, and how far it rises and falls."""
    return _slide(folder, "sliding along", (level, spacing), np.array([[0.0, 0.0], [0.0, 1.0]]), 1.0)


def sliding_in_groove(folder: Path, level: str, spacing: float) -> list[Measured]:
    """One filament slides in the groove of two: F/N = mu/cos(angle of the sides), 30 degrees less the dent's."""
    tilt = math.sqrt(0.75)
    return _slide(
        folder, "sliding in a groove", (level, spacing), np.array([[-0.5, 0.0], [0.5, 0.0], [0.0, tilt]]), tilt
    )


def _slide(folder: Path, case: str, grid: tuple[str, float], centres: FloatArray, tilt: float) -> list[Measured]:
    """``centres`` in diameters; the last filament leans on the others at an angle of cosine ``tilt`` to its load."""
    level, spacing = grid
    law, line_load = line_law(), 1e5
    n_cell = max(6, math.ceil(12 / spacing))
    plan, system = parallel_filaments(level, spacing, n_cell * spacing, centres * D, periodic=True)
    beads = system.n_beads // len(centres)
    for _ in range(5):  # the overlap makes the groove steeper
        approach = float(law.approach(line_load / (len(centres) - 1) / tilt))
        height = math.sqrt((D - approach) ** 2 - (centres[0, 0] * D) ** 2)
        tilt = height / (D - approach)
    points = system.positions.copy()
    points[-beads:, 2] = height + 0.1 * approach  # it has to come down
    system = replace(system, positions=points)
    found = []
    for name, shift in (("in register", 0.0), ("half a segment off", 0.5)):
        points = system.positions.copy()
        points[-beads:, 0] += shift * spacing * D
        own = replace(system, positions=points)
        load = line_load * spacing * D
        rows, out = dragged(folder / name[:2], (plan, own), Drag((spacing * D, 0.0), load))
        late = rows[ROWS // 10 :]  # once the friction springs slip and the load has come to rest
        ratio = late[:, 2] / -late[:, 4]
        label = f"{case}, {name}"
        found += [*_ratios(label, grid, ratio, MU / tilt, out.time.cpu), _rise(label, grid, late[:, 5])]
    return found


def sliding_across(folder: Path, level: str, spacing: float) -> list[Measured]:
    """The upper of two filaments carried across the top of the lower at an even height, out of register: F_t/F_n, the
    slope of the surface allowed for, where it is furthest from mu."""
    aside, approach = 0.2, float(line_law().approach(1e6))
    n = segments_for(spacing)
    shapes = [straight(n, spacing), straight(n, spacing, (0.37 * spacing * D, -aside, D - approach))]
    rows, out = dragged(folder, posed(level, spacing, shapes), Drag((0.0, 2 * aside)))
    y, across, normal = rows[:, 1] - aside, rows[:, 3], rows[:, 4]
    slope = np.arctan2(y, rows[:, 5])
    ratio = np.tan(np.arctan2(across, -normal) + slope)[ROWS // 2 :]
    worst = float(ratio[np.argmax(np.abs(ratio - MU))])
    return [Measured("sliding across", level, spacing, "F_t/F_n", "1", worst, MU, out.time.cpu)]


def crossing_dragged(
    folder: Path, level: str, spacing: float, angle: float, along: str, friction: str, mu: float
) -> tuple[FloatArray, float]:
    """(F/N along the way, processor seconds): a filament dragged over another that it crosses, at an even height, lens
    of 0.3 R, over a segment of the lower (``along`` "lower") or of its own axis ("own")."""
    half = 0.3 * R * math.sin(math.radians(angle))
    away = math.sqrt(D**2 - half**2)
    n = 2 * math.ceil(max(10, 30 / spacing / math.sin(math.radians(max(angle, 20)))) / 2)
    turn = math.radians(angle)
    s = spacing * D
    way = (1.0, 0.0) if along == "lower" else (math.cos(turn), math.sin(turn))
    shapes = [straight(n, spacing), straight(n, spacing, (0.3 * s, 0, away), angle) + 0.4 * s * np.array([*way, 0])]
    assembly = posed(level, spacing, shapes, {"contact.damping_ratio": 1e-9})
    rows, out = dragged(folder, assembly, Drag((way[0] * s, way[1] * s)), contact_friction=friction)
    late = rows[ROWS // 10 :]
    return (late[:, 2] * way[0] + late[:, 3] * way[1]) / -late[:, 4], out.time.cpu


def crossing_sliding(folder: Path, level: str, spacing: float, angle: float = 90.0) -> list[Measured]:
    """A filament dragged over another that it crosses at ``angle`` degrees, over a segment of it and over one of its
    own: F/N and its ripple."""
    found = []
    for along in ("lower", "own"):
        ratio, cpu = crossing_dragged(folder / along, level, spacing, angle, along, f"{MU}", MU)
        case = f"crossing slide at {angle:g} degrees, along {'the other' if along == 'lower' else 'itself'}"
        found += _ratios(case, (level, spacing), ratio, MU, cpu)
    return found


def friction_by_angle(folder: Path, level: str, spacing: float, angle: float = 45.0) -> list[Measured]:
    """Friction tabulated against the crossing angle: F/N of a filament dragged over another is the table's."""
    run = folder / "run"
    run.mkdir(parents=True, exist_ok=True)
    rows = "\n".join(f"{k} {a:g} {mu:g}" for k, (a, mu) in enumerate(BY_ANGLE.items(), 1))
    (run / "friction.table").write_text(f"# degrees, mu\n\nTOW\nN {len(BY_ANGLE)}\n\n{rows}\n")
    words = "angle friction.table TOW"  # of the deck's own folder
    ratio, cpu = crossing_dragged(run, level, spacing, angle, "lower", words, BY_ANGLE[angle])
    return _ratios(f"friction by angle, {angle:g} degrees", (level, spacing), ratio, BY_ANGLE[angle], cpu)


def static_and_kinetic(folder: Path, level: str, spacing: float) -> list[Measured]:
    """Friction of 0.2 static, 0.15 kinetic: the largest F/N of a parallel filament that starts to move along, and F/N
    once it slides; the whole contact gives way at once."""
    law, n = line_law(), segments_for(spacing)
    approach = float(law.approach(1e6))
    shapes = [straight(n, spacing), straight(n, spacing, (0.37 * spacing * D, 0, D - approach))]
    assembly = posed(level, spacing, shapes, {"contact.damping_ratio": 1e-9})
    # the spring gives way at mu f/kt: 0.25 of the approach; over twice that
    rows, out = dragged(folder, assembly, Drag((0.5 * approach, 0.0)), contact_friction=f"{MU} kinetic 0.15")
    ratio = rows[:, 2] / -rows[:, 4]
    case, grid = "static and kinetic friction", (level, spacing)
    peak = float(np.max(ratio))
    return [
        Measured(case, *grid, "largest F/N", "1", peak, MU, out.time.cpu),
        Measured(case, *grid, "sliding F/N", "1", float(ratio[-1]), 0.15, 0.0),
    ]


def torque_of_friction(folder: Path, level: str, spacing: float) -> list[Measured]:
    """The lower of two rods, held, while the upper is carried across its top: the torque about its axis is mu N R, R to
    the middle of the overlap."""
    law, n, steps = line_law(), segments_for(spacing), 4000
    approach = float(law.approach(1e6))
    aside = 2 * approach
    shapes = [straight(n, spacing), straight(n, spacing, (0.37 * spacing * D, -aside, D - approach))]
    plan, system = posed(level, spacing, shapes)
    out = run_on(
        1,
        folder,
        system,
        moved(plan, 1e-9, steps, sample=steps),
        [
            *HELD,
            "group upper molecule 2",
            "group lower subtract all upper",
            f"fix pull upper move linear 0 {aside / steps / plan.timestep:.17g} 0",
            "compute couple all property/atom tqx",
            "compute grip lower reduce sum fx fy fz c_couple",
            f'fix probe all ave/time {steps} 1 {steps} c_grip[*] file probe.txt format " %.17g"',
        ],
        AWAY,
    )
    # the upper one has come to stand above: the force on the lower is friction along y, the load along -z
    _, across, normal, torque = out.rows("probe.txt")[-1, 1:]
    grid = ("torque of friction", level, spacing)
    return [
        Measured(*grid, "F_t/F_n", "1", float(across / -normal), MU, out.time.cpu),
        Measured(*grid, "torque", "nN um", float(torque), float(MU * normal * (D - approach) / 2), 0.0),
    ]


def rolled(folder: Path, level: str, spacing: float, length: float = 40.0) -> list[Measured]:
    """A rod of ``length`` diameters, kept in its place and from turning at its ends, over whose middle another one is
    dragged: friction at the surface turns it there by T L/(4 GJ), T = mu N R.

    Its grips stand a tenth of a segment beyond its ends. The lens is cut by the middle bead: each half of it turns the
    rod at the foot of its own force, c from there, so L is less by 2 c; it touches R above the axis, c/2 from there, so
    what it presses leans by atan(c/2 R).
    """
    overlap, n = 0.02 * D, 2 * math.ceil(length / spacing / 2)
    s = spacing * D
    shapes = [straight(n, spacing), straight(n, spacing, (0, 0, D - overlap), 90.0)]
    plan, system = posed(level, spacing, shapes, {"contact.damping_ratio": 1e-9})
    f, inertia = system.types[0], rod.SPHERE_INERTIA * system.types[0].mass_per_length * s * D**2
    frequency = math.pi / (n * s) * math.sqrt(f.GJ * s / inertia)
    steps = math.ceil(20 / frequency / plan.timestep / 20) * 20
    way = 2 * overlap  # the friction spring gives way at a fifth of the overlap, the rod turns by less
    out = run_on(
        1,
        folder,
        system,
        moved(plan, 1e-9, steps, sample=steps),
        [
            *HELD,
            f"group lower id 1:{n + 1}",
            "group upper molecule 2",
            "fix integrate lower nve/bpm/sphere",
            "fix still lower setforce 0 0 0",
            f"fix pull upper move linear 0 {way / steps / plan.timestep:.17g} 0",
            "compute grip upper reduce sum fx fy fz",
            "compute turns all property/atom quatw quati",
            "compute touching all capsule/local",
            f"group middle id {n // 2 + 1}",
            "compute turn middle reduce sum c_turns[1] c_turns[2]",
            f'fix probe all ave/time {steps} 1 {steps} c_grip[*] c_turn[*] file probe.txt format " %.17g"',
            f"dump lens all local {steps} lens.txt index c_touching[5] c_touching[12] c_touching[14]",
        ],
        {"drag": 0.0, "turning_drag": 2 * frequency * inertia} | AWAY,
    )
    _, across, normal, w, i = out.rows("probe.txt")[-1, 1:]
    rows = [line.split() for line in (folder / "lens.txt").read_text().split("index")[-1].splitlines()[1:]]
    load, x, z = np.array(rows, dtype=float).T[1:]
    foot, lever = (float(np.average(values, weights=load)) for values in (2 * np.abs(x), z))
    exact = across * lever * (n * s + 0.2 * s - 2 * foot) / (4 * f.GJ)
    grid = ("rolled by friction", level, spacing)
    return [
        Measured(*grid, "F_t/F_n", "1", float(-across / normal), MU * math.hypot(1, foot / lever / 2), out.time.cpu),
        Measured(*grid, "turn", "rad", float(2 * np.arctan2(i, w)), float(exact), 0.0),
    ]
