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
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from cgfibre.build.system import FloatArray
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
