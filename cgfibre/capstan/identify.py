"""Friction coefficients from a capstan signal by least squares, and which of them the signal can fix at all.

The signal is x = ln(T2/T1)/theta, whose noise is even where that of T2 is relative. The model is the rigid belt
(:mod:`cgfibre.capstan.features`): x = mu(V (t - t0)). A coefficient is identifiable where its 95 % interval, from the
Jacobian at the solution and the scatter left, is within TOLERANCE.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from cgfibre.capstan.column import Column, pull
from cgfibre.capstan.features import COEFFICIENTS
from cgfibre.errors import InputError
from cgfibre.measure.signal import TestRig
from cgfibre.measure.spectrum import checked, dominant_lines, highest_frequency
from cgfibre.mechanics.stick_slip import StickSlipLaw

FloatArray = npt.NDArray[np.float64]

#: half width of the 95 % interval up to which a coefficient counts as identified
TOLERANCE = 0.005
#: what may be fitted beside the coefficients
OTHERS = ("start", "critical_slip", "drop_slip", "frequency", "restick")
#: samples and slips, in lengths of the first sticking, of the first stage of the fit; each next one is four times
#: longer: the phase of a cycle far away is a guess before the period is known from those nearby
FIRST_SAMPLES, FIRST_SLIPS = 80, 20.0
STARTS = 6
#: (mu_s - mu_k)/mu_s0 that are tried, from, to, how many: neighbours differ by a sixth of a cycle in four
RATIOS = (0.005, 0.6, 120)
#: steps of the finite differences in a coefficient: of the rigid belt, where hundreds of cycles on a larger one would
#: carry samples across a kink of the waveform, and of the column
STEP, COLUMN_STEP = 1e-11, 1e-4
#: coefficients of a column, in the order of its Jacobian
COLUMN_COEFFICIENTS = tuple(f"{where} {name}" for where in ("pulley", "between") for name in COEFFICIENTS)
#: longest part of a pull, in us, that the Jacobian of a column is worked out over
COLUMN_SPAN = 6e5


@dataclass(frozen=True)
class Estimate:
    """One parameter: ``value``, standard ``error`` (inf: the data say nothing), and whether it is identified."""

    name: str
    value: float
    error: float
    identifiable: bool

    @property
    def interval(self) -> float:
        """Half width of the 95 % interval."""
        return 1.96 * self.error


@dataclass(frozen=True)
class Identifiability:
    """What a Jacobian of n samples says: errors (k,) of the parameters, singular values (k,) largest first, and the
    combination of the parameters (k,) that the data fix worst."""

    names: tuple[str, ...]
    errors: FloatArray
    singular_values: FloatArray
    weakest: FloatArray

    def estimates(self, values: Sequence[float], tolerance: Sequence[float]) -> tuple[Estimate, ...]:
        """The parameters with their errors; identified where 1.96 errors are within the tolerance."""
        return tuple(
            Estimate(n, v, float(e), bool(1.96 * e <= t))
            for n, v, e, t in zip(self.names, values, self.errors, tolerance, strict=True)
        )

    @property
    def weakest_text(self) -> str:
        """The worst combination in words: "0.71 mu_s - 0.70 mu_k"."""
        parts = [(w, n) for w, n in zip(self.weakest.tolist(), self.names, strict=True) if abs(w) > 0.1]
        parts.sort(key=lambda p: -abs(p[0]))
        text = " ".join(f"{'+' if w >= 0 else '-'} {abs(w):.2f} {n}" for w, n in parts)
        return text.removeprefix("+ ")


def identifiability(names: Sequence[str], jacobian: FloatArray, noise: float) -> Identifiability:
    """Standard errors from the singular values of the Jacobian (n, k) and the noise's standard deviation.

    cov = noise^2 (J^T J)^-1. Directions whose singular value vanishes beside the largest are known no better than
    before: parameters that share in one have an infinite error.
    """
    u = np.asarray(jacobian, dtype=np.float64)
    _, s, v = np.linalg.svd(u, full_matrices=False)
    variance = np.zeros(u.shape[1])
    largest = s[0] if len(s) and s[0] > 0 else 1.0
    for value, direction in zip(s, v, strict=True):
        if value < 1e-9 * largest or value == 0:
            variance[np.abs(direction) > 1e-6] = np.inf
        else:
            variance += (noise * direction / value) ** 2
    return Identifiability(tuple(names), np.sqrt(variance), s, v[-1])


@dataclass(frozen=True)
class Identification:
    """What a fit found: the law, all estimates, the scatter ``noise`` of x, samples, and the Jacobian's verdict."""

    law: StickSlipLaw
    start: float
    estimates: tuple[Estimate, ...]
    noise: float
    n: int
    verdict: Identifiability

    def __getitem__(self, name: str) -> Estimate:
        return next(e for e in self.estimates if e.name == name)


class _Problem:
    """Signal and parameters: mu_s0; rho = (mu_s - mu_k)/mu_s0, which sets the period; mu_k over what it can be at most,
    mu_s0 (1 - rho); logarithms of factors of what else is fitted, the start in times of the first sticking."""

    def __init__(self, time: FloatArray, x: FloatArray, law: StickSlipLaw, free: tuple[str, ...]) -> None:
        self.time, self.x, self.law, self.free = time, x, law, free

    def law_of(self, p: FloatArray) -> tuple[StickSlipLaw, float]:
        mu_s0, rho, part = p[:3].tolist()
        mu_k = part * mu_s0 * (1 - rho)
        values = {"mu_k": mu_k, "mu_s": min(mu_k + rho * mu_s0, mu_s0), "mu_s0": mu_s0}
        start = 0.0
        for name, value in zip(self.free, p[3:].tolist(), strict=True):
            if name == "start":
                start = value * self.law.critical_slip / self.law.speed
            else:
                values[name] = getattr(self.law, name) * math.exp(value)
        return replace(self.law, **values), start

    def residual(self, p: FloatArray, upto: int | None = None) -> FloatArray:
        law, start = self.law_of(p)
        t = self.time[:upto]
        return law.coefficient(law.speed * np.maximum(t - start, 0.0)) - self.x[:upto]

    def cost(self, p: FloatArray, upto: int | None = None) -> float:
        r = self.residual(p, upto)
        return float(r @ r)

    def refined(self, p: FloatArray, upto: int) -> FloatArray:
        others = len(self.free)
        low = np.concatenate([[1e-3, 0.0, 1e-3], np.full(others, -3.0)])
        high = np.concatenate([[3.0, 0.95, 1.0], np.full(others, 3.0)])
        inside = np.clip(p, low + 1e-9, high - 1e-9)
        fit = least_squares(
            self.residual, inside, bounds=(low, high), x_scale="jac", diff_step=np.full(len(p), 1e-7), args=(upto,)
        )
        return np.asarray(fit.x)


def identify(
    time: npt.ArrayLike,
    force: npt.ArrayLike,
    rig: TestRig,
    law: StickSlipLaw,
    free: Sequence[str] = (),
) -> Identification:
    """Fit (mu_s0, mu_s, mu_k) to a signal that was pulled from rest at time 0.

    ``time`` in the law's unit, ``force`` in that of the rig's input tension; ``law`` gives what is not fitted and no
    start: that is searched over a grid, the stick-slip line of the spectrum being a help. ``free`` names more to fit
    (OTHERS; ``start`` is when the pull began). Raises InputError for a signal without positive tensions.
    """
    t, f = checked(time, force)
    unknown = [name for name in free if name not in OTHERS]
    if unknown:
        raise InputError("free", unknown[0], "one of " + ", ".join(OTHERS))
    if np.any(f <= 0):
        raise InputError("force", float(f.min()), "positive tensions")
    x = rig.coefficients(f)
    problem = _Problem(t, x, law, tuple(free))
    near = int(np.searchsorted(t, FIRST_SLIPS * law.critical_slip / law.speed))
    count = min(len(t), max(FIRST_SAMPLES, near))
    starts = _on_grid(problem, np.geomspace(*RATIOS).tolist(), count)
    while count < len(t):
        fitted = sorted((problem.refined(p, count) for p in starts), key=lambda p: problem.cost(p, count))
        starts = fitted[:STARTS]
        count = min(len(t), 4 * count)
    # where the spectrum has a line, the period is known at once
    starts += _on_grid(problem, _ratios_of_lines(problem), len(t))
    if not starts:
        raise InputError("force", float(x.mean()), "ln(T2/T1)/theta above 0: a signal pulled against the load")
    return _judged(problem, min((problem.refined(p, len(t)) for p in starts), key=problem.cost))


def _ratios_of_lines(problem: _Problem) -> list[float]:
    """(mu_s - mu_k)/mu_s0 whose cycle is a line of the spectrum, with the line's error to either side."""
    t, x, law = problem.time, problem.x, problem.law
    span = float(t[-1] - t[0])
    swing = x - np.polynomial.Polynomial.fit(t, x, 1)(t)
    ratios = []
    for line in dominant_lines(t, swing, (5 / span, highest_frequency(t)), most=2):
        ratio = law.restick * (law.speed / line.frequency - law.slip_length) / law.critical_slip
        if 0 < ratio < 1:
            ratios += [ratio * (1 + k * line.error / line.frequency) for k in (-1, 0, 1)]
    return ratios


def _on_grid(problem: _Problem, ratios: Sequence[float], count: int) -> list[FloatArray]:
    """The best points of a grid over mu_s0 and (mu_s - mu_k)/mu_s0 for the first samples; the mean is the signal's."""
    x, law = problem.x, problem.law
    level = float(x[len(x) // 3 :].mean())
    others = [0.0] * len(problem.free)
    found = []
    for ratio in ratios:
        for mu_s0 in (level * np.linspace(1.0, 2.2, 13)).tolist():
            drop = ratio * mu_s0
            stick = ratio * law.critical_slip / law.restick
            mean = drop * (0.5 * stick + 2 / math.pi * law.slip_length) / (stick + law.slip_length)
            mu_k = level - mean
            if 0 < mu_k and mu_k + drop <= mu_s0:
                p = np.array([mu_s0, ratio, mu_k / (mu_s0 - drop), *others])
                found.append((problem.cost(p, count), p))
    found.sort(key=lambda c: c[0])
    return [p for _, p in found[: 2 * STARTS]]


def _judged(problem: _Problem, p: FloatArray) -> Identification:
    law, start = problem.law_of(p)
    r = problem.residual(p)
    n, k = len(r), len(p)
    noise = math.sqrt(float(r @ r) / max(1, n - k))
    jacobian = np.empty((n, k))
    for j, name in enumerate(COEFFICIENTS):
        # a law must fall: from where there is no room for mu_s0 > mu_s > mu_k, the other way
        change = STEP if _room(law, name) >= STEP else -STEP
        other = replace(law, **{name: getattr(law, name) + change})
        moved = other.coefficient(law.speed * np.maximum(problem.time - start, 0.0)) - problem.x
        jacobian[:, j] = (moved - r) / (getattr(other, name) - getattr(law, name))
    for j in range(3, k):
        step = STEP * np.eye(k)[j]
        jacobian[:, j] = (problem.residual(p + step) - problem.residual(p - step)) / (2 * STEP)
    names = (*COEFFICIENTS, *problem.free)
    verdict = identifiability(names, jacobian, noise)
    values = [law.mu_s0, law.mu_s, law.mu_k]
    scale = [1.0] * 3
    for name in problem.free:
        value = start if name == "start" else getattr(law, name)
        values.append(value)
        scale.append(law.critical_slip / law.speed if name == "start" else value)
    in_units = replace(verdict, errors=verdict.errors * np.array(scale))
    # 5 % of what is no coefficient
    tolerance = [TOLERANCE] * 3 + [0.05 * s for s in scale[3:]]
    return Identification(law, start, in_units.estimates(values, tolerance), noise, n, verdict)


def _room(law: StickSlipLaw, name: str) -> float:
    """How far a coefficient can rise before the law is none."""
    return {"mu_s0": math.inf, "mu_s": law.mu_s0 - law.mu_s, "mu_k": law.mu_s - law.mu_k}[name]


# --- what a test of a column can tell --------------------------------------------------------------------------------


@dataclass(frozen=True)
class ColumnVerdict:
    """Identifiability of the six coefficients of a column: from the ``total`` force, and ``each`` filament's."""

    total: Identifiability
    each: Identifiability
    noise: float
    samples: int


def column_identifiability(column: Column, step: float, duration: float, noise: float, rate: float) -> ColumnVerdict:
    """Errors to expect of the coefficients of ``column`` (pulley, then between filaments) from a test of it.

    ``noise`` relative, ``rate`` samples a us; the first COLUMN_SPAN us of the pull at most. The Jacobian is that of the
    quasi-static model itself, by differences of COLUMN_STEP.
    """
    span = min(duration, COLUMN_SPAN)
    samples = max(len(COLUMN_COEFFICIENTS) + 1, int(span * rate))
    t = np.linspace(0.0, span, samples + 1)[1:]

    def signals(c: Column) -> FloatArray:
        r = pull(c, span, step)
        logs = np.log(r.force / (c.load / c.filaments))
        logs = np.column_stack([np.log(r.total / c.load), logs])
        return np.array([np.interp(t, r.time, column) for column in logs.T])

    base = signals(column)
    columns = []
    for where in ("pulley", "between"):
        law: StickSlipLaw = getattr(column, where)
        for name in COEFFICIENTS:
            change = COLUMN_STEP if _room(law, name) >= COLUMN_STEP else -COLUMN_STEP
            other = replace(law, **{name: getattr(law, name) + change})
            two = (other, column.between) if where == "pulley" else (column.pulley, other)
            columns.append((signals(replace(column, pulley=two[0], between=two[1])) - base) / change)
    jacobian = np.array(columns)  # (6, 1 + filaments, samples)
    total = identifiability(COLUMN_COEFFICIENTS, jacobian[:, 0].T, noise)
    each = identifiability(COLUMN_COEFFICIENTS, jacobian[:, 1:].reshape(len(columns), -1).T, noise)
    return ColumnVerdict(total, each, noise, samples)
