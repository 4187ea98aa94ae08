"""How far filaments overlap as built: smooth rods along the segments between beads, across periodic boundaries."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from cgfibre.build.system import FilamentSystem, FloatArray


def segment_distance(p: FloatArray, u: FloatArray, q: FloatArray, v: FloatArray) -> FloatArray:
    """Least distance of segments p + s u and q + t v, 0 <= s, t <= 1, of (n, 3) each (Ericson, Real-Time Collision
    Detection, 5.1.9)."""
    r = p - q
    a, e, f = (u * u).sum(1), (v * v).sum(1), (v * r).sum(1)
    b, c = (u * v).sum(1), (u * r).sum(1)
    det = a * e - b * b
    parallel = det <= 1e-12 * a * e
    s = np.clip((b * f - c * e) / np.where(parallel, 1.0, det), 0, 1)
    s[parallel] = 0
    t = (b * s + f) / e
    s = np.clip((b * np.clip(t, 0, 1) - c) / a, 0, 1)
    t = np.clip((b * s + f) / e, 0, 1)
    return np.linalg.norm(r + s[:, None] * u - t[:, None] * v, axis=1)


def initial_overlap(system: FilamentSystem, between_tows: bool = False) -> tuple[float, tuple[int, int] | None]:
    """Largest overlap of two filaments' rods as built, um, and those two; (0, None) where none overlap.

    Overlap (D + D') / 2 - d, d the least distance of a segment of the one and a segment of the other, nearest images
    along periodic axes. ``between_tows`` leaves out pairs of one tow (the chains of a ribbon stand in each other).
    """
    bonds = system.bonds()
    if not len(bonds):
        return 0.0, None
    vector = system.bond_vectors()
    start = system.positions[bonds[:, 0]]
    filament = system.filament_of_bead[bonds[:, 0]]
    group = system.tow[filament] if between_tows else filament
    radius = 0.5 * system.diameter[filament]
    size = np.where(system.periodic, system.box[:, 1] - system.box[:, 0], 0.0)
    middle = start + 0.5 * vector - system.box[:, 0]
    wrapped = np.where(size > 0.0, middle % np.where(size > 0.0, size, 1.0), middle)
    wrapped = np.where((size > 0.0) & (wrapped >= size), 0.0, wrapped)  # rounding of a tiny negative
    reach = 2.0 * float(radius.max()) + float(np.linalg.norm(vector, axis=1).max())
    tree = cKDTree(wrapped, boxsize=size)
    pairs = tree.query_pairs(reach, output_type="ndarray")
    pairs = pairs[group[pairs[:, 0]] != group[pairs[:, 1]]]
    if not len(pairs):
        return 0.0, None
    a, b = pairs[:, 0], pairs[:, 1]
    apart = middle[b] - middle[a]
    image = np.where(size > 0.0, size * np.round(apart / np.where(size > 0.0, size, 1.0)), 0.0)
    distance = segment_distance(start[a], vector[a], start[b] - image, vector[b])
    overlap = radius[a] + radius[b] - distance
    worst = int(np.argmax(overlap))
    if overlap[worst] <= 0.0:
        return 0.0, None
    return float(overlap[worst]), (int(filament[a[worst]]), int(filament[b[worst]]))
