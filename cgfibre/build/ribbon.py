"""What lies between the chains of a tow that is a ribbon of them: rungs across it, turns in its plane, twist.

Beads of equal station of neighbouring chains make a rung.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray, IntArray
from cgfibre.errors import InputError


@dataclass(frozen=True)
class Rungs:
    """Rungs as built: ``beads`` (n, 2), ``length`` (n,) um, ``share`` (n,) um of the tow that each stands for, ``kind``
    (n,) type of filament; ``pairs`` (n,) neighbouring chains that its tow has, ``pair`` (n,) which of them it joins."""

    beads: IntArray
    length: FloatArray
    share: FloatArray
    kind: IntArray
    pairs: IntArray
    pair: IntArray


@dataclass(frozen=True)
class Turns:
    """Turns of chains in the ribbon's plane as built.

    ``beads`` (n, 4): before, at and behind on a chain, and the one that a rung leads to from "at"; ``span`` (n,) um,
    mean of the two chords; ``turn`` (n,) rad, (t2 - t1) . e of the unit vectors of chords and rung; ``share`` (n,) um
    of the tow, an equal part a chain, so that a tow's shares add up to its length; ``kind`` (n,) type of filament.
    """

    beads: IntArray
    span: FloatArray
    turn: FloatArray
    share: FloatArray
    kind: IntArray


@dataclass(frozen=True)
class Twists:
    """Twist from rung to rung as built.

    ``beads`` (n, 4): b_i, a_i, a_j, b_j of two rungs in a row, a on the chain nearer to the tow's middle; ``gap`` (n,)
    um between them; ``arm`` (n,) um from b to the line through a_i and a_j; ``twist`` (n,) rad about that line, in
    LAMMPS' sense; ``pairs`` (n,) neighbouring chains that the tow has; ``kind`` (n,) type of filament.
    """

    beads: IntArray
    gap: FloatArray
    arm: FloatArray
    twist: FloatArray
    pairs: IntArray
    kind: IntArray


def between(system: FilamentSystem, first: IntArray, second: IntArray) -> FloatArray:
    """(n, 3) from bead to bead, the nearest image along periodic axes, um."""
    d = system.positions[second] - system.positions[first]
    size = system.box[:, 1] - system.box[:, 0]
    for axis in np.flatnonzero(system.periodic):
        d[:, axis] -= size[axis] * np.round(d[:, axis] / size[axis])
    return np.asarray(d)


def ahead(system: FilamentSystem, beads: IntArray, steps: IntArray | int) -> IntArray:
    """(n,) the bead so many ``steps`` behind each of ``beads`` along its filament (before it: below 0); -1: none."""
    filament = system.filament_of_bead[beads]
    start, count = system.filament_start[filament], np.diff(system.filament_start)[filament]
    place = beads - start + steps
    inside = system.closed[filament] | ((place >= 0) & (place < count))
    return np.where(inside, start + place % count, -1)


def rungs(system: FilamentSystem) -> Rungs:
    """Rungs of all tows of more than one chain; InputError where a tow's chains differ in their number of beads."""
    f = np.flatnonzero(system.tow[1:] == system.tow[:-1])
    count = np.diff(system.filament_start)
    if np.any(count[f] != count[f + 1]):
        raise InputError("ribbon", "chains of unequal numbers of beads", "as many beads in every chain of a tow")
    _, first, tow, pairs = np.unique(system.tow[f], return_index=True, return_inverse=True, return_counts=True)
    n = count[f]
    side = np.repeat(np.arange(len(f)), n)
    k = np.arange(len(side)) - np.repeat(np.cumsum(n) - n, n)
    beads = np.column_stack([system.filament_start[f[side]] + k, system.filament_start[f[side] + 1] + k])
    length = np.linalg.norm(between(system, beads[:, 0], beads[:, 1]), axis=1)
    share = np.mean(system.tributary_lengths()[beads], axis=1)
    pair = (np.arange(len(f)) - first[tow])[side]
    return Rungs(beads, length, share, system.filament_type[f[side]], pairs[tow][side], pair)


def turns(system: FilamentSystem, across: Rungs, reach: Sequence[int]) -> Turns:
    """Turns at both ends of every rung, over chords of ``reach`` segments (of each type of filament; 0: none).

    In an open chain none is taken nearer than ``reach`` segments to an end. Raises :class:`InputError` for chords
    longer than a quarter of a closed chain.
    """
    at, beside = across.beads.T.reshape(-1), across.beads[:, ::-1].T.reshape(-1)
    # every chain has an equal part of the tow; inner ones have rungs on both sides
    outermost = np.concatenate([across.pair == 0, across.pair == across.pairs - 1])
    share = np.tile(across.share / (across.pairs + 1), 2) / np.where(outermost, 1, 2)
    kind = np.tile(across.kind, 2)
    steps = np.asarray(reach, dtype=np.int64)[kind]
    filament = system.filament_of_bead[at]
    room = np.diff(system.filament_start)[filament] // 4
    if np.any(system.closed[filament] & (steps > room)):
        raise InputError("ribbon.reach", int(np.max(steps)), f"at most {int(np.min(room))}, a quarter of the chain")
    before, behind = ahead(system, at, -steps), ahead(system, at, steps)
    use = (steps > 0) & (before >= 0) & (behind >= 0)
    beads = np.column_stack([before, at, behind, beside])[use]
    one, two, e = (between(system, beads[:, i], beads[:, j]) for i, j in ((0, 1), (1, 2), (1, 3)))
    l1, l2, l3 = (np.linalg.norm(x, axis=1) for x in (one, two, e))
    turn = np.sum((two / l2[:, None] - one / l1[:, None]) * e, axis=1) / l3
    return Turns(beads, 0.5 * (l1 + l2), turn, share[use], kind[use])


def twists(system: FilamentSystem, across: Rungs) -> Twists:
    """Twist between rungs in a row."""
    inner = 2 * across.pair < across.pairs - 1  # the second of the two chains is nearer to the middle
    a, b = (np.where(inner, across.beads[:, k], across.beads[:, 1 - k]) for k in (1, 0))
    next_a, next_b = ahead(system, a, 1), ahead(system, b, 1)
    use = next_a >= 0
    beads = np.column_stack([b, a, next_a, next_b])[use]
    one, axis, two = (between(system, beads[:, k], beads[:, k + 1]) for k in range(3))
    n1, n2 = np.cross(one, axis), np.cross(axis, two)
    gap = np.linalg.norm(axis, axis=1)
    twist = np.arctan2(np.sum(np.cross(n1, n2) * axis, axis=1) / gap, np.sum(n1 * n2, axis=1))
    arm = np.minimum(np.linalg.norm(n1, axis=1), np.linalg.norm(n2, axis=1)) / gap
    other = np.linalg.norm(between(system, beads[:, 0], beads[:, 3]), axis=1)
    return Twists(beads, 0.5 * (gap + other), arm, twist, across.pairs[use], across.kind[use])
