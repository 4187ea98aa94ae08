"""Figures of sub-bundles: the homogenised law, and tows of them beside the tow of all filaments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from cgfibre.build.system import FloatArray
from cgfibre.plot import BLUE, GREEN, GREY, INK, VERMILION, new_figure, shades, style
from cgfibre.subbundle_law import HEXAGONAL, SubbundleLaw

if TYPE_CHECKING:
    from cgfibre.plot import Figure

Pair = tuple[FloatArray, FloatArray]


def figure_law(law: SubbundleLaw) -> Figure:
    """State curve with its spread (left), and the force of two discs against their overlap (right)."""
    with style():
        fig = new_figure(9.0, 3.9)
        left, right = fig.subplots(1, 2)
        s = law.state
        left.fill_between(s.fraction, s.load - s.spread, s.load + s.spread, color=BLUE, alpha=0.2, lw=0)
        left.plot(s.fraction, s.load, color=BLUE, label="loading, mean and s.d. of one start")
        left.plot(s.fraction, s.unload, color=BLUE, ls="--", label="unloading")
        v = np.linspace(HEXAGONAL, float(s.fraction[-1]), 100)
        x = 1 - np.sqrt(HEXAGONAL / v)
        left.plot(v, np.sqrt(3) * x / (1 - x), color=GREY, label="hexagonal lattice, exact")
        left.set(xlabel="volume fraction of whole filaments", ylabel="pressure over contact stiffness $p/k'$")
        left.legend(frameon=False)
        right.plot(law.contact.overlap, law.contact.load, color=VERMILION, label="contact: calibrated")
        top = float(law.contact.overlap[-1])
        right.plot([0, top], [0, top], color=GREY, label="one filament's own law, scaled")
        right.plot(law.lattice.overlap, law.lattice.load, color=GREEN, label="lattice: loading")
        if law.lattice.unload is not None:
            right.plot(law.lattice.overlap, law.lattice.unload, color=GREEN, ls="--", label="lattice: unloading")
        right.set(xlabel="overlap over diameter $d/D_s$", ylabel="force over stiffness $f/(k' D_s)$")
        right.legend(frameon=False)
        for ax in (left, right):
            ax.set_ylim(bottom=0)
        return fig


def figure_tow(reference: Pair, tows: Mapping[str, Pair], depth: float) -> Figure:
    """Force a depth against displacement of all filaments and of sub-bundles (left), thickness error against the force
    (right). Pairs are (thickness um, force N) while loading, the first as built; ``depth`` mm."""
    with style():
        fig = new_figure(9.0, 3.9)
        left, right = fig.subplots(1, 2)
        t0, f0 = reference
        left.plot(t0[0] - t0, f0 / depth, color=INK, label="every filament")
        loads = np.linspace(0.05, float(f0[-1] / depth), 300)
        wanted = np.interp(loads, np.maximum.accumulate(f0 / depth), t0)
        for (name, (t, f)), colour in zip(tows.items(), shades(len(tows)), strict=True):
            left.plot(t[0] - t, f / depth, color=colour, ls="--", label=name)
            rising = np.maximum.accumulate(f / depth)
            reached = loads <= rising[-1]
            right.plot(loads[reached], 100 * (np.interp(loads[reached], rising, t) / wanted[reached] - 1), color=colour)
        left.set(xlabel="displacement (µm)", ylabel="force a depth (N/mm)")
        right.set(xlabel="force a depth (N/mm)", ylabel="thickness against every filament (%)")
        right.axhline(0, color=INK, lw=0.8)
        left.legend(frameon=False)
        return fig
