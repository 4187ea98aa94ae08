"""Contact against closed forms: parallel filaments (line contact), crossing ones (Hertz), forces between platens."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from cgfibre.build.bundle import BundleSpec, build_bundle, build_section
from cgfibre.build.system import FilamentSystem
from cgfibre.cases.experiment import Measured, moved, planned, run, scene
from cgfibre.cases.friction import parallel_filaments
from cgfibre.cases.rods import AWAY, SECTION, D, filament
from cgfibre.mechanics.contact import LineContact, contact_modulus, crossing_prefactor
from cgfibre.plan.model import CONTACT, Plan

LINE_LOADS = (0.01, 0.1, 1.0, 10.0)  # N/mm


def line_contact(folder: Path, level: str, spacing: float, load: float = 1.0) -> list[Measured]:
    """Two parallel filaments brought together by the approach that plane strain gives ``load`` N/mm: line load found.

    The decks' hooke is the secant at contact.line_load = 1 N/mm: exact there, elsewhere off by the ratio of secants,
    but where beads touch the neighbours of their partners (10 N/mm, 0.24 D of approach, at D/2).
    With the real stiffness: a section's default softening of 10 is a choice of its plan, which makes it 10 times less.
    """
    f = scene({}).filament
    pair = LineContact.between(D / 2, D / 2, f.E2, f.nu23, f.E2, f.nu23)
    line_load = load * 1e6
    approach = float(pair.approach(line_load))
    centres = np.array([[0.0, 0.0], [0.0, D]])
    if level == "section":
        plan, one = planned(SECTION | {"contact.softening": 1.0})
        system = build_section(BundleSpec(one.types[0], centres), np.random.default_rng(0))
        at = np.zeros(1)
        length, axis, move = plan.depth, "fy", f"0 -{approach:.17g} 0"
    else:
        plan, system = parallel_filaments(level, spacing, max(10.0, 5 * spacing), centres)
        at = plan.beads.stations[plan.beads.role == CONTACT]
        length = len(at) * spacing * D
        axis, move = "fz", f"0 0 -{approach:.17g}"
    force, cpu = _held(folder, plan, system, ["group upper molecule 2", f"displace_atoms upper move {move}"], axis)
    # a bead's own partner, and at small spacings its partner's neighbours as well: they touch once the approach is more
    # than D - sqrt(D^2 - s^2)
    apart = np.hypot(at[:, None] - at, D - approach)
    bead = float(pair.secant_stiffness(1e6)) * length / len(at)
    pushed = bead * np.sum(np.maximum(D - apart, 0) * (D - approach) / apart)
    stated = float(pushed) / length / line_load - 1
    case = f"line contact, {load:g} N/mm"
    return [Measured(case, level, spacing, "line load", "nN/um", force / length, line_load, cpu, stated)]


def crossing(folder: Path, level: str, spacing: float, angle: float = 90.0, force: float = 1e6) -> list[Measured]:
    """Two filaments crossing at ``angle`` degrees, law hertz, brought together by Hertz' approach at ``force`` nN.

    A bead knows no angle: the decks take that of 90 degrees, so others err by the ratio of Hertz' prefactors.
    """
    f = scene({}).filament
    modulus = float(contact_modulus(f.E2, f.nu23, f.E2, f.nu23))
    prefactor = float(crossing_prefactor(modulus, D / 2, D / 2, math.radians(angle)))
    approach = (force / prefactor) ** (2 / 3)
    plan, one = filament(level, spacing, 16.0, {"contact.law": "hertz"})
    centres = np.array([[0.0, 0.0], [0.0, D]])
    stations = plan.beads.stations - plan.beads.stations[0]
    both = build_bundle(BundleSpec(one.types[0], centres, stations), np.random.default_rng(0))
    points = both.positions.copy()
    upper, middle = points[one.n_beads :], 8 * D
    x = upper[:, 0] - middle
    turn = math.radians(angle)
    upper[:, 0], upper[:, 1] = middle + x * math.cos(turn), x * math.sin(turn)
    box = both.box.copy()
    box[1] = -16 * D, 16 * D
    system = replace(both, positions=points, box=box)
    commands = ["group upper molecule 2", f"displace_atoms upper move 0 0 -{approach:.17g}"]
    found, cpu = _held(folder, plan, system, commands, "fz")
    right = float(crossing_prefactor(modulus, D / 2, D / 2))
    stated = right / prefactor - 1
    return [Measured(f"crossing at {angle:g} degrees", level, spacing, "force", "nN", found, force, cpu, stated)]


def _held(folder: Path, plan: Plan, system: FilamentSystem, commands: list[str], axis: str) -> tuple[float, float]:
    """(force on the group ``upper``, processor seconds): everything held where the commands put it."""
    out = run(
        folder,
        system,
        moved(plan, 1e-9, 40, sample=20),
        [
            *commands,
            "unfix integrate",
            *(["unfix springs"] if plan.level == "section" else []),
            f"compute grip upper reduce sum {axis}",
            'fix probe all ave/time 20 1 20 c_grip file probe.txt format " %.17g"',
        ],
        **AWAY,
    )
    return float(out.rows("probe.txt")[-1, 1]), out.time.cpu


def stack(folder: Path, level: str, spacing: float) -> list[Measured]:
    """Two discs of a section between the platens, no springs: the top one's force is the bottom one's, at rest, and
    d/(2/k_platen + 1/k_pair)."""
    plan, one = planned(SECTION)
    system = build_section(BundleSpec(one.types[0], np.array([[0.0, 0.0], [0.0, D]])), np.random.default_rng(0))
    plan = moved(plan, 0.01 / 4000 / plan.timestep, 4000, 4000)
    drag = math.sqrt(plan.platens.kn * plan.beads.mass[0])
    out = run(folder, system, plan, spring_nN_um=1e-9, torsion_nN_um=0.0, drag=drag)
    top, bottom = (float(out.record.mean[name][-1]) for name in ("top_force", "bottom_force"))
    exact = 0.01 / (2 / plan.platens.kn + 1 / plan.contact.kn)
    return [
        Measured("stack between platens", level, spacing, "top force", "nN", top, exact, out.time.cpu),
        Measured("stack between platens", level, spacing, "bottom force", "nN", bottom, top, 0.0),
    ]


def platen_balance(folder: Path, level: str, spacing: float) -> list[Measured]:
    """Seven filaments pressed by 2 um between a plate and an anvil, with friction, and held: what the top platen gives
    the bottom one and the end supports take."""
    plan, system = planned(
        {
            "model.level": level,
            "model.spacing": f"{spacing * D} um",
            "assembly.count": 7,
            "assembly.length": f"{20 * D} um",
            "assembly.jitter": "0.01 um",
            "platens.width": f"{12 * D} um",
            "platens.friction": 0.3,
            "platens.stop": {"displacement": "2 um"},
        }
    )
    plan = moved(plan, 2.0 / 20000 / plan.timestep, 20000, 20000)
    out = run(
        folder,
        system,
        plan,
        ['fix supports all ave/time 10 100 1000 f_hold_left[3] f_hold_right[3] file supports.txt format " %.15g"'],
        drag=20 * plan.drag,
    )
    top, bottom = (float(out.record.mean[name][-1]) for name in ("top_force", "bottom_force"))
    left, right = out.rows("supports.txt")[-1, 1:]
    taken = float(bottom - left - right)
    return [Measured("platen force balance", level, spacing, "taken below", "nN", taken, top, out.time.cpu)]
