"""Judge and measure a finished run: guards, statistics of every frame, fits of the curve. Arrays in, numbers out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.engine.assemble import beads_under, crimp_cylinders, platen_heights
from cgfibre.engine.collect import Extremes, displacement_at
from cgfibre.errors import InputError
from cgfibre.measure import compaction, distribution, guards
from cgfibre.measure.contacts import Contacts, CylinderPlaten, FlatPlaten, filament_contacts
from cgfibre.measure.guards import Guard
from cgfibre.measure.segments import LineLaw, segment_contacts
from cgfibre.measure.voids import find_voids
from cgfibre.mechanics.contact import LineContact
from cgfibre.plan.contact import OVERLAP_LIMIT
from cgfibre.plan.model import FREE, Plan, every_bead
from cgfibre.plan.motion import REFERENCE_DISPLACEMENT
from cgfibre.record import Balance, Curve, Frames
from cgfibre.review_fabric import fabric_statistics, passing_guard, plane_guard, upright
from cgfibre.scene import Scene

#: largest kinetic energy over work beyond the reference displacement
ENERGY_LIMIT = 0.05
#: mean change of the force on halving the platen speed, over the accuracy asked for, beyond which a run is distrusted
SPEED_FACTOR = 2.0
#: pressures at which the summary gives the thickness, MPa
PRESSURES = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
#: speed over the fastest quasi-static one beyond which a run is distrusted without a speed check: at 1.3 times it the
#: force of seven filaments is 5 % high (accuracy 5 %), at 1.9 times 11 %
FAST = 1.5
#: largest slide of filaments under the anvil's edge over the free span beside it
SLIDE_LIMIT = 0.15
#: largest turn of a section's disc on the engine's own fixes: its spring's torque k sin(turn) is then 4 % below k turn
TURN_LIMIT = 0.5
#: largest roll of a rod, rad: beyond half a turn it is not told from one the other way
ROLL_LIMIT = 3.1
#: approach over D at which the line contact's theory ends: b/R = 0.58 at 10 N/mm of carbon, 6 % soft there
APPROACH_LIMIT = 0.25
#: the same of soft tows over their thickness: half of it
TOW_LIMIT = 0.5
#: filaments of beads at most D apart overlap by 0.29 D on their way through each other (sqrt(1/2) D between centres)
PASSING_OVERLAP = 0.2
#: largest difference of the platen's path from the plan's, over the whole path
MOTION_LIMIT = 0.05
#: surfaces this far apart (over D) count as neighbours in the coordination number
TOUCHING = 0.02

Gap = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Review:
    """What was measured: guards, statistics (name -> values a frame, units), fits of the loading curve, and the
    displacement and force from which on the run is quasi-static to the accuracy asked for."""

    guards: tuple[Guard, ...]
    statistics: dict[str, tuple[np.ndarray, str]]
    fits: dict[str, Any]
    energy_ratio: float | None
    quasi_static_um: float | None = None
    quasi_static_N: float | None = None

    @property
    def ok(self) -> bool:
        """No guard failed."""
        return all(g.ok for g in self.guards)


def mid_plane(scene: Scene, plan: Plan) -> float:
    """x of the plane under the middle of the platen, um."""
    if plan.woven is not None:
        return plan.woven.size[0] / 2
    return 0.0 if plan.flat else scene.bundle.length / 2


def platen_gaps(plan: Plan, system: FilamentSystem, displacement: float) -> tuple[Gap, Gap]:
    """Gap functions of the top and the bottom platen at a displacement of the top one, um; surfaces without edges."""
    top, bottom = platen_heights(system, plan)
    p = plan.platens
    if p.shape != "crimped":
        return FlatPlaten(top - displacement, True), FlatPlaten(bottom, False)
    top_z, bottom_z = crimp_cylinders(plan, top, bottom)
    across = plan.level == "section"
    upper = CylinderPlaten(p.crimp_centre, top_z - displacement, p.crimp_radius, p.convex, across=across)
    lower: Gap = FlatPlaten(bottom, False)
    if p.bottom_crimped:
        lower = CylinderPlaten(p.crimp_centre, bottom_z, p.crimp_radius, p.convex, across=across)
    return upper, lower


def review_run(
    scene: Scene,
    plan: Plan,
    system: FilamentSystem,
    curve: Curve,
    frames: Frames,
    extremes: Extremes | None,
    speed: dict[str, float] | None = None,
) -> Review:
    """All guards, statistics and fits of a run, finished or cut short; ``speed`` is what :func:`speed_change` found."""
    shallow = (
        extremes is not None
        and len(extremes.closest) > 0
        and bool(np.max(1 - extremes.closest / float(np.max(system.diameter))) < PASSING_OVERLAP)
    )
    found = list(_guards(scene, plan, system, curve, frames, swaps=not shallow))
    if extremes is not None and len(extremes.closest):
        found += _extreme_guards(plan, system, extremes)
        if extremes.balance is not None and len(extremes.balance.springs) == len(curve):
            found += [
                guards.section_balance(curve, extremes.balance),
                guards.section_inertia(curve, extremes.balance, scene.model.accuracy),
                guards.section_energy(curve, extremes.balance),
            ]
    found.append(_motion_guard(plan, curve, None if extremes is None else extremes.balance))
    found += _stop_guards(plan, curve)
    # a short first loading may never get there, a later one does
    starts = (quasi_static_from(plan, system, curve.of(k)) for k in range(1, curve.cycles + 1))
    start = next((s for s in starts if s is not None), None)
    ratio = None
    if start is None:
        limit = float(plan.motion.quasi_static_force(np.array(np.max(curve["displacement_um"])))) * 1e-9
        peak = float(np.max(curve["force_top_N"], initial=0.0))
        found.append(
            Guard(
                "quasi-static",
                False,
                peak,
                limit,
                f"quasi-static: the force ({peak:.2g} N) did not rise above {limit:.2g} N, below which inertia is "
                "more than the accuracy asked for; press further or slower",
            )
        )
    else:
        energy = guards.quasi_static(curve, start, ENERGY_LIMIT)
        found.append(energy)
        ratio = energy.value
    if plan.motion.last > FAST * plan.motion.fastest:
        found.append(
            Guard(
                "platen speed",
                False,
                plan.motion.last,
                FAST * plan.motion.fastest,
                f"the platen's {plan.motion.last:.3g} m/s is far above the {plan.motion.fastest:.3g} m/s that accuracy "
                f"{scene.model.accuracy:g} allows: not quasi-static; lower platens.speed",
            )
        )
    if speed is not None:
        limit = SPEED_FACTOR * scene.model.accuracy
        found.append(
            Guard(
                "platen speed",
                speed["mean"] <= limit,
                speed["mean"],
                limit,
                f"halving the platen speed changes the force by {speed['mean']:.1%} on average (limit {limit:.0%}): "
                "not quasi-static; lower model.accuracy or platens.speed",
            )
        )
    force = None if start is None else float(plan.motion.quasi_static_force(np.array(start))) * 1e-9
    return Review(
        tuple(found), frame_statistics(scene, plan, system, frames), fit_curve(plan, curve), ratio, start, force
    )


def quasi_static_from(plan: Plan, system: FilamentSystem, curve: Curve) -> float | None:
    """Displacement (um) from which on the accuracy asked for is promised; None when the run never gets there.

    At least 2/7 D, and from there on every loading force above the plan's quasi-static force at its speed.
    """
    d, force = curve["displacement_um"][curve.loading], curve["force_top_N"][curve.loading] * 1e9
    start = min(REFERENCE_DISPLACEMENT * float(np.max(system.diameter)), plan.motion.targets[0].displacement / 2)
    if plan.woven is not None:  # tows touch at once, and are thick
        start = 0.0
    short = np.flatnonzero((d < start) | (force < plan.motion.quasi_static_force(d)))
    after = int(short[-1]) + 1 if len(short) else 0
    return float(d[after]) if after < len(d) else None


def _guards(scene: Scene, plan: Plan, system: FilamentSystem, curve: Curve, frames: Frames, swaps: bool) -> list[Guard]:
    found = [guards.finite(curve, frames)]
    if len(frames):
        found.append(guards.lost_beads(system.n_beads, int(np.sum(np.isfinite(frames.positions[-1]).all(axis=1)))))
    if not found[0].ok or not all(g.ok for g in found) or len(frames) == 0:
        return found  # geometry of what is not finite says nothing
    if plan.woven is not None:
        found.append(passing_guard(system, plan, upright(system, frames)))
        if plan.woven.moved and curve.cell:
            found.append(plane_guard(plan.woven, curve))
    else:
        found.append(guards.filaments_through_each_other(system, frames, swaps))
    for side, span in enumerate((plan.platens.top_span, plan.platens.bottom_span)):
        # a platen presses the beads that were built under it, wherever they slide
        pressed = beads_under(system, plan, span)
        gaps = [[platen_gaps(plan, system, float(d))[side]] for d in frames.displacement_um]
        found.append(
            guards.beads_past_platen(
                Frames(frames.step, frames.displacement_um, frames.positions[:, pressed]),
                gaps,
                f"beads past the {('top', 'bottom')[side]} platen",
            )
        )
    if not plan.flat:
        found.append(guards.stretch(system, frames, plan.axial_softening))
        found.append(guards.largest_bend(system, frames))
        if plan.woven is None:
            found.append(_gone_guard(scene, plan, system, frames))
    found.append(guards.force_balance(curve, applies=plan.beads.support == "periodic"))
    if plan.platens.top_span is not None and not plan.contact.per_length:  # a segment meets the edge where that is
        found.append(_slide_guard(plan, system, frames))
    return found


def _gone_guard(scene: Scene, plan: Plan, system: FilamentSystem, frames: Frames) -> Guard:
    """Filaments that no longer pass the plane under the middle of the platen: slid out between the platens."""
    x = mid_plane(scene, plan)
    gone: set[int] = set()
    for positions in frames.positions:
        gone |= set(np.flatnonzero(np.isnan(distribution.section_at(system, positions, x)[:, 0])).tolist())
    name = "filaments gone"
    message = f"{name}: {len(gone) or 'no'} filaments slid out from under the middle of the platen; press less deep"
    return Guard(name, not gone, float(len(gone)), 0.0, message)


def _motion_guard(plan: Plan, curve: Curve, balance: Balance | None) -> Guard:
    """Whether the platen went as planned: a deck run by hand with another step or speed is not what the plan judges.

    Only until contacts of a section become stiffer: the platen is slower from then on.
    """
    loading = curve.loading & (curve["step"] > 0)
    if balance is not None:
        loading &= np.maximum.accumulate(balance.factor) <= 1
    loading[np.flatnonzero(loading)[-1:]] = False  # decks of earlier versions do not tell where the platen turned
    middle = curve["step"][loading] - 0.5 * plan.sampling.sample
    last = plan.motion.load_steps - 1
    film = [displacement_at(plan, np.minimum(middle + k * plan.sampling.block, last)) for k in (0, 1)]
    # within a block the deck goes straight where the film is curved
    off = np.abs(curve["displacement_um"][loading] - film[0]) - 0.25 * (film[1] - film[0])
    share = float(np.max(off, initial=0.0) / max(float(np.max(film[0], initial=0.0)), 1e-12))
    return Guard(
        "motion as planned",
        share <= MOTION_LIMIT,
        share,
        MOTION_LIMIT,
        f"motion as planned: the platen's path differs from the plan's by {share:.1%}: the deck ran with another time "
        "step, speed or number of steps than its plan; judge such runs by plans of their own",
    )


def _stop_guards(plan: Plan, curve: Curve) -> list[Guard]:
    """Whether stops by force or pressure were met before the loading came to the deepest place planned.

    Of loadings that ended: something followed, or the last one came to its deepest place.
    """
    found = []
    targets = plan.motion.targets
    for k, target in enumerate(targets, start=1):
        own, last = curve.of(k), k == len(targets)
        ended = bool(np.any(own.phase > 0)) or (last and _place(own) >= target.displacement)
        stops = (
            ("force", target.force * 1e-9, "force_top_N", "N"),
            ("pressure", target.pressure * 1e-3, "pressure_MPa", "MPa"),
        )
        for what, limit, column, unit in stops:
            if math.isinf(limit) or not (ended or np.any(own[column] >= limit)):
                continue
            peak = float(np.max(own[column], initial=0.0))
            name = "stop met" if last else f"stop of cycle {k}"
            message = (
                f"{name}: its {what} came to {peak:.3g} of {limit:.3g} {unit} at the deepest place planned, "
                f"{target.displacement:.4g} um: filaments gave way; ask for less"
            )
            found.append(Guard(name, peak >= limit * (1 - 1e-9), peak, limit, message))
    return found


def _place(curve: Curve) -> float:
    """Displacement that a loading came to, um, to a row: rows are means over their windows."""
    d = curve["displacement_um"][curve.loading]
    return 2 * float(d[-1]) - float(d[-2]) if len(d) > 1 else 0.0


def _slide_guard(plan: Plan, system: FilamentSystem, frames: Frames) -> Guard:
    """How far filaments slid under the anvil's edges, over the free span that bends beside them.

    The edge presses the bead built under it, also where that slides inwards: the free span then grows by as much.
    """
    lo, hi = plan.platens.top_span or (0.0, 0.0)
    pressed = beads_under(system, plan, (lo, hi))
    x = system.positions[pressed, 0]
    edge = np.flatnonzero(pressed)[(np.abs(x - lo) < 1e-3) | (np.abs(x - hi) < 1e-3)]
    slide = float(np.max(np.abs(frames.positions[:, edge, 0] - system.positions[edge, 0]), initial=0.0))
    share = slide / plan.free_span
    return Guard(
        "sliding under the anvil's edge",
        share <= SLIDE_LIMIT,
        share,
        SLIDE_LIMIT,
        f"sliding under the anvil's edge: filaments slid by {slide:.2g} um, {share:.0%} of the free span (limit "
        f"{SLIDE_LIMIT:.0%}); the edge moves with them, so bending forces are too low by about three times that; press "
        "less deep",
    )


def _extreme_guards(plan: Plan, system: FilamentSystem, extremes: Extremes) -> list[Guard]:
    """Guards on every sample of the run, not on the few frames alone."""
    d = float(np.max(system.diameter))
    # a sub-bundle's law goes as far as its table; softened or not, overlap is the model
    softening = 1.0 if plan.discs is not None else plan.contact.softening
    factor = np.ones(len(extremes.closest))
    if extremes.balance is not None:
        factor = extremes.balance.factor[1:]
    soft = plan.woven is not None and plan.woven.resolve == "tow"
    found = [_depth_guard("overlap of filaments", 1 - extremes.closest / d, softening, factor, soft)]
    if plan.platens.shape != "crimped":
        top, bottom = platen_heights(system, plan)
        reach = extremes.z_hi + d / 2 - (top - extremes.displacement)
        if plan.platens.bottom_span == plan.platens.top_span:
            reach = np.maximum(reach, bottom - (extremes.z_lo - d / 2))
        depth = float(np.max(reach)) / d
        if depth > 0.5:
            found.append(
                Guard(
                    "platen passed",
                    False,
                    depth,
                    0.5,
                    f"a filament's axis passed a platen ({depth:.0%} of a diameter deep): the platen has lost it",
                )
            )
        else:
            found.append(_depth_guard("overlap with a platen", reach / d, softening, factor, soft))
    if plan.flat and plan.disc_fixes == "engine" and plan.springs[1] > 0:
        turn = float(np.max(extremes.turn))
        found.append(
            Guard(
                "turn of discs",
                turn <= TURN_LIMIT,
                turn,
                TURN_LIMIT,
                f"a disc turned by {turn:.2g} rad (limit {TURN_LIMIT} rad): its torsional spring is too soft there",
            )
        )
    if plan.level == "rod" and plan.contact.per_length:
        roll, name = float(np.max(extremes.turn)), "roll of rods"
        message = f"{name}: a bead turned by up to {roll:.2g} rad about its axis (limit {ROLL_LIMIT} rad: half a turn)"
        found.append(Guard(name, roll <= ROLL_LIMIT, roll, ROLL_LIMIT, message))
    return found


def _depth_guard(name: str, overlaps: FloatArray, softening: float, factor: FloatArray, soft: bool = False) -> Guard:
    """Overlaps over D: what softening adds to the real approach of the surfaces, and whether that is still Hertz'.

    ``factor``: how many times stiffer than at first the softened contacts had become by each sample. ``soft``: tows,
    whose law is of their whole section.
    """
    added = overlaps * (1 - factor / softening)
    artefact, overlap = (float(np.max(x, initial=0.0)) for x in (added, overlaps))
    if artefact > OVERLAP_LIMIT:
        return Guard(
            name,
            False,
            artefact,
            OVERLAP_LIMIT,
            f"{name}: softened contacts add {artefact:.1%} of a diameter (limit {OVERLAP_LIMIT:.0%}), which thickness "
            "takes up; lower contact.softening",
        )
    limit = TOW_LIMIT if soft else APPROACH_LIMIT
    why = "the line contact's theory ends there); press less, or raise contact.line_load"
    if soft:
        why = "a tow as thin as that is no rod of its thickness any more); press less, or raise contact.stiffness"
    return Guard(
        name,
        overlap <= limit,
        overlap,
        limit,
        f"{name}: surfaces approach by {overlap:.1%} of a diameter (limit {limit:.0%}: {why}",
    )


def frame_statistics(
    scene: Scene, plan: Plan, system: FilamentSystem, frames: Frames
) -> dict[str, tuple[np.ndarray, str]]:
    """Distribution of the filaments under the middle of the platen and their contacts, one row a frame."""
    if plan.woven is not None:
        top, bottom = platen_heights(system, plan)
        faces = np.column_stack([np.full(len(frames), bottom), top - frames.displacement_um])
        law, modulus = line_law(plan, system), hertz_modulus(plan)
        friction = plan.contact.sliding_friction
        return fabric_statistics(system, frames, faces, law, modulus, plan.contact.both_sides, friction)
    x = mid_plane(scene, plan)
    d = float(np.max(system.diameter))
    rows: list[dict[str, Any]] = []
    reference = None
    first_area = 0.0
    for positions, factor in zip(frames.positions, frames.factor.tolist(), strict=True):
        if not np.all(np.isfinite(positions)):
            break
        centres = distribution.section_at(system, positions, x)
        if not np.all(np.isfinite(centres)):
            break  # a filament has left the plane: its guard says so
        width, thickness = distribution.bundle_size(centres, d)
        area = distribution.polygon_area(distribution.outline(centres, d))
        row: dict[str, Any] = {"width": width, "thickness": thickness, "outline_area": area}
        if len(centres) >= 3:
            if reference is None:
                reference, first_area = distribution.normalisation(centres, d), area
            fit = distribution.fit_distribution(centres, reference)
            local = distribution.local_volume_fraction(centres, d)
            near = distribution.nearest_neighbour_distance(centres)
            row |= {
                "mean": fit.mean,
                "sd": fit.sd,
                "gaussian_r_squared": fit.r_squared,
                "gaussian_ks": fit.ks_distance,
                "area_strain": float(distribution.area_strain(area, first_area)),
                "local_volume_fraction_mean": float(np.mean(local)),
                "local_volume_fraction_sd": float(np.std(local)),
                "coordination_mean": float(np.mean(distribution.coordination_number(centres, d, TOUCHING * d))),
                "nearest_neighbour_mean": float(np.mean(near)),
                "nearest_neighbour_least": float(np.min(near)),
            }
            room = find_voids(centres, d)
            row |= {
                "void_count": len(room),
                "void_area_mean": float(np.mean(room.area)) if len(room) else 0.0,
                "void_radius_largest": float(np.max(room.radius, initial=0.0)),
                "hydraulic_radius": room.hydraulic_radius,
            }
        row |= _contact_row(plan, system, positions, factor)
        rows.append(row)
    units = {
        "width": "um",
        "thickness": "um",
        "outline_area": "um2",
        "nearest_neighbour_mean": "um",
        "nearest_neighbour_least": "um",
        "void_area_mean": "um2",
        "void_radius_largest": "um",
        "hydraulic_radius": "um",
        "contact_force_mean": "nN",
        "contact_force_largest": "nN",
    }
    if not rows:
        return {}
    statistics = {name: (np.array([row[name] for row in rows]), units.get(name, "1")) for name in rows[0]}
    statistics["displacement"] = (frames.displacement_um[: len(rows)], "um")
    return statistics


def contact_length(plan: Plan, system: FilamentSystem) -> FloatArray:
    """(n_beads,) length of contact line that a bead stands for, um; 0 where beads do not touch."""
    if plan.flat:
        return np.full(system.n_beads, plan.depth)
    role = every_bead(system, plan.beads.role)
    return np.where(role == 0, plan.spacing, 0.0)


def contacts_under_platen(plan: Plan, system: FilamentSystem, positions: FloatArray, factor: float = 1.0) -> Contacts:
    """Contacts between filaments under the top platen; their forces by the line contact (none for the law hertz).

    ``factor``: how many times stiffer than at first a section's softened contacts had become (Frames.factor).
    """
    if plan.contact.per_length:
        touching = every_bead(system, plan.beads.role) != FREE
        contacts = segment_contacts(system, positions, line_law(plan, system), touching)
    else:
        now = factor * plan.contact.line_stiffness / plan.contact.softening
        stiffness = now if plan.contact.law == "hooke" else 0.0
        contacts = filament_contacts(system, positions, stiffness, contact_length(plan, system))
    return contacts if plan.platens.top_span is None else contacts.within(*plan.platens.top_span)


def line_law(plan: Plan, system: FilamentSystem) -> LineLaw:
    """Force per length against overlap of two filaments, as the plan's capsules have it."""
    c = plan.contact
    if c.law == "hooke":
        return lambda overlap: c.kn * overlap
    if c.law == "table":
        d, load = (np.array([row[k] for row in c.pair]) for k in (0, 1))
        steep = (load[-1] - load[-2]) / (d[-1] - d[-2])
        return lambda overlap: np.interp(overlap, d, load, left=0.0) + steep * np.maximum(overlap - d[-1], 0.0)
    radius = float(np.max(system.diameter)) / 2
    line = LineContact(c.modulus, radius / 2, radius)
    return lambda overlap: line.line_load(np.minimum(overlap, 0.999 * line.greatest_approach))


def hertz_modulus(plan: Plan) -> float | None:
    """E* (kPa) with which filaments that cross take Hertz' law, or None where they never do."""
    return plan.contact.modulus if plan.contact.law == "line" else None


def _contact_row(plan: Plan, system: FilamentSystem, positions: FloatArray, factor: float) -> dict[str, Any]:
    contacts = contacts_under_platen(plan, system, positions, factor)
    row: dict[str, Any] = {"contact_count": len(contacts)}
    if plan.contact.law != "hertz":
        row |= {
            "contact_force_mean": float(np.mean(contacts.force)) if len(contacts) else 0.0,
            "contact_force_largest": float(np.max(contacts.force, initial=0.0)),
        }
    return row


def thickness_at(curve: Curve) -> dict[str, float]:
    """Thickness (um) of the loading at each of :data:`PRESSURES`, by its text; nan where the pressure is not met."""
    thickness, pressure = curve["thickness_um"][curve.loading], curve["pressure_MPa"][curve.loading]
    at = compaction.thickness_at_pressure(thickness, pressure, np.array(PRESSURES))
    return {f"{p:g}": float(h) for p, h in zip(PRESSURES, at, strict=True)}


def measure_cycle(curve: Curve) -> dict[str, Any]:
    """One cycle of a curve (:meth:`Curve.of`): its peak, the thickness at fixed pressures, the work of loading and,
    where it was unloaded, its permanent set and the loss.

    ``set_um`` is the displacement, from the assembly as built, at which unloading ended: the platen feels nothing any
    more, or stands where it first touched. The next cycle begins there.
    """
    d, force, thickness = curve["displacement_um"], curve["force_top_N"], curve["thickness_um"]
    peak = int(np.argmax(force))
    loop = compaction.hysteresis(d, force, curve.phase)
    found: dict[str, Any] = {
        "peak_force_N": float(force[peak]),
        "peak_pressure_MPa": float(curve["pressure_MPa"][peak]),
        "thickness_um_at_peak": float(thickness[peak]),
        "thickness_um_at_MPa": thickness_at(curve),
        "work_J": loop.loading * 1e-6,
    }
    if np.any(curve.unloading):
        # a row is the mean over its window: unloading went on by half a row
        end = float(d[-1] + (d[-1] - d[-2]) / 2)
        found |= {
            "set_um": end,
            "thickness_um_released": float(thickness[-1] + d[-1] - end),
            "loss_J": loop.loss * 1e-6,
            "loss_fraction": loop.fraction,
        }
    return found


def fit_curve(plan: Plan, curve: Curve) -> dict[str, Any]:
    """Hysteresis (of the last cycle), thickness at fixed pressures; over the quasi-static part of the first loading the
    power law eps = a p^b with its tangent modulus, and Poisson's ratio at its stop; each cycle where there are several.
    """
    loading = curve.loading & (curve["force_top_N"] * 1e9 > plan.motion.quasi_static_force(curve["displacement_um"]))
    fits: dict[str, Any] = {}
    final = curve.of(curve.cycles)
    if np.any(final.unloading):
        loop = compaction.hysteresis(final["displacement_um"], final["force_top_N"], final.phase)
        fits["hysteresis"] = {"loss_J": loop.loss * 1e-6, "fraction": loop.fraction}
    fits["thickness_um_at_MPa"] = thickness_at(curve)
    if curve.cycles > 1:
        fits["cycles"] = [measure_cycle(curve.of(k)) for k in range(1, curve.cycles + 1)]
    strain = compaction.compressive_strain(curve["displacement_um"], float(curve["thickness_um"][0]))[loading]
    pressure = curve["pressure_MPa"][loading]
    try:
        law = compaction.fit_power_law(pressure, strain)
    except InputError:
        return fits
    fits["power_law"] = {
        "a": law.a,
        "b": law.b,
        "a_error": law.a_error,
        "b_error": law.b_error,
        "r_squared": law.r_squared,
        "window_MPa": list(law.window),
        "tangent_modulus_MPa_at_stop": float(law.modulus(float(strain[-1]))),
    }
    ratio = compaction.poisson_ratio(curve.width_um[curve.loading], curve["thickness_um"][curve.loading])
    fits["poisson_ratio_at_stop"] = float(ratio[-1])
    return fits


def speed_change(curve: Curve, slow: Curve, start: float) -> dict[str, float]:
    """Change of the loading force on halving the platen speed, from the displacement ``start`` um on.

    |F - F_slow| / F_slow at the samples of the slower run: its mean and its worst. nan without a common stretch.
    """
    d, f = curve["displacement_um"][curve.loading], curve["force_top_N"][curve.loading]
    other = slow.loading & (slow["displacement_um"] >= start) & (slow["displacement_um"] <= d.max(initial=0.0))
    reference = slow["force_top_N"][other]
    keep = reference > 0
    if not keep.any():
        return {"mean": math.nan, "worst": math.nan}
    change = np.abs(np.interp(slow["displacement_um"][other][keep], d, f) / reference[keep] - 1)
    return {"mean": float(np.mean(change)), "worst": float(np.max(change))}
