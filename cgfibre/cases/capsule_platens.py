"""Platens that press segments: edges, cylinders, friction, and a filament that rolls between two of them."""

from __future__ import annotations

import math
from pathlib import Path

from scipy.integrate import quad

from cgfibre.cases.capsule import HELD, R, platen_law, posed, reading, segments_for, straight
from cgfibre.cases.experiment import Measured, moved, run
from cgfibre.cases.rods import AWAY, D
from cgfibre.plan.model import Plan

MU = 0.3
WALL = ["group feel union contact left right"]


def wall(plan: Plan, name: str, shape: str, words: str = "") -> str:
    """Command of a platen of the plan's stiffness."""
    return f"fix {name} feel wall/capsule {shape} line {plan.platens.modulus:.17g} {words}"


def sharp_edge(folder: Path, level: str, spacing: float) -> list[Measured]:
    """A held filament under 1 N/mm of an anvil 3.3 D wide, shifted in thirds of a segment: the force is that of the
    width, wherever the beads lie. The shift that is furthest off."""
    law, n, width = platen_law(), segments_for(spacing), 3.3 * D
    dent = float(law.approach(1e6))
    found, cpu = [], 0.0
    for k, shift in enumerate((0.0, 0.31, 0.64)):
        plan, system = posed(level, spacing, [straight(n, spacing, (shift * spacing * D, 0, 0))])
        anvil = wall(plan, "anvil", f"plane z {-R + dent:.17g} above", f"span x {-width / 2:.17g} {width / 2:.17g}")
        (_, _, force), out = reading(folder / str(k), plan, system, [*WALL, anvil], "f_anvil[1] f_anvil[2] f_anvil[3]")
        found.append(float(force))
        cpu += out.time.cpu
    exact = 1e6 * width
    worst = max(found, key=lambda x: abs(x - exact))
    return [Measured("anvil with sharp edges", level, spacing, "force", "nN", worst, exact, cpu)]


def cylinder(folder: Path, level: str, spacing: float, side: str = "outside") -> list[Measured]:
    """A straight filament dented by 0.2 um by a cylinder of 60 D that lies across: convex (outside) in the middle,
    concave (inside) at the edges of a span of 10 D. The line law over the touching length."""
    law, n, radius, dent, half = platen_law(), segments_for(spacing), 60 * D, 0.2, 5 * D
    sign = 1.0 if side == "outside" else -1.0
    plan, system = posed(level, spacing, [straight(n, spacing, (0.29 * spacing * D, 0, 0))])
    # height of the cylinder's axis below the filament
    height = radius + R - dent if sign > 0 else -math.sqrt((radius - R + dent) ** 2 - half**2)

    def push(x: float) -> float:
        distance = math.hypot(x, height)
        overlap = sign * (radius - distance) + R
        return float(law.line_load(max(overlap, 0.0))) * abs(height) / distance

    edge = min(half, math.sqrt(max((radius + R) ** 2 - height**2, 0.0))) if sign > 0 else half
    start = 0.0 if sign > 0 else math.sqrt(max((radius - R) ** 2 - height**2, 0.0))
    exact = 2 * float(quad(push, start, edge, epsrel=1e-10)[0])
    shape = f"cylinder y 0 {-height:.17g} {radius:.17g} {side}"
    command = wall(plan, "roll", shape, f"span x {-half:.17g} {half:.17g}")
    (_, _, force), out = reading(folder, plan, system, [*WALL, command], "f_roll[1] f_roll[2] f_roll[3]")
    kind = "convex" if sign > 0 else "concave"
    return [Measured(f"{kind} cylinder", level, spacing, "force", "nN", float(force), exact, out.time.cpu)]


def between_platens(folder: Path, level: str, spacing: float) -> list[Measured]:
    """Two platens of friction 0.3 dent a filament by 1 N/mm; it is dragged along and across: F_t/F_n and the normal
    force, of the platen that is further off."""
    law, n = platen_law(), segments_for(spacing)
    dent, normal, steps = float(law.approach(1e6)), 1e6 * n * spacing * D, 4000
    found = []
    for k, direction in enumerate(("along", "across")):
        plan, system = posed(level, spacing, [straight(n, spacing)])
        # slip begins after mu/0.8 of the dent
        speed = 2 * dent / steps / plan.timestep
        way = f"{speed:.17g} 0 0" if k == 0 else f"0 {speed:.17g} 0"
        out = run(
            folder / direction,
            system,
            moved(plan, 1e-9, steps, sample=steps),
            [
                *HELD,
                *WALL,
                wall(plan, "top", f"plane z {R - dent:.17g} below", f"friction {MU}"),
                wall(plan, "bottom", f"plane z {-R + dent:.17g} above", f"friction {MU}"),
                f"fix pull all move linear {way}",
                f"fix probe all ave/time {steps} 1 {steps} f_top[1] f_top[2] f_top[3] "
                'f_bottom[1] f_bottom[2] f_bottom[3] file probe.txt format " %.17g"',
            ],
            **AWAY,
        )
        top, bottom = out.rows("probe.txt")[-1, 1:].reshape(2, 3)
        case = f"capsule dragged {direction} between platens"
        ratios = [float(top[k] / top[2]), float(-bottom[k] / bottom[2])]
        forces = [float(-top[2]), float(bottom[2])]
        worst = max(ratios, key=lambda x: abs(x - MU))
        push = max(forces, key=lambda x: abs(x - normal))
        found += [
            Measured(case, level, spacing, "F_t/F_n", "1", worst, MU, out.time.cpu),
            Measured(case, level, spacing, "normal force", "nN", push, normal, 0.0),
        ]
    return found


def rolling(folder: Path, level: str, spacing: float) -> list[Measured]:
    """A free rod between a platen that moves across it and one that stands, friction 0.3: it rolls, at half the
    platen's speed and at v/(2 R) of turn, R less the dent."""
    law, n, steps = platen_law(), segments_for(spacing), 20000
    dent = float(law.approach(1e5))
    plan, system = posed(level, spacing, [straight(n, spacing)])
    speed = 0.05 * D / steps / plan.timestep
    out = run(
        folder,
        system,
        moved(plan, 1e-9, steps, sample=steps),
        [
            "unfix hold_left",
            "unfix hold_right",
            "unfix integrate",
            "fix integrate all nve/bpm/sphere",
            *WALL,
            f"variable carried equal {speed:.17g}*step*dt",
            *(
                wall(plan, name, shape, f"damping {plan.platens.gamma:.17g} friction {MU} spin yes {move}")
                for name, shape, move in (
                    ("top", f"plane z {R - dent:.17g} below", "move y v_carried"),
                    ("bottom", f"plane z {-R + dent:.17g} above", ""),
                )
            ),
            "compute pace contact reduce ave vy",
            "compute omega all property/atom omegax",
            "compute turn contact reduce ave c_omega",
            f'fix probe all ave/time 1 {steps // 2} {steps} c_pace c_turn file probe.txt format " %.17g"',
        ],
        **({"drag": 0.0, "turning_drag": 0.0} | AWAY),
    )
    pace, turn = out.rows("probe.txt")[-1, 1:]
    grid = ("rolling between platens", level, spacing)
    return [
        Measured(*grid, "speed", "um/us", float(pace), speed / 2, out.time.cpu),
        Measured(*grid, "turn", "rad/us", float(-turn), speed / (2 * (R - dent)), 0.0),
    ]
