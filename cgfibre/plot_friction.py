"""Figures of friction tests: signals, spectra, belt law, trials. As in :mod:`cgfibre.plot`: they compute nothing but
layout and take what they draw as arguments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cgfibre.build.system import FloatArray
from cgfibre.measure.signal import Mean, TestRig, TrialFriction, WrapRegression
from cgfibre.measure.spectrum import Line, Spectra
from cgfibre.plot import BLUE, GREEN, GREY, INK, VERMILION, new_figure, style
from cgfibre.plot_chart import COLOURS

if TYPE_CHECKING:
    from cgfibre.plot import Axes, Figure

#: points of a line that are drawn at most
DRAWN = 20_000
DIRECTIONS = {1: ("pulled up", BLUE, "o"), -1: ("let down", VERMILION, "s")}


@dataclass(frozen=True)
class SignalView:
    """A pull to draw: ``time`` (n,) s, ``tension`` (n,) N, its rig (N, rad), its friction, and a title."""

    time: FloatArray
    tension: FloatArray
    rig: TestRig
    friction: TrialFriction
    title: str = ""


def _thinned(*columns: FloatArray) -> list[FloatArray]:
    every = max(1, len(columns[0]) // DRAWN)
    return [c[::every] for c in columns]


def _broken(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A line with breaks where samples are missing for twenty times as long as usual."""
    step = np.diff(time)
    at = np.flatnonzero(step > 20 * np.median(step)) + 1
    return np.insert(time, at, np.nan), np.insert(values, at, np.nan)


def plot_signal(ax: Axes, view: SignalView, span: tuple[float, float] | None = None) -> Axes:
    """T/T1 over time with the steady window and the levels exp(mu theta) of the coefficients; ``span`` (s) of it."""
    f, rig = view.friction, view.rig
    t, ratio = _broken(*_thinned(view.time, view.tension / rig.input_tension))
    if span is not None:
        shown = (view.time >= span[0]) & (view.time <= span[1])
        t, ratio = view.time[shown], view.tension[shown] / rig.input_tension
    with style():
        lo, hi = f.window
        if span is None:
            ax.axvspan(lo, hi, color=GREY, alpha=0.14, lw=0, label="steady window")
        marks = ("-", "o") if span is not None else ("-", "")
        ax.plot(t, ratio, ls=marks[0], marker=marks[1], ms=3.5, lw=1.0, color=BLUE, zorder=3)
        for name, mu, colour, dash in (
            (r"$\mu_{s0}$", f.mu_s0, INK, ":"),
            (r"$\mu_s$", f.mu_s, VERMILION, "--"),
            (r"$\mu_k$", f.mu_k, GREEN, "--"),
        ):
            if np.isfinite(mu):
                level = np.exp(f.direction * mu * rig.wrap)
                ax.axhline(level, color=colour, lw=1.6, ls=dash, zorder=4, label=f"{name} = {mu:.3f}")
        ax.set_ylabel("Tension ratio T/T1")
    return ax


def figure_signal(view: SignalView) -> Figure:
    """The whole record, and below it a dozen cycles from the middle of its window."""
    f = view.friction
    fig = new_figure(8.4, 5.6)
    with style():
        top, below = fig.subplots(2, 1)
        plot_signal(top, view)
        top.set_title(view.title)
        top.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=4)
        middle = 0.5 * (f.window[0] + f.window[1])
        half = 6 / f.frequency if np.isfinite(f.frequency) else 0.05 * (f.window[1] - f.window[0])
        plot_signal(below, view, (middle - half, middle + half))
        below.set_xlabel("Time (s)")
    return fig


def figure_spectra(spectra: Spectra, lines: Sequence[Line], title: str = "") -> Figure:
    """The three estimators below each other, on one axis of frequencies; lines found are marked."""
    fig = new_figure(8.4, 7.0)
    with style():
        panels = fig.subplots(3, 1, sharex=True)
        rows = (
            (spectra.lomb_scargle, "Lomb-Scargle\npower", BLUE),
            (spectra.dft * 1e3, "Non-uniform DFT\namplitude (mN)", VERMILION),
            (spectra.expansion * 1e3, "Fourier expansion\namplitude (mN)", GREEN),
        )
        for ax, (values, label, colour) in zip(panels, rows, strict=True):
            f, v = _envelope(spectra.frequency, values)
            ax.plot(f, v, lw=0.9, color=colour)
            ax.set_ylabel(label)
            ax.set_ylim(0, 1.3 * float(values.max(initial=0)) or 1)
            ax.margins(x=0.01)
        for (p, level), dash in zip(spectra.levels, (":", "--", "-"), strict=False):
            panels[0].axhline(level, color=GREY, lw=1.2, ls=dash, label=f"{100 * p:g} % by chance")
        panels[0].legend(loc="center left", bbox_to_anchor=(0.0, 0.55))
        for line in lines:
            name = f"{line.frequency:.3f} Hz"
            if line.harmonic_of is not None:
                name = f"{line.harmonic_of[1]} x {lines[line.harmonic_of[0]].frequency:.3g} Hz"
            left = line.frequency > 0.8 * float(spectra.frequency[-1])
            for ax in panels:
                ax.axvline(line.frequency, color=GREY, lw=0.8, ls=":", zorder=0)
            panels[0].annotate(
                name, (line.frequency, 1), xycoords=("data", "axes fraction"), xytext=(-4 if left else 4, -3),
                textcoords="offset points", ha="right" if left else "left", va="top", fontsize=9.5, color=INK,
            )  # fmt: skip
        panels[0].set_title(title)
        panels[-1].set_xlabel("Frequency (Hz)")
    return fig


def _envelope(frequency: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The highest of neighbouring values where there are more than can be drawn."""
    every = len(values) // DRAWN
    if every < 2:
        return frequency, values
    n = len(values) // every * every
    block = values[:n].reshape(-1, every)
    top = np.argmax(block, axis=1) + np.arange(len(block)) * every
    return frequency[top], values[top]


def figure_belt_law(points: FloatArray, regressions: Mapping[int, WrapRegression]) -> Figure:
    """ln(T2/T1) against the wrap with the lines through the origin; ``points`` (n, 3): wrap, mu theta, direction."""
    fig = new_figure(6.6, 4.6)
    with style():
        ax = fig.add_subplot()
        far = 1.08 * float(points[:, 0].max())
        for direction, (name, colour, marker) in DIRECTIONS.items():
            mine = points[points[:, 2] == direction]
            if not len(mine):
                continue
            ax.plot(mine[:, 0], mine[:, 1], marker, color=colour, mfc="none", mew=1.6, label=name)
            if direction in regressions:
                r = regressions[direction]
                x = np.array([0.0, far])
                text = rf"$\mu$ = {r.mu:.4f} ± {r.interval:.4f} (95 %)"
                ax.plot(x, r.mu * x, color=colour, lw=1.4, label=text)
                ax.fill_between(x, (r.mu - r.interval) * x, (r.mu + r.interval) * x, color=colour, alpha=0.15, lw=0)
        ax.set_xlim(0, far)
        ax.set_ylim(bottom=0)
        ax.set_xlabel("Angle of wrap (rad)")
        ax.set_ylabel("ln(T2/T1)")
        ax.legend(loc="upper left")
    return fig


def figure_trials(
    trials: Sequence[TrialFriction],
    names: Sequence[str],
    means: Mapping[tuple[float, int], Mapping[str, Mean]],
) -> Figure:
    """Coefficients of every trial, and the band of each mean (of one wrap and direction) with its 95 % interval."""
    fig = new_figure(max(6.6, 0.5 * len(trials) + 3), 4.6)
    with style():
        ax = fig.add_subplot()
        x = np.arange(len(trials))
        rows = {
            "mu_s0": (r"$\mu_{s0}$", "^"),
            "mu_s": (r"$\mu_s$", "s"),
            "mu": ("mean", "o"),
            "mu_k": (r"$\mu_k$", "v"),
        }
        for k, (key, (label, marker)) in enumerate(rows.items()):
            values = np.array([getattr(t, key) for t in trials])
            if np.isfinite(values).any():
                ax.plot(x, values, marker, color=COLOURS[k], ms=6, label=label)
                if len(means) == 1:
                    m = next(iter(means.values()))[key]
                    ax.axhline(m.mean, color=COLOURS[k], lw=1.0)
                    if np.isfinite(m.interval):
                        ax.axhspan(m.mean - m.interval, m.mean + m.interval, color=COLOURS[k], alpha=0.15, lw=0)
        ax.set_xticks(x, names, rotation=30 if max(map(len, names)) > 5 else 0, ha="right")
        ax.set_ylabel("Friction coefficient")
        ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    return fig


# --- capstan model ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class CapstanView:
    """A pull to draw: ``time`` (n,) s, ``ratio`` T2/T1 (n,), that of a rigid belt (n,), ``levels`` by coefficient,
    other runs by name as (time s, ratio), a title."""

    time: FloatArray
    ratio: FloatArray
    rigid: FloatArray
    levels: Mapping[str, float]
    others: Mapping[str, tuple[FloatArray, FloatArray]]
    title: str = ""


@dataclass(frozen=True)
class WrapView:
    """ln(T/T1) (filaments, n) along the ``angle`` (n,) rad at ``time`` s, beside the belt law at mu_s and mu_k."""

    angle: FloatArray
    logs: FloatArray
    mu_s: float
    mu_k: float
    time: float


_NAMES = {"mu_s0": r"$\mu_{s0}$", "mu_s": r"$\mu_s$", "mu_k": r"$\mu_k$"}


def figure_capstan(view: CapstanView) -> Figure:
    """T2/T1 over time: model, rigid belt, other runs, and the levels of the coefficients."""
    fig = new_figure(8.4, 4.6)
    with style():
        ax = fig.add_subplot()
        for (name, level), dash in zip(view.levels.items(), (":", "--", "-."), strict=False):
            ax.axhline(level, color=GREY, lw=1.1, ls=dash, zorder=1)
            ax.annotate(
                rf"exp({_NAMES.get(name, name)}$\,\theta$)", (1, level), xycoords=("axes fraction", "data"),
                xytext=(4, 0), textcoords="offset points", va="center", fontsize=9.5, color=INK, annotation_clip=False,
            )  # fmt: skip
        for k, (name, (t, ratio)) in enumerate(view.others.items()):
            ax.plot(t, ratio, color=(VERMILION, GREEN)[k % 2], lw=1.6, label=name, zorder=4)
        ax.plot(view.time, view.ratio, color=BLUE, lw=1.8, label="quasi-static model", zorder=3)
        ax.plot(view.time, view.rigid, color=INK, lw=0.9, ls=(0, (4, 3)), label="rigid belt", zorder=5)
        ax.set_xlabel("Time (s)")
        ax.set_ylabel("Total tension ratio T2/T1")
        ax.set_title(view.title)
        ax.margins(x=0.01)
        ax.legend(loc="lower right")
    return fig


def figure_filaments(time: FloatArray, share: FloatArray) -> Figure:
    """T2/T1 (n, filaments) of each filament over time; what rises least is drawn again below, enlarged."""
    from cgfibre.plot import shades

    n = share.shape[1]
    fig = new_figure(8.4, 5.6 if n > 1 else 3.6)
    with style():
        axes = fig.subplots(2 if n > 1 else 1, 1, sharex=True, squeeze=False)[:, 0]
        colours = shades(n)
        for j in range(n):
            label = f"{j + 1}" if n <= 12 or j in (0, n - 1) else None
            axes[0].plot(time, share[:, j], color=colours[j], lw=1.4, label=label)
            if n > 1 and j > 0:
                axes[1].plot(time, share[:, j], color=colours[j], lw=1.4)
        axes[0].set_ylabel("T2/T1 of a filament")
        if n > 1:
            axes[1].set_ylabel("without the lowest one")
            fig.legend(title="from the pulley", loc="outside right center", fontsize=9)
        axes[-1].set_xlabel("Time (s)")
        axes[-1].margins(x=0.01)
    return fig


def figure_wrap(view: WrapView, law: str = r"belt law, $\mu_k$ to $\mu_s$") -> Figure:
    """ln(T/T1) along the wrap for each filament, and for all together, beside the belt law between mu_k and mu_s."""
    from cgfibre.plot import shades

    fig = new_figure(7.4, 4.8)
    with style():
        ax = fig.add_subplot()
        n = len(view.logs)
        for j, colour in enumerate(shades(n)):
            ax.plot(view.angle, view.logs[j], color=colour, lw=1.4, label=f"filament {j + 1}" if n <= 12 else None)
        if n > 1:
            total = np.log(np.exp(view.logs).mean(axis=0))
            ax.plot(view.angle, total, color=INK, lw=2.2, label="all together")
        band = (view.mu_k * view.angle, view.mu_s * view.angle)
        ax.fill_between(view.angle, *band, color=GREY, alpha=0.35, lw=0, label=law)
        ax.set_xlabel("Angle of wrap (rad)")
        ax.set_ylabel("ln(T/T1)")
        ax.set_title(f"at {view.time:.3g} s")
        ax.margins(x=0.01)
        ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=9)
    return fig


def figure_sensitivity(time: FloatArray, studies: Mapping[str, Sequence[tuple[float, FloatArray]]]) -> Figure:
    """T2/T1 over time with one coefficient changed at a time (Figs 4-7 to 4-9): name -> (value, ratio (n,))."""
    fig = new_figure(8.4, 7.4)
    with style():
        panels = fig.subplots(len(studies), 1, sharex=True, sharey=True)
        for ax, (name, traces) in zip(np.atleast_1d(panels), studies.items(), strict=True):
            for k, (value, ratio) in enumerate(traces):
                ax.plot(time, ratio, color=COLOURS[k], lw=1.5, label=f"{_NAMES[name]} = {value:.2f}")
            ax.set_ylabel("T2/T1")
            ax.legend(loc="upper right", ncols=3, fontsize=9.5)
            ax.margins(x=0.01, y=0.18)
        np.atleast_1d(panels)[-1].set_xlabel("Time (s)")
    return fig


def figure_fit(time: FloatArray, ratio: FloatArray, model: FloatArray) -> Figure:
    """A measured signal T2/T1 (n,) and the fitted one: the whole, and its first dozen cycles or so."""
    fig = new_figure(8.4, 5.6)
    with style():
        for ax, n in zip(fig.subplots(2, 1), (len(time), max(60, len(time) // 40)), strict=True):
            t, y, m = (v[:n] for v in (time, ratio, model))
            if n == len(time):
                t, y, m = _thinned(t, y, m)
            ax.plot(t, y, ".", ms=3, color=GREY, label="measured")
            ax.plot(t, m, color=VERMILION, lw=1.0, label="fitted")
            ax.set_ylabel("T2/T1")
            ax.margins(x=0.01)
        fig.axes[0].legend(loc="upper right", ncols=2)
        fig.axes[1].set_xlabel("Time (s)")
    return fig


@dataclass(frozen=True)
class TowFrictionView:
    """Friction of tows of one size: interpolated ``mu`` (n,) and its ``interval`` (n,) at ``angle`` (n,) deg, and the
    table's points (angle deg, mu, standard deviation)."""

    label: str
    angle: FloatArray
    mu: FloatArray
    interval: FloatArray
    points: FloatArray


def figure_tow_friction(views: Sequence[TowFrictionView], pulley: float) -> Figure:
    """Friction of tow on tow against their angle, a curve with its 95 % interval a tow size, and that on the pulley."""
    fig = new_figure(7.4, 4.8)
    with style():
        ax = fig.add_subplot()
        for k, v in enumerate(views):
            colour = COLOURS[k]
            ax.plot(v.angle, v.mu, color=colour, lw=1.6, label=v.label)
            ax.fill_between(v.angle, v.mu - v.interval, v.mu + v.interval, color=colour, alpha=0.15, lw=0)
            a, mu, s = v.points.T
            ax.errorbar(a, mu, yerr=s, fmt="o", ms=4, color=colour, lw=1.0, capsize=2)
        ax.axhline(pulley, color=GREY, lw=1.2, ls="--", label="12k on the bare pulley")
        ax.set_xlabel("Angle between the tows (deg)")
        ax.set_ylabel("Friction coefficient")
        ax.legend(loc="upper right")
    return fig
