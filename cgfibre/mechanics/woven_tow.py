r"""A woven tow as an elastic curve z = A cos(k u), k = pi/p, against forces at its crossings, p apart.

Units: um, nN; EI nN um2; EA, kGA nN. Tows that weave alike repeat: only the quarter wave from a crest (u = 0) to the
middle between two crossings (u = p/2) is to be solved. There the fabric is point-symmetric: no moment, no displacement.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_bvp

from cgfibre.mechanics._checks import FloatArray, finite, positive


@dataclass(frozen=True)
class WovenTow:
    """Crossings ``spacing`` p um apart, ``amplitude`` A um, rigidities; ``kGA`` inf: no shear."""

    spacing: float
    amplitude: float
    EA: float
    EI: float
    kGA: float = math.inf

    @property
    def wave(self) -> float:
        """k = pi/p, 1/um."""
        return math.pi / self.spacing

    def slope(self, u: FloatArray) -> FloatArray:
        """Angle of the curve as built at u, rad."""
        return -np.arctan(self.amplitude * self.wave * np.sin(self.wave * u))

    def pace(self, u: FloatArray) -> FloatArray:
        """ds/du of the arc length as built."""
        return np.hypot(1.0, self.amplitude * self.wave * np.sin(self.wave * u))


def shallow_arch(tow: WovenTow, load: float) -> float:
    r"""Deflection of every crest (trough) under a force ``load`` nN down (up), at small slopes and loads, um.

    The forces are the series (2 F/p) sum over odd n of cos(n k u); bending meets every term by EI (n k)^4, and the
    first one, of the tow's own shape, also stretches it, the ends being held: EA A^2 k^4/2. With shear

    w = (2 F/p) [1/(k^4 (EI + EA A^2/2)) + (pi^4/96 - 1)/(EI k^4)] + F p/(4 kGA),

    without stretching F p^3/(48 EI), a beam of two half spans.
    """
    F, p = finite("load", load), tow.spacing
    k4 = tow.wave**4
    stretched = tow.EI + tow.EA * tow.amplitude**2 / 2
    bent = 2 * F / p * (1 / stretched + (math.pi**4 / 96 - 1) / tow.EI) / k4
    return float(bent + F * p / (4 * tow.kGA))


def arch(tow: WovenTow, load: float, *, dead: bool = False) -> tuple[float, float]:
    r"""(deflection um, thrust nN) of every crest and trough under ``load`` nN, of any size, the cell's length held.

    Reissner's beam of natural shape theta_0: over the arc length S of that shape, with R = (-T, F/2) the force inside
    (T the thrust), t and n along and across the section,

    EI (theta' - theta_0') = M, M' = z' R_x - x' R_z, (x', z') = (1 + R.t/EA) t + R.n/kGA n,

    theta = 0 at the crest, M = 0 and x = p/2 between the crossings. ``dead``: the tow wants to be straight, and
    constant forces make its shape free of load as built (chains at rest as built): EI theta' = M and R = (-T, F/2) -
    EI theta_0'' n_0, which keeps its direction.

    By collocation; raises RuntimeError where that does not converge, InputError for what is not positive.
    """
    F = finite("load", load)
    for name in ("spacing", "amplitude", "EA", "EI"):
        positive(name, getattr(tow, name))
    p, k, A = tow.spacing, tow.wave, tow.amplitude
    EI, EA, kGA = tow.EI, tow.EA, tow.kGA

    def natural(u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """theta_0' and theta_0'' over the arc length."""
        z1, z2, z3 = -A * k * np.sin(k * u), -A * k**2 * np.cos(k * u), A * k**3 * np.sin(k * u)
        g = 1 + z1**2
        return z2 / g**1.5, (z3 / g**1.5 - 3 * z1 * z2**2 / g**2.5) / np.sqrt(g)

    # lengths over p, moments over EI/p, forces over EI/p^2
    f, stretch, shear = float(F) / 2 * p**2 / EI, EI / (EA * p**2), EI / (kGA * p**2)

    def inside(
        u: FloatArray, theta: FloatArray, thrust: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Force (x, z) and what it is along and across the section."""
        x, z = np.full_like(u, -thrust), np.full_like(u, f)
        if dead:
            q = -natural(u)[1] * p**2
            slope = tow.slope(u)
            x, z = x - q * np.sin(slope), z + q * np.cos(slope)
        sine, cosine = np.sin(theta), np.cos(theta)
        return x, z, x * cosine + z * sine, z * cosine - x * sine

    def slopes(v: FloatArray, y: FloatArray, thrust: FloatArray) -> FloatArray:
        u = v * p
        theta, moment = y[0], y[1]
        rx, rz, along, across = inside(u, theta, float(thrust[0]))
        sine, cosine = np.sin(theta), np.cos(theta)
        kappa = 0.0 if dead else natural(u)[0] * p
        longer, sheared = 1 + stretch * along, shear * across
        dx, dz = longer * cosine - sheared * sine, longer * sine + sheared * cosine
        return np.vstack([moment + kappa, rx * dz - rz * dx, dx, dz]) * tow.pace(u)

    def ends(a: FloatArray, b: FloatArray, _: FloatArray) -> FloatArray:
        return np.array([a[0], a[2], a[3], b[1], b[2] - 0.5])

    v = np.linspace(0, 0.5, 101)
    theta = tow.slope(v * p)
    guess = np.vstack([theta, natural(v * p)[0] * p * dead, v, A / p * (np.cos(np.pi * v) - 1)])
    solution = solve_bvp(slopes, ends, v, guess, p=[0.0], tol=1e-8, max_nodes=20000)
    if not solution.success or solution.p is None:
        raise RuntimeError(f"arch: {solution.message}")
    height = -float(solution.y[3, -1]) * p
    return A - height, float(solution.p[0]) * EI / p**2
