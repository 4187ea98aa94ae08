"""Figures of a run: curve, filaments in 3D, energies; and what other figures share.

Functions ``plot_*`` draw on an axes and return it; ``figure_*`` lay out a whole figure and return it. They compute
nothing but layout. One style throughout: colour-blind-safe colours (Okabe and Ito; viridis for values), units in every
label, 150 dots per inch. Figures are made without pyplot: no display is needed and nothing stays open. Save with
``fig.savefig(path)``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray, IntArray
from cgfibre.errors import InputError
from cgfibre.record import Curve

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

BLUE, VERMILION, GREEN, GREY, INK = "#0072B2", "#D55E00", "#009E73", "#8C8C8C", "#222222"
STEEL = "#9AA5B1"
DPI = 150

#: rcParams of every figure (Any: the stubs of matplotlib list the keys, and they differ by version)
STYLE: Any = {
    "font.size": 11,
    "axes.titlesize": 11.5,
    "axes.titleweight": "bold",
    "axes.labelsize": 11,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.linewidth": 0.9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.8,
    "lines.linewidth": 2.0,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 10,
    "hatch.linewidth": 0.7,
    "figure.dpi": DPI,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}

_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}


def style() -> AbstractContextManager[None]:
    """Context in which matplotlib has the style of the package."""
    import matplotlib

    return matplotlib.rc_context(STYLE)


def new_figure(width: float = 7.2, height: float = 4.4) -> Figure:
    """An empty figure in the style of the package, ``width`` x ``height`` inches; add axes with ``fig.add_subplot``."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with style():
        fig = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
        FigureCanvasAgg(fig)
        return fig


def shades(n: int) -> list[tuple[float, float, float, float]]:
    """``n`` colours in order, dark to light (viridis, without its palest part)."""
    import matplotlib

    return [matplotlib.colormaps["viridis"](x) for x in np.linspace(0.0, 0.88, n)]


def new_axes(width: float = 7.2, height: float = 4.4) -> Axes:
    """One axes on a new figure in the style of the package; its figure is ``ax.figure``."""
    with style():
        return new_figure(width, height).add_subplot()


def _prefix(values: FloatArray, unit: str) -> tuple[float, str]:
    """Factor and unit with the SI prefix that brings the largest magnitude to 1..1000."""
    finite = np.abs(values[np.isfinite(values)])
    largest = float(finite.max(initial=0.0))
    power = 0 if largest == 0 else int(np.clip(3 * np.floor(np.log10(largest) / 3), -12, 9))
    return 10.0**-power, _PREFIXES[power] + unit


@dataclass(frozen=True)
class CurveView:
    """What :func:`plot_curve` shows: ``x`` and ``y``, the bottom platen's force, a logarithmic y, and the error band.

    ``speed_error`` is the relative change of the force on halving the platen speed, drawn as a band about the loading
    branch; ``certified`` is the certificate's relative error of the force, drawn in its place.
    """

    x: Literal["displacement", "thickness"] = "displacement"
    y: Literal["force", "pressure"] = "force"
    bottom: bool = True
    log: bool = False
    speed_error: float | None = None
    certified: float | None = None


def plot_curve(ax: Axes, curve: Curve, view: CurveView | None = None, label: str = "") -> Axes:
    """Force or pressure against displacement or thickness, loading and unloading; of several cycles the earlier ones
    are thin and pale.

    Thickness runs from right to left, so that compaction always goes to the right. ``label`` names the run in the
    legend. On a logarithmic axis values that are not above zero are left out.
    """
    view = view or CurveView()
    if view.x not in ("displacement", "thickness") or view.y not in ("force", "pressure"):
        raise InputError("view", (view.x, view.y), "x displacement or thickness, y force or pressure")
    x = curve["displacement_um" if view.x == "displacement" else "thickness_um"]
    top, unit = (curve["force_top_N"], "N") if view.y == "force" else (curve["pressure_MPa"] * 1e6, "Pa")
    factor, unit = _prefix(top, unit)
    lines = [(top, BLUE, "top platen" if view.y == "force" else "mean under the platen")]
    if view.bottom and view.y == "force":
        lines.append((curve["force_bottom_N"], VERMILION, "bottom platen"))
    back = curve.unloading
    with style():
        for values, colour, name in lines:
            y = values * factor
            if view.log:
                y = np.where(y > 0, y, np.nan)
            for part, returning, cycle in _branches(curve):
                early = curve.cycles - cycle
                look = {"lw": 1.5, "ls": (0, (4, 1.6))} if returning else {"lw": 1.2} if early else {}
                alpha = (0.8 if returning else 1.0) * 0.75 ** min(early, 3)
                text = f"{label}: {name}" if label else name
                ax.plot(x[part], y[part], color=colour, alpha=alpha, label="" if early or returning else text, **look)
        if curve.cycles > 1:
            before = "loading 1" if curve.cycles == 2 else f"loadings 1 to {curve.cycles - 1}"
            ax.plot([], [], color=GREY, lw=1.2, alpha=0.75, label=before)
        error, source = view.speed_error, "halving the platen speed"
        if view.certified is not None:
            error, source = view.certified, "certificate"
        if error is not None:
            going = ~back & (curve.cycle == 1)  # what the error was found for
            y = np.where(top > 0, top, np.nan if view.log else 0.0)[going] * factor
            band = (y * (1 - error), y * (1 + error))
            text = f"±{100 * error:.2g} % ({source})"
            ax.fill_between(x[going], *band, color=BLUE, alpha=0.16, lw=0, label=text)
        if back.any():
            ax.plot([], [], color=GREY, lw=1.5, ls=(0, (4, 1.6)), label="unloading")
        ax.set_ylabel(f"{'Force on the platen' if view.y == 'force' else 'Pressure'} ({unit})")
        ax.set_xlabel("Platen displacement (µm)" if view.x == "displacement" else "Thickness (µm)")
        if view.log:
            ax.set_yscale("log")
        else:
            ax.axhline(0, color=INK, lw=0.9)
        if view.x == "thickness" and not ax.xaxis_inverted():
            ax.invert_xaxis()
        ax.margins(x=0.01)
        ax.legend(loc="best")
    return ax


def _branches(curve: Curve) -> list[tuple[slice, bool, int]]:
    """(rows, whether the platen goes back, cycle) of each stretch of a curve; it starts where the one before ends."""
    back = curve.unloading
    change = (np.diff(back) != 0) | (np.diff(curve.cycle) != 0)
    ends = [*(np.flatnonzero(change) + 1).tolist(), len(curve)]
    begins = [0, *(end - 1 for end in ends[:-1])]
    return [(slice(a, b), bool(back[b - 1]), int(curve.cycle[b - 1])) for a, b in zip(begins, ends, strict=True)]


def plot_loadings(ax: Axes, curves: Mapping[str, Curve]) -> Axes:
    """Force of the top platen (full) and of the bottom one (broken) against displacement while loading, a colour a run.

    ``curves`` by the name of each run in the legend.
    """
    highest = np.concatenate([c["force_top_N"][c.loading] for c in curves.values()])
    factor, unit = _prefix(highest, "N")
    with style():
        for (name, curve), colour in zip(curves.items(), (BLUE, VERMILION, *shades(len(curves))), strict=False):
            d = curve["displacement_um"][curve.loading]
            ax.plot(d, curve["force_top_N"][curve.loading] * factor, color=colour, label=name)
            bottom = curve["force_bottom_N"][curve.loading] * factor
            ax.plot(d, bottom, color=colour, ls=(0, (4, 1.6)), lw=1.4)
        ax.plot([], [], color=GREY, ls=(0, (4, 1.6)), lw=1.4, label="bottom platen")
        ax.axhline(0, color=INK, lw=0.9)
        ax.set_xlabel("Platen displacement (µm)")
        ax.set_ylabel(f"Force on the platen ({unit})")
        ax.margins(x=0.01)
        ax.legend(loc="best")
    return ax


def plot_thickness_errors(ax: Axes, thickness: FloatArray, pressure: FloatArray, error: FloatArray) -> Axes:
    """Thickness with its error bars (um) at pressures (MPa) on an axes that :func:`plot_curve` drew.

    The axes shows pressure against thickness; its unit is read off its label.
    """
    unit = ax.get_ylabel().rpartition("(")[2].rstrip(")")
    factor = {p + "Pa": 10.0**-power for power, p in _PREFIXES.items()}[unit] * 1e6
    with style():
        ax.errorbar(
            thickness,
            pressure * factor,
            xerr=error,
            fmt="o",
            ms=5,
            color=INK,
            capsize=3.5,
            lw=1.4,
            zorder=4,
            label="thickness ± error (certificate)",
        )
        ax.legend(loc="best")
    return ax


@dataclass(frozen=True)
class Colours:
    """Colour scale of the values: ``label`` with unit, range, colour map."""

    label: str
    low: float
    high: float
    cmap: str = "viridis"

    @classmethod
    def spanning(cls, label: str, *values: FloatArray | None, cmap: str = "viridis") -> Colours:
        """The range of all values given (finite ones; None is passed over)."""
        parts = [np.asarray(v, dtype=float).ravel() for v in values if v is not None]
        found = np.concatenate(parts) if parts else np.empty(0)
        found = found[np.isfinite(found)]
        if not len(found):
            return cls(label, 0.0, 1.0, cmap)
        low, high = float(found.min()), float(found.max())
        return cls(label, low, high if high > low else low + 1.0, cmap)

    def mappable(self) -> ScalarMappable:
        """The scale as matplotlib wants it."""
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        return ScalarMappable(Normalize(self.low, self.high), self.cmap)


def plot_energy(ax: Axes, curve: Curve) -> Axes:
    """Where the work of the platen went, over time: stored, kinetic, and the remainder (friction and damping), stacked.

    The remainder is work - stored - kinetic; where it is negative the stack passes above the line of the work.
    """
    with style():
        factor, unit = _prefix(curve.work, "J")
        late, time_unit = _prefix(curve["time_us"] * 1e-6, "s")
        t = curve["time_us"] * 1e-6 * late
        work, stored, kinetic = (x * factor for x in (curve.work, curve["stored_J"], curve["kinetic_J"]))
        ax.fill_between(t, 0, stored, color=BLUE, alpha=0.55, lw=0, label="stored in filaments, springs and end load")
        ax.fill_between(t, stored, stored + kinetic, color=VERMILION, alpha=0.9, lw=0, label="kinetic")
        dissipated = np.maximum(work, stored + kinetic)
        ax.fill_between(
            t, stored + kinetic, dissipated, color="#E69F00", alpha=0.45, lw=0, label="friction and damping"
        )
        whose = "work of the platen and of the cell's edges" if curve.cell else "work of the platen"
        ax.plot(t, work, color=INK, lw=1.8, label=whose)
        for part, returning, cycle in _branches(curve)[1:]:
            turn = t[part.start]
            ax.axvline(turn, color=GREY, lw=1.0, ls=":")
            ax.annotate(
                "unloading" if curve.cycles == 1 else "" if returning else f"loading {cycle}",
                (turn, 0.0),
                xycoords=("data", "axes fraction"),
                xytext=(4, 5),
                textcoords="offset points",
                color=INK,
                fontsize=9.5,
            )
        if min(work.min(), stored.min()) >= 0:
            ax.set_ylim(bottom=0)
        else:
            ax.axhline(0, color=INK, lw=0.9)
        ax.set_xlabel(f"Time ({time_unit})")
        ax.set_ylabel(f"Energy ({unit})")
        ax.margins(x=0.01)
        ax.legend(loc="upper left")
    return ax


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
        ax.set_xlabel("Processor time of the engine (s)")
        ax.set_ylabel("Error (%)")
        _decade_ticks(ax)
        ax.margins(x=0.12, y=0.12)
        ax.legend(loc="best")
    return ax


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
        ax.set_xlabel("Processor time of the engine (s)")
        ax.set_ylabel("Error against the closed form (%)")
        _decade_ticks(ax)
        ax.margins(x=0.12, y=0.12)
        ax.legend(loc="best")
    return ax


def figure_trials(trials: Sequence[Trial], names: Sequence[str] = (), title: str = "") -> Figure:
    """:func:`plot_trials` on a figure of its own."""
    fig = new_figure(8.4, 5.2)
    with style():
        plot_trials(fig.add_subplot(), trials, names).set_title(title)
    return fig


@dataclass(frozen=True)
class PlatenFace:
    """Face of a platen in the 3D view: height ``z`` um, if it is the top one, extents in x and y, um (inf: all)."""

    z: float
    above: bool
    x: tuple[float, float] = (-np.inf, np.inf)
    y: tuple[float, float] = (-np.inf, np.inf)


@dataclass(frozen=True)
class BundleView:
    """What :func:`figure_bundle_3d` shows.

    ``values`` (n_filaments,) or (n_beads,) coloured on ``colours``; ``platens`` outlined; y and z (diameters included)
    drawn ``exaggeration`` times larger than x, and said so on the figure; ``azimuth`` and ``elevation`` in degrees of
    the eye about z and above the x-y plane (-90, 0 looks along y).
    """

    values: FloatArray | None = None
    colours: Colours | None = None
    platens: tuple[PlatenFace, ...] = ()
    exaggeration: float = 1.0
    azimuth: float = -62.0
    elevation: float = 20.0
    title: str = ""


@dataclass(frozen=True)
class Camera:
    """Parallel projection: rows right, up, towards the eye; y and z stretched before."""

    axes: FloatArray
    stretch: FloatArray

    @classmethod
    def of(cls, view: BundleView) -> Camera:
        """The camera of a view."""
        a, e = np.radians([view.azimuth, view.elevation])
        eye = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
        right = np.array([-np.sin(a), np.cos(a), 0.0])
        return cls(np.stack([right, np.cross(eye, right), eye]), np.array([1, view.exaggeration, view.exaggeration]))

    def __call__(self, points: FloatArray) -> FloatArray:
        """(n, 3) points as the camera sees them."""
        return (np.asarray(points, dtype=float) * self.stretch) @ self.axes.T


@dataclass(frozen=True)
class Tubes:
    """Points close together along the filaments, (n, 3) as the camera sees them, with tangent and (n,) radius."""

    points: FloatArray
    tangent: FloatArray
    radius: FloatArray
    bead: IntArray
    filament: IntArray


#: pixels touched at most (a second or so); larger systems are drawn coarser
PIXEL_BUDGET = 16_000_000


def _tubes(system: FilamentSystem, positions: FloatArray, camera: Camera, step: float) -> Tubes:
    bonds = system.bonds()
    bonds = bonds[bonds[:, 1] > bonds[:, 0]]  # a closing bond would cross the picture
    seen = camera(positions)
    d = seen[bonds[:, 1]] - seen[bonds[:, 0]]
    length = np.linalg.norm(d, axis=1)
    n = np.maximum(1, np.ceil(np.linalg.norm(d[:, :2], axis=1) / step)).astype(np.int64)
    bond = np.repeat(np.arange(len(bonds)), n)
    share = (np.arange(len(bond)) - np.repeat(np.cumsum(n) - n, n) + 0.5) / n[bond]
    return Tubes(
        points=seen[bonds[bond, 0]] + share[:, None] * d[bond],
        tangent=(d / np.where(length > 0, length, 1.0)[:, None])[bond],
        radius=np.full(len(bond), float(system.diameter.mean()) / 2 * float(camera.stretch[1])),
        bead=bonds[bond, 0] + (share > 0.5),
        filament=system.filament_of_bead[bonds[bond, 0]],
    )


def render_tubes(
    tubes: Tubes, base: FloatArray, origin: FloatArray, shape: tuple[int, int], pixel: float
) -> FloatArray:
    """(rows, columns, 4) image of shaded tubes by a depth buffer: every point is a ball, shaded as its tube."""
    rows, columns = shape
    place = (tubes.points[:, :2] - origin) / pixel
    corner = np.floor(place).astype(np.int64)
    r = tubes.radius / pixel
    largest = float(r.max())
    reach = int(np.ceil(largest))
    offsets = np.array([(i, j) for i in range(-reach, reach + 1) for j in range(-reach, reach + 1)])
    depth = tubes.points[:, 2] / pixel
    depth = depth - depth.min() + largest + 1
    # depth in the high bits, then the point: the largest is what the eye meets
    levels = (2.0**30) / (depth.max() + largest + 1)
    nearest = np.zeros(rows * columns, dtype=np.int64)
    index = np.arange(len(place), dtype=np.int64)
    for i, j in offsets:
        at = corner + np.array((i, j))
        dx, dy = at[:, 0] + 0.5 - place[:, 0], at[:, 1] + 0.5 - place[:, 1]
        lift = r * r - dx * dx - dy * dy
        use = (lift > 0) & (at[:, 0] >= 0) & (at[:, 0] < columns) & (at[:, 1] >= 0) & (at[:, 1] < rows)
        height = depth[use] + np.sqrt(lift[use])
        key = ((height * levels).astype(np.int64) << 32) | index[use]
        np.maximum.at(nearest, at[use, 1] * columns + at[use, 0], key)
    hit = np.flatnonzero(nearest)
    point = nearest[hit] & 0xFFFFFFFF
    normal = np.empty((len(hit), 3))
    normal[:, 0] = (hit % columns + 0.5 - place[point, 0]) / r[point]
    normal[:, 1] = (hit // columns + 0.5 - place[point, 1]) / r[point]
    normal[:, 2] = np.sqrt(np.maximum(1 - normal[:, 0] ** 2 - normal[:, 1] ** 2, 0))
    tangent = tubes.tangent[point]
    normal -= (normal * tangent).sum(axis=1, keepdims=True) * tangent
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    light = np.array([-0.35, 0.75, 0.56])
    halfway = light + np.array([0, 0, 1])
    halfway /= np.linalg.norm(halfway)
    diffuse = np.clip(normal @ light, 0, 1)
    shine = np.clip(normal @ halfway, 0, 1) ** 28
    # a dark rim parts one filament from the next, a jump in depth deepens it
    surface = (nearest >> 32).reshape(shape) / levels
    fall = np.zeros(shape)
    for axis, shift in ((0, 1), (0, -1), (1, 1), (1, -1)):
        fall = np.maximum(fall, np.roll(surface, shift, axis) - surface)
    shadow = 1 - 0.5 * np.clip(fall.ravel()[hit] / (2 * r[point]), 0, 1)
    bright = (0.38 + 0.72 * diffuse) * (0.55 + 0.45 * normal[:, 2]) * shadow
    image = np.zeros((rows * columns, 4))
    image[hit, :3] = np.clip(base[point] * bright[:, None] + 0.22 * (shine * shadow)[:, None], 0, 1)
    image[hit, 3] = 1
    return image.reshape(rows, columns, 4)


def _draw_platens(ax: Axes, view: BundleView, camera: Camera, positions: FloatArray, depth: float) -> FloatArray:
    """Draw the outlines; (n, 3) their corners."""
    from matplotlib.patches import Polygon

    drawn = np.empty((0, 3))

    low, high = positions.min(axis=0), positions.max(axis=0)
    margin = 0.06 * max(high[1] - low[1], high[2] - low[2], 1e-9)
    for face in view.platens:
        x = np.clip(face.x, low[0] - margin, high[0] + margin)
        y = np.clip(face.y, low[1] - 2 * margin, high[1] + 2 * margin)
        back = face.z + (depth if face.above else -depth)
        ring = np.array([(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])])
        lower, upper = (np.column_stack([ring, np.full(4, z)]) for z in sorted((face.z, back)))
        sides = [np.array([lower[k], lower[(k + 1) % 4], upper[(k + 1) % 4], upper[k]]) for k in range(4)]
        centre = (lower.mean(axis=0) + upper.mean(axis=0)) / 2
        for quad in (lower, upper, *sides):
            drawn = np.concatenate([drawn, quad])
            outward = (quad.mean(axis=0) - centre) @ camera.axes[2]
            front = outward > 0
            if not front and not (face.above and quad is lower):
                continue
            ax.add_patch(
                Polygon(
                    camera(quad)[:, :2],
                    facecolor=(0.62, 0.66, 0.70, 0.16 if face.above else 0.35),
                    edgecolor=(0.2, 0.22, 0.25, 0.75),
                    lw=0.9,
                    zorder=3 if face.above else 1,
                    joinstyle="round",
                )
            )
    return drawn


def _draw_scale(ax: Axes, view: BundleView, camera: Camera, points: FloatArray) -> FloatArray:
    """Bar of a round length along x below everything at ``points`` (n, 3), the axes beside it; (n, 2) points drawn."""
    low, high = points.min(axis=0), points.max(axis=0)
    seen = camera(points)[:, :2]
    size = float(np.ptp(seen[:, 0]))
    along = camera.axes[:2, 0]
    nice = 10 ** np.floor(np.log10((high[0] - low[0]) / 3))
    bar = nice * max(k for k in (1, 2, 5) if k == 1 or k * nice <= (high[0] - low[0]) / 3)
    near = camera(low)[:2] - [0, 0.03 * size]
    ends = np.array([near, near + bar * along])
    ax.plot(ends[:, 0], ends[:, 1], color=INK, lw=3, solid_capstyle="butt", zorder=4)
    words = f"{bar:g} µm along x" if bar < 1000 else f"{bar / 1000:g} mm along x"
    if view.exaggeration != 1:
        words += f"; y and z drawn {view.exaggeration:g} times larger"
    ax.annotate(
        words,
        (near[0], near[1]),
        (0, -6),
        textcoords="offset points",
        ha="left",
        va="top",
        rotation=float(np.degrees(np.arctan2(along[1], along[0]))),
        rotation_mode="anchor",
    )
    arrow = 0.055 * size
    root = np.array([seen[:, 0].max() + 0.02 * size, seen[:, 1].min() + 0.3 * arrow])
    tips = root + arrow * camera.axes[:2].T
    for tip, name in zip(tips, "xyz", strict=True):
        arrowprops = {"arrowstyle": "-|>", "color": INK, "lw": 1.2, "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", (tip[0], tip[1]), (root[0], root[1]), arrowprops=arrowprops)
        out = root + 1.3 * (tip - root)
        ax.text(out[0], out[1], name, ha="center", va="center", style="italic")
    return np.concatenate([ends, tips])


def figure_bundle_3d(system: FilamentSystem, positions: FloatArray, view: BundleView | None = None) -> Figure:
    """The filaments as shaded tubes in parallel projection, hidden parts hidden, with the platens' outline.

    ``positions`` (n_beads, 3) um. True to scale unless ``view.exaggeration`` says otherwise. A bond that closes a
    periodic filament is not drawn. Raises InputError for sections, non-finite positions or values of another length.
    """
    from matplotlib.colors import to_rgb

    view = view or BundleView()
    if not len(system.bonds()):
        raise InputError("system", "one bead a filament", "filaments of two beads or more (draw sections in 2D)")
    if positions.shape != (system.n_beads, 3) or not np.all(np.isfinite(positions)):
        raise InputError("positions", positions.shape, f"shape ({system.n_beads}, 3), finite")
    camera = Camera.of(view)
    radius = float(system.diameter.mean()) / 2 * view.exaggeration
    seen = camera(positions)[:, :2]
    low, high = seen.min(axis=0) - 1.5 * radius, seen.max(axis=0) + 1.5 * radius
    pixel = float((high[0] - low[0]) / 2100)
    bonds = system.bonds()
    run = float(np.linalg.norm(seen[bonds[:, 1]] - seen[bonds[:, 0]], axis=1).sum())
    for _ in range(8):
        step = max(0.5 * radius, pixel)
        if run / step * (2 * np.ceil(radius / pixel) + 1) ** 2 <= PIXEL_BUDGET:
            break
        pixel *= 1.25
    tubes = _tubes(system, positions, camera, step)
    colours = view.colours
    if view.values is None:
        # slightly different greys tell neighbours apart
        tone = 0.88 + 0.24 * np.modf(np.arange(system.n_filaments) * 0.618)[0]
        base = np.asarray(to_rgb(STEEL)) * tone[tubes.filament][:, None]
    else:
        values = np.asarray(view.values, dtype=float)
        if values.shape not in ((system.n_filaments,), (system.n_beads,)):
            raise InputError("view.values", values.shape, f"{system.n_filaments} or {system.n_beads} values")
        colours = colours or Colours.spanning("", values)
        each = values[tubes.bead] if values.shape == (system.n_beads,) else values[tubes.filament]
        base = np.asarray(colours.mappable().to_rgba(each))[:, :3]
    shape = (int(np.ceil((high[1] - low[1]) / pixel)), int(np.ceil((high[0] - low[0]) / pixel)))
    image = render_tubes(tubes, base, low, shape, pixel)

    fig = new_figure(10.0, 4.0)
    with style():
        ax = fig.add_subplot()
        extent = (low[0], low[0] + shape[1] * pixel, low[1], low[1] + shape[0] * pixel)
        ax.imshow(image, origin="lower", extent=extent, interpolation="antialiased", zorder=2)
        corners = positions.min(axis=0), positions.max(axis=0)
        faces = _draw_platens(ax, view, camera, positions, depth=0.22 * float((corners[1] - corners[0])[1:].max()))
        points = np.concatenate([faces, positions])
        scale = _draw_scale(ax, view, camera, points)
        drawn = np.concatenate([scale, camera(points)[:, :2], [low, high]])
        ax.set_aspect("equal")
        ax.set_axis_off()
        if view.title:
            ax.set_title(view.title)
        pad = 0.02 * float(np.ptp(drawn[:, 0]))
        ax.set_xlim(drawn[:, 0].min() - pad, drawn[:, 0].max() + 2 * pad)
        ax.set_ylim(drawn[:, 1].min() - 2 * pad, drawn[:, 1].max() + pad)
        (x0, x1), (y0, y1) = ax.get_xlim(), ax.get_ylim()
        fig.set_size_inches(10.0, float(np.clip(9.2 * (y1 - y0) / (x1 - x0) + 0.5, 2.4, 8.0)))
        if view.values is not None and colours is not None:
            bar = fig.colorbar(colours.mappable(), ax=ax, shrink=0.75, pad=0.01, aspect=20)
            bar.set_label(colours.label, labelpad=7)
            bar.outline.set_visible(False)
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


# --- micrographs -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Finds:
    """A grey ``picture`` (rows, columns), circles found in it and its scale ``pixels_per_um``.

    ``centres`` (n, 2) and ``diameter`` (n,) in pixels, x right, y down.
    """

    picture: np.typing.NDArray[np.floating[Any]]
    centres: FloatArray
    diameter: FloatArray
    pixels_per_um: float


def plot_finds(ax: Axes, finds: Finds) -> Axes:
    """The picture with the circles found in it, their middles and a scale bar; axes in um from the lower left."""
    from matplotlib.collections import EllipseCollection

    rows, columns = finds.picture.shape
    scale = finds.pixels_per_um
    low, high = np.percentile(finds.picture[:: max(rows // 500, 1), :: max(columns // 500, 1)], [0.5, 99.5])
    with style():
        extent = (0, columns / scale, 0, rows / scale)
        ax.imshow(
            finds.picture, cmap="gray", vmin=low, vmax=max(high, low + 1), extent=extent, interpolation="antialiased"
        )
        y = (finds.centres[:, 0] + 0.5) / scale
        z = (rows - 0.5 - finds.centres[:, 1]) / scale
        d = finds.diameter / scale
        offsets = np.stack([y, z], axis=1)
        inches = ax.get_position().width * ax.figure.get_figwidth()  # type: ignore[union-attr]
        dots = DPI * inches * float(np.median(d)) / extent[1] if len(d) else 0.0
        ax.add_collection(
            EllipseCollection(
                d,
                d,
                np.zeros(len(d)),
                units="xy",
                offsets=offsets,
                offset_transform=ax.transData,
                facecolors="none",
                edgecolors=VERMILION,
                linewidths=float(np.clip(dots / 20, 0.5, 1.6)),
            ),
            autolim=False,
        )
        ax.plot(y, z, ".", color=BLUE, ms=float(np.clip(dots / 8, 0.8, 5)), mew=0)
        ax.set_xlim(0, extent[1])
        ax.set_ylim(0, extent[3])
        ax.grid(False)
        ax.set_xlabel("y (µm)")
        ax.set_ylabel("z (µm)")
        ax.set_title(f"{len(d)} filaments found", loc="left")
    return ax


def figure_finds(finds: Finds) -> Figure:
    """:func:`plot_finds` in a figure of about the picture's own pixels (7 to 16 inches wide)."""
    rows, columns = finds.picture.shape
    width = float(np.clip(columns / DPI, 7.0, 16.0))
    fig = new_figure(width, float(np.clip(width * rows / columns, 2.5, 16.0)) + 0.6)
    with style():
        plot_finds(fig.add_subplot(), finds)
    return fig


@dataclass(frozen=True)
class Histogram:
    """Values and the label of their axis, with its unit."""

    values: FloatArray
    label: str


def figure_histograms(histograms: Sequence[Histogram]) -> Figure:
    """Histograms side by side, each with its mean and s.d. in the title; an empty one says so."""
    fig = new_figure(3.6 * len(histograms), 3.3)
    with style():
        axes = np.atleast_1d(fig.subplots(1, len(histograms)))
        for ax, h in zip(axes, histograms, strict=True):
            values = h.values[np.isfinite(h.values)]
            ax.set_xlabel(h.label)
            if not len(values):
                ax.set_title("too few filaments", loc="left")
                continue
            ax.hist(values, int(np.clip(2 * np.cbrt(len(values)), 5, 60)), color=BLUE, alpha=0.75, lw=0)
            sd = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
            ax.set_title(f"{np.mean(values):.3g} ± {sd:.2g}", loc="left")
            ax.axvline(float(np.mean(values)), color=INK, lw=1.2, ls=(0, (4, 2)))
        axes[0].set_ylabel("Filaments (1)")
    return fig


# --- contact ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ContactCurve:
    """Pressure (n,) kPa across a contact at ``y`` (n,) um, with its ``label``."""

    y: FloatArray
    pressure: FloatArray
    label: str


def plot_contact_pressure(ax: Axes, curves: Sequence[ContactCurve]) -> Axes:
    """Pressure across line contacts (thesis Fig 6-3), GPa, one line a curve."""
    with style():
        for k, c in enumerate(curves):
            ax.plot(c.y, c.pressure * 1e-6, color=(BLUE, VERMILION, GREEN, GREY)[k % 4], label=c.label)
        ax.set_xlabel("Distance from the middle of the contact (µm)")
        ax.set_ylabel("Contact pressure (GPa)")
        ax.set_ylim(bottom=0, top=1.3 * ax.get_ylim()[1])
        ax.legend(loc="upper center")
    return ax


def plot_shear_map(ax: Axes, y: FloatArray, depth: FloatArray, shear: FloatArray, label: str) -> Axes:
    """Map of the greatest shear stress (depths, ys) under a contact, in the unit that ``label`` states; + its peak."""
    with style():
        drawn = ax.contourf(y, depth, shear, 15, cmap="viridis")
        k = np.unravel_index(int(np.argmax(shear)), shear.shape)
        ax.plot(y[k[1]], depth[k[0]], "+", color="white", ms=9, mew=1.6)
        ax.invert_yaxis()
        ax.set_aspect("equal")
        ax.grid(False)
        ax.set_xlabel("Distance from the middle (µm)")
        ax.set_ylabel("Depth (µm)")
        ax.figure.colorbar(drawn, ax=ax, label=label, shrink=0.85)
    return ax
