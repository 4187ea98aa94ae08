"""One filament against closed forms: statics by critical drag, free vibration, torsion, curved rest shapes.

Every case takes a folder, the level and s/D, and runs the level's own deck on one carbon filament with its real EA;
loads and other ends are commands of the experiment's own. ``stated`` is what theory says of the method itself at this
spacing: discrete chains solved by hand, see each case.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import curve_fit

from cgfibre.build.system import FilamentSystem, FilamentType, FloatArray
from cgfibre.cases.experiment import Measured, Outcome, moved, planned, pressed_at, run
from cgfibre.mechanics import rod, support
from cgfibre.plan.model import LEFT, RIGHT, Plan

D = 7.0  # um, diameter of experiment.SCENE's filament
#: platens far from the filament, and few neighbour bins in the wide boxes of experiments
AWAY = {"platen_top_um": 1000.0, "platen_bottom_um": -1000.0, "bin_um": 4 * D}
ROWS = 20  # of what a static experiment writes


def filament(
    level: str, spacing: float, length: float, changes: Mapping[str, object] | None = None
) -> tuple[Plan, FilamentSystem]:
    """Plan and system of one filament of ``length`` diameters, beads s/D = ``spacing`` apart, real EA, no end load."""
    own: dict[str, object] = {
        "model.level": level,
        "model.spacing": f"{spacing * D:.17g} um",
        "model.axial_softening": 1.0,
        "assembly.length": f"{length * D:.17g} um",
        "ends.tension": "0 nN",
    }
    return planned(own | dict(changes or {}))


def critical_drag(plan: Plan, frequency: float) -> float:
    """Drag on a bead that damps the mode of this angular frequency critically, nN us/um."""
    return 2 * frequency * float(np.median(plan.beads.mass))


def settling_steps(plan: Plan, frequency: float, tolerance: float) -> int:
    """Steps after which a critically damped mode is within ``tolerance`` of rest: (1 + x) exp(-x) = tolerance."""
    x = -math.log(tolerance)
    x += math.log(1 + x + math.log(1 + x))
    sample = 20 * ROWS
    return math.ceil(x / frequency / plan.timestep / sample) * sample


def at_rest(
    folder: Path,
    assembly: tuple[Plan, FilamentSystem],
    commands: Sequence[str],
    probes: str,
    frequency: float,
    tolerance: float = 1e-6,
    **variables: float | str,
) -> tuple[FloatArray, Outcome]:
    """(values of ``probes`` at rest, outcome): run with the drag that damps ``frequency`` critically until it is there.

    ``probes`` are the engine's names of global values, c_x v_y f_z[1]. Raises RuntimeError when they still move: their
    last two rows, a twentieth of the run apart, differ by a thousandth (and by more than 1e-8 of the largest).
    """
    plan, system = assembly
    steps = settling_steps(plan, frequency, tolerance)
    plan = moved(plan, 1e-9, steps, sample=steps // ROWS)
    probe = (
        f"fix probe all ave/time {steps // ROWS} 1 {steps // ROWS} {probes} file probe.txt "
        'format " %.17g"'  # of everything that the experiment reads
    )
    out = run(
        folder,
        system,
        plan,
        [*commands, probe],
        **({"drag": critical_drag(plan, frequency)} | AWAY | variables),
    )
    rows = out.rows("probe.txt")[:, 1:]
    if np.any(np.abs(rows[-1] - rows[-2]) > 1e-3 * np.abs(rows[-1]) + 1e-8 * np.max(np.abs(rows))):
        raise RuntimeError(f"not at rest: {rows[-2].tolist()} and {rows[-1].tolist()}")
    return rows[-1], out


def bead_at(plan: Plan, x: float) -> int:
    """The engine's number of the bead at x um of one filament alone."""
    return int(np.argmin(np.abs(plan.beads.stations - x))) + 1


def end_drag(plan: Plan) -> list[str]:
    """Commands for the drag on a right end that is free, in proportion to its mass."""
    lighter = float(np.mean(plan.beads.mass[plan.beads.role == RIGHT]) / np.median(plan.beads.mass))
    drag = [f"fix end_drag right viscous $({lighter:.17g}*v_drag)"]
    if plan.level == "chain":
        return drag
    return [*drag, f"fix end_turning_drag right viscous/sphere $({lighter:.17g}*v_turning_drag)"]


def free_right_end(plan: Plan) -> list[str]:
    """Commands that turn a filament clamped at both ends into a cantilever; what lies beyond its end hangs along."""
    free = ["unfix hold_right", *end_drag(plan)]
    if plan.level == "chain":
        return free
    return [
        *free,
        "unfix slide",
        "unfix integrate",
        "group moving subtract all left",
        "fix integrate moving nve/bpm/sphere",
    ]


def cantilever_frequency(length: float, f: FilamentType) -> float:
    """First bending frequency of a cantilever of this length, rad/us."""
    return 1.875104**2 / length**2 * math.sqrt(f.EI / f.mass_per_length)


def chain_trapezium(spacing: float, length: float) -> float:
    """(s/L)^2 of the trapezium rule that a chain's hinges are."""
    return (spacing / length) ** 2


def _wall(level: str, f: FilamentType) -> float:
    """Shear stiffness that the level has: none given way to in a chain."""
    return f.kGA if level == "rod" else math.inf


# --- stretching and bending ------------------------------------------------------------------------------------------


def axial(folder: Path, level: str, spacing: float, length: float = 40.0) -> list[Measured]:
    """One end clamped, the other pulled to a strain of 1e-3: elongation F L/EA, exact at every spacing."""
    plan, system = filament(level, spacing, length, {"ends.support": "clamped"})
    f, L = system.types[0], length * D
    tip = bead_at(plan, L)
    force = 1e-3 * f.EA
    commands = [*free_right_end(plan), f"group tip id {tip}", f"fix load tip addforce {force:.17g} 0 0"]
    commands.append("compute tip tip reduce ave x")
    # the bead beyond the tip and the tip's whole mass slow it
    frequency = math.pi / 2 / (L + 2 * spacing * D) * math.sqrt(f.EA / f.mass_per_length)
    (x,), out = at_rest(folder, (plan, system), commands, "c_tip", frequency, 1e-10)
    exact = float(rod.axial_elongation(force, L, f.EA))
    return [Measured("axial", level, spacing, "elongation", "um", x - L, exact, out.time.cpu)]


def cantilever(folder: Path, level: str, spacing: float, length: float = 40.0) -> list[Measured]:
    """Tip force, deflection L/200: F L^3/(3 EI) and shear. A chain's trapezium rule errs by (s/L)^2/2."""
    plan, system = filament(level, spacing, length, {"ends.support": "clamped"})
    f, L = system.types[0], length * D
    force = L / 200 * 3 * f.EI / L**3
    z, out = _tip_loaded(folder, level, (plan, system), force, L)
    # the large deflection that is left: from the elastica, 2e-5 of the deflection
    exact = elastica_tip(force, L, f.EI, f.EA, _wall(level, f))[1]
    stated = chain_trapezium(spacing, length) / 2 if level == "chain" else 0.0
    return [Measured("cantilever", level, spacing, "deflection", "um", z[1], exact, out.time.cpu, stated)]


def elastica(folder: Path, level: str, spacing: float, length: float = 40.0, load: float = 10.0) -> list[Measured]:
    """Cantilever under a dead tip force F L^2/EI = ``load``: deflection and shortening against solve_bvp."""
    plan, system = filament(level, spacing, length, {"ends.support": "clamped"})
    f, L = system.types[0], length * D
    force = load * f.EI / L**2
    (x, z), out = _tip_loaded(folder, level, (plan, system), force, L)
    exact_x, exact_z = elastica_tip(force, L, f.EI, f.EA, _wall(level, f))
    return [
        Measured("elastica", level, spacing, "deflection", "um", z, exact_z, out.time.cpu),
        Measured("elastica", level, spacing, "shortening", "um", L - x, L - exact_x, 0.0),
    ]


def _tip_loaded(
    folder: Path, level: str, assembly: tuple[Plan, FilamentSystem], force: float, length: float
) -> tuple[FloatArray, Outcome]:
    """((x, z) of a cantilever's tip, outcome) under a vertical dead force there."""
    # the bead beyond the tip hangs along: a longer cantilever swings slower, never faster
    slow = cantilever_frequency(length + 2 * assembly[0].spacing, assembly[1].types[0])
    commands = [
        *free_right_end(assembly[0]),
        f"group tip id {bead_at(assembly[0], length)}",
        f"fix load tip addforce 0 0 {force:.17g}",
        "compute tip tip reduce ave x z",
    ]
    plan, system = assembly
    # room to bend into: the deck takes a box that grows tenfold for beads that flew apart
    box = system.box.copy()
    box[2] = -length, length
    return at_rest(folder, (plan, replace(system, box=box)), commands, "c_tip[*]", slow)


def elastica_tip(
    force: float, length: float, EI: float, EA: float = math.inf, kGA: float = math.inf
) -> tuple[float, float]:
    """(x, z) of the tip of a cantilever along x under a dead force along z: elastica with stretch and shear, um.

    Over the arc length S: EI theta' = M, M' = -F x', (x', z') = (1 + N/EA) t + Q/kGA n with the section's normal t
    = (cos theta, sin theta), N = F sin theta, Q = F cos theta; theta = x = z = 0 at 0, M = 0 at the tip. By
    scipy's solve_bvp, scaled with the length. Raises RuntimeError when it does not converge.
    """
    p = force * length**2 / EI

    def slopes(s: FloatArray, y: FloatArray) -> FloatArray:
        theta, moment = y[0], y[1]
        sine, cosine = np.sin(theta), np.cos(theta)
        stretch, shear = 1 + force * sine / EA, force * cosine / kGA
        dx, dz = stretch * cosine - shear * sine, stretch * sine + shear * cosine
        return np.vstack([moment, -p * dx, dx, dz])

    def ends(a: FloatArray, b: FloatArray) -> FloatArray:
        return np.array([a[0], b[1], a[2], a[3]])

    s = np.linspace(0, 1, 101)
    root = min(p, 3.0)
    guess = np.vstack([root * (s - s**2 / 2) / 3, root * (1 - s), s, s * 0.0])
    solution = solve_bvp(slopes, ends, s, guess, tol=1e-9, max_nodes=20000)
    if not solution.success:
        raise RuntimeError(f"elastica: {solution.message}")
    return float(solution.y[2, -1]) * length, float(solution.y[3, -1]) * length


def chain_compliance(n: int, at: int, spacing: float, EI: float, tension: float = 0.0) -> float:
    """Compliance of a simply supported chain of n bonds under tension, pushed at beads ``at`` and n - ``at`` by half a
    force each, um/nN.

    Sine modes diagonalise it: (2/n) sum over odd k of sin^2(k pi at/n)/(16 EI S^2/s^3 + 4 P S/s), S = sin^2(k pi/2 n).
    """
    k = np.arange(1, n, 2)
    S = np.sin(k * np.pi / (2 * n)) ** 2
    stiffness = 16 * EI * S**2 / spacing**3 + 4 * tension * S / spacing
    return float(np.sum(2 / n * np.sin(k * np.pi * at / n) ** 2 / stiffness))


def rod_compliance(n: int, at: int, spacing: float, f: FilamentType, tension: float = 0.0) -> float:
    """Compliance of a simply supported rod as :func:`chain_compliance`, um/nN.

    Small deflections w and turns v of its beads: ks (w_j - w_i - s (v_i + v_j)/2)^2/2 + kb (v_j - v_i)^2/2 + P/s
    (w_j - w_i)^2/2 a bond. The tension acts along the bond, as the engine's bpm bonds have it, on lengths stretched by
    1 + P/EA while the coefficients are those of the natural length.
    """
    natural = spacing / (1 + tension / f.EA)
    c = rod.rod_coefficients(natural, f.EA, f.EI, f.GJ, f.kGA)
    shear = np.array([-1.0, -spacing / 2, 1.0, -spacing / 2])
    turn, string = np.array([0.0, -1.0, 0.0, 1.0]), np.array([-1.0, 0.0, 1.0, 0.0])
    bond = float(c.ks) * np.outer(shear, shear) + float(c.kb) * np.outer(turn, turn)
    bond += tension / spacing * np.outer(string, string)
    whole = np.zeros((2 * n + 2, 2 * n + 2))
    for k in range(n):
        whole[2 * k : 2 * k + 4, 2 * k : 2 * k + 4] += bond
    load = np.zeros(2 * n + 2)
    np.add.at(load, [2 * at, 2 * (n - at)], 0.5)
    free = np.delete(np.arange(2 * n + 2), [0, 2 * n])
    deflection = np.linalg.solve(whole[np.ix_(free, free)], load[free])
    return float(deflection[np.searchsorted(free, 2 * at)])


def _of_level(level: str, n: int, at: int, spacing: float, f: FilamentType, tension: float) -> float:
    """Compliance of the level's own beads at this spacing, um/nN."""
    s = spacing * D
    return chain_compliance(n, at, s, f.EI, tension) if level == "chain" else rod_compliance(n, at, s, f, tension)


def three_point(
    folder: Path, level: str, spacing: float, length: float = 40.0, argument: float = 0.0
) -> list[Measured]:
    """Simply supported, mid-span force, deflection L/1000, pre-tensioned to (L/2) sqrt(P/EI) = ``argument``.

    A chain errs by 2 (s/L)^2 without tension (its trapezium rule), see chain_compliance. A rod's stiffness holds
    over its natural length, so stretched by e its EI counts as EI (1 + e).
    """
    L = length * D
    f = planned({})[1].types[0]
    P = f.EI * (2 * argument / L) ** 2
    plan, system = filament(level, spacing, length, {"ends.tension": f"{P:.17g} nN"})
    stretch = 1 + P / f.EA if level == "rod" else 1.0
    compliance = float(rod.platen_compliance(L, f.EI * stretch, tension=P, kGA=_wall(level, f)))
    force = L / 1000 / compliance
    commands = [
        f"group middle id {bead_at(plan, L / 2)}",
        f"fix load middle addforce 0 0 {force:.17g}",
        "compute middle middle reduce ave z",
    ]
    frequency = float(rod.bending_frequency(L, f.EI, f.mass_per_length, tension=P))
    (z,), out = at_rest(folder, (plan, system), commands, "c_middle", frequency)
    n = round(length / spacing)
    stated = _of_level(level, n, n // 2, spacing, f, P) / compliance - 1
    case = "simply supported" if argument == 0 else "pre-tensioned beam"
    return [Measured(case, level, spacing, "deflection", "um", z, force * compliance, out.time.cpu, stated)]


def pre_tensioned(folder: Path, level: str, spacing: float, length: float = 40.0) -> list[Measured]:
    """:func:`three_point` with (L/2) sqrt(P/EI) = 10: a string but for its middle; strain 1/64 at 40 D."""
    return three_point(folder, level, spacing, length, 10.0)


@dataclass(frozen=True)
class Press:
    """A filament pressed by the platen: ``compliance`` um/nN without the beads' dent, forces at rest of the left and
    the right support and of the platen, nN, how much the force still changes, and the outcome."""

    compliance: float
    left: float
    right: float
    wall: float
    change: float
    out: Outcome


def press(folder: Path, level: str, spacing: float, changes: Mapping[str, object]) -> Press:
    """Pressed at mid-span by an edge, or by a flat platen of ``changes``' platens.width; no plate below.

    Rods are pressed deeper: the engine's bpm bonds leave a noise of 0.3 nN on the supports (an arc cosine that loses
    half its digits, it seems).
    """
    plan, system = planned({"model.level": level, "model.spacing": f"{spacing * D:.17g} um"} | dict(changes))
    f = system.types[0]
    clamped = int(np.sum(plan.beads.role == LEFT)) == 2
    length = float(plan.beads.stations[-2 if clamped else -1])
    if "platens.width" not in changes:
        plan = pressed_at(plan, length / 2 - 0.1, length / 2 + 0.1)
    free = 0.66 * length if clamped else length
    frequency = float(rod.bending_frequency(free, f.EI, f.mass_per_length, tension=plan.beads.tension))
    stop = 0.1 if level == "chain" else 0.2
    load = 1000 * math.ceil(settling_steps(plan, frequency, 1e-8) / 2000)
    plan = moved(plan, stop / load / plan.timestep, load, max(5000, 2 * load))
    supports = (
        "fix supports all ave/time 10 100 1000 f_hold_left[3] f_hold_right[3] c_wall_top "
        'file supports.txt format " %.15g"'
    )
    out = run(folder, system, plan, [supports], platen_bottom_um=-1000.0, drag=critical_drag(plan, frequency))
    force = out.record.mean["top_force"]
    displacement = out.record.mean["displacement"][-1]
    if not math.isclose(displacement, stop, rel_tol=1e-9):
        raise RuntimeError(f"the platen stopped at {displacement} um in place of {stop}")
    edges = 2 if "platens.width" in changes else 1
    compliance = float((displacement - force[-1] / (edges * plan.platens.kn)) / force[-1])
    left, right, wall = out.rows("supports.txt")[-1, 1:]
    return Press(compliance, left, right, wall, float(force[-3] / force[-1] - 1), out)


def flat_platen(folder: Path, level: str, spacing: float) -> list[Measured]:
    """A filament of 40 D under 0.04 cN pressed by a flat platen of 24 D: it touches at the platen's edges alone."""
    width, length = 24 * D, 40 * D
    changes = {"platens.width": f"{width} um", "assembly.length": f"{length} um", "ends.tension": "4e5 nN"}
    pressed = press(folder, level, spacing, changes)
    f = planned({})[1].types[0]
    exact = float(rod.platen_compliance(length, f.EI, width=width, tension=4e5, kGA=_wall(level, f)))
    stated = _of_level(level, round(40 / spacing), round(8 / spacing), spacing, f, 4e5) / exact - 1
    cpu, taken = pressed.out.time.cpu, pressed.left + pressed.right
    return [
        Measured("flat platen", level, spacing, "deflection", "um/nN", pressed.compliance, exact, cpu, stated),
        Measured("flat platen", level, spacing, "taken by supports", "nN", taken, pressed.wall, 0.0),
    ]


# --- buckling and vibration ------------------------------------------------------------------------------------------


def buckling_load(length: float, f: FilamentType, kGA: float) -> float:
    """Compression that buckles a pinned rod of natural length L, nN: P (1 - P/EA) = (1 - P/kGA) pi^2 EI/L^2.

    Euler's load with shear (Engesser) and with the axis shortened by P/EA, EI and EA over the natural length.
    """
    euler = float(rod.euler_buckling_load(length, f.EI))
    a, b = 1 / f.EA, 1 + euler / kGA
    return 2 * euler / (b + math.sqrt(b * b - 4 * a * euler))


LOADS = (0.4, 0.7, 0.9)  # of the buckling load


def buckling(folder: Path, level: str, spacing: float, length: float = 40.0) -> list[Measured]:
    """Compressed to 0.4, 0.7, 0.9 of the buckling load under a half sine of lateral force: its stiffness, extrapolated
    by a parabola, vanishes at the load measured.

    A half sine is the mode itself, so stiffness falls in proportion to the load but for shear and shortening. A chain
    errs by -(pi s/L)^2/12 (sin of pi s/(2 L) over it, squared), a rod by as much the other way: its bonds are straight.
    """
    plan, system = filament(level, spacing, length)
    f, L = system.types[0], length * D
    exact = buckling_load(L, f, _wall(level, f))
    n = system.n_beads
    first = float(rod.bending_frequency(L, f.EI, f.mass_per_length))
    q = f.EI * (math.pi / L) ** 4 * spacing * D  # force on a bead for 1 um at mid-span
    stiffness, cpu = [], 0.0
    for p in LOADS:
        force = 0.3 * q * (1 - p)
        commands = [
            f"group beads id 1:{n}",
            f"variable push atom {force:.17g}*sin(PI*(id-1)/{n - 1})",
            "fix load beads addforce 0 0 v_push",
            f"group middle id {bead_at(plan, L / 2)}",
            "compute middle middle reduce ave z",
        ]
        (z,), out = at_rest(
            folder / f"{p:g}",
            (plan, system),
            commands,
            "c_middle",
            first * math.sqrt(1 - p),
            end_load_nN=-p * exact,
        )
        stiffness.append(force / z)
        cpu += out.time.cpu
    parabola = np.polynomial.Polynomial.fit(LOADS, stiffness, 2)
    roots = parabola.roots()
    critical = float(np.real(roots[np.argmin(np.abs(roots - 1))])) * exact
    sign = -1 if level == "chain" else 1
    stated = sign * (math.pi * spacing / length) ** 2 / 12
    return [Measured("buckling", level, spacing, "load", "nN", critical, exact, cpu, stated)]


def timoshenko_frequency(length: float, f: FilamentType) -> float:
    """First bending frequency of a simply supported Timoshenko rod, rad/us, with shear and rotary inertia m' D^2/16.

    kGA (q^2 EI + kGA - w rho I) ... of the determinant: (kGA q^2 - w m)(EI q^2 + kGA - w J) = (kGA q)^2, w = omega^2.
    """
    q = math.pi / length
    m, J = f.mass_per_length, f.mass_per_length * f.diameter**2 / 16
    shear, turn = f.kGA * q**2, f.EI * q**2 + f.kGA
    b, c = shear * J + turn * m, shear * turn - (f.kGA * q) ** 2
    return math.sqrt(2 * c / (b + math.sqrt(b * b - 4 * m * J * c)))


def frequency(folder: Path, level: str, spacing: float, length: float = 40.0) -> list[Measured]:
    """Simply supported, set swinging as a half sine by 0.3 um, no damping, three swings: first bending frequency.

    A chain is slow by (pi s/L)^2/12. A rod's beads have the rotary inertia of spheres, m D^2/10 in place of
    m D^2/16: slow by 0.0188 (pi D/L)^2, 1.2e-4 at 40 D, at every spacing.
    """
    plan, system = filament(level, spacing, length)
    f, L, n = system.types[0], length * D, system.n_beads
    exact = float(rod.bending_frequency(L, f.EI, f.mass_per_length)) if level == "chain" else timoshenko_frequency(L, f)
    period = 2 * math.pi / exact / plan.timestep
    sample = max(20, round(period / 60 / 20) * 20)
    steps = round(3 * period / sample) * sample
    commands = [
        f"group beads id 1:{n}",
        f"variable kick atom {0.3 * exact:.17g}*sin(PI*(id-1)/{n - 1})",
        "velocity beads set NULL NULL v_kick",
        f"group middle id {bead_at(plan, L / 2)}",
        "compute middle middle reduce ave z",
        f'fix probe all ave/time {sample} 1 {sample} c_middle file probe.txt format " %.17g"',
    ]
    variables: dict[str, float] = {"drag": 0.0} | AWAY
    if level == "rod":
        variables |= {"rod_damping": 0.0, "turning_drag": 0.0}
    out = run(folder, system, moved(plan, 1e-9, steps, sample=sample), commands, **variables)
    step, z = out.rows("probe.txt").T
    time = step * plan.timestep

    def swing(t: FloatArray, omega: float, sine: float, cosine: float) -> FloatArray:
        return np.asarray(sine * np.sin(omega * t) + cosine * np.cos(omega * t))

    (omega, *_), _ = curve_fit(swing, time, z, p0=(exact, 0.3, 0.0))
    if level == "chain":
        stated = float(np.sinc(spacing / (2 * length))) ** 2 - 1
    else:
        stated = -0.5 * (rod.SPHERE_INERTIA - 1 / 16) * (math.pi / length) ** 2
    return [
        Measured("bending frequency", level, spacing, "frequency", "rad/us", float(omega), exact, out.time.cpu, stated)
    ]


# --- torsion ---------------------------------------------------------------------------------------------------------


def torsion(folder: Path, level: str, spacing: float, length: float = 40.0, turn: float = 0.2) -> list[Measured]:
    """Both ends clamped, the middle bead turned by ``turn`` rad in all and held: torque 4 GJ turn/L, exact.

    Starts from the even twist if a bond turns by more than 0.2 rad, else from the one bead.
    """
    plan, system = filament(level, spacing, length, {"ends.support": "clamped"})
    f, L = system.types[0], length * D
    middle = bead_at(plan, L / 2)
    half = round(length / spacing / 2)
    inertia = rod.SPHERE_INERTIA * spacing * D * f.mass_per_length * D**2
    frequency = 2 * math.pi / L * math.sqrt(f.GJ * spacing * D / inertia)
    even = turn / half > 0.2
    turned = f"{math.degrees(turn) / half:.17g}*({half}-abs(id-{middle}))*(abs(id-{middle})<={half})"
    commands = [
        f"group held id {middle}",
        "group spinning subtract turning held",
        "unfix integrate",
        "fix integrate spinning nve/bpm/sphere",
        f"variable turned atom {turned}",
        "set group all quat 1 0 0 v_turned" if even else f"set group held quat 1 0 0 {math.degrees(turn):.17g}",
        "compute torque all property/atom tqx",
        "compute grip held reduce sum c_torque",
    ]
    (torque,), out = at_rest(
        folder, (plan, system), commands, "c_grip", frequency, 1e-9, turning_drag=2 * frequency * inertia
    )
    exact = float(support.mid_span_torsional_stiffness(L, f.GJ)) * turn
    case = f"torsion, {turn / half:.2g} rad a bond" if even else "torsion"
    return [Measured(case, level, spacing, "torque", "nN um", -torque, exact, out.time.cpu)]


def torsion_of_three_radians(folder: Path, level: str, spacing: float) -> list[Measured]:
    """:func:`torsion` of ten bonds with 3 rad on each."""
    return torsion(folder, level, spacing, 10 * spacing, 15.0)


# --- curved rest shapes ----------------------------------------------------------------------------------------------

Curve = Callable[[FloatArray], FloatArray]


def arc(radius: float) -> Curve:
    """Circle in the plane of x and y that starts along x: (..., 3) um of the arc length."""

    def path(s: FloatArray) -> FloatArray:
        a = np.asarray(s) / radius
        return np.stack([radius * np.sin(a), radius * (1 - np.cos(a)), np.zeros_like(a)], axis=-1)

    return path


def helix(radius: float, pitch_angle: float) -> Curve:
    """Helix about x through the origin: (..., 3) um of the arc length."""

    def path(s: FloatArray) -> FloatArray:
        a = np.asarray(s) * math.cos(pitch_angle) / radius
        return np.stack([np.asarray(s) * math.sin(pitch_angle), radius * (1 - np.cos(a)), radius * np.sin(a)], axis=-1)

    return path


def curved_cantilever(curve: Curve, length: float, force: FloatArray, f: FilamentType) -> FloatArray:
    """(3,) displacement of the tip of a curved rod clamped at 0 under a tip force, small, um (Castigliano).

    u = int (C_i m_i (m_i of a unit force) ...) ds with m = (r(L) - r(s)) x F: twist m_t^2/GJ, bending, stretch, shear.
    """
    nodes, weights = np.polynomial.legendre.leggauss(200)
    s, w = (nodes + 1) * length / 2, weights * length / 2
    r, h = curve(s), 1e-4 * length
    t = (curve(s + h) - curve(s - h)) / (2 * h)
    t /= np.linalg.norm(t, axis=1)[:, None]
    arm = curve(np.array(length)) - r
    out = np.zeros(3)
    m = np.cross(arm, force)
    for k in range(3):
        unit = np.eye(3)[k]
        n = np.cross(arm, unit)
        twist = np.sum(m * t, axis=1) * np.sum(n * t, axis=1)
        along = (t @ force) * (t @ unit)
        density = twist / f.GJ + (np.sum(m * n, axis=1) - twist) / f.EI
        density += along / f.EA + (force @ unit - along) / f.kGA
        out[k] = np.sum(w * density)
    return out


def laid_along(assembly: tuple[Plan, FilamentSystem], points: FloatArray) -> FilamentSystem:
    """The system with its beads at these points (n_beads, 3) um, in a box with room around them."""
    _, system = assembly
    room = 2 * D + 0.1 * float(np.ptp(points))
    reach = np.max(np.abs(points), axis=0) + room
    box = np.column_stack([np.min(points, axis=0) - room, reach])
    box[1:, 0] = -reach[1:]
    return replace(system, positions=points, box=box)


def _curved(
    folder: Path, case: str, spacing: float, curve: Curve, length: float, direction: tuple[float, float, float]
) -> list[Measured]:
    """A rod built along a curve and clamped at its start: at rest as built, then compliance under a tip force.

    The force acts one way and then the other: half the difference is free of the quadratic part and of the drift.
    """
    plan, straight = filament("rod", spacing, length, {"ends.support": "clamped"})
    f, L = straight.types[0], length * D
    system = laid_along((plan, straight), curve(plan.beads.stations))
    tip = bead_at(plan, L)
    along = np.array(direction)
    compliance = curved_cantilever(curve, L, along, f)
    size = float(np.linalg.norm(compliance))
    # its softest direction, with a quarter of the mass at the tip, as of a straight cantilever
    softest = np.max(np.linalg.eigvalsh([curved_cantilever(curve, L, e, f) for e in np.eye(3)]))
    frequency = math.sqrt(1 / float(softest) / (0.25 * f.mass_per_length * (L + 2 * spacing * D)))
    watch = [*free_right_end(plan), f"group tip id {tip}", "compute tip tip reduce ave x y z"]

    def at(name: str, load: float) -> tuple[FloatArray, float]:
        words = " ".join(f"{x:.17g}" for x in load * along)
        commands = [*watch, f"fix load tip addforce {words}"]
        where, out = at_rest(folder / name, (plan, system), commands, "c_tip[*]", frequency, 1e-5)
        return where, out.time.cpu

    (up, first), (down, second) = at("pushed", 2e-3 * L / size), at("pulled", -2e-3 * L / size)
    still, third = at("still", 0.0)
    drift = float(np.linalg.norm(still - system.positions[tip - 1]))
    moved_by = float((up - down) / 2 @ compliance) / size
    return [
        Measured(case, "rod", spacing, "compliance", "um", moved_by, 2e-3 * L, first + second),
        Measured(case, "rod", spacing, "drift unloaded", "D", drift / D, 0.0, third),
    ]


def helix_compliance(folder: Path, level: str, spacing: float) -> list[Measured]:
    """A helical spring of 64 D, radius 8 D, rising at 20 degrees: pulled along its axis at its tip (level rod)."""
    _rods_only(level)
    return _curved(folder, "helix", spacing, helix(8 * D, math.radians(20)), 64.0, (1.0, 0.0, 0.0))


def curved_rest_shape(folder: Path, level: str, spacing: float) -> list[Measured]:
    """A quarter circle of 40 D: pushed out of its plane at its tip, so that it bends and twists.

    A chain (angle cosine) is straight at rest: it holds EI/(2 R^2) a length when it is built as an arc.
    """
    radius = 40 * D / (math.pi / 2)
    if level == "rod":
        return _curved(folder, "curved rest shape", spacing, arc(radius), 40.0, (0.0, 0.0, 1.0))
    plan, straight = filament(level, spacing, 40.0)
    system = laid_along((plan, straight), arc(radius)(plan.beads.stations))
    out = run(folder, system, moved(plan, 1e-9, 400, sample=400), [], **AWAY)
    hinged = 40.0 * D - spacing * D
    exact = straight.types[0].EI / radius**2 / 2 * hinged
    value = float(out.record.start["stored"])
    stated = -((spacing * D / radius) ** 2) / 12  # of 1 - cos
    return [
        Measured("curved rest shape", level, spacing, "bending energy", "nN um", value, exact, out.time.cpu, stated)
    ]


def _rods_only(level: str) -> None:
    if level != "rod":
        raise ValueError(f"this case is of level rod, not {level}")


# --- section ---------------------------------------------------------------------------------------------------------

SECTION = {"model.level": "section", "platens.width": "500 um"}


def disc(folder: Path, level: str, spacing: float, length: float = 700.0, spring: str = "exact") -> list[Measured]:
    """A section's disc on its spring, pressed by the top platen: F = k (d - F/kn), k of the beam under the platen's
    two edges (exact) or the thesis' Eq 7-1; ``length`` um."""
    plan, system = planned(SECTION | {"model.spring": spring, "assembly.length": f"{length} um"})
    f = system.types[0]
    if spring == "exact":
        k = float(rod.platen_force(1.0, length, f.EI, width=500.0, tension=4e5))
    else:
        k = float(support.thesis_mid_span_stiffness(length, f.EI, 4e5))
    # drag critical for the contact: the disc follows the platen and does not bounce off it, however soft the spring
    drag = 2 * math.sqrt(plan.platens.kn * plan.beads.mass[0])
    plan = moved(plan, 0.1 / 4000 / plan.timestep, 4000, 4000)
    out = run(folder, system, plan, platen_bottom_um=-1000.0, drag=drag)
    force, d = (float(out.record.mean[name][-1]) for name in ("top_force", "displacement"))
    exact = k * d / (1 + k / plan.platens.kn)
    case = f"disc on the spring of {length / 1000:g} mm ({spring})"
    return [Measured(case, level, spacing, "force", "nN", force, exact, out.time.cpu)]


def far_field(folder: Path, level: str, spacing: float, form: str = "condensed") -> list[Measured]:
    """345 mm on a millimetre of beads and a far field of this form, pushed by 0.1 um at a 0.5 mm platen's edges: force
    against the beam of 345 mm.

    The edges are held to the platen's displacement from the start: a platen that can only push bounces off so soft a
    support for millions of steps (one swing is a million). The rest, critically damped, comes to rest on its own.
    """
    length, width, depth = 345000.0, 500.0, 0.1
    plan, system = planned(
        {
            "assembly.length": f"{length} um",
            "platens.width": f"{width} um",
            "model.far_field": form,
            "model.level": level,
            "model.spacing": f"{spacing * D} um",
        }
    )
    f = system.types[0]
    edges = [bead_at(plan, x) for x in ((length - width) / 2, (length + width) / 2)]
    frequency = float(rod.bending_frequency(width, f.EI, f.mass_per_length, tension=4e5))
    out = run(
        folder,
        system,
        moved(plan, 1e-9, 96000, sample=2000),
        [
            f"group edges id {edges[0]} {edges[1]}",
            f"displace_atoms edges move 0 0 -{depth}",
            "fix edges edges setforce NULL NULL 0",
            'fix edge_force all ave/time 2000 1 2000 f_edges[3] file edges.txt format " %.15g"',
            # coarse beads weigh little and swing slowly: by trial, the drag on them that takes fewest steps
            "fix far_drag free viscous 5",
        ],
        **({"drag": critical_drag(plan, frequency)} | AWAY),
    )
    force = out.rows("edges.txt")[:, 1]
    if abs(force[-1] / force[-2] - 1) > 1e-4:
        raise RuntimeError(f"not at rest: {force[-2:].tolist()}")
    exact = depth * float(rod.platen_force(1.0, length, f.EI, width=width, tension=4e5))
    return [Measured(f"345 mm, far field {form}", level, spacing, "force", "nN", float(force[-1]), exact, out.time.cpu)]


def end_load_doubled(folder: Path, level: str, spacing: float) -> list[Measured]:
    """Twice the planned end load moves the loaded end by P/EA of the natural length L/(1 + P/EA)."""
    P, L = 4e5, 40 * D
    plan, system = filament(level, spacing, 40.0, {"ends.tension": f"{P} nN"})
    f = system.types[0]
    frequency = math.pi / 2 / L * math.sqrt(f.EA / f.mass_per_length)
    held = int(np.sum(plan.beads.role == RIGHT))
    (end,), out = at_rest(folder, (plan, system), [], "c_pull", frequency, 1e-10, end_load_nN=2 * P / held)
    exact = P / f.EA * L / (1 + P / f.EA)
    return [Measured("end load doubled", level, spacing, "elongation", "um", end - L, exact, out.time.cpu)]
