"""Where rod methods, starts, ghosts and platen speeds go wrong: small experiments for the stability maps."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cgfibre.build.bundle import BundleSpec, build_bundle
from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.cases.experiment import moved, planned, pressed_at
from cgfibre.cases.limits import AWAY, FREE, Bench, Point, Trial, bisect, filament_step, filament_trial
from cgfibre.engine.assemble import rest_bends
from cgfibre.errors import EngineError
from cgfibre.materials import MATERIALS
from cgfibre.mechanics import rod
from cgfibre.plan.model import Plan

D = 7.0


def straight(level: str, segments: int, spacing: float = D) -> tuple[Plan, FilamentSystem]:
    """One straight filament, not pulled, the real EA."""
    trial = filament_trial(
        level, spacing, {"assembly.length": f"{segments * spacing} um", "model.axial_softening": 1.0}
    )
    return trial.plan, trial.system


def dumped(path: Path) -> FloatArray:
    """(n_rows, n_columns) of the first frame of a dump."""
    first = path.read_text().split("ITEM: TIMESTEP\n")[1]
    return np.array([line.split() for line in first.splitlines()[8:]], dtype=float)


# --- dihedrals -------------------------------------------------------------------------------------------------------


def dihedral_step(plan: Plan, system: FilamentSystem) -> tuple[float, float]:
    """(bend rad a bead, limiting step us) of a chain with dihedrals: omega^2 = 64 GJ/(s^3 theta^2 m) and the chain."""
    f = system.types[0]
    theta = float(np.min(rest_bends(system)))
    s = float(np.min(system.bond_lengths()))
    mass = f.mass_per_length * s
    chain = rod.chain_frequency_squared(s, mass, f.EA, f.EI)
    return theta, 2 / math.sqrt(64 * f.GJ / (s**3 * theta**2 * mass) + float(chain))


def dihedral_against_bend(bench: Bench, turns: Sequence[float] = (0.4, 0.55, 0.75, 1.0, 1.5)) -> Iterator[Point]:
    """Time step limit of a helix with dihedrals against its bend a bead; used: the plan's step, which is refused."""
    length = 40 * D
    for turn in turns:
        plan, one = straight("chain", 40)
        spec = BundleSpec(one.types[0], np.array([[28.0, 0.0]]), plan.beads.stations, twist=turn / length)
        system = build_bundle(spec, np.random.default_rng(0))
        theta, predicted = dihedral_step(plan, system)
        used = plan.timestep
        # below what the assembler refuses; the trial's own step goes to the deck as a variable
        trial = Trial(replace(plan, torsion="dihedral", timestep=predicted / 2), system, amplitude=1e-7)
        found = trial.limit(bench, predicted)
        yield Point("helix, s = D", theta, found, predicted, bench.lap(), used)


# --- angle harmonic --------------------------------------------------------------------------------------------------


def hinge_stiffness(bench: Bench, style: str, bend: float) -> float:
    """Moment of one hinge bent by ``bend`` rad over EI/s times it, by the force on its bead; bonds not stretched."""
    plan, system = straight("chain", 6)
    f = system.types[0]
    away = np.abs(system.positions[:, 0] - 3 * D)
    positions = np.column_stack(
        [
            3 * D + np.sign(system.positions[:, 0] - 3 * D) * away * math.cos(bend / 2),
            np.zeros(7),
            away * math.sin(bend / 2),
        ]
    )
    system = replace(system, positions=positions)
    commands = ["dump force all custom 1000 force.txt id fz", "dump_modify force sort id format float %.15g"]
    if style == "harmonic":
        commands += ["angle_style harmonic", f"angle_coeff * {f.EI / D / 2:.17g} 180.0"]
    out = bench.run(system, moved(plan, 1e-9, 20, sample=20), commands, **AWAY)
    force = dumped(out.folder / "force.txt")[3, 1]
    return float(force / (2 * f.EI / D**2 * bend * math.cos(bend / 2)))


#: below this sine the engine's angle harmonic divides by it instead
ENGINE_SMALL = 1e-3


def hinge_against_bend(
    bench: Bench, bends: Sequence[float] = (1e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 0.1, 0.5, 1.0)
) -> Iterator[Point]:
    """Stiffness of a hinge over EI/s against its bend: cosine sin(x)/x, harmonic min(1, x/0.001)."""
    for style in ("cosine", "harmonic"):
        for bend in bends:
            exact = math.sin(bend) / bend if style == "cosine" else min(1.0, math.sin(bend) / ENGINE_SMALL)
            yield Point(f"angle {style}", bend, hinge_stiffness(bench, style, bend), exact, bench.lap())


# --- rods ------------------------------------------------------------------------------------------------------------


def twist_torque(
    bench: Bench,
    direction: FloatArray,
    turn: float,
    axis: FloatArray | None = None,
    commands: Sequence[str] = (),
) -> float:
    """Torque on a bead turned by ``turn`` over the stiffness of its two bonds; the rod along ``direction``.

    About the rod's own axis 2 GJ/s, about another one across it 2 EI/s and the shear ks s^2/2.
    """
    plan, system = straight("rod", 8)
    f = system.types[0]
    middle = len(system.positions) // 2
    along = system.positions[:, 0] - system.positions[middle, 0]
    positions = along[:, None] * direction
    reach = float(np.max(np.abs(positions))) + 4 * D
    box = np.column_stack([np.full(3, -reach), np.full(3, reach)])
    system = replace(system, positions=positions, box=box)
    if commands:  # what puts the rod upright
        direction = np.round(direction)
    x, y, z = direction if axis is None else axis
    c = rod.rod_coefficients(D, f.EA, f.EI, f.GJ, f.kGA)
    stiffness = 2 * f.GJ / D if axis is None else float(2 * c.kb + c.ks * D**2 / 2)
    out = bench.run(
        system,
        moved(plan, 1e-9, 20, sample=20),
        [
            *commands,
            f"group held id {middle + 1}",
            f"set group held quat {x:.17g} {y:.17g} {z:.17g} {math.degrees(turn):.17g}",
            "compute torque all property/atom tqx tqy tqz",
            "dump torque all custom 1000 torque.txt id c_torque[*]",
            "dump_modify torque sort id format float %.15g",
        ],
        **AWAY,
        **FREE["rod"],
    )
    torque = dumped(out.folder / "torque.txt")[middle, 1:]
    return float(-torque @ np.array([x, y, z]) / stiffness)


def torsion_against_tilt(
    bench: Bench, tilts: Sequence[float] = (1e-16, 1e-11, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-3, 0.1)
) -> Iterator[Point]:
    """Torsional stiffness of a rod along z over GJ/s against its tilt from z (1e-16: none), tags rising or falling."""
    for series, sign in (("tags rising along +z", 1.0), ("tags falling along +z", -1.0)):
        for tilt in tilts:
            # such rods are refused as built: that one is built tilted and put upright afterwards
            x = 1e-6 if tilt < 1e-15 else math.sin(tilt)
            direction = sign * np.array([x, 0.0, math.sqrt(1 - x**2)])
            upright = ("set group all x 0",) if tilt < 1e-15 else ()
            yield Point(series, tilt, twist_torque(bench, direction, 0.1, commands=upright) / 0.1, 1.0, bench.lap())


def torsion_against_turn(
    bench: Bench, turns: Sequence[float] = (0.5, 1.5, 2.5, 3.1, 3.2, 4.0, 5.0, 6.2, 6.4, 7.0, 8.0)
) -> Iterator[Point]:
    """Torque of a bond over its stiffness (rad) against its turn: linear as it should be, twist to 2 pi, bending to pi.

    Twist is known by half its angle and its sense, so 2 pi is lost beyond 2 pi; of bending only the cosine is.
    """
    along, across = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    for turn in turns:
        yield Point("twist", turn, twist_torque(bench, along, turn), turn, bench.lap())
    for turn in turns:
        yield Point("bending", turn, twist_torque(bench, along, turn, across), turn, bench.lap())


def damped_rod_step(trial: Trial, damping: float) -> float:
    """Limit of a rod whose bonds are damped by this part of critical, us: the least over its stiffest modes."""
    plan, f = trial.plan, trial.system.types[0]
    s = float(np.diff(plan.beads.stations)[0])
    mass = f.mass_per_length * s
    inertia = rod.SPHERE_INERTIA * mass * f.diameter**2
    c = rod.rod_coefficients(s, f.EA / plan.axial_softening, f.EI, f.GJ, f.kGA)
    return min(
        float(rod.damped_time_step(lever * k / m, lever * damping * math.sqrt(k * own) / m))
        for k, lever, m, own in (
            (c.kr, 4.0, mass, mass),
            (c.ks, 4.0, mass, mass),
            (c.ks, s**2, inertia, mass),
            (c.kt, 4.0, inertia, inertia),
            (c.kb, 4.0, inertia, inertia),
        )
    )


def step_against_rod_damping(
    bench: Bench,
    dampings: Sequence[float] = (0.01, 0.05, 0.1, 0.2, 0.5, 1.0),
    diameters: Sequence[float] = (7.0, 300.0),
) -> Iterator[Point]:
    """Time step limit of a rod against the damping of its bonds, for thin and thick filaments alike."""
    for diameter in diameters:
        for damping in dampings:
            changes = {"filament.diameter": f"{diameter} um", "model.axial_softening": 1.0}
            trial = filament_trial("rod", diameter, changes)
            trial = replace(trial, variables={"rod_damping": damping})
            predicted = damped_rod_step(trial, damping)
            found = trial.limit(bench, predicted)
            yield Point(f"D = {diameter:g} um", damping, found, predicted, bench.lap(), trial.plan.timestep)


#: kinetic energy of a burst rod over that at the end of loading, for the picture
LOST = 1e6


def twisted_and_bent(bench: Bench, damping: float, turn: float = 0.25) -> float:
    """Kinetic energy at the end of a hold over that at its start: a rod twisted by ``turn`` rad a bond and bent, let
    go."""
    plan, system = straight("rod", 20)
    length, load = 20 * D, 4000
    plan = pressed_at(plan, length / 2 - 0.1, length / 2 + 0.1)
    plan = moved(plan, 2.0 / load / plan.timestep, load, 16000, sample=500)
    middle = system.n_beads // 2 + 1
    turned = f"{math.degrees(turn)}*({middle - 1}-abs(id-{middle}))*(id<={system.n_beads})"
    commands = [f"variable turned atom {turned}", "set group turning quat 1 0 0 v_turned"]
    try:
        out = bench.run(
            system, plan, commands, platen_bottom_um=-1000.0, turning_drag=0.0, drag=0.0, rod_damping=damping
        )
    except EngineError:
        return LOST
    kinetic = out.record.mean["kinetic"]
    return float(kinetic[-1] / kinetic[8])


def energy_against_damping(
    bench: Bench, dampings: Sequence[float] = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 0.02, 0.05, 0.1)
) -> Iterator[Point]:
    """Growth of the kinetic energy of a twisted and bent rod at rest against the damping of its bonds.

    Predicted: what decays at least at the rate of the slowest mode, that of twist along the rod, omega_1 zeta_1 with
    zeta_1 = zeta omega_1/omega_bond: hardly anything, 1.
    """
    for damping in dampings:
        yield Point("rod, s = D", damping, twisted_and_bent(bench, damping), 1.0, bench.lap(), math.nan)


def axial_stiffness(bench: Bench, stiffening: float, excluded: bool) -> tuple[float, float]:
    """(stiffness over EA in compression, contact 4 s kn over EA) of a chain of s = D/2; contacts within it or not."""
    plan, system = straight("chain", 40, D / 2)
    f = system.types[0]
    c = plan.contact
    kn = c.line_stiffness * D / 2 * stiffening
    plan = replace(plan, contact=replace(c, kn=kn, kt=0.8 * kn, gamma=0.0, softening=1.0))
    strain, length = 1e-4, 20 * D
    commands = [
        *([] if excluded else ["special_bonds lj 0 1 1 coul 0 1 1", "neigh_modify exclude none"]),
        f"displace_atoms all ramp x 0 {-strain * length} x 0 {length} units box",
        "unfix hold_left",
        "group half id 1:20",
        "compute cut half reduce sum fx",
        'fix cut all ave/time 20 1 20 c_cut file cut.txt format " %.15g"',
    ]
    out = bench.run(system, moved(plan, 1e-9, 20, sample=20), commands, drag=0.0, timestep_us=1e-12, **AWAY)
    return float(-out.rows("cut.txt")[0, 1] / (f.EA * strain)), 2 * D * kn / f.EA


def axial_against_contact(
    bench: Bench, stiffenings: Sequence[float] = (0.1, 1.0, 10.0, 55.0, 200.0)
) -> Iterator[Point]:
    """Stiffness in compression over EA against contact stiffness, 4 s kn/EA: doubled where that is 1."""
    for series, excluded in (("special_bonds 0 1 1 alone", False), ("exclude molecule/intra", True)):
        for stiffening in stiffenings:
            measured, ratio = axial_stiffness(bench, stiffening, excluded)
            yield Point(series, ratio, measured, 1.0 if excluded else 1 + ratio, bench.lap())


# --- start under tension ---------------------------------------------------------------------------------------------


def pulled(bench: Bench, tension: float, sudden: bool) -> float:
    """Largest kinetic energy over P^2 L/EA of a filament that starts with its tension built in, or pulled suddenly."""
    changes = {"assembly.length": f"{40 * D} um", "model.axial_softening": 1.0}
    trial = filament_trial("chain", D, changes | {"ends.tension": "0 nN" if sudden else f"{tension} nN"})
    plan, system = trial.plan, trial.system
    out = bench.run(
        system,
        moved(plan, 1e-9, 200, sample=20),
        ['fix energy all ave/time 1 1 1 v_kinetic_energy file energy.txt format " %.15g"'],
        drag=0.0,
        end_load_nN=tension,
        **AWAY,
    )
    return float(np.max(out.rows("energy.txt")[:, 1]) / (tension**2 * 40 * D / system.types[0].EA))


def kinetic_against_tension(bench: Bench, tensions: Sequence[float] = (4e4, 4e5, 4e6, 4e7)) -> Iterator[Point]:
    """Largest kinetic energy over the work of the load, P^2 L/EA, against the tension (cN): a half where sudden."""
    for series, sudden in (("sudden", True), ("built in: r0 = s/(1 + P/EA)", False)):
        for tension in tensions:
            found = max(pulled(bench, tension, sudden), 1e-30)
            yield Point(series, tension * 1e-7, found, 0.5 if sudden else math.nan, bench.lap())


# --- ghosts ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Shared:
    """A filament of bonds of ``spacing`` um on two ranks, whose common border meets a bead or the middle of a bond."""

    level: str
    spacing: float
    at_bead: bool

    def kinetic(self, bench: Bench, ranks: int, cutoff: float) -> FloatArray:
        """Kinetic energy over 100 steps after a shake, nN um; ghosts are known up to ``cutoff`` um."""
        trial = filament_trial(self.level, self.spacing, {"model.axial_softening": 1.0})
        segments = 20 if self.at_bead else 21
        plan, system = straight(self.level, segments, self.spacing)
        variables: dict[str, Any] = {**AWAY, **FREE[self.level], **trial.variables}
        out = bench.run(
            system,
            moved(plan, 1e-9, 100, sample=20),
            ["displace_atoms all random 1e-3 1e-3 1e-3 20141 units box"],
            ranks=ranks,
            ghost_cutoff_um=cutoff,
            ranks_along_x=ranks,
            **variables,
        )
        return out.record.mean["kinetic"]

    def least_cutoff(self, bench: Bench, guess: float) -> tuple[float, int]:
        """(least reach of ghosts um for which two ranks find what one does, trials that ended well but were wrong)."""
        right = self.kinetic(bench, 1, 10 * self.spacing)
        silent = 0

        def fails(cutoff: float) -> bool:
            nonlocal silent
            try:
                found = self.kinetic(bench, 2, cutoff)
            except EngineError:
                return True
            wrong = not np.allclose(found, right, rtol=1e-6)
            silent += wrong
            return wrong

        return bisect(fails, guess, within=0.02), silent


def ghosts_against_spacing(bench: Bench, ratios: Sequence[float] = (4.0, 8.0)) -> Iterator[Point]:
    """Least reach of ghosts (um) against s/D; used: the deck's 2.5 s + D + 2 um.

    A chain's owner of an angle is its middle bead, so s beyond a bead on the border (s/2 beyond a border at mid-bond)
    is enough; rods want one bond more.
    """
    for level in ("chain", "rod"):
        for at_bead in (True, False):
            for ratio in ratios:
                s = ratio * D
                # a rod's bending energy is that of angles that every rank counts for its own beads at their ends
                exact = s * ((1.0 if at_bead else 0.5) + (level == "rod"))
                found, silent = Shared(level, s, at_bead).least_cutoff(bench, exact)
                name = f"{level}, border at {'a bead' if at_bead else 'mid-bond'}"
                name += f" ({silent} trials silently wrong)" if silent else ""
                yield Point(name, ratio, found, exact, bench.lap(), 2.5 * s + D + 2)


# --- platen speed ----------------------------------------------------------------------------------------------------

BUNDLE = {
    "assembly.count": 7,
    "assembly.length": "0.14 mm",
    "assembly.jitter": "0.01 um",
    "platens.width": "70 um",
    "platens.friction": 0.3,
    "platens.stop.displacement": "4 um",
    "output.samples": 80,
}


def bundle_force(bench: Bench, speed: float, depths: FloatArray) -> tuple[FloatArray, float]:
    """(force nN of seven filaments at the platen's ``depths`` um, impedance nN us/um of the plan's speed bound)."""
    plan, system = planned({**BUNDLE, "platens.speed": f"{speed} m/s"})
    out = bench.run(system, plan)
    m = out.record.mean
    impedance = plan.motion.quasi_static_impedance * 0.05  # at the accuracy of the scene
    return np.interp(depths, m["displacement"], m["top_force"]), impedance


def force_against_speed(
    bench: Bench, speeds: Sequence[float] = (16.0, 8.0, 4.0, 2.0, 1.0, 0.5, 0.25)
) -> Iterator[Point]:
    """Change of the force on halving the platen's speed, mean over 2 to 4 um, against the speed; predicted: the
    plan's bound, eps = v k/(omega F) or v sqrt(kn m)/F."""
    depths = np.linspace(2.0, 3.9, 20)
    fast, impedance = bundle_force(bench, speeds[0], depths)
    for speed in speeds:
        slow, _ = bundle_force(bench, speed / 2, depths)
        error = float(np.mean(np.abs(fast - slow)) / np.mean(slow))
        predicted = impedance * speed / float(np.mean(slow))
        yield Point("7 filaments, chain", speed, error, predicted, bench.lap())
        fast = slow


# --- materials -------------------------------------------------------------------------------------------------------

#: materials of the maps: soft, brittle, stiff, metal, and a yarn made homogeneous whose shear is 4000 times softer
FIBRES = ("nylon", "E-glass", "steel wire", "T700 carbon", "E-glass yarn")


def of_material(level: str, material: str, shear: float | None = None, softening: float = 1e6) -> Trial:
    """One filament of a material of :data:`FIBRES`, s = D; ``shear`` kPa in the place of its G12."""
    changes: dict[str, object] = {
        "filament.material": material,
        "model.axial_softening": 1.0,
        "contact.softening": softening,
    }
    if shear is not None:
        changes["filament.G12"] = f"{shear} kPa"
    return filament_trial(level, MATERIALS[material].diameter, changes)


def steps_of_materials(bench: Bench, ratios: Sequence[float] = (0.1, 1.0, 10.0, 100.0, 1e3, 1e4)) -> Iterator[Point]:
    """Time step limit against EI/GJ, over its closed form: carbon's E1 with another G12, and real materials."""
    for level in ("chain", "rod"):
        for name in FIBRES:
            trial = of_material(level, name)
            f = trial.system.types[0]
            predicted = filament_step(trial)
            found = trial.limit(bench, predicted)
            yield Point(f"{level}, {name}", f.EI / f.GJ, found, predicted, bench.lap(), trial.plan.timestep)
    for ratio in ratios:
        trial = of_material("rod", "T700 carbon", MATERIALS["T700 carbon"].E1 / 2 / ratio)
        predicted = filament_step(trial)
        found = trial.limit(bench, predicted)
        yield Point("rod, carbon with another G12", ratio, found, predicted, bench.lap(), trial.plan.timestep)


def mid_span_compliance(bench: Bench, trial: Trial) -> tuple[float, float]:
    """(compliance um/nN, its closed form) of the trial's filament pressed at mid-span; held until it rests."""
    plan, system, f = trial.plan, trial.system, trial.system.types[0]
    length = float(plan.beads.stations[-1])
    plan = pressed_at(plan, length / 2 - 0.1, length / 2 + 0.1)
    chain = plan.level == "chain"
    stop = (1.5e-2 if chain else 3e-2) * f.diameter
    # its first frequency with shear sets the drag; a soft shear takes longer to come to rest
    kGA = math.inf if chain else f.kGA
    exact = float(rod.platen_compliance(length, f.EI, kGA=kGA))
    stiff = float(rod.platen_compliance(length, f.EI))
    frequency = float(rod.bending_frequency(length, f.EI, f.mass_per_length)) * math.sqrt(stiff / exact)
    load = 5000
    hold = math.ceil(16 / frequency / plan.timestep / 1000) * 1000
    plan = moved(plan, stop / load / plan.timestep, load, max(hold, 10000))
    out = bench.run(
        system, plan, drag=2 * frequency * float(np.median(plan.beads.mass)), platen_bottom_um=-1e3 * f.diameter
    )
    force = out.record.mean["top_force"][-1]
    travel = out.record.mean["displacement"][-1]
    return float((travel - force / plan.platens.kn) / force), exact


def deflections_of_materials(bench: Bench, ratios: Sequence[float] = (0.1, 1.0, 10.0, 100.0, 1e3)) -> Iterator[Point]:
    """Mid-span deflection over its closed form against EI/GJ, L = 20 D; chains 1 + 2 (s/L)^2, rods 1."""
    cases: list[tuple[str, str, float | None]] = [(level, name, None) for level in ("chain", "rod") for name in FIBRES]
    cases += [("rod", "T700 carbon", ratio) for ratio in ratios]
    for level, name, ratio in cases:
        trial = of_material(level, name, None if ratio is None else MATERIALS[name].E1 / 2 / ratio, softening=1.0)
        f = trial.system.types[0]
        measured, exact = mid_span_compliance(bench, trial)
        series = f"{level}, {name}" if ratio is None else "rod, carbon with another G12"
        stated = 1 + 2 / 20**2 if level == "chain" else 1.0
        yield Point(series, f.EI / f.GJ, measured / exact, stated, bench.lap())
