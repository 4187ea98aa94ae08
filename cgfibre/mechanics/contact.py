"""Contact of filaments: parallel (line contact), crossing (Hertz), friction stiffness, damping, bumps of bead chains.

Units: um, nN, kPa (= nN/um2), pg, us; line loads f in nN/um (1 N/mm = 1e6 nN/um), k' = f/delta in kPa. Arrays
broadcast; scalars in give a numpy scalar. Every function raises :class:`cgfibre.errors.InputError` for a value out of
its range.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.special import ellipkm1, elliprd, lambertw

from cgfibre.errors import InputError
from cgfibre.mechanics._checks import FloatArray, non_negative, poisson, positive


def contact_modulus(E1: npt.ArrayLike, nu1: npt.ArrayLike, E2: npt.ArrayLike, nu2: npt.ArrayLike) -> FloatArray:
    """E* of 1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2, kPa; transverse moduli for filaments; E2 = inf: rigid."""
    first = (1 - poisson("nu1", nu1) ** 2) / positive("E1", E1, infinite=True)
    return 1 / (first + (1 - poisson("nu2", nu2) ** 2) / positive("E2", E2, infinite=True))


def relative_radius(r1: npt.ArrayLike, r2: npt.ArrayLike) -> FloatArray:
    """R* = r1 r2 / (r1 + r2), um; r2 = inf for a plane."""
    return 1 / (1 / positive("r1", r1, infinite=True) + 1 / positive("r2", r2, infinite=True))


@dataclass(frozen=True)
class LineContact:
    r"""Two parallel cylinders, or a cylinder on a rigid plane: Hertz' contact and the approach of the axes.

    Half width b = sqrt(4 f R*/(pi E*)), peak pressure 2 f/(pi b) (thesis 6-8; the printed b = 5.25e-3 mm for F = 2 N,
    l = 1 mm, r = 3.5 um, E = 10 GPa, nu = 0.3 is wrong, it exceeds the radius: b = 0.90e-3 mm).

    Approach, plane strain: every cylinder is compressed between its contact and its axis by c_i f (2 ln(4 R_i/b) -
    1)/pi, c_i = (1 - nu_i^2)/E_i (Johnson, Contact Mechanics, 5.57), together

    delta = f/(pi E*) (2 ln(4 R_g/b) - 1), with ln R_g the mean of ln R_i weighted by c_i.

    An independent finite-element solution agrees within 0.4 % to 1 N/mm for carbon; at 10 N/mm (b/R = 0.58) the
    formula is 6 % soft (lammps-findings).

    Attributes: ``modulus`` E* kPa; ``radius`` R* um; ``log_radius`` R_g um. Made by :meth:`between` and
    :meth:`on_rigid_plane`.
    """

    modulus: float
    radius: float
    log_radius: float

    def __post_init__(self) -> None:
        positive("modulus", self.modulus)
        positive("radius", self.radius)
        positive("log_radius", self.log_radius)

    @classmethod
    def between(cls, r1: float, r2: float, E1: float, nu1: float, E2: float, nu2: float) -> LineContact:
        """Two parallel elastic cylinders of radii r1, r2 (um), transverse moduli E1, E2 (kPa)."""
        modulus = float(contact_modulus(positive("E1", E1), nu1, positive("E2", E2), nu2))
        share = modulus * (1 - nu1**2) / E1
        log_radius = positive("r1", r1) ** share * positive("r2", r2) ** (1 - share)
        return cls(modulus, float(relative_radius(r1, r2)), float(log_radius))

    @classmethod
    def on_rigid_plane(cls, radius: float, E: float, nu: float) -> LineContact:
        """A cylinder on a rigid plane (platen); half the approach of two such cylinders at the same load."""
        return cls(float(contact_modulus(positive("E", E), nu, np.inf, 0.0)), radius, radius)

    def half_width(self, line_load: npt.ArrayLike) -> FloatArray:
        """Half width b of the contact, um."""
        return np.sqrt(4 * non_negative("line_load", line_load) * self.radius / (np.pi * self.modulus))

    def peak_pressure(self, line_load: npt.ArrayLike) -> FloatArray:
        """Largest contact pressure 2 f/(pi b) = sqrt(f E*/(pi R*)), kPa."""
        return np.sqrt(non_negative("line_load", line_load) * self.modulus / (np.pi * self.radius))

    def pressure(self, y: npt.ArrayLike, line_load: npt.ArrayLike) -> FloatArray:
        """Pressure pmax sqrt(1 - (y/b)^2) at distance y (um) from the middle of the contact, 0 outside, kPa."""
        b = self.half_width(positive("line_load", line_load))
        inside = np.maximum(1 - (np.asarray(y, dtype=np.float64) / b) ** 2, 0.0)
        return self.peak_pressure(line_load) * np.sqrt(inside)

    @property
    def greatest_approach(self) -> float:
        """Where delta(f) stops rising, b = 4 R_g/e, um: far beyond the theory (b << R); the domain of the inverse."""
        return 4 * self.log_radius**2 / (self.radius * np.e**2)

    def approach(self, line_load: npt.ArrayLike) -> FloatArray:
        """Approach delta of the axes (of axis and plane) under the line load, um; 0 at 0.

        Errors: a load beyond that of :attr:`greatest_approach`.
        """
        b = self.half_width(line_load)
        if np.any(b > 4 * self.log_radius / np.e):
            raise InputError("line_load", float(np.max(np.asarray(line_load))), "a contact narrower than the cylinder")
        # written in b, so that 0 log 0 = 0 needs no division by the load
        ratio = np.where(b > 0, b / (4 * self.log_radius), 1.0)
        return np.where(b > 0, -(b**2) / (4 * self.radius) * (2 * np.log(ratio) + 1), 0.0)

    def line_load(self, approach: npt.ArrayLike) -> FloatArray:
        """Line load f at an approach (inverse of :meth:`approach`, exact), nN/um.

        With t = (b/(4 R_g))^2: t (1 + ln t) = -y, y = delta R*/(4 R_g^2), so t = -y/W, W the lower branch (-1) of
        Lambert's function at -e y. Errors: approach beyond :attr:`greatest_approach`.
        """
        delta = non_negative("approach", approach)
        if np.any(delta > self.greatest_approach):
            raise InputError("approach", float(np.max(delta)), f"at most {self.greatest_approach:.4g} um")
        y = delta * self.radius / (4 * self.log_radius**2)
        safe = np.where(y > 0, y, np.exp(-2.0))
        # kept off the branch point, where lambertw gives nan
        branch = np.maximum(-np.e * safe, -np.exp(-1.0) * (1 - 1e-12))
        t = np.where(y > 0, -safe / np.real(lambertw(branch, -1)), 0.0)
        return 4 * np.pi * self.modulus * self.log_radius**2 * t / self.radius

    def secant_stiffness(self, line_load: npt.ArrayLike) -> FloatArray:
        """k' = f/delta at a line load > 0, kPa; the engine's ``hooke`` kn of a bead is k' s.

        The law is nonlinear (carbon: 1.8, 2.3, 3.3, 6.0 GPa at 0.01, 0.1, 1, 10 N/mm): take it at the load that
        matters.
        """
        return positive("line_load", line_load) / self.approach(line_load)

    def tangent_stiffness(self, line_load: npt.ArrayLike) -> FloatArray:
        """df/ddelta = pi E*/(2 ln(4 R_g/b) - 2) at a line load > 0, kPa."""
        b = self.half_width(positive("line_load", line_load))
        if np.any(b >= 4 * self.log_radius / np.e):
            raise InputError("line_load", float(np.max(np.asarray(line_load))), "a contact narrower than the cylinder")
        return np.pi * self.modulus / (2 * np.log(4 * self.log_radius / b) - 2)

    def roark_approach(self, line_load: npt.ArrayLike) -> FloatArray:
        """Approach in Roark's form, meant by thesis 6-1: f/(pi E*) (2/3 + ln(2 D1/B) + ln(2 D2/B)), um.

        B = 2 b is the *full* width in Roark (Formulas for Stress and Strain, table 14.1). The thesis prints a mangled
        form; 4 R/b with the half width b would add 2 ln 2 to the bracket. In full widths the bracket is 2 ln(4 R/b) +
        2/3 - 2 ln 2, so it exceeds the plane-strain form by a constant: delta_Roark = delta + f/(pi E*) (5/3 - 2 ln
        2), 5 % at 1 N/mm of carbon. Like materials only (R_g = sqrt(R1 R2)).
        """
        f = positive("line_load", line_load)
        return self.approach(f) + f / (np.pi * self.modulus) * (5 / 3 - 2 * np.log(2))


# --- crossing filaments ----------------------------------------------------------------------------------------------


def _axis_ratio(curvature_ratio: float) -> float:
    """Minor over major axis q of the contact ellipse of B/A = R_D(0, 1, q^2)/R_D(0, q^2, 1)."""
    if curvature_ratio <= 1 + 1e-14:
        return 1.0

    def miss(log_q: float) -> float:
        q2 = np.exp(2 * log_q)
        return float(np.log(elliprd(0.0, 1.0, q2) / elliprd(0.0, q2, 1.0)) - np.log(curvature_ratio))

    return float(np.exp(brentq(miss, -30.0, 0.0, xtol=1e-14)))


def crossing_prefactor(
    modulus: npt.ArrayLike, r1: npt.ArrayLike, r2: npt.ArrayLike, angle: npt.ArrayLike = np.pi / 2
) -> FloatArray:
    r"""C of F = C delta^(3/2) (Hertz) for two cylinders crossing at ``angle``, nN/um^1.5.

    Relative curvatures A <= B: A + B = (1/r1 + 1/r2)/2, A B = sin^2(angle)/(4 r1 r2). With q = minor/major axis of
    the contact ellipse and m = 1 - q^2: C = (2 pi E*/3) K(m)^(-3/2) sqrt((K - E)/(m A)) (Johnson, Contact Mechanics,
    4.2). Equal radii at 90 degrees: 4/3 E* sqrt(R), a sphere of R on a plane.

    Parameters: ``modulus`` E* kPa, radii um, ``angle`` between the axes, rad, 0 < angle <= pi/2 (parallel:
    :class:`LineContact`).
    """
    a1, a2, cross = positive("r1", r1), positive("r2", r2), positive("angle", angle)
    if np.any(cross > np.pi / 2):
        raise InputError("angle", float(np.max(cross)), "between 0 and pi/2")
    mean = (1 / a1 + 1 / a2) / 4
    product = np.sin(cross) ** 2 / (4 * a1 * a2)
    large = mean + np.sqrt(np.maximum(mean**2 - product, 0.0))
    small = product / large
    q2 = np.vectorize(_axis_ratio, otypes=[np.float64])(large / small) ** 2
    shape = elliprd(0.0, q2, 1.0) / 3
    return 2 * np.pi * positive("modulus", modulus) / 3 * ellipkm1(q2) ** -1.5 * np.sqrt(shape / small)


def hertz_coefficient(prefactor: npt.ArrayLike, r1: npt.ArrayLike, r2: npt.ArrayLike) -> FloatArray:
    """k_n of the engine's ``granular hertz`` so that two beads of radii r1, r2 give F = prefactor delta^(3/2), kPa.

    The engine has F = k_n sqrt(R_eff) delta^(3/2) with R_eff = r1 r2/(r1 + r2): beads touch as spheres, while crossing
    filaments touch as a sphere of R on a plane; so k_n = sqrt(2) 4/3 E* for equal ones (checked in the engine).
    """
    return positive("prefactor", prefactor) / np.sqrt(relative_radius(r1, r2))


def hertz_material_modulus(coefficient: npt.ArrayLike, nu: npt.ArrayLike) -> FloatArray:
    """E for ``granular hertz/material E ... nu`` so that its k_n = 4/3 E/(2 (1 - nu^2)) is ``coefficient``, kPa.

    It is sqrt(2) times the filament's modulus for equal crossing filaments, see :func:`hertz_coefficient`.
    """
    return 1.5 * positive("coefficient", coefficient) * (1 - poisson("nu", nu) ** 2)


# --- friction stiffness, damping, overlap ----------------------------------------------------------------------------


def mindlin_modulus(G1: npt.ArrayLike, nu1: npt.ArrayLike, G2: npt.ArrayLike, nu2: npt.ArrayLike) -> FloatArray:
    """G* of 1/G* = (2 - nu1)/G1 + (2 - nu2)/G2, kPa (Mindlin 1949)."""
    first = (2 - poisson("nu1", nu1)) / positive("G1", G1, infinite=True)
    return 1 / (first + (2 - poisson("nu2", nu2)) / positive("G2", G2, infinite=True))


def mindlin_stiffness(shear_modulus: npt.ArrayLike, contact_radius: npt.ArrayLike) -> FloatArray:
    """Tangential stiffness 8 G* a of a circular contact of radius a without slip, nN/um."""
    return 8 * positive("shear_modulus", shear_modulus) * positive("contact_radius", contact_radius)


def tangential_ratio(modulus: npt.ArrayLike, shear_modulus: npt.ArrayLike) -> FloatArray:
    """kt/kn = 4 G*/E* of a circular contact; 2 (1 - nu)/(2 - nu) for like isotropic bodies, 0.82 for nu = 0.3."""
    return 4 * positive("shear_modulus", shear_modulus) / positive("modulus", modulus)


def mindlin_coefficient(hertz_coefficient: npt.ArrayLike, ratio: npt.ArrayLike) -> FloatArray:
    """k_t of the engine's ``tangential mindlin`` with kt/kn = ``ratio``: 3/2 k_n ratio, kPa.

    The engine multiplies k_t by its own contact radius sqrt(R_eff delta), as it does with k_n; 8 G* for spheres.
    """
    return 1.5 * positive("hertz_coefficient", hertz_coefficient) * positive("ratio", ratio)


def damping_coefficient(
    ratio: npt.ArrayLike, stiffness: npt.ArrayLike, mass1: npt.ArrayLike, mass2: npt.ArrayLike = np.inf
) -> FloatArray:
    """gamma of ``damping velocity`` for a damping ratio zeta: 2 zeta sqrt(k m_eff), nN us/um; m_eff = m1 m2/(m1 + m2).

    ``mass2`` = inf for a wall.
    """
    inverse = 1 / positive("mass1", mass1) + 1 / positive("mass2", mass2, infinite=True)
    return 2 * non_negative("ratio", ratio) * np.sqrt(positive("stiffness", stiffness) / inverse)


def relative_overlap(force: npt.ArrayLike, kn: npt.ArrayLike, diameter: npt.ArrayLike) -> FloatArray:
    """Overlap F/kn of two beads over their diameter; keep it below 1-2 % (lammps-findings)."""
    return non_negative("force", force) / (positive("kn", kn) * positive("diameter", diameter))


# --- bumps of bead chains --------------------------------------------------------------------------------------------


def _half_pitch(spacing: npt.ArrayLike, diameter: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    s, D = positive("spacing", spacing), positive("diameter", diameter)
    if np.any(s >= 2 * D):
        raise InputError("spacing", float(np.max(s)), "less than two diameters (beads fall through)")
    return s / 2, D


def nested_distance(spacing: npt.ArrayLike, diameter: npt.ArrayLike) -> FloatArray:
    """Axis distance sqrt(D^2 - s^2/4) of two nested bead chains (beads in each other's gaps), um; 0.866 D at s = D."""
    half, D = _half_pitch(spacing, diameter)
    return np.sqrt(D**2 - half**2)


def bump_friction(mu: npt.ArrayLike, spacing: npt.ArrayLike, diameter: npt.ArrayLike) -> FloatArray:
    """Peak force ratio tan(asin(s/(2 D)) + atan(mu)) of one bead chain dragged over another; the mean stays near mu.

    Errors: bumps too steep to climb (s/(2 D) >= 1/sqrt(1 + mu^2)), the chains lock.
    """
    half, D = _half_pitch(spacing, diameter)
    slope = np.arcsin(half / D) + np.arctan(non_negative("mu", mu))
    if np.any(slope >= np.pi / 2):
        raise InputError("spacing", float(np.max(2 * half)), "a spacing at which the bumps can be climbed")
    return np.tan(slope)
