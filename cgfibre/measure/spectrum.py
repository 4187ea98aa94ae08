r"""Spectra of unevenly sampled signals: Lomb-Scargle, non-uniform DFT, finite Fourier expansion; dominant lines.

Times are in any unit, frequencies in its inverse (s and Hz). All three estimators are sums of exp(i 2 pi f t) over the
samples on one grid of frequencies (Eq 3-4 of Chakladar 2014, refined where asked for), done by a non-uniform fast
Fourier transform (FINUFFT, Barnett, Magland and af Klinteberg 2019) to 12 digits. Raises
:class:`cgfibre.errors.InputError` for signals that are too short, not finite or not in order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq, minimize_scalar
from scipy.special import gammaln

from cgfibre.errors import InputError

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

LEAST = 16  # samples
#: length of the mean phase vector beyond which samples follow a clock
REGULAR = 0.9
#: frequencies of a spectrum at most: 145 Hz of a record of 180 s
MOST_BINS = 2**17
_DIGITS = 1e-12


@dataclass(frozen=True)
class Grid:
    """Frequencies m df, m = 0 .. n - 1."""

    step: float
    n: int

    @property
    def frequencies(self) -> FloatArray:
        """(n,) frequencies."""
        return np.asarray(self.step * np.arange(self.n))


def checked(time: npt.ArrayLike, values: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Time (n,) and values (n,) as floats; InputError unless finite, in order, and at least LEAST over some time."""
    t, y = np.asarray(time, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if t.ndim != 1 or t.shape != y.shape:
        raise InputError("signal", (t.shape, y.shape), "times and values of one length")
    if len(t) < LEAST:
        raise InputError("signal", f"{len(t)} sample(s)", f"at least {LEAST} samples")
    if not (np.isfinite(t).all() and np.isfinite(y).all()):
        raise InputError("signal", "nan", "finite times and values")
    if np.any(np.diff(t) < 0):
        raise InputError("time", float(t[int(np.argmin(np.diff(t) >= 0)) + 1]), "times that do not go back")
    if not t[-1] > t[0]:
        raise InputError("time", float(t[0]), "times that differ")
    return t, y


def common_grid(time: FloatArray, oversampling: int = 1, highest: float | None = None) -> Grid:
    """Eq 3-4: 0 : 1/(N dt) : (N - 1)/(N dt) with dt = T/(N - 1); ``oversampling`` divides the step.

    At most MOST_BINS frequencies. T is the time from the first to the last sample. ``highest``: end there instead of
    at the mean sampling rate. Uneven samples carry frequencies beyond half the mean rate, evenly spaced ones mirror
    them (:func:`highest_frequency`).
    """
    n, span = len(time), float(time[-1] - time[0])
    step = (n - 1) / n / span / oversampling
    top = (n - 1) * step * oversampling if highest is None else highest
    return Grid(step, min(max(2, math.floor(top / step + 1e-9) + 1), MOST_BINS))


def highest_frequency(time: FloatArray) -> float:
    """Up to where lines can be told: Eq 3-4's end for uneven samples, half the clock's rate where a clock ticks.

    A clock ticks where the samples, gaps or not, add up in phase at the inverse of their median interval: all beyond
    half of that is a mirror image.
    """
    n, span = len(time), float(time[-1] - time[0])
    top = (n - 1) ** 2 / n / span
    tick = float(np.median(np.diff(time)))
    if tick <= 0:
        return top
    rates = np.linspace(-0.5, 0.5, 21) / span + 1 / tick
    in_phase = max(abs(complex(np.mean(np.exp(2j * np.pi * f * (time - time[0]))))) for f in rates)
    return min(top, 0.5 / tick) if in_phase > REGULAR else top


def exponential_sums(time: FloatArray, weights: npt.ArrayLike, grid: Grid) -> ComplexArray:
    """(k, n) sums over samples of w exp(-i 2 pi f (t - t_0)) for each of the weights (k, N), t_0 the first time."""
    import finufft

    x = 2 * np.pi * grid.step * (time - time[0])
    w = np.ascontiguousarray(np.atleast_2d(np.asarray(weights, dtype=np.complex128)))
    modes = 2 * grid.n
    sums = finufft.nufft1d1(np.mod(x + np.pi, 2 * np.pi) - np.pi, w, modes, eps=_DIGITS, isign=-1, nthreads=1)
    return np.asarray(np.atleast_2d(sums)[:, grid.n :], dtype=np.complex128)


# --- the three estimators --------------------------------------------------------------------------------------------


def lomb_scargle(time: FloatArray, values: FloatArray, grid: Grid) -> FloatArray:
    """Share of the variance that a sinusoid with a floating mean takes away at each frequency (n,), 0 to 1.

    Eq 3-1 fitted by least squares (Lomb, Scargle; the floating mean after Zechmeister and Kuerster 2009); 0 at f = 0.
    """
    y = values - values.mean()
    n = len(y)
    total = float(y @ y)
    if total <= 1e-24 * float(values @ values):  # a constant has no lines
        return np.zeros(grid.n)
    ones = np.ones(n)
    s = exponential_sums(time, [y, ones], grid)
    twice = exponential_sums(time, ones, Grid(2 * grid.step, grid.n))[0]
    yc, ys = s[0].real / n, -s[0].imag / n
    c, si = s[1].real / n, -s[1].imag / n
    cc = 0.5 * (1 + twice.real / n) - c**2
    ss = 0.5 * (1 - twice.real / n) - si**2
    cs = -0.5 * twice.imag / n - c * si
    det = cc * ss - cs**2
    safe = det > 1e-9
    power = np.zeros(grid.n)
    power[safe] = (ss * yc**2 + cc * ys**2 - 2 * cs * yc * ys)[safe] / det[safe] / (total / n)
    power[0] = 0.0
    return np.clip(power, 0.0, 1.0)


def nonuniform_dft(time: FloatArray, values: FloatArray, grid: Grid) -> FloatArray:
    """Amplitude 2/N |sum_n p_n exp(-i 2 pi f t_n)| at each frequency (n,), Eq 3-2; 0 at f = 0, the mean taken out.

    On Eq 3-4's grid f = m (N - 1)/(N T); the thesis prints m/T, which differs by 1 part in N.
    """
    amplitude = 2 / len(time) * np.abs(exponential_sums(time, values - values.mean(), grid)[0])
    amplitude[0] = 0.0
    return amplitude


def trapezoid_weights(time: FloatArray) -> FloatArray:
    """Weights (N,) of the trapezoidal rule over uneven samples: half the time to either neighbour."""
    step = np.diff(time)
    return 0.5 * (np.concatenate([step, [0.0]]) + np.concatenate([[0.0], step]))


def fourier_expansion(time: FloatArray, values: FloatArray, grid: Grid) -> FloatArray:
    """Amplitude sqrt(a^2 + b^2) of the finite Fourier expansion at each frequency (n,), Eq 3-3, App A.3.

    a, b = 2/T int f cos, sin dt by the trapezoidal rule over the uneven samples; the mean (by the same rule) taken out.
    """
    w = trapezoid_weights(time)
    span = float(time[-1] - time[0])
    mean = float(w @ values) / span
    amplitude = 2 / span * np.abs(exponential_sums(time, w * (values - mean), grid)[0])
    amplitude[0] = 0.0
    return amplitude


# --- significance ----------------------------------------------------------------------------------------------------


def false_alarm_probability(power: float, n: int, spread: float, highest: float) -> float:
    """Probability that white noise shows this Lomb-Scargle power or more anywhere below ``highest``.

    Baluev's (2008) bound for a sinusoid with a floating mean: with z the power, f = (1 - z)^((N-3)/2) for one frequency
    and tau = gamma W (1 - z)^((N-4)/2) sqrt((N-1) z/2) crossings, W = highest sqrt(4 pi var t), 1 - (1 - f) exp(-tau).
    ``n`` samples whose times have the standard deviation ``spread``.
    """
    z = min(max(power, 0.0), 1.0)
    if z >= 1.0:
        return 0.0
    log_rest = math.log1p(-z)
    single = math.exp(0.5 * (n - 3) * log_rest)
    gamma = math.sqrt(2 / (n - 1)) * math.exp(float(gammaln((n - 1) / 2) - gammaln((n - 2) / 2)))
    width = highest * math.sqrt(4 * math.pi) * spread
    tau = gamma * width * math.exp(0.5 * (n - 4) * log_rest) * math.sqrt(0.5 * (n - 1) * z)
    return min(1.0, -math.expm1(-tau) + single * math.exp(-tau))


def significance_level(probability: float, n: int, spread: float, highest: float) -> float:
    """Lomb-Scargle power that white noise passes anywhere below ``highest`` with this probability."""
    if not 0 < probability < 1:
        raise InputError("probability", probability, "between 0 and 1")

    def excess(power: float) -> float:
        return math.log(max(false_alarm_probability(power, n, spread, highest), 1e-300)) - math.log(probability)

    # below its largest the bound is no probability; search down from 1
    low = max(1e-6, 1.0 / n)
    return float(brentq(excess, low, 1 - 1e-12)) if excess(low) > 0 else low


@dataclass(frozen=True)
class Spectra:
    """The three estimators (n,) of one signal on one grid.

    ``lomb_scargle`` power 0 to 1, ``dft`` and ``expansion`` amplitudes in the unit of the values; ``levels`` pairs of a
    false-alarm probability and the power that noise passes with it.
    """

    frequency: FloatArray
    lomb_scargle: FloatArray
    dft: FloatArray
    expansion: FloatArray
    levels: tuple[tuple[float, float], ...]


def all_spectra(
    time: FloatArray, values: FloatArray, oversampling: int = 5, probabilities: Sequence[float] = (0.05, 0.001)
) -> Spectra:
    """Lomb-Scargle, non-uniform DFT and finite Fourier expansion of a signal, a straight line taken out of it."""
    t, y = checked(time, values)
    swing = y - np.polynomial.Polynomial.fit(t, y, 1)(t)
    grid = common_grid(t, oversampling)
    f = grid.frequencies
    levels = tuple((p, significance_level(p, len(t), float(np.std(t)), float(f[-1]))) for p in probabilities)
    return Spectra(
        f, lomb_scargle(t, swing, grid), nonuniform_dft(t, swing, grid), fourier_expansion(t, swing, grid), levels
    )


# --- lines -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Line:
    """A sinusoid in a signal: ``frequency`` and its standard error, ``amplitude`` (half of peak to peak), probability
    that noise alone makes it; ``harmonic_of``: (index of a line, multiple) where it lies on one."""

    frequency: float
    error: float
    amplitude: float
    probability: float
    harmonic_of: tuple[int, int] | None = None


def sinusoids(time: FloatArray, frequencies: Sequence[float]) -> FloatArray:
    """(N, 1 + 2 k) columns: 1, cos and sin of each frequency."""
    phase = 2 * np.pi * np.outer(time - time[0], frequencies)
    return np.concatenate([np.ones((len(time), 1)), np.cos(phase), np.sin(phase)], axis=1)


def _residual(time: FloatArray, values: FloatArray, frequencies: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """What a least-squares fit of sinusoids leaves (N,), and their amplitudes (k,)."""
    columns = sinusoids(time, frequencies)
    solution = np.linalg.lstsq(columns, values, rcond=None)[0]
    k = len(frequencies)
    return values - columns @ solution, np.hypot(solution[1 : 1 + k], solution[1 + k :])


def refined_peak(time: FloatArray, values: FloatArray, start: float, step: float) -> float:
    """Frequency within ``step`` of ``start`` at which one sinusoid leaves the least squares."""

    def left(frequency: float) -> float:
        r = _residual(time, values, [frequency])[0]
        return float(r @ r)

    lo, hi = max(start - step, step * 1e-3), start + step
    return float(minimize_scalar(left, bounds=(lo, hi), method="bounded", options={"xatol": 1e-5 * step}).x)


def strongest(frequency: FloatArray, spectrum: FloatArray, band: tuple[float, float]) -> int:
    """Index of the largest value of a spectrum within a band of frequencies."""
    inside = np.flatnonzero((frequency >= band[0]) & (frequency <= band[1]))
    if not len(inside):
        raise InputError("--band", f"{band[0]:.4g} to {band[1]:.4g}", f"frequencies from 0 to {frequency[-1]:.4g}")
    return int(inside[np.argmax(spectrum[inside])])


def peak_frequency(frequency: FloatArray, spectrum: FloatArray, band: tuple[float, float]) -> float:
    """Frequency of the largest value of a spectrum in a band, by a parabola through it and its neighbours."""
    k = strongest(frequency, spectrum, band)
    if not 0 < k < len(frequency) - 1:
        return float(frequency[k])
    a, b, c = spectrum[k - 1 : k + 2]
    bend = a - 2 * b + c
    return float(frequency[k] + (frequency[1] - frequency[0]) * (0.5 * (a - c) / bend if bend < 0 else 0.0))


def dominant_lines(
    time: FloatArray,
    values: FloatArray,
    band: tuple[float, float],
    most: int = 5,
    probability: float = 1e-3,
    oversampling: int = 5,
) -> list[Line]:
    """Lines of a signal in a band, strongest first: each found by Lomb-Scargle in what the earlier ones leave.

    A line is one that noise shows with less than ``probability``. Its frequency's standard error is that of a sinusoid
    in white noise, sqrt(6/N) sigma/(pi T A) (Montgomery and O'Donoghue 1999), sigma being what all lines leave. A line
    closer than 1/T to an earlier one is not resolved and ends the search.
    """
    t, y = checked(time, values)
    grid = common_grid(t, oversampling, band[1])
    span, spread = float(t[-1] - t[0]), float(np.std(t))
    found: list[tuple[float, float]] = []
    left = y - y.mean()
    while len(found) < most:
        power = lomb_scargle(t, left, grid)
        k = strongest(grid.frequencies, power, band)
        chance = false_alarm_probability(float(power[k]), len(t), spread, band[1])
        if not chance < probability:
            break
        f = refined_peak(t, left, grid.step * k, grid.step)
        if any(abs(f - g) < 1 / span for g, _ in found):
            break
        found.append((f, chance))
        left = _residual(t, y, [g for g, _ in found])[0]
    if not found:
        return []
    amplitudes = _residual(t, y, [f for f, _ in found])[1]
    noise = float(np.std(left))
    lines: list[Line] = []
    for (f, chance), a in zip(found, amplitudes.tolist(), strict=True):
        error = math.sqrt(6 / len(t)) * noise / (math.pi * span * a) if a > 0 else math.inf
        lines.append(Line(f, error, a, chance, _harmonic(f, lines, 2 / span)))
    return lines


def _harmonic(frequency: float, lines: Sequence[Line], tolerance: float) -> tuple[int, int] | None:
    for i, line in enumerate(lines):
        multiple = round(frequency / line.frequency)
        if multiple > 1 and line.harmonic_of is None and abs(frequency - multiple * line.frequency) < tolerance:
            return i, multiple
    return None
