"""The arches of a weave that is held in its plane: part of what its planner expects a crossing to carry."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.mechanics.arch import arch_force
from cgfibre.scene import Scene


def arches(scene: Scene, system: FilamentSystem, softening: float) -> Callable[[float], float]:
    """Force (nN) of the tows' flanks a crossing, against the way (um) by which the two axes there come nearer: each tow
    goes down by half of it.

    The sum of :func:`arch_force` over all passages of tows from side to side, over the crossings. ``softening`` divides
    EA. Tows with floats, and those along which the cell is free, or pulled at, have nothing to push against and bend
    alone.
    """
    w = scene.weave
    EA, EI = (np.array([getattr(t, name) for t in system.types]) for name in ("EA", "EI"))
    rows = []
    for tow in np.unique(system.tow):
        members = np.flatnonzero(system.tow == tow)
        first = int(members[0])
        line = system.positions[system.filament_start[first] : system.filament_start[first + 1]]
        warp = bool(abs(np.ptp(line[:, 0])) > abs(np.ptp(line[:, 1])))
        closed = bool(system.closed[first])
        row = _shape(line, w.size[0 if warp else 1] if closed else 0.0, 0 if warp else 1)
        if row is None:
            continue
        kind = system.filament_type[members]
        flank = w.spacing.weft if warp else w.spacing.warp
        # beside a float the thrust finds room
        floats = row[0] < (w.tows.weft if warp else w.tows.warp) - (not closed)
        axial = float(EA[kind].sum()) / softening if _held(scene, warp) and not floats else 0.0
        rows.append((*row, axial, float(EI[kind].sum()), flank))
    crossings = w.tows.warp * w.tows.weft
    passages, *shapes = np.array(rows).reshape(-1, 7).T  # all tows at once: the planner asks thousands of times

    def force(way: float) -> float:
        return float(np.sum(passages * arch_force(way / 2, *shapes))) / crossings

    return force


def _held(scene: Scene, warp: bool) -> bool:
    """Whether the cell cannot give along warp (or weft) tows."""
    cell = scene.in_plane
    strain, pull = (cell.strain.x, cell.tension.warp) if warp else (cell.strain.y, cell.tension.weft)
    return strain != 0 or (cell.edges != "free" and pull == 0)


def _shape(line: FloatArray, period: float, axis: int) -> tuple[int, float, float, float] | None:
    """(passages, amplitude um, crimp, steepest slope rad) of a tow's line; None of one that stays on its side."""
    if period > 0:
        image = line[0].copy()
        image[axis] += period
        line = np.vstack([line, image])
    z = line[:, 2]
    high = z > (z.max() + z.min()) / 2
    passages = int(np.sum(high[1:] != high[:-1]))
    if passages == 0:
        return None
    step = np.diff(line, axis=0)
    plane = np.hypot(step[:, 0], step[:, 1])
    crimp = float(np.sum(np.linalg.norm(step, axis=1)) / np.sum(plane) - 1)
    return passages, float(np.ptp(z)) / 2, crimp, float(np.arctan(np.max(np.abs(step[:, 2]) / plane)))
