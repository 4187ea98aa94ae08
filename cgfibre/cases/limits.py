"""Where methods fail: what a map of limits is, bisection over trial runs, and the limits of the time step."""

from __future__ import annotations

import math
import resource
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from cgfibre.build.bundle import BundleSpec, build_bundle, build_section
from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.cases.experiment import Outcome, moved, planned, run_on
from cgfibre.errors import EngineError
from cgfibre.mechanics import rod
from cgfibre.plan.contact import TANGENTIAL_DAMPING, TANGENTIAL_RATIO
from cgfibre.plan.model import Plan

#: platens out of reach
AWAY: Mapping[str, Any] = MappingProxyType({"platen_top_um": 1000.0, "platen_bottom_um": -1000.0})
#: no background drag
FREE: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "chain": {"drag": 0.0},
        "rod": {"drag": 0.0, "turning_drag": 0.0},
        "section": {"drag": 0.0, "turning_drag": 0.0},
    }
)
#: kinetic energy over that of the first rows beyond which a run is unstable
BURST = 1e3
#: steps of a trial: half a percent above the limit noise grows by a fifth a step undamped, by a hundredth overdamped
TRIAL_STEPS = 1500


@dataclass(frozen=True)
class Point:
    """One point of a map.

    ``series`` which curve; ``parameter`` what was varied; ``measured`` the limit (or error) found; ``predicted`` its
    closed form (nan: none); ``cpu`` processor seconds of the engine; ``used`` what the package does by default (nan:
    does not apply).
    """

    series: str
    parameter: float
    measured: float
    predicted: float
    cpu: float
    used: float = math.nan


class Bench:
    """Runs experiments, each in a folder of its own below ``folder``, and counts the engine's processor seconds."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._runs = 0
        self._spent = self._children()

    @staticmethod
    def _children() -> float:
        # of the engine whether it ends well or not
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    def lap(self) -> float:
        """Processor seconds of the engine since the last call."""
        now = self._children()
        spent, self._spent = now - self._spent, now
        return spent

    def run(
        self,
        system: FilamentSystem,
        plan: Plan,
        commands: Sequence[str] = (),
        ranks: int = 1,
        **variables: float | str,
    ) -> Outcome:
        """:func:`cgfibre.cases.experiment.run` in the next folder."""
        self._runs += 1
        return run_on(ranks, self._folder / str(self._runs), system, plan, commands, variables)


@dataclass(frozen=True)
class LimitMap:
    """A map: what is varied, what is found, how, and what the package does about it.

    ``points`` runs the experiments one by one; ``fails``, ``formula`` and ``handled`` say in words what goes wrong,
    what the prediction is and which refusal, guard or default answers it. ``logarithmic``: the axes of its picture.
    """

    name: str
    title: str
    parameter: str
    parameter_unit: str
    quantity: str
    unit: str
    fails: str
    formula: str
    handled: str
    points: Callable[[Bench], Iterator[Point]]
    logarithmic: tuple[bool, bool] = (True, True)


def bisect(passes: Callable[[float], bool], guess: float, *, reach: float = 1.6, within: float = 0.004) -> float:
    """Value up to which ``passes`` holds, by bisection on its logarithm to a relative ``within``.

    The bracket starts at guess/reach and guess reach and grows until it holds the limit; nan where none is found
    within reach^8.
    """
    low, high = guess / reach, guess * reach
    for _ in range(8):
        if passes(low):
            break
        low, high = low / reach, low
    else:
        return math.nan
    for _ in range(8):
        if not passes(high):
            break
        low, high = high, high * reach
    else:
        return math.nan
    while high / low > 1 + within:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if passes(middle) else (low, middle)
    return math.sqrt(low * high)


def noise(level: str, amplitude: float) -> list[str]:
    """Commands that shift every bead at random (um) and set beads that may turn spinning."""
    flat = level == "section"
    # two generators of their own: shifts and spins that are unlike
    commands = [f"displace_atoms all random {amplitude} {amplitude} {0 if flat else amplitude} 20141 units box"]
    if level != "chain":
        commands.append(f"variable noise atom normal(0,{amplitude},77)")
        axes = "0 0 v_noise" if flat else "v_noise v_noise v_noise"
        commands.append(f"set group all omega {axes}")
    return commands


@dataclass(frozen=True)
class Trial:
    """A system that is let go with a little noise: does its energy stay?"""

    plan: Plan
    system: FilamentSystem
    commands: tuple[str, ...] = ()
    variables: Mapping[str, float] = field(default_factory=dict)
    amplitude: float = 1e-6

    def survives(self, bench: Bench, timestep: float) -> bool:
        """Whether the kinetic energy stays below :data:`BURST` times its first values at this time step, us."""
        plan = moved(self.plan, 1e-9, TRIAL_STEPS, sample=20)
        variables: dict[str, Any] = {**AWAY, **FREE[plan.level], **self.variables, "timestep_us": timestep}
        # beads that fly apart make a box that takes long: stop them well beyond BURST times what the noise holds
        held = (
            self.system.n_beads * float(np.max(plan.beads.mass)) * (2 * self.amplitude / self.plan.timestep_limit) ** 2
        )
        commands = [
            *self.commands,
            *noise(plan.level, self.amplitude),
            f"fix burst all halt 2 v_kinetic_energy > {10 * BURST * held} error hard",
        ]
        try:
            kinetic = bench.run(self.system, plan, commands, **variables).record.mean["kinetic"]
        except EngineError:
            return False
        return bool(np.all(np.isfinite(kinetic)) and np.max(kinetic) < BURST * np.max(kinetic[:2]))

    def limit(self, bench: Bench, guess: float) -> float:
        """Longest time step at which it survives, us."""
        return bisect(lambda step: self.survives(bench, step), guess)


# --- one filament ----------------------------------------------------------------------------------------------------

#: segments of a trial filament; the highest mode of 20 lies 0.3 % below that of an endless one
SEGMENTS = 20


def filament_trial(level: str, spacing: float, changes: Mapping[str, object] | None = None) -> Trial:
    """One filament of :data:`SEGMENTS` segments of ``spacing`` um, not pulled, without drag or damping."""
    plan, system = planned(
        {
            "model.level": level,
            "model.spacing": f"{spacing} um",
            "assembly.length": f"{SEGMENTS * spacing} um",
            "ends.tension": "0 nN",
            "contact.softening": 1e6,  # the ends' masses follow the limiting step: here that of the filament alone
            **(changes or {}),
        }
    )
    return Trial(plan, system, variables={"rod_damping": 0.0} if level == "rod" else {})


def filament_step(trial: Trial) -> float:
    """Limit 2/omega_max of the even filament alone, us, by its closed form."""
    plan, f = trial.plan, trial.system.types[0]
    EA, s = f.EA / plan.axial_softening, float(np.diff(plan.beads.stations)[0])
    mass = f.mass_per_length * s
    if plan.level == "chain":
        omega2 = rod.chain_frequency_squared(s, mass, EA, f.EI)
    else:
        omega2 = rod.rod_frequency_squared(s, mass, f.diameter, rod.rod_coefficients(s, EA, f.EI, f.GJ, f.kGA))
    return 2 / math.sqrt(float(omega2))


def step_against_spacing(bench: Bench, ratios: Sequence[float] = (0.25, 0.5, 1.0, 2.0, 4.0)) -> Iterator[Point]:
    """Time step limit of one filament against s/D, chain and rod, the real EA; used: the plan's own step."""
    for level in ("chain", "rod"):
        for ratio in ratios:
            trial = filament_trial(level, ratio * 7.0, {"model.axial_softening": 1.0})
            predicted = filament_step(trial)
            found = trial.limit(bench, predicted)
            yield Point(level, ratio, found, predicted, bench.lap(), trial.plan.timestep)


def step_against_softening(
    bench: Bench,
    softenings: Sequence[float] = (1.0, 2.0, 4.0, 10.0, 30.0, 100.0),
    cases: Sequence[tuple[str, float]] = (("chain", 0.5), ("chain", 1.0), ("chain", 4.0), ("rod", 1.0)),
) -> Iterator[Point]:
    """Time step limit against the reduction of EA; ``cases`` are levels with their s/D."""
    for level, ratio in cases:
        for softening in softenings:
            trial = filament_trial(level, ratio * 7.0, {"model.axial_softening": softening})
            predicted = filament_step(trial)
            found = trial.limit(bench, predicted)
            yield Point(f"{level}, s = {ratio:g} D", softening, found, predicted, bench.lap(), trial.plan.timestep)


# --- filaments in contact --------------------------------------------------------------------------------------------


def hexagon(rings: int, pitch: float) -> tuple[FloatArray, np.ndarray]:
    """(n, 2) centres of a hexagonal packing of so many rings about one, and (n,) which of them lie in the last."""
    found, outer = [], []
    for i in range(-rings, rings + 1):
        for j in range(max(-rings, -rings - i), min(rings, rings - i) + 1):
            found.append((pitch * (i + j / 2), pitch * math.sqrt(0.75) * j))
            outer.append(max(abs(i), abs(j), abs(i + j)) == rings)
    return np.array(found), np.array(outer)


#: overlap over D with which caged filaments start; noise is far below it, so that no contact opens
CAGED = 1e-3
SECTION = MappingProxyType({"model.level": "section", "platens.width": "500 um"})


def caged(level: str, rings: int, softening: float, ratio: float = 1e-6, friction: float = 1e6) -> Trial:
    """Close-packed filaments pressed into each other a little, the outermost held: all contacts stick.

    ``softening`` of the contacts may be below 1 (stiffer than real), ``ratio`` is their damping. The friction
    coefficient is so high that nothing slides: linear, the worst case for the step.
    """
    changes = {"contact.softening": max(softening, 1.0), "contact.damping_ratio": ratio}
    if level == "section":
        plan, one = planned({**SECTION, **changes})
        length = 0.0
    else:
        plan, one = planned(
            {
                "model.level": level,
                "model.spacing": "7 um",
                "assembly.length": "70 um",
                "ends.tension": "0 nN",
                **changes,
            }
        )
        length = 70.0
    d = one.types[0].diameter
    centres, outer = hexagon(rings, d)
    c, stiffer = plan.contact, max(1.0, 1 / softening)  # a scene is not let have contacts stiffer than real
    contact = replace(c, kn=c.kn * stiffer, kt=c.kt * stiffer, gamma=c.gamma * math.sqrt(stiffer), friction=friction)
    plan = replace(plan, contact=contact)
    rng = np.random.default_rng(0)
    if length:
        system = build_bundle(BundleSpec(one.types[0], centres, plan.beads.stations), rng)
        # molecules are numbered as the filaments are
        held = "molecule"
    else:
        system = build_section(BundleSpec(one.types[0], centres), rng)
        held = "id"
    system = replace(system, positions=system.positions * np.array([1.0, 1 - CAGED, 1 - CAGED]))
    numbers = " ".join(str(i + 1) for i in np.flatnonzero(outer))
    commands = (f"group cage {held} {numbers}", "fix cage cage freeze")
    variables = {"rod_damping": 0.0} if level == "rod" else {}
    if level == "section":
        variables = {"spring_nN_um": 1e-9, "torsion_nN_um": 0.0}
    return Trial(plan, system, commands, variables, amplitude=1e-3 * CAGED * d)


#: tangential over normal stiffness and damping of the contacts; moment of inertia of a disc over m D^2
KT, XT = TANGENTIAL_RATIO, TANGENTIAL_DAMPING
DISC_INERTIA = 0.125


def caged_modes(trial: Trial) -> list[tuple[float, float, float]]:
    """(omega^2 m/kn, c m/gamma, omega^2 of the filament itself) of the stiffest modes of packed chains or rods.

    Contacts as in :func:`cgfibre.mechanics.rod.packed_time_step`; all rocking alike about an axis across has half of
    what spinning has. A chain's beads alternate along it as well: 16 EI/(s^3 m), 4 EA/(s m); a rod's 4 ks/m, 4 kr/m,
    4 kt/I and for rocking max(ks s^2, 4 kb)/I.
    """
    plan, f = trial.plan, trial.system.types[0]
    across, along = (4.5 * (1 + KT), 4.5 * (1 + XT)), (9 * KT, 9 * XT)
    s, EA = plan.spacing, f.EA / plan.axial_softening
    mass = f.mass_per_length * s
    if plan.level == "chain":
        return [(*across, 16 * f.EI / (s**3 * mass)), (*along, 4 * EA / (s * mass))]
    J = rod.SPHERE_INERTIA
    inertia = J * mass * f.diameter**2
    c = rod.rod_coefficients(s, EA, f.EI, f.GJ, f.kGA)
    return [
        (*across, float(4 * c.ks / mass)),
        (*along, float(4 * c.kr / mass)),
        (3 * KT / J, 3 * XT / J, float(4 * c.kt / inertia)),
        (1.5 * KT / J, 1.5 * XT / J, float(max(c.ks * s**2, 4 * c.kb) / inertia)),
    ]


def caged_step(trial: Trial) -> float:
    """Least of the limits of the trial's stiffest modes, us: contacts, damped as they are, and filaments together."""
    c = trial.plan.contact
    if trial.plan.level == "section":
        mass = float(trial.plan.beads.mass[0])
        return float(rod.packed_time_step(c.kn, c.gamma, mass, kt_ratio=KT, damping_ratio=XT, inertia=DISC_INERTIA))
    mass = trial.system.types[0].mass_per_length * trial.plan.spacing
    return min(
        float(rod.damped_time_step(stiffness * c.kn / mass + own, damping * c.gamma / mass))
        for stiffness, damping, own in caged_modes(trial)
    )


def step_against_contact(bench: Bench, softenings: Sequence[float] = (0.01, 0.1, 1.0, 10.0, 100.0)) -> Iterator[Point]:
    """Time step limit of caged filaments against the softening of their contacts, hardly damped."""
    for level, rings in (("section", 10), ("chain", 3), ("rod", 3)):
        for softening in softenings:
            trial = caged(level, rings, softening)
            predicted = caged_step(trial)
            found = trial.limit(bench, predicted)
            used = (
                trial.plan.timestep if softening >= 1 else math.nan
            )  # no scene is let have contacts stiffer than real
            yield Point(level, softening, found, predicted, bench.lap(), used)


def step_against_damping(
    bench: Bench, ratios: Sequence[float] = (1e-6, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)
) -> Iterator[Point]:
    """Time step limit of caged filaments against the damping ratio of their contacts."""
    for level, rings, softening in (("section", 10, 10.0), ("chain", 3, 0.1), ("chain", 3, 1.0), ("rod", 3, 1.0)):
        for ratio in ratios:
            trial = caged(level, rings, softening, ratio)
            predicted = caged_step(trial)
            found = trial.limit(bench, predicted)
            name = (
                level if level == "section" else f"{level}, contacts {'real' if softening == 1 else 'ten times stiff'}"
            )
            used = trial.plan.timestep if softening >= 1 else math.nan
            yield Point(name, ratio, found, predicted, bench.lap(), used)
