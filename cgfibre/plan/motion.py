"""Platen motion of a plan: as fast as the accuracy allows, slow at the first touch, faster as the force grows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cgfibre.build.system import FloatArray
from cgfibre.errors import InputError
from cgfibre.mechanics.support import bundle_bending_force, quasi_static_speed
from cgfibre.plan.model import Choice, Motion, Sampling, Target, film_time
from cgfibre.scene import Scene, Stop

#: the displacement over diameter from which on the accuracy asked for shall hold
REFERENCE_DISPLACEMENT = 2 / 7
#: rows spread sideways before they carry: on carbon-37 filaments join about twice as late as voids close evenly
LATE = 2.0
#: the accuracy over which the platen's bound is taken, over that asked for: at the bound with eps the mean error of
#: carbon-37 is about 0.4 eps (measured: 1.6, 3.7, 11 % to 10 um at 0.05, 0.1, 0.2)
SPEED_GAIN = 1.2
#: the speed may grow to this many times its first value
SPEED_RATIO = 30.0
#: bead-steps of loading beyond which an automatic speed is raised, and the least and most steps that makes of them; the
#: plan then says from which force on the run is quasi-static
BUDGET, LEAST_STEPS, MOST_STEPS = 1e9, 600_000, 1_500_000
#: an automatic speed that would have to be raised more than this gives up growing: slow where the force is large
EVEN_SPEED = 3.0
LOOSE = 1e-3
#: of a section's bundle: the part of the planned displacement from which on the accuracy shall hold, if that is more
PILE_REFERENCE = 0.05
#: force of a section's discs over that of voids that close evenly at LATE: 1519 discs to 30 % (measured 0.5)
PILE_FORCE = 0.5
#: SPEED_GAIN of a section. Its mean error goes with the square of the speed, 0.25 eps (547 and 1519 discs on soft and
#: stiff springs to 30 %: 1.1, 3.4, 12 % at eps 0.06, 0.24, 0.96)
PILE_GAIN = 3.0
SPREAD = 3.0  # times wider than built: the most that an assembly is expected to flatten
READINGS = 20  # of forces within a record row
CHECKPOINTS = 20  # a run
BLOCK = 300  # least steps in a block: to begin one costs as much as some ten steps
LEAST_GAP = 0.02  # of D, between layers as built, for the mass that the platen gathers
DENSEST = math.pi / (2 * math.sqrt(3))  # hexagonal packing of touching circles


def planned_displacement(
    scene: Scene, height: float, width: float, n_filaments: int, key: str = "platens.stop", stop: Stop | None = None
) -> float:
    """Displacement at the planned stop (or at another one, of that ``key``), um; for a stop by force or pressure the
    deepest that makes sense.

    Raises InputError when the stop lies beyond what the assembly can give: one flat layer of filaments.
    """
    stop = scene.platens.stop if stop is None else stop
    d = scene.filament.diameter
    # the assembly may spread to one flat layer, so only that is impossible
    thinnest = d if n_filaments > 1 else d / 2  # one filament alone is dented
    deepest = height - thinnest
    if stop.displacement is not None:
        if stop.displacement >= deepest:
            raise InputError(
                f"{key}.displacement",
                f"{stop.displacement:g} um",
                f"less than {deepest:.4g} um: the assembly is {height:.4g} um high and no thinner than {thinnest:g} um",
            )
        return stop.displacement
    if stop.thickness is not None:
        if not thinnest < stop.thickness < height:
            raise InputError(
                f"{key}.thickness",
                f"{stop.thickness:g} um",
                f"between {thinnest:g} um and the height as built ({height:.4g} um)",
            )
        return height - stop.thickness
    # a stop by force or pressure comes where it comes; no later than solid filaments spread to SPREAD times the width
    solid = n_filaments * math.pi * d**2 / 4 / (DENSEST * SPREAD * max(width, height))
    depth = min(deepest, height - solid)
    if depth < 1e-3 * d:
        expected = f"an assembly of more than one layer: this one is {height:.4g} um high, as thin as {thinnest:g} um"
        raise InputError(f"{key}.{stop.kind}", stop.value, expected)
    return depth


@dataclass(frozen=True)
class Bodies:
    """What the platen sets in motion, for the choice of its speed.

    ``depths`` (n,) um of the filaments below the top one; ``pitch`` um; ``stiffness`` nN/um and ``frequency`` rad/us of
    one filament on its supports, under the platen; ``contact_stiffness`` nN/um and ``bead_mass`` pg of a contact;
    ``n_beads`` of the whole model; ``bends``: bending between the supports carries the first forces (not so where a
    long far field is much softer than contacts); ``gain`` see SPEED_GAIN; ``columns`` of discs side by side in a
    section (0: filaments), which the platen gathers layer by layer.
    """

    depths: FloatArray
    pitch: float
    stiffness: float
    frequency: float
    contact_stiffness: float
    bead_mass: float
    n_beads: int
    bends: bool = True
    gain: float = SPEED_GAIN
    columns: float = 0.0

    def reference(self, diameter: float, deepest: float) -> float:
        """Displacement from which on the accuracy shall hold, um."""
        least = REFERENCE_DISPLACEMENT * diameter
        return min(max(least, PILE_REFERENCE * deepest) if self.columns else least, deepest / 2)

    def force(self, displacement: FloatArray, diameter: float) -> FloatArray:
        """Estimate of the platen's force, nN."""
        depths = LATE * self.depths
        even = bundle_bending_force(displacement, depths, self.stiffness, diameter=diameter, pitch=self.pitch)
        return PILE_FORCE * even if self.columns else even

    def impedance(self, speed: float, diameter: float) -> float:
        """Force over speed of what the platen hits: sqrt(kn m) of a bead or k/omega of a filament, nN us/um.

        Of a section: n m v/g at the ``speed`` v, see :func:`speed_bound`.
        """
        if self.columns:
            gap = max(self.pitch - diameter, LEAST_GAP * diameter)
            return max(self.columns * self.bead_mass * speed / gap, self.stiffness / self.frequency)
        return max(math.sqrt(self.contact_stiffness * self.bead_mass), self.stiffness / self.frequency)


def loose(kn: float, mass: float, layers: float) -> tuple[float, float]:
    """(stiffness nN/um, frequency rad/us) of one bead or disc that no support holds, for the choice of the speed.

    It feels nothing until it meets others: forces of LOOSE of the contact's stiffness are to be right, and a wave of
    contact has to run through the height, sqrt(kn/m) over the number of layers.
    """
    return LOOSE * kn / layers, math.sqrt(kn / mass) / layers


def speed_bound(bodies: Bodies, diameter: float, accuracy: float, displacement: FloatArray) -> FloatArray:
    """(n,) highest quasi-static platen speed at each displacement, um/us: the least of what follows.

    A bead hit by the platen: eps F/sqrt(kn m). A filament set in motion by it swings with the amplitude v/omega about
    its static deflection, a force k v/omega: eps F omega/(k n), for those touched at once n is their number, later ones
    swing out of step and n is the root of it (a single filament at displacement d: eps omega d; measured on carbon-37,
    where it is the one that counts). F(d) is the bending force of the filaments engaged so far.

    A section's n columns of discs: single impacts do not count beside many discs; what does is that the platen gathers
    a layer, from rest to its speed, whenever it has gone on by a gap g between layers: n m v^2/g <= eps F.
    """
    depths = LATE * bodies.depths
    force = bodies.force(displacement, diameter)
    gaps = depths * (1 - diameter / bodies.pitch)
    at_once = int(np.sum(gaps < 0.05 * diameter))
    engaged = np.searchsorted(np.sort(gaps), displacement)
    contact = quasi_static_speed(accuracy, force, bodies.contact_stiffness, bodies.bead_mass)
    swing = accuracy * force * bodies.frequency / (bodies.stiffness * np.maximum(np.sqrt(engaged), at_once))
    if bodies.columns:
        gap = max(bodies.pitch - diameter, LEAST_GAP * diameter)
        contact = np.sqrt(accuracy * force * gap / (bodies.columns * bodies.bead_mass))
    return np.minimum(contact, swing)


def choose_speed(bodies: Bodies, diameter: float, accuracy: float, deepest: float) -> tuple[float, float, float]:
    """(first, last, growth): the fastest v = first (1 + d/growth) up to ``last`` below :func:`speed_bound`.

    The first speed is half the bound at the reference displacement; growth is no quicker than the filaments can follow,
    (v/(growth omega))^2 <= eps.
    """
    d = np.linspace(bodies.reference(diameter, deepest), deepest, 200)
    bound = speed_bound(bodies, diameter, accuracy, d)
    first = float(bound[0]) / 2
    rise = np.minimum.accumulate(bound[::-1])[::-1] / first - 1  # at least 0: bounds fall short of the first at worst
    growth = float(np.max(d / np.clip(rise, 1e-3, SPEED_RATIO - 1)))
    growth = max(growth, first / (bodies.frequency * math.sqrt(accuracy)))
    last = first * min(SPEED_RATIO, 1 + deepest / growth)
    return first, last, growth


def earlier_displacements(
    scene: Scene, height: float, width: float, n_filaments: int, displacement: float
) -> tuple[float, ...]:
    """Displacements of platens.cycles, um, as in :func:`planned_displacement`; those by force or pressure go no deeper
    than the main stop's ``displacement``."""
    found: list[float] = []
    for i, cycle in enumerate(scene.platens.cycles):
        depth = planned_displacement(scene, height, width, n_filaments, f"platens.cycles.{i}", cycle)
        by_place = cycle.kind in ("displacement", "thickness")
        found += cycle.times * [depth if by_place else min(depth, displacement)]
    return tuple(found)


def target(stop: Stop, displacement: float, contact_length: float) -> Target:
    """The stop in the deck's terms; a force per length is one over the platen's ``contact_length`` um."""
    force = stop.force
    if stop.line_force is not None:
        force = stop.line_force * contact_length
    return Target(
        displacement,
        math.inf if force is None else force,
        math.inf if stop.pressure is None else stop.pressure,
    )


def plan_motion(
    scene: Scene,
    bodies: Bodies,
    timestep: float,
    displacement: float,
    earlier: Sequence[float] = (),
    contact_length: float = math.nan,
) -> tuple[Motion, Sampling, list[Choice]]:
    """Speeds, phases and sampling of the platen's motion to ``displacement`` um, after cycles to the ``earlier`` ones.

    ``contact_length`` um of the platen along the filaments, for stops by force per length.
    """
    stops = [cycle for cycle in scene.platens.cycles for _ in range(cycle.times)]
    cycles = tuple(target(s, d, contact_length) for s, d in zip(stops, earlier, strict=True))
    choices = []
    d = scene.filament.diameter
    eps = bodies.gain * scene.model.accuracy
    asked = scene.platens.speed
    first, last, growth = choose_speed(bodies, d, eps, displacement)
    fastest, allowed = last, (first, last, growth)
    if asked == "auto":
        most = scene.model.most_steps
        budget = min(max(BUDGET / bodies.n_beads, LEAST_STEPS), MOST_STEPS) if most == "auto" else most
        faster = film_time(first, last, growth, displacement) / timestep / budget
        rule = "v <= eps F/sqrt(kn m) for beads and eps F omega/(k n) for filaments"
        if bodies.columns:
            rule = "n m v^2/g <= eps F for n columns of discs a gap g apart and v <= eps F omega/(k n)"
        reason = (
            f"{rule}, eps = {bodies.gain:g} x accuracy {scene.model.accuracy:g}, from "
            f"{bodies.reference(d, displacement):.2g} um on; it grows with the force"
        )
        if faster > EVEN_SPEED:
            first = last = displacement / (budget * timestep)
            reason = (
                f"accuracy {scene.model.accuracy:g} would take {faster * budget:.2g} steps: even speed instead, to end "
                f"within {budget:.2g}; only forces above the one below are quasi-static"
            )
        elif faster > 1:
            first, last = first * faster, last * faster
            reason += f"; raised {faster:.3g} times to end within {budget:.2g} steps"
        choices.append(Choice("platen speed", f"{first:.3g} to {last:.3g} m/s", reason))
    else:
        first = last = float(asked)
        growth = displacement
        choices.append(Choice("platen speed", f"{first:.4g} m/s", "as asked in the scene"))
    at_reference = min(first * (1 + bodies.reference(d, displacement) / growth), last)
    least = bodies.impedance(at_reference, d) / eps
    choices.append(
        Choice(
            "quasi-static above",
            f"{least * first * 1e-9:.2g} N at first touch, {least * last * 1e-9:.2g} N at {last:.3g} m/s",
            ("n m v^2/(g eps)" if bodies.columns else "v sqrt(kn m)/eps")
            + " or v k/(omega eps): below it inertia is more than the accuracy asked for",
        )
    )
    if cycles:
        choices.append(
            Choice(
                "cycles",
                f"{len(cycles)} before the last loading",
                "unloaded till the platen feels nothing, then loaded from there as the first time: slow, then faster",
            )
        )
    main = target(scene.platens.stop, displacement, contact_length)
    motion = Motion(
        first=first,
        last=last,
        growth=growth,
        load_steps=0,
        hold_steps=0,
        unload=scene.platens.unload,
        stop_force=main.force,
        stop_pressure=main.pressure,
        planned_displacement=displacement,
        quasi_static_impedance=least,
        eps=eps,
        fastest=fastest if bodies.bends else math.inf,
        cycles=cycles,
    )
    motion, sampling = in_steps(scene, motion, timestep)
    if bodies.bends:
        over = np.linspace(min(REFERENCE_DISPLACEMENT * d, displacement / 2), displacement, 200)
        motion = replace(motion, pace=mean_pace((motion.first, motion.last, growth), allowed, over))
    return motion, sampling, choices


def in_steps(scene: Scene, motion: Motion, timestep: float, held: int = 0) -> tuple[Motion, Sampling]:
    """A motion whose speeds are known, with the steps of its phases, and its sampling; ``held`` steps stand before
    those of platens.hold.

    A little slower than asked, so that the last whole window of the first loading ends at its planned displacement
    itself (those of later loadings: the deck).
    """
    phases = 2 * len(motion.cycles) + (2 if motion.unload else 1)

    def steps(displacement: float) -> float:
        return film_time(motion.first, motion.last, motion.growth, displacement) / timestep

    total, whole = steps(motion.targets[0].displacement), steps(motion.planned_displacement)
    every = max(1, round((total + (phases - 1) * whole + held) / scene.output.samples / READINGS))
    sample = every * READINGS
    load_steps = max(sample, math.ceil(total / sample) * sample)
    slower = total / load_steps
    motion = replace(
        motion,
        first=motion.first * slower,
        last=motion.last * slower,
        load_steps=load_steps,
        hold_steps=math.ceil((scene.platens.hold / timestep + held) / sample) * sample,
    )
    planned = motion.planned_steps
    frame = max(1, round(planned / scene.output.frames / sample)) * sample
    checkpoint = max(1, round(planned / CHECKPOINTS / frame)) * frame
    block = math.ceil(BLOCK / sample) * sample
    return motion, Sampling(sample, every, frame, checkpoint, block)


def mean_pace(speeds: tuple[float, float, float], allowed: tuple[float, float, float], d: FloatArray) -> float:
    """Mean over displacements ``d`` (n,) um of one (first, last, growth) over another."""

    def speed(of: tuple[float, float, float]) -> FloatArray:
        return np.minimum(of[0] * (1 + d / of[2]), of[1])

    return float(np.mean(speed(speeds) / speed(allowed)))


def depths_below_top(centres: FloatArray) -> FloatArray:
    """(n,) depth of each filament's centre below the highest, um; ``centres`` (n, 2) of y, z."""
    return np.asarray(np.max(centres[:, 1]) - centres[:, 1])
