"""The natural (stress-free) shape that rods are read in, before they are moved to where the scene starts.

The engine's rods take their rest state from where their beads stand at the first run, none of them turned. What starts
otherwise (stretched by an end load, woven in straight) is read in its natural shape, moved and turned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.errors import InputError

#: of a length: what tows of one direction may differ in to be laid out straight in one periodic cell
ALIKE = 1e-6


@dataclass(frozen=True)
class NaturalShape:
    """Where beads stand without stress, in a ``box`` (3, 2) um of its own; ``positions`` (n_beads, 3) um; ``segments``
    (n_beads, 3) um to the bead behind (0 where there is none); ``turn`` (n_beads, 3) rad, the rotation vector of every
    bead from there to the start; None: no bead turns."""

    positions: FloatArray
    segments: FloatArray
    box: FloatArray
    turn: FloatArray | None = None


def natural_shape(system: FilamentSystem, strain: FloatArray) -> NaturalShape:
    """As built, less an axial ``strain`` (n_bonds,) of every segment."""
    vectors = system.bond_vectors() / (1 + strain)[:, None]
    return NaturalShape(_laid_out(system, vectors), _segments(system, vectors), system.box.copy())


def straight_shape(system: FilamentSystem) -> NaturalShape:
    """Woven tows straight, along x or y, with the lengths of their segments as built; a periodic cell grows to hold
    them. Beads turn to the mean of the segments beside them.

    Raises :class:`InputError` where closed tows of one direction are not equally long: no one cell holds them straight.
    """
    vectors, lengths = system.bond_vectors(), system.bond_lengths()
    along = _directions(system, vectors)
    straight = lengths[:, None] * along[system.bonds()[:, 0]]
    positions, box = _laid_out(system, straight), system.box.copy()
    total = np.bincount(system.filament_of_bead[system.bonds()[:, 0]], lengths, system.n_filaments)
    for axis in range(3):
        if not system.periodic[axis]:
            room, own = float(np.max(system.diameter)), positions[:, axis]
            box[axis] = min(box[axis, 0], own.min() - room), max(box[axis, 1], own.max() + room)
            continue
        mine = np.flatnonzero(along[system.first_beads, axis])
        if not len(mine):
            continue
        if np.ptp(total[mine]) > ALIKE * total[mine[0]]:
            raise InputError(
                "assembly.rest",
                "woven-in",
                f"'stress-free' at level rod (or level = 'chain'): tows of one direction are {total[mine].min():.7g} "
                f"to {total[mine].max():.7g} um long, and no periodic cell holds all of them straight",
            )
        box[axis, 1] = box[axis, 0] + total[mine[0]]
        # a quarter of a segment from the cell's edge: no bead may be wrapped to the other side before it is moved
        for i in mine:
            beads = slice(system.filament_start[i], system.filament_start[i + 1])
            positions[beads, axis] += box[axis, 0] + 0.25 * lengths.min() - positions[beads, axis].min()
    return NaturalShape(positions, _segments(system, straight), box, _turns(system, along, vectors))


def _directions(system: FilamentSystem, vectors: FloatArray) -> FloatArray:
    """(n_beads, 3) unit vector along x or y, or back, of the way that every bead's filament takes."""
    bead, n = system.bonds()[:, 0], system.n_filaments
    run = np.stack([np.bincount(system.filament_of_bead[bead], vectors[:, k], n) for k in (0, 1)], axis=1)
    axis = np.argmax(np.abs(run), axis=1)
    along = np.zeros((n, 3))
    along[np.arange(n), axis] = np.sign(run[np.arange(n), axis])
    return along[system.filament_of_bead]


def _turns(system: FilamentSystem, along: FloatArray, vectors: FloatArray) -> FloatArray:
    """(n_beads, 3) rad, the least turns from ``along`` to the mean directions of the segments beside the beads."""
    bonds, unit = system.bonds(), vectors / np.linalg.norm(vectors, axis=1)[:, None]
    tangent = np.zeros_like(along)
    np.add.at(tangent, bonds[:, 0], unit)
    np.add.at(tangent, bonds[:, 1], unit)
    axis = np.cross(along, tangent)
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, np.sum(along * tangent, axis=1))
    return axis * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 0)[:, None]


def axis_and_angle(turn: FloatArray) -> FloatArray:
    """(n, 4) unit axis and angle in degrees from rotation vectors (n, 3) rad."""
    angle = np.linalg.norm(turn, axis=1)
    axis = np.where(angle[:, None] > 0, turn / np.where(angle > 0, angle, 1.0)[:, None], [1.0, 0.0, 0.0])
    return np.column_stack([axis, np.degrees(angle)])


def _segments(system: FilamentSystem, vectors: FloatArray) -> FloatArray:
    """(n_beads, 3) the vector to the bead behind from those of the bonds."""
    found = np.zeros_like(system.positions)
    found[system.bonds()[:, 0]] = vectors
    return found


def _laid_out(system: FilamentSystem, vectors: FloatArray) -> FloatArray:
    """(n_beads, 3) the filaments laid out again from their first bead with these bond vectors (closing bonds apart)."""
    bonds = system.bonds()
    step = np.zeros_like(system.positions)
    forward = bonds[:, 1] == bonds[:, 0] + 1
    step[bonds[forward, 1]] = vectors[forward]
    first = system.first_beads
    total = np.cumsum(step, axis=0)
    start = np.repeat(system.positions[first] - total[first], np.diff(system.filament_start), axis=0)
    return total + start
