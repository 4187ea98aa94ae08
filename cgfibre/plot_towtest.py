"""Figures of tow compaction tests: strain, modulus, Poisson's ratio, zones, laws of fibre beds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cgfibre.build.system import FloatArray
from cgfibre.plot import BLUE, GREEN, GREY, INK, VERMILION, new_figure, style

if TYPE_CHECKING:
    from cgfibre.plot import Axes, Figure

Pair = tuple[FloatArray, FloatArray]
COLOURS = (BLUE, VERMILION, GREEN, "#CC79A7", "#E69F00", "#56B4E9", INK)
BED_COLOURS = {"van Wyk": GREEN, "Toll": BLUE, "Gutowski": VERMILION}


@dataclass(frozen=True)
class ShownTests:
    """Trials under one condition as they are drawn; pairs are (x, y) arrays, pressures MPa.

    ``loading`` and ``unloading`` (pressure, strain) of each trial, ``poisson`` (strain, ratio), ``modulus`` (strain,
    MPa) and the power law's ``fitted_modulus``, ``mean`` (pressure, strain, half width of the band), ``zones`` (breaks,
    strains, exponents), ``power_law`` (a, b), ``law_strain`` of the empirical law at the mean's pressures,
    ``volume_fraction`` there and ``beds`` (name, volume fraction there, rms).
    """

    name: str
    loading: tuple[Pair, ...]
    unloading: tuple[Pair, ...]
    poisson: tuple[Pair, ...]
    modulus: tuple[Pair, ...]
    fitted_modulus: Pair
    mean: tuple[FloatArray, FloatArray, FloatArray]
    zones: tuple[FloatArray, FloatArray, FloatArray] | None
    power_law: tuple[float, float]
    law_strain: FloatArray | None
    volume_fraction: FloatArray | None
    beds: tuple[tuple[str, FloatArray, float], ...]


def plot_strain(ax: Axes, shown: Sequence[ShownTests]) -> Axes:
    """Strain against pressure: trials (thin; unloading dashed), mean with its band, the empirical law (dots)."""
    with style():
        for k, s in enumerate(shown):
            colour = COLOURS[k % len(COLOURS)]
            for p, e in s.loading:
                ax.plot(p, e, color=colour, lw=0.7, alpha=0.45)
            for p, e in s.unloading:
                ax.plot(p, e, color=colour, lw=0.7, alpha=0.45, ls=(0, (4, 2)))
            p, e, half = s.mean
            ax.plot(p, e, color=colour, label=s.name)
            if np.all(np.isfinite(half)):
                ax.fill_between(p, e - half, e + half, color=colour, alpha=0.18, lw=0)
            if s.law_strain is not None:
                ax.plot(p[::4], s.law_strain[::4], ".", color=colour, ms=5)
        ax.set_xlabel("Pressure (MPa)")
        ax.set_ylabel("Thickness strain (1)")
        ax.set_ylim(bottom=0)
        ax.set_xlim(left=0)
        ax.legend(loc="lower right", fontsize=8)
    return ax


def plot_modulus(ax: Axes, shown: Sequence[ShownTests]) -> Axes:
    """Tangent modulus against strain: slopes of the records (points), of the power law (lines)."""
    with style():
        for k, s in enumerate(shown):
            colour = COLOURS[k % len(COLOURS)]
            for e, m in s.modulus:
                good = np.isfinite(m) & (m > 0) & (e > 0)
                step = max(int(good.sum()) // 60, 1)
                ax.plot(e[good][::step], m[good][::step], ".", color=colour, ms=3, alpha=0.5)
            ax.plot(*s.fitted_modulus, color=colour)
        ax.set_yscale("log")
        ax.set_xlabel("Thickness strain (1)")
        ax.set_ylabel("Modulus (MPa)")
    return ax


def plot_poisson(ax: Axes, shown: Sequence[ShownTests]) -> Axes:
    """Poisson's ratio against strain, of the tests whose width was measured."""
    with style():
        drawn = False
        for k, s in enumerate(shown):
            for e, nu in s.poisson:
                good = np.isfinite(nu) & (e > 0.2 * e.max())  # nothing over nothing at first touch
                ax.plot(e[good], nu[good], color=COLOURS[k % len(COLOURS)], lw=0.9, alpha=0.8)
                drawn = True
        if not drawn:
            ax.text(0.5, 0.5, "no widths measured", transform=ax.transAxes, ha="center", color=GREY)
        ax.set_xlabel("Thickness strain (1)")
        ax.set_ylabel("Poisson's ratio (1)")
        if drawn:
            ax.set_ylim(bottom=min(0.0, ax.get_ylim()[0]), top=1.15 * ax.get_ylim()[1])
    return ax


def plot_zones(ax: Axes, shown: Sequence[ShownTests]) -> Axes:
    """Mean strain against pressure on logarithmic axes, with the pieces that the data tell apart."""
    with style():
        for k, s in enumerate(shown):
            colour = COLOURS[k % len(COLOURS)]
            p, e, _ = s.mean
            ax.plot(p, e, ".", color=colour, ms=3.5, alpha=0.7)
            if s.zones is None:
                continue
            breaks, strains, slopes = s.zones
            knots = np.concatenate([[p[0]], breaks, [p[-1]]])
            a, b = s.power_law
            inner = strains if len(breaks) else np.array([a * p[0] ** b])
            first = inner[0] * (knots[0] / (breaks[0] if len(breaks) else p[0])) ** slopes[0]
            last = inner[-1] * (knots[-1] / (breaks[-1] if len(breaks) else p[0])) ** slopes[-1]
            heights = np.concatenate([[first], strains, [last]])
            ax.plot(knots, heights, color=colour, lw=1.4)
            ax.plot(breaks, strains, "o", color=colour, ms=6, mfc="white")
            if len(shown) <= 3:
                for q in range(len(slopes)):
                    x, y = np.sqrt(knots[q] * knots[q + 1]), np.sqrt(heights[q] * heights[q + 1])
                    ax.annotate(
                        f"{slopes[q]:.2f}", (x, y), (0, 7), textcoords="offset points", color=colour, ha="right"
                    )
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.set_xlabel("Pressure (MPa)")
        ax.set_ylabel("Thickness strain (1)")
    return ax


def figure_tests(shown: Sequence[ShownTests]) -> Figure:
    """Strain, modulus, Poisson's ratio and zones of all conditions."""
    fig = new_figure(11.0, 8.2)
    with style():
        axes = fig.subplots(2, 2)
        for ax, draw, title in (
            (axes[0, 0], plot_strain, "strain: mean with 95 % band"),
            (axes[0, 1], plot_modulus, "modulus: slopes and power law"),
            (axes[1, 0], plot_poisson, "Poisson's ratio of the section"),
            (axes[1, 1], plot_zones, "zones, with their exponents"),
        ):
            draw(ax, shown)
            ax.set_title(title, loc="left")
    return fig


def plot_beds(ax: Axes, shown: ShownTests) -> Axes:
    """Fibre volume fraction against pressure, measured and by the laws of fibre beds."""
    p = shown.mean[0]
    with style():
        if shown.volume_fraction is not None:
            ax.plot(p, shown.volume_fraction, "o", color=INK, ms=4, mfc="none", label="measured")
        for name, fraction, rms in shown.beds:
            ax.plot(p, fraction, color=BED_COLOURS.get(name, GREY), lw=1.6, label=f"{name} ({100 * rms:.2g} %)")
        if shown.volume_fraction is None:
            ax.text(0.5, 0.5, "tow size not stated", transform=ax.transAxes, ha="center", color=GREY)
        else:
            ax.legend(loc="upper left", fontsize=8.5)
        ax.set_xscale("log")
        ax.set_xlabel("Pressure (MPa)")
        ax.set_title(shown.name, loc="left", fontsize=9.5)
    return ax


def figure_laws(shown: Sequence[ShownTests], most: int = 6) -> Figure:
    """:func:`plot_beds` of each condition (the first ``most``), side by side in rows of three."""
    some = shown[:most]
    columns = min(len(some), 3)
    rows = -(-len(some) // columns)
    fig = new_figure(4.2 * columns, 3.6 * rows)
    with style():
        axes = np.atleast_1d(fig.subplots(rows, columns, squeeze=False)).ravel()
        for ax, s in zip(axes, some, strict=False):
            plot_beds(ax, s)
        for ax in axes[len(some) :]:
            ax.set_visible(False)
        for ax in axes[::columns]:
            ax.set_ylabel("Fibre volume fraction (1)")
    return fig
