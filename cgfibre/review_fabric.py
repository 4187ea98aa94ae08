"""What a finished run of a weave is judged and measured by, beside what holds for every run: guards and statistics."""

from __future__ import annotations

from typing import Any

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.measure.crossing_forces import crossing_loads, touches
from cgfibre.measure.crossings import filament_crossings, through_each_other, tow_crossings
from cgfibre.measure.fabric import fabric_of, tow_lines
from cgfibre.measure.fabric_section import tow_sections
from cgfibre.measure.guards import Guard
from cgfibre.measure.segments import LineLaw
from cgfibre.plan.model import Plan
from cgfibre.record import Frames

UNITS = {
    "displacement": "um",
    "crimp_angle_warp": "rad",
    "crimp_angle_weft": "rad",
    "crossing_force_mean": "nN",
    "crossing_force_largest": "nN",
    "crossing_area_mean": "um2",
    "contact_force_mean": "nN",
    "contact_force_largest": "nN",
    **{
        f"{of}_{tow}_{where}": "um"
        for of in ("width", "thickness")
        for tow in ("warp", "weft")
        for where in ("crossing", "between")
    },
}


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


def fabric_statistics(
    system: FilamentSystem, frames: Frames, faces: FloatArray, law: LineLaw, modulus: float | None
) -> dict[str, tuple[np.ndarray, str]]:
    """Crimp, widths and thicknesses of tows, forces at crossings: name -> (one value a frame, units).

    ``faces`` (n_frames, 2) um, z of the bottom and top platen; ``modulus`` as for :func:`touches`.
    """
    fabric = fabric_of(system)
    rows: list[dict[str, Any]] = []
    for positions, (bottom, top) in zip(frames.positions, faces, strict=True):
        if not np.all(np.isfinite(positions)):
            break
        lines = tow_lines(fabric, positions)
        crossings = tow_crossings(fabric, lines)
        sections = tow_sections(fabric, lines, crossings, (float(bottom), float(top)))
        row: dict[str, Any] = {}
        for axis, tow in enumerate(("warp", "weft")):
            mine = [line for line in lines if line.axis == axis]
            row[f"crimp_{tow}"] = float(np.mean([line.crimp() for line in mine]))
            row[f"crimp_angle_{tow}"] = float(np.mean([line.angles()[1] for line in mine]))
            for of in ("width", "thickness"):
                for at, where in ((True, "crossing"), (False, "between")):
                    row[f"{of}_{tow}_{where}"] = sections.mean(of, fabric.axis, axis, at)
        touch = touches(fabric, positions, law, modulus)
        loads = crossing_loads(fabric, crossings, touch)
        row |= {
            "crossing_force_mean": float(np.mean(loads.through)),
            "crossing_force_largest": float(np.max(loads.through)),
            "crossing_area_mean": float(np.mean(loads.area)),
            "contact_count": len(touch.force),
            "contact_force_mean": float(np.mean(touch.force)) if len(touch.force) else 0.0,
            "contact_force_largest": float(np.max(touch.force, initial=0.0)),
        }
        rows.append(row)
    if not rows:
        return {}
    values = {name: (np.array([row[name] for row in rows]), UNITS.get(name, "1")) for name in rows[0]}
    values["displacement"] = (frames.displacement_um[: len(rows)], "um")
    return values
