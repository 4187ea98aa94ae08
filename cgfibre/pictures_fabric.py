"""The pictures of a fabric that a run leaves: in 3D, sections, crimp and sizes of tows, forces at crossings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cgfibre import plot_fabric, plot_weave
from cgfibre.build.system import FilamentSystem, FloatArray
from cgfibre.engine.assemble import platen_heights
from cgfibre.measure.crossing_forces import crossing_loads, touches
from cgfibre.measure.crossings import tow_crossings
from cgfibre.measure.fabric import Fabric, fabric_of, tow_lines
from cgfibre.measure.fabric_section import cut_fabric
from cgfibre.measure.segments import period_of
from cgfibre.plan.model import Plan
from cgfibre.record import Curve, Frames
from cgfibre.review import hertz_modulus, line_law
from cgfibre.review_fabric import planes_of

Statistics = Mapping[str, tuple[np.ndarray, str]]


def draw_fabric(
    out: Path,
    plan: Plan,
    system: FilamentSystem,
    curve: Curve,
    frames: Frames,
    statistics: Statistics,
    shown: Sequence[tuple[int, str]],
) -> list[Path]:
    """Write weave.png, sections.png, crimp.png and crossings.png; of ``shown`` (frame, title), as built first, what was
    built and the deepest.

    ``statistics`` of every frame, as :func:`cgfibre.review_fabric.fabric_statistics` gives them.
    """
    fabric = fabric_of(system)
    peak = max(shown, key=lambda s: frames.displacement_um[s[0]])
    chosen = [shown[0], peak] if peak != shown[0] else [shown[0]]
    made = []
    states = {title: frames.system_at(system, k) for k, title in chosen}
    figures = {
        "weave.png": plot_weave.figure_weave(states),
        "sections.png": _sections(plan, fabric, frames, chosen),
    }
    if len(next(iter(statistics.values()), ((), ""))[0]) == len(frames):
        figures["crimp.png"] = plot_fabric.figure_crimp(crimp_history(curve, frames, statistics))
        figures["crossings.png"] = _crossings(plan, fabric, curve, frames, statistics, peak[0])
    for name, figure in figures.items():
        figure.savefig(out / name)
        made.append(out / name)
    return made


def _faces(plan: Plan, fabric: Fabric, frames: Frames, k: int) -> tuple[float, float]:
    top, bottom = platen_heights(fabric.system, plan)
    return bottom, top - float(frames.displacement_um[k])


def _sections(plan: Plan, fabric: Fabric, frames: Frames, shown: Sequence[tuple[int, str]]) -> plot_fabric.Figure:
    views = []
    for side, where in enumerate(("through a weft tow", "half-way to the next weft tow")):
        for k, title in shown:
            now = replace(fabric, system=frames.system_at(fabric.system, k))
            place = planes_of(now, frames.positions[0 if frames.box is None else k])[side]
            bottom, top = _faces(plan, fabric, frames, k)
            cut = cut_fabric(now, frames.positions[k], 0, place)
            if frames.tilt.any():  # planes that turn with the weft are shown from their edges on
                cut = cut.from_edge(0.0)
            views.append(plot_fabric.CutView(cut, fabric.axis, bottom, top, f"{where}, {title}"))
    return plot_fabric.figure_cuts(views, "along the weft" if frames.tilt.any() else "")


def _pressures(curve: Curve, frames: Frames) -> FloatArray:
    return np.asarray(np.interp(frames.step, curve["step"], curve["pressure_MPa"]))


def _turn(frames: Frames) -> int | None:
    peak = int(np.argmax(frames.displacement_um))
    return peak if peak < len(frames) - 1 else None


def crimp_history(curve: Curve, frames: Frames, statistics: Statistics) -> plot_fabric.CrimpHistory:
    """Crimp and sizes of tows against pressure, of a fabric's ``statistics`` ({name: (a value a frame, unit)})."""

    def pair(name: str, place: str = "") -> tuple[FloatArray, FloatArray]:
        warp, weft = (statistics[f"{name}_{tow}{place}"][0] for tow in ("warp", "weft"))
        return warp, weft

    return plot_fabric.CrimpHistory(
        pressure=_pressures(curve, frames),
        crimp=pair("crimp"),
        angle=pair("crimp_angle"),
        width=pair("width", "_crossing"),
        width_between=pair("width", "_between"),
        thickness=pair("thickness", "_crossing"),
        thickness_between=pair("thickness", "_between"),
        turn=_turn(frames),
    )


def _crossings(
    plan: Plan, fabric: Fabric, curve: Curve, frames: Frames, statistics: Statistics, peak: int
) -> plot_fabric.Figure:
    system, positions = frames.system_at(fabric.system, peak), frames.positions[peak]
    fabric = replace(fabric, system=system)
    lines = tow_lines(fabric, positions)
    law, sides = line_law(plan, system), plan.contact.both_sides
    touch = touches(fabric, positions, law, hertz_modulus(plan), both_sides=sides)
    loads = crossing_loads(fabric, tow_crossings(fabric, lines), touch)
    period = period_of(system)[:2]
    corner = np.where(period > 0, system.box[:2, 0], positions[:, :2].min(axis=0))
    straight = system.upright(positions[:, :2] - corner) + corner
    low = np.where(period > 0, system.box[:2, 0], straight.min(axis=0))
    high = np.where(period > 0, system.box[:2, 1], straight.max(axis=0))
    tilt = system.tilt * float((high[1] - low[1]) / np.ptp(system.box[1]))
    width = np.array([float(statistics[f"width_{('warp', 'weft')[a]}_crossing"][0][peak]) for a in fabric.axis])
    size, plan_of = np.stack([low, high], 1), [line.points for line in lines]
    view = plot_fabric.CrossingMap(loads, plan_of, width, fabric.axis, size, tilt)
    through = statistics["crossing_force"][0].sum(axis=1) * 1e-9
    top = np.interp(frames.step, curve["step"], curve["force_top_N"])
    balance = plot_fabric.Balance(_pressures(curve, frames), top, through)
    return plot_fabric.figure_crossings(view, balance)
