"""The pictures a run leaves in its folder, drawn from arrays by :mod:`cgfibre.plot` and :mod:`cgfibre.plot_section`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cgfibre import plot, plot_bundle, plot_section
from cgfibre.build.system import FilamentSystem
from cgfibre.engine.assemble import crimp_cylinders, platen_heights
from cgfibre.measure import distribution
from cgfibre.pictures_fabric import draw_fabric
from cgfibre.plan.model import Plan
from cgfibre.record import Curve, Frames
from cgfibre.review import contacts_under_platen, mid_plane
from cgfibre.scene import Scene

#: every picture that a run may leave, in the order in which to look at them
PICTURES = (
    "curve.png",
    "pressure.png",
    "weave.png",
    "sections.png",
    "sections_middle.png",
    "bundle.png",
    "energy.png",
    "distribution.png",
    "crimp.png",
    "crossings.png",
)


def frames_to_show(frames: Frames) -> list[tuple[int, str]]:
    """(frame, title) before, half-way, at the largest displacement and, if the platen went back, at the end."""
    d = frames.displacement_um
    peak = int(np.argmax(d))
    half = int(np.argmin(np.abs(d[: peak + 1] - d[peak] / 2)))
    shown = [(0, "as built"), (half, f"pressed by {d[half]:.3g} µm"), (peak, f"pressed by {d[peak]:.3g} µm")]
    if len(frames) - 1 > peak and d[-1] < d[peak]:
        shown.append((len(frames) - 1, f"unloaded to {d[-1]:.3g} µm"))
    return shown


def draw_all(
    out: Path,
    scene: Scene,
    plan: Plan,
    system: FilamentSystem,
    curve: Curve,
    frames: Frames,
    summary: dict[str, Any],
    statistics: Mapping[str, tuple[np.ndarray, str]] | None = None,
) -> list[Path]:
    """Write the pictures that fit the run (curve, pressure, energy, sections, distribution, bundle); their paths.

    ``statistics`` of a weave's frames are drawn too.
    """
    made = [_curve(out, scene, curve, summary), _pressure(out, scene, curve, summary), _energy(out, curve)]
    if len(frames) < 2 or not np.all(np.isfinite(frames.positions)):
        return made
    shown = frames_to_show(frames)
    if plan.woven is not None:
        return made + draw_fabric(out, plan, system, curve, frames, statistics or {}, shown)
    x, d = mid_plane(scene, plan), float(np.max(system.diameter))
    heights = platen_heights(system, plan)
    edge = plan.platens.top_span
    # between the edges of a finite anvil the filaments sag away from it: both places are worth seeing
    planes = (
        [(x, "", "sections.png")]
        if edge is None
        else [(edge[0], "at the anvil's edge", "sections.png"), (x, "at mid-span", "sections_middle.png")]
    )
    for plane, where, name in planes:
        made.append(_save(_sections(plan, system, frames, shown, plane, where, heights), out / name))
    peak = shown[2][0]
    if system.n_filaments >= 3:
        before = distribution.section_at(system, frames.positions[0], x)
        reference = distribution.normalisation(before, d)
        after = distribution.section_at(system, frames.positions[peak], x)
        after = after[np.isfinite(after).all(axis=1)]  # without those that slid out
        fits = [distribution.fit_distribution(c, reference) for c in (before, after) if len(c) >= 3]
        if len(fits) == 2:
            made.append(_save(plot_section.figure_distribution(*fits), out / "distribution.png"))
    if not plan.flat:
        made.append(_bundle(out, scene, plan, system, frames, peak, heights))
    return made


def _sections(
    plan: Plan,
    system: FilamentSystem,
    frames: Frames,
    shown: list[tuple[int, str]],
    plane: float,
    where: str,
    heights: tuple[float, float],
) -> Any:
    d = float(np.max(system.diameter))
    top, bottom = heights
    flat = plan.platens.shape != "crimped"
    sections = []
    for k, title in shown:
        centres = distribution.section_at(system, frames.positions[k], plane)
        centres = centres[np.isfinite(centres).all(axis=1)]
        local = distribution.local_volume_fraction(centres, d, reach=d) if len(centres) >= 3 else None
        shift = float(frames.displacement_um[k])
        faces = () if flat or plan.level != "section" else _curved_faces(plan, (top, bottom), shift, centres)
        lower = bottom if flat or (faces and not plan.platens.bottom_crimped) else None
        sections.append(plot_section.Section(centres, d, lower, top - shift if flat else None, local, title, faces))
    colours = plot.Colours.spanning("local fibre volume fraction", *(s.values for s in sections))
    figure = plot_section.figure_sections(sections, colours)
    if where:
        figure.suptitle(where)
    return figure


def _curved_faces(
    plan: Plan, heights: tuple[float, float], shift: float, centres: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Faces of platens that are curved across a section, over the filaments' width, top one first."""
    p = plan.platens
    axes = crimp_cylinders(plan, *heights)
    reach = min(float(np.max(np.abs(centres[:, 0] - p.crimp_centre))) + plan.pitch, 0.999 * p.crimp_radius)
    y = np.linspace(-reach, reach, 101)
    arc = np.sqrt(p.crimp_radius**2 - y**2) * (-1.0 if p.convex else 1.0)
    faces = [np.column_stack([y + p.crimp_centre, axes[0] - shift + arc])]
    if p.bottom_crimped:
        faces.append(np.column_stack([y + p.crimp_centre, axes[1] - arc]))
    return tuple(faces)


def _save(figure: Any, path: Path) -> Path:
    figure.savefig(path)
    return path


def _title(scene: Scene, summary: dict[str, Any]) -> str:
    error, certified = summary.get("speed_error"), _certified(summary)
    name = scene.name or "scene"
    if certified is not None:
        return f"{name}: force within {certified:.1%} (certificate, mean)"
    return name if error is None else f"{name}: force within {error:.1%} on halving the platen speed (mean)"


def _certified(summary: dict[str, Any]) -> float | None:
    """Relative error of the force that the certificate states."""
    return (summary.get("certificate") or {}).get("force_error_mean")


def _curve(out: Path, scene: Scene, curve: Curve, summary: dict[str, Any]) -> Path:
    ax = plot.new_axes()
    plot.plot_curve(ax, curve, plot.CurveView(speed_error=summary.get("speed_error"), certified=_certified(summary)))
    ax.set_title(_title(scene, summary))
    return _save(ax.figure, out / "curve.png")


def _pressure(out: Path, scene: Scene, curve: Curve, summary: dict[str, Any]) -> Path:
    ax = plot.new_axes()
    certificate, error = summary.get("certificate"), summary.get("speed_error")
    # the certificate's error is that of the thickness here
    view = plot.CurveView(x="thickness", y="pressure", log=True, speed_error=None if certificate else error)
    plot.plot_curve(ax, curve, view)
    if certificate:
        columns = (np.array(certificate[key], dtype=float) for key in ("thickness_um", "pressure_MPa", "error_um"))
        plot.plot_thickness_errors(ax, *columns)
    ax.set_title(_title(scene, summary))
    return _save(ax.figure, out / "pressure.png")


def _energy(out: Path, curve: Curve) -> Path:
    ax = plot.new_axes()
    plot.plot_energy(ax, curve)
    return _save(ax.figure, out / "energy.png")


def _bundle(
    out: Path, scene: Scene, plan: Plan, system: FilamentSystem, frames: Frames, k: int, heights: tuple[float, float]
) -> Path:
    span = plan.platens.top_span or (0.0, scene.bundle.length)
    lower = plan.platens.bottom_span or (0.0, scene.bundle.length)
    positions = frames.positions[k]
    low, high = positions[:, 1].min(), positions[:, 1].max()
    faces = (
        ()
        if plan.platens.shape == "crimped"
        else (
            plot_bundle.PlatenFace(heights[0] - float(frames.displacement_um[k]), True, span, (low, high)),
            plot_bundle.PlatenFace(heights[1], False, lower, (low, high)),
        )
    )
    force, colours = None, None
    if plan.contact.law != "hertz":
        contacts = contacts_under_platen(plan, system, positions, float(frames.factor[k]))
        force = contacts.force_per_filament(system.n_filaments) * 1e-6
        colours = plot.Colours.spanning("contact force on a filament (mN)", force)
    view = plot_bundle.BundleView(
        values=force, colours=colours, platens=faces, title=f"pressed by {frames.displacement_um[k]:.3g} µm"
    )
    return _save(plot_bundle.figure_bundle_3d(system, positions, view), out / "bundle.png")
