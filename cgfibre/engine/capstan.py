"""The capstan in LAMMPS: a column of bead chains over a turning pulley with Coulomb friction (deck ``in.capstan``)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cgfibre.build.system import FloatArray
from cgfibre.engine.datafile import DataFile, Topology, write_data
from cgfibre.engine.deck import write_deck
from cgfibre.engine.dump import iterate_frames
from cgfibre.engine.lammps import Engine, EngineTime, run_deck
from cgfibre.errors import EngineError

DECK = "in.capstan"
#: tangential over normal stiffness of the contacts
TANGENTIAL = 0.8
#: change of T2 between the middle and the end of the run below which the slip is steady
STEADY = 1e-5


@dataclass(frozen=True)
class Rig:
    """Chains over a pulley: ``filaments`` of ``diameter`` (um), ``EA`` (nN) and ``mass`` (pg/um) with ``nodes`` each on
    ``wrap`` rad of a pulley of ``radius`` um, under a dead load of ``load`` nN on all together."""

    filaments: int
    diameter: float
    EA: float
    mass: float
    nodes: int
    radius: float
    wrap: float
    load: float

    @property
    def radii(self) -> FloatArray:
        """(n,) um: of the circles on which the beads of each filament stand, just touching."""
        return np.asarray(self.radius + self.diameter * (np.arange(self.filaments) + 0.5))

    @property
    def spacings(self) -> FloatArray:
        """(n,) um: between neighbouring beads of each filament, 2 r sin(theta/(2 n))."""
        return 2 * self.radii * math.sin(self.wrap / self.nodes / 2)

    @property
    def stiffness(self) -> FloatArray:
        """(n,) nN/um of each filament's bonds, EA/s."""
        return np.asarray(self.EA / self.spacings)

    def positions(self, sunk: FloatArray | float = 0.0) -> FloatArray:
        """(n, nodes + 2, 2) um: from the held end round the pulley to the load, ``sunk`` (n,) um into what lies below.

        Nodes stand at half turns from both ends of the wrap; the strands beyond lie along the polygon's sides, so that
        a filament turns by theta/n at its first and last node too.
        """
        turn = self.wrap / self.nodes
        angle = (np.arange(self.nodes) + 0.5) * turn
        on_pulley = np.column_stack([np.cos(angle), np.sin(angle)])
        held = np.array([math.sin(0.0), -math.cos(0.0)])  # at the angle 0 the belt comes from below
        load = np.array([-math.sin(self.wrap), math.cos(self.wrap)])
        made = []
        for r in (self.radii - sunk).tolist():
            p, s = r * on_pulley, 2 * r * math.sin(turn / 2)
            made.append(np.vstack([p[0] + s * held, p, p[-1] + s * load]))
        return np.array(made)

    @property
    def load_direction(self) -> tuple[float, float]:
        """Unit vector of the dead load."""
        return -math.sin(self.wrap), math.cos(self.wrap)


@dataclass(frozen=True)
class BeltRun:
    """What the deck gave: ``tension`` (n, nodes + 1) nN of every bond from the held end to the load, time spent, the
    relative change of T2 over the second half of the run."""

    tension: FloatArray
    spent: EngineTime
    change: float

    @property
    def ratio(self) -> float:
        """Sum of T2 over the load of all filaments."""
        return float(self.tension[:, 0].sum() / self.tension[:, -1].sum())


def run_belt(engine: Engine, folder: Path, rig: Rig, friction: float, between: float) -> BeltRun:
    """Run the deck with Coulomb friction on the pulley and between the filaments; tensions in steady slip.

    Raises EngineError when the engine stops or the slip did not become steady.
    """
    points = rig.positions()
    n, m = points.shape[:2]
    stiffness = float(rig.stiffness.max())
    mass = float(rig.mass * rig.spacings.mean())
    timestep = 0.15 * math.sqrt(mass / stiffness)
    frequency = math.pi / 2 / (m * float(rig.spacings.mean())) * math.sqrt(rig.EA / rig.mass)
    along = rig.load_direction
    load = rig.load / n
    steps = 40_000
    # far enough for every contact to slip: its spring and the filament's own stretch
    reach = 5 * rig.load * math.exp(friction * rig.wrap) * (1 / stiffness + rig.wrap * rig.radius / rig.EA)
    parameters: dict[str, float | int | str] = {
        "pulley_radius_um": rig.radius,
        "friction": friction,
        "between": between,
        "kn": stiffness,
        "kt": TANGENTIAL * stiffness,
        "load_x_nN": load * along[0],
        "load_y_nN": load * along[1],
        "drag": 2 * mass * frequency,
        "surface_speed": reach / (steps * timestep),
        "timestep_us": timestep,
        "steps": steps,
        "ghost_cutoff_um": 2.5 * float(rig.spacings.max()),
    }
    about = f"cgfibre deck of a capstan: {n} filaments, {rig.nodes} nodes on {rig.wrap:g} rad."
    write_deck(folder, DECK, parameters, about)
    words = f"hooke {stiffness:.17g} 0 tangential linear_history {TANGENTIAL * stiffness:.17g} 1.0 {between:.17g}"
    data = capstan_data(rig, points, rig.spacings, mass, ("granular", f"{words} damping velocity"))
    write_data(folder / "system.data", data)
    spent = run_deck(engine, folder, DECK)
    frames = [x.reshape(n, m, 3)[:, :, :2] for _, x in iterate_frames(folder / "beads.lammpstrj", n * m)]
    if len(frames) < 3:
        raise EngineError("the capstan deck left no frames", f"read {folder / 'log.lammps'}")
    tension = [
        rig.stiffness[:, None] * (np.linalg.norm(np.diff(x, axis=1), axis=2) - rig.spacings[:, None])
        for x in frames[-2:]
    ]
    change = float(tension[1][:, 0].sum() / tension[0][:, 0].sum()) - 1
    if not abs(change) < STEADY:
        raise EngineError(f"the filaments do not slip steadily: T2 still changes by {change:.1e}", "a stronger load")
    return BeltRun(tension[1], spent, change)


def capstan_data(rig: Rig, points: FloatArray, natural: FloatArray, mass: float, pair: tuple[str, str]) -> DataFile:
    """Data file of the chains at ``points`` (n, m, 2) um with bonds of length ``natural`` (n,) um at rest, beads of
    ``mass`` pg; ``pair`` style and coefficients."""
    n, m = points.shape[:2]
    xy = points.reshape(-1, 2)
    kind = np.ones((n, m), dtype=np.int64)
    kind[:, 0], kind[:, -1] = 3, 2
    density = mass / (math.pi / 6 * rig.diameter**3)
    count = n * m
    first = np.arange(count).reshape(n, m)[:, :-1].ravel()
    bonds = Topology(
        "Bond",
        np.column_stack([first, first + 1]),
        np.repeat(np.arange(n), m - 1),
        [(0.5 * k, s) for k, s in zip(rig.stiffness.tolist(), natural.tolist(), strict=True)],
        "harmonic",
    )
    margin = 10 * float(rig.spacings.max())
    box = np.array([[xy[:, 0].min(), xy[:, 0].max()], [xy[:, 1].min(), xy[:, 1].max()], [-100.0, 100.0]])
    box[:2] += np.array([-margin, margin])
    return DataFile(
        "capstan",
        "hybrid sphere molecular",
        [
            kind.ravel(),
            *xy.T,
            np.zeros(count),
            np.full(count, rig.diameter),
            np.full(count, density),
            np.repeat(np.arange(1, n + 1), m),
        ],
        ["%d", "%.17g", "%.17g", "%.17g", "%.17g", "%.17g", "%d"],
        3,
        box,
        pair[0],
        [(i, j, pair[1]) for i in range(3) for j in range(i, 3)],
        [bonds],
    )
