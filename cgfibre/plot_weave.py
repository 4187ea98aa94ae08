"""Figures of woven fabrics. As in :mod:`cgfibre.plot`: they compute nothing but layout and take what they draw."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from cgfibre.build.system import BoolArray, FilamentSystem, FloatArray
from cgfibre.errors import InputError
from cgfibre.measure.fabric import lines_of
from cgfibre.plot import BLUE, INK, VERMILION, new_figure, style
from cgfibre.plot_bundle import PIXEL_BUDGET, BundleView, Camera, Tubes, render_tubes

if TYPE_CHECKING:
    from cgfibre.plot import Axes, Figure

#: pixels along the picture's width
WIDE = 1600


@dataclass(frozen=True)
class TowView:
    """How :func:`draw_tows` looks at the tows.

    ``azimuth`` and ``elevation`` in degrees of the eye about z and above the x-y plane; ``colours`` of warp and weft;
    ``title``; ``scale`` whether a bar tells the length.
    """

    azimuth: float = -60.0
    elevation: float = 35.0
    colours: tuple[str, str] = (BLUE, VERMILION)
    title: str = ""
    scale: bool = True


def along_x(system: FilamentSystem) -> BoolArray:
    """(n_filaments,) whether a filament runs more along x (warp) than along y (weft), before its cell was sheared."""
    bonds, vector = system.bonds(), np.abs(system.upright(system.bond_vectors()))
    filament = system.filament_of_bead[bonds[:, 0]]
    run = [np.bincount(filament, vector[:, axis], system.n_filaments) for axis in (0, 1)]
    return np.asarray(run[0] >= run[1])


def draw_tows(
    ax: Axes, system: FilamentSystem, positions: FloatArray | None = None, view: TowView | None = None
) -> Axes:
    """Draw the chains as shaded tubes of their diameters in parallel projection, warp and weft in two colours.

    ``positions`` (n_beads, 3) um, or ``None``: as built. A closed chain is drawn on to its first bead's image. True to
    scale. Raises :class:`InputError` for sections and non-finite positions.
    """
    from matplotlib.colors import to_rgb

    view = view or TowView()
    positions = system.positions if positions is None else positions
    bonds = system.bonds()
    if not len(bonds):
        raise InputError("system", "one bead a filament", "filaments of two beads or more")
    if positions.shape != (system.n_beads, 3) or not np.all(np.isfinite(positions)):
        raise InputError("positions", positions.shape, f"shape ({system.n_beads}, 3), finite")
    camera = Camera.of(BundleView(azimuth=view.azimuth, elevation=view.elevation))
    vector = system.nearest(positions[bonds[:, 1]] - positions[bonds[:, 0]])
    start, d = camera(positions[bonds[:, 0]]), camera(vector)
    radius = 0.5 * system.diameter
    ends = np.concatenate([start, start + d])[:, :2]
    low, high = ends.min(axis=0) - 1.1 * radius.max(), ends.max(axis=0) + 1.1 * radius.max()
    pixel = float((high[0] - low[0]) / WIDE)
    run = float(np.linalg.norm(d[:, :2], axis=1).sum())
    while True:
        step = max(0.3 * float(radius.min()), pixel)
        if run / step * (2 * np.ceil(radius.max() / pixel) + 1) ** 2 <= 2 * PIXEL_BUDGET:
            break
        pixel *= 1.2
    n = np.maximum(1, np.ceil(np.linalg.norm(d, axis=1) / step)).astype(np.int64)
    bond = np.repeat(np.arange(len(bonds)), n)
    share = (np.arange(len(bond)) - np.repeat(np.cumsum(n) - n, n) + 0.5) / n[bond]
    filament = system.filament_of_bead[bonds[bond, 0]]
    tubes = Tubes(
        points=start[bond] + share[:, None] * d[bond],
        tangent=(d / np.linalg.norm(d, axis=1)[:, None])[bond],
        radius=radius[filament],
        bead=bonds[bond, 0],
        filament=filament,
    )
    base = np.where(along_x(system)[:, None], to_rgb(view.colours[0]), to_rgb(view.colours[1]))
    tone = 0.85 + 0.3 * np.modf(np.arange(system.n_filaments) * 0.618)[0]  # tells neighbours apart
    shape = (int(np.ceil((high[1] - low[1]) / pixel)), int(np.ceil((high[0] - low[0]) / pixel)))
    image = render_tubes(tubes, np.clip(base * tone[:, None], 0, 1)[filament], low, shape, pixel)
    extent = (low[0], low[0] + shape[1] * pixel, low[1], low[1] + shape[0] * pixel)
    ax.imshow(image, origin="lower", extent=extent, interpolation="antialiased", zorder=2)
    ax.set_aspect("equal")
    ax.set_axis_off()
    bottom = low[1]
    if view.scale:
        width = float(high[0] - low[0])
        nice = 10 ** np.floor(np.log10(width / 4))
        bar = nice * max(k for k in (1, 2, 5) if k == 1 or k * nice <= width / 4)
        y = low[1] - 0.02 * width
        ax.plot([low[0], low[0] + bar], [y, y], color=INK, lw=3, solid_capstyle="butt")
        words = f"{bar:g} µm" if bar < 1000 else f"{bar / 1000:g} mm"
        ax.annotate(words, (low[0] + bar, y), (4, 0), textcoords="offset points", ha="left", va="center")
        bottom = y - 0.03 * width
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(bottom, extent[3])
    if view.title:
        ax.set_title(view.title)
    return ax


def repeated(system: FilamentSystem, least: int = 4) -> FilamentSystem:
    """So many periodic cells beside each other, as open chains, that ``least`` tows stand in either direction.

    Raises :class:`InputError` as :func:`lines_of`.
    """
    lines = lines_of(system, system.positions)
    size = system.box[:, 1] - system.box[:, 0]
    warp = along_x(system)
    counts = [1, 1]
    for axis, across in ((0, ~warp), (1, warp)):
        if system.periodic[axis]:
            counts[axis] = max(1, -(-least // max(1, len(np.unique(system.tow[across])))))
    steps = [(i, j) for i in range(counts[0]) for j in range(counts[1])]
    shifts = [np.array([i * size[0] + j * system.tilt, j * size[1], 0.0]) for i, j in steps]
    points = np.concatenate([lines.points + shift for shift in shifts])
    starts = [lines.start[:-1] + k * len(lines.points) for k in range(len(shifts))]
    n, copies = system.n_filaments, len(shifts)
    return FilamentSystem(
        positions=points,
        filament_start=np.append(np.concatenate(starts), len(points)),
        closed=np.zeros(n * copies, dtype=bool),
        tow=np.concatenate([system.tow + k * (int(system.tow.max()) + 1) for k in range(copies)]),
        filament_type=np.tile(system.filament_type, copies),
        types=system.types,
        box=np.stack([points.min(axis=0), points.max(axis=0)], axis=1),
        periodic=np.zeros(3, dtype=bool),
        prestrain=np.zeros(n * copies),
        tilt=system.tilt / float(size[1]) * float(np.ptp(points[:, 1])),
    )


def figure_weave(states: Mapping[str, FilamentSystem], view: TowView | None = None) -> Figure:
    """The fabric in 3D, one picture a state, beside each other on the same scale; ``states`` title -> fabric.

    A periodic cell is shown several times (:func:`repeated`).
    """
    if not states:
        raise InputError("states", 0, "at least one state to draw")
    view = view or TowView()
    shown = {title: repeated(system) for title, system in states.items()}
    fig = new_figure(5.4 * len(shown), 4.3)
    with style():
        axes = fig.subplots(1, len(shown), squeeze=False)[0]
        limits = []
        for ax, (title, cells) in zip(axes, shown.items(), strict=True):
            draw_tows(ax, cells, view=replace(view, title=title))
            limits.append((*ax.get_xlim(), *ax.get_ylim()))
        low, high = np.min(limits, axis=0), np.max(limits, axis=0)
        for ax in axes:
            ax.set_xlim(low[0], high[1])
            ax.set_ylim(low[2], high[3])
        wide, tall = high[1] - low[0], high[3] - low[2]
        fig.set_size_inches(5.4 * len(shown), float(np.clip(5.4 * tall / wide + 0.4, 2.0, 8.0)))
    return fig
