"""Signals of capstan friction tests: steady window, friction coefficients, stick-slip, means over trials and wraps.

Times in any unit, tensions in any one unit of force, wraps in rad. Raises :class:`cgfibre.errors.InputError` for
signals without what is asked of them. Section and equation numbers are those of Chakladar 2014.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy import stats

from cgfibre.errors import InputError
from cgfibre.measure.spectrum import LEAST, FloatArray, Line, checked, dominant_lines, highest_frequency, sinusoids

BLOCKS = 50
#: relative departure of a block's mean from the level that counts as steady, whatever the scatter
STEADY = 0.02
#: harmonics that a waveform may have
HARMONICS = 8
#: share of the swing between turning points that a repeating waveform must have to be taken for it
COHERENT = 0.5
#: share of its range by which a crosshead goes back where it turns
TURN = 0.2
#: scatters of a crest by which the first peak must stand out
FIRST_PEAK = 3.0


@dataclass(frozen=True)
class Branch:
    """Samples ``start`` to ``stop`` in which the crosshead goes one way: ``direction`` 1 up, -1 down."""

    start: int
    stop: int
    direction: int


def travel_branches(displacement: npt.ArrayLike) -> list[Branch]:
    """Branches of a crosshead's travel: it turns where it goes back by a fifth of its whole range."""
    d = np.asarray(displacement, dtype=np.float64)
    every = max(1, len(d) // 5000)
    x = d[::every]
    swing = TURN * float(np.ptp(x))
    if swing == 0:
        raise InputError("displacement", float(d[0]), "a crosshead that moves")
    turns, best, direction = [0], 0, 0
    for i in range(1, len(x)):
        if direction == 0:
            if abs(x[i] - x[0]) > swing:
                direction, best = int(np.sign(x[i] - x[0])), i
        elif direction * (x[i] - x[best]) > 0:
            best = i
        elif direction * (x[best] - x[i]) > swing:
            turns.append(best)
            direction, best = -direction, i
    edges = [t * every for t in turns] + [len(d)]
    first = int(np.sign(x[turns[1]] - x[0])) if len(turns) > 1 else direction
    return [Branch(a, b, first * (-1) ** k) for k, (a, b) in enumerate(pairwise(edges))]


def steady_window(time: FloatArray, force: FloatArray) -> tuple[float, float]:
    """The longest time in which block means of the force keep their level: (start, end).

    The record is cut into blocks of equal time; the level is the median of the block means of its second half, and a
    block keeps it within three scatters (from the differences of neighbours) or 2 %, whichever is more. The first block
    is never steady: sticking begins there.
    """
    n = min(BLOCKS, max(4, len(time) // LEAST))
    edges = np.linspace(time[0], time[-1], n + 1)
    at = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, n - 1)
    count = np.bincount(at, minlength=n)
    with np.errstate(invalid="ignore"):
        means = np.bincount(at, force, n) / count
    half = means[n // 2 :]
    half = half[np.isfinite(half)]
    level = float(np.median(half))
    # of neighbours' differences: a drift is no scatter
    scatter = 1.4826 / math.sqrt(2) * float(np.median(np.abs(np.diff(half))))
    band = max(3 * scatter, STEADY * abs(level))
    # a gap in the record does not end the window
    kept = (np.abs(means - level) <= band) | (count < max(5, len(time) // n // 10))
    kept[0] = False
    start, length = _longest(kept)
    if length == 0 or length < n // 5:
        raise InputError("--window", "auto", "a record that slides steadily for a fifth of its time; give the window")
    return float(edges[start]), float(edges[start + length])


def _longest(kept: npt.NDArray[np.bool_]) -> tuple[int, int]:
    padded = np.concatenate([[False], kept, [False]]).astype(np.int8)
    starts, ends = np.flatnonzero(np.diff(padded) == 1), np.flatnonzero(np.diff(padded) == -1)
    if not len(starts):
        return 0, 0
    k = int(np.argmax(ends - starts))
    return int(starts[k]), int(ends[k] - starts[k])


@dataclass(frozen=True)
class TrialFriction:
    """Friction of one pull.

    ``mu`` mean of ln(T/T1)/theta over the window (App A.1), ``deviation`` of its samples; ``mu_s0`` initial static
    coefficient, at the highest sample before the window (nan: none that stands out); ``mu_s`` and ``mu_k`` static and
    kinetic coefficient of the continuing stick-slip, its crests and troughs; ``amplitude`` (T_s - T_k)/mean T;
    ``lines`` of the spectrum; ``coherent``: crests and troughs are those of the waveform that repeats at the first
    line, else means of the turning points (which noise widens). ``drift`` relative change of T over the window;
    ``direction`` 1: pulled against the load, -1: let down.
    """

    window: tuple[float, float]
    samples: int
    mean_force: float
    mu: float
    deviation: float
    mu_s0: float
    mu_s: float
    mu_k: float
    amplitude: float
    lines: tuple[Line, ...]
    coherent: bool
    drift: float
    direction: int

    @property
    def frequency(self) -> float:
        """Stick-slip frequency: that of the strongest line, nan without one."""
        return self.lines[0].frequency if self.lines else math.nan


@dataclass(frozen=True)
class TestRig:
    """Tension of the slack side ``input_tension`` (in the unit of the force) and ``wrap`` (rad)."""

    __test__ = False  # no test of pytest's

    input_tension: float
    wrap: float

    def __post_init__(self) -> None:
        for name in ("input_tension", "wrap"):
            value = getattr(self, name)
            if not (value > 0 and math.isfinite(value)):
                raise InputError(name, value, "a positive number")

    def coefficients(self, force: FloatArray) -> FloatArray:
        """ln(T/T1)/theta of tensions, Eq 2-8 turned round."""
        return np.log(force / self.input_tension) / self.wrap


def trial_friction(
    time: npt.ArrayLike,
    force: npt.ArrayLike,
    rig: TestRig,
    window: tuple[float, float] | None = None,
    band: tuple[float, float] | None = None,
) -> TrialFriction:
    """Friction coefficients and stick-slip of one pull.

    ``window`` the steady part (times), else :func:`steady_window`; ``band`` the frequencies in which lines are looked
    for, else from five cycles in the window to :func:`highest_frequency`.
    Raises InputError where the force is not positive in the window, or the window holds too few samples.
    """
    t, f = checked(time, force)
    lo, hi = window or steady_window(t, f)
    inside = (t >= lo) & (t <= hi)
    n = int(np.sum(inside))
    if n < LEAST:
        whole = f"{LEAST} samples or more in it; the record spans {t[0]:.4g} to {t[-1]:.4g}"
        raise InputError("--window", f"{lo:.4g} to {hi:.4g}", whole)
    ts, fs = t[inside], f[inside]
    if np.any(fs <= 0):
        raise InputError("force", float(fs.min()), "positive tensions in the window (or another column or window)")
    x = rig.coefficients(fs)
    direction = 1 if x.mean() >= 0 else -1
    x = direction * x
    rise = np.polynomial.Polynomial.fit(ts, fs, 1)(ts[[0, -1]])
    span = float(ts[-1] - ts[0])
    straight = np.polynomial.Polynomial.fit(ts, x, 1)(ts)
    swing = x - straight
    lines = tuple(dominant_lines(ts, swing, band or (5 / span, highest_frequency(ts))))
    cycle = _crest_and_trough(ts, swing, lines)
    mu = float(x.mean())
    mu_s, mu_k = mu + cycle.crest, mu + cycle.trough
    before = f[(t < lo) & (f > 0)]
    mu_s0 = float(np.max(direction * rig.coefficients(before))) if len(before) else math.nan
    if not mu_s0 > mu_s + FIRST_PEAK * cycle.scatter:
        mu_s0 = math.nan
    ends = [rig.input_tension * math.exp(direction * m * rig.wrap) for m in (mu_s, mu_k)]
    return TrialFriction(
        (float(ts[0]), float(ts[-1])),
        n,
        float(fs.mean()),
        mu,
        float(x.std()),
        mu_s0,
        mu_s,
        mu_k,
        abs(ends[0] - ends[1]) / float(fs.mean()),
        lines,
        cycle.coherent,
        float((rise[1] - rise[0]) / fs.mean()),
        direction,
    )


@dataclass(frozen=True)
class _Cycle:
    """Mean crest and trough about the mean line, ``scatter`` of a crest, and whether a waveform repeats."""

    crest: float
    trough: float
    scatter: float
    coherent: bool


def _crest_and_trough(time: FloatArray, swing: FloatArray, lines: Sequence[Line]) -> _Cycle:
    turning = _turning_points(swing)
    if lines:
        wave = waveform(time, swing, lines[0].frequency)
        if np.ptp(wave) > COHERENT * (turning.crest - turning.trough):
            left = max(float(np.var(swing)) - float(np.var(wave)), 0.0)
            return _Cycle(float(wave.max()), float(wave.min()), math.sqrt(left), True)
    return turning


def _turning_points(swing: FloatArray) -> _Cycle:
    """Means of the highest points above and of the lowest points below the mean, one an excursion."""
    above = swing > 0
    if not above.any() or above.all():
        return _Cycle(0.0, 0.0, 0.0, False)
    edges = np.flatnonzero(np.diff(above.astype(np.int8))) + 1
    starts = np.concatenate([[0], edges])
    highest, lowest = np.maximum.reduceat(swing, starts), np.minimum.reduceat(swing, starts)
    up = above[starts]
    return _Cycle(float(highest[up].mean()), float(lowest[~up].mean()), float(highest[up].std()), False)


def waveform(time: FloatArray, swing: FloatArray, frequency: float, points: int = 720) -> FloatArray:
    """One cycle (points,) of what repeats at a frequency: harmonics fitted by least squares, as many as the Bayesian
    information criterion bears out."""
    n = len(time)
    best = np.zeros(points)
    least = math.inf
    phase = np.arange(points) / points
    for k in range(1, HARMONICS + 1):
        if 2 * k + 1 > n // 4:
            break
        columns = sinusoids(time, [frequency * (j + 1) for j in range(k)])
        solution = np.linalg.lstsq(columns, swing, rcond=None)[0]
        left = float(np.sum((swing - columns @ solution) ** 2))
        criterion = n * math.log(max(left, 1e-300) / n) + 2 * k * math.log(n)
        if criterion < least:
            least = criterion
            best = sinusoids(np.concatenate([[0.0], phase]), np.arange(1, k + 1).tolist())[1:] @ solution
    return best


# --- several trials, several wraps -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Mean:
    """Mean of ``n`` trials with its 95 % interval, 1.96 s/sqrt(n) (section 3.3.3; nan for one), s ``deviation``."""

    mean: float
    interval: float
    deviation: float
    n: int


def mean_interval(values: Sequence[float]) -> Mean:
    """Mean over trials with its interval; values that are nan are no trials. All nan: a mean of nan."""
    x = np.array([v for v in values if math.isfinite(v)])
    if not len(x):
        return Mean(math.nan, math.nan, math.nan, 0)
    s = float(x.std(ddof=1)) if len(x) > 1 else math.nan
    return Mean(float(x.mean()), 1.96 * s / math.sqrt(len(x)), s, len(x))


@dataclass(frozen=True)
class WrapRegression:
    """Line ln(T2/T1) = mu theta through the origin: ``mu`` with its 95 % interval (Student's t); with a constant:
    ``slope``, ``intercept`` and the intercept's 95 % interval (nan with fewer than three points); ``r_squared`` of the
    line through the origin about the mean."""

    mu: float
    interval: float
    slope: float
    intercept: float
    intercept_interval: float
    r_squared: float
    n: int

    @property
    def belt_law_holds(self) -> bool:
        """Whether the intercept's interval holds zero, as T2/T1 = exp(mu theta) wants (True without an interval)."""
        return not abs(self.intercept) > self.intercept_interval


def wrap_regression(wrap: npt.ArrayLike, log_ratio: npt.ArrayLike) -> WrapRegression:
    """Belt law from pulls over several wraps (rad): regression of ln(T2/T1) on theta (section 3.4.4)."""
    theta, y = np.asarray(wrap, dtype=np.float64), np.asarray(log_ratio, dtype=np.float64)
    n = len(theta)
    if n < 2 or np.ptp(theta) == 0:
        raise InputError("--wrap", theta.tolist(), "two wraps or more that differ")
    mu = float(theta @ y / (theta @ theta))
    left = y - mu * theta
    error = math.sqrt(float(left @ left) / (n - 1) / float(theta @ theta))
    line = stats.linregress(theta, y)
    spread = float(np.sum((y - y.mean()) ** 2))
    r_squared = 1 - float(left @ left) / spread if spread > 0 else math.nan
    student = float(stats.t.ppf(0.975, n - 1))
    own = float(stats.t.ppf(0.975, n - 2)) * float(line.intercept_stderr) if n > 2 else math.nan
    return WrapRegression(mu, student * error, float(line.slope), float(line.intercept), own, r_squared, n)
