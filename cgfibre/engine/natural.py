"""The natural (stress-free) shape that rods are read in, before they are moved to where the scene starts.

The engine's rods take their rest state from where their beads stand at the first run, none of them turned. What starts
otherwise (stretched by an end load, woven in straight) is read in its natural shape and moved: by ``shift``, and turned.
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
    vectors, lengths, bonds = system.bond_vectors(), system.bond_lengths(), system.bonds()
    first = bonds[:, 0]
    run = np.add.reduceat(vectors, np.searchsorted(first, system.first_beads), axis=0)
    axis = np.argmax(np.abs(run[:, :2]), axis=1)
    sign = np.sign(run[np.arange(len(run)), axis])
    along = np.zeros((system.n_filaments, 3))
    along[np.arange(len(run)), axis] = sign
    straight = lengths[:, None] * along[system.filament_of_bead[first]]
    box = system.box.copy()
    positions = _laid_out(system, straight)
    for k in np.flatnonzero(system.periodic[:2]):
        mine = system.closed & (axis == k)
        if not np.any(mine):
            continue
        total = np.bincount(system.filament_of_bead[first], lengths, system.n_filaments)[mine]
        if np.ptp(total) > ALIKE * total[0]:
            raise InputError(
                "assembly.rest",
                "woven-in",
                f"'stress-free' at level rod (or level = 'chain'): tows of one direction are {total.min():.7g} to "
                f"{total.max():.7g} um long, and no periodic cell holds all of them straight",
            )
        box[k] = box[k, 0], box[k, 0] + total[0]
        # a quarter of a segment from the cell's edge: no bead may be wrapped to the other side before it is moved
        for i in np.flatnonzero(mine):
            beads = slice(system.filament_start[i], system.filament_start[i + 1])
            own = positions[beads, k]
            positions[beads, k] += box[k, 0] + 0.25 * lengths.min() - own.min()
    for k in range(3):
        if not system.periodic[k]:
            room = float(np.max(system.diameter))
            box[k] = min(box[k, 0], positions[:, k].min() - room), max(box[k, 1], positions[:, k].max() + room)
    before = np.zeros_like(system.positions)
    unit = vectors / lengths[:, None]
    np.add.at(before, bonds[:, 0], unit)
    np.add.at(before, bonds[:, 1], unit)
    tangent = before / np.linalg.norm(before, axis=1)[:, None]
    axes = along[system.filament_of_bead]
    across = np.cross(axes, tangent)
    sine, cosine = np.linalg.norm(across, axis=1), np.sum(axes * tangent, axis=1)
    angle = np.arctan2(sine, cosine)
    turn = across * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 0)[:, None]
    return NaturalShape(positions, _segments(system, straight), box, turn)


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
