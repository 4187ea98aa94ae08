"""Charts of error against time, of trials, and of the limits of methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from cgfibre.build.system import FloatArray
from cgfibre.errors import InputError
from cgfibre.plot import BLUE, GREEN, GREY, INK, VERMILION, new_figure, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class ChartPoint:
    """One variant of a chart of accuracy against speed: ``cpu`` seconds and relative ``error`` with their lowest and
    highest; whether it is on the Pareto front, the planner's choice, and trusted by its guards."""

    name: str
    level: str
    cpu: float
    error: float
    cpu_range: tuple[float, float]
    error_range: tuple[float, float]
    front: bool = False
    chosen: bool = False
    trusted: bool = True


#: colour and marker of a level, and of how its filaments touch
LEVELS = {
    "subbundle": ("#CC79A7", "P"),
    "section": (GREEN, "s"),
    "chain": (BLUE, "o"),
    "rod": (VERMILION, "^"),
    "chain, capsule": (BLUE, "o"),
    "chain, beads": ("#56B4E9", "h"),
    "rod, capsule": (VERMILION, "^"),
    "rod, beads": ("#E69F00", "v"),
    "compared": (INK, "D"),
}


def plot_chart(ax: Axes, points: Sequence[ChartPoint], goal: float | None = None) -> Axes:
    """Error (%) against processor seconds on logarithmic axes, with the Pareto front and the planner's choice.

    Bars are the lowest and highest of the starts; hollow points are those that a guard distrusts; ``goal`` is drawn as
    a line. Points without a positive error are left out. Raises InputError without a point to draw.
    """
    drawn = [p for p in points if p.error > 0 and p.cpu > 0]
    if not drawn:
        raise InputError("points", len(points), "one with a positive error and time, or more")
    with style():
        ax.set_xscale("log")
        ax.set_yscale("log")
        front = sorted((p for p in drawn if p.front), key=lambda p: p.cpu)
        if len(front) > 1:
            x, y = [p.cpu for p in front], [100 * p.error for p in front]
            ax.plot(x, y, color=GREY, lw=1.3, ls=(0, (4, 2)), zorder=1, label="Pareto front")
        for level in dict.fromkeys(p.level for p in drawn):
            colour, marker = LEVELS.get(level, (GREY, "o"))
            of_level = [p for p in drawn if p.level == level]
            for p in of_level:
                low, high = p.error_range
                ax.errorbar(
                    p.cpu,
                    100 * p.error,
                    xerr=[[p.cpu - p.cpu_range[0]], [p.cpu_range[1] - p.cpu]],
                    yerr=[[100 * (p.error - low)], [100 * (high - p.error)]],
                    fmt=marker,
                    ms=7,
                    color=colour,
                    lw=1.2,
                    capsize=2.5,
                    zorder=3,
                    markerfacecolor=colour if p.trusted else "white",
                )
            ax.plot([], [], marker, ms=7, color=colour, label=level)
        for k, p in enumerate(p for p in drawn if p.chosen):
            ax.plot(
                p.cpu, 100 * p.error, "o", ms=15, mfc="none", mec=INK, mew=1.5, zorder=4,
                label="planner's choice" if k == 0 else None,
            )  # fmt: skip
        if goal is not None:
            ax.axhline(100 * goal, color=INK, lw=1.3, ls=":", zorder=1.5, label=f"{100 * goal:g} %")
        if any(not p.trusted for p in drawn):
            ax.plot([], [], "o", ms=7, mfc="white", mec=GREY, label="distrusted by a guard")
        _name_points(ax, drawn)
        _label(ax, "Error (%)")
    return ax


def _label(ax: Axes, error: str) -> None:
    """Axes of an ``error`` against processor time, ticks, room and legend."""
    ax.set_xlabel("Processor time of the engine (s)")
    ax.set_ylabel(error)
    _decade_ticks(ax)
    ax.margins(x=0.12, y=0.12)
    ax.legend(loc="best")


def _decade_ticks(ax: Axes) -> None:
    """Plain numbers in place of powers of ten, with ticks between decades where there are less than two of them."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    for axis in (ax.xaxis, ax.yaxis):
        low, high = axis.get_view_interval()
        few = np.log10(high / low) < 2.5
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
        axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
        axis.set_minor_formatter(FuncFormatter(lambda v, _: ""))


def _name_points(ax: Axes, points: Sequence[ChartPoint]) -> None:
    """Names beside the points, above or below where another one is near."""
    ordered = sorted(points, key=lambda p: p.cpu)
    left, right = ordered[0].cpu, ordered[-1].cpu
    low: list[bool] = []
    for k, p in enumerate(ordered):
        near = [
            i
            for i, q in enumerate(ordered[:k])
            if abs(np.log10(p.cpu / q.cpu)) < 0.4 and abs(np.log10(p.error / q.error)) < 0.12
        ]
        below = not low[near[-1]] if near else False
        low.append(below)
        last = right > left and np.log(p.cpu / left) > 0.9 * np.log(right / left)
        ax.annotate(
            p.name,
            (p.cpu, 100 * p.error),
            xytext=(-9 if last else 9, -13 if below else 7),
            textcoords="offset points",
            ha="right" if last else "left",
            fontsize=9,
            color=INK,
            zorder=5,
        )


def figure_chart(points: Sequence[ChartPoint], goal: float | None, error: str, title: str = "") -> Figure:
    """:func:`plot_chart` on a figure of its own; ``error`` names what the error is, with its unit (%)."""
    fig = new_figure(8.4, 5.2)
    with style():
        ax = plot_chart(fig.add_subplot(), points, goal)
        ax.set_ylabel(error)
        ax.set_title(title)
    return fig


class Trial(Protocol):
    """What :func:`plot_trials` draws (``cases.experiment.Measured`` is one)."""

    @property
    def level(self) -> str: ...  # noqa: D102
    @property
    def spacing(self) -> float: ...  # noqa: D102
    @property
    def cpu(self) -> float: ...  # noqa: D102
    @property
    def error(self) -> float: ...  # noqa: D102


def plot_trials(ax: Axes, trials: Sequence[Trial], names: Sequence[str] = ()) -> Axes:
    """Error (%) of experiments against their closed forms over processor seconds, logarithmic, one line a level.

    A level tried several times at one spacing has a line a spacing. ``names`` stand beside the points, in the order of
    ``trials``; else their spacing s/D (nothing for a section). Trials without time are left out; errors below 1e-6 are
    drawn there. Raises InputError without one to draw.
    """
    texts = list(names) or [f"{t.spacing:g}" if t.spacing else "" for t in trials]
    drawn = [(t, name) for t, name in zip(trials, texts, strict=True) if t.cpu > 0 and np.isfinite(t.error)]
    if not drawn:
        raise InputError("trials", len(trials), "one with a time and a finite error, or more")
    with style():
        ax.set_xscale("log")
        ax.set_yscale("log")
        for level in dict.fromkeys(t.level for t, _ in drawn):
            colour, marker = LEVELS.get(level, (GREY, "o"))
            of_level = [(t, name) for t, name in drawn if t.level == level]
            spacings = list(dict.fromkeys(t.spacing for t, _ in of_level))
            apart = 1 < len(spacings) < len(of_level)
            for k, spacing in enumerate(spacings if apart else [None]):
                line = sorted(
                    (t.cpu, 100 * max(abs(t.error), 1e-6), name)
                    for t, name in of_level
                    if spacing is None or t.spacing == spacing
                )
                label = level if spacing is None else f"{level}, s = {spacing:g} D"
                x, y = [c for c, _, _ in line], [e for _, e, _ in line]
                face = colour if k % 2 == 0 else "white"
                ax.plot(x, y, marker, ls=("-", "--", ":")[k % 3], color=colour, mfc=face, lw=1.4, label=label)
                for c, e, name in line:
                    ax.annotate(name, (c, e), xytext=(6, 5), textcoords="offset points", fontsize=9, color=INK)
        _label(ax, "Error against the closed form (%)")
    return ax


def figure_trials(trials: Sequence[Trial], names: Sequence[str] = (), title: str = "") -> Figure:
    """:func:`plot_trials` on a figure of its own."""
    fig = new_figure(8.4, 5.2)
    with style():
        plot_trials(fig.add_subplot(), trials, names).set_title(title)
    return fig


# --- limits of methods -----------------------------------------------------------------------------------------------

#: Okabe and Ito's colours, for curves beside each other
COLOURS = (BLUE, VERMILION, GREEN, "#CC79A7", "#E69F00", "#56B4E9", INK, GREY)


@dataclass(frozen=True)
class LimitView:
    """Title, labels of the axes and which of them are logarithmic, (x, y)."""

    title: str
    x: str
    y: str
    logarithmic: tuple[bool, bool] = (True, True)


@dataclass(frozen=True)
class LimitSeries:
    """One curve of a map of limits, (n,) each: ``predicted`` and ``used`` may be nan."""

    label: str
    parameter: FloatArray
    measured: FloatArray
    predicted: FloatArray
    used: FloatArray


def plot_limits(ax: Axes, view: LimitView, series: Sequence[LimitSeries]) -> Axes:
    """Measured limits as circles on the lines of their closed forms; crosses: what the package uses by default.

    Series of one point each (one a material, say) are drawn without lines. On a logarithmic axis values that are not
    above zero are left out.
    """
    from matplotlib.lines import Line2D

    predicted = used = False
    for k, s in enumerate(series):
        order = np.argsort(s.parameter)
        x, colour = s.parameter[order], COLOURS[k % len(COLOURS)]
        marker = "o" if k < len(COLOURS) else "s"
        if np.any(np.isfinite(s.predicted)):
            line = "-" if len(x) > 1 else ""
            ax.plot(x, s.predicted[order], line, marker="" if line else "_", ms=18, color=colour, lw=1.5, alpha=0.6)
            predicted = True
        # points that coincide show as rings within rings
        size = 6.5 if len(series) < 6 else 12.0 - 6.0 * k / len(series)
        ax.plot(x, s.measured[order], marker, color=colour, ms=size, mfc="none", mew=1.8, label=s.label)
        if np.any(np.isfinite(s.used)):
            ax.plot(x, s.used[order], "x", color=colour, ms=6, mew=1.4)
            used = True
    if view.logarithmic[0]:
        ax.set_xscale("log")
    if view.logarithmic[1]:
        ax.set_yscale("log", nonpositive="mask")
    ax.set_xlabel(view.x)
    ax.set_ylabel(view.y)
    ax.set_title(view.title, loc="left")
    handles, labels = ax.get_legend_handles_labels()
    for shown, handle, label in (
        (predicted, Line2D([], [], color=GREY, lw=1.5), "closed form"),
        (used, Line2D([], [], color=GREY, marker="x", ls="", mew=1.4), "used by default"),
    ):
        if shown:
            handles.append(handle)
            labels.append(label)
    ax.legend(handles, labels, loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=9)
    return ax
