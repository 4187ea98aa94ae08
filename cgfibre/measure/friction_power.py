"""The fit of thickness against load and friction, t = c P^(a mu - b) (thesis Eqs 7-6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cgfibre.errors import InputError
from cgfibre.measure.ensemble import mean_of
from cgfibre.mechanics.compaction_laws import FrictionPower


@dataclass(frozen=True)
class FrictionFit:
    """A fitted law with the half widths of the 95 % intervals of c (mm), a and b (nan: one set of specimens), the root
    mean square of ln t - ln t_fit, and the number of points."""

    law: FrictionPower
    c_ci: float
    a_ci: float
    b_ci: float
    misfit: float
    n_points: int


def fit_friction_power(
    load: ArrayLike, friction: ArrayLike, thickness: ArrayLike, felt: bool = True
) -> tuple[FrictionPower, float]:
    """(law, rms of ln t - ln t_fit) by least squares of ln t = ln c + a mu ln P - b ln P.

    ``load`` N/mm, ``friction`` and ``thickness`` mm are of one shape; points that are not finite are left out. Without
    friction ``felt`` a is 0. InputError where the points do not tell the constants (one load alone; one mu with a).
    """
    p, mu, t = (np.asarray(v, dtype=float).ravel() for v in (load, friction, thickness))
    use = np.isfinite(p) & np.isfinite(mu) & np.isfinite(t) & (p > 0) & (t > 0)
    x = np.log(p[use])
    columns = [np.ones_like(x), -x] + ([mu[use] * x] if felt else [])
    matrix = np.stack(columns, axis=1)
    if len(x) < matrix.shape[1] or np.linalg.matrix_rank(matrix) < matrix.shape[1]:
        raise InputError("fit", int(use.sum()), "thicknesses at two loads or more" + (" and two frictions" * felt))
    solution = np.linalg.lstsq(matrix, np.log(t[use]), rcond=None)[0]
    misfit = float(np.sqrt(np.mean((matrix @ solution - np.log(t[use])) ** 2)))
    law = FrictionPower(float(np.exp(solution[0])), float(solution[2]) if felt else 0.0, float(solution[1]))
    return law, misfit


def fit_specimens(load: ArrayLike, friction: ArrayLike, thickness: ArrayLike, felt: bool = True) -> FrictionFit:
    """Fit of ``thickness`` (specimens, frictions, loads) mm to ``friction`` (frictions,) and ``load`` (loads,) N/mm.

    The law is fitted to all specimens; the intervals are Student's over the fits of each specimen, because samples
    along one curve are not independent.
    """
    p, mu, t = (np.asarray(v, dtype=float) for v in (load, friction, thickness))
    if t.ndim != 3 or t.shape[1:] != (len(mu), len(p)):
        raise InputError("thickness", t.shape, f"specimens by {len(mu)} frictions by {len(p)} loads")
    mus, loads = np.meshgrid(mu, p, indexing="ij")
    law, misfit = fit_friction_power(np.broadcast_to(loads, t.shape), np.broadcast_to(mus, t.shape), t, felt)
    each = [fit_friction_power(loads, mus, one, felt)[0] for one in t]
    c, a, b = (mean_of([getattr(e, key) for e in each])[1] for key in ("c", "a", "b"))
    return FrictionFit(law, c, a, b, misfit, int(np.isfinite(t).sum()))
