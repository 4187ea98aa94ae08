"""A flat tow as a ribbon of joined chains against closed forms: bending both ways, twist, energy, momentum.

Three carbon filaments side by side stand for the chains, far enough apart not to touch; ``spacing`` is s/D. The ribbon
floats: what loads it is in balance. Two cantilevers back to back need no clamp.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.cases.capsule_ranks import states
from cgfibre.cases.experiment import Measured, moved, planned, run, run_on
from cgfibre.cases.rods import AWAY, D, at_rest, chain_trapezium
from cgfibre.mechanics.ribbon import twisting_moment
from cgfibre.plan.model import LEFT, RIGHT, Plan, Ribbon
from cgfibre.plan.ribbons import ribbon_bound

CHAINS, APART = 3, 20.0  # um from chain to chain
OFFSETS = APART * (np.arange(CHAINS) - (CHAINS - 1) / 2)
#: rigidities over those of the filaments together: bending in the plane, and twist
IN_PLANE, TWIST = 20.0, 1.0
#: nN/um, modulus across times thickness: 20 MPa over D
ACROSS = 2e4 * D
LENGTH = 40.0  # of a cantilever, over D
SAFETY = 0.9
STEPS = 4000


@dataclass(frozen=True)
class Rigidities:
    """Of the whole ribbon: EI out of its plane and in it, GJ, nN um2."""

    out: float
    within: float
    twist: float


def ribbon(spacing: float, length: float, reach: int = 1) -> tuple[Plan, FilamentSystem, Rigidities]:
    """Plan, system and rigidities of a free ribbon of ``length`` D, turns in its plane over ``reach`` segments."""
    plan, one = planned(
        {
            "model.level": "chain, capsules",
            "model.spacing": f"{spacing * D:.17g} um",
            "model.axial_softening": 1.0,
            "assembly.length": f"{length * D:.17g} um",
            "ends.tension": "0 nN",
        }
    )
    n = one.n_beads
    box = one.box.copy()
    box[1:] = -length * D, length * D  # room: the deck takes a box that grows tenfold for beads that flew apart
    system = replace(
        one,
        positions=np.concatenate([one.positions + np.array([0.0, y, 0.0]) for y in OFFSETS]),
        filament_start=n * np.arange(CHAINS + 1),
        closed=np.zeros(CHAINS, dtype=bool),
        tow=np.zeros(CHAINS, dtype=np.int64),
        filament_type=np.zeros(CHAINS, dtype=np.int64),
        prestrain=np.zeros(CHAINS),
        box=box,
    )
    f = system.types[0]
    all_of = Rigidities(CHAINS * f.EI, IN_PLANE * CHAINS * f.EI, TWIST * CHAINS * f.GJ)
    joints = Ribbon((ACROSS,), (all_of.within - all_of.out,), (all_of.twist,), (reach,))
    mass = np.tile(plan.beads.mass, CHAINS)
    added = float(np.max(np.sum(ribbon_bound(system, joints), axis=0) / mass))
    limit = 2 / math.sqrt((2 / plan.timestep_limit) ** 2 + added)
    return replace(plan, ribbon=joints, timestep=SAFETY * limit, timestep_limit=limit), system, all_of


def free(plan: Plan) -> list[str]:
    """Commands that take the supports away and give the ends, which are lighter, a drag in proportion."""
    mass = plan.beads.mass
    lighter = float(np.mean(mass[np.isin(plan.beads.role, (LEFT, RIGHT))]) / np.median(mass))
    return [
        "unfix hold_left",
        "unfix hold_right",
        "group ends union left right",
        f"fix end_drag ends viscous $({lighter:.17g}*v_drag)",
    ]


def station(plan: Plan, name: str, *x: float) -> str:
    """Command that makes a group of the beads of all chains at places x, um."""
    n = len(plan.beads.stations)
    at = [int(np.argmin(np.abs(plan.beads.stations - one))) for one in x]
    return f"group {name} id " + " ".join(str(k * n + a + 1) for k in range(CHAINS) for a in at)


def beam(segments: int, spacing: float, EI: float, more: float, reach: int) -> float:
    """Deflection (um/nN) of the tips of two cantilevers back to back, ``segments`` long each, under a force on each
    tip, as the deck's beads have it.

    Hinges EI/s at every bead, and turns over chords of ``reach`` segments with stiffness ``more`` s/h^2.
    """
    n = 2 * segments + 1
    whole = np.zeros((n, n))
    for r, stiffness in ((1, EI / spacing), (reach, more / (reach**2 * spacing))):
        for i in range(r, n - r):
            turn = np.zeros(n)
            turn[[i - r, i, i + r]] = np.array([1.0, -2.0, 1.0]) / (r * spacing)
            whole += stiffness * np.outer(turn, turn)
    load = np.zeros(n)
    load[[0, segments, -1]] = 1.0, -2.0, 1.0
    w = np.linalg.lstsq(whole, load, rcond=None)[0]
    return float((w[0] + w[-1]) / 2 - w[segments])


def cantilevers(folder: Path, level: str, spacing: float, way: str = "z", reach: int = 1) -> list[Measured]:
    """Two cantilevers back to back, a tip force each along z (out of the plane) or y (in it): P L^3/(3 EI).

    A chain's trapezium rule errs by (s/L)^2/2; with turns over longer chords the error is that of :func:`beam`.
    """
    plan, system, EI = ribbon(spacing, 2 * LENGTH, reach)
    L, own = LENGTH * D, {"z": EI.out, "y": EI.within}[way]
    force = L / 500 * 3 * own / L**3
    push = {"z": "0 0 {:.17g}", "y": "0 {:.17g} 0"}[way]
    commands = [
        *free(plan),
        station(plan, "tips", 0.0, 2 * L),
        station(plan, "middle", L),
        "fix load tips addforce " + push.format(force / CHAINS),
        "fix back middle addforce " + push.format(-2 * force / CHAINS),
        f"compute tips tips reduce ave {way}",
        f"compute middle middle reduce ave {way}",
    ]
    slowest = (4.730041 / (2 * L)) ** 2 * math.sqrt(own / (CHAINS * system.types[0].mass_per_length))
    (tip, middle), out = at_rest(folder, (plan, system), commands, "c_tips c_middle", slowest, 1e-7)
    exact = force * L**3 / (3 * own)
    if way == "z":
        stated = chain_trapezium(spacing, LENGTH) / 2
    else:
        n = round(LENGTH / spacing)
        stated = beam(n, spacing * D, EI.out, EI.within - EI.out, reach) * force / exact - 1
    case = {"z": "ribbon bent out of its plane", "y": "ribbon bent in its plane"}[way]
    return [Measured(case, level, spacing, "deflection", "um", tip - middle, exact, out.time.cpu, stated)]


def twisted(folder: Path, level: str, spacing: float) -> list[Measured]:
    """Couples at the ends of a free ribbon: it turns by T L/GJ, at every spacing; chains that may slide add nothing."""
    plan, system, rigid = ribbon(spacing, LENGTH)
    L, width = LENGTH * D, (CHAINS - 1) * APART
    angle = 1e-3
    pull = angle * rigid.twist / L / width
    n = len(plan.beads.stations)
    last = (CHAINS - 1) * n
    corners = {"a": 1, "b": n, "c": last + 1, "d": last + n}  # first and last bead of the first and the last chain
    commands = free(plan)
    for name, bead in corners.items():
        sign = 1 if name in "ad" else -1
        commands += [
            f"group {name} id {bead}",
            f"fix load_{name} {name} addforce 0 0 {sign * pull:.17g}",
            f"compute {name} {name} reduce ave z",
        ]
    slowest = math.pi / L * math.sqrt(rigid.twist / (system.types[0].mass_per_length * 2 * APART**2))
    z, out = at_rest(folder, (plan, system), commands, "c_a c_b c_c c_d", slowest, 1e-7)
    found = math.asin((z[0] - z[2]) / width) + math.asin((z[3] - z[1]) / width)
    return [Measured("ribbon twisted", level, spacing, "turn", "rad", found, angle, out.time.cpu)]


def held_and_twisted(folder: Path, level: str, spacing: float) -> list[Measured]:
    """Energy of a ribbon that is given an even twist, its chains' ends at their distance: int M dtau over its length.

    A fifth of it from chains that become helices (Wagner), the rest from GJ. The beads at the ends have no hinges: half
    a segment of the bending is missing at each.
    """
    plan, system, rigid = ribbon(spacing, LENGTH)
    f, L = system.types[0], LENGTH * D
    twist = 0.5 * math.sqrt(4 * rigid.twist / (f.EA * float(np.sum(OFFSETS**4))))
    steps = np.linspace(0, twist, 2001)

    def energy(GJ: float, EA: float, EI: float) -> float:
        return float(np.trapezoid(twisting_moment(steps, GJ, OFFSETS, EA, EI), steps)) * L

    exact = energy(rigid.twist, f.EA, rigid.within / CHAINS)
    stated = -energy(0.0, 0.0, rigid.within / CHAINS) * spacing / LENGTH / exact
    commands = [
        f"variable offset atom {APART:.17g}*(mol-{(CHAINS + 1) / 2:g})",
        f"variable turned_y atom v_offset*cos({twist:.17g}*x)",
        f"variable turned_z atom v_offset*sin({twist:.17g}*x)",
        "set group all y v_turned_y z v_turned_z",
        "run 0 post no",
        'print "$(c_stored:%.17g)" file energy.txt',
    ]
    out = run(folder, system, moved(plan, 1e-9, 20, sample=20), commands, **AWAY)
    found = float(out.rows("energy.txt")[0, 0])
    case = "ribbon twisted, ends held"
    return [Measured(case, level, spacing, "energy", "nN um", found, exact, out.time.cpu, stated)]


def let_go(folder: Path, level: str, spacing: float, refine: int = 1) -> list[Measured]:
    """A free ribbon thrown into bending in both planes and twist: its energy, kinetic and stored, stays.

    Leapfrog's own energy differs by (omega dt)^2/8 of its fastest modes'; ``refine`` divides the time step.
    """
    plan, system, rigid = ribbon(spacing, LENGTH, 2)
    plan = replace(plan, timestep=plan.timestep / refine)
    L = LENGTH * D
    speed = 0.02 * L * (math.pi / L) ** 2 * math.sqrt(rigid.out / (CHAINS * system.types[0].mass_per_length))
    commands = [
        "unfix hold_left",
        "unfix hold_right",
        f"variable vy atom {speed:.17g}*cos(2*PI*x/{L:.17g})",
        f"variable vz atom {speed:.17g}*(cos(2*PI*x/{L:.17g})+y/{APART:.17g}*cos(PI*x/{L:.17g}))",
        "velocity all set NULL v_vy v_vz",
    ]
    steps = STEPS * refine
    out = run(folder, system, moved(plan, 1e-9, steps, sample=steps // 20), commands, drag=0.0, **AWAY)
    energy = out.record.mean["kinetic"] + out.record.mean["stored"]
    drift = float(np.mean(energy[-5:]) / np.mean(energy[:5]) - 1)
    scatter = float(np.ptp(energy) / np.mean(energy))
    return [
        Measured("ribbon let go", level, spacing, "drift", "", drift, 0.0, out.time.cpu),
        Measured("ribbon let go", level, spacing, "scatter of energy", "", scatter, 0.0, 0.0),
    ]


def crooked(
    folder: Path, plan: Plan, system: FilamentSystem, size: float = 1.0, ranks: int = 1
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """((n_beads, 3) positions um, forces nN; virial xx, yy, zz, xy, xz, yz nN um) of a free ribbon whose beads are
    displaced by up to ``size`` um at random."""
    out = run_on(
        ranks,
        folder,
        system,
        moved(plan, 1e-9, 20, sample=20),
        [
            "unfix hold_left",
            "unfix hold_right",
            f"displace_atoms all random {size} {size} {size} 4711",
            "dump forces all custom 20 forces.txt id xu yu zu fx fy fz",
            'dump_modify forces sort id format float "%.17g"',
            "compute virial all pressure NULL bond angle dihedral improper",
            "run 0 post no",
            'print "$(vol*c_virial[1]:%.17g) $(vol*c_virial[2]:%.17g) $(vol*c_virial[3]:%.17g) &\n'
            '  $(vol*c_virial[4]:%.17g) $(vol*c_virial[5]:%.17g) $(vol*c_virial[6]:%.17g)" file virial.txt',
        ],
        AWAY,
    )
    rows = states(out.folder / "forces.txt")[0]
    return rows[:, :3], rows[:, 3:], out.rows("virial.txt")[0]


def joints_alone(plan: Plan, system: FilamentSystem) -> tuple[Plan, FilamentSystem]:
    """The same without a stiffness of the chains themselves: forces are those of the joints."""
    f = system.types[0]
    hinge = np.zeros_like(plan.beads.hinge)
    return replace(plan, beads=replace(plan.beads, hinge=hinge)), replace(system, types=(replace(f, EA=1e-30),))
