"""Soft tows: their law across as the capsules of a deck take it, a force per length against the overlap of two axes.

Two round tows of diameter D that cross at a right angle, their axes D - delta apart at the crossing, overlap by
y(s) = delta - s^2/(2 D) along it, so that a force per length f(y) gives the crossing force

    F(delta) = int f(y(s)) ds = sqrt(2 D) int_0^delta f(y) / sqrt(delta - y) dy ,

Abel's equation; a pressure p(delta) on the area a b in which two chains cross is met by its inverse

    f(y) = 1 / (pi sqrt(2 D)) int_0^y F'(x) / sqrt(y - x) dx ,    F = a b p .

Under another angle both the area and the integral grow by 1/sin(angle). A rigid platen meets half of the pair's
compliance: f_platen(y) = f_pair(2 y).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cgfibre.build.system import FloatArray
from cgfibre.scene import Scene

#: overlaps tabulated, and the part of the thickness that they reach
POINTS, REACH = 81, 0.6
#: final over first slope of the exponential law: e to this power
STEEPENING = 3.0


@dataclass(frozen=True)
class TowLaw:
    """Force per length (nN/um) of a tow at an overlap (um) of two: ``overlap`` and ``load``, rising, with the way back
    in ``unload`` (or None); ``stiffness`` kPa where the law is linear (else 0).

    ``pressure``: the law was given as a pressure (kPa) on the area in which tows cross, and ``load`` is that.
    """

    overlap: FloatArray
    load: FloatArray
    unload: FloatArray | None = None
    stiffness: float = 0.0
    pressure: bool = False


@dataclass(frozen=True)
class ChainLaw:
    """What a chain of a tow feels: rows (overlap um, force per length nN/um) for a pair and for a platen, loading and
    unloading; ``linear``: the stiffness kPa of a pair (else 0)."""

    pair: tuple[FloatArray, FloatArray, FloatArray | None]
    platen: tuple[FloatArray, FloatArray, FloatArray | None]
    linear: float = 0.0

    def slope(self, overlap: float) -> tuple[float, float]:
        """Largest secant slope (kPa) of pair and platen laws around an overlap of the pair, um."""

        def largest(rows: tuple[FloatArray, FloatArray, FloatArray | None], upto: float) -> float:
            d, f, _ = rows
            inside = (d[1:] <= upto) | (np.arange(1, len(d)) == 1)
            rise = np.diff(f) / np.diff(d)
            # the first step of a law like a root is steeper than what a lens of it feels
            return float(np.max(rise[1:][inside[1:]], initial=float(f[1] / d[1])))

        return largest(self.pair, overlap), largest(self.platen, overlap / 2)

    def force(self, overlap: FloatArray, platen: bool = False) -> FloatArray:
        """Force per length at an overlap, nN/um; linear between the rows and beyond them."""
        d, f, _ = self.platen if platen else self.pair
        beyond = np.maximum(overlap - d[-1], 0.0) * (f[-1] - f[-2]) / (d[-1] - d[-2])
        return np.asarray(np.interp(overlap, d, f, left=0.0) + beyond)


def crossing_law(overlap: FloatArray, force: FloatArray, diameter: float, at: FloatArray) -> FloatArray:
    """(m,) force per length nN/um at the overlaps ``at`` um that gives two crossing rods of ``diameter`` um the force
    ``force`` (n,) nN at the overlaps ``overlap`` (n,) um of their axes; exact between the rows, where F is straight.

    The derivative of Abel's integral of a piecewise straight F; never falling, as contact laws are.
    """
    d, f = np.asarray(overlap, dtype=float), np.asarray(force, dtype=float)
    if d[0] > 0:
        d, f = np.append(0.0, d), np.append(0.0, f)
    slope = np.append(np.diff(f) / np.diff(d), (f[-1] - f[-2]) / (d[-1] - d[-2]))
    ends = np.append(d[1:], np.inf)
    y = np.asarray(at, dtype=float)[:, None]
    begun, ended = np.sqrt(np.maximum(y - d, 0.0)), np.sqrt(np.maximum(y - ends, 0.0))
    found = 2.0 / (math.pi * math.sqrt(2.0 * diameter)) * np.sum(slope * (begun - ended), axis=1)
    return np.maximum.accumulate(found)


def tow_law(scene: Scene, modulus: float) -> TowLaw:
    """The law of ``[contact]`` for tows of ``modulus`` kPa (EA over their fibres' area)."""
    c, w = scene.contact, scene.weave
    reach = REACH * max(w.tow.thickness, w.weft.thickness)
    if c.table is not None:
        rows = c.table.rows
        d, load = (np.array([row[k] for row in rows], dtype=float) for k in (0, 1))
        back = [row[2] for row in rows]
        unload = None if back[0] is None else np.array(back, dtype=float)
        return TowLaw(d, load, unload, pressure=c.table.of == "pressure")
    stiffness = (c.stiffness or STIFFNESS) * modulus
    d = np.linspace(0.0, reach, POINTS)
    if c.law != "exponential":
        return TowLaw(d, stiffness * d, None, stiffness)
    rise = c.rise if c.rise is not None else RISE * min(w.tow.thickness, w.weft.thickness)
    scale = rise / STEEPENING
    low = stiffness * scale * (np.exp((np.minimum(d, rise) - rise) / scale) - math.exp(-STEEPENING))
    return TowLaw(d, low + stiffness * np.maximum(d - rise, 0.0))


#: contact stiffness of tows over their modulus where the scene says nothing (10 % EA fits the nylon tests, 8.4.3)
STIFFNESS = 0.1
#: overlap over thickness at which the exponential law reaches its stiffness
RISE = 0.1


def chain_law(law: TowLaw, diameter: float, width: float, chains: int) -> ChainLaw:
    """The law of each of ``chains`` that stand for a tow ``width`` um wide, of ``diameter`` um (its thickness).

    One chain takes a force per length as it is. A ribbon spreads it over its width, p = f/width, as a pressure does.
    """
    d = law.overlap
    if chains == 1 and not law.pressure:
        pair, back = law.load, law.unload
        half = (d / 2, law.load, law.unload)
        return ChainLaw((d, pair, back), half, law.stiffness)
    share = width / chains
    top = float(d[-1])
    at = top * np.linspace(0.0, 1.0, POINTS) ** 2  # laws like a root want small steps at first

    def per_length(load: FloatArray | None) -> tuple[FloatArray | None, FloatArray | None]:
        if load is None:
            return None, None
        pressure = load if law.pressure else load / width
        return crossing_law(d, share**2 * pressure, diameter, at), share * np.interp(at, d, pressure, left=0.0)

    pair_load, wall_load = per_length(law.load)
    pair_back, wall_back = per_length(law.unload)
    assert pair_load is not None and wall_load is not None
    return ChainLaw((at, pair_load, pair_back), (at / 2, wall_load, wall_back))
