"""The one data model of an assembly: filaments as chains of beads.

Everything that follows from positions and types (bonds, angles, spacings, tributary lengths, rest lengths) is derived
here and stored nowhere. Units: um, us, nN, pg (so kPa for stress, nN um for energy).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


def whole_periods(away: FloatArray, period: FloatArray, tilt: float = 0.0) -> FloatArray:
    """(..., k) whole periods nearest to vectors ``away`` (..., k), k = 2 or 3 axes, um: less them they are those to the
    nearest image.

    ``period`` (k,) um, 0 along axes that do not repeat; a step along y also goes ``tilt`` um along x. Of vectors short
    beside the cell.
    """
    shift = np.zeros_like(away)
    if tilt and period[1] > 0:
        rows = np.round(away[..., 1] / period[1])
        shift[..., 1] = period[1] * rows
        shift[..., 0] = tilt * rows
        if period[0] > 0:
            shift[..., 0] += period[0] * np.round((away[..., 0] - shift[..., 0]) / period[0])
        axes = np.flatnonzero(period[2:] > 0) + 2
    else:
        axes = np.flatnonzero(period > 0)
    for axis in axes:
        shift[..., axis] = period[axis] * np.round(away[..., axis] / period[axis])
    return shift


@dataclass(frozen=True)
class FilamentType:
    """Section constants of one kind of filament.

    Attributes: ``diameter`` um; ``EA`` nN; ``EI`` nN um2; ``GJ`` nN um2; ``kGA`` nN (Timoshenko shear stiffness);
    ``mass_per_length`` pg/um.
    """

    diameter: float
    EA: float
    EI: float
    GJ: float
    kGA: float
    mass_per_length: float


@dataclass(frozen=True)
class FilamentSystem:
    """Filaments as chains of beads, zero-based; only the data file adds one.

    Attributes
    ----------
    positions : (n_beads, 3) float, um, unwrapped, bead after bead, filament after filament
    filament_start : (n_filaments + 1,) int; beads of filament i are ``filament_start[i]:filament_start[i + 1]``
    closed : (n_filaments,) bool; the last bead is bonded to the first (periodic filament)
    tow : (n_filaments,) int; the tow each filament belongs to
    filament_type : (n_filaments,) int; index into ``types``
    types : section constants
    box : (3, 2) float, um; periodic : (3,) bool
    prestrain : (n_filaments,) float; axial strain of the shape as built over the natural (stress-free) length
    tilt : um by which the box's upper y edge lies over the lower one along x: of a sheared cell, whose x edges are
        ``box[0]`` at the lower one
    provenance : what built it (builder, spec, seed)

    A filament of one bead is a disc: the cross-section models use it, its x is 0.
    """

    positions: FloatArray
    filament_start: IntArray
    closed: BoolArray
    tow: IntArray
    filament_type: IntArray
    types: tuple[FilamentType, ...]
    box: FloatArray
    periodic: BoolArray
    prestrain: FloatArray
    provenance: dict[str, Any] = field(default_factory=dict)
    tilt: float = 0.0

    def __post_init__(self) -> None:
        n = self.n_filaments
        shapes = {
            "positions": (self.positions.shape, (self.n_beads, 3)),
            "closed": (self.closed.shape, (n,)),
            "tow": (self.tow.shape, (n,)),
            "filament_type": (self.filament_type.shape, (n,)),
            "prestrain": (self.prestrain.shape, (n,)),
            "box": (self.box.shape, (3, 2)),
            "periodic": (self.periodic.shape, (3,)),
        }
        for name, (got, want) in shapes.items():
            if got != want:
                raise ValueError(f"FilamentSystem.{name} has shape {got}, expected {want}")
        if n and (self.filament_start[0] != 0 or np.any(np.diff(self.filament_start) < 1)):
            raise ValueError("FilamentSystem.filament_start must start at 0 and rise by at least one bead a filament")
        if not np.all(np.isfinite(self.positions)):
            raise ValueError("FilamentSystem.positions has non-finite values")

    @property
    def n_filaments(self) -> int:
        """Number of filaments."""
        return len(self.filament_start) - 1

    @property
    def n_beads(self) -> int:
        """Number of beads."""
        return int(self.filament_start[-1]) if len(self.filament_start) else 0

    @property
    def filament_of_bead(self) -> IntArray:
        """(n_beads,) index of each bead's filament."""
        return np.repeat(np.arange(self.n_filaments), np.diff(self.filament_start))

    @property
    def diameter(self) -> FloatArray:
        """(n_filaments,) diameter in um."""
        return np.array([t.diameter for t in self.types])[self.filament_type]

    @property
    def is_section(self) -> bool:
        """Whether filaments are discs of a cross-section: one bead each."""
        return bool(np.any(np.diff(self.filament_start) == 1))

    @property
    def first_beads(self) -> IntArray:
        """(n_filaments,) first bead of each filament."""
        return self.filament_start[:-1]

    @property
    def last_beads(self) -> IntArray:
        """(n_filaments,) last bead of each filament."""
        return self.filament_start[1:] - 1

    def bonds(self) -> IntArray:
        """(n_bonds, 2) bead pairs, filament after filament; a closed filament's closing bond comes last of its own."""
        i = np.arange(self.n_beads)
        j = i + 1
        last = self.last_beads
        j[last] = np.where(self.closed, self.first_beads, -1)
        keep = (j >= 0) & (j != i)
        return np.stack([i[keep], j[keep]], axis=1)

    def bond_vectors(self) -> FloatArray:
        """(n_bonds, 3) from first to second bead, by minimum image along periodic axes, um."""
        b = self.bonds()
        return self.nearest(self.positions[b[:, 1]] - self.positions[b[:, 0]])

    def nearest(self, away: FloatArray) -> FloatArray:
        """(n, 3) vectors ``away`` to the nearest image, um."""
        return away - whole_periods(away, self.period, self.tilt)

    @property
    def period(self) -> FloatArray:
        """(3,) size of the box along periodic axes, 0 along the others, um."""
        return np.where(self.periodic, self.box[:, 1] - self.box[:, 0], 0.0)

    def upright(self, points: FloatArray) -> FloatArray:
        """(..., 2 or 3) points or vectors with the tilt taken back: x - y tilt/(size of the box along y), um."""
        if not self.tilt:
            return points
        out = np.array(points, dtype=float)
        out[..., 0] -= out[..., 1] * self.tilt / float(self.box[1, 1] - self.box[1, 0])
        return out

    def bond_lengths(self) -> FloatArray:
        """(n_bonds,) length as built, um."""
        return np.linalg.norm(self.bond_vectors(), axis=1)

    def angles(self) -> IntArray:
        """(n_angles, 3) bead triples, the middle bead in the middle."""
        b = self.bonds()
        nxt = np.full(self.n_beads, -1, dtype=np.int64)
        nxt[b[:, 0]] = b[:, 1]
        j = nxt[b[:, 0]]
        k = nxt[j]
        keep = k >= 0
        return np.stack([b[keep, 0], j[keep], k[keep]], axis=1)

    def dihedrals(self) -> IntArray:
        """(n_dihedrals, 4) bead quadruples."""
        a = self.angles()
        nxt = np.full(self.n_beads, -1, dtype=np.int64)
        b = self.bonds()
        nxt[b[:, 0]] = b[:, 1]
        last = nxt[a[:, 2]]
        keep = last >= 0
        return np.column_stack([a[keep], last[keep]])

    def tributary_lengths(self) -> FloatArray:
        """(n_beads,) half the length of the bonds that meet at a bead, um (half a bond at an open end)."""
        b = self.bonds()
        length = self.bond_lengths()
        w: FloatArray = np.bincount(b[:, 0], 0.5 * length, self.n_beads).astype(np.float64, copy=False)
        w += np.bincount(b[:, 1], 0.5 * length, self.n_beads)
        return w
