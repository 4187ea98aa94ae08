"""What a finished run of a weave is judged and measured by, beside what holds for every run: guards and statistics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.measure.crossing_forces import CrossingLoads, crossing_loads, touches
from cgfibre.measure.crossings import Crossings, filament_crossings, through_each_other, tow_crossings
from cgfibre.measure.fabric import Fabric, TowLine, areal_density, fabric_of, lines_of, tow_lines
from cgfibre.measure.fabric_section import (
    Room,
    open_area,
    plane_frame,
    plane_window,
    room_between,
    tow_image,
    tow_sections,
)
from cgfibre.measure.guards import Guard
from cgfibre.measure.segments import LineLaw, period_of
from cgfibre.mechanics.trellis import turning_friction
from cgfibre.plan.model import Plan, Woven
from cgfibre.record import Curve, Frames

#: pixels across the thinnest of tow, filament and cell in pictures of sections and of the plane, and at most in all
PIXELS, MOST_PIXELS = 12.0, 20_000
#: of the strain or shear, and of the tension, asked for, that a cell has to come to
STRAIN_LIMIT, TENSION_LIMIT = 0.98, 0.9
UNITS = {
    "displacement": "um",
    "crimp_angle": "rad",
    "width": "um",
    "thickness": "um",
    "areal_density": "g/m2",
    "hydraulic_radius": "um",
    "largest_circle": "um",
    "crossing_force": "nN",
    "crossing_area": "um2",
    "crossing_pressure": "kPa",
    "crossing_place": "um",
    "turning_couple": "N/m",
    "contact_force": "nN",
}


def _units(name: str) -> str:
    return next((unit for start, unit in UNITS.items() if name.startswith(start)), "1")


def upright(system: FilamentSystem, frames: Frames) -> Frames:
    """Frames of a weave that is loaded in its plane in the box as built, its strain and shear taken back; others as
    they are.

    Which filament lies above which stays, lengths do not.
    """
    if frames.box is None:
        return frames
    low, size = frames.box[:, None, :, 0], np.ptp(frames.box, axis=2)[:, None]
    away = frames.positions - low
    away[..., 0] -= away[..., 1] * (frames.tilt / size[:, 0, 1])[:, None]
    back = system.box[:, 0] + away / size * np.ptp(system.box, axis=1)
    return Frames(frames.step, frames.displacement_um, back)


def plane_guard(woven: Woven, curve: Curve) -> Guard:
    """Whether strain, shear and tension came to what the scene asks for by the end of the run: the least share."""
    name, cell = "loading in the plane", curve.cell
    shares = [
        (float(cell[f"cell_{axis}_um"][-1]) / size - 1) / strain
        for axis, size, strain in zip("xy", woven.size, woven.strain, strict=True)
        if strain
    ]
    shares += [float(cell["shear_rad"][-1]) / woven.shear] if woven.shear else []
    pulls = [
        (float(cell[f"tension_{tow}_N"][-1]) * 1e9 * n / pull, TENSION_LIMIT)
        for tow, n, pull in zip(("warp", "weft"), woven.tows, woven.tension, strict=True)
        if pull
    ]
    value, limit = min([*((share, STRAIN_LIMIT) for share in shares), *pulls], default=(1.0, STRAIN_LIMIT))
    message = (
        f"{name}: {value:.1%} of what was asked for when the run ended (limit {limit:.0%}); a shorter cell.over, or a "
        "slower platen, brings it further"
    )
    return Guard(name, value >= limit, value, limit, message)


def passing_guard(system: FilamentSystem, plan: Plan, frames: Frames) -> Guard:
    """Whether a filament passed through another; of tows that are ribbons of chains, between tows alone."""
    fabric = fabric_of(system)
    if plan.woven is None or plan.woven.resolve == "filament":
        return through_each_other(fabric, frames)
    name, n = "tows through each other", system.n_filaments
    orders = [filament_crossings(fabric, positions).order(n, n) for positions in frames.positions]
    passed = int(np.sum(np.any([o != orders[0] for o in orders[1:]], axis=0))) if len(orders) > 1 else 0
    crossing = int(np.sum(orders[0] != 0))
    message = f"{name}: {passed or 'no'} pairs of chains ({crossing} that cross, followed)"
    return Guard(name, passed == 0, float(passed), 0.0, message)


def planes_of(fabric: Fabric, positions: FloatArray) -> tuple[float, float]:
    """x (um) of the planes in which a fabric is looked at: through a weft tow in its middle, half-way to the next; of a
    sheared one along their normal (:func:`plane_frame`).

    Where the middle lies between the chains of a ribbon, the plane goes through the nearest of them.
    """
    frame = plane_frame(fabric.system, 0)
    weft_lines = (x for x in tow_lines(fabric, positions) if x.axis == 1)
    lines = sorted((float(frame.of(x.points)[:, 0].mean()), x.tow) for x in weft_lines)
    weft = [x for x, _ in lines]
    k = (len(weft) - 1) // 2
    if k + 1 < len(weft):
        following = weft[k + 1]
    else:
        following = weft[0] + frame.normal if frame.normal > 0 else float(frame.of(positions)[:, 0].max())
    return _through(fabric, positions, lines[k][1], weft[k]), (weft[k] + following) / 2


def _through(fabric: Fabric, positions: FloatArray, tow: int, middle: float) -> float:
    """``middle``, or x of the filament of the weft ``tow`` nearest to it if none lies there, um."""
    members = fabric.members[tow]
    runs, frame = lines_of(fabric.system, positions), plane_frame(fabric.system, 0)
    off = np.array([float(frame.of(runs[i])[:, 0].mean()) for i in members]) - middle
    off -= frame.normal * np.round(off / frame.normal) if frame.normal > 0 else 0.0
    nearest = int(np.argmin(np.abs(off)))
    radius = float(fabric.system.diameter[members[nearest]]) / 2
    return middle if abs(off[nearest]) < radius else middle + float(off[nearest])


def _room(fabric: Fabric, positions: FloatArray, place: float, faces: FloatArray) -> Room:
    """Room for resin in the plane x = ``place`` um between the platens."""
    limits = np.array([plane_window(fabric.system, positions, 0, place), faces])
    size = limits[:, 1] - limits[:, 0]
    pixel = max(float(fabric.system.diameter.min()) / PIXELS, float(np.sqrt(size[0] * size[1] / MOST_PIXELS)))
    return room_between(tow_image(fabric, positions, (0, place), limits, pixel), pixel)


def _open_area(fabric: Fabric, positions: FloatArray) -> float:
    extent = np.ptp(fabric.system.upright(positions[:, :2]), axis=0)
    pixel = max(float(fabric.system.diameter.min()) / PIXELS, float(np.sqrt(extent[0] * extent[1] / MOST_PIXELS)))
    return open_area(fabric, positions, pixel)


def fabric_statistics(
    system: FilamentSystem,
    frames: Frames,
    faces: FloatArray,
    law: LineLaw,
    modulus: float | None,
    both_sides: bool = False,
    friction: Callable[[FloatArray], FloatArray] | None = None,
) -> dict[str, tuple[np.ndarray, str]]:
    """Crimp, widths and thicknesses of tows, forces at crossings, room for resin: name -> (one row a frame, units).

    ``faces`` (n_frames, 2) um, z of the bottom and top platen; ``modulus``, ``both_sides`` as for :func:`touches`.
    Names end on warp or weft, and on crossing (at the tows' crossings; of the room: in a plane through a weft tow) or
    between. ``crossing_force`` and ``crossing_area`` (n_frames, n_crossings), ``crossing_place`` (n_frames,
    n_crossings, 3): by warp tow, then weft tow. ``turning_couple`` of tows that are chains, with ``friction`` (n,) of
    angles (n,) rad: what their turning on each other (:func:`turning_friction`) puts against a change of the weft's
    angle beyond the couple of the record, over the area.
    """
    fabric = fabric_of(system)
    rows: list[dict[str, Any]] = []
    for k, (positions, face) in enumerate(zip(frames.positions, faces, strict=True)):
        if not np.all(np.isfinite(positions)):
            break
        fabric = replace(fabric, system=frames.system_at(system, k))
        planes = planes_of(fabric, system.positions if frames.box is None else positions)
        lines = tow_lines(fabric, positions)
        crossings = tow_crossings(fabric, lines)
        row = _tow_row(fabric, lines, crossings, face)
        area = _area(fabric, system)
        row["areal_density"] = areal_density(fabric, positions, area)
        for place, where in zip(planes, ("crossing", "between"), strict=True):
            room = _room(fabric, positions, place, face)
            row |= {
                f"void_fraction_{where}": room.fraction,
                f"hydraulic_radius_{where}": room.hydraulic_radius,
                f"largest_circle_{where}": room.largest,
            }
        row["open_area"] = _open_area(fabric, positions)
        touch = touches(fabric, positions, law, modulus, both_sides=both_sides)
        loads = crossing_loads(fabric, crossings, touch)
        if rows and len(loads.through) != len(rows[0]["crossing_force"]):
            break  # tows have come off each other: their guard says so
        row |= {
            "crossing_force": loads.through,
            "crossing_area": loads.area,
            "crossing_place": loads.place,
            "crossing_force_mean": float(np.mean(loads.through)),
            "crossing_force_largest": float(np.max(loads.through)),
            "crossing_area_mean": float(np.mean(loads.area)),
            "crossing_pressure_mean": float(np.mean(loads.pressure)),
            "contact_count": len(touch.force),
            "contact_force_mean": float(np.mean(touch.force)) if len(touch.force) else 0.0,
            "contact_force_largest": float(np.max(touch.force, initial=0.0)),
        }
        if friction is not None and np.all(fabric.single):
            row["turning_couple"] = _turning(lines, loads, friction) / area * 1e-3  # of nN/um
        rows.append(row)
    if not rows:
        return {}
    values = {name: (np.array([row[name] for row in rows]), _units(name)) for name in rows[0]}
    values["displacement"] = (frames.displacement_um[: len(rows)], "um")
    return values


def _turning(lines: list[TowLine], loads: CrossingLoads, friction: Callable[[FloatArray], FloatArray]) -> float:
    """Couple at which all tows turn on each other at their crossings, nN um."""
    runs = np.array([line.run / np.linalg.norm(line.run) for line in lines])  # by tow
    cosine = np.abs(np.sum(runs[loads.warp] * runs[loads.weft], axis=1))
    angle = np.arccos(np.minimum(cosine, 1.0 - 1e-6))
    return float(np.sum(turning_friction(loads.normal, loads.area, angle, friction(angle))))


def _area(fabric: Fabric, built: FilamentSystem) -> float:
    """Area of the cell, or of the patch (as ``built``, strained and sheared as its box was since), um2."""
    period, grown = period_of(fabric.system)[:2], np.ptp(fabric.system.box, axis=1) / np.ptp(built.box, axis=1)
    size = np.where(period > 0, period, np.ptp(built.positions[:, :2], axis=0) * grown[:2])
    return float(size[0] * size[1])


def _tow_row(fabric: Fabric, lines: list[TowLine], crossings: Crossings, face: FloatArray) -> dict[str, Any]:
    sections = tow_sections(fabric, lines, crossings, (float(face[0]), float(face[1])))
    row: dict[str, Any] = {}
    for axis, tow in enumerate(("warp", "weft")):
        mine = [line for line in lines if line.axis == axis]
        row[f"crimp_{tow}"] = float(np.mean([line.crimp() for line in mine]))
        angles = np.array([line.angles() for line in mine])
        row[f"crimp_angle_{tow}"] = float(np.mean(angles[:, 1]))
        row[f"crimp_angle_largest_{tow}"] = float(np.max(angles[:, 0]))
        for of in ("width", "thickness"):
            for at, where in ((True, "crossing"), (False, "between")):
                row[f"{of}_{tow}_{where}"] = sections.mean(of, fabric.axis, axis, at)
        if not np.any(fabric.single):
            for at, where in ((True, "crossing"), (False, "between")):
                row[f"tow_fraction_{tow}_{where}"] = sections.mean("fraction", fabric.axis, axis, at)
    return row


def fabric_summary(statistics: Mapping[str, tuple[np.ndarray, str]]) -> dict[str, dict[str, float]]:
    """The statistics of a frame in single numbers, as built and at the largest displacement, names with their units."""
    if not statistics:
        return {}
    peak = int(np.argmax(statistics["displacement"][0]))
    out: dict[str, dict[str, float]] = {"as_built": {}, "at_largest_displacement": {}}
    for name, (values, units) in statistics.items():
        if values.ndim == 1:
            full = name if units == "1" else f"{name}_{units.replace('/', '_per_')}"
            for where, k in (("as_built", 0), ("at_largest_displacement", peak)):
                out[where][full] = float(values[k])
    return out
