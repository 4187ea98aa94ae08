"""A compaction test of a tow: from force, displacement and width to pressure, strain, laws, zones and bands.

Units here: um, nN and kPa in (of displacement, width, anvil and force), MPa for every pressure out, as the thesis' laws
take them. Strain is that of the thickness, (t0 - t)/t0, compression positive.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import special
from scipy.optimize import least_squares, minimize, minimize_scalar

from cgfibre.build.system import FloatArray, IntArray
from cgfibre.errors import InputError
from cgfibre.measure import compaction
from cgfibre.measure.compaction import Hysteresis, PowerLaw
from cgfibre.mechanics.compaction_laws import THESIS_LAW, AlignedBed, Conditions, EmpiricalLaw, FibreBed

#: MPa of one kPa
MPA = 1e-3
#: below this part of the largest force a record counts as approach, if it is that long
APPROACH, LEAST_APPROACH = 1e-3, 10
#: laws are fitted from this part of the peak pressure on: below, the strain is that of finding the touch
LEAST_PART = 1e-3
#: samples of loading that a test needs
LEAST_SAMPLES = 8
#: a displacement may go back by this part of its range (noise) before the record counts as not a single cycle
BACKLASH = 0.02
#: points at which zones are fitted, equally many in each decade
ZONE_POINTS = 60


@dataclass(frozen=True)
class TowTest:
    """One test, from touching on: loading, then unloading.

    ``displacement`` um from where the anvil touched, ``force`` nN, ``width`` um, ``thickness`` um, ``strain``,
    ``pressure`` MPa, all (n,); ``turn`` the number of samples of loading; ``initial_width`` um, mean up to the touch.
    """

    displacement: FloatArray
    force: FloatArray
    width: FloatArray
    thickness: FloatArray
    strain: FloatArray
    pressure: FloatArray
    turn: int
    initial_width: float

    @property
    def loading(self) -> slice:
        """The samples of loading."""
        return slice(0, self.turn)

    @property
    def window(self) -> tuple[float, float]:
        """Pressures that laws are fitted to where none are asked for: from :data:`LEAST_PART` of the peak on, MPa."""
        peak = float(self.pressure[self.turn - 1])
        return LEAST_PART * peak, peak

    def power_law(self, window: tuple[float, float] | None = None) -> PowerLaw:
        """eps = a p^b of the loading branch (thesis Eq 5-1), p in MPa; ``window`` of pressures to use."""
        return compaction.fit_power_law(self.pressure[self.loading], self.strain[self.loading], window or self.window)

    def poisson_ratio(self) -> FloatArray:
        """(n,) widening over thinning, (w/w0 - 1)/eps (thesis Eq 5-3); nan where eps <= 0."""
        lateral = self.width / self.initial_width - 1
        return np.divide(lateral, self.strain, out=np.full(len(lateral), np.nan), where=self.strain > 0)

    def hysteresis(self) -> Hysteresis:
        """Work of the cycle, nN um: done, given back, lost."""
        phase = np.where(np.arange(len(self.force)) < self.turn, 0, 2)
        return compaction.hysteresis(self.displacement, self.force, phase)

    def modulus(self, window: int = 7) -> FloatArray:
        """(turn,) slope dp/deps of loading through ``window`` samples, MPa (the second way of thesis 5.3.2)."""
        odd = min(window, self.turn - (self.turn + 1) % 2)
        return compaction.tangent_modulus(self.strain[self.loading], self.pressure[self.loading], odd)


#: ways of finding where the anvil touches
TOUCHES = ("noise", "record", "fit")


@dataclass(frozen=True)
class Geometry:
    """What a record does not say: ``anvil`` um along the tow, ``initial_thickness`` um where the anvil touches, and how
    that place is found.

    ``touch`` is "noise" (the force leaves its own scatter, :func:`first_touch`), a force in nN, "record" (where the
    displacement is 0) or "fit" (the displacement u0 of u = u0 + c p^b, by least squares). It matters: a tow is so soft
    at first that a thousandth of the force takes a fifth of the strain (b = 0.23). The best is a gauge that measures
    the gap, and a measured initial thickness: "record".
    """

    anvil: float
    initial_thickness: float
    touch: float | str = "noise"

    def __post_init__(self) -> None:
        for key in ("anvil", "initial_thickness"):
            if not (np.isfinite(getattr(self, key)) and getattr(self, key) > 0):
                raise InputError(key, getattr(self, key), "a length above 0 um")
        if isinstance(self.touch, str) and self.touch not in TOUCHES:
            raise InputError("touch", self.touch, f"a force, or one of {', '.join(TOUCHES)}")


@dataclass(frozen=True)
class Touch:
    """Where the anvil touches: ``index`` of the last sample without contact, ``offset`` nN of the load cell before."""

    index: int
    offset: float


def first_touch(force: ArrayLike, level: float | None = None) -> Touch:
    """The last sample before the largest force at which the force, less its offset, is not above ``level`` nN.

    Samples before the force has risen by :data:`APPROACH` of all it rises are the approach; the mean of their first
    half is the load cell's offset and five times its s.d. the default of ``level``. Fewer than :data:`LEAST_APPROACH`
    such samples: the record starts at the touch, offset and ``level`` are 0.
    Raises InputError where the force never is above the level.
    """
    f = np.asarray(force, dtype=float)
    peak = int(np.argmax(f))
    rise = f - np.median(f[:LEAST_APPROACH])
    lead = f[: int(np.argmax(rise > APPROACH * rise[peak]))] if rise[peak] > 0 else f[:0]
    offset, above = 0.0, 0.0 if level is None else level
    if len(lead) >= LEAST_APPROACH:
        half = lead[: len(lead) // 2]
        offset = float(half.mean())
        if level is None:
            above = 5 * float(half.std(ddof=1))
    if not f[peak] - offset > max(above, 0.0):
        raise InputError(
            "force", f"{f[peak] * 1e-9:.4g} N at most", "a record in which the anvil presses (force above 0)"
        )
    below = np.flatnonzero(f[: peak + 1] - offset <= above)
    return Touch(int(below[-1]) if len(below) else 0, offset)


def _zero(u: FloatArray, f: FloatArray, w: FloatArray, geometry: Geometry) -> tuple[int, float, float]:
    """(first sample, displacement there, offset of the force) of the touch."""
    level = None if isinstance(geometry.touch, str) else geometry.touch
    touch = first_touch(f, level)
    peak = int(np.argmax(f))
    if geometry.touch == "record":
        above = np.flatnonzero(u[: peak + 1] <= 0)
        return (int(above[-1]) if len(above) else 0), 0.0, touch.offset
    if geometry.touch != "fit":
        return touch.index, float(u[touch.index]), touch.offset
    loaded = slice(touch.index + 1, peak + 1)
    p = (f[loaded] - touch.offset) / w[loaded]
    use = p > LEAST_PART * p[-1]
    x, y = np.log(p[use] / p[-1]), u[loaded][use]
    if len(y) < LEAST_SAMPLES:
        raise InputError("force", f"{len(y)} samples of loading", f"at least {LEAST_SAMPLES} to fit the touch")

    def lines(b: float) -> tuple[float, FloatArray]:
        design = np.column_stack([np.ones(len(x)), np.exp(b * x)])
        found = np.linalg.lstsq(design, y, rcond=None)[0]
        return float(np.sum((design @ found - y) ** 2)), found

    b = minimize_scalar(lambda b: lines(b)[0], bounds=(0.02, 3.0), method="bounded", options={"xatol": 1e-6}).x
    start = float(lines(float(b))[1][0])
    before = np.flatnonzero(u[: peak + 1] <= start)
    return (int(before[-1]) if len(before) else 0), start, touch.offset


def _check_cycle(u: FloatArray, peak: int) -> None:
    """Refuse a displacement that goes back before the peak of the force or on again after it."""
    down, up = u[: peak + 1], u[peak:]
    for wrong, first in ((np.maximum.accumulate(down) - down, 0), (up - np.minimum.accumulate(up), peak)):
        if wrong.max() > BACKLASH * np.ptp(u):
            at = int(np.argmax(wrong)) + first + 1
            raise InputError(
                "displacement", f"turns, by {wrong.max():.4g} um at sample {at}", "one cycle: down, then up"
            )


def reduce_test(displacement: ArrayLike, force: ArrayLike, width: ArrayLike, geometry: Geometry) -> TowTest:
    """Pressure and strain of a test record: one cycle of loading and (or not) unloading.

    ``displacement`` (n,) um rises as the anvil comes down, ``force`` (n,) nN, ``width`` of the tow um, one value or
    (n,). The pressure is that on the true contact area, F/(anvil x width), at each sample (thesis 5.2). Displacement
    and strain start where the anvil touches (:class:`Geometry`), the force loses the offset of the load cell.
    Raises InputError for fewer than :data:`LEAST_SAMPLES` samples of loading, a displacement that goes back before the
    largest force or on after it (more than one cycle), a width that is not above 0, and a tow pressed to nothing.
    """
    u, f = compaction._same_length(displacement=displacement, force=force)
    w = np.broadcast_to(np.asarray(width, dtype=float), u.shape)
    for key, values in (("displacement", u), ("force", f), ("width", w)):
        if not np.all(np.isfinite(values)):
            raise InputError(key, "not finite", "finite numbers only")
    if not np.all(w > 0):
        raise InputError("width", float(w.min()), "above 0 um")
    if len(u) < LEAST_SAMPLES:
        raise InputError("force", f"{len(u)} samples", f"at least {LEAST_SAMPLES} from touch to peak")
    begin, zero, offset = _zero(u, f, w, geometry)
    turn = int(np.argmax(f)) + 1 - begin
    if turn < LEAST_SAMPLES:
        raise InputError("force", f"{turn} samples of loading", f"at least {LEAST_SAMPLES} from touch to peak")
    _check_cycle(u, int(np.argmax(f)))
    first_width = float(w[: begin + 1].mean())
    u, f, w = u[begin:] - zero, f[begin:] - offset, w[begin:]
    thickness = geometry.initial_thickness - u
    if thickness.min() <= 0:
        least = f"above the {u.max():.4g} um that the anvil went down after touching"
        raise InputError("initial_thickness", f"{geometry.initial_thickness:.4g} um", least)
    pressure = MPA * compaction.pressure(np.maximum(f, 0.0), geometry.anvil * w)
    strain = compaction.compressive_strain(u, geometry.initial_thickness)
    return TowTest(u, f, w, thickness, strain, pressure, turn, first_width)


# --- zones of the curve ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Zones:
    """Straight pieces of ln eps against ln p: void closure, bending, flattening, as far as the data tell them apart.

    ``breaks`` (m - 1,) pressures MPa where the slope changes, ``strains`` (m - 1,) there, ``slopes`` (m,) the exponents
    b of each piece and ``slope_errors`` (m,) their standard errors; ``bic`` (k -> value) of the fits with 1, 2 and 3
    pieces, of which the least was taken.
    """

    breaks: FloatArray
    strains: FloatArray
    slopes: FloatArray
    slope_errors: FloatArray
    bic: dict[int, float]


def _bins(x: FloatArray, count: int) -> IntArray:
    """Bin of each point, of equal width in x, numbered without gaps."""
    bins = np.minimum(((x - x[0]) / (x[-1] - x[0]) * count).astype(int), count - 1)
    return np.unique(bins, return_inverse=True)[1]


def _thinned(x: FloatArray, y: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Means of the points in equal bins of x, so that every decade of pressure counts alike."""
    bins = _bins(x, count)
    n = np.bincount(bins)
    return np.bincount(bins, x) / n, np.bincount(bins, y) / n


def find_zones(pressure: ArrayLike, strain: ArrayLike, most: int = 3) -> Zones:
    """Continuous straight pieces of ln eps against ln p, 1 to ``most`` of them, breaks by least squares over all.

    Points are weighted so that equal bins of ln p count alike. Every set of breaks on the bins' means with three bins
    and more a piece is tried, the best one refined on the points themselves. The number of pieces is that of the least
    Bayesian information criterion n ln(mean square) + 2 m ln n, n the number of bins (neighbouring samples are not
    independent), m pieces having m slopes, an intercept and m - 1 breaks.
    Raises InputError for fewer than 12 distinct positive samples or ``most`` outside 1 to 3.
    """
    if most not in (1, 2, 3):
        raise InputError("most", most, "1, 2 or 3 pieces")
    p, eps = compaction._same_length(pressure=pressure, strain=strain)
    use = (p > 0) & (eps > 0)
    if np.unique(p[use]).size < 12:
        raise InputError("pressure", f"{int(use.sum())} samples", "at least 12 of positive pressure and strain")
    order = np.argsort(p[use], kind="stable")
    x, y = np.log(p[use][order]), np.log(eps[use][order])
    bins = _bins(x, ZONE_POINTS)
    coarse, means = _thinned(x, y, ZONE_POINTS)
    n = len(coarse)
    root = np.sqrt(1.0 / np.bincount(bins)[bins])

    def left(knots: FloatArray) -> float:
        knots = np.sort(knots)
        if np.any(np.diff(np.concatenate([[x[0]], knots, [x[-1]]])) <= 0):
            return math.inf
        design = _hinges(x, knots) * root[:, None]
        return float(np.sum((design @ np.linalg.lstsq(design, y * root, rcond=None)[0] - y * root) ** 2))

    fits: dict[int, tuple[float, FloatArray]] = {}
    for pieces in range(1, most + 1):
        tried = []
        for at in _break_sets(n, pieces):
            rss = np.linalg.lstsq(_hinges(coarse, coarse[list(at)]), means, rcond=None)[1]
            tried.append((float(rss[0]) if len(rss) else 0.0, at))
        if not tried:
            break
        knots = coarse[list(min(tried)[1])]
        if pieces > 1:
            knots = np.sort(minimize(left, knots, method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 0.0}).x)
        fits[pieces] = left(knots), knots
    floor = 1e-20 * float(np.sum((means - means.mean()) ** 2))
    bic = {m: n * math.log(max(rss, floor) / n) + 2 * m * math.log(n) for m, (rss, _) in fits.items()}
    best = min(bic, key=lambda m: (bic[m], m))
    least, knots = fits[best]
    design = _hinges(x, knots) * root[:, None]
    coefficients = np.linalg.lstsq(design, y * root, rcond=None)[0]
    covariance = np.linalg.inv(design.T @ design) * least / max(n - 2 * best, 1)
    sums = np.tril(np.ones((best, best)))  # a slope is the sum of the changes up to it
    return Zones(
        breaks=np.exp(knots),
        strains=np.exp(_hinges(knots, knots) @ coefficients),
        slopes=sums @ coefficients[1:],
        slope_errors=np.sqrt(np.diag(sums @ covariance[1:, 1:] @ sums.T)),
        bic=bic,
    )


def _hinges(x: FloatArray, knots: FloatArray) -> FloatArray:
    return np.column_stack([np.ones(len(x)), x, *(np.maximum(x - k, 0.0) for k in knots)])


def _break_sets(n: int, pieces: int) -> list[tuple[int, ...]]:
    """Indices of inner points that leave three points and more in every piece."""
    inner = range(3, n - 3)
    if pieces == 1:
        return [()]
    if pieces == 2:
        return [(i,) for i in inner]
    return [(i, j) for i in inner for j in range(i + 3, n - 3)]


# --- trials ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class MeanCurve:
    """Mean strain of several trials at the same pressures.

    ``pressure`` (m,) MPa, ``strain`` (m,), ``sd`` (m,) of the trials, ``half_width`` (m,) of the confidence band of the
    mean, ``n`` trials; nan half widths for a single one.
    """

    pressure: FloatArray
    strain: FloatArray
    sd: FloatArray
    half_width: FloatArray
    n: int


def mean_curve(tests: Sequence[TowTest], points: int = 60, confidence: float = 0.95) -> MeanCurve:
    """Mean of loading branches on a common logarithmic grid of pressures, with a confidence band of the mean.

    The grid spans what all trials reached, of three decades. Band: t s/sqrt(n) with Student's t of n - 1
    (the thesis writes 1.96 in its place; for three trials t is 4.30). Strains at a pressure are linear between samples,
    at the first crossing. Raises InputError without tests, or where no pressure is common to all.
    """
    if not tests:
        raise InputError("tests", 0, "one test or more")
    high = min(float(np.max(t.pressure[t.loading])) for t in tests)
    low = max(float(np.min(p[p > 0])) for p in (t.pressure[t.loading] for t in tests))
    low = max(low, *(t.window[0] for t in tests))
    if not low < high:
        raise InputError("tests", f"pressures up to {high:.3g} MPa and from {low:.3g} MPa", "trials of a common range")
    grid = np.geomspace(low, high, points)
    grid[-1] = high
    strains = np.array(
        [compaction.thickness_at_pressure(t.strain[t.loading], t.pressure[t.loading], grid) for t in tests]
    )
    n = len(tests)
    sd = strains.std(axis=0, ddof=1) if n > 1 else np.full(points, np.nan)
    factor = float(special.stdtrit(n - 1, 0.5 + confidence / 2)) if n > 1 else np.nan
    return MeanCurve(grid, strains.mean(axis=0), sd, factor * sd / math.sqrt(n), n)


# --- the empirical law of a set of tests -------------------------------------------------------------------------

PARAMETERS = ("ln a0", "a1", "a2", "a3", "b")


@dataclass(frozen=True)
class LawFit:
    """The empirical law (thesis Eq 5-4) of a set of tests, with its uncertainty.

    ``law``; ``covariance`` (5, 5) of (ln a0, a1, a2, a3, b), zero where ``held`` (names of parameters that the tests
    cannot tell, kept at the thesis' values); ``rms`` and ``worst`` relative deviation of the strain; ``n_tests`` and
    ``n_samples`` used.
    """

    law: EmpiricalLaw
    covariance: FloatArray
    held: tuple[str, ...]
    rms: float
    worst: float
    n_tests: int
    n_samples: int

    @property
    def errors(self) -> FloatArray:
        """(5,) standard errors of (ln a0, a1, a2, a3, b); that of a0 is a0 times that of ln a0."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> FloatArray:
        """(5, 5) correlation of the parameters; nan beside those held."""
        error = np.where(self.errors > 0, self.errors, np.nan)
        return self.covariance / error[:, None] / error[None, :]

    def strain_error(self, pressure: ArrayLike, at: Conditions) -> FloatArray:
        """Relative standard error of the predicted strain, sqrt(g C g) with g = d ln eps/d parameters."""
        g = _design(np.atleast_1d(np.asarray(pressure, dtype=float)), at)
        return np.sqrt(np.einsum("ni,ij,nj->n", g, self.covariance, g))


def _design(pressure: FloatArray, at: Conditions) -> FloatArray:
    """(n, 5) derivatives of ln eps with respect to (ln a0, a1, a2, a3, b)."""
    one = np.ones(len(pressure))
    covariates = math.log(1 - at.twist), -math.log(at.tow), -math.log(1 + at.preload)
    return np.column_stack([one, *(c * one for c in covariates), np.log(pressure)])


def fit_empirical_law(
    tests: Sequence[TowTest], conditions: Sequence[Conditions], window: tuple[float, float] | None = None
) -> LawFit:
    """Fit eps = a0 (1 - tau)^a1 n^(-a2) (1 + l)^(-a3) p^b to the loading branches (thesis Eq 5-4, C.2).

    Least squares of ln eps, to which the law is linear; every test weighs the same, whatever its number of samples.
    Samples of a test are not independent: the covariance is the sandwich of the tests' summed scores (clusters, with
    the small-sample factor m/(m - k) of m tests, k parameters); only with at least two tests more than parameters, else
    that of independent samples, too small. A parameter whose quantity does not vary over the tests, or only together
    with those before it, is held at the thesis' value and named in ``held``.
    Raises InputError for lists of unequal length or no usable samples.
    """
    if len(tests) != len(conditions) or not tests:
        raise InputError("conditions", len(conditions), f"those of each of the {len(tests)} tests, one or more")
    rows, values, owner = [], [], []
    for k, (test, at) in enumerate(zip(tests, conditions, strict=True)):
        p, eps = test.pressure[test.loading], test.strain[test.loading]
        low, high = window or test.window
        use = (p > 0) & (eps > 0) & (p >= low) & (p <= high)
        rows.append(_design(p[use], at))
        values.append(np.log(eps[use]))
        owner.append(np.full(int(use.sum()), k))
    X, y, who = np.concatenate(rows), np.concatenate(values), np.concatenate(owner)
    count = np.bincount(who, minlength=len(tests))
    if np.any(count < 3):
        raise InputError("window", window, "at least three samples of positive pressure and strain in every test")
    weight = (len(y) / len(tests) / count)[who]
    free = _identifiable(X, weight)
    start = np.array([math.log(THESIS_LAW.a0), THESIS_LAW.a1, THESIS_LAW.a2, THESIS_LAW.a3, THESIS_LAW.b])
    held = [k for k in range(5) if k not in free]
    target = y - X[:, held] @ start[held]
    A, root = X[:, free], np.sqrt(weight)
    found = np.linalg.lstsq(A * root[:, None], target * root, rcond=None)[0]
    residual = target - A @ found
    bread = np.linalg.inv((A * weight[:, None]).T @ A)
    m, k = len(tests), len(free)
    if m >= k + 2:
        scores = np.array([np.sum((A * (weight * residual)[:, None])[who == t], axis=0) for t in range(m)])
        part = bread @ (scores.T @ scores) @ bread * m / (m - k)
    else:
        part = bread * float(np.sum(weight * residual**2)) / max(len(y) - k, 1)
    values_ = start.copy()
    values_[free] = found
    covariance = np.zeros((5, 5))
    covariance[np.ix_(free, free)] = part
    a0, a1, a2, a3, b = math.exp(values_[0]), *(float(v) for v in values_[1:])
    return LawFit(
        EmpiricalLaw(a0, a1, a2, a3, b),
        covariance,
        tuple(PARAMETERS[i] for i in held),
        float(np.sqrt(np.average(np.expm1(residual) ** 2, weights=weight))),
        float(np.max(np.abs(np.expm1(residual)))),
        m,
        len(y),
    )


def _identifiable(X: FloatArray, weight: FloatArray) -> list[int]:
    """Columns that are not, to 1e-6 of their spread, a combination of those before them (b comes before a1 to a3)."""
    free: list[int] = []
    root = np.sqrt(weight)
    for k in (0, 4, 1, 2, 3):
        column = X[:, k] * root
        if free:
            before = X[:, free] * root[:, None]
            rest = column - before @ np.linalg.lstsq(before, column, rcond=None)[0]
        else:
            rest = column
        if np.linalg.norm(rest) > 1e-6 * max(float(np.linalg.norm(column)), 1e-300):
            free.append(k)
    return sorted(free)


# --- laws of fibre beds ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class BedFit:
    """A law fitted to volume fraction against pressure.

    ``name``, the ``law``, ``rms`` relative deviation of the volume fraction, number of ``parameters`` fitted, ``aic`` =
    n ln(RSS/n) + 2 k; ``at_bound``: names of parameters that the data drive to the end of their range.
    """

    name: str
    law: FibreBed | AlignedBed
    rms: float
    parameters: int
    aic: float
    at_bound: tuple[str, ...]


#: largest volume fraction of parallel filaments, hexagonal: pi / (2 sqrt 3)
HEXAGONAL = math.pi / (2 * math.sqrt(3))


def fit_fibre_beds(pressure: ArrayLike, volume_fraction: ArrayLike) -> list[BedFit]:
    """van Wyk's, Toll's and Gutowski's laws fitted to a loading branch, the best first (by AIC).

    Least squares of ln Vf at the pressures given (MPa), by scipy: k and V0 of van Wyk (n = 3), k, n (1 to 60) and V0 of
    Toll, A, V0 and Va (up to 1) of Gutowski. Samples are averaged in bins of ln p: every decade counts alike.
    Raises InputError for fewer than 8 distinct positive samples, or volume fractions outside 0 to 1.
    """
    p, v = compaction._same_length(pressure=pressure, volume_fraction=volume_fraction)
    use = p > 0
    p, v = p[use], v[use]
    if np.unique(p).size < LEAST_SAMPLES:
        raise InputError("pressure", f"{len(p)} samples", f"at least {LEAST_SAMPLES} above 0")
    if not (np.all(v > 0) and np.all(v < 1)):
        expected = "between 0 and 1: the width, the thickness, the tow size or the filament's diameter is wrong"
        raise InputError("volume_fraction", f"{v.min():.3g} to {v.max():.3g}", expected)
    order = np.argsort(p, kind="stable")
    x, y = _thinned(np.log(p[order]), np.log(v[order]), ZONE_POINTS)
    p, top, low = np.exp(x), float(np.exp(y.max())), float(np.exp(y.min()))
    # each: names, start, lower and upper bounds of the logarithms of what is fitted
    scale = math.log(float(p.max()) / max(top**3 - 0.5 * low**3, 1e-12))
    bed = [("k", scale, scale - 80, scale + 80), ("V0", math.log(0.9 * low), math.log(1e-3), math.log(top))]
    cases: dict[str, tuple[list[tuple[str, float, float, float]], Callable[[FloatArray], FibreBed | AlignedBed]]] = {
        "van Wyk": (bed, lambda q: FibreBed(math.exp(q[0]), 3.0, math.exp(q[1]))),
        "Toll": (
            [*bed, ("n", math.log(7.0), 0.0, math.log(60.0))],
            lambda q: FibreBed(math.exp(q[0]), math.exp(q[2]), math.exp(q[1])),
        ),
        "Gutowski": (
            [
                ("A", math.log(0.01 * float(p.max())), math.log(float(p.max())) - 40, math.log(float(p.max())) + 10),
                ("V0 / Va", math.log(0.9 * low / min(1.1 * top, 0.999)), math.log(1e-3), math.log(0.999)),
                ("Va", math.log(min(1.1 * top, 0.999)), math.log(0.5 * top), 0.0),
            ],
            lambda q: AlignedBed(math.exp(q[0]), math.exp(q[1] + q[2]), math.exp(q[2])),
        ),
    }
    found = []
    for name, (free, make) in cases.items():
        names, start, lower, upper = (np.array(part) for part in zip(*free, strict=True))
        start = np.clip(start.astype(float), lower.astype(float) + 1e-6, upper.astype(float) - 1e-6)

        def miss(q: FloatArray, make: Callable[[FloatArray], FibreBed | AlignedBed] = make) -> FloatArray:
            return np.log(make(q).volume_fraction(p)) - y

        solved = least_squares(
            miss,
            start,
            bounds=(lower.astype(float), upper.astype(float)),
            x_scale="jac",
            max_nfev=2000,
        )
        rss, n = float(np.sum(solved.fun**2)), len(y)
        found.append(
            BedFit(
                name,
                make(solved.x),
                math.sqrt(rss / n),
                len(free),
                n * math.log(max(rss, 1e-30) / n) + 2 * len(free),
                tuple(str(names[i]) for i in np.flatnonzero(_near(solved.x, lower, upper))),
            )
        )
    return sorted(found, key=lambda f: f.aic)


def _near(x: FloatArray, lower: FloatArray, upper: FloatArray) -> np.ndarray:
    span = upper.astype(float) - lower.astype(float)
    return (x - lower.astype(float) < 1e-3 * span) | (upper.astype(float) - x < 1e-3 * span)
