"""Closed forms of a weave sheared as a trellis: tows turn about their crossings, lengths along them stay."""

from __future__ import annotations

import math


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
