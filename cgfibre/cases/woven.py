"""Woven tows against closed forms, through the decks of weaves: arches between crossings, free of stress at the start.

Levels chain and rod; s/D is the bead spacing over the tow's diameter.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cgfibre.build.system import FilamentSystem
from cgfibre.cases.experiment import Measured
from cgfibre.cases.rods import at_rest
from cgfibre.mechanics.woven_tow import WovenTow, arch
from cgfibre.plan.make import make_plan
from cgfibre.plan.model import Plan
from cgfibre.plan.system import build_system
from cgfibre.scene_reading import scene_from_dict

D, SPACING = 300.0, 6000.0  # um, of the tows and from crossing to crossing
#: deflection of an arch over its height
DEEP = 0.05


def woven(level: str, spacing: float) -> tuple[Plan, FilamentSystem]:
    """Plan and system of a 2 x 2 cell, plain, of solid round nylon tows, a diameter apart where they cross."""
    data: dict[str, Any] = {
        "filament": {"material": "nylon"},
        "assembly": {
            "kind": "weave",
            "spacing": f"{SPACING} um",
            "gap": f"{D} um",  # arches never meet
            "tow": {"thickness": f"{D} um", "modulus": "1 GPa"},
        },
        "platens": {"stop": {"displacement": "10 um"}},
        "model": {"resolve": "tow", "level": level, "spacing": f"{spacing * D} um"},
    }
    scene = scene_from_dict(data)
    plan = make_plan(scene)
    return plan, build_system(scene, plan)


def tow_of(system: FilamentSystem, level: str) -> WovenTow:
    """A tow of the cell as the closed forms take it; chains do not shear."""
    t = system.types[0]
    return WovenTow(SPACING, float(np.max(system.positions[:, 2])), t.EA, t.EI, t.kGA if level == "rod" else math.inf)


def woven_arch(folder: Path, level: str, spacing: float) -> list[Measured]:
    """Crests pushed down and troughs up by a twentieth of their height: against Reissner's beam of that natural shape,
    for chains under the constant forces that keep it."""
    plan, system = woven(level, spacing)
    tow = tow_of(system, level)
    load = DEEP * tow.amplitude / arch(tow, 1.0)[0]
    exact = arch(tow, load, dead=level == "chain")[0]
    z = system.positions[:, 2]
    crests, troughs = (np.flatnonzero(sign * z > (1 - 1e-9) * tow.amplitude) + 1 for sign in (1, -1))
    commands = []
    for name, beads, sign in (("crests", crests, -1), ("troughs", troughs, 1)):
        commands += [
            f"group {name} id " + " ".join(map(str, beads)),
            f"fix load_{name} {name} addforce 0 0 {sign * load:.17g}",
            f"compute {name} {name} reduce ave z",
        ]
    mass = system.types[0].mass_per_length
    frequency = tow.wave**2 * math.sqrt((tow.EI + tow.EA * tow.amplitude**2 / 2) / mass)
    # room for the platens, out of the way
    box = system.box.copy()
    box[2] = -10 * D, 10 * D
    rows, out = at_rest(
        folder, (plan, replace(system, box=box)), commands, "c_crests c_troughs", frequency, 1e-8, bin_um=0.0
    )
    found = tow.amplitude - (rows[0] - rows[1]) / 2
    return [Measured("woven arch", level, spacing, "deflection", "um", float(found), exact, out.time.cpu)]
