"""What a deck of woven tows says beyond that of a bundle: forces that keep the shape as built, the cell, the ends."""

from __future__ import annotations

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.plan.model import Plan, Woven, every_bead
from cgfibre.plan.weave_common import runs_along

#: of a segment: how far the corner of a sheared cell stands before its first beads
CORNER = 0.4


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


def fabric_box(system: FilamentSystem, plan: Plan) -> FloatArray:
    """(3, 2) um, the box that the deck starts from: of a cell that is sheared with its corner a little before the first
    beads.

    Beads on the boundary of a tilted box change sides with rounding, which a checkpoint does not repeat.
    """
    box = system.box.copy()
    box[:2] += _corner(system, plan)
    return box


def _corner(system: FilamentSystem, plan: Plan) -> float:
    """x and y of the corner of a periodic cell, um."""
    if plan.woven is None or not plan.woven.periodic or plan.woven.shear == 0:
        return 0.0
    return -CORNER * float(np.min(system.bond_lengths()))


def fabric_parameters(system: FilamentSystem, plan: Plan, box: FloatArray) -> dict[str, float | int | str]:
    """Parameters of a deck of a weave that starts from the ``box`` (3, 2) um; none for a bundle."""
    if plan.woven is None:
        return {}
    w = plan.woven
    values: dict[str, float | int | str] = {
        "rest": "built" if w.at_rest else "straight",
        "skin_um": plan.woven.skin,
    }
    if w.moved:
        values |= _moved_cell(system, w, box)
        forces = rest_forces(system, plan)
        if forces is not None:
            moment = np.sum(forces * system.positions, axis=0)
            values |= {"rest_moment_x": float(moment[0]), "rest_moment_y": float(moment[1])}
    if w.periodic:
        values |= {"boundary_y": "p", "width_formula": "lx*ly/v_contact_length_um"}
        values |= {"cell_x_um": w.size[0], "cell_y_um": w.size[1], "corner_um": _corner(system, plan)}
    else:
        values |= {"boundary_y": "m", "width_formula": f"{w.size[1]!r}", "end_stiffness_nN_um": w.end_stiffness}
        if w.moved:  # in a box with room around it, that maps it as a cell is mapped
            part = w.size[0] * w.size[1] / float(np.prod(np.ptp(box[:2], axis=1)))
            values |= {"boundary_x": "p", "boundary_y": "p", "width_formula": f"lx*ly*{part!r}/v_contact_length_um"}
    return values


def _moved_cell(system: FilamentSystem, woven: Woven, box: FloatArray) -> dict[str, float | int | str]:
    """Parameters of a cell or patch that is strained, sheared or pulled in its plane."""
    (x, y), (wide, long) = woven.size, np.ptp(box[:2], axis=1).tolist()
    if woven.periodic:  # rods that are woven in straight are read in another box
        wide, long = x, y
    values: dict[str, float | int | str] = {
        "cell": "moved",
        "cell_when": woven.when,
        "boundary_z": "f",
        "preparation_steps": max(woven.preparation, 1),
        "over_um": woven.over or 1.0,
        "cell_x_um": x,
        "cell_y_um": y,
        "box_x_um": wide,
        "box_y_um": long,
        "strain_x": woven.strain[0],
        "strain_y": woven.strain[1],
        "shear_rad": woven.shear,
    }
    if woven.shear != 0:
        weft = int(np.flatnonzero(runs_along(system) == 1)[0])  # builders put warp tows first
        values["first_weft"] = (int(system.tow[weft]) if woven.resolve == "tow" else weft) + 1
    for axis, tension, drag in zip("xy", woven.tension, woven.edge_drag, strict=True):
        if tension is not None:
            values |= {f"edge_{axis}": "free", f"tension_{axis}_nN": tension, f"edge_drag_{axis}": drag}
    return values
