"""Ensembles: the same quantity of several specimens on one grid, its mean, scatter and confidence.

With n samples x_i at a grid point: mean m, standard deviation s (n - 1 degrees of freedom) and the half width of the
95 % confidence interval of the mean, t(0.975, n - 1) s/sqrt(n) with Student's t. One sample has a value but neither
scatter nor confidence (nan). All functions take arrays; curves are of loading or unloading alone, in their order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cgfibre.build.system import FloatArray
from cgfibre.errors import InputError
from cgfibre.measure.compaction import thickness_at_pressure

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Ensemble:
    """Samples on a grid: ``x`` (m,), ``values`` (n, m), one row a sample, nan where a sample does not reach.

    ``mean``, ``sd`` and ``ci`` (half width at 95 %) are (m,) and nan where any sample is missing: a mean over those
    alone that got there would be one of other specimens.
    """

    x: FloatArray
    values: FloatArray

    def __post_init__(self) -> None:
        if self.values.ndim != 2 or self.values.shape[1:] != self.x.shape or len(self.values) < 1:
            raise InputError("values", self.values.shape, f"samples by {len(self.x)} grid points, at least one sample")

    @property
    def n(self) -> int:
        """Number of samples."""
        return len(self.values)

    @property
    def mean(self) -> FloatArray:
        """(m,) mean over the samples."""
        return np.asarray(self.values.mean(axis=0))

    @property
    def sd(self) -> FloatArray:
        """(m,) standard deviation of the samples; nan for one sample."""
        if self.n < 2:
            return np.full(self.x.shape, np.nan)
        return np.asarray(self.values.std(axis=0, ddof=1))

    @property
    def ci(self) -> FloatArray:
        """(m,) half width of the confidence interval of the mean; nan for one sample."""
        return student(self.n) * self.sd / math.sqrt(self.n)


@dataclass(frozen=True)
class Difference:
    """Difference of two means with the half width of its 95 % confidence interval (nan: a case of one sample)."""

    value: float
    ci: float

    @property
    def significant(self) -> bool:
        """Whether the interval leaves out zero."""
        return abs(self.value) > self.ci


def student(n: int, confidence: float = CONFIDENCE) -> float:
    """Quantile t of Student's distribution for the mean of ``n`` samples: t((1 + confidence)/2, n - 1); nan for one."""
    return _quantile(n - 1, confidence) if n > 1 else math.nan


def _quantile(freedom: float, confidence: float = CONFIDENCE) -> float:
    from scipy.stats import t

    return float(t.ppf(0.5 + confidence / 2, freedom))


def ensemble(x: ArrayLike, samples: Sequence[ArrayLike]) -> Ensemble:
    """The samples, each (m,), on their grid ``x`` (m,); InputError where lengths differ or there is none."""
    grid = np.asarray(x, dtype=float)
    rows = [np.asarray(s, dtype=float) for s in samples]
    if not rows or any(row.shape != grid.shape for row in rows):
        raise InputError("samples", [row.shape for row in rows], f"one or more of the grid's shape {grid.shape}")
    return Ensemble(grid, np.stack(rows))


def mean_of(values: Sequence[float]) -> tuple[float, float, float]:
    """(mean, half width of its 95 % interval, standard deviation) of single numbers; nan where one is not known."""
    if not len(values):
        return math.nan, math.nan, math.nan
    e = ensemble([0.0], [[v] for v in values])
    return float(e.mean[0]), float(e.ci[0]), float(e.sd[0])


def difference(a: Sequence[float], b: Sequence[float]) -> Difference:
    """mean(a) - mean(b) with Welch's interval: two specimens' populations of unequal scatter.

    Half width t(0.975, nu) sqrt(va + vb), v = s^2/n, nu = (va + vb)^2/(va^2/(na - 1) + vb^2/(nb - 1)).
    """
    if not len(a) or not len(b):
        return Difference(math.nan, math.nan)
    value = float(np.mean(a) - np.mean(b))
    if len(a) < 2 or len(b) < 2:
        return Difference(value, math.nan)
    va, vb = (float(np.var(v, ddof=1)) / len(v) for v in (a, b))
    if va + vb == 0:
        return Difference(value, 0.0)
    if not math.isfinite(va + vb):
        return Difference(value, math.nan)
    freedom = (va + vb) ** 2 / (va**2 / (len(a) - 1) + vb**2 / (len(b) - 1))
    return Difference(value, _quantile(freedom) * math.sqrt(va + vb))


def load_on(displacement: ArrayLike, load: ArrayLike, grid: ArrayLike) -> FloatArray:
    """Load of one branch at displacements ``grid``, linearly between samples; nan beyond them.

    The displacement may rise (loading) or fall (unloading) monotonically.
    """
    d, f = np.asarray(displacement, dtype=float), np.asarray(load, dtype=float)
    if len(d) < 2:
        return np.full(np.shape(grid), np.nan)
    if d[0] > d[-1]:
        d, f = d[::-1], f[::-1]
    return np.asarray(np.interp(np.asarray(grid, dtype=float), d, f, left=np.nan, right=np.nan))


def thickness_on(thickness: ArrayLike, load: ArrayLike, grid: ArrayLike, unloading: bool = False) -> FloatArray:
    """Thickness of one branch where its load first crosses each of ``grid``: rising, or falling while unloading.

    nan for loads that the branch does not cross (:func:`cgfibre.measure.compaction.thickness_at_pressure`).
    """
    t, f, at = (np.asarray(v, dtype=float) for v in (thickness, load, grid))
    if len(t) < 2:
        return np.full(at.shape, np.nan)
    return thickness_at_pressure(t, -f, -at) if unloading else thickness_at_pressure(t, f, at)


def load_grid(lowest: float, highest: float, points: int = 60) -> FloatArray:
    """(points,) loads evenly spaced in their logarithm, both ends included; InputError unless 0 < lowest < highest."""
    if not 0 < lowest < highest:
        raise InputError("grid", (lowest, highest), "0 < lowest < highest")
    return np.geomspace(lowest, highest, points)
