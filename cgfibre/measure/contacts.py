"""Contacts between beads of different filaments, and of beads with platens, from positions alone.

The engine sums forces on beads; which filament presses which is found here again from the overlaps and the normal law.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from cgfibre.build.system import FilamentSystem, FloatArray, IntArray
from cgfibre.errors import InputError

#: (n, 3) positions in um -> (n,) distance in um from each to a platen's surface, negative behind it, inf beside it
GapFunction = Callable[[FloatArray], FloatArray]


def _sums(index: IntArray, value: FloatArray, n: int) -> FloatArray:
    return np.asarray(np.bincount(index.ravel(), np.repeat(value, index.shape[1]), n), dtype=np.float64)


@dataclass(frozen=True)
class Contacts:
    """Contacts of one frame.

    ``beads`` and ``filaments`` (n_contacts, 2) int, of a platen contact (n_contacts, 1); ``overlap`` (n_contacts,) um,
    negative for gaps within the tolerance; ``force`` (n_contacts,) nN, normal, never negative; ``x`` (n_contacts,) um
    along the filaments, of the point of contact.
    """

    beads: IntArray
    filaments: IntArray
    overlap: FloatArray
    force: FloatArray
    x: FloatArray

    def __len__(self) -> int:
        return len(self.overlap)

    def within(self, low: float, high: float) -> Contacts:
        """Those with low <= x <= high, um."""
        keep = (self.x >= low) & (self.x <= high)
        return Contacts(self.beads[keep], self.filaments[keep], self.overlap[keep], self.force[keep], self.x[keep])

    def force_per_bead(self, n_beads: int) -> FloatArray:
        """(n_beads,) sum of the magnitudes of the normal forces on each bead, nN; a pair counts on both beads."""
        return _sums(self.beads, self.force, n_beads)

    def force_per_filament(self, n_filaments: int) -> FloatArray:
        """(n_filaments,) sum of the magnitudes of the normal forces on each filament, nN."""
        return _sums(self.filaments, self.force, n_filaments)

    def count_per_filament(self, n_filaments: int) -> IntArray:
        """(n_filaments,) number of bead contacts of each filament."""
        return np.bincount(self.filaments.ravel(), minlength=n_filaments).astype(np.int64)


def _lengths(system: FilamentSystem, length: FloatArray | float | None) -> FloatArray:
    if length is None:
        if np.any(np.diff(system.filament_start) == 1):
            raise InputError("length", None, "the depth of the section (a filament of one bead has no length)")
        return system.tributary_lengths()
    array = np.asarray(length, dtype=float)
    if array.shape not in ((), (system.n_beads,)) or not np.all(array >= 0):
        raise InputError("length", array.shape, f"one length or {system.n_beads} lengths, none negative")
    return np.broadcast_to(array, (system.n_beads,))


def _check(system: FilamentSystem, positions: FloatArray, stiffness_per_length: float) -> None:
    if positions.shape != (system.n_beads, 3):
        raise InputError("positions", positions.shape, f"shape ({system.n_beads}, 3)")
    if not np.all(np.isfinite(positions)):
        raise InputError("positions", int(np.sum(~np.isfinite(positions))), "finite values only")
    if not stiffness_per_length >= 0:
        raise InputError("stiffness_per_length", stiffness_per_length, "zero or above, kPa")


def filament_contacts(
    system: FilamentSystem,
    positions: FloatArray,
    stiffness_per_length: float = 0.0,
    length: FloatArray | float | None = None,
    tolerance: float = 0.0,
) -> Contacts:
    """Bead pairs of different filaments closer than the mean of their diameters plus ``tolerance`` (um).

    Normal force by the line contact's Hooke law F = k' l delta with delta the overlap, k' ``stiffness_per_length``
    (nN/um2 = kPa) and l the geometric mean of the two beads' lengths (as LAMMPS mixes stiffnesses). ``length``
    (n_beads,) or one value, um: default the tributary lengths; a section needs its depth. ``positions`` (n_beads, 3)
    um; periodic axes by minimum image. Beads of one filament never touch. Raises InputError for wrong shapes or
    non-finite positions.
    """
    _check(system, positions, stiffness_per_length)
    bead_length = _lengths(system, length)
    filament = system.filament_of_bead
    radius = system.diameter[filament] / 2
    size = system.box[:, 1] - system.box[:, 0]
    points = positions
    if system.periodic.any():
        points = positions.copy()
        for axis in np.flatnonzero(system.periodic):
            # the second remainder: a tiny negative value rounds up to the box size itself
            points[:, axis] = np.mod(np.mod(positions[:, axis] - system.box[axis, 0], size[axis]), size[axis])
    tree = cKDTree(points, boxsize=np.where(system.periodic, size, 0.0) if system.periodic.any() else None)
    reach = 2 * float(radius.max(initial=0.0)) + tolerance
    pairs = tree.query_pairs(reach, output_type="ndarray").astype(np.int64, copy=False)
    pairs = pairs[filament[pairs[:, 0]] != filament[pairs[:, 1]]]
    d = points[pairs[:, 1]] - points[pairs[:, 0]]
    for axis in np.flatnonzero(system.periodic):
        d[:, axis] -= size[axis] * np.round(d[:, axis] / size[axis])
    overlap = radius[pairs[:, 0]] + radius[pairs[:, 1]] - np.linalg.norm(d, axis=1)
    keep = overlap >= -tolerance
    pairs, overlap, d = pairs[keep], overlap[keep], d[keep]
    shared = np.sqrt(bead_length[pairs[:, 0]] * bead_length[pairs[:, 1]])
    return Contacts(
        beads=pairs,
        filaments=filament[pairs],
        overlap=overlap,
        force=stiffness_per_length * shared * np.maximum(overlap, 0.0),
        x=positions[pairs[:, 0], 0] + d[:, 0] / 2,
    )


@dataclass(frozen=True)
class FlatPlaten:
    """Gap function of a flat platen: surface at ``z`` (um), free side below it if ``above`` (top platen), else above.

    ``x`` and ``y`` are the extents (um) of a finite anvil: beads beside it have the gap inf.
    """

    z: float
    above: bool
    x: tuple[float, float] = (-np.inf, np.inf)
    y: tuple[float, float] = (-np.inf, np.inf)

    def __call__(self, positions: FloatArray) -> FloatArray:
        """(n,) distance from each of the (n, 3) positions to the surface, um; negative behind it, inf beside it."""
        gap = self.z - positions[:, 2] if self.above else positions[:, 2] - self.z
        beside = (positions[:, 0] < self.x[0]) | (positions[:, 0] > self.x[1])
        beside |= (positions[:, 1] < self.y[0]) | (positions[:, 1] > self.y[1])
        return np.where(beside, np.inf, gap)


@dataclass(frozen=True)
class CylinderPlaten:
    """Gap function of a crimped platen: a cylinder of ``radius`` um about the axis (``x``, ``z``) that runs along y.

    ``convex``: filaments lie outside the cylinder, else inside. ``span``: beads beside it have the gap inf.
    ``across``: the axis runs along x instead, through (y, z) with y the value of ``x``.
    """

    x: float
    z: float
    radius: float
    convex: bool
    span: tuple[float, float] = (-np.inf, np.inf)
    across: bool = False

    def __call__(self, positions: FloatArray) -> FloatArray:
        """(n,) distance from each of the (n, 3) positions to the surface, um; negative behind it, inf beside it."""
        from_axis = np.hypot(positions[:, 1 if self.across else 0] - self.x, positions[:, 2] - self.z)
        gap = from_axis - self.radius if self.convex else self.radius - from_axis
        beside = (positions[:, 0] < self.span[0]) | (positions[:, 0] > self.span[1])
        return np.where(beside, np.inf, gap)


def platen_contacts(
    system: FilamentSystem,
    positions: FloatArray,
    gap: GapFunction,
    stiffness_per_length: float = 0.0,
    length: FloatArray | float | None = None,
) -> Contacts:
    """Beads that touch a platen, gap <= D/2, with F = k' l delta, delta = D/2 - gap.

    ``gap`` maps (n, 3) positions to (n,) distances to the surface: a :class:`FlatPlaten`, or any function for a crimped
    one. The other arguments as in :func:`filament_contacts`. A bead behind the surface (gap < 0) is still listed here
    although the engine's wall has lost it: see :func:`cgfibre.measure.guards.beads_past_platen`.
    """
    _check(system, positions, stiffness_per_length)
    bead_length = _lengths(system, length)
    filament = system.filament_of_bead
    overlap = system.diameter[filament] / 2 - gap(positions)
    beads = np.flatnonzero(overlap >= 0)
    return Contacts(
        beads=beads[:, None],
        filaments=filament[beads][:, None],
        overlap=overlap[beads],
        force=stiffness_per_length * bead_length[beads] * overlap[beads],
        x=positions[beads, 0],
    )
