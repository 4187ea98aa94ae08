"""From filaments to sub-bundles: stress against strain of a section, state curves of cells, laws of contact, fits.

Arrays in, numbers out. Stresses P = p/k' are without dimension (k' the stiffness of a contact a length, kPa), volume
fractions those of whole filaments; see :mod:`cgfibre.subbundle_law`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from cgfibre.build.system import FloatArray
from cgfibre.errors import InputError
from cgfibre.subbundle_law import HEXAGONAL, State, Table

#: mean pressure over k' from which on filaments count as jammed: overlaps of about 1e-4 D
JAMMED = 1e-4
#: the thesis' three moduli of 127 filaments (7.3.4), MPa, and the strains between them
THESIS_MODULI, THESIS_KNEES = (22.0, 125.0, 1316.0), (0.46, 0.54)
#: knees are looked for among this many strains, up to EXHAUSTIVE of them by trying all
CANDIDATES, EXHAUSTIVE = 24, 3


@dataclass(frozen=True)
class SectionResponse:
    """What a pressed section says of itself as a material, (n,) each: nominal ``strain`` d/h0, nominal ``stress``
    F/(depth w0) of the top platen in kPa, that of the bottom one (``carried``: through the contacts, all the way),
    and the part ``springs`` that the filaments' supports take, their difference."""

    strain: FloatArray
    stress: FloatArray
    carried: FloatArray

    @property
    def springs(self) -> FloatArray:
        """Stress that goes into the supports between the platens, kPa."""
        return self.stress - self.carried


@dataclass(frozen=True)
class MultiLinear:
    """A continuous line of straight pieces through the origin: ``knees`` (n,) strains, ``moduli`` (n + 1,) in the unit
    of the stress, ``rms`` difference over the largest stress."""

    knees: tuple[float, ...]
    moduli: tuple[float, ...]
    rms: float

    def stress(self, strain: ArrayLike) -> FloatArray:
        """Stress at ``strain``, any shape."""
        return _basis(np.asarray(strain, dtype=float), self.knees) @ _steps(np.array(self.moduli))


def section_response(
    displacement: ArrayLike, top_force: ArrayLike, bottom_force: ArrayLike, height: float, width: float, depth: float
) -> SectionResponse:
    """Nominal stress and strain of a section (thesis 7.3.4): um, nN; ``height`` and ``width`` um as built.

    Raises InputError for a size that is not above zero or arrays of unequal length.
    """
    for key, value in (("height", height), ("width", width), ("depth", depth)):
        if not value > 0:
            raise InputError(key, value, "above zero")
    d, top, bottom = (np.asarray(a, dtype=float) for a in (displacement, top_force, bottom_force))
    if not d.shape == top.shape == bottom.shape or d.ndim != 1:
        raise InputError("top_force", top.shape, f"one dimension, as the displacement has {d.shape}")
    return SectionResponse(d / height, top / (depth * width), bottom / (depth * width))


def mean_of_runs(x: Sequence[ArrayLike], y: Sequence[ArrayLike], at: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """(mean, standard deviation) over runs of y where x rises through ``at`` (n,), linearly between samples.

    The s.d. is that of one run (n - 1); nan of a single one. Beyond a run's last x it counts as nan: no extrapolation.
    """
    grid = np.asarray(at, dtype=float)
    rows = []
    for xs, ys in zip(x, y, strict=True):
        a, b = np.asarray(xs, dtype=float), np.asarray(ys, dtype=float)
        rows.append(np.interp(grid, a, b, right=np.nan))
    table = np.array(rows)
    sd = table.std(axis=0, ddof=1) if len(rows) > 1 else np.full(len(grid), np.nan)
    return table.mean(axis=0), sd


def state_curve(
    fractions: Sequence[FloatArray],
    pressures: Sequence[FloatArray],
    unloading: Sequence[np.ndarray],
    deepest: float,
    rows: int = 40,
) -> State:
    """The mean state curve of cells: P = p/k' against volume fraction, there and back, from where it jams.

    ``fractions``, ``pressures`` (P) and ``unloading`` (bool) one array a run, from loose to ``deepest`` and back. The
    first row is where the mean of the runs reaches :data:`JAMMED`; there it counts as 0. Curves are made to rise.
    Raises InputError where the runs do not jam before ``deepest``.
    """
    grid = np.linspace(0.5, deepest, 2000)
    down = [~u for u in unloading]
    load, _ = mean_of_runs(
        [f[k] for f, k in zip(fractions, down, strict=True)], [p[k] for p, k in zip(pressures, down, strict=True)], grid
    )
    # the record is of means over windows: no row is at the deepest itself
    jammed = np.flatnonzero((load < JAMMED) & np.isfinite(load))
    start = int(jammed[-1]) if len(jammed) else 0
    last = np.flatnonzero(np.isfinite(load))
    if not len(last) or start >= last[-1] - 10:
        raise InputError("deepest", deepest, "a volume fraction at which the cells are jammed")
    at = np.linspace(grid[start], grid[last[-1]], rows)
    load, spread = mean_of_runs(
        [f[k] for f, k in zip(fractions, down, strict=True)], [p[k] for p, k in zip(pressures, down, strict=True)], at
    )
    back, _ = mean_of_runs(
        [f[u][::-1] for f, u in zip(fractions, unloading, strict=True)],
        [p[u][::-1] for p, u in zip(pressures, unloading, strict=True)],
        at,
    )
    load, back = (np.maximum.accumulate(np.maximum(a, 0.0)) for a in (load, back))
    load[0] = back[0] = 0.0
    back[-1] = load[-1]
    return State(at, load, np.minimum(back, load), np.nan_to_num(spread))


def lattice_table(state: State) -> Table:
    r"""Force against overlap of elements that keep their six neighbours, closed form of the state curve.

    Hexagonal cells of area (sqrt 3/2) a^2 at the distance a = D_s (1 - x): V = V_jam/(1 - x)^2 with D_s = sqrt(n) D
    sqrt(0.9069/V_jam); the mean stress of such a lattice under forces f a length is p = sqrt(3) f/a, so phi = f/(k'
    sqrt(n) D) ... in the unit of D_s: phi = P (1 - x)/sqrt(3).
    """
    x = 1 - np.sqrt(state.fraction[0] / state.fraction)
    scale = (1 - x) / math.sqrt(3)
    load, unload = (np.maximum.accumulate(a * scale) for a in (state.load, state.unload))
    return Table(x, load, np.minimum(unload, load), math.sqrt(HEXAGONAL / float(state.fraction[0])))


def recalibrated(table: Table, wanted: State, answered: State) -> Table:
    """A better law of contact: phi(x) times what the filaments answer over what discs with it answered.

    At the overlap x discs are as dense as V = V_jam/(1 - x)^2, with V_jam where they jammed; the ratio is taken from
    P a volume fraction beyond the jam, over what the first and last rows know. Iterated it makes a cell of discs answer
    as the cell of filaments does.
    """
    jam = float(answered.fraction[0])
    fraction = jam / (1 - table.overlap) ** 2
    beyond = fraction - jam
    target = np.interp(beyond, wanted.fraction - wanted.fraction[0], wanted.load)
    got = np.interp(beyond, answered.fraction - jam, answered.load)
    known = (
        (beyond > 0.01) & (beyond < answered.fraction[-1] - jam) & (beyond < wanted.fraction[-1] - wanted.fraction[0])
    )
    # a few runs are noisy: the ratio's logarithm as a parabola, held beyond what is known
    x = table.overlap
    shape = np.polynomial.Polynomial.fit(x[known], np.log(target[known] / got[known]), 2)
    ratio = np.exp(shape(np.clip(x, x[known][0], x[known][-1])))
    return Table(x, np.maximum.accumulate(table.load * ratio), None, table.size)


def lateral_ratio(across: Sequence[FloatArray], down: Sequence[FloatArray]) -> float:
    """Stress across over stress down of cells squeezed from above alone, by least squares over all rows of all runs."""
    a, d = np.concatenate(list(across)), np.concatenate(list(down))
    if not np.sum(d**2) > 0:
        raise InputError("down", float(np.sum(d)), "stresses above zero")
    return float(np.sum(a * d) / np.sum(d**2))


# --- straight pieces -------------------------------------------------------------------------------------------------


def _basis(strain: FloatArray, knees: Sequence[float]) -> FloatArray:
    return np.stack([strain, *(np.maximum(strain - k, 0.0) for k in knees)], axis=-1)


def _steps(moduli: FloatArray) -> FloatArray:
    return np.concatenate([moduli[:1], np.diff(moduli)])


def _misfit(strain: FloatArray, stress: FloatArray, knees: Sequence[float]) -> tuple[float, FloatArray]:
    basis = _basis(strain, knees)
    step = np.linalg.lstsq(basis, stress, rcond=None)[0]
    return float(np.sum((basis @ step - stress) ** 2)), np.cumsum(step)


def multi_linear(strain: ArrayLike, stress: ArrayLike, knees: int = 2) -> MultiLinear:
    """Straight pieces through the origin with the ``knees`` that fit best, by least squares (thesis 7.3.4: two knees).

    For given knees the moduli are linear least squares; the knees themselves come from trying all sets of candidates
    (beyond three knees: one more at a time), then a simplex. ``strain`` and ``stress`` (n,), rising strain. Raises
    InputError for fewer samples than a piece needs or unequal lengths.
    """
    x, y = np.asarray(strain, dtype=float), np.asarray(stress, dtype=float)
    if x.shape != y.shape or x.ndim != 1 or len(x) < 3 * (knees + 1):
        raise InputError("strain", x.shape, f"one dimension, as the stress, of at least {3 * (knees + 1)} samples")
    if knees < 0:
        raise InputError("knees", knees, "0 or more")
    low, high = float(x.min()), float(x.max())
    candidates = np.linspace(low, high, CANDIDATES + 2)[1:-1]
    best: tuple[float, ...] = ()
    tried = min(knees, EXHAUSTIVE)
    if tried:
        best = min(itertools.combinations(candidates.tolist(), tried), key=lambda k: _misfit(x, y, k)[0])
    while len(best) < knees:
        more = [tuple(sorted((*best, c))) for c in candidates.tolist() if c not in best]
        best = min(more, key=lambda k: _misfit(x, y, k)[0])
    if knees:

        def cost(k: FloatArray) -> float:
            inside = np.all(np.diff(np.concatenate([[low], k, [high]])) > 0)
            return _misfit(x, y, k.tolist())[0] if inside else math.inf

        found = minimize(
            cost, np.array(best), method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 0.0, "maxiter": 400}
        )
        if found.fun <= cost(np.array(best)):
            best = tuple(float(k) for k in found.x)
    misfit, moduli = _misfit(x, y, best)
    scale = float(np.max(np.abs(y)))
    return MultiLinear(best, tuple(moduli.tolist()), math.sqrt(misfit / len(x)) / scale if scale else 0.0)
