"""Capsules on ranks: the same forces and the same curve whoever computes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.cases.experiment import Outcome, moved, planned, run_on
from cgfibre.plan.model import Plan


def bundle(level: str, changes: dict[str, object] | None = None) -> tuple[Plan, FilamentSystem]:
    """Nineteen filaments of 60 D, segments of 4 D, packed at random within 0.3 um, with friction on each other and on
    the platens."""
    own: dict[str, object] = {
        "model.level": f"{level}, capsules",
        "model.spacing": "28 um",
        "assembly.count": 19,
        "assembly.length": "420 um",
        "assembly.jitter": "0.3 um",
        "assembly.seed": 5,
        "platens.width": "280 um",
        "platens.friction": 0.3,
        "platens.stop": {"displacement": "8 um"},
    }
    return planned(own | (changes or {}))


def states(path: Path) -> list[FloatArray]:
    """(n_beads, columns) of every frame of a dump that is sorted by number, without the number."""
    blocks = path.read_text().split("ITEM: TIMESTEP\n")[1:]
    return [np.array([line.split()[1:] for line in b.splitlines()[8:]], dtype=float) for b in blocks]


def forces(
    folder: Path, system: FilamentSystem, plan: Plan, ranks: int, commands: Sequence[str] = (), contacts: bool = False
) -> tuple[FloatArray, FloatArray]:
    """((n_beads, 3) forces on the beads as they lie, rows of compute capsule/local in the order of beads)."""
    out = run_on(
        ranks,
        folder,
        system,
        moved(plan, 1e-9, 20, sample=20),
        [
            *commands,
            "compute rows all capsule/local",
            "dump forces all custom 20 forces.txt id fx fy fz",
            'dump_modify forces sort id format float "%.17g"',
            "dump rows all local 20 rows.txt c_rows[*]",
            'dump_modify rows format float "%.17g"',
        ],
    )
    found = states(out.folder / "forces.txt")[0]
    rows = (out.folder / "rows.txt").read_text().split("ITEM: TIMESTEP\n")[1].splitlines()[8:]
    table = np.array([line.split() for line in rows], dtype=float)
    return found, table[np.lexsort((table[:, 1], table[:, 0]))]


def squeezed(system: FilamentSystem) -> FilamentSystem:
    """The bundle with its filaments pushed together to 0.8 of their distances: every neighbour touches."""
    return replace(system, positions=system.positions * np.array([1.0, 0.8, 0.8]))


def pressed(
    folder: Path, level: str, ranks: int, commands: Sequence[str] = (), steps: int = 4000
) -> tuple[Plan, FilamentSystem, Outcome]:
    """The bundle pressed by 6 um: plan, the system as it lies then, outcome with 40 rows of the record."""
    plan, system = bundle(level)
    n = system.n_beads
    out = run_on(
        ranks,
        folder,
        system,
        moved(plan, 6.0 / steps / plan.timestep, steps, sample=steps // 40),
        [
            *commands,
            f"group beads id 1:{n}",
            f"dump last beads custom {steps} last.txt id xu yu zu",
            'dump_modify last sort id format float "%.17g"',
        ],
    )
    return plan, replace(system, positions=states(out.folder / "last.txt")[-1]), out
