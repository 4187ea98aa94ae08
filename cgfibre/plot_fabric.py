"""Figures of what is measured on fabrics: sections, crimp and sizes of tows against pressure, maps of crossings.

``plot_*`` draw on an axes and return it, ``figure_*`` lay out a whole figure, as in :mod:`cgfibre.plot`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cgfibre.build.system import FloatArray, IntArray
from cgfibre.errors import InputError
from cgfibre.measure.crossing_forces import CrossingLoads
from cgfibre.measure.fabric_section import Cut
from cgfibre.plot import BLUE, GREEN, GREY, INK, VERMILION, Colours, new_figure, style

if TYPE_CHECKING:
    from cgfibre.plot import Axes, Figure

WARP, WEFT = BLUE, VERMILION
#: crossings of a map that are named at most
NAMED = 16
#: names and colours of the two directions, and dashes and marks that part them without colour
DIRECTIONS = (("warp", WARP, "-", "o"), ("weft", WEFT, "--", "s"))


def tow_colours(axis: IntArray) -> FloatArray:
    """(n_tows, 3) blue for warp and vermilion for weft, neighbours in slightly different tones; ``axis`` 0 or 1."""
    from matplotlib.colors import to_rgb

    base = np.array([to_rgb(WARP), to_rgb(WEFT)])[np.asarray(axis)]
    lift = np.modf(np.arange(len(base)) * 0.618)[0][:, None] * 0.34
    return np.asarray(base * (1 - lift) + lift)


@dataclass(frozen=True)
class CutView:
    """A section to draw: ``cut``, ``axis`` (n_tows,) of the tows, the platens' faces (z um, or None), a title."""

    cut: Cut
    axis: IntArray
    z_bottom: float | None = None
    z_top: float | None = None
    title: str = ""


def plot_cut(ax: Axes, view: CutView) -> Axes:
    """Cut filaments at true scale: ellipses of those cut across, strips of those that lie in the plane.

    Platens are hatched bars. Limits that were set before are kept, so that several sections can share them.
    """
    from matplotlib.collections import EllipseCollection, PolyCollection
    from matplotlib.patches import Rectangle

    cut, colours = view.cut, tow_colours(view.axis)
    low, high = _limits([view])
    if ax.get_autoscalex_on():
        ax.set_xlim(low[0], high[0])
        ax.set_ylim(low[1], high[1])
    (x0, x1), (y0, y1) = ax.get_xlim(), ax.get_ylim()
    edge: dict[str, Any] = {"edgecolors": "white", "linewidths": 0.35}
    with style():
        if cut.bands:
            strips = PolyCollection(
                [band.polygon() for band in cut.bands],
                facecolors=colours[[band.tow for band in cut.bands]],
                zorder=2,
                **edge,
            )
            ax.add_collection(strips)
        if len(cut.ellipses):
            e = cut.ellipses
            discs = EllipseCollection(
                2 * e.major,
                2 * e.minor,
                np.degrees(e.tilt),
                units="xy",
                offsets=e.centres,
                offset_transform=ax.transData,
                facecolors=colours[e.tow],
                zorder=3,
                **edge,
            )
            ax.add_collection(discs)
        for z, above in ((view.z_bottom, False), (view.z_top, True)):
            if z is not None:
                bar = (x0, z) if above else (x0, y0)
                tall = max(y1 - z, 0.0) if above else max(z - y0, 0.0)
                box = Rectangle(bar, x1 - x0, tall, facecolor="#DDE1E6", edgecolor=GREY, hatch="///", lw=0.6, zorder=4)
                ax.add_patch(box)
        ax.set_aspect("equal")
        ax.grid(False)
        if view.title:
            ax.set_title(view.title, loc="left")
    return ax


def _limits(views: Sequence[CutView]) -> tuple[FloatArray, FloatArray]:
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for v in views:
        low[0], high[0] = min(low[0], v.cut.window[0]), max(high[0], v.cut.window[1])
        heights = [z for z in (v.z_bottom, v.z_top) if z is not None]
        if len(v.cut.ellipses):
            z, r = v.cut.ellipses.centres[:, 1], v.cut.ellipses.major
            heights += [float((z - r).min()), float((z + r).max())]
        for band in v.cut.bands:
            heights += [float((band.line[:, 1] + s * band.half_width).min()) for s in (-1, 1)]
            heights += [float((band.line[:, 1] + s * band.half_width).max()) for s in (-1, 1)]
        if heights:
            low[1], high[1] = min(low[1], *heights), max(high[1], *heights)
    if not np.all(np.isfinite([low, high])):
        raise InputError("views", len(views), "a section that cuts a filament or stands between platens")
    pad = max(0.12 * (high[1] - low[1]), 0.008 * (high[0] - low[0]))
    return low - np.array([0.0, pad]), high + np.array([0.0, pad])


def figure_cuts(views: Sequence[CutView], across: str = "") -> Figure:
    """Sections below each other on the same scale; warp blue, weft vermilion. ``across``: what the planes run along,
    if not y or x."""
    if not views:
        raise InputError("views", 0, "at least one section")
    low, high = _limits(views)
    wide = 9.0
    tall = (high[1] - low[1]) / (high[0] - low[0]) * (wide - 1.0)
    mm = high[0] - low[0] > 3000
    fig = new_figure(wide, float(np.clip(len(views) * (tall + 0.42) + 0.75, 2.4, 14.0)))
    with style():
        axes = fig.subplots(len(views), 1, squeeze=False, sharex=True)[:, 0]
        for ax, view in zip(axes, views, strict=True):
            ax.set_xlim(low[0], high[0])
            ax.set_ylim(low[1], high[1])
            plot_cut(ax, view)
            if mm:
                ax.xaxis.set_major_formatter(lambda x, _: f"{x / 1000:g}")
                ax.yaxis.set_major_formatter(lambda x, _: f"{x / 1000:g}")
            ax.set_ylabel("z (mm)" if mm else "z (µm)")
            ax.locator_params(axis="y", nbins=3)
        names = {v.cut.axis for v in views}
        across = across or ("y" if names == {0} else "x" if names == {1} else "y or x")
        axes[-1].set_xlabel(f"{across} ({'mm' if mm else 'µm'})")
        _direction_legend(axes[0])
    return fig


def _direction_legend(ax: Axes) -> None:
    from matplotlib.patches import Patch

    handles = [Patch(facecolor=colour, label=name) for name, colour, _, _ in DIRECTIONS]
    ax.legend(handles=handles, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.1)


def plot_by_pressure(
    ax: Axes, pressure: FloatArray, values: Mapping[str, FloatArray], label: str, turn: int | None = None
) -> Axes:
    """``values`` of warp and weft against pressure, MPa; keys "warp", "weft", or "warp, between" and the like.

    A key's first word gives colour, dash and mark; "between" is drawn pale and hollow. ``turn``: index at which
    unloading begins, drawn thin from there on.
    """
    shown = {name: (colour, dash, mark) for name, colour, dash, mark in DIRECTIONS}
    stop = len(pressure) if turn is None else turn + 1
    with style():
        for name, series in values.items():
            direction, _, place = name.partition(", ")
            colour, dash, mark = shown[direction]
            pale = place == "between"
            look: dict[str, Any] = {"color": colour, "ls": dash, "alpha": 0.55 if pale else 1.0}
            ax.plot(
                pressure[:stop], series[:stop], marker=mark, ms=4, mfc="white" if pale else colour, label=name, **look
            )
            if stop < len(pressure):
                ax.plot(pressure[stop - 1 :], series[stop - 1 :], lw=1.0, **look)
        ax.set_xlabel("pressure (MPa)")
        ax.set_ylabel(label)
        ax.set_xlim(left=0)
        ax.legend(loc="best", fontsize=8.5)
    return ax


@dataclass(frozen=True)
class CrimpHistory:
    """What :func:`figure_crimp` shows, one value a frame: pressure MPa; crimp, angle (rad), width and thickness (um) at
    crossings and between, each (warp, weft); ``turn``: frame at which unloading begins, or None."""

    pressure: FloatArray
    crimp: tuple[FloatArray, FloatArray]
    angle: tuple[FloatArray, FloatArray]
    width: tuple[FloatArray, FloatArray]
    width_between: tuple[FloatArray, FloatArray]
    thickness: tuple[FloatArray, FloatArray]
    thickness_between: tuple[FloatArray, FloatArray]
    turn: int | None = None


def figure_crimp(history: CrimpHistory, title: str = "") -> Figure:
    """Crimp, crimp angle, tow width and tow thickness against pressure."""
    h = history
    mm = max(float(np.nanmax(np.asarray(part))) for part in (h.width, h.thickness)) > 2000
    scale, unit = (1e-3, "mm") if mm else (1.0, "µm")
    fig = new_figure(9.0, 6.4)
    with style():
        axes = fig.subplots(2, 2)
        plain = (
            (axes[0, 0], [100 * c for c in h.crimp], "crimp (%)"),
            (axes[0, 1], [np.degrees(a) for a in h.angle], "crimp angle at inflection (°)"),
        )
        for ax, pair, label in plain:
            plot_by_pressure(ax, h.pressure, dict(zip(("warp", "weft"), pair, strict=True)), label, h.turn)
        for ax, at, between, label in (
            (axes[1, 0], h.width, h.width_between, "tow width"),
            (axes[1, 1], h.thickness, h.thickness_between, "tow thickness"),
        ):
            series = {}
            for k, name in enumerate(("warp", "weft")):
                series[f"{name}, at crossings"] = at[k] * scale
                series[f"{name}, between"] = between[k] * scale
            plot_by_pressure(ax, h.pressure, series, f"{label} ({unit})", h.turn)
        if title:
            fig.suptitle(title)
    return fig


@dataclass(frozen=True)
class CrossingMap:
    """What :func:`plot_crossings` shows: forces at crossings, and the ``lines`` (n, 3) um of the tows with their
    ``width`` um and ``axis``; ``size`` (2, 2) um: low and high of x and of y; ``tilt`` um by which the upper edge of a
    sheared fabric lies over the lower one."""

    loads: CrossingLoads
    lines: Sequence[FloatArray]
    width: FloatArray
    axis: IntArray
    size: FloatArray
    tilt: float = 0.0


def plot_crossings(ax: Axes, view: CrossingMap) -> Axes:
    """Plan of the fabric, with the force that each crossing carries through the thickness as the colour of a disc.

    The tow above is drawn above, and named where there are few crossings (warp runs along x).
    """
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Circle, Polygon

    force = view.loads.through * 1e-9
    largest = float(np.max(np.abs(force), initial=0.0))
    units = ((1.0, "N"), (1e3, "mN"), (1e6, "µN"), (1e9, "nN"))
    factor, unit = next((f, u) for f, u in units if largest * f >= 0.1 or u == "nN")
    mm = float(np.max(view.size[:, 1] - view.size[:, 0])) > 3000
    scale = 1e-3 if mm else 1.0
    colours = Colours.spanning(f"force at the crossing ({unit})", np.append(force * factor, 0.0))
    with style():
        tints = tow_colours(view.axis) * 0.45 + 0.55
        for tow, line in enumerate(view.lines):
            way = np.gradient(line[:, :2], axis=0)
            way /= np.linalg.norm(way, axis=1)[:, None]
            side = np.stack([-way[:, 1], way[:, 0]], axis=1) * view.width[tow] / 2
            outline = np.concatenate([line[:, :2] + side, (line[:, :2] - side)[::-1]]) * scale
            above = 1 + 0.1 * view.axis[tow]
            ax.add_patch(Polygon(outline, facecolor=tints[tow], edgecolor="white", lw=0.8, zorder=above))
        low, high = view.size[:, 0], view.size[:, 1]
        # in the cell, sheared or not; the directions of warp and weft, and how much wider one cuts the other
        slope = view.tilt / float(high[1] - low[1])
        places = view.loads.place[:, :2] - low
        places[:, 0] -= slope * places[:, 1]
        places = np.mod(places, high - low)
        places[:, 0] += slope * places[:, 1]
        places += low
        wider = float(np.hypot(1.0, slope))
        along = np.array([[1.0, 0.0], [slope / wider, 1.0 / wider]])
        for k in np.flatnonzero(view.loads.warp_above).tolist():
            # weft was drawn last: the warp once more where it lies above
            warp, weft = view.loads.warp[k], view.loads.weft[k]
            half = np.array([1.1 * view.width[weft], view.width[warp]]) * wider * scale / 2
            corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
            patch = places[k] * scale + corners @ along
            ax.add_patch(Polygon(patch, facecolor=tints[warp], lw=0, zorder=2))
        radius = 0.32 * float(np.min(view.width)) * scale
        discs = [Circle((p[0] * scale, p[1] * scale), radius) for p in places]
        shown = PatchCollection(discs, cmap=colours.cmap, edgecolor=INK, lw=0.8, zorder=3)
        shown.set_array(force * factor)
        shown.set_clim(colours.low, colours.high)
        ax.add_collection(shown)
        named = places * scale if len(places) <= NAMED else places[:0]
        for p, is_warp in zip(named, view.loads.warp_above[: len(named)], strict=True):
            ax.annotate(
                "warp above" if is_warp else "weft above",
                (p[0], p[1] - radius),
                (0, -2),
                textcoords="offset points",
                ha="center",
                va="top",
                fontsize=7,
                zorder=4,
            )
        ax.set_xlim((low[0] + min(view.tilt, 0.0)) * scale, (high[0] + max(view.tilt, 0.0)) * scale)
        ax.set_ylim(low[1] * scale, high[1] * scale)
        ax.set_aspect("equal")
        ax.grid(False)
        ax.set_xlabel(f"x, along the warp ({'mm' if mm else 'µm'})")
        ax.set_ylabel(f"y{'' if view.tilt else ', along the weft'} ({'mm' if mm else 'µm'})")
        bar = ax.figure.colorbar(shown, ax=ax, shrink=0.85)
        bar.set_label(colours.label)
        bar.outline.set_visible(False)
    return ax


@dataclass(frozen=True)
class Balance:
    """Forces through the fabric against pressure, one value a frame: ``platen`` N, the sum over ``crossings`` N."""

    pressure: FloatArray
    platen: FloatArray
    crossings: FloatArray


def plot_balance(ax: Axes, balance: Balance) -> Axes:
    """Sum of the crossing forces over the platen's force: 1 where every crossing carries its load straight down."""
    with style():
        loaded = balance.platen > 0.02 * float(np.max(balance.platen, initial=0.0))
        ax.axhline(1.0, color=GREY, lw=1.0)
        ratio = balance.crossings[loaded] / balance.platen[loaded]
        ax.plot(balance.pressure[loaded], ratio, color=GREEN, marker="o", ms=4)
        ax.set_xlabel("pressure (MPa)")
        ax.set_ylabel("force at crossings / platen force")
        ax.set_xlim(left=0)
        ax.set_ylim(bottom=0)
        ax.locator_params(axis="x", nbins=5)
    return ax


def figure_crossings(view: CrossingMap, balance: Balance) -> Figure:
    """The map of the crossing forces, and beside it their sum over the platen's force against pressure."""
    fig = new_figure(10.5, 4.4)
    with style():
        left, right = fig.subplots(1, 2, width_ratios=(1.25, 1.0))
        plot_crossings(left, view)
        plot_balance(right, balance)
    return fig
