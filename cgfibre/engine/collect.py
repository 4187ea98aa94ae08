"""From what a deck wrote to a Curve and Frames in the axes and units of the interface."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.engine.assemble import platen_heights
from cgfibre.engine.dump import RawRecord, frame_boxes, iterate_frames, read_record
from cgfibre.engine.mirror import moved_beads, whole_of
from cgfibre.plan.model import Plan
from cgfibre.record import Balance, Curve, Frames, phases

JOULE = 1e-15  # of nN um
NEWTON = 1e-9
MPA = 1e-3  # of kPa
NEWTON_PER_METRE = 1e-3  # of nN/um


@dataclass(frozen=True)
class Extremes:
    """What the guards need of every sample: closest pair of beads um, lowest and highest bead centre under the platen
    um, largest turn of a disc rad, displacement um. All (n_samples,)."""

    closest: FloatArray
    z_lo: FloatArray
    z_hi: FloatArray
    turn: FloatArray
    displacement: FloatArray
    balance: Balance | None = None


def _with_start(start: float, values: FloatArray) -> FloatArray:
    return np.concatenate([[start], values])


def curve_of(raw: RawRecord, system: FilamentSystem, plan: Plan) -> Curve:
    """The curve, with a first row for the assembly as built (platens touching, no force).

    thickness = gap of the platens as built - displacement; pressure = force / (contact length x present width);
    fibre volume fraction in the rectangle width x thickness. work_J is the work of the platens (the moving one's force
    over its path); stored_J the elastic energy and the potential of the dead load at the filaments' ends.
    """
    top, bottom = platen_heights(system, plan)
    diameter = float(np.max(system.diameter))
    m = raw.mean
    load = plan.beads.end_load
    potential = -load * (m["end_path"] - raw.start.get("end_path", 0.0))
    stored = m["stored"] - raw.start.get("stored", 0.0) + potential
    d = _with_start(0.0, m["displacement"])
    force = _with_start(0.0, m["top_force"])
    built = raw.start.get("y_hi", 0.0) - raw.start.get("y_lo", 0.0) + diameter
    area = math.pi / 4 * float(np.sum(system.diameter**2))
    if plan.woven is not None:  # of a cell: its extent in y, and the section through all of its fibres
        built, area = plan.woven.size[1], plan.woven.volume / plan.platens.contact_length
    cell = _cell_columns(raw, plan)
    if cell:  # it may have been strained before the platens move
        start = (cell[name][0] for name in ("cell_x_um", "cell_y_um", "shear_rad"))
        x, y, turn = (float(value) for value in start)
        built = x * y * math.cos(turn) / plan.platens.contact_length
    width = _with_start(built, m["width"])
    thickness = top - bottom - d
    step = _with_start(0.0, raw.step.astype(float))
    columns = {
        "step": step,
        "time_us": _with_start(0.0, raw.state["time"]) if "time" in raw.state else step * plan.timestep,
        "displacement_um": d,
        "thickness_um": thickness,
        "force_top_N": force * NEWTON,
        "force_bottom_N": _with_start(0.0, m["bottom_force"]) * NEWTON,
        "pressure_MPa": force / (plan.platens.contact_length * width) * MPA,
        "fibre_volume_fraction": area / (width * thickness),
        "kinetic_J": _with_start(0.0, m["kinetic"]) * JOULE,
        "stored_J": _with_start(0.0, stored) * JOULE,
        "work_J": np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(d))]) * JOULE,
    }
    phase = _with_start(0.0, m["phase"] if "phase" in m else phases(m["displacement"]).astype(float))
    cycle = _with_start(1.0, m["leg"] if "leg" in m else np.ones(len(m["displacement"])))
    return Curve(columns, np.rint(phase).astype(np.int64), width, np.rint(cycle).astype(np.int64), cell)


def _cell_columns(raw: RawRecord, plan: Plan) -> dict[str, FloatArray]:
    """Columns of a weave that is loaded in its plane, with the state at step 0 first; nothing of others.

    work_cell_J: forces over the paths of the edges, couple over the change of the angle.
    """
    c, w = raw.cell, plan.woven
    if w is None or not c:
        return {}
    work = np.zeros(len(c["edge_x"]))
    for force, path in (("pull_x", "edge_x"), ("pull_y", "edge_y"), ("couple", "turned")):
        f, u = c[force], c[path]
        work[1:] += np.cumsum(0.5 * (f[1:] + f[:-1]) * np.diff(u))
    return {
        "cell_x_um": c["edge_x"],
        "cell_y_um": c["edge_y"],
        "shear_rad": c["turned"],
        "tension_warp_N": c["pull_x"] / w.tows[0] * NEWTON,
        "tension_weft_N": c["pull_y"] / w.tows[1] * NEWTON,
        "shear_couple_N_per_m": c["couple"] / (c["edge_x"] * c["edge_y"]) * NEWTON_PER_METRE,
        "work_cell_J": work * JOULE,
    }


def extremes_of(raw: RawRecord) -> Extremes:
    """What the guards need of the record."""
    s = raw.state
    b = raw.balance
    balance = None
    if b:
        balance = Balance(
            springs=_with_start(0.0, b["spring_force"]) * NEWTON,
            drag=_with_start(0.0, b["drag_force"]) * NEWTON,
            momentum=_with_start(0.0, b["momentum"]) * NEWTON,
            contact=_with_start(0.0, b["contact_energy"]) * JOULE,
            factor=_with_start(1.0, b["factor"]),
        )
    return Extremes(s["closest"], s["z_lo"], s["z_hi"], s["turn"], s["displacement"], balance)


def displacement_at(plan: Plan, step: np.ndarray) -> FloatArray:
    """Platen displacement at each step of the first loading, um: the law of motion.inc."""
    m = plan.motion
    t = step * plan.timestep
    growth_time = m.growth / m.first * math.log(m.last / m.first)
    growing = m.growth * np.expm1(np.minimum(t, growth_time) * m.first / m.growth)
    return np.where(t < growth_time, growing, m.growth * (m.last / m.first - 1) + m.last * (t - growth_time))


def frames_of(folder: Path, system: FilamentSystem, plan: Plan, raw: RawRecord) -> Frames:
    """Frames of a deck's folder, of equal steps the last, in rising order; a frame cut short at the end is dropped.

    Frames lie on the record's steps, where it has the displacement; the factor of stiffened contacts is recorded as
    means over the windows, so it is read between their middles. A weave that is loaded in its plane comes with its box.
    """
    found: dict[int, FloatArray] = {}
    for step, positions in iterate_frames(folder / "trajectory.lammpstrj", moved_beads(system, plan)):
        if plan.flat:
            # a section's y, z were LAMMPS' x, y
            positions = np.column_stack([np.zeros(len(positions)), positions[:, 0], positions[:, 1]])
        found[step] = whole_of(positions, system, plan)
    steps = np.array(sorted(found), dtype=np.int64)
    stacked = np.stack([found[s] for s in steps.tolist()]) if found else np.empty((0, system.n_beads, 3))
    at = raw.step.astype(float)
    displacement = np.interp(steps, _with_start(0.0, at), _with_start(0.0, raw.state["displacement"]))
    factor = np.ones(len(steps))
    if raw.balance:
        middle = at - 0.5 * plan.sampling.sample
        factor = np.interp(steps, _with_start(0.0, middle), _with_start(1.0, raw.balance["factor"]))
    box, tilt = None, np.empty(0)
    if found and plan.woven is not None and plan.woven.moved:
        boxes = frame_boxes(folder / "trajectory.lammpstrj")
        box = np.repeat(system.box[None], len(steps), axis=0)
        box[:, :2] = [boxes[s][0][:2] for s in steps.tolist()]
        tilt = np.array([boxes[s][1] for s in steps.tolist()])
    return Frames(steps, displacement, stacked, factor, box, tilt)


def read_run(folder: Path, system: FilamentSystem, plan: Plan) -> tuple[Curve, Frames, Extremes]:
    """Curve, frames and extremes of a deck's folder, finished or not."""
    raw = read_record(folder)
    return curve_of(raw, system, plan), frames_of(folder, system, plan, raw), extremes_of(raw)
