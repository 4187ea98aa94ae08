"""A periodic cell of discs, squeezed and let go: what a sub-bundle among its like answers by its contacts alone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cgfibre.build.system import FloatArray
from cgfibre.engine.assemble import pair_words
from cgfibre.engine.datafile import DataFile, write_data
from cgfibre.engine.deck import write_deck
from cgfibre.engine.lammps import Engine, find_engine, run_deck
from cgfibre.engine.plugin import copy_plugin, plugin_variables
from cgfibre.engine.subbundle import LAW_FILE, table_text
from cgfibre.errors import InputError
from cgfibre.plan.contact import TANGENTIAL_DAMPING, TANGENTIAL_RATIO
from cgfibre.plan.model import Contact

#: densest start of random sequential placing that is found quickly (it jams at 0.547)
LOOSEST, DENSEST_START = 0.05, 0.5
#: background drag of a disc's motion relative to the cell, 1/us
DRAG = 0.002
#: how much faster a loose cell is squeezed
LOOSE_SPEED = 4.0


@dataclass(frozen=True)
class CellPath:
    """How a cell is squeezed: volume fractions at the start, up to which it is loose and may go LOOSE_SPEED times as
    fast, and at the deepest; evenly from all sides or from above alone, the speed um/us of the cell's faces, and rows
    of the record while it is squeezed."""

    start: float = 0.45
    loose: float = 0.74
    deepest: float = 1.0
    uniaxial: bool = False
    speed: float = 0.05
    samples: int = 400


@dataclass(frozen=True)
class CellRecord:
    """What a cell answered, row by row of the record: volume fraction of whole discs, mean stresses across and down
    (kPa, compression positive, with the shear stress), and which rows are of letting go."""

    fraction: FloatArray
    across: FloatArray
    down: FloatArray
    shear: FloatArray
    unloading: np.ndarray

    @property
    def pressure(self) -> FloatArray:
        """Mean of both normal stresses, kPa."""
        return (self.across + self.down) / 2


def random_cell(count: int, diameter: float, fraction: float, rng: np.random.Generator) -> tuple[FloatArray, float]:
    """(centres (count, 2) um, side um) of discs placed one by one at random in a periodic square, without overlap.

    Raises InputError for a volume fraction out of 0.05..0.5: beyond, hardly a place is found.
    """
    if not LOOSEST <= fraction <= DENSEST_START:
        raise InputError("start", fraction, f"a volume fraction from {LOOSEST} to {DENSEST_START}")
    side = math.sqrt(count * math.pi * diameter**2 / 4 / fraction)
    centres = np.empty((count, 2))
    placed = 0
    while placed < count:
        trial = rng.random(2) * side
        gap = np.abs(centres[:placed] - trial)
        gap = np.minimum(gap, side - gap)
        if placed == 0 or float(np.min(np.sum(gap**2, axis=1))) >= diameter**2:
            centres[placed] = trial
            placed += 1
    return centres - side / 2, side


@dataclass(frozen=True)
class CellDisc:
    """Discs of a cell: ``diameter`` um, ``mass`` pg, ``solid`` um2 of fibre in each, time step us, ``depth`` um, their
    contact, and for a tabulated one its ``law``: overlap um and force nN/um of depth."""

    diameter: float
    mass: float
    solid: float
    timestep: float
    depth: float
    contact: Contact
    law: tuple[FloatArray, FloatArray] | None = None


def run_cell(
    folder: Path, disc: CellDisc, path: CellPath, count: int, seed: int, engine: Engine | None = None
) -> CellRecord:
    """Squeeze a random periodic cell of ``count`` discs along ``path`` in ``folder``; its record."""
    engine = engine or find_engine()
    c, d = disc.contact, disc.diameter
    # discs of another size than their fibre: the path speaks of the fibre
    packed = path.start * math.pi * d**2 / 4 / disc.solid
    centres, side = random_cell(count, d, min(packed, DENSEST_START), np.random.default_rng(seed))

    def scales(fraction: float) -> tuple[float, float]:
        ratio = count * disc.solid / side**2 / fraction
        return (1.0, ratio) if path.uniaxial else (math.sqrt(ratio), math.sqrt(ratio))

    loose, scale = scales(path.loose), scales(path.deepest)
    steps = side * (min(loose) - min(scale)) / 2 / path.speed / disc.timestep
    sample = max(5, math.ceil(steps / path.samples / 5) * 5)
    first = side * (1 - min(loose)) / 2 / (LOOSE_SPEED * path.speed) / disc.timestep
    loose_steps = math.ceil(first / sample) * sample
    parameters: dict[str, float | int | str] = {
        "timestep_us": disc.timestep,
        "depth_um": disc.depth,
        "scale_across": scale[0],
        "scale_down": scale[1],
        "loose_across": loose[0],
        "loose_down": loose[1],
        "loose_steps": loose_steps,
        "load_steps": sample * path.samples,
        "sample_steps": sample,
        "drag": DRAG * disc.mass,
        "turning_drag": DRAG * disc.mass * d**2 / 8,
    }
    if disc.law is not None:
        parameters |= {
            "contact_shape": "subbundle",
            "contact_law": f"table {LAW_FILE} PAIR",
            "contact_damping": c.gamma,
            "contact_friction": c.friction,
            "contact_kt_ratio": TANGENTIAL_RATIO,
            "tangential_damping": TANGENTIAL_DAMPING,
        }
    write_deck(folder, "in.cell", parameters, f"A periodic cell of {count} discs, squeezed and let go")
    if disc.law is not None:
        copy_plugin(folder, engine)
        (folder / LAW_FILE).write_text(table_text({"PAIR": disc.law}, "overlap um, force nN/um of depth"))
        for name, value in (("pair_first", 1.0), ("pair_second", 1.0), ("pair_lengths", disc.depth)):
            (folder / f"{name}.txt").write_text(f"{value:.17g}\n")
    diameters = np.full(count, d)
    zero = np.zeros(count)
    data = DataFile(
        title="cgfibre, cell, units micro",
        atom_style="hybrid",
        atom_columns=[
            np.ones(count, dtype=np.int64),
            *centres.T,
            zero,
            diameters,
            disc.mass / (math.pi / 6 * diameters**3),
            np.arange(1, count + 1),
        ],
        atom_format=["%d", *["%.17g"] * 5, "%d"],
        n_types=1,
        box=np.array([[-side / 2, side / 2], [-side / 2, side / 2], [-d, d]]),
        pair_style="granular",
        pair_rows=[] if disc.law is not None else [(0, 0, pair_words(c))],
    )
    write_data(folder / "system.data", data)
    run_deck(engine, folder, "in.cell", 1, plugin_variables(folder, engine))
    rows = np.loadtxt(folder / "record.txt", ndmin=2)
    fraction = count * disc.solid / (rows[:, 1] * rows[:, 2])
    return CellRecord(fraction, rows[:, 3], rows[:, 4], rows[:, 5], rows[:, 0] > loose_steps + sample * path.samples)
