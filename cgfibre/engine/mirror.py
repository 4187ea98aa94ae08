"""The right half of an assembly that is its own mirror image about mid-span: what the engine moves of it, and back.

There the filaments run at right angles to the plane of symmetry: the first bead keeps its x, and its hinge turns
against a bead held far away on the left, whose direction from there hardly changes (forces err by 2e-4). Where
filaments touch by their beads, the plane lies midway between two beads, so that no bead is halved. Where they touch
along segments, it lies on a bead, so that no segment is: that bead has half its mass and, turning half as much as the
whole filament's hinge there, twice the hinge's stiffness.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.plan.model import LEFT, Beads, Plan

FAR = 3000.0  # lengths to the held beads: they err by the mid-span's deflection over that, beside slopes of it over L


def _split(beads: Beads) -> tuple[int, float]:
    """(first station of the right half, x of the plane); an odd number of stations has one on the plane."""
    n = len(beads.stations)
    return n // 2, float(beads.stations[0] + beads.stations[-1]) / 2


def _on_bead(beads: Beads) -> bool:
    return len(beads.stations) % 2 == 1


def right_half(system: FilamentSystem, plan: Plan) -> tuple[FilamentSystem, Plan]:
    """(system, plan) of the right half, every filament with its held bead first; as they are without symmetry."""
    if plan.beads.support != "symmetric":
        return system, plan
    first, plane = _split(plan.beads)
    n, old = system.n_filaments, plan.beads
    far = FAR * float(old.stations[-1] - old.stations[0])
    whole = system.positions.reshape(n, len(old.stations), 3)[:, first:]
    held = whole[:, :1] - np.array([far, 0.0, 0.0])
    positions = np.concatenate([held, whole], axis=1)
    box = system.box.copy()
    box[0, 0] = plane - far - 10 * plan.spacing
    half = replace(
        system,
        positions=positions.reshape(-1, 3),
        filament_start=np.arange(n + 1, dtype=np.int64) * positions.shape[1],
        box=box,
    )
    mass, hinge = old.mass[first:].copy(), old.hinge[first:].copy()
    if _on_bead(old):
        mass[0], hinge[0] = mass[0] / 2, 2 * hinge[0]
    beads = replace(
        old,
        stations=np.concatenate([[old.stations[first] - far], old.stations[first:]]),
        role=np.concatenate([[LEFT], old.role[first:]]),
        mass=np.concatenate([mass[:1], mass]),
        hinge=np.concatenate([[0.0], hinge]),
    )
    return half, replace(plan, beads=beads)


def whole_of(positions: FloatArray, system: FilamentSystem, plan: Plan) -> FloatArray:
    """(n_beads, 3) positions of the whole assembly from those of what the engine moved, um."""
    if plan.beads.support != "symmetric":
        return positions
    _, plane = _split(plan.beads)
    right = positions.reshape(system.n_filaments, -1, 3)[:, 1:]
    mirrored = right[:, :0:-1] if _on_bead(plan.beads) else right[:, ::-1]
    left = mirrored * np.array([-1.0, 1.0, 1.0]) + np.array([2 * plane, 0.0, 0.0])
    return np.concatenate([left, right], axis=1).reshape(-1, 3)


def moved_beads(system: FilamentSystem, plan: Plan) -> int:
    """Number of beads that the engine moves."""
    if plan.beads.support != "symmetric":
        return system.n_beads
    stations = len(plan.beads.stations)
    return system.n_filaments * (stations - stations // 2 + 1)
