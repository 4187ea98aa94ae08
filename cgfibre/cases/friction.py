"""Friction against closed forms: capstan, filaments sliding along, across and in the groove of others, platens."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.integrate import quad

from cgfibre.build.bundle import BundleSpec, build_bundle
from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.cases.experiment import Measured, moved, planned, run, scene
from cgfibre.cases.rods import AWAY, D, critical_drag, end_drag, filament, laid_along
from cgfibre.mechanics import contact
from cgfibre.plan.model import CONTACT, Plan

MU = 0.2  # of the pair, as the scene has it


# --- capstan ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Pulley:
    """Pulley of ``radius`` um (the filament's axis runs half a diameter outside) with Coulomb ``friction``, wrapped by
    ``wrap`` rad."""

    radius: float = 60 * D
    friction: float = 0.22
    wrap: float = 1.435

    @property
    def ratio(self) -> float:
        """T2/T1 = exp(mu theta)."""
        return math.exp(self.friction * self.wrap)

    def spacing(self, nodes: int) -> float:
        """s/D of a chain with this many nodes on the pulley: 2 R sin(theta/(2 n))."""
        return 2 * (self.radius / D + 0.5) * math.sin(self.wrap / nodes / 2)

    def nodes(self, spacing: float) -> int:
        """Nodes on the pulley nearest to s/D = ``spacing``."""
        return max(1, round(self.wrap / 2 / math.asin(spacing / (2 * self.radius / D + 1))))

    def ratio_of(self, nodes: int) -> float:
        """T2/T1 of a chain that turns at this many nodes: ((1 + mu tan(a/2))/(1 - mu tan(a/2)))^n, a = theta/n."""
        slip = self.friction * math.tan(self.wrap / nodes / 2)
        return ((1 + slip) / (1 - slip)) ** nodes


def capstan(folder: Path, level: str, spacing: float, pulley: Pulley | None = None) -> list[Measured]:
    """A chain without bending stiffness over a turning pulley, one end held, 10 uN on the other: T2/T1 at the held end.

    Level chain; as many beads touch the pulley as s/D asks for (see Pulley.spacing), the chain turns evenly at them.
    """
    pulley = Pulley() if pulley is None else pulley
    nodes = pulley.nodes(spacing)
    turn, axis = pulley.wrap / nodes, pulley.radius + D / 2
    s = pulley.spacing(nodes) * D
    assembly = filament(level, s / D, (nodes + 1) * s / D)
    plan = assembly[0]
    angle = (np.arange(nodes) + 0.5) * turn - pulley.wrap / 2
    on_pulley = axis * np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)])
    # the strands lie along the polygon's sides, so the chain turns at its end nodes as at all others
    points = np.vstack([2 * on_pulley[0] - on_pulley[1], on_pulley, 2 * on_pulley[-1] - on_pulley[-2]])
    points[0] = on_pulley[0] + s * _unit(-math.cos(pulley.wrap / 2), -math.sin(pulley.wrap / 2))
    points[-1] = on_pulley[-1] + s * _unit(math.cos(pulley.wrap / 2), -math.sin(pulley.wrap / 2))
    system = laid_along(assembly, points)
    load = 1e4 * (points[-1] - points[-2]) / s
    f = system.types[0]
    frequency = math.pi / 2 / ((nodes + 3) * s) * math.sqrt(f.EA / f.mass_per_length)
    speed = 1e-2  # of its surface, um/us: what slips does not ask how fast
    steps = 40000
    p = plan.platens
    out = run(
        folder,
        system,
        moved(plan, 1e-9, steps, sample=2000),
        [
            "unfix hold_right",
            f"fix load right addforce {load[0]:.17g} 0 {load[2]:.17g}",
            *end_drag(plan),
            "angle_coeff * 0",
            f"variable turned equal {speed / pulley.radius:.17g}*step*{plan.timestep:.17g}",
            f"region pulley cylinder y 0 0 {pulley.radius:.17g} INF INF side out rotate v_turned 0 0 0 0 1 0",
            f"fix pulley contact wall/gran/region granular hooke {p.kn:.17g} 0 tangential linear_history "
            f"{p.kt:.17g} 1.0 {pulley.friction} damping velocity region pulley",
            'fix probe all ave/time 2000 1 2000 f_hold_left[1] f_hold_left[3] file probe.txt format " %.17g"',
        ],
        **({"drag": critical_drag(plan, frequency)} | AWAY),
    )
    rows = out.rows("probe.txt")[:, 1:]
    tension = np.hypot(rows[:, 0], rows[:, 1])
    if abs(tension[-1] / tension[-3] - 1) > 1e-6:
        raise RuntimeError(f"the chain does not slip steadily: {tension[-3:].tolist()}")
    ratio = float(tension[-1]) / 1e4
    stated = pulley.ratio_of(nodes) / pulley.ratio - 1
    return [Measured("capstan", level, s / D, "T2/T1", "1", ratio, pulley.ratio, out.time.cpu, stated)]


def _unit(x: float, z: float) -> FloatArray:
    return np.array([x, 0.0, z]) / math.hypot(x, z)


# --- filaments on filaments ------------------------------------------------------------------------------------------


def parallel_filaments(
    level: str, spacing: float, length: float, centres: FloatArray, *, periodic: bool = False
) -> tuple[Plan, FilamentSystem]:
    """Parallel filaments of ``length`` diameters through ``centres`` (n, 2) um, beads in register, no end load."""
    changes: dict[str, object] = {"contact.softening": 1.0}
    plan, one = filament(level, spacing, length, changes | ({"ends.support": "symmetry"} if periodic else {}))
    stations = plan.beads.stations - plan.beads.stations[0]
    system = build_bundle(BundleSpec(one.types[0], centres, stations), np.random.default_rng(0))
    if periodic:
        n = len(centres)
        box = system.box.copy()
        box[0] = one.box[0]
        along = np.array([True, False, False])
        system = replace(system, box=box, closed=np.ones(n, dtype=bool), periodic=along)
    return plan, system


def sliding_across(folder: Path, level: str, spacing: float) -> list[Measured]:
    """The lower of two filaments held, the upper one pushed down and dragged across its top by 0.04 um, in register.

    Bumps play no part: every bead stays above its own. On the slope alpha = y/D: F_y/F_z = tan(atan mu - alpha). Gives
    F_t/F_n where it is furthest from mu, and the largest force along the filament over the normal one.
    """
    span, steps, aside = 0.04, 4000, -0.02
    centres = np.array([[0.0, 0.0], [aside, math.sqrt(D**2 - aside**2)]])
    plan, system = parallel_filaments(level, spacing, max(10.0, 5 * spacing), centres)
    push = 1e4 * spacing
    out = run(
        folder,
        system,
        moved(plan, 1e-6, steps),
        [
            "group upper molecule 2",
            "group pressed intersect contact upper",
            "group held subtract contact upper",
            "unfix integrate",
            f"fix push pressed addforce 0 0 -{push}",
            f"fix pull upper move linear 0 {span / steps / plan.timestep:.17g} NULL",
            "compute grip held reduce sum fx fy fz",
            "compute where upper reduce ave y",
            'fix friction all ave/time 100 1 100 c_grip[*] c_where file friction.txt format " %.15g"',
        ],
        **({"drag": 0.0} | AWAY),
    )
    _, along, across, normal, y = out.rows("friction.txt").T
    slope = np.arcsin(y / D)
    sliding = slope > aside / 2 / D
    if np.any(normal[sliding] > -1e4):
        raise RuntimeError("the filaments lost contact")
    ratio = np.tan(np.arctan2(across[sliding], -normal[sliding]) + slope[sliding])
    worst = float(ratio[np.argmax(np.abs(ratio - MU))])
    stray = float(np.max(np.abs(along[sliding] / normal[sliding])))
    return [
        Measured("sliding across", level, spacing, "F_t/F_n", "1", worst, MU, out.time.cpu),
        Measured("sliding across", level, spacing, "F along/F_n", "1", stray, 0.0, 0.0),
    ]


def mean_bump_friction(mu: float, spacing: float, diameter: float) -> float:
    """Mean of tan(atan mu + asin(u/D)) over -s/2 < u < s/2: sliding force over load, quasi-static."""

    def force(u: float) -> float:
        return math.tan(math.atan(mu) + math.asin(u / diameter))

    return float(quad(force, -spacing / 2, spacing / 2)[0]) / spacing


def sliding_along(folder: Path, level: str, spacing: float) -> list[Measured]:
    """One filament slides along the top of another, from crest to crest of its beads: mean and peak of force/load."""
    centres = np.array([[0.0, 0.0], [0.0, D]])
    return _slide(folder, "sliding along", (level, spacing), centres, (MU, D))


def sliding_in_groove(folder: Path, level: str, spacing: float) -> list[Measured]:
    """One filament slides in the groove of two that touch: as along one, with D cos 30 deg for D and mu/cos 30 deg."""
    tilt = math.sqrt(0.75)
    centres = np.array([[-D / 2, 0.0], [D / 2, 0.0], [0.0, tilt * D]])
    return _slide(folder, "sliding in a groove", (level, spacing), centres, (MU / tilt, tilt * D))


def _slide(
    folder: Path, case: str, grid: tuple[str, float], centres: FloatArray, bump: tuple[float, float]
) -> list[Measured]:
    """The last of periodic filaments dragged along the others, which are held, from crest to crest.

    Mean and peak of pull over load against the bumps of friction and radius ``bump``, and the deepest axis distance
    over the nested one. A load of 5e-4 D of overlap: a bead still leans on the one behind until it is 5e-4 D past the
    nest, which rounds the peak by that angle.
    """
    level, spacing = grid
    n_cell = max(6, math.ceil(4.5 / spacing))  # longer than a bead's reach, so it never meets an image of its partner
    plan, system = parallel_filaments(level, spacing, n_cell * spacing, centres, periodic=True)
    s, n = spacing * D, len(centres)
    kn, mass = plan.contact.kn, float(np.median(plan.beads.mass))
    load = 5e-4 * D * kn
    steepest = math.tan(math.asin(s / 2 / bump[1]))
    # the bead turns round in the nest: 2 v tan(alpha) sqrt(kn m) is 6 % of the load
    speed = 0.03 * load / math.sqrt(kn * mass) / max(steepest, 0.2)
    rows = 2000
    steps = math.ceil(s / speed / plan.timestep / rows / 20) * rows * 20
    speed = s / steps / plan.timestep
    every = steps // rows
    out = run(
        folder,
        system,
        moved(plan, 1e-9, steps, sample=steps // 20),
        [
            f"group upper molecule {n}",
            "group held subtract all upper",
            "unfix integrate",
            f"fix push upper addforce 0 0 -{load:.17g}",
            f"fix pull upper move linear {speed:.17g} 0 NULL",
            "compute grip held reduce sum fx fz",
            "compute where upper reduce ave z",
            f'fix friction all ave/time {every // 20} 20 {every} c_grip[*] c_where file friction.txt format " %.15g"',
        ],
        **({"drag": 0.0} | AWAY),
    )
    _, pull, normal, z = out.rows("friction.txt").T
    late = slice(rows // 20, None)  # after the load has come to rest on the crest
    beads = system.n_beads // n
    mean = float(np.mean(pull)) / (beads * load)
    peak = float(np.max(pull[late] / -normal[late]))
    summit = float(contact.bump_friction(bump[0], s, bump[1]))
    nested = math.sqrt(bump[1] ** 2 - s**2 / 4)
    # the bead behind is left once the overlap in front, delta, is made up for: delta D/s past the nest
    angle = math.asin(s / 2 / bump[1])
    overlap = load / kn / ((n - 1) * bump[1] / D * (math.cos(angle) - bump[0] * math.sin(angle)))
    steep = angle + math.atan(bump[0])
    rounded = math.tan(steep - overlap * D / (s * bump[1] * math.cos(angle))) / math.tan(steep) - 1
    return [
        Measured(case, level, spacing, "mean F/N", "1", mean, mean_bump_friction(bump[0], s, bump[1]), out.time.cpu),
        Measured(case, level, spacing, "peak F/N", "1", peak, summit, 0.0, rounded),
        Measured(case, level, spacing, "nested distance", "um", float(np.min(z)), nested, 0.0),
    ]


# --- platens ---------------------------------------------------------------------------------------------------------


def between_platens(folder: Path, level: str, spacing: float) -> list[Measured]:
    """Both platens of friction 0.3 dent a filament by 0.01 um; it is dragged along and across: F_t/F_n and the normal
    force, of the platen that is further off. A flat platen feels no bumps, so any direction will do."""
    mu, dent = 0.3, 0.01
    plan, system = planned(
        {
            "model.level": level,
            "model.spacing": f"{spacing * D} um",
            "assembly.length": f"{max(10, 5 * spacing) * D} um",
            "platens.friction": mu,
        }
    )
    plan = moved(plan, 1e-9, 4000)
    speed = 0.05 / 4000 / plan.timestep
    f = scene({}).filament
    on_platen = contact.LineContact.on_rigid_plane(D / 2, f.E2, f.nu23)
    touching = int(np.sum(plan.beads.role == CONTACT)) * spacing * D
    normal = float(on_platen.secant_stiffness(1e6)) * touching * dent  # contact.line_load of the scene: 1 N/mm
    found = []
    for k, direction in enumerate(("along", "across")):
        out = run(
            folder / direction,
            system,
            plan,
            [
                "unfix integrate",
                f"fix pull all move linear {f'{speed:.17g} 0 0' if k == 0 else f'0 {speed:.17g} 0'}",
                "compute top all reduce sum f_top_wall[2] f_top_wall[3] f_top_wall[4]",
                "compute bottom all reduce sum f_bottom_wall[2] f_bottom_wall[3] f_bottom_wall[4]",
                'fix friction all ave/time 1000 1 1000 c_top[*] c_bottom[*] file friction.txt format " %.15g"',
            ],
            platen_top_um=D / 2 - dent,
            platen_bottom_um=dent - D / 2,
            drag=0.0,
        )
        top, bottom = out.rows("friction.txt")[-1, 1:].reshape(2, 3)
        case = f"dragged {direction} between platens"
        ratios = [float(top[k] / top[2]), float(-bottom[k] / bottom[2])]
        forces = [float(-top[2]), float(bottom[2])]
        found += [
            Measured(case, level, spacing, "F_t/F_n", "1", max(ratios, key=lambda x: abs(x - mu)), mu, out.time.cpu),
            Measured(
                case, level, spacing, "normal force", "nN", max(forces, key=lambda x: abs(x - normal)), normal, 0.0
            ),
        ]
    return found
