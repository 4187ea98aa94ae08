"""Platen motion of a plan: as fast as the accuracy allows, slow at the first touch, faster as the force grows."""

from __future__ import annotations

import math

import numpy as np

from cgfibre.build.system import FloatArray
from cgfibre.errors import InputError
from cgfibre.mechanics.support import bundle_bending_force, quasi_static_speed
from cgfibre.plan.model import Choice, Motion, Sampling
from cgfibre.scene import Scene

#: the displacement over diameter from which on the accuracy asked for shall hold
REFERENCE_DISPLACEMENT = 2 / 7
#: the speed may grow to this many times its first value
SPEED_RATIO = 5.0
#: loading steps beyond which an automatic speed is raised; the plan then says from which force on it is quasi-static
STEP_BUDGET = 400_000
READINGS = 20  # of forces within a record row
CHECKPOINTS = 20  # a run
DENSEST = math.pi / (2 * math.sqrt(3))  # hexagonal packing of touching circles


def film_time(first: float, last: float, growth: float, displacement: float) -> float:
    """Time to a displacement, us: v = first (1 + d/growth) up to ``last``; the inverse of the deck's motion.inc."""
    end = growth * (last / first - 1)
    if displacement <= end:
        return growth / first * math.log1p(displacement / growth)
    return growth / first * math.log(last / first) + (displacement - end) / last


def planned_displacement(scene: Scene, height: float, width: float, n_filaments: int) -> float:
    """Displacement at the planned stop, um; for a stop by force or pressure the one at solid packing.

    Raises InputError when the stop lies beyond solid packing (hexagonal, 0.9069, over the present width).
    """
    stop = scene.platens.stop
    d = scene.filament.diameter
    # the assembly may spread to one flat layer, so only that is impossible
    deepest = height - d
    if stop.displacement is not None:
        if stop.displacement >= deepest:
            raise InputError("platens.stop.displacement", f"{stop.displacement:g} um",
                             f"less than {deepest:.4g} um: the assembly is {height:.4g} um high and one filament stays")
        return stop.displacement
    if stop.thickness is not None:
        if not d < stop.thickness < height:
            raise InputError("platens.stop.thickness", f"{stop.thickness:g} um",
                             f"between one diameter ({d:g} um) and the height as built ({height:.4g} um)")
        return height - stop.thickness
    solid = n_filaments * math.pi * d**2 / 4 / (DENSEST * width)
    return min(deepest, max(0.3 * height, height - 0.9 * solid))


def plan_motion(
    scene: Scene,
    *,
    depths: FloatArray,
    filament_stiffness: float,
    contact_stiffness: float,
    mass: float,
    timestep: float,
    pitch: float,
    displacement: float,
) -> tuple[Motion, Sampling, list[Choice]]:
    """Speeds, phases and sampling.

    The first speed is eps F/sqrt(kn m) with F the bending force of the filaments engaged at 2/7 D (2 um for carbon);
    it grows with displacement as that force does, at most five times. ``depths`` um of the filaments below the top
    one; ``filament_stiffness`` nN/um of one filament under the platen.
    """
    choices = []
    d = scene.filament.diameter
    eps = scene.model.accuracy
    reference = min(REFERENCE_DISPLACEMENT * d, displacement / 2)
    force = float(bundle_bending_force(reference, depths, filament_stiffness, diameter=d, pitch=pitch))
    wanted = float(quasi_static_speed(eps, force, contact_stiffness, mass))
    growth = 2 * reference
    asked = scene.platens.speed
    if asked == "auto":
        first, last = wanted, SPEED_RATIO * wanted
        steps = film_time(first, last, growth, displacement) / timestep
        faster = max(1.0, steps / STEP_BUDGET)
        first, last = first * faster, last * faster
        reason = (f"accuracy {eps:g}: v <= eps F/sqrt(kn m) with F = {force:.3g} nN of bending at {reference:.3g} um, "
                  "growing with the force")
        if faster > 1.001:
            reason += f"; raised {faster:.3g} times to end within {STEP_BUDGET} steps"
        choices.append(Choice("platen speed", f"{first:.4g} to {last:.4g} m/s", reason))
    else:
        first = last = float(asked)
        choices.append(Choice("platen speed", f"{first:.4g} m/s", "as asked in the scene"))
    quasi_static = first * math.sqrt(contact_stiffness * mass) / eps
    choices.append(Choice("quasi-static from", f"{quasi_static * 1e-9:.3g} N on a bead's neighbourhood",
                          "v sqrt(kn m)/eps: below this force inertia is more than the accuracy asked for"))
    unload = scene.platens.unload
    phases = 2 if unload else 1
    total = film_time(first, last, growth, displacement) / timestep
    every = max(1, round(total * phases / scene.output.samples / READINGS))
    sample = every * READINGS
    load_steps = max(sample, math.ceil(total / sample) * sample)
    # a little slower, so that the last whole window ends at the planned displacement itself
    first, last = first * total / load_steps, last * total / load_steps
    hold = math.ceil(scene.platens.hold / timestep / sample) * sample
    planned = load_steps * phases + hold
    frame = max(1, round(planned / scene.output.frames / sample)) * sample
    checkpoint = max(1, round(planned / CHECKPOINTS / frame)) * frame
    stop = scene.platens.stop
    motion = Motion(
        first=first,
        last=last,
        growth=growth,
        load_steps=load_steps,
        hold_steps=hold,
        unload=unload,
        stop_force=stop.force if stop.force is not None else math.inf,
        stop_pressure=stop.pressure if stop.pressure is not None else math.inf,
        planned_displacement=displacement,
        quasi_static_force=quasi_static,
    )
    return motion, Sampling(sample, every, frame, checkpoint), choices


def depths_below_top(centres: FloatArray) -> FloatArray:
    """(n,) depth of each filament's centre below the highest, um; ``centres`` (n, 2) of y, z."""
    return np.asarray(np.max(centres[:, 1]) - centres[:, 1])
