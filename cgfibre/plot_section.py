"""Figures of a section: filaments as discs, maps of volume fraction, voids, and how filaments are distributed.

``plot_*`` draw on an axes and return it, ``figure_*`` lay out a whole figure, as in :mod:`cgfibre.plot`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from cgfibre.build.system import FloatArray, IntArray
from cgfibre.errors import InputError
from cgfibre.plot import BLUE, GREY, INK, STEEL, Colours, new_figure, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Section:
    """One section to draw: ``centres`` (n, 2) y and z um, ``diameter`` um (one or n), heights of the platens' faces,
    and optionally ``values`` (n,) for the colour and a ``title``. A face None: that platen is not there. ``faces`` are
    curved faces, (m, 2) points of y and z each."""

    centres: FloatArray
    diameter: float | FloatArray
    z_bottom: float | None = None
    z_top: float | None = None
    values: FloatArray | None = None
    title: str = ""
    faces: tuple[FloatArray, ...] = ()


def _section_limits(sections: Sequence[Section]) -> tuple[float, float, float, float]:
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for s in sections:
        r = np.broadcast_to(np.asarray(s.diameter, dtype=float) / 2, len(s.centres))[:, None]
        low = np.minimum(low, np.nanmin(s.centres - r, axis=0))
        high = np.maximum(high, np.nanmax(s.centres + r, axis=0))
        platens = [z for z in (s.z_bottom, s.z_top) if z is not None]
        platens += [float(z) for curved in s.faces for z in (curved[:, 1].min(), curved[:, 1].max())]
        low[1], high[1] = min([low[1], *platens]), max([high[1], *platens])
    pad = 0.05 * max(high - low)
    bar = min(0.07 * max(high - low), 0.3 * (high[1] - low[1]))
    return low[0] - pad, high[0] + pad, low[1] - bar, high[1] + bar


def plot_section(ax: Axes, section: Section, colours: Colours | None = None) -> Axes:
    """Filament discs at true scale between the platens, coloured by ``section.values`` on the scale ``colours``.

    Platens are hatched bars across the axes. Filaments with nan centres are not drawn. Limits that were set before by
    ``ax.set_xlim``/``set_ylim`` are kept, so that several sections can share them.
    """
    from matplotlib.collections import EllipseCollection
    from matplotlib.patches import Rectangle

    centres = np.asarray(section.centres, dtype=float)
    there = np.isfinite(centres).all(axis=1)
    if centres.ndim != 2 or centres.shape[1] != 2 or not there.any():
        raise InputError("section.centres", centres.shape, "shape (n, 2) with finite centres")
    with style():
        if ax.get_autoscalex_on():
            y0, y1, z0, z1 = _section_limits([section])
            ax.set_xlim(y0, y1)
            ax.set_ylim(z0, z1)
        diameter = np.broadcast_to(np.asarray(section.diameter, dtype=float), len(centres))[there]
        if section.values is None:
            face: Any = STEEL
        else:
            scale = (colours or Colours.spanning("", section.values)).mappable()
            face = scale.to_rgba(np.asarray(section.values, dtype=float)[there])
        discs = EllipseCollection(
            diameter,
            diameter,
            np.zeros(len(diameter)),
            units="xy",
            offsets=centres[there],
            offset_transform=ax.transData,
            facecolors=face,
            edgecolors="white" if len(diameter) > 1000 else INK,
            linewidths=0.0 if len(diameter) > 1000 else 0.5,
        )
        ax.add_collection(discs, autolim=False)
        (y0, y1), (z0, z1) = ax.get_xlim(), ax.get_ylim()
        deep = 2 * (z1 - z0)
        for z, base in ((section.z_bottom, -deep), (section.z_top, 0.0)):
            if z is not None:
                bar = (y0 - deep, z + base), y1 - y0 + 2 * deep, deep
                ax.add_patch(Rectangle(*bar, facecolor="#ECECEC", edgecolor="#A0A0A0", hatch="////", lw=0))
                ax.axhline(z, color=INK, lw=1.4)
        for curved in section.faces:
            ax.plot(*curved.T, color=INK, lw=1.8)
        ax.set_aspect("equal")
        ax.grid(False)
        ax.set_xlabel("y (µm)")
        ax.set_ylabel("z (µm)")
        if section.title:
            ax.set_title(section.title)
    return ax


def figure_sections(sections: Sequence[Section], colours: Colours | None = None) -> Figure:
    """Sections side by side (wide ones: one above the other) at one scale, with one colour bar; say before, during,
    after.

    The range of all values is used where ``colours`` is not given. Raises InputError without a section.
    """
    if not sections:
        raise InputError("sections", 0, "one section or more")
    values = [s.values for s in sections]
    coloured = any(v is not None for v in values)
    scale = colours or Colours.spanning("", *values)
    y0, y1, z0, z1 = _section_limits(sections)
    aspect, n = (y1 - y0) / (z1 - z0), len(sections)
    wide = aspect > 2.2 and n > 1
    panel_width = 8.6 if wide else max(2.6, min(4.0, 12.0 / n))
    panel_height = panel_width / aspect
    rows, columns = (n, 1) if wide else (1, n)
    fig = new_figure(columns * panel_width + (1.9 if coloured else 0.8), rows * (panel_height + 0.45) + 0.55)
    with style():
        axes = fig.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
        for ax, section in zip(axes, sections, strict=True):
            ax.set_xlim(y0, y1)
            ax.set_ylim(z0, z1)
            plot_section(ax, section, scale)
            ax.label_outer()
        if coloured:
            bar = fig.colorbar(scale.mappable(), ax=list(axes), shrink=0.9, pad=0.015, aspect=22)
            bar.set_label(scale.label, labelpad=7)
            bar.outline.set_visible(False)
    return fig


class GaussianCoordinates(Protocol):
    """What :func:`figure_distribution` draws (``measure.distribution.Distribution`` is one): ``coordinates`` (n, 2),
    normalised; ``mean`` and ``sd`` (2,)."""

    @property
    def coordinates(self) -> FloatArray: ...  # noqa: D102
    @property
    def mean(self) -> FloatArray: ...  # noqa: D102
    @property
    def sd(self) -> FloatArray: ...  # noqa: D102


def figure_distribution(before: GaussianCoordinates, after: GaussianCoordinates) -> Figure:
    """Histograms of the normalised y and z of the filaments before and after, with their Gaussian fits (thesis Fig
    7-19).

    Both states on the same bins; the legend gives mean and s.d. A coordinate without spread has no curve.
    """
    fig = new_figure(9.2, 3.9)
    with style():
        axes = fig.subplots(1, 2, sharey=True)
        for axis, (ax, name) in enumerate(zip(axes, ("y", "z"), strict=True)):
            both = np.concatenate([before.coordinates[:, axis], after.coordinates[:, axis]])
            reach = 1.05 * max(1.0, float(np.abs(both).max()))
            n_bins = int(np.clip(2 * np.cbrt(len(both) / 2), 9, 41))
            bins = np.linspace(-reach, reach, n_bins + (1 - n_bins % 2) + 1)
            x = np.linspace(-1.15 * reach, 1.15 * reach, 301)
            for state, colour, when in ((before, GREY, "before"), (after, BLUE, "after")):
                mean = round(float(state.mean[axis]), 2) + 0.0  # no minus zero
                text = f"{when}: mean {mean:.2f}, s.d. {state.sd[axis]:.2f}".replace("-", "−")
                data = state.coordinates[:, axis]
                ax.hist(data, bins, density=True, color=colour, alpha=0.35, lw=0, label=text)
                if state.sd[axis] > 0:
                    z = (x - state.mean[axis]) / state.sd[axis]
                    ax.plot(x, np.exp(-(z**2) / 2) / (state.sd[axis] * np.sqrt(2 * np.pi)), color=colour)
            ax.set_xlabel(f"Normalised {name} (1)")
            ax.legend(loc="upper left", handlelength=1.2)
        axes[0].set_ylim(0, 1.28 * axes[0].get_ylim()[1])
        axes[0].set_ylabel("Probability density (1)")
        axes[0].set_title("across the compaction", loc="left")
        axes[1].set_title("along the compaction", loc="left")
    return fig


@dataclass(frozen=True)
class VoidPicture:
    """Voids to draw: ``corners`` (n_triangles, 3) indices into the section's centres, the triangles between filaments
    that make up the voids, and ``values`` (n_triangles,) for their colour."""

    corners: IntArray
    values: FloatArray


def plot_voids(ax: Axes, section: Section, voids: VoidPicture, colours: Colours) -> Axes:
    """Voids in colour between the filaments of ``section``, whose own values are left aside; platens as there."""
    from matplotlib.collections import PolyCollection

    with style():
        plot_section(ax, replace(section, values=None))
        triangles = list(section.centres[voids.corners])
        face = colours.mappable().to_rgba(voids.values)
        # edges in the same colour close the seams between triangles
        ax.add_collection(
            PolyCollection(triangles, facecolors=face, edgecolors=face, linewidths=0.3, zorder=0.5), autolim=False
        )
    return ax


def plot_fraction_map(ax: Axes, y: FloatArray, z: FloatArray, fraction: FloatArray, colours: Colours) -> Axes:
    """Volume fraction (n_z, n_y) on a grid with edges ``y`` (n_y + 1,) and ``z`` (n_z + 1,) um, at true scale."""
    with style():
        ax.pcolormesh(y, z, fraction, cmap=colours.cmap, vmin=colours.low, vmax=colours.high, rasterized=True)
        ax.set_aspect("equal")
        ax.grid(False)
        ax.set_xlabel("y (µm)")
        ax.set_ylabel("z (µm)")
    return ax


@dataclass(frozen=True)
class CountSeries:
    """One curve against the number of filaments: ``count`` (n,), ``mean`` (n,) of an ensemble, ``half_width`` (n,) of
    its confidence interval (nan: one sample alone), in ``colour``."""

    label: str
    count: FloatArray
    mean: FloatArray
    half_width: FloatArray
    colour: str = BLUE
    dashed: bool = False


def plot_against_count(ax: Axes, series: Sequence[CountSeries], label: str) -> Axes:
    """Ensemble means with their confidence bands against filament count, logarithmic; rings are single samples."""
    from matplotlib.ticker import NullFormatter

    with style():
        for s in series:
            known = np.isfinite(s.half_width)
            ax.plot(s.count, s.mean, "--" if s.dashed else "-", color=s.colour, lw=1.5, label=s.label)
            ax.errorbar(s.count[known], s.mean[known], s.half_width[known], fmt="o", color=s.colour, ms=4.5, capsize=3)
            ax.plot(s.count[~known], s.mean[~known], "o", color=s.colour, mfc="white", ms=6, mew=1.5)
        ax.set_xscale("log")
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.set_xlabel("Filaments (1)")
        ax.set_ylabel(label)
    return ax
