"""Weaves of round tows as chains and as rods: thickness under pressure, and what the two differ by in theory.

    python analysis/woven_rods.py [--out results/woven_rods]

Prints the rows of docs/fabrics.md: nylon-weave (a 2 x 2 cell, slowly), with ten times the bending stiffness, in other
patterns and with the limp yarns of the thesis' Table 8-2; the deflection of such a tow as an arch under 1 N. Minutes.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from cgfibre.cases.experiment import run
from cgfibre.engine.collect import read_run
from cgfibre.measure.compaction import thickness_at_pressure
from cgfibre.mechanics.woven_tow import WovenTow, arch
from cgfibre.plan.make import make_plan
from cgfibre.plan.system import build_system
from cgfibre.scene_reading import joined_overrides, load_scene

AT = np.array([0.05, 0.1, 0.2])  # MPa
SLOW = ["platens.stop.pressure=0.205 MPa", "model.accuracy=0.0125"]
#: limp tows give way further than the estimate that a stop by pressure is planned by
LIMP = [
    "assembly.tow.EI=0.0066 N*mm**2",
    "assembly.tow.GJ=0.0066 N*mm**2",
    "platens.stop.displacement=180 um",
]
SMOOTH = ["contact.friction=0", "platens.friction=0"]
TWILL = ["assembly.tows=4", "assembly.pattern=twill-2/2", "model.accuracy=0.025"]
WEAVES = {
    "plain": ["assembly.tows=2"],
    "plain, half the spacing": ["assembly.tows=2", "model.spacing=225 um"],
    "plain, EI x 10": ["assembly.tows=2", "assembly.tow.EI=125 N*mm**2"],
    "2/2 twill": TWILL,
    "satin": ["assembly.tows=5", "assembly.pattern=satin-5", "model.accuracy=0.025"],
    "plain, limp": ["assembly.tows=2", *LIMP],
    "plain, limp, no friction": ["assembly.tows=2", *LIMP, *SMOOTH],
    "twill, limp": [*TWILL, *LIMP],
}
#: level and factor on the shear stiffness
LEVELS = {"chain": ("chain", 1.0), "rod": ("rod", 1.0)}
SHEARLESS = {"rod, no shear": ("rod", 100.0)}


def row(folder: Path, sets: list[str], level: str, shear: float) -> str:
    """Thickness at the pressures, largest roll, processor seconds."""
    scene = load_scene("nylon-weave", joined_overrides(SLOW, sets, [f"model.level={level}"]))
    plan = make_plan(scene)
    system = build_system(scene, plan)
    system = replace(system, types=tuple(replace(t, kGA=shear * t.kGA) for t in system.types))
    out = run(folder, system, plan)
    curve, _, extremes = read_run(folder, system, plan)
    thickness = thickness_at_pressure(curve["thickness_um"], curve["pressure_MPa"], AT)
    numbers = ", ".join(f"{h:.2f}" for h in thickness)
    return f"{numbers} um | {float(np.max(extremes.turn)):.2g} rad | {out.time.cpu:.2g} CPU s"


def arches() -> None:
    """The tow of nylon-weave as an arch under 1 N: chain, rod without shear, rod."""
    scene = load_scene("nylon-weave")
    tow = build_system(scene, make_plan(scene)).types[0]
    for factor in (1, 10):
        one = WovenTow(scene.weave.spacing.weft, scene.weave.tow.thickness / 2, tow.EA, factor * tow.EI)
        chain, shearless = (arch(one, 1e9, dead=dead)[0] for dead in (True, False))
        sheared = arch(replace(one, kGA=tow.kGA), 1e9)[0]
        print(f"arch, EI x {factor}, 1 N: chain {chain:.4g}, rod without shear {shearless:.4g}, rod {sheared:.4g} um")


def main() -> None:
    """Rows as they come."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/woven_rods"))
    out = parser.parse_args().out
    arches()
    for name, sets in WEAVES.items():
        levels = LEVELS | (SHEARLESS if name == "plain" else {})
        for label, (level, shear) in levels.items():
            folder = out / f"{name} {label}".replace(" ", "_").replace("/", "-").replace(",", "")
            print(f"| {name} | {label} | {row(folder, sets, level, shear)} |", flush=True)


if __name__ == "__main__":
    main()
