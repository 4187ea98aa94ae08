"""What a deck of woven tows says beyond that of a bundle: forces that keep the shape as built, the cell, the ends."""

from __future__ import annotations

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.plan.model import Plan, Woven, every_bead


def bending_forces(system: FilamentSystem, hinge: FloatArray) -> FloatArray:
    """(n_beads, 3) forces in nN of ``angle_style cosine`` on the beads as built; ``hinge`` (n_beads,) its K, nN um.

    E = K (1 + cos theta), theta the angle between the bonds to the bead before and the bead behind.
    """
    angles, vectors, bonds = system.angles(), system.bond_vectors(), system.bonds()
    begins = np.full(system.n_beads, -1)
    begins[bonds[:, 0]] = np.arange(len(bonds))
    before, behind = -vectors[begins[angles[:, 0]]], vectors[begins[angles[:, 1]]]
    r, s = np.linalg.norm(before, axis=1)[:, None], np.linalg.norm(behind, axis=1)[:, None]
    u, v = before / r, behind / s
    cosine = np.sum(u * v, axis=1)[:, None]
    k = hinge[angles[:, 1]][:, None]
    # -dE/dx of the outer beads; the middle one takes the rest
    first, last = -k * (v - cosine * u) / r, -k * (u - cosine * v) / s
    force = np.zeros_like(system.positions)
    for column, values in ((0, first), (1, -first - last), (2, last)):
        np.add.at(force, angles[:, column], values)
    return force


def rest_forces(system: FilamentSystem, plan: Plan) -> FloatArray | None:
    """Constant forces that balance the bending of the tows as built, nN; None where they are woven in straight.

    A chain's hinges want to be straight: under these forces the shape as built is without load, and small changes of it
    meet the same stiffness.
    """
    if plan.woven is None or not plan.woven.at_rest:
        return None
    return -bending_forces(system, every_bead(system, plan.beads.hinge))


def fabric_parameters(system: FilamentSystem, plan: Plan) -> dict[str, float | int | str]:
    """Parameters of a deck of a weave; none for a bundle."""
    if plan.woven is None:
        return {}
    w = plan.woven
    values: dict[str, float | int | str] = {
        "rest": "built" if w.at_rest else "straight",
        "skin_um": plan.woven.skin,
    }
    if w.moved:
        values |= _moved_cell(system, w)
    if w.periodic:
        values |= {"boundary_y": "p", "width_formula": "lx*ly/v_contact_length_um"}
        values |= {"cell_x_um": w.size[0], "cell_y_um": w.size[1]}
    else:
        values |= {"boundary_y": "m", "width_formula": f"{w.size[1]!r}", "end_stiffness_nN_um": w.end_stiffness}
    return values


def _moved_cell(system: FilamentSystem, woven: Woven) -> dict[str, float | int | str]:
    """Parameters of a cell that is strained, sheared or pulled in its plane; stresses refer to the box's height."""
    (x, y), height = woven.size, float(np.ptp(system.box[2]))
    values: dict[str, float | int | str] = {
        "cell": "moved",
        "boundary_z": "f",
        "preparation_steps": woven.preparation,
        "strain_x": woven.strain[0],
        "strain_y": woven.strain[1],
        "shear_rad": woven.shear,
        "edge_time_us": woven.edge_time,
    }
    stiffness = []
    for axis, tension, pull, across in zip("xy", woven.tension, woven.edge_stiffness, (y, x), strict=True):
        if tension is not None:
            values[f"edge_{axis}"] = "free"
            values[f"tension_{axis}_kPa"] = -tension / (across * height)
            stiffness.append(pull / (across * height))
    if stiffness:
        values["edge_modulus_kPa"] = float(np.mean(stiffness))
    return values
