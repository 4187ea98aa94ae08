"""Figures of studies: mean curves with confidence bands, and numbers against what varies.

In the style of :mod:`cgfibre.plot`; they compute nothing but layout.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cgfibre.build.system import FloatArray
from cgfibre.plot import BLUE, GREEN, GREY, INK, VERMILION, new_figure, shades, style

if TYPE_CHECKING:
    from cgfibre.plot import Axes, Figure

#: cases without an order: Okabe and Ito
COLOURS = (BLUE, VERMILION, GREEN, "#CC79A7", "#E69F00", "#56B4E9", "#000000")
NAMES = {"line_force": "Force per width", "pressure": "Pressure", "force": "Force on the platen"}
WIDE = 30.0  # from this ratio on what varies has a logarithmic axis
BROKEN, DOTTED = (0, (4, 1.6)), (0, (1, 1.4))


@dataclass(frozen=True)
class Line:
    """A branch of a case: ``x`` (m,) and ``mean`` (m,) of its ``n`` samples; ``band`` (m,) half as wide as what is
    drawn about it (nan: none)."""

    label: str
    branch: str
    x: FloatArray
    mean: FloatArray
    band: FloatArray
    n: int


@dataclass(frozen=True)
class StudyView:
    """How a study is drawn: ``x`` "thickness" (its mean at each load) or "displacement" (the mean load at each),
    ``kind`` and ``unit`` of the load, over the initial thickness or not; ``ordered`` cases go from dark to light."""

    title: str
    x: str
    kind: str
    unit: str
    normalised: bool = False
    log: bool = True
    ordered: bool = False


def plot_study(ax: Axes, lines: Sequence[Line], view: StudyView) -> Axes:
    """Load against thickness or displacement, a colour a case; bands are the 95 % confidence of the mean.

    Of two samples bands are their range. First loading full, unloading broken, loading again dotted.
    """
    labels = list(dict.fromkeys(line.label for line in lines))
    many = view.ordered or len(labels) > len(COLOURS)
    colours = dict(zip(labels, shades(len(labels)) if many else COLOURS, strict=False))
    with style():
        for line in lines:
            colour = colours[line.label]
            again = line.branch not in ("loading", "unloading")
            dashes = DOTTED if again else BROKEN if line.branch.startswith("unloading") else "-"
            name = line.label if line.branch == "loading" else None
            known = np.isfinite(line.band)
            if view.x == "thickness":
                ax.plot(line.mean, line.x, color=colour, ls=dashes, lw=1.8, label=name)
                ax.fill_betweenx(
                    line.x, line.mean - line.band, line.mean + line.band, where=known, color=colour, alpha=0.18, lw=0
                )
            else:
                ax.plot(line.x, line.mean, color=colour, ls=dashes, lw=1.8, label=name)
                low = np.maximum(line.mean - line.band, 0.0)
                ax.fill_between(line.x, low, line.mean + line.band, where=known, color=colour, alpha=0.18, lw=0)
        if any(line.branch == "unloading" for line in lines):
            ax.plot([], [], color=GREY, ls=BROKEN, lw=1.5, label="unloading")
        if any(line.branch == "loading 2" for line in lines):
            ax.plot([], [], color=GREY, ls=DOTTED, lw=1.5, label="loading again")
        for many_of, text in ((True, "95 % of the mean"), (False, "range of two samples")):
            if any((line.n > 2) == many_of and np.isfinite(line.band).any() for line in lines):
                ax.fill_between([], [], [], color=GREY, alpha=0.3, lw=0, label=text)
        ax.set_ylabel(f"{NAMES[view.kind]} ({view.unit})")
        quantity = "Thickness" if view.x == "thickness" else "Platen displacement"
        ax.set_xlabel(f"{quantity} / initial thickness" if view.normalised else f"{quantity} (µm)")
        if view.log:
            ax.set_yscale("log")
        ax.margins(x=0.02)
        if view.x == "thickness":
            means = np.concatenate([line.mean[np.isfinite(line.mean)] for line in lines] or [np.zeros(0)])
            if len(means):  # a band of few samples may be wider than all curves
                ax.set_xlim(means.max() + 0.04 * np.ptp(means), means.min() - 0.04 * np.ptp(means))
            else:
                ax.invert_xaxis()
    return ax


def figure_study(lines: Sequence[Line], view: StudyView) -> Figure:
    """:func:`plot_study` with its legend beside the data."""
    with style():
        fig = new_figure(8.4, 4.6)
        ax = plot_study(fig.add_subplot(), lines, view)
        ax.set_title(view.title, loc="left")
        handles, labels = ax.get_legend_handles_labels()
        columns = 1 if len(labels) <= 18 else 2
        fig.legend(handles, labels, loc="outside right upper", ncols=columns, fontsize=9)
    return fig


@dataclass(frozen=True)
class Points:
    """A number against what varies: ``x``, ``mean`` and ``half`` (n,) the bars' half length (nan: none), um, of at most
    ``samples`` each; the fitted law and the thesis' there, if any."""

    label: str
    x: FloatArray
    mean: FloatArray
    half: FloatArray
    samples: int
    fit: FloatArray | None = None
    beside: FloatArray | None = None


def plot_values(ax: Axes, series: Sequence[Points], xlabel: str) -> Axes:
    """Thickness at each load against ``xlabel``, with 95 % intervals (of two samples: their range), a colour a load;
    laws as lines."""
    with style():
        for points, colour in zip(series, shades(len(series)), strict=True):
            error = np.where(np.isfinite(points.half), points.half, 0.0)
            ax.errorbar(
                points.x, points.mean, yerr=error, fmt="o", ms=5, capsize=3, lw=1.3, color=colour, label=points.label
            )
            if points.fit is None:
                ax.plot(points.x, points.mean, color=colour, lw=1.0, alpha=0.5)
            else:
                ax.plot(points.x, points.fit, color=colour, lw=1.6)
            if points.beside is not None:
                ax.plot(points.x, points.beside, color=colour, lw=1.4, ls=BROKEN)
        bars = any(np.isfinite(p.half).any() for p in series)
        if bars:
            text = "95 % of the mean" if max(p.samples for p in series) > 2 else "range of two samples"
            ax.errorbar([], [], yerr=[], fmt="none", capsize=3, ecolor=GREY, label=text)
        if any(p.fit is not None for p in series):
            ax.plot([], [], color=INK, lw=1.6, label="fitted")
        if any(p.beside is not None for p in series):
            ax.plot([], [], color=INK, lw=1.4, ls=BROKEN, label="thesis, Eqs 7-6")
        ax.set_xlabel(xlabel[:1].upper() + xlabel[1:])
        ax.set_ylabel("Thickness (µm)")
        ax.set_ylim(bottom=0)
        x = np.concatenate([p.x for p in series])
        if x.min() > 0 and x.max() / x.min() > WIDE:
            ax.set_xscale("log")
        ax.margins(x=0.04)
    return ax


def figure_values(series: Sequence[Points], xlabel: str, title: str) -> Figure:
    """:func:`plot_values` with its legend beside the data."""
    with style():
        fig = new_figure(7.6, 4.4)
        ax = plot_values(fig.add_subplot(), series, xlabel)
        ax.set_title(title, loc="left")
        handles, labels = ax.get_legend_handles_labels()
        fig.legend(handles, labels, loc="outside right upper", fontsize=9)
    return fig
