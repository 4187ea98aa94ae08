"""Numbers of a compaction test: pressure, strain, power law, modulus, Poisson's ratio, hysteresis.

All functions take arrays. With forces in nN and lengths in um stresses are kPa; a power law keeps the unit of the
pressure it was fitted to (the thesis uses MPa).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cgfibre.build.system import FloatArray, IntArray
from cgfibre.errors import InputError
from cgfibre.mechanics.compaction_laws import Conditions, EmpiricalLaw

#: spread of the thickness at a pressure between laboratories: 22 of them, one fabric (the stress at a thickness: 42 %)
LABORATORIES = 0.04


@dataclass(frozen=True)
class PowerLaw:
    """Power law eps = a p^b of strain against pressure (thesis Eq 5-1), fitted in log space.

    ``a_error`` and ``b_error`` are standard errors; ``window`` is the (lowest, highest) pressure used, ``n_points`` the
    number of samples in it, ``r_squared`` the coefficient of determination of ln eps. ``a`` is in (unit of p)^-b.
    """

    a: float
    b: float
    a_error: float
    b_error: float
    window: tuple[float, float]
    n_points: int
    r_squared: float

    def strain(self, pressure: ArrayLike) -> FloatArray:
        """Strain eps = a p^b at ``pressure`` (unit of the fit), same shape (thesis Eq 5-1)."""
        return self.a * np.asarray(pressure, dtype=float) ** self.b

    def pressure(self, strain: ArrayLike) -> FloatArray:
        """Pressure p = (eps/a)^(1/b) at ``strain``, in the unit of the fit, same shape (inverse of thesis Eq 5-1)."""
        return (np.asarray(strain, dtype=float) / self.a) ** (1.0 / self.b)

    def modulus(self, strain: ArrayLike) -> FloatArray:
        """Tangent modulus dp/deps = (1/(a b)) (eps/a)^(1/b - 1), in the unit of the pressure (thesis Eq 5-2)."""
        return (np.asarray(strain, dtype=float) / self.a) ** (1.0 / self.b - 1.0) / (self.a * self.b)


@dataclass(frozen=True)
class Hysteresis:
    """Work of a loading-unloading cycle, in (unit of force) x (unit of displacement).

    ``loading`` done on the assembly, ``unloading`` given back, ``loss`` the area of the loop, ``fraction`` =
    loss/loading (nan where no work was done).
    """

    loading: float
    unloading: float

    @property
    def loss(self) -> float:
        """Area between the two branches."""
        return self.loading - self.unloading

    @property
    def fraction(self) -> float:
        """Loss over the work of loading."""
        return self.loss / self.loading if self.loading else float("nan")


def _positive(key: str, value: ArrayLike) -> FloatArray:
    array = np.asarray(value, dtype=float)
    if not np.all(array > 0):
        raise InputError(key, value, "above zero")
    return array


def _same_length(**arrays: ArrayLike) -> list[FloatArray]:
    out = [np.asarray(a, dtype=float) for a in arrays.values()]
    for name, a in zip(arrays, out, strict=True):
        if a.ndim != 1 or a.shape != out[0].shape:
            raise InputError(name, a.shape, f"one dimension of the length of {next(iter(arrays))}, {out[0].shape}")
    return out


def pressure(force: ArrayLike, area: ArrayLike) -> FloatArray:
    """Mean pressure p = F/A: kPa from nN and um2; arrays broadcast.

    The thesis takes A as the anvil's length times the measured width of the tow (5.2). Raises InputError for an area
    that is not above zero.
    """
    return np.asarray(force, dtype=float) / _positive("area", area)


def fibre_volume_fraction(n_filaments: int, diameter: float, width: ArrayLike, thickness: ArrayLike) -> FloatArray:
    """Volume fraction N (pi D^2/4)/(w t) of filaments in the rectangle that encloses the assembly.

    ``diameter``, ``width`` and ``thickness`` in um; the last two broadcast. For filaments of several diameters pass the
    root mean square. Raises InputError for a size that is not above zero.
    """
    area = _positive("width", width) * _positive("thickness", thickness)
    return n_filaments * np.pi * _positive("diameter", diameter) ** 2 / 4 / area


def compressive_strain(displacement: ArrayLike, initial_thickness: float) -> FloatArray:
    """Strain eps = displacement / initial thickness, compression positive. Raises InputError for a thickness <= 0."""
    return np.asarray(displacement, dtype=float) / _positive("initial_thickness", initial_thickness)


def fit_power_law(
    pressure: ArrayLike, strain: ArrayLike, window: tuple[float, float] | None = None, min_points: int = 3
) -> PowerLaw:
    """Fit eps = a p^b by least squares of ln eps = ln a + b ln p (thesis Eq 5-1).

    Parameters: ``pressure`` and ``strain`` (n,), loading only; ``window`` (lowest, highest) pressure to use, else all.
    Samples where either is not above zero have no logarithm and are left out. The errors are standard errors of the
    regression (a_error = a times that of ln a): samples of one run are correlated, so they are lower bounds.
    Raises InputError where fewer than ``min_points`` distinct pressures are left.
    """
    p, eps = _same_length(pressure=pressure, strain=strain)
    low, high = (0.0, np.inf) if window is None else window
    use = (p > 0) & (eps > 0) & (p >= low) & (p <= high)
    if np.unique(p[use]).size < max(min_points, 3):
        raise InputError("window", window, f"at least {max(min_points, 3)} samples of positive pressure and strain")
    x, y = np.log(p[use]), np.log(eps[use])
    (slope, intercept), covariance = np.polyfit(x, y, 1, cov=True)
    a = float(np.exp(intercept))
    return PowerLaw(
        a=a,
        b=float(slope),
        a_error=a * math.sqrt(max(covariance[1, 1], 0.0)),
        b_error=math.sqrt(max(covariance[0, 0], 0.0)),
        window=(float(p[use].min()), float(p[use].max())),
        n_points=int(use.sum()),
        r_squared=float(np.corrcoef(x, y)[0, 1]) ** 2,
    )


def tangent_modulus(strain: ArrayLike, pressure: ArrayLike, window: int = 5) -> FloatArray:
    """(n,) slope dp/deps of a record, by a straight line through ``window`` neighbouring samples (odd, at least 3).

    Near the ends the window keeps its width and stops being centred. nan where the strain does not vary in the window.
    Unit of the pressure. Raises InputError for a window that is even, below 3 or longer than the record.
    """
    eps, p = _same_length(strain=strain, pressure=pressure)
    if window < 3 or window % 2 == 0 or window > len(eps):
        raise InputError("window", window, f"an odd number from 3 to the {len(eps)} samples")
    x = np.lib.stride_tricks.sliding_window_view(eps, window)
    y = np.lib.stride_tricks.sliding_window_view(p, window)
    dx = x - x.mean(axis=1, keepdims=True)
    spread = (dx**2).sum(axis=1)
    slope = np.divide((dx * y).sum(axis=1), spread, out=np.full(len(x), np.nan), where=spread > 0)
    return slope[np.clip(np.arange(len(eps)) - window // 2, 0, len(x) - 1)]


def poisson_ratio(width: ArrayLike, thickness: ArrayLike) -> FloatArray:
    """(n,) overall Poisson's ratio eps_y/eps_z of the section: widening over thinning, each from the first sample.

    eps_y = (w - w0)/w0 and eps_z = (t0 - t)/t0 (thesis Eq 5-3, which names compaction y and width z). Positive where
    the bundle spreads; nan where it has not been compressed. Raises InputError for a first width or thickness <= 0.
    """
    w, t = _same_length(width=width, thickness=thickness)
    w0, t0 = _positive("width[0]", w[0]), _positive("thickness[0]", t[0])
    lateral, compressive = (w - w0) / w0, (t0 - t) / t0
    return np.divide(lateral, compressive, out=np.full(len(w), np.nan), where=compressive != 0)


def hysteresis(displacement: ArrayLike, force: ArrayLike, phase: IntArray) -> Hysteresis:
    """Work integral of F du over loading (with holding) and over unloading, by trapezoids.

    ``phase`` (n,): 0 loading, 1 holding, 2 unloading, in the order of the record; unloading starts at the sample before
    its first. Without unloading the work given back is zero. Raises InputError where loading follows unloading.
    """
    u, f = _same_length(displacement=displacement, force=force)
    back = np.asarray(phase) == 2
    if back.shape != u.shape or np.any(np.diff(back.astype(int)) < 0):
        raise InputError("phase", phase, f"{len(u)} values, no loading after unloading")
    turn = len(u) - int(back.sum())
    given_back = -np.trapezoid(f[max(turn - 1, 0) :], u[max(turn - 1, 0) :])
    return Hysteresis(loading=float(np.trapezoid(f[:turn], u[:turn])), unloading=float(given_back) + 0.0)


def thickness_at_pressure(thickness: ArrayLike, pressure: ArrayLike, at: ArrayLike) -> FloatArray:
    """Thickness at the first sample-to-sample crossing of each pressure ``at``, linearly between the two samples.

    ``thickness`` and ``pressure`` (n,) of the loading branch, in its order (the pressure may fall in between, as when a
    column buckles). nan for pressures below the first sample or never reached: nothing is extrapolated.
    """
    t, p = _same_length(thickness=thickness, pressure=pressure)
    wanted = np.asarray(at, dtype=float)
    flat = np.atleast_1d(wanted).ravel()
    out = np.full(flat.shape, np.nan)
    first = np.searchsorted(np.maximum.accumulate(p), flat)
    out[flat == p[0]] = t[0]
    inside = (first > 0) & (first < len(p))
    i = first[inside]
    share = (flat[inside] - p[i - 1]) / (p[i] - p[i - 1])
    out[inside] = t[i - 1] + share * (t[i] - t[i - 1])
    return out.reshape(wanted.shape)


@dataclass(frozen=True)
class ThicknessComparison:
    """Thickness over the initial one at fixed pressures, (n,) each: ours, the law's and the law's band.

    ``pressure`` MPa; ``measured`` is nan where a pressure was not reached; ``low`` and ``high`` hold the law's
    deviation and the scatter between laboratories (:data:`LABORATORIES` of the thickness).
    """

    pressure: FloatArray
    measured: FloatArray
    law: FloatArray
    low: FloatArray
    high: FloatArray

    @property
    def deviation(self) -> FloatArray:
        """Measured thickness over the law's, less one."""
        return np.asarray(self.measured / self.law - 1)

    @property
    def within(self) -> np.ndarray:
        """(n,) bool: the measured thickness lies in the band."""
        return (self.measured >= self.low) & (self.measured <= self.high)


def compare_thickness(
    thickness: ArrayLike, pressure: ArrayLike, law: EmpiricalLaw, conditions: Conditions, at: ArrayLike
) -> ThicknessComparison:
    """Thickness at the pressures ``at`` beside an empirical law's (thesis Eq 5-4), both over the initial thickness.

    ``thickness`` (n,) in any unit and ``pressure`` (n,) MPa of the loading branch in its order, from the first touch:
    its first thickness is the initial one. Thickness at a pressure is what tests of different laboratories agree on;
    the pressure at a thickness is not. Raises InputError for a pressure at which the law leaves nothing.
    """
    t, p = _same_length(thickness=thickness, pressure=pressure)
    wanted = np.atleast_1d(np.asarray(at, dtype=float))
    expected = law.thickness(1.0, wanted, conditions)
    low, high = law.thickness_band(wanted, conditions)
    measured = thickness_at_pressure(t / t[0], p, wanted)
    return ThicknessComparison(wanted, measured, expected, low * (1 - LABORATORIES), high * (1 + LABORATORIES))
