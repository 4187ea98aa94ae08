"""Segments by themselves in the real engine: a bare deck of polylines, their forces and contacts."""

from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from cgfibre.cases.capsule_ranks import states
from cgfibre.engine.lammps import find_engine, run_deck
from cgfibre.engine.plugin import copy_plugin, plugin_variables

DECK = """\
variable plugin index ./cgfibre_plugin.so
variable reach index 10.0
variable law index "line 5.5e6"
variable skin index 1.0
variable sides index one
units micro
atom_style hybrid sphere bond
boundary {boundary}
newton on
comm_modify vel yes cutoff $(3.3*v_reach+10)
atom_modify map array sort 0 0
bond_style zero nocoeff
special_bonds lj 0 0 0
include plugin.inc
pair_style capsule ${{reach}} sides ${{sides}}
read_data system.data
bond_coeff *
pair_coeff * * ${{law}}
neighbor ${{skin}} bin
neigh_modify exclude molecule/intra all
thermo_modify lost error flush yes
compute rows all capsule/local
dump forces all custom 1 forces.txt id fx fy fz
dump_modify forces sort id format float "%.17g"
dump rows all local 1 rows.txt c_rows[*]
dump_modify rows format float "%.17g"
timestep 1e-9
run 0
print "cgfibre: done"
"""


@dataclass(frozen=True)
class Box:
    """Edges um and whether the box is periodic."""

    edges: np.ndarray
    periodic: bool = False


@dataclass(frozen=True)
class Found:
    """(n_beads, 3) forces in the order of beads, and rows of compute capsule/local."""

    forces: np.ndarray
    rows: np.ndarray = field(repr=False)


def forces_on(folder: Path, filaments, box: Box, ranks=1, diameter=7.0, engine=None, **variables):
    """Forces on polylines, (n, 3) um each, at rest; one molecule each, in their order."""
    folder.mkdir(parents=True, exist_ok=True)
    engine = find_engine() if engine is None else engine
    (folder / "plugin.inc").write_text("plugin load ${plugin}\ncgfibre_plugin\n")
    copy_plugin(folder, engine)
    (folder / "in.bench").write_text(DECK.format(boundary="p p p" if box.periodic else "m m m"))
    points = np.concatenate(filaments)
    start = np.cumsum([0, *(len(f) for f in filaments)])
    bonds = [(k + 1, k + 2) for a, b in pairwise(start.tolist()) for k in range(a, b - 1)]
    molecule = np.repeat(np.arange(1, len(filaments) + 1), np.diff(start))
    lines = ["segments", "", f"{len(points)} atoms", f"{len(bonds)} bonds", "1 atom types", "1 bond types"]
    lines += ["2 extra bond per atom", "4 extra special per atom"]
    lines += [f"{lo:.17g} {hi:.17g} {n}lo {n}hi" for n, (lo, hi) in zip("xyz", box.edges, strict=True)]
    lines += ["", "Atoms", ""]
    density = 1.8
    lines += [
        f"{k + 1} 1 {x:.17g} {y:.17g} {z:.17g} {diameter:g} {density} {m}"
        for k, ((x, y, z), m) in enumerate(zip(points.tolist(), molecule.tolist(), strict=True))
    ]
    lines += ["", "Bonds", "", *(f"{k + 1} 1 {a} {b}" for k, (a, b) in enumerate(bonds)), ""]
    (folder / "system.data").write_text("\n".join(lines))
    given = plugin_variables(folder, engine) | {k: str(v) for k, v in variables.items()}
    run_deck(engine, folder, "in.bench", ranks, given)
    rows = (folder / "rows.txt").read_text().split("ITEM: TIMESTEP\n")[1].splitlines()[8:]
    table = np.array([line.split() for line in rows], dtype=float).reshape(-1, 19)
    return Found(states(folder / "forces.txt")[0], table[np.lexsort((table[:, 1], table[:, 0]))])
