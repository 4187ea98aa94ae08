"""Guards: does a run deserve trust? Each returns a :class:`Guard`; none raises for a bad result, and none edits one.

A guard that cannot judge (no two beads, never reached, flag off) is ok with the value nan and says "not applicable".
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from cgfibre.build.system import BoolArray, FilamentSystem, FloatArray, IntArray
from cgfibre.errors import InputError
from cgfibre.measure.contacts import Contacts, GapFunction
from cgfibre.measure.segments import minimum_axis_distance
from cgfibre.record import Balance, Curve, Frames

#: up to this many filaments every pair is followed, beyond it the pairs that come near
ALL_PAIRS_UP_TO = 200
_CHUNK = 2_000_000


@dataclass(frozen=True)
class Guard:
    """Verdict of one guard: ``ok`` says whether ``value`` kept its ``limit``; ``message`` is one line for the user."""

    name: str
    ok: bool
    value: float
    limit: float
    message: str


def _not_applicable(name: str, limit: float, why: str) -> Guard:
    return Guard(name, True, float("nan"), limit, f"{name}: not applicable, {why}")


def _none_of(name: str, count: int, what: str) -> Guard:
    return Guard(name, count == 0, float(count), 0.0, f"{name}: {count if count else 'no'} {what}")


def overlap_depth(
    system: FilamentSystem, contacts: Contacts, limit: float = 0.05, name: str = "overlap depth"
) -> Guard:
    """Largest overlap over the (smaller) diameter against ``limit``; for contacts of filaments or with a platen.

    Deeper than a few hundredths of D the geometry is the contact law's, not the fibre's.
    """
    if not len(contacts):
        return Guard(name, True, 0.0, limit, f"{name}: nothing touches")
    ratio = contacts.overlap / system.diameter[contacts.filaments].min(axis=1)
    worst = int(np.argmax(ratio))
    value = max(float(ratio[worst]), 0.0)
    who = " and ".join(str(f) for f in contacts.filaments[worst])
    where = f"filament {who} at x = {contacts.x[worst]:.4g} um"
    message = f"{name}: {value:.3g} of the diameter (limit {limit:.3g}), {where}"
    return Guard(name, value <= limit, value, limit, message)


def beads_past_platen(
    frames: Frames, gaps: Sequence[Sequence[GapFunction]], name: str = "beads past a platen"
) -> Guard:
    """Number of beads whose centre lies behind a platen's surface (gap < 0) in any frame: the wall has lost them.

    ``gaps[i]`` are the gap functions of the platens as they stood at frame i. Raises InputError for another number.
    """
    if len(gaps) != len(frames):
        raise InputError("gaps", len(gaps), f"one sequence of gap functions for each of {len(frames)} frames")
    past = np.zeros(frames.positions.shape[1], dtype=bool)
    for positions, platens in zip(frames.positions, gaps, strict=True):
        for gap in platens:
            past |= gap(positions) < 0
    return _none_of(name, int(past.sum()), "bead centres behind a platen's surface")


def winding_stations(system: FilamentSystem, positions: FloatArray) -> FloatArray:
    """(n_stations,) planes in x, um, at which filaments are compared: the beads of the filament that has most.

    Limited to the stretch that all filaments share; one period where all are closed. Raises InputError for a mixture of
    open and closed filaments, for sections and where there is no such stretch.
    """
    if system.is_section or (system.closed.any() and not system.closed.all()):
        raise InputError("system", system.n_filaments, "filaments of two beads or more, all open or all closed")
    fullest = int(np.argmax(np.diff(system.filament_start)))
    x = np.sort(positions[system.filament_start[fullest] : system.filament_start[fullest + 1], 0])
    if system.closed.all():
        return np.append(x, x[0] + system.box[0, 1] - system.box[0, 0])
    ends = np.stack([positions[system.first_beads, 0], positions[system.last_beads, 0]])
    low, high = ends.min(axis=0).max(), ends.max(axis=0).min()
    if not high > low:
        raise InputError("system", (float(low), float(high)), "filaments that share a stretch of x")
    return np.unique(np.concatenate([[low], x[(x > low) & (x < high)], [high]]))


def sections_along(system: FilamentSystem, positions: FloatArray, stations: FloatArray) -> FloatArray:
    """(n_filaments, n_stations, 2) y and z of every filament at each station x, linearly between beads.

    ``positions`` (n_beads, 3) um, unwrapped. Filaments must run along x (one y, z for an x); beyond an open end the
    end's own y, z stand. One interpolation for all filaments: 1.2 million beads take a few tenths of a second.
    """
    n_beads = np.diff(system.filament_start)
    start, filament = system.first_beads, system.filament_of_bead
    forwards = positions[system.last_beads, 0] >= positions[start, 0]
    wanted = np.where(forwards[:, None], stations, -stations[::-1])
    x, yz = np.where(forwards[filament], positions[:, 0], -positions[:, 0]), positions[:, 1:]
    if system.closed.any():
        # three periods from before the first station on
        period = system.box[0, 1] - system.box[0, 0]
        shift = period * np.floor((wanted[:, 0] - x[start]) / period)
        filament = np.repeat(np.arange(system.n_filaments), 3 * n_beads)
        start3 = 3 * start
        place = np.arange(3 * system.n_beads) - start3[filament]
        source = start[filament] + place % n_beads[filament]
        x, yz = x[source] + shift[filament] + period * (place // n_beads[filament]), yz[source]
        start, n_beads = start3, 3 * n_beads
    # one long abscissa, filament after filament; a bead that runs back stays with the one before it
    base = min(x.min(), wanted.min())
    offset = np.arange(system.n_filaments) * (max(x.max(), wanted.max()) - base + 1.0)
    key = np.maximum.accumulate(x - base + offset[filament])
    at = np.clip(wanted - base + offset[:, None], key[start][:, None], key[start + n_beads - 1][:, None])
    yz_at = np.stack([np.interp(at, key, yz[:, axis]) for axis in (0, 1)], axis=-1)
    yz_at[~forwards] = yz_at[~forwards, ::-1]
    return yz_at


def _turn(before: FloatArray, after: FloatArray) -> FloatArray:
    """Signed angle from one set of (..., 2) vectors to another, in -pi..pi."""
    cross = before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]
    return np.arctan2(cross, before[..., 0] * after[..., 0] + before[..., 1] * after[..., 1])


def _chunks(n_pairs: int, n_stations: int) -> Iterator[slice]:
    step = max(1, _CHUNK // n_stations)
    return (slice(i, i + step) for i in range(0, n_pairs, step))


def _winding(yz: FloatArray, pairs: IntArray) -> FloatArray:
    out = np.empty(len(pairs))
    for part in _chunks(len(pairs), yz.shape[1]):
        separation = yz[pairs[part, 1]] - yz[pairs[part, 0]]
        out[part] = _turn(separation[:, :-1], separation[:, 1:]).sum(axis=1)
    return out


def _swapped(before: FloatArray, after: FloatArray, pairs: IntArray, diameter: FloatArray) -> BoolArray:
    """Pairs that touch at a station in both states and have turned there by 120 degrees or more."""
    out = np.zeros(len(pairs), dtype=bool)
    touching = 1.1 * (diameter[pairs[:, 0]] + diameter[pairs[:, 1]]) / 2
    for part in _chunks(len(pairs), before.shape[1]):
        then, now = (yz[pairs[part, 1]] - yz[pairs[part, 0]] for yz in (before, after))
        reach = touching[part, None] ** 2
        pair, station = np.nonzero(
            (then[..., 0] ** 2 + then[..., 1] ** 2 < reach) & (now[..., 0] ** 2 + now[..., 1] ** 2 < reach)
        )
        reversed_ = np.abs(_turn(then[pair, station], now[pair, station])) >= 2 * np.pi / 3
        out[part][pair[reversed_]] = True
    return out


def pair_winding(
    system: FilamentSystem, positions: FloatArray, pairs: IntArray, stations: FloatArray | None = None
) -> FloatArray:
    """(n_pairs,) angle in rad by which the (y, z) separation of two filaments turns from one end to the other.

    ``pairs`` (n_pairs, 2) filaments; ``positions`` (n_beads, 3) um; ``stations`` as of :func:`winding_stations`. With
    the ends held, the winding is a topological invariant: it jumps by 2 pi whenever the axis of
    one passes through that of the other, and only then. Filaments of straight segments between stations wind by the sum
    of turns below pi: the sum is exact. Raises InputError where the filaments have no common stations (sections).
    """
    at = winding_stations(system, positions) if stations is None else stations
    return _winding(sections_along(system, positions, at), np.asarray(pairs))


def _pairs_to_follow(system: FilamentSystem, sections: Iterator[FloatArray]) -> IntArray:
    n = system.n_filaments
    if n <= ALL_PAIRS_UP_TO:
        return np.stack(np.triu_indices(n, k=1), axis=1).astype(np.int64)
    reach = 1.5 * float(system.diameter.max())
    found = np.empty(0, dtype=np.int64)
    for yz in sections:
        planes = np.unique(np.linspace(0, yz.shape[1] - 1, 9).astype(int))
        near = [cKDTree(yz[:, k]).query_pairs(reach, output_type="ndarray") for k in planes]
        found = np.union1d(found, np.concatenate([p[:, 0].astype(np.int64) * n + p[:, 1] for p in near]))
    return np.stack([found // n, found % n], axis=1)


def filaments_through_each_other(system: FilamentSystem, frames: Frames, swaps: bool = True) -> Guard:
    """Number of pairs of filaments that have passed through each other since the first frame, by two signs.

    *Winding* (chains, :func:`pair_winding`): it may change only by what the two ends turn about each other, which is
    followed from frame to frame (under half a turn each); the rest is a multiple of 2 pi, and not zero once one has
    passed through the other. A filament that goes through and comes back on the same side, as if it had gone round,
    leaves no winding. *Swap* (chains and the discs of sections): a pair in contact (within 1.1 D) whose separation has
    reversed (by 120 degrees or more) from one frame to the next, while the platen moved less than D/2. Farther apart
    frames cannot tell. Up to :data:`ALL_PAIRS_UP_TO` filaments all pairs are followed, beyond it those within 1.5 D in
    any frame at one of nine planes. A column that buckles can reverse a pair as fast: ``swaps`` false leaves that sign
    out, right where it is known that no two filaments ever overlapped by a fifth of D. :func:`axis_distance` sees a
    passage while it happens. Raises InputError for frames of another number of beads.
    """
    name = "filaments through each other"
    if frames.positions.shape[1:] != (system.n_beads, 3):
        raise InputError("frames", frames.positions.shape, f"shape (n_frames, {system.n_beads}, 3)")
    if len(frames) < 2 or system.n_filaments < 2:
        return _not_applicable(name, 0.0, "it takes two frames and two filaments")
    if not np.all(np.isfinite(frames.positions)):
        return Guard(name, False, float("nan"), 0.0, f"{name}: positions are not finite")
    section = system.is_section
    close = np.abs(np.diff(frames.displacement_um)) < system.diameter.min() / 2
    if section and not swaps:
        return _not_applicable(name, 0.0, "no two discs ever overlapped deep enough")
    if section and not close.any():
        return _not_applicable(name, 0.0, "the platen moves more than half a diameter between frames")
    stations = np.zeros(1) if section else winding_stations(system, frames.positions[0])

    def sections() -> Iterator[FloatArray]:
        for positions in frames.positions:
            if section:
                yield positions[system.first_beads, None, 1:]
            else:
                yield sections_along(system, positions, stations)

    pairs = _pairs_to_follow(system, sections())
    passed: BoolArray = np.zeros(len(pairs), dtype=bool)
    note = ""
    states = sections()
    before = next(states)
    ends = (before[pairs[:, 1]] - before[pairs[:, 0]])[:, [0, -1]]
    first, ends_turned = _winding(before, pairs), np.zeros(len(pairs))
    for k, after in enumerate(states, start=1):
        now = (after[pairs[:, 1]] - after[pairs[:, 0]])[:, [0, -1]]
        turned = _turn(ends, now)
        ends_turned += turned[:, 1] - turned[:, 0]
        through = np.rint((_winding(after, pairs) - first - ends_turned) / (2 * np.pi)) != 0
        if swaps and close[k - 1]:
            through |= _swapped(before, after, pairs, system.diameter)
        if through.any() and not note:
            i, j = pairs[np.argmax(through)]
            note = f"; first {i} and {j}, by a displacement of {frames.displacement_um[k]:.4g} um"
        passed |= through
        before, ends = after, now
    guard = _none_of(name, int(passed.sum()), f"of {len(pairs)} pairs followed")
    return replace(guard, message=guard.message + note)


def axis_distance(system: FilamentSystem, positions: FloatArray, limit: float = 0.5) -> Guard:
    """Least distance of two filaments' axes over the (smallest) diameter: below ``limit`` they are about to pass
    through.

    Two touching filaments have 1; nested bead chains sqrt(1 - s^2/(4 D^2)). Above 1 it is given as inf.
    """
    name = "axis distance"
    if system.n_filaments < 2:
        return _not_applicable(name, limit, "it takes two filaments")
    if not np.all(np.isfinite(positions)):
        return Guard(name, False, float("nan"), limit, f"{name}: positions are not finite")
    diameter = float(system.diameter.min())
    value = minimum_axis_distance(system, positions, diameter) / diameter
    shown = f"{value:.3g}" if np.isfinite(value) else "above 1"
    return Guard(name, value > limit, value, limit, f"{name}: least {shown} of the diameter (limit {limit:.3g})")


def stretch(system: FilamentSystem, frames: Frames, softening: float, limit: float = 0.01) -> Guard:
    """Largest axial strain of a segment in any frame that is owed to softening: |l/l0 - 1| (1 - 1/softening).

    l0 is the length as built, end load included. Softened EA lengthens the step; where the ends cannot follow
    (clamped, periodic) or friction holds, filaments stretch and shorten ``softening`` times too much.
    """
    name = "stretch of softened filaments"
    if softening <= 1.0:
        return _not_applicable(name, limit, "filaments have their real axial stiffness")
    bonds = system.bonds()
    built = system.bond_lengths()
    worst = 0.0
    for k, positions in enumerate(frames.positions):
        u = frames.system_at(system, k).nearest(positions[bonds[:, 1]] - positions[bonds[:, 0]])
        worst = max(worst, float(np.max(np.abs(np.linalg.norm(u, axis=1) / built - 1), initial=0.0)))
    value = worst * (1 - 1 / softening)
    message = f"{name}: {value:.2g} (limit {limit:.2g}), softened {softening:.4g} times; lower model.axial_softening"
    return Guard(name, value <= limit, value, limit, message)


def largest_bend(system: FilamentSystem, frames: Frames, limit: float = 0.5) -> Guard:
    """Largest turn between two neighbouring segments in any frame, rad: the spacing no longer resolves the bend.

    At 0.5 rad a chain's hinge, K sin(turn) for K turn, is 4 % soft; beyond pi a rod's bond pulls the wrong way.
    """
    name = "bend of a segment"
    angles = system.angles()
    if not len(angles):
        return _not_applicable(name, limit, "there are no angles")
    worst = 0.0
    for frame, positions in enumerate(frames.positions):
        now = frames.system_at(system, frame)
        u, v = (now.nearest(positions[angles[:, k + 1]] - positions[angles[:, k]]) for k in (0, 1))
        cross = np.linalg.norm(np.cross(u, v), axis=1)
        worst = max(worst, float(np.max(np.arctan2(cross, np.sum(u * v, axis=1)))))
    message = f"{name}: {worst:.2g} rad between neighbours (limit {limit:.2g} rad); press less, or lower model.spacing"
    return Guard(name, worst <= limit, worst, limit, message)


def quasi_static(curve: Curve, after_um: float, limit: float = 0.05) -> Guard:
    """Largest kinetic energy over the work done so far, from the first sample at a displacement of ``after_um`` on.

    The work is its running maximum, so that unloading does not divide by nothing; to it comes that of a cell's edges,
    whichever way they go. A small ratio is needed, not enough: only halving the platen speed shows that the force is
    quasi-static.
    """
    name = "quasi-static"
    reached = np.flatnonzero(curve["displacement_um"] >= after_um)
    if not len(reached):
        return _not_applicable(name, limit, f"the platen never reached {after_um:.4g} um")
    kinetic = curve["kinetic_J"][reached[0] :]
    work = np.maximum.accumulate(curve["work_J"])
    if curve.cell:
        work = work + np.maximum.accumulate(np.abs(curve.cell["work_cell_J"]))
    work = work[reached[0] :]
    if not (np.all(np.isfinite(kinetic)) and np.all(np.isfinite(work))):
        return Guard(name, False, float("nan"), limit, f"{name}: energies are not finite")
    moving = kinetic > 0
    ratio = np.zeros(len(kinetic))
    ratio[moving] = np.divide(kinetic[moving], work[moving], out=np.full(moving.sum(), np.inf), where=work[moving] > 0)
    worst = int(np.argmax(ratio))
    value = float(ratio[worst])
    where = f"at {curve['displacement_um'][reached[0] + worst]:.4g} um"
    return Guard(name, value <= limit, value, limit, f"{name}: kinetic/work {value:.3g} {where} (limit {limit:.3g})")


def force_balance(curve: Curve, applies: bool, limit: float = 0.05) -> Guard:
    """Mean |top - bottom| over the mean of the larger of both, where the force exceeds a tenth of its peak.

    ``applies``: whether the two must balance (nothing but the platens holds the assembly: no end supports under it, no
    springs). The force of a run that is too fast is larger at the moving platen.
    """
    name = "top against bottom force"
    if not applies:
        return _not_applicable(name, limit, "supports or springs carry part of the force")
    top, bottom = curve["force_top_N"], curve["force_bottom_N"]
    larger = np.maximum(np.abs(top), np.abs(bottom))
    if not np.all(np.isfinite(larger)):
        return Guard(name, False, float("nan"), limit, f"{name}: forces are not finite")
    loaded = larger > 0.1 * larger.max(initial=0.0)
    if not loaded.any():
        return _not_applicable(name, limit, "there is no force")
    value = float(np.abs(top - bottom)[loaded].sum() / larger[loaded].sum())
    return Guard(name, value <= limit, value, limit, f"{name}: differ by {value:.3g} (limit {limit:.3g})")


def _loaded(curve: Curve) -> BoolArray:
    top = np.abs(curve["force_top_N"])
    return np.asarray(top > 0.1 * top.max(initial=0.0))


def section_balance(curve: Curve, balance: Balance, limit: float = 0.02) -> Guard:
    """Newton's second law of a section: sum of |F_bottom - F_top + F_springs + F_drag - dp/dt| over that of the force.

    Where the force exceeds a tenth of its peak; dp/dt by central differences of the samples' means, the forces as
    means over the same stretch (1/4, 1/2, 1/4 of three samples).
    """
    name = "force balance"
    total = curve["force_bottom_N"] - curve["force_top_N"] + balance.springs + balance.drag
    if not np.all(np.isfinite(total)):
        return Guard(name, False, float("nan"), limit, f"{name}: forces are not finite")
    loaded = _loaded(curve)[1:-1]
    if len(curve) < 3 or not loaded.any():
        return _not_applicable(name, limit, "there is no force")
    even = 0.25 * total[:-2] + 0.5 * total[1:-1] + 0.25 * total[2:]
    rate = (balance.momentum[2:] - balance.momentum[:-2]) / (curve["time_us"][2:] - curve["time_us"][:-2])
    force = np.abs(curve["force_top_N"][1:-1])[loaded]
    value = float(np.abs(even - rate)[loaded].sum() / force.sum())
    message = f"{name}: platens, springs, drag and inertia leave {value:.2g} of the force (limit {limit:.2g})"
    return Guard(name, value <= limit, value, limit, message)


def section_inertia(curve: Curve, balance: Balance, limit: float) -> Guard:
    """Share of a section's force that is not borne: sum of |F_top - F_bottom - F_springs| over that of F_top.

    Inertia and drag, that is; none in a quasi-static run. Where the force exceeds a tenth of its peak.
    """
    name = "inertia and drag"
    loaded = _loaded(curve)
    if not loaded.any() or not np.any(curve["force_top_N"]):
        return _not_applicable(name, limit, "there is no force")
    off = np.abs(curve["force_top_N"] - curve["force_bottom_N"] - balance.springs)[loaded]
    value = float(off.sum() / np.abs(curve["force_top_N"])[loaded].sum())
    message = f"{name}: {value:.2g} of the force (limit {limit:.2g}); lower model.accuracy or platens.speed"
    return Guard(name, value <= limit, value, limit, message)


def section_energy(curve: Curve, balance: Balance, limit: float = 0.02) -> Guard:
    """Largest excess of stored and kinetic energy over the work done, over the largest work so far.

    Friction and damping, which are not recorded, can only take energy; without them both are equal. Beside the
    platens' work there is that of contacts made stiffer: their energy and the kinetic one times dln(factor).
    """
    name = "energy balance"
    scaled = (balance.contact + curve["kinetic_J"]) / balance.factor
    stiffening = 0.5 * (scaled[1:] + scaled[:-1]) * np.diff(balance.factor)
    work = curve["work_J"] + np.concatenate([[0.0], np.cumsum(stiffening)])
    inside = curve["stored_J"] + curve["kinetic_J"]
    if not np.all(np.isfinite(inside)):
        return Guard(name, False, float("nan"), limit, f"{name}: energies are not finite")
    most = np.maximum.accumulate(work)
    begun = most > 0.01 * most.max(initial=0.0)
    if not begun.any():
        return _not_applicable(name, limit, "there is no work")
    value = max(0.0, float(np.max((inside - work)[begun] / most[begun])))
    share = 1 - float(inside[-1] / work[-1]) if work[-1] > 0 else 0.0
    message = (
        f"{name}: stored and kinetic energy exceed the work by {value:.2g} of it at most (limit {limit:.2g}); "
        f"{share:.0%} of the work is lost to friction and damping in the end"
    )
    return Guard(name, value <= limit, value, limit, message)


def finite(curve: Curve, frames: Frames) -> Guard:
    """Number of values in the record and the frames that are not finite."""
    record = [*curve.columns.values(), curve.width_um]
    count = sum(int(np.sum(~np.isfinite(column))) for column in record)
    count += int(np.sum(~np.isfinite(frames.positions)))
    return _none_of("finite values", count, "values of the record and the frames are not finite")


def lost_beads(expected: int, found: int) -> Guard:
    """Beads that the engine no longer has."""
    return _none_of("lost beads", expected - found, f"of {expected} beads missing")


def filaments_outside_box(system: FilamentSystem, positions: FloatArray) -> Guard:
    """Number of filaments with a bead outside the box along an axis that is not periodic (sections: y and z only)."""
    outside = (positions < system.box[:, 0]) | (positions > system.box[:, 1]) | ~np.isfinite(positions)
    outside &= ~system.periodic
    if system.is_section:
        outside[:, 0] = False
    left = np.unique(system.filament_of_bead[outside.any(axis=1)])
    return _none_of("filaments outside the box", len(left), "filaments left the box")
