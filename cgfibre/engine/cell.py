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
from cgfibre.errors import InputError
from cgfibre.plan.model import Contact

#: densest start of random sequential placing that is found quickly (it jams at 0.547)
LOOSEST, DENSEST_START = 0.05, 0.5


@dataclass(frozen=True)
class CellPath:
    """How a cell is squeezed: volume fractions at the start and at the deepest, evenly from all sides or from above
    alone, the speed um/us of the cell's faces, and rows of the record while it is squeezed."""

    start: float = 0.45
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


def run_cell(
    folder: Path,
    contact: Contact,
    diameter: float,
    mass: float,
    timestep: float,
    depth: float,
    path: CellPath,
    count: int,
    seed: int,
    engine: Engine | None = None,
) -> CellRecord:
    """Squeeze a random periodic cell of ``count`` discs along ``path`` in ``folder``; its record.

    ``contact`` of discs ``depth`` um long, of ``mass`` pg and ``diameter`` um; ``timestep`` us.
    """
    centres, side = random_cell(count, diameter, path.start, np.random.default_rng(seed))
    ratio = path.start / path.deepest
    scale = (1.0, ratio) if path.uniaxial else (math.sqrt(ratio), math.sqrt(ratio))
    way = side * (1 - min(scale)) / 2
    sample = max(5, math.ceil(way / path.speed / timestep / path.samples / 5) * 5)
    parameters: dict[str, float | int | str] = {
        "timestep_us": timestep,
        "depth_um": depth,
        "scale_across": scale[0],
        "scale_down": scale[1],
        "load_steps": sample * path.samples,
        "sample_steps": sample,
        "drag": 0.002 * mass,
        "turning_drag": 0.002 * mass * diameter**2 / 8,
    }
    write_deck(folder, "in.cell", parameters, f"A periodic cell of {count} discs, squeezed and let go")
    n = np.arange(1, count + 1)
    d = np.full(count, diameter)
    zero = np.zeros(count)
    data = DataFile(
        title="cgfibre, cell, units micro",
        atom_style="hybrid",
        atom_columns=[np.ones(count, dtype=np.int64), *centres.T, zero, d, mass / (math.pi / 6 * d**3), n],
        atom_format=["%d", *["%.17g"] * 5, "%d"],
        n_types=1,
        box=np.array([[-side / 2, side / 2], [-side / 2, side / 2], [-diameter, diameter]]),
        pair_style="granular",
        pair_rows=[(0, 0, pair_words(contact))],
    )
    write_data(folder / "system.data", data)
    run_deck(engine or find_engine(), folder, "in.cell", 1)
    rows = np.loadtxt(folder / "record.txt", ndmin=2)
    solid = count * math.pi * diameter**2 / 4
    return CellRecord(solid / (rows[:, 1] * rows[:, 2]), rows[:, 3], rows[:, 4], rows[:, 5], rows[:, 0] > sample * path.samples)
