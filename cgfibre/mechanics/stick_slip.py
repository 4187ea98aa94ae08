r"""Stick-slip friction of filaments: the law of Chakladar 2014, Eqs 4-3 (UFRIC), and the slider on a spring.

The law gives the friction coefficient tau/p against slip. Any consistent units (here um, us); coefficients are pure
numbers. Raises :class:`cgfibre.errors.InputError` for values out of range.

Errata of the printed form: the Fortran of App B has unbalanced IF/ELSE and an extra bracket, misspells ALPHA1, gives
the slip phase as -mu_k p + ... (the equation has +mu_k p) and drops to mu_k at once where Eq 4-3 (ii) falls over a
critical slip of its own. Eqs 4-3 are implemented; what they leave open (the way back) is stated at
:meth:`StickSlipLaw.follow`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from cgfibre.errors import InputError
from cgfibre.mechanics._checks import FloatArray

IntArray = npt.NDArray[np.int64]


class Phase(IntEnum):
    """Phases of a contact: the first stick (i), the drop from it (ii), and stick and slip by turns (iii)."""

    FIRST_STICK = 0
    DROP = 1
    STICK = 2
    SLIP = 3


@dataclass(frozen=True)
class Contacts:
    """State of contacts, (n,) each: ``phase``, ``sign`` of the slip, and a point (``slip``, ``mu``) on the branch.

    On sticking branches the point is where the elastic line goes through; on slipping ones where the branch begins.
    ``last`` is the slip that was reached: less of it, against ``sign``, is a way back.
    """

    phase: IntArray
    sign: FloatArray
    slip: FloatArray
    mu: FloatArray
    last: FloatArray

    @staticmethod
    def at_rest(n: int) -> Contacts:
        """``n`` contacts that never slipped."""
        return Contacts(np.zeros(n, dtype=np.int64), np.ones(n), np.zeros(n), np.zeros(n), np.zeros(n))


@dataclass(frozen=True)
class StickSlipLaw:
    """Eqs 4-3: friction coefficient against slip gamma, in three phases.

    (i)   gamma < critical_slip: mu = mu_s0 gamma/critical_slip;
    (ii)  a fall from mu_s0 to mu_k over drop_slip;
    (iii) stick with ``restick`` times the first stiffness until mu_s, then slip with
          mu = mu_k + (mu_s - mu_k) cos(omega gamma/V), a quarter of a wave down to mu_k, and so on.

    ``frequency`` (omega = 2 pi f) and ``speed`` V shape the slip; the time of the slip at V is 1/(4 f). The thesis has
    critical_slip 2 % of an element of 1 mm, restick 0.05, f = 3.97 Hz, V = 0.16 mm/s; it does not print drop_slip (a
    quarter of critical_slip here).
    """

    mu_s0: float
    mu_s: float
    mu_k: float
    critical_slip: float
    drop_slip: float
    frequency: float
    speed: float
    restick: float = 0.05

    def __post_init__(self) -> None:
        if not 0 < self.mu_k <= self.mu_s <= self.mu_s0 or not math.isfinite(self.mu_s0):
            found = f"{self.mu_s0:g}, {self.mu_s:g}, {self.mu_k:g}"
            raise InputError("mu_s0, mu_s, mu_k", found, "falling coefficients above 0, mu_s0 >= mu_s >= mu_k")
        for name in ("critical_slip", "drop_slip", "frequency", "speed", "restick"):
            value = getattr(self, name)
            if not (value > 0 and math.isfinite(value)):
                raise InputError(name, value, "a positive number")

    @property
    def stiffness(self) -> float:
        """First stiffness mu_s0/critical_slip, per length: tau/gamma over p, Eqs 4-1 and 4-2 (times the normal force: a
        force per slip)."""
        return self.mu_s0 / self.critical_slip

    @property
    def stick_length(self) -> float:
        """Slip over which a contact sticks again: (mu_s - mu_k)/(restick mu_s0/critical_slip)."""
        return (self.mu_s - self.mu_k) / (self.restick * self.stiffness)

    @property
    def slip_length(self) -> float:
        """Slip over a quarter of the cosine: V/(4 f)."""
        return self.speed / (4 * self.frequency)

    @property
    def cycle_length(self) -> float:
        """Slip of a whole cycle of phase (iii)."""
        return self.stick_length + self.slip_length

    @property
    def cycle_frequency(self) -> float:
        """Stick-slip frequency at the speed V: 1/((mu_s - mu_k) critical_slip/(restick mu_s0 V) + 1/(4 f)).

        The law sets it: 3.45 Hz for (0.22, 0.18, 0.16) and 5.66 Hz for (0.22, 0.16, 0.15) with the thesis' other
        values; 4 f at most, as mu_s - mu_k vanishes. An unending cosine alone would give f itself.
        """
        return self.speed / self.cycle_length

    def coefficient(self, slip: npt.ArrayLike) -> FloatArray:
        """Friction coefficient tau/p on sliding one way from rest by ``slip`` (any shape); odd in it."""
        signed = np.asarray(slip, dtype=np.float64)
        g = np.abs(signed)
        drop = (g - self.critical_slip) / self.drop_slip
        later = np.mod(np.maximum(g - self.critical_slip - self.drop_slip, 0.0), self.cycle_length)
        rise = self.mu_k + self.restick * self.stiffness * later
        fall = self._cosine(later - self.stick_length)
        cyclic = np.where(later < self.stick_length, rise, fall)
        mu = np.where(drop <= 0, self.stiffness * g, np.where(drop < 1, self._falling(drop), cyclic))
        return np.sign(signed) * mu

    def _falling(self, part: FloatArray) -> FloatArray:
        return self.mu_s0 - (self.mu_s0 - self.mu_k) * part

    def _cosine(self, slip: FloatArray) -> FloatArray:
        return self.mu_k + (self.mu_s - self.mu_k) * np.cos(0.5 * np.pi * slip / self.slip_length)

    def follow(self, contacts: Contacts, slip: FloatArray) -> tuple[FloatArray, FloatArray, Contacts]:
        """Coefficient (n,), its slope d mu/d slip (n,) and the state once contacts have come to ``slip`` (n,).

        Sticking is elastic both ways. A way back while slipping (which Eqs 4-3 do not speak of) sticks with the soft
        stiffness from where it is; beyond mu_s on the other side it slips there; coming back to the fall of phase (ii)
        it falls on. Coefficients are continuous throughout.
        """
        now = replace(contacts, last=np.array(slip, dtype=np.float64))
        s = _Moving(now.phase.copy(), now.sign.copy(), now.slip.copy(), now.mu.copy())
        self._turn_back(contacts, s, slip)
        mu, slope = self._on_branch(s, slip)
        while self._leave(s, slip, mu):  # each pass takes contacts that left their branch to the next one
            mu, slope = self._on_branch(s, slip)
        return mu, slope, Contacts(s.phase, s.sign, s.slip, s.mu, now.last)

    def _turn_back(self, before: Contacts, s: _Moving, slip: FloatArray) -> None:
        back = _slipping(s.phase) & ((slip - before.last) * s.sign < 0)
        if not back.any():
            return
        mu = self._on_branch(s, before.last)[0]
        s.phase[back], s.slip[back], s.mu[back] = Phase.STICK, before.last[back], mu[back]

    def _leave(self, s: _Moving, slip: FloatArray, mu: FloatArray) -> bool:
        """Take contacts beyond the end of their branch to the next one; whether there were any."""
        first, slipping = s.phase == Phase.FIRST_STICK, _slipping(s.phase)
        side = np.where(mu < 0, -1.0, 1.0)
        # a contact that turned back in the fall of phase (ii) holds more than mu_s on that side
        limit = np.where(first, self.mu_s0, np.maximum(self.mu_s, side * s.mu))
        over = ~slipping & (side * mu > limit * (1 + 1e-12))
        if not (slipping.any() or over.any()):
            return False
        moved = slip - s.slip
        dropped = (s.phase == Phase.DROP) & (moved * s.sign >= self.drop_slip)
        slipped = (s.phase == Phase.SLIP) & (moved * s.sign >= self.slip_length)
        if not (over.any() or dropped.any() or slipped.any()):
            return False
        if over.any():
            stiffness = np.where(first, self.stiffness, self.restick * self.stiffness)
            at = s.slip + (side * limit - s.mu) / stiffness
            high = over & (first | (limit > self.mu_s))
            # where on the fall the coefficient is `limit`
            into = np.zeros_like(limit)
            if self.mu_s0 > self.mu_k:
                into = (self.mu_s0 - limit) / (self.mu_s0 - self.mu_k) * self.drop_slip
            s.sign[over] = side[over]
            s.mu[over] = (side * limit)[over]
            s.slip[over] = at[over]
            s.slip[high] -= (side * into)[high]
            s.phase[over] = np.where(high[over], Phase.DROP, Phase.SLIP)
        for ended, length in ((dropped, self.drop_slip), (slipped, self.slip_length)):
            s.slip[ended] += s.sign[ended] * length
            s.mu[ended] = s.sign[ended] * self.mu_k
            s.phase[ended] = Phase.STICK
        return True

    def _on_branch(self, s: _Moving, slip: FloatArray) -> tuple[FloatArray, FloatArray]:
        moved = slip - s.slip
        soft = self.restick * self.stiffness
        stiffness = np.where(s.phase == Phase.FIRST_STICK, self.stiffness, soft)
        elastic = s.mu + stiffness * moved
        if not _slipping(s.phase).any():
            return elastic, stiffness
        along = np.maximum(s.sign * moved, 0.0)
        falling = s.sign * self._falling(along / self.drop_slip)
        waved = s.sign * self._cosine(along)
        turn = 0.5 * np.pi / self.slip_length
        fall_slope = np.full_like(moved, -(self.mu_s0 - self.mu_k) / self.drop_slip)
        wave_slope = -(self.mu_s - self.mu_k) * turn * np.sin(turn * along)
        which = [s.phase == Phase.DROP, s.phase == Phase.SLIP]
        return np.select(which, [falling, waved], elastic), np.select(which, [fall_slope, wave_slope], stiffness)


def _slipping(phase: IntArray) -> npt.NDArray[np.bool_]:
    return (phase == Phase.DROP) | (phase == Phase.SLIP)


@dataclass
class _Moving:
    """The arrays of a state while it is worked out."""

    phase: IntArray
    sign: FloatArray
    slip: FloatArray
    mu: FloatArray


# --- slider on a spring ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Slider:
    """A mass m on a surface, pulled through a spring k (and dashpot c beside it) whose end moves at V (Fig 4-2).

    Sticks while the spring pulls less than ``static`` (mu_s N), slides against ``kinetic`` (mu_k N). With y the spring
    force less mu_k N over k: m y'' + c y' + k y = 0 while it slides, from y = A = (static - kinetic)/k, y' = V, until
    the mass stands still, y' = V, again (the classic model: Korycki; Sakamoto; Leine et al., thesis 2.4).
    """

    mass: float
    stiffness: float
    speed: float
    static: float
    kinetic: float
    damping: float = 0.0

    def __post_init__(self) -> None:
        for name in ("mass", "stiffness", "speed"):
            if not (getattr(self, name) > 0 and math.isfinite(getattr(self, name))):
                raise InputError(name, getattr(self, name), "a positive number")
        if not 0 <= self.kinetic < self.static:
            raise InputError("kinetic", self.kinetic, f"from 0 to below static, {self.static:g}")
        if not 0 <= self.damping < 2 * math.sqrt(self.mass * self.stiffness):
            limit = 2 * math.sqrt(self.mass * self.stiffness)
            raise InputError("damping", self.damping, f"from 0 to below critical, {limit:.4g}")

    @property
    def amplitude(self) -> float:
        """A = (static - kinetic)/k."""
        return (self.static - self.kinetic) / self.stiffness

    def _decay(self) -> tuple[float, float]:
        """Rate of decay and angular frequency of the free motion."""
        rate = self.damping / (2 * self.mass)
        return rate, math.sqrt(self.stiffness / self.mass - rate**2)

    def sliding(self, t: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """y and y' at times ``t`` since the mass began to slide."""
        time = np.asarray(t, dtype=np.float64)
        rate, w = self._decay()
        a, b = self.amplitude, (self.speed + rate * self.amplitude) / w
        c, s, e = np.cos(w * time), np.sin(w * time), np.exp(-rate * time)
        y = e * (a * c + b * s)
        return y, e * ((b * w - rate * a) * c - (a * w + rate * b) * s)

    @property
    def slip_time(self) -> float:
        """Time of a slide; 2 (pi - atan(A omega/V))/omega without damping, inf where damping makes it slide on."""
        _, w = self._decay()
        if self.damping == 0:
            return 2 * (math.pi - math.atan2(self.amplitude * w, self.speed)) / w

        def standing(t: float) -> float:
            return float(self.sliding(t)[1]) - self.speed

        # y' = V at the start, less than V while the mass is fast; back at V within a turn or never
        times = np.linspace(0.0, 2 * math.pi / w, 400)[1:]
        above = np.flatnonzero(self.sliding(times)[1] >= self.speed)
        if not len(above) or above[0] == 0:
            return math.inf
        return float(brentq(standing, times[above[0] - 1], times[above[0]], xtol=1e-15 * times[-1]))

    @property
    def stick_time(self) -> float:
        """Time of a stick between two slides: the spring goes from where the slide ended to ``static`` at V."""
        t = self.slip_time
        end = float(self.sliding(t)[0]) if math.isfinite(t) else 0.0
        return (self.amplitude - end) / self.speed

    @property
    def period(self) -> float:
        """Time of a cycle; 2 A/V + 2 (pi - atan(A omega/V))/omega without damping."""
        return self.slip_time + self.stick_time

    def force(self, t: npt.ArrayLike) -> FloatArray:
        """Force of the spring at times ``t`` (any shape, >= 0) since it was slack: event by event, exactly."""
        time = np.asarray(t, dtype=np.float64)
        first = self.static / (self.stiffness * self.speed)
        slip = self.slip_time
        if math.isinf(slip):
            sliding = self.sliding(np.maximum(time - first, 0.0))[0]
        else:
            within = np.mod(np.maximum(time - first, 0.0), self.period)
            end = self.sliding(slip)[0]
            slide = self.sliding(np.minimum(within, slip))[0]
            sliding = np.where(within < slip, slide, end + self.speed * (within - slip))
        pulled = self.kinetic + self.stiffness * sliding
        return np.where(time < first, self.stiffness * self.speed * time, pulled)
