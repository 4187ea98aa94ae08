"""One filament alone under a moving platen, nothing below it: what the platen's speed and the spacing get wrong."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from cgfibre.cases.experiment import Measured, moved, planned, run
from cgfibre.mechanics import rod
from cgfibre.mechanics.elastica import spring_law
from cgfibre.plan.motion import REFERENCE_DISPLACEMENT

#: um, of the platen: one filament alone may be dented by half its diameter at most
DEPTH = 3.4
WIDTH = 500.0
#: steps of the way down of pressed_deep
DEEP_STEPS = 200_000
DIAMETER = 7.0
TENSION = 4e5  # nN, of experiment.SCENE
#: so far below that it is never met
BELOW = -1000.0


def pressed_alone(folder: Path, level: str, spacing: float, accuracy: float, length: float = 700.0) -> list[Measured]:
    """A tensioned carbon filament of ``length`` um bent by a flat platen at the planned speed of an ``accuracy``.

    ``spacing`` s/D (of no use to a section). The exact force is that of the pre-tensioned beam (rods: with shear) and
    of the contacts at the platen's two edges in series, d/(C + 1/(n kn)); small deflection, so deviations of (d/a)^2, a
    the free span beside the platen, are none of the method's. Returns the mean of abs(F/F_exact - 1) beyond 2/7 D
    (exact: 0) and the force at the end.
    """
    changes: dict[str, object] = {
        "assembly.length": f"{length!r} um",
        "platens.width": f"{WIDTH!r} um",
        "platens.stop.displacement": f"{DEPTH!r} um",
        "model.level": level,
        "model.accuracy": accuracy,
        "model.most_steps": 10**9,
    }
    edges = 1
    if level != "section":
        edges = 2
        changes["model.spacing"] = f"{spacing * DIAMETER!r} um"
    plan, system = planned(changes)
    f = system.types[0]
    out = run(folder, system, plan, platen_bottom_um=BELOW)
    compliance = float(
        rod.platen_compliance(length, f.EI, width=WIDTH, tension=TENSION, kGA=f.kGA if level == "rod" else math.inf)
    ) + 1 / (edges * plan.platens.kn)
    shift, force = out.record.mean["displacement"], out.record.mean["top_force"]
    late = shift >= REFERENCE_DISPLACEMENT * f.diameter
    error = float(np.mean(np.abs(force[late] * compliance / shift[late] - 1)))
    case = f"pressed alone, accuracy {accuracy:g}"
    own = 0.0 if level == "section" else spacing
    return [
        Measured(case, level, own, "mean force error", "1", error, 0.0, out.time.cpu),
        Measured(
            case, level, own, "force at the end", "nN", float(force[-1]), float(shift[-1] / compliance), out.time.cpu
        ),
    ]


def pressed_deep(folder: Path, level: str, spacing: float, depth: float, length: float = 700.0) -> list[Measured]:
    """A tensioned carbon filament bent ``depth`` um deep by a flat frictionless platen, against the elastica.

    ``level`` a chain (with capsules: its platen has sharp edges) or the section, whose springs are that law. Compliance
    of the contact at the edges and inertia are not in the closed form. Forces at a half and at all of the depth.
    """
    changes: dict[str, object] = {
        "assembly.length": f"{length!r} um",
        "platens.width": f"{WIDTH!r} um",
        "platens.stop.displacement": f"{DEPTH!r} um",
        "model.level": level,
    }
    if level == "section":
        changes |= {"model.spring": "elastica", "contact.shape": "auto"}
    else:
        # both ends slide, as in scenes of straight filaments: one end held would shift all of it under the platen
        changes |= {"model.spacing": f"{spacing * DIAMETER!r} um", "model.symmetry": "half"}
    plan, system = planned(changes)
    f = system.types[0]
    law = spring_law(length, f.EI, TENSION, WIDTH, depth)
    if level == "section":
        plan = replace(plan, spring_law=law, stiffen=1.0)
    steps = DEEP_STEPS
    plan = moved(plan, depth / steps / plan.timestep, steps, sample=steps // 100)
    out = run(folder, system, plan, platen_bottom_um=BELOW)
    shift, force = out.record.mean["displacement"], out.record.mean["top_force"]
    found = []
    for part in (0.5, 0.98):
        value = float(np.interp(part * depth, shift, force))
        case = f"pressed alone to {part * depth:.4g} um"
        exact = float(law(part * depth))
        own = 0.0 if level == "section" else spacing
        found.append(Measured(case, level, own, "force", "nN", value, exact, out.time.cpu))
    return found
