"""What holds whatever the scene: energy over a load cycle, momentum in a collision, the same answer in any frame."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cgfibre.build.bundle import BundleSpec, build_bundle
from cgfibre.build.system import FilamentSystem, FilamentType, FloatArray
from cgfibre.cases.experiment import Measured, deck_level, moved, pressed_at, run
from cgfibre.cases.rods import AWAY, D, arc, at_rest, bead_at, cantilever_frequency, filament, free_right_end
from cgfibre.mechanics import rod
from cgfibre.plan.model import Plan

# --- energy ----------------------------------------------------------------------------------------------------------


def energy_cycle(folder: Path, level: str, spacing: float, length: float = 40.0) -> list[Measured]:
    """A simply supported filament pressed at mid-span by L/1000 and let go again within six of its periods each,
    without any damping.

    The platen's work against kinetic and elastic energy and the bead's dent F^2/(2 kn): at the stop, and the largest
    difference ever over the work at the stop. What swings on at the end is left over: (v/(omega d))^2, 1e-3.
    """
    plan, system = filament(level, spacing, length)
    L, f, n = system.types[0].diameter * length, system.types[0], system.n_beads
    plan = pressed_at(plan, L / 2 - 0.1, L / 2 + 0.1)
    period = 2 * math.pi / float(rod.bending_frequency(L, f.EI, f.mass_per_length)) / plan.timestep
    rows = 100
    load = math.ceil(6 * period / rows / 20) * rows * 20
    every = load // rows
    plan = moved(plan, L / 1000 / load / plan.timestep, load, sample=every)
    plan = replace(
        plan,
        motion=replace(plan.motion, unload=True),
        sampling=replace(plan.sampling, frame=2 * load, checkpoint=2 * load, every=1),
    )
    variables: dict[str, float] = {"drag": 0.0, "platen_gamma": 0.0, "platen_bottom_um": -1000.0, "unload_to": -1.0}
    commands = [
        f"fix probe all ave/time {every} 1 {every} v_displacement v_kinetic_energy v_stored_energy v_top_force "
        'file probe.txt format " %.17g"'
    ]
    if level == "rod":
        variables |= {"rod_damping": 0.0, "turning_drag": 0.0}
        commands += [
            f"group beads id 1:{n}",
            "compute turns beads property/atom quatw quatj",
            f"dump states beads custom {every} states.txt id x z c_turns[1] c_turns[2]",
            'dump_modify states sort id format float "%.17g"',
        ]
    out = run(folder, system, plan, commands, **variables)
    _, d, kinetic, stored, force = out.rows("probe.txt").T
    if level == "rod":  # bpm bonds report no energy: from where the beads are and how they are turned
        stored = np.array([rod_energy(state, spacing * D, f) for state in _states(folder / "states.txt", n)])
    work = np.concatenate([[0.0], np.cumsum(out.record.mean["top_force"] * np.diff(d))])
    held = kinetic + stored + force**2 / (2 * plan.platens.kn)
    stop = int(np.argmax(d))
    unbalanced = float(np.max(np.abs(held - work)) / work[stop])
    case = "energy over a cycle"
    return [
        Measured(case, level, spacing, "energy at the stop", "nN um", held[stop], work[stop], out.time.cpu),
        Measured(case, level, spacing, "unbalanced", "1", unbalanced, 0.0, 0.0),
        Measured(case, level, spacing, "left over", "1", float(work[-1] / work[stop]), 0.0, 0.0),
    ]


def rod_energy(state: FloatArray, spacing: float, f: FilamentType) -> float:
    """Elastic energy of a rod that is bent a little in the plane of x and z, nN um: stretch, shear, bending.

    ``state`` (n, 4): x, z um and w, y of the quaternion of every bead; a turn about y by theta is a slope -theta.
    """
    x, z, w, y = state.T
    slope = -2 * np.arctan2(y, w)
    c = rod.rod_coefficients(spacing, f.EA, f.EI, f.GJ, f.kGA)
    stretch = np.hypot(np.diff(x), np.diff(z)) - spacing
    shear = np.diff(z) - np.diff(x) * (slope[:-1] + slope[1:]) / 2
    return float(np.sum(c.kr * stretch**2 + c.ks * shear**2 + c.kb * np.diff(slope) ** 2) / 2)


def _states(path: Path, n: int) -> list[FloatArray]:
    """Rows of every frame of a dump of n atoms sorted by number, without the number."""
    blocks = path.read_text().split("ITEM: TIMESTEP\n")[1:]
    return [np.array([line.split()[1:] for line in b.splitlines()[8 : 8 + n]], dtype=float) for b in blocks]


# --- momentum --------------------------------------------------------------------------------------------------------


def momentum(folder: Path, level: str, spacing: float) -> list[Measured]:
    """Two crossing filaments in free flight collide off their middles with damping (rods: and friction): linear and
    angular momentum after over before, as largest change over the sum of magnitudes.

    Chains have no friction here: beads that do not spin take up no torque, so their friction keeps linear momentum
    alone (segments: what would turn them about their axis is lost).
    """
    rods = deck_level(level) == "rod"
    friction = 0.3 if rods else 0.0
    plan, one = filament(level, spacing, 16.0, {"ends.support": "clamped", "contact.friction": friction})
    stations = plan.beads.stations
    centres = np.array([[0.0, 0.0], [0.0, D]])
    both = build_bundle(BundleSpec(one.types[0], centres, stations - stations[0]), np.random.default_rng(0))
    points, n = both.positions + np.array([stations[0], 0, 0]), one.n_beads
    # crossing at a right angle over beads at a quarter of the lower and the middle of the upper
    x = points[n:, 0].copy()
    points[n:] = np.column_stack([np.full(n, 4 * D), x - 8 * D, np.full(n, 1.001 * D)])
    reach = float(np.ptp(stations)) + 4 * D
    system = replace(both, positions=points, box=np.array([[-reach, 2 * reach], [-reach, reach], [-reach, reach]]))
    free = ["unfix hold_left", "unfix hold_right"]
    if rods:
        free += ["unfix slide", "unfix integrate", "fix integrate all nve/bpm/sphere"]
    columns = "id mass x y z vx vy vz omegax omegay omegaz"
    steps = 4000
    out = run(
        folder,
        system,
        moved(plan, 1e-9, steps, sample=200),
        [
            *free,
            "group upper molecule 2",
            "velocity upper set 0.2 0.1 -0.5",
            "compute pairs all pair/local force",
            "compute largest all reduce max c_pairs inputs local",
            f"dump motion all custom {steps} motion.txt {columns}",
            'dump_modify motion sort id format float "%.17g"',
            'fix probe all ave/time 1 20 20 c_largest file probe.txt format " %.17g"',
        ],
        **({"drag": 0.0, "turning_drag": 0.0} | AWAY),
    )
    if np.max(out.rows("probe.txt")[:, 1]) <= 0:
        raise RuntimeError("the filaments did not meet")
    states = _states(folder / "motion.txt", 2 * n)
    linear, angular = [], []
    for state in (states[0], states[-1]):
        mass, r, v, omega = state[:, :1], state[:, 1:4], state[:, 4:7], state[:, 7:10]
        linear.append(mass * v)
        angular.append(mass * np.cross(r - points.mean(axis=0), v) + rod.SPHERE_INERTIA * mass * D**2 * omega)

    def change(parts: list[FloatArray]) -> float:
        size = np.sum(np.linalg.norm(parts[0], axis=1))
        return float(np.max(np.abs(parts[1].sum(axis=0) - parts[0].sum(axis=0))) / size)

    return [
        Measured("momentum", level, spacing, "linear, change", "1", change(linear), 0.0, out.time.cpu),
        Measured("momentum", level, spacing, "angular, change", "1", change(angular), 0.0, 0.0),
    ]


# --- frames ----------------------------------------------------------------------------------------------------------

#: rotations of the whole scene: along y, downwards along z (bpm: never upwards along +z), tilted
FRAMES = {
    "y": Rotation.from_euler("z", 90, degrees=True),
    "-z": Rotation.from_euler("y", 90, degrees=True),
    "tilted": Rotation.from_rotvec([0.5, -0.7, 1.1]),
}


def frame(folder: Path, level: str, spacing: float) -> list[Measured]:
    """A cantilever bent far by a dead tip force F L^2/EI = 3, as built along x and turned as a whole: its tip, turned
    back, and its bending energy, of the frame that is furthest off. A rod starts as a quarter circle across the force,
    so that it twists as well."""
    length, load = 20.0, 3.0
    plan, straight = filament(level, spacing, length, {"ends.support": "clamped"})
    f, L = straight.types[0], length * D
    points = straight.positions
    if level == "rod":
        points = arc(2 * L / math.pi)(plan.beads.stations)
    force = load * f.EI / L**2 * np.array([0.0, 0.3, 1.0])
    reach = L + 3 * spacing * D + 2 * D

    def bent(name: str, turn: Rotation) -> tuple[FloatArray, float, float]:
        system = replace(
            straight, positions=turn.apply(points), box=np.array([[-reach, reach], [-reach, reach], [-reach, reach]])
        )
        return _bent(folder / name, (plan, system), turn.apply(force), L)

    where, energy, cpu = bent("x", Rotation.identity())
    size = float(np.linalg.norm(where - points[bead_at(plan, L) - 1]))
    worst, furthest = 0.0, energy
    for name, turn in FRAMES.items():
        tip, stored, spent = bent(name, turn)
        worst = max(worst, float(np.linalg.norm(turn.inv().apply(tip) - where)) / size)
        furthest = max(furthest, stored, key=lambda e: abs(e - energy))
        cpu += spent
    return [
        Measured("frame", level, spacing, "tip off", "1", worst, 0.0, cpu),
        Measured("frame", level, spacing, "bending energy", "nN um", furthest, energy, 0.0),
    ]


def _bent(
    folder: Path, assembly: tuple[Plan, FilamentSystem], force: FloatArray, length: float
) -> tuple[FloatArray, float, float]:
    """(tip, bending energy, processor seconds) of a cantilever under a dead tip force, at rest."""
    plan, system = assembly
    words = " ".join(f"{x:.17g}" for x in force)
    commands = [
        *free_right_end(plan),
        f"group tip id {bead_at(plan, length)}",
        f"fix load tip addforce {words}",
        "compute tip tip reduce ave x y z",
    ]
    slow = cantilever_frequency(length + 2 * plan.spacing, system.types[0]) / 1.5
    (*tip, energy), out = at_rest(folder, assembly, commands, "c_tip[*] v_stored_energy", slow, 1e-8)
    return np.array(tip), float(energy), out.time.cpu
