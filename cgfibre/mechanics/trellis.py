"""Closed forms of a weave sheared as a trellis: tows turn about their crossings, lengths along them stay."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ellipe

from cgfibre.mechanics._checks import FloatArray


def area_factor(shear: float) -> float:
    """Area of a cell over that before it was sheared by ``shear`` rad: its cosine."""
    return math.cos(shear)


def locking_angle(width: float, spacing: float) -> float:
    """Shear in rad at which tows of a ``width`` lie side by side: their distance ``spacing`` cos(shear) is their width.

    Both um; 0 where they do so as woven.
    """
    return math.acos(min(1.0, width / spacing))


def bearing_angle(apart: float, amplitudes: tuple[float, float], spacings: tuple[float, float]) -> float:
    """Shear in rad from which round tows on cosines, touching at their crossings, press on each other beside them.

    Near a crossing, xi along the warp and eta along the weft, |xi e1 - eta e2|^2 + (D - (pi^2/2)(h xi^2/p^2 + h'
    eta^2/p'^2))^2 stays above D^2 while (1 - a)(1 - b) > sin^2(shear), a = pi^2 D h/p^2, b = pi^2 D h'/p'^2.
    ``apart`` D um of the axes at a crossing; ``amplitudes`` (h, h') um of warp and weft; ``spacings`` (p, p') um from
    crossing to crossing along them. 0 where crossings as steep press beside each other without any shear.
    """
    a, b = (math.pi**2 * apart * h / p**2 for h, p in zip(amplitudes, spacings, strict=True))
    if a >= 1 or b >= 1:
        return 0.0
    return math.asin(math.sqrt((1 - a) * (1 - b)))


def turning_friction(normal: FloatArray, area: FloatArray, angle: FloatArray, friction: FloatArray) -> FloatArray:
    """Couple, nN um, at which two equal round tows turn on each other at their crossing, (n,).

    All of the contact slips, by friction mu times a pressure in proportion to the overlap, p = p0 (1 - (x/a)^2 -
    (y/b)^2): M = mu int p r dA = 16/(15 pi) mu N a E(m), m = 1 - (b/a)^2, where a^2 = A cot(angle/2)/pi and
    b/a = tan(angle/2); 8/15 mu N sqrt(A/pi) at a right angle. ``normal`` N nN, ``area`` A um2 of the overlap seen along
    the normal, ``angle`` rad of the tows (the acute one), ``friction`` mu. Even pressure would give 5/4 of it, Hertz'
    ellipse, which is half as large, 0.78.
    """
    aspect = np.tan(angle / 2)
    return np.asarray(16 / (15 * np.pi) * friction * normal * np.sqrt(area / (np.pi * aspect)) * ellipe(1 - aspect**2))
