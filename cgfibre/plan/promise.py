"""What a plan promises: the mean error of the loading force, with its parts."""

from __future__ import annotations

import math

from cgfibre.mechanics import rod
from cgfibre.plan.beads import platen_span
from cgfibre.plan.level import level_errors
from cgfibre.plan.model import ErrorPart, Motion
from cgfibre.plan.outline import Outline
from cgfibre.scene import Scene

#: mean error of a platen at its bound, over the accuracy of the bound (see SPEED_GAIN)
SPEED_ERROR = 0.5
#: the same of a section (see PILE_GAIN)
PILE_ERROR = 0.25
#: without a bound (long far fields, loose discs): the error at the planned speed, as measured on carbon-37-full-length
UNBOUNDED = 0.1
#: an error of all of the force: what is faster is promised nothing
NOTHING = 1.0
#: where filaments rearrange, the displacement at which they do so differs from run to run; mean over the curve
REARRANGEMENT = 0.03
#: beads a diameter apart against half of that: forces of carbon-37 differ by no more (measured)
BUMPS = 0.01
#: contacts softened by the planner: their overlap takes up a part of the displacement
SOFTENED = 0.01
#: the same of capsules, for every part of the stiffness that is missing (seven filaments: 8 % at a softening of 9)
CAPSULES_SOFTENED = 0.01


def promise(
    scene: Scene, out: Outline, level: str, spacing: float, softening: float, motion: Motion, capsule: bool = False
) -> tuple[ErrorPart, ...]:
    """Parts of the mean relative error of the force between the quasi-static start and the stop; they add up.

    Against a fine and slow model of the same scene: what no level models (see the omissions) is not in it.
    """
    if math.isfinite(motion.pace):
        speed = (PILE_ERROR if level == "section" else SPEED_ERROR) * motion.eps * max(motion.pace, motion.pace**2)
        reason = f"the platen is {motion.pace:.3g} times as fast as the accuracy allows"
        if speed >= NOTHING:
            speed, reason = NOTHING, f"{reason}: inertia is most of the force"
    else:
        speed, reason = UNBOUNDED, "no bound of the speed applies"
    parts = [ErrorPart("platen speed", speed, reason)]
    several = scene.bundle.count > 1
    if spacing > 0:
        width = 0.0 if scene.platens.width == "full" else float(scene.platens.width)
        clamped = scene.ends.support == "clamped"
        if level == "chain" and scene.platens.width != "full" and scene.ends.support != "symmetry":
            error = float(rod.chain_bending_error(spacing, scene.bundle.length, width=width, clamped=clamped))
            parts.append(ErrorPart("bead spacing", error, f"bending of a chain with beads {spacing:.3g} um apart"))
        if not several and not capsule:
            lo, hi = platen_span(scene)
            parts.append(ErrorPart("platens in beads", spacing / (hi - lo), "beads on the edges count whole"))
        if several and not capsule:
            parts.append(
                ErrorPart("bumps", BUMPS * spacing / scene.filament.diameter, "beads in place of a smooth side")
            )
    if several and softening > 1:
        share = CAPSULES_SOFTENED * (softening - 1) if capsule else SOFTENED * math.log10(softening)
        parts.append(ErrorPart("softened contacts", share, "their overlap"))
    if several:
        parts.append(ErrorPart("rearrangements", REARRANGEMENT, "filaments give way at slightly other displacements"))
    return tuple(parts + level_errors(scene, out, level))
