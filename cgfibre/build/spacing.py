"""Stations along x: where the beads of every filament stand, uniform or graded.

All filaments share the stations, so that their beads lie in the same cross-sections: two beads only touch if the
spacing is at most about one diameter, hence a fine zone under the anvil and a coarse far field.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cgfibre.build.system import FloatArray
from cgfibre.errors import InputError


@dataclass(frozen=True)
class SpacingSpec:
    """What is asked of the stations on 0 <= x <= ``length`` (all um).

    Attributes
    ----------
    length : of the filaments
    fine : largest spacing inside ``zone``
    zone : (x0, x1) of the fine zone; ``None`` is the whole length, uniform stations
    coarse : largest spacing outside; ``None`` lets it grow to the ends
    growth : largest ratio of two neighbouring spacings, anywhere, above 1
    anchors : further places that must be stations (the anvil's edges); both ends and both ends of the zone always are
    """

    length: float
    fine: float
    zone: tuple[float, float] | None = None
    coarse: float | None = None
    growth: float = 1.3
    anchors: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for key in ("length", "fine"):
            value = getattr(self, key)
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"spacing.{key}", value, "a finite length above 0 um")
        if self.fine > self.length:
            raise InputError("spacing.fine", self.fine, f"at most the length {self.length:g} um")
        if self.coarse is not None and not self.coarse >= self.fine:
            raise InputError("spacing.coarse", self.coarse, f"at least the fine spacing {self.fine:g} um")
        if not 1.0 < self.growth <= 10.0:
            raise InputError("spacing.growth", self.growth, "a ratio above 1, at most 10")
        if self.zone is not None and not 0.0 <= self.zone[0] < self.zone[1] <= self.length:
            raise InputError("spacing.zone", self.zone, f"x0 < x1 within 0 and {self.length:g} um")
        for x in self.anchors:
            if not 0.0 <= x <= self.length:
                raise InputError("spacing.anchors", x, f"places within 0 and {self.length:g} um")


def stations(spec: SpacingSpec) -> FloatArray:
    """(m,) rising stations from 0 to the length, um.

    Between anchors the stations cut the integral of dx / h into equal parts of at most one, where h(x) is ``fine`` in
    the zone and rises from it at slope ln(growth), up to ``coarse``; so neighbouring spacings inside a stretch differ
    by the growth ratio at most, those in a stretch of the zone are equal, and none there exceeds ``fine``. Where two
    stretches meet at a worse ratio (an anchor close to another), h is lowered about that anchor until the ratio holds;
    only there are the spacings of a zone unequal. Anchors nearer than 1e-6 ``fine`` to a former one count as that one.
    Symmetric input gives symmetric stations up to rounding. Raises :class:`InputError` if no size fits the ratio.
    """
    nodes = _nodes(spec)
    coarse = spec.length if spec.coarse is None else spec.coarse
    x0, x1 = spec.zone if spec.zone is not None else (0.0, spec.length)
    tolerance = 1e-6 * spec.fine
    in_zone = (nodes[:-1] >= x0 - tolerance) & (nodes[1:] <= x1 + tolerance)
    cap = np.where(in_zone, spec.fine, coarse)
    at_node = np.minimum(np.append(cap, np.inf), np.insert(cap, 0, np.inf))
    slope = float(np.log(spec.growth))
    for _ in range(2000):
        at_node = _limit(at_node, nodes, slope)
        parts = [_stretch(nodes[k], nodes[k + 1], at_node[k], at_node[k + 1], cap[k], slope) for k in range(len(cap))]
        if not _lower(at_node, parts, spec.growth):
            break
    else:
        raise InputError("spacing.anchors", spec.anchors, f"anchors that allow a growth ratio of {spec.growth:g}")
    return np.concatenate([[0.0], *(p[1:] for p in parts)])


def _nodes(spec: SpacingSpec) -> FloatArray:
    """Rising anchors, without doubles; the ends and the zone's ends stay exact."""
    kept: list[float] = []
    for x in (0.0, spec.length, *(spec.zone or ()), *spec.anchors):
        if all(abs(x - y) > 1e-6 * spec.fine for y in kept):
            kept.append(float(x))
    return np.array(sorted(kept))


def _limit(h: FloatArray, x: FloatArray, slope: float) -> FloatArray:
    """Largest values below ``h`` that change by at most ``slope`` per length."""
    h = h.copy()
    dx = np.diff(x)
    for k in range(len(dx)):
        h[k + 1] = min(h[k + 1], h[k] + slope * dx[k])
    for k in reversed(range(len(dx))):
        h[k] = min(h[k], h[k + 1] + slope * dx[k])
    return h


def _stretch(a: float, b: float, ha: float, hb: float, cap: float, slope: float) -> FloatArray:
    """Stations from a to b for the size that rises from both ends at ``slope`` up to ``cap``."""
    peak = min(0.5 * (ha + hb + slope * (b - a)), cap)
    up, down = np.log(peak / ha) / slope, np.log(peak / hb) / slope
    flat_from, flat_to = a + (peak - ha) / slope, b - (peak - hb) / slope
    flat = max(flat_to - flat_from, 0.0) / peak
    total = up + flat + down
    n = max(int(np.ceil(total - 1e-9)), 1)
    if up == down == 0.0:
        return np.linspace(a, b, n + 1)
    phi = np.linspace(0.0, total, n + 1)
    x = np.where(
        phi < up,
        a + ha * np.expm1(slope * np.minimum(phi, up)) / slope,
        np.where(
            phi <= up + flat,
            flat_from + (phi - up) * peak,
            b - hb * np.expm1(slope * np.minimum(total - phi, down)) / slope,
        ),
    )
    x[0], x[-1] = a, b
    return x


def _lower(at_node: FloatArray, parts: list[FloatArray], growth: float) -> bool:
    """Lower the size at every inner anchor where neighbouring spacings differ too much; whether any did."""
    changed = False
    for k in range(1, len(parts)):
        left = parts[k - 1][-1] - parts[k - 1][-2]
        right = parts[k][1] - parts[k][0]
        ratio = max(left, right) / min(left, right)
        if ratio > growth * (1.0 + 1e-9):
            at_node[k] *= max(0.5, min(0.97, growth / ratio))
            changed = True
    return changed
